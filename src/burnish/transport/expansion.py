"""Expansion: from the few numbers of each square to its rows.

A block's rows are combinations of its first a row directions, U[r, a] (`block`). What is
contracted along columns and tails can stay in those directions until the end, so that a
frame reads a, not r, rows of each square.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Float32, Int32

_SIZES = np.array([1, 2, 4, 6, 8, 12, 16, 24, 32, 48, 64])
"""What r and a are padded to: a few sizes, so that one product serves many blocks."""
_PER_CALL = 256
"""Blocks that one call multiplies; calls are shared out over the cores."""


@dataclass(frozen=True)
class _Group:
    """Blocks padded to one shape. U: float32 [k, r, a], zero where padded. rows: int32 [k, r],
    latent: int32 [k, a], positions; one past the last where padded."""

    U: Float32
    rows: Int32
    latent: Int32


@dataclass(frozen=True)
class Expansion:
    """light[h, r] = Σ_a U[r, a] latent[h, a], block by block.

    rows, latent: how many of each in all.
    """

    rows: int
    latent: int
    groups: tuple[_Group, ...]

    @property
    def nbytes(self) -> int:
        """Bytes of U, padding included."""
        return sum(group.U.nbytes for group in self.groups)

    @staticmethod
    def of(blocks: Iterable[Float32]) -> Expansion:
        """The expansion of U [r, a] of each block; rows and directions in the blocks' order."""
        alike: dict[tuple[int, int], list[tuple[Float32, int, int]]] = {}
        rows = latent = 0
        for U in blocks:
            r, a = U.shape
            alike.setdefault((_padded(r), _padded(a)), []).append((U, rows, latent))
            rows, latent = rows + r, latent + a
        groups = tuple(
            _group(shape, members[start : start + _PER_CALL], rows, latent)
            for shape, members in alike.items()
            for start in range(0, len(members), _PER_CALL)
        )
        return Expansion(rows, latent, groups)

    def expand(self, latent: Float32) -> Float32:
        """float32 [q, latent] to float32 [q, rows], of any number of planes q."""
        return self._through(latent, self.rows, forward=True)

    def back(self, light: Float32) -> Float32:
        """The transpose of `expand`: float32 [q, rows] to float32 [q, latent]."""
        return self._through(light, self.latent, forward=False)

    def places(self, pixel: Int32, count: int) -> list[AnyArray]:
        """For `add`: the pixel of every row of each group, of `count` pixels in all."""
        known = np.append(pixel, np.int32(count))
        return [known[group.rows] for group in self.groups]

    def add(
        self,
        latent: Float32,
        picture: Float32,
        places: Sequence[AnyArray],
        factor: Float32 | None = None,
    ) -> None:
        """Add what `expand` gives to the pixels of a picture.

        latent: float32 [q, latent]. picture: float32 [pixels + 1, q]; its last entry is left
        as it is. places: see `places`; a pixel has one row. factor: float32 [rows, q], or 1.
        """
        source = np.zeros((self.latent + 1, len(latent)), np.float32)
        source[:-1] = latent.T
        if factor is not None:
            factor = np.concatenate([factor, np.zeros_like(factor[:1])])

        def work(group: _Group, place: AnyArray) -> None:
            light = np.matmul(group.U, source[group.latent])
            if factor is not None:
                light *= factor[group.rows]
            picture[place] += light

        parallel_map(work, self.groups, places)

    def of_rows(self, kept: AnyArray) -> Expansion:
        """The expansion to some rows alone, of rising indices; directions stay as they are."""
        place = np.full(self.rows + 1, len(kept), np.int32)
        place[kept] = np.arange(len(kept))
        groups = []
        for group in self.groups:
            rows = place[group.rows]
            used = np.flatnonzero((rows < len(kept)).any(axis=1))
            if len(used):
                groups.append(_Group(group.U[used], rows[used], group.latent[used]))
        return Expansion(len(kept), self.latent, tuple(groups))

    def _through(self, values: Float32, count: int, forward: bool) -> Float32:
        # Planes side by side, and one entry that padding reads and writes
        planes = values.shape[0]
        source = np.zeros((values.shape[1] + 1, planes), np.float32)
        source[:-1] = values.T
        result = np.zeros((count + 1, planes), np.float32)

        def work(group: _Group) -> None:
            if forward:
                result[group.rows] = np.matmul(group.U, source[group.latent])
            else:
                result[group.latent] = np.matmul(group.U.transpose(0, 2, 1), source[group.rows])

        parallel_map(work, self.groups)
        return np.ascontiguousarray(result[:-1].T)


def _padded(size: int) -> int:
    """The next of the sizes; a size above all of them stays."""
    return int(_SIZES[np.searchsorted(_SIZES, size)]) if size <= _SIZES[-1] else size


def _group(
    shape: tuple[int, int], members: list[tuple[Float32, int, int]], rows: int, latent: int
) -> _Group:
    r, a = shape
    U = np.zeros((len(members), r, a), np.float32)
    at_rows: AnyArray = np.full((len(members), r), rows, np.int32)
    at_latent: AnyArray = np.full((len(members), a), latent, np.int32)
    for k, (own, row, direction) in enumerate(members):
        U[k, : own.shape[0], : own.shape[1]] = own
        at_rows[k, : own.shape[0]] = row + np.arange(own.shape[0])
        at_latent[k, : own.shape[1]] = direction + np.arange(own.shape[1])
    return _Group(U, at_rows, at_latent)
