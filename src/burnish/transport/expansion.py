"""Expansion: from the few numbers of each square to its rows.

A block's rows are combinations of its first a row directions, U[r, a] (`block`). What is
contracted along columns and tails can stay in those directions until the end, so that a
frame reads a, not r, rows of each square.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Float32, Int32
from burnish.transport.compression import SQUARE

_AREA = SQUARE * SQUARE
_SIZES = np.array([1, 2, 4, 6, 8, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 56, 64])
"""What a is padded to: a few sizes, so that one product serves many blocks."""
_PER_CALL = 256
"""Blocks that one call multiplies; calls are shared out over the cores."""
_FEW = 128
"""Blocks below which threads cost more than they save."""


@dataclass(frozen=True)
class _Group:
    """Blocks padded to one shape. U: float32 [k, 64, a], zero where padded. rows: int32
    [k, 64], latent: int32 [k, a], positions; one past the last where padded. squares: int32
    [2, k], row and column of each block's square in the picture. turn: blocks that share a
    square have different ones."""

    U: Float32
    rows: Int32
    latent: Int32
    squares: Int32
    turn: int


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
    def of(blocks: Iterable[tuple[Float32, Int32]], width: int) -> Expansion:
        """The expansion of blocks: U [r, a] and the pixels of its rows, all of one square.

        width: of the picture. Rows and directions are numbered in the blocks' order.
        """
        alike: dict[tuple[int, int], list[_Member]] = {}
        turns: dict[tuple[int, int], int] = {}
        rows = latent = 0
        for U, pixel in blocks:
            y, x = pixel // width, pixel % width
            square = int(y[0]) // SQUARE, int(x[0]) // SQUARE
            assert (y // SQUARE == square[0]).all()
            assert (x // SQUARE == square[1]).all()
            turn = turns[square] = turns.get(square, -1) + 1
            places = y % SQUARE * SQUARE + x % SQUARE
            member = _Member(U, places, rows, latent, square)
            alike.setdefault((turn, _padded(U.shape[1])), []).append(member)
            rows, latent = rows + U.shape[0], latent + U.shape[1]
        groups = tuple(
            _group(turn, a, members[start : start + _PER_CALL], rows, latent)
            for (turn, a), members in sorted(alike.items())
            for start in range(0, len(members), _PER_CALL)
        )
        return Expansion(rows, latent, groups)

    def expand(self, latent: Float32) -> Float32:
        """float32 [q, latent] to float32 [q, rows], of any number of planes q."""
        source, result = _padded_planes(latent), np.zeros((self.rows + 1, len(latent)), np.float32)

        def work(group: _Group) -> None:
            result[group.rows] = np.matmul(group.U, np.take(source, group.latent, axis=0))

        parallel_map(work, self.groups)
        return np.ascontiguousarray(result[:-1].T)

    def back(self, light: Float32) -> Float32:
        """The transpose of `expand`: float32 [q, rows] to float32 [q, latent]."""
        source, result = _padded_planes(light), np.zeros((self.latent + 1, len(light)), np.float32)

        def work(group: _Group) -> None:
            own = np.take(source, group.rows, axis=0)
            result[group.latent] = np.matmul(group.U.transpose(0, 2, 1), own)

        parallel_map(work, self.groups)
        return np.ascontiguousarray(result[:-1].T)

    def add(self, latent: Float32, picture: Float32, factor: Float32 | None = None) -> None:
        """Add what `expand` gives to the pixels of its rows.

        latent: float32 [q, latent]. picture: float32 [q last], see `blank`. factor: float32
        [rows, q] times which the rows are added, or None for 1.
        """
        q = len(latent)
        source = _padded_planes(latent)
        if factor is not None:
            factor = np.concatenate([factor, np.zeros((1, q), np.float32)])

        def work(group: _Group) -> None:
            light = np.matmul(group.U, np.take(source, group.latent, axis=0))
            if factor is not None:
                light *= np.take(factor, group.rows, axis=0)
            y, x = group.squares
            picture[y, :, x] += light.reshape(-1, SQUARE, SQUARE, q)

        # Each turn meets a square once at most
        for turn in sorted({group.turn for group in self.groups}):
            groups = [group for group in self.groups if group.turn == turn]
            if sum(len(group.U) for group in groups) < _FEW:
                for group in groups:
                    work(group)
            else:
                parallel_map(work, groups)

    def of_rows(self, kept: AnyArray) -> Expansion:
        """The expansion to some rows alone, of rising indices; directions stay as they are."""
        place = np.full(self.rows + 1, len(kept), np.int32)
        place[kept] = np.arange(len(kept))
        groups = []
        for group in self.groups:
            rows = place[group.rows]
            used = np.flatnonzero((rows < len(kept)).any(axis=1))
            if len(used):
                # What is left out must not reach the pixels either
                U = group.U[used] * (rows[used] < len(kept))[:, :, None]
                squares = group.squares[:, used]
                groups.append(_Group(U, rows[used], group.latent[used], squares, group.turn))
        return Expansion(len(kept), self.latent, tuple(groups))


def blank(width: int, height: int, planes: int) -> Float32:
    """A dark picture in whole squares: float32 [y, 8, x, 8, planes]."""
    return np.zeros((-(-height // SQUARE), SQUARE, -(-width // SQUARE), SQUARE, planes), np.float32)


def flattened(picture: Float32) -> Float32:
    """A picture in squares as one of pixels, larger by what fills the last squares: a view."""
    y, _, x, _, planes = picture.shape
    return picture.reshape(y * SQUARE, x * SQUARE, planes)


def _padded(size: int) -> int:
    """The next of the sizes; a size above all of them stays."""
    return int(_SIZES[np.searchsorted(_SIZES, size)]) if size <= _SIZES[-1] else size


def _padded_planes(planes: Float32) -> Float32:
    """Planes [q, n] side by side, and one entry that padding reads: float32 [n + 1, q]."""
    result = np.zeros((planes.shape[1] + 1, len(planes)), np.float32)
    result[:-1] = planes.T
    return result


@dataclass(frozen=True)
class _Member:
    """A block of a group. places: of its rows in the square; rows, latent: its first ones."""

    U: Float32
    places: Int32
    rows: int
    latent: int
    square: tuple[int, int]


def _group(turn: int, a: int, members: list[_Member], rows: int, latent: int) -> _Group:
    U = np.zeros((len(members), _AREA, a), np.float32)
    at_rows: AnyArray = np.full((len(members), _AREA), rows, np.int32)
    at_latent: AnyArray = np.full((len(members), a), latent, np.int32)
    for k, item in enumerate(members):
        count, own = item.U.shape
        U[k, item.places, :own] = item.U
        at_rows[k, item.places] = item.rows + np.arange(count)
        at_latent[k, :own] = item.latent + np.arange(own)
    squares = np.array([item.square for item in members], np.int32).T
    return _Group(U, at_rows, at_latent, squares, turn)
