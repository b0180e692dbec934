"""Values between which a lobe changes little, and how what varies over rows lies among them.

Each painted number is an axis with nodes of its own. A point of a row lies between the nodes of
every axis, and a row's shares of their combinations are the mean of its points'.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from burnish.core.errors import TooLarge
from burnish.core.types import Float32, Float64, Int32, Int64, Value
from burnish.materials.images.image import Place

_CHUNK = 4096
"""Rows whose points are shared out among nodes at a time."""
_MOST_SHARES = 1 << 28

Node = tuple[tuple[Place, Value], ...]
"""The painted parameters' values at an entry of a table."""


@dataclass(frozen=True)
class Axis:
    """A painted number: regular nodes, values that are nodes of their own, and each row's.

    channel: the channel of a colour whose channels mix, else None. nodes: as many as `position`
    tells apart. values: float64 [r, points, 1 or 3]. position: from values to places among the
    nodes, 0 to len(nodes) - 1. cubic: interpolate between four nodes, else between two.
    """

    place: Place
    channel: int | None
    nodes: Float64
    special: Float64
    values: Float64
    position: Callable[[Float64], Float64]
    cubic: bool

    @cached_property
    def all_nodes(self) -> Float64:
        return np.concatenate([self.nodes, np.unique(self.special)])

    @property
    def size(self) -> int:
        return len(self.all_nodes)

    def corners(self, rows: slice) -> tuple[Int64, Float32]:
        """The nodes about each value and their shares: [r, points, 2 or 4, 1 or 3] each.

        Nodes without a share repeat one that has some.
        """
        values = self.values[rows]
        r, points, channels = values.shape
        values = values.reshape(-1, channels)
        count = 4 if self.cubic else 2
        index = np.zeros((len(values), count, channels), np.int64)
        share = np.zeros(index.shape, np.float32)
        exact = np.unique(self.special)
        between = np.ones(values.shape, np.bool_)
        if len(exact):
            place = np.minimum(np.searchsorted(exact, values), len(exact) - 1)
            between = exact[place] != values
            index[:] = len(self.nodes) + place[:, None]
            share[:, 0] = 1.0
        row, channel = np.nonzero(between)
        index[row, :, channel], share[row, :, channel] = self._between(values[between])
        shape = r, points, count, channels
        return index.reshape(shape), share.reshape(shape)

    def _between(self, values: Float64) -> tuple[Int64, Float64]:
        """Regular nodes about values and their shares: [m, 2 or 4] each."""
        last = len(self.nodes) - 1
        at = np.clip(self.position(values), 0.0, last)
        if self.cubic:
            first = np.clip(np.floor(at).astype(np.int64) - 1, 0, last - 3)
            x = at - first
            a, b, c, d = x, x - 1, x - 2, x - 3
            shares = [-b * c * d / 6, a * c * d / 2, -a * b * d / 2, a * b * c / 6]
        else:
            first = np.clip(np.floor(at).astype(np.int64), 0, last - 1)
            shares = [1 - (at - first), at - first]
        share = np.stack(shares, axis=1)
        index = first[:, None] + np.arange(len(shares))
        largest = np.take_along_axis(index, np.abs(share).argmax(axis=1)[:, None], axis=1)
        return np.where(share == 0, largest, index), share


def joint(axes: Sequence[Axis], rows: slice, count: int) -> tuple[Int64, Float32]:
    """Combinations of all axes' nodes and their shares: [r, points, corners, 1 or 3] each."""
    index = np.zeros((len(range(count)[rows]), 1, 1, 1), np.int64)
    share = np.ones(index.shape, np.float32)
    for axis in axes:
        # Corners of the axes so far, times this one's
        more, part = axis.corners(rows)
        joint = index[:, :, :, None] * axis.size + more[:, :, None]
        r, points, _, _, channels = joint.shape
        index = joint.reshape(r, points, -1, channels)
        share = (share[:, :, :, None] * part[:, :, None]).reshape(index.shape)
    return index, share


def shared_out(
    axes: Sequence[Axis], count: int, importance: Float32 | None
) -> tuple[Int64, Int32, Float32]:
    """The nodes that the points of the rows have, and each row's mean shares of all of them.

    importance: what each point counts, float32 [r, points]; alike without it.
    Gives keys [q], places int32 and shares float32, both [r, q, 1 or 3].
    Raises TooLarge.
    """
    size = int(np.prod([axis.size for axis in axes]))
    parts: list[tuple[Int64, Float32]] = []
    used = np.zeros(size, np.bool_)
    for start in range(0, count, _CHUNK):
        rows = slice(start, min(start + _CHUNK, count))
        index, share = joint(axes, rows, count)
        r, points, _, channels = index.shape
        if importance is not None:
            share = share * importance[rows, :, None, None]
        first = size * np.arange(r).reshape(-1, 1, 1)
        dense = np.stack(
            [
                np.bincount((first + index[..., h]).ravel(), share[..., h].ravel(), r * size)
                for h in range(channels)
            ],
            axis=1,
        ).reshape(r, size, channels)
        own = np.flatnonzero(np.abs(dense).any(axis=(0, 2)))
        used[own] = True
        parts.append((own, (dense[:, own] / points).astype(np.float32)))
    keys = np.flatnonzero(used)
    channels = parts[0][1].shape[2] if parts else 1
    if count * len(keys) * channels > _MOST_SHARES:
        raise TooLarge(
            "so many maps on one object at a time do not fit; take one off, or make the picture "
            "smaller"
        )
    shares = np.zeros((count, len(keys), channels), np.float32)
    for number, (own, part) in enumerate(parts):
        start = number * _CHUNK
        shares[start : start + len(part), np.searchsorted(keys, own)] = part
    order = np.arange(len(keys), dtype=np.int32)[:, None]
    places = np.broadcast_to(order, (count, len(keys), channels))
    return keys, places, shares


def even(low: float, high: float, count: int) -> tuple[Float64, Callable[[Float64], Float64]]:
    """Equally spaced nodes, and values' places among them."""
    return np.linspace(low, high, count), lambda value: (value - low) / (high - low) * (count - 1)


def distinct(index: Int64, count: int) -> tuple[Int64, Int32]:
    """The distinct values of an index below `count`, rising, and each one's place among them."""
    if count > 1 << 20:
        keys, places = np.unique(index, return_inverse=True)
        return keys, places.reshape(index.shape).astype(np.int32)
    used = np.zeros(count, np.bool_)
    used[index] = True
    return np.flatnonzero(used), (np.cumsum(used, dtype=np.int32) - 1)[index]


def node_of(axes: list[Axis], key: int) -> Node:
    """The painted values of a combination of nodes."""
    values: dict[Place, Value] = {}
    mixed: dict[Place, dict[int, float]] = {}
    for axis in reversed(axes):
        key, position = divmod(key, len(axis.all_nodes))
        number = float(axis.all_nodes[position])
        if axis.channel is not None:
            mixed.setdefault(axis.place, {})[axis.channel] = number
        else:
            wide = axis.values.shape[2] == 3
            values[axis.place] = (number,) * 3 if wide else number
    for place, channels in mixed.items():
        values[place] = (channels[0], channels[1], channels[2])
    return tuple(sorted(values.items()))
