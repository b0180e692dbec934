"""Frames of painted objects: rows that each have a material of their own.

B = base + Σ_parts H(row) Σ_nodes share(row, node) · s_node(θo) Σ_n power_n Σ_c c_node F[row, c, n]:
2008's eq. 28 with its coefficients a function of the row, which is a mixture of uniform
materials (`materials.painting.varied`). The light of a node is contracted once for all rows
and kept, so that a stroke costs a mixture of its own rows; the powers, which the mean of all
rows decides, are those of the same frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from burnish.core.errors import TooLarge
from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Bool, Float32, Float64, Int64
from burnish.materials.painting.nodes import Node
from burnish.materials.painting.varied import VariedLayer, VariedMaterial
from burnish.runtime.freeze import machine_memory
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import State
from burnish.transport.contraction import fold, meet_tails
from burnish.transport.frozen import FoldedPart, Frozen, FrozenPart
from burnish.transport.stack import Stack

_TOGETHER = 8
"""Nodes whose light is contracted in one reading of the transport."""
_FEW = 64
"""Nodes of a row that are compared with those that it had in the last frame."""
_SPARE = 8
"""Nodes that the store has room for beyond those in use."""


@dataclass(frozen=True)
class PaintedRows:
    """An object's fine rows and what they are made of in the present frame.

    pixel: int32 [r], rising. material: its numbers, row by row.
    """

    pixel: AnyArray
    material: VariedMaterial


class PaintedRenderer:
    """Turns a `Frozen` of which some targets are painted into images.

    >>> renderer = PaintedRenderer(frozen, frozenset({0}))         # doctest: +SKIP
    >>> picture = renderer.image(state, {0: rows})                 # doctest: +SKIP
    """

    def __init__(self, frozen: Frozen, painted: frozenset[int]) -> None:
        self.frozen, self.painted = frozen, painted
        own = [part for part in frozen.parts if _is_painted(part, painted)]
        others = [part for part in frozen.parts if not _is_painted(part, painted)]
        self._others = Renderer(replace(frozen, parts=others))
        powers = len(frozen.powers.exponents)
        self._parts = [_Part(part, powers, frozen.width) for part in own]

    def image(self, state: State, rows: Mapping[int, PaintedRows]) -> Float32:
        """The picture: float32 [h, w, 3], linear RGB. rows: those of each painted object.

        A painted object counts by its mean from the second encounter on, and where it is
        first met after rough surfaces.
        """
        objects = self.frozen.basis.objects
        mixed = {**state, **{objects[i].id: item.material.mean for i, item in rows.items()}}
        image = np.array(self._others.image(mixed))
        flat = image.reshape(-1, 3)
        powers = self.frozen.powers.evaluate(self.frozen.basis, mixed).astype(np.float32)
        for part in self._parts:
            flat[part.pixel] += part.light(rows[part.object], powers)
        return image


def _is_painted(part: FrozenPart | FoldedPart, painted: frozenset[int]) -> bool:
    return part.object in painted and part.slice is not None and not part.indirect


class _Part:
    """A frozen part whose rows have materials of their own."""

    def __init__(self, part: FrozenPart | FoldedPart, powers: int, width: int) -> None:
        assert part.slice is not None
        _check_memory(12 * powers * len(part.pixel))
        self._width = width
        self.part, self.slice = part, part.slice
        self.object, self.pixel = part.object, part.pixel
        self._light = np.zeros((powers, 3, len(part.pixel)), np.float32)
        self._slots: dict[Node, int] = {}
        """Where the light of a node stands in the store."""
        self._store = np.zeros((0, *self._light.shape), np.float32)
        """The light of nodes in every row: float32 [slots, powers, 3, r]."""
        self._place: AnyArray | None = None
        self._known: VariedLayer | None = None

    def light(self, rows: PaintedRows, powers: Float32) -> Float32:
        """What the part adds to its pixels: float32 [r, 3]."""
        layer = rows.material.layers[self.slice.layer]
        if self._place is None:
            self._place = _places(rows.pixel, self.pixel, self._width)
        changed = np.flatnonzero(self._changed(layer))
        if len(changed):
            self._mix(layer, self._first_column(rows), changed)
        self._known = layer
        light = np.einsum("nhr,nh->rh", self._light, powers)
        return np.asarray(light * layer.factor[self._place])

    def _changed(self, layer: VariedLayer) -> Bool:
        """Which of the part's rows are made of other nodes than in the last frame."""
        before, place = self._known, self._place
        if before is layer:
            return np.zeros(len(self.pixel), np.bool_)
        if before is None or before.version != layer.version:
            self._slots = {}
            return np.ones(len(self.pixel), np.bool_)
        if before.index.shape != layer.index.shape or layer.index.shape[1] > _FEW:
            return np.ones(len(self.pixel), np.bool_)
        # Entries of the two tables are told apart by their values, not by their places
        where = {node: n for n, node in enumerate(layer.nodes)}
        same = np.array([where.get(node, -1) for node in before.nodes])
        index = same[before.index] != layer.index
        other = (index | (before.share != layer.share)).reshape(len(layer.index), -1)
        return np.asarray(other.any(axis=1)[place])

    def _mix(self, layer: VariedLayer, first: int, changed: Int64) -> None:
        """Σ_nodes share · light of the node, for some rows."""
        assert self._place is not None
        self._light_nodes(layer, slice(self.slice.start - first, self.slice.stop - first))
        slots = np.array([self._slots[node] for node in layer.nodes])
        place = self._place[changed]
        index, share = slots[layer.index[place]], layer.share[place]
        mixed = np.zeros((len(changed), *self._light.shape[:2]), np.float32)
        for k in range(index.shape[1]):
            for h in range(3):
                own = min(h, index.shape[2] - 1)
                hit = np.flatnonzero(share[:, k, own])
                light = self._store[index[hit, k, own], :, h, changed[hit]]
                mixed[hit, :, h] += share[hit, k, own, None] * light
        self._light[:, :, changed] = mixed.transpose(1, 2, 0)

    def _light_nodes(self, layer: VariedLayer, columns: slice) -> None:
        """Make sure that the store has the light of all nodes of a layer, and few others."""
        fresh = [node for node in layer.nodes if node not in self._slots]
        if len(self._slots) + len(fresh) > 2 * len(layer.nodes) + _SPARE:
            kept = [node for node in layer.nodes if node in self._slots]
            self._store = self._store[[self._slots[node] for node in kept]]
            self._slots = {node: slot for slot, node in enumerate(kept)}
        need = len(self._slots) + len(fresh)
        if need > len(self._store):
            _check_memory((need + _SPARE) * self._light.nbytes)
            store = np.empty((need + _SPARE, *self._light.shape), np.float32)
            store[: len(self._store)] = self._store
            self._store = store
        cosines = self.part.cos_theta_o.astype(np.float64)
        for start in range(0, len(fresh), _TOGETHER):
            nodes = fresh[start : start + _TOGETHER]
            c = np.stack([layer.table.coefficients(node)[columns] for node in nodes])
            for node, light in zip(nodes, self._uniform(c), strict=True):
                factor = layer.table.outgoing(node, cosines, self.slice.delta)
                slot = self._slots[node] = len(self._slots)
                self._store[slot] = light
                if factor is not None:
                    self._store[slot] *= factor.T.astype(np.float32)

    def _uniform(self, coefficients: Float64) -> Iterator[Float32]:
        """Σ_c c F[:, c, n] of all rows for each of some materials [q, columns, 3]."""
        if isinstance(self.part, FoldedPart):
            return _folded(self.part, coefficients)
        part = self.part
        return (_plain(part, c) for c in coefficients)

    def _first_column(self, rows: PaintedRows) -> int:
        """The first column of the slice's layer among the object's."""
        return sum(item.layer.columns for item in rows.material.layers[: self.slice.layer])


