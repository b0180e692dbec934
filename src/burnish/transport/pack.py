"""Packs: a tile's blocks of the same columns, laid side by side in a few arrays.

Thousands of small blocks contract slowly one by one. In a pack the columns of all blocks
meet their coefficients in a single matrix product per channel, whatever the blocks' ranks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from burnish.core.types import Float32, Int32
from burnish.transport.basis import Basis
from burnish.transport.block import Block, Tile
from burnish.transport.rows import Rows
from burnish.transport.stack import Stack, stacks_of


@dataclass
class Pack:
    """Blocks k of one object, kind and first column; r_k rows and ranks a_k, b_k each.

    shape: int32 [blocks, 3], (r_k, a_k, b_k). rows: int32 [Σ r_k], block by block, indices
    into the view's (in a tile: the tile's) Rows. U: float32 [Σ r_k · a_k], each block's
    [r, a] flattened. core: float16 or float32 [3, c, Σ a_k · b_k], weighted, each block's
    [a, b] flattened along the last axis. S: float16 or float32 [Σ b_k, z].
    column_scale: float32 [c], 1/w_c.
    """

    object: int
    indirect: bool
    shape: Int32
    rows: Int32
    U: Float32
    core: np.ndarray
    S: np.ndarray
    column_scale: Float32
    start: int = 0

    @cached_property
    def offsets(self) -> np.ndarray:
        """Where each block starts in (rows, U, core's last axis, S): int64 [blocks + 1, 4]."""
        r, a, b = self.shape.T.astype(np.int64)
        sizes = np.stack([r, r * a, a * b, b], axis=1)
        return np.concatenate([np.zeros((1, 4), np.int64), np.cumsum(sizes, axis=0)])

    @property
    def nbytes(self) -> int:
        return sum(x.nbytes for x in (self.shape, self.rows, self.U, self.core, self.S))

    @staticmethod
    def of(blocks: Sequence[Block]) -> Pack:
        """The pack of at least one block, all of the same columns."""
        first = blocks[0]
        assert len({(b.object, b.indirect, b.start) for b in blocks}) == 1
        columns = len(first.column_scale)
        return Pack(
            object=first.object,
            indirect=first.indirect,
            shape=np.array(
                [(len(b.rows), b.core.shape[0], b.core.shape[2]) for b in blocks], np.int32
            ),
            rows=np.concatenate([b.rows for b in blocks]),
            U=np.concatenate([b.U.ravel() for b in blocks]),
            core=np.concatenate(
                [b.core.transpose(3, 1, 0, 2).reshape(3, columns, -1) for b in blocks], axis=2
            ),
            S=np.concatenate([b.S for b in blocks]),
            column_scale=first.column_scale,
            start=first.start,
        )

    def blocks(self) -> list[Block]:
        """The blocks again; arrays are copies."""
        result = []
        for k, (r, a, b) in enumerate(self.shape):
            at, end = self.offsets[k], self.offsets[k + 1]
            core = self.core[:, :, at[2] : end[2]].reshape(3, -1, a, b)
            result.append(
                Block(
                    self.object,
                    self.indirect,
                    self.rows[at[0] : end[0]].copy(),
                    self.U[at[1] : end[1]].reshape(r, a).copy(),
                    np.ascontiguousarray(core.transpose(2, 1, 3, 0)),
                    self.S[at[3] : end[3]].astype(np.float32),
                    self.column_scale,
                    self.start,
                )
            )
        return result


def packs_of(blocks: Sequence[Block]) -> list[Pack]:
    """One pack for each object, kind and first column that occurs."""
    groups: dict[tuple[int, bool, int], list[Block]] = {}
    for block in blocks:
        groups.setdefault((block.object, block.indirect, block.start), []).append(block)
    return [Pack.of(groups[key]) for key in sorted(groups)]


class BlockSource(Protocol):
    """A view's compressed transport: what a bake leaves, in memory or on disk.

    base: float32 [height, width, 3], light that met no symbolic object, with directly seen
    emission; emission: the directly seen emission alone; both float32
    [lights, height, width, 3] where the basis tells light groups apart. packs: their `rows`
    index `rows`.
    """

    @property
    def basis(self) -> Basis: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def rows(self) -> Rows: ...
    @property
    def base(self) -> Float32: ...
    @property
    def emission(self) -> Float32: ...
    @property
    def revision(self) -> int: ...
    def packs(self) -> Sequence[Pack]: ...
    def stacks(self) -> Sequence[Stack]:
        """The same laid out for freezing and frames."""
        ...


@dataclass
class TiledBlocks:
    """A `BlockSource` in memory."""

    basis: Basis
    width: int
    height: int
    rows: Rows
    base: Float32
    emission: Float32
    content: list[Pack] = field(default_factory=list)
    revision: int = 0
    _stacks: list[Stack] | None = field(default=None, init=False, repr=False)

    def packs(self) -> Sequence[Pack]:
        return self.content

    def stacks(self) -> Sequence[Stack]:
        if self._stacks is None:
            self._stacks = stacks_of(self.content, self.rows, self.width)
        return self._stacks

    @staticmethod
    def of(basis: Basis, width: int, height: int, tiles: Sequence[Tile]) -> TiledBlocks:
        """Join finished tiles, which must not overlap, into one view."""
        return join(
            basis,
            width,
            height,
            [(tile, packs_of(tile.blocks)) for tile in tiles],
        )


def join(
    basis: Basis, width: int, height: int, tiles: Sequence[tuple[Tile, list[Pack]]]
) -> TiledBlocks:
    """One view from tiles whose blocks are packed, rows renumbered."""
    apart = (len(basis.lights),) if basis.lights else ()
    base = np.zeros((*apart, height, width, 3), np.float32)
    emission = np.zeros_like(base)
    joined = Rows.concatenate([tile.rows for tile, _ in tiles])
    order = np.lexsort((joined.pixel, joined.indirect, joined.object))
    position = np.empty(len(order), np.int32)
    position[order] = np.arange(len(order), dtype=np.int32)
    content: list[Pack] = []
    start = 0
    for tile, packs in tiles:
        area = np.s_[..., tile.y : tile.y + tile.height, tile.x : tile.x + tile.width, :]
        base[area] = tile.fixed + tile.emission
        emission[area] = tile.emission
        content += [replace(pack, rows=position[start + pack.rows]) for pack in packs]
        start += len(tile.rows)
    return TiledBlocks(basis, width, height, joined.select(order), base, emission, content)