def _places(known: AnyArray, pixel: AnyArray, width: int) -> AnyArray:
    """Which of an object's rows, of known rising pixels, each of a part's pixels is.

    A live part has been sampled anew and may meet a silhouette where the view's rows do not:
    such a pixel takes a neighbour's paint.
    """
    last = len(known) - 1
    result = np.minimum(np.searchsorted(known, pixel), last)
    missing = np.flatnonzero(known[result] != pixel)
    for step in (1, -1, width, -width, width + 1, width - 1, -width + 1, -width - 1):
        near = pixel[missing] + step
        at = np.minimum(np.searchsorted(known, near), last)
        there = known[at] == near
        result[missing[there]] = at[there]
        missing = missing[~there]
    return result


def _check_memory(need: int) -> None:
    limit = machine_memory() // 4
    if need > limit:
        raise TooLarge(
            f"painting this needs {need / 1e9:.1f} GB and at most {limit / 1e9:.1f} GB may be "
            "used: erase the paint of other objects, or select fewer"
        )


def _plain(part: FrozenPart, coefficients: Float64) -> Float32:
    """Σ_c c F[r, c, n]: float32 [powers, 3, r]."""
    columns = len(coefficients)
    count = part.F.shape[2] // columns
    c = coefficients.astype(np.float32)
    products = np.empty((count, 3, part.F.shape[1]), np.float32)
    for h in range(3):
        # One product: column c, power n of F meets c in column n
        weights = np.kron(c[:, h, None], np.eye(count, dtype=np.float32))
        products[:, h] = (part.F[h] @ weights).T
    return products if part.expansion is None else _expanded(part, products)


def _folded(part: FoldedPart, coefficients: Float64) -> Iterator[Float32]:
    """The same from the blocks themselves, which are read once for some materials [q, c, 3]."""
    z, n, _ = part.factors.shape
    tails = part.tails
    if tails is None:
        flat = part.factors.transpose(0, 2, 1).reshape(z, 3 * n)
        tails = meet_tails(part.stack, flat).reshape(3, n, -1)
    for cells in _cells(part.stack, coefficients):
        latent = fold(part.stack, list(cells), tails)
        yield _expanded(part, latent.transpose(1, 0, 2))


def _cells(stack: Stack, coefficients: Float64) -> Float32:
    """Σ_c C[h, cell, c] coefficients[q, c, h]: float32 [q, 3, cells]."""
    # Always as many at a time, so that rounding does not tell what a node was made with
    weights = np.zeros((3, _TOGETHER, stack.columns), np.float32)
    weights[:, : len(coefficients)] = coefficients.transpose(2, 0, 1) * stack.scale[:, None]
    chunks, _, width = stack.core.shape[1:]
    result = np.empty((_TOGETHER, 3, chunks, width), np.float32)

    def work(h: int, chunk: int) -> None:
        part = stack.core[h, chunk].astype(np.float32, copy=False)
        result[:, h, chunk] = weights[h] @ part

    parallel_map(work, *zip(*np.ndindex(3, chunks), strict=True))
    return result[: len(coefficients)].reshape(-1, 3, chunks * width)


def _expanded(part: FrozenPart | FoldedPart, latent: Float32) -> Float32:
    """From directions [powers, 3, directions] to rows: float32 [powers, 3, r]."""
    expansion = part.stack.expansion if isinstance(part, FoldedPart) else part.expansion
    assert expansion is not None
    flat = np.ascontiguousarray(latent.reshape(-1, latent.shape[2]))
    return expansion.expand(flat).reshape(*latent.shape[:2], -1)
