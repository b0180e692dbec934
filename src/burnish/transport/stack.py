"""Stacks: a whole view's blocks of the same columns, laid out for few large products.

A stack holds what a freeze and a frame read, in the order in which they read it:

    light[r] = Σ_a U[r, a] Σ_b S'[b] Σ_c C[a, c, b] / w_c · coefficient_c,   S' = S · tails

The pairs (a, b) of all blocks are its *cells*. They lie in chunks, the columns of a chunk one
after the other, so that columns meet their coefficients in one product per chunk and dark ones
are not read. Blocks are sorted by their rank b over tails, and the cells of one rank lie
[b, direction]: the sum over b is one of long vectors. Cores are 16-bit integers with a scale
for each column and channel: NumPy widens those ten times faster than half floats, in as few
bytes, and half a step of a column's peak is far below what compression leaves out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Float32, Float64, Int32, Int64
from burnish.transport.expansion import Expansion
from burnish.transport.rows import Rows

if TYPE_CHECKING:
    from burnish.transport.pack import Pack

_LEVELS = 32767
_NO_LIGHT = np.float32(1e-30)
"""The step of a column of zeros."""
CHUNK = 1 << 17
"""Numbers of a chunk; widened to float32 they stay in a core's cache."""
_NARROWEST = 64
"""Cells of a chunk at least, however many columns there are: shorter sums cost more than memory."""


@dataclass(frozen=True)
class Run:
    """Blocks of one rank b. cells, tails, directions: where they lie among the stack's, cells
    and tails [b, directions or blocks]. counts: int64 [blocks], directions of each."""

    rank: int
    cells: slice
    tails: slice
    directions: slice
    counts: Int64

    def spread(self, tails: Float32) -> Float32:
        """Numbers of tail directions [3, n, all] at the cells: float32 [3, n, b, directions]."""
        own = tails[:, :, self.tails].reshape(*tails.shape[:2], self.rank, -1)
        return np.repeat(own, self.counts, axis=-1)


@dataclass
class Stack:
    """Blocks of one object, kind and first column of a view.

    rows: int32 [r], indices into the view's Rows, block by block; pixel: theirs, unique.
    cos_theta_o: float32 [r]. core: int16 or float32 [3, chunks, c, cells of a chunk], zero
    after the last cell; times scale, float32 [3, c], it is the transport. S: float32 [tail
    directions, z]. expansion: from latent directions to the rows. nbytes: of the blocks as
    they are stored.
    """

    object: int
    indirect: bool
    start: int
    rows: Int32
    pixel: Int32
    cos_theta_o: Float32
    core: AnyArray
    scale: Float32
    S: Float32
    runs: tuple[Run, ...]
    expansion: Expansion
    nbytes: int
    kept: dict[int, tuple[Float64, Float32]] = field(default_factory=dict, repr=False)
    """By channel: relative weights, float64 [c], and the cells that they were contracted to."""

    @property
    def columns(self) -> int:
        return int(self.core.shape[2])

    @property
    def cells(self) -> int:
        """Cells, those after the last one included."""
        return int(self.core.shape[1] * self.core.shape[3])

    @property
    def directions(self) -> int:
        """Latent directions of all blocks."""
        return self.expansion.latent

    @staticmethod
    def of(packs: Sequence[Pack], rows: Rows, width: int) -> Stack:
        """The stack of packs, all of the same columns, of a view that many pixels wide."""
        first = packs[0]
        assert len({(p.object, p.indirect, p.start) for p in packs}) == 1
        blocks = [(pack, j) for pack in packs for j, (_, a, b) in enumerate(pack.shape) if a * b]
        blocks.sort(key=lambda block: int(block[0].shape[block[1], 2]))
        shapes = np.array([pack.shape[j] for pack, j in blocks], np.int64)
        runs = _runs(shapes)

        # What a block has in U, rows and S, in the runs' order
        S = np.empty((runs[-1].tails.stop, first.S.shape[1]), np.float32)
        own: list[tuple[Float32, Int32]] = []
        at = 0
        for run in runs:
            tails = S[run.tails].reshape(run.rank, -1, S.shape[1])
            for k in range(len(run.counts)):
                pack, j = blocks[at]
                begin, end = pack.offsets[j], pack.offsets[j + 1]
                U = pack.U[begin[1] : end[1]].reshape(pack.shape[j, :2])
                own.append((U, pack.rows[begin[0] : end[0]]))
                tails[:, k] = pack.S[begin[3] : end[3]]
                at += 1
        members = np.concatenate([which for _, which in own])
        core, scale = _core(blocks, runs)
        return Stack(
            object=first.object,
            indirect=first.indirect,
            start=first.start,
            rows=members,
            pixel=rows.pixel[members],
            cos_theta_o=rows.cos_theta_o[members],
            core=core,
            scale=scale,
            S=S,
            runs=runs,
            expansion=Expansion.of([(U, rows.pixel[which]) for U, which in own], width),
            nbytes=sum(pack.nbytes for pack in packs),
        )


def stacks_of(packs: Sequence[Pack], rows: Rows, width: int) -> list[Stack]:
    """A stack for each object, kind and first column that occurs, in that order."""
    alike: dict[tuple[int, bool, int], list[Pack]] = {}
    for pack in packs:
        if (pack.shape > 0).all(axis=1).any():
            alike.setdefault((pack.object, pack.indirect, pack.start), []).append(pack)
    return [Stack.of(alike[key], rows, width) for key in sorted(alike)]


def _runs(shapes: Int64) -> tuple[Run, ...]:
    """Runs of blocks (r, a, b) that are sorted by b."""
    runs: list[Run] = []
    cells = tails = directions = 0
    cuts = np.flatnonzero(np.diff(shapes[:, 2])) + 1
    for blocks in np.split(shapes, cuts):
        counts, rank = blocks[:, 1], int(blocks[0, 2])
        total = int(counts.sum())
        runs.append(
            Run(
                rank,
                slice(cells, cells + rank * total),
                slice(tails, tails + rank * len(blocks)),
                slice(directions, directions + total),
                counts,
            )
        )
        cells, tails = runs[-1].cells.stop, runs[-1].tails.stop
        directions = runs[-1].directions.stop
    return tuple(runs)


def _core(blocks: Sequence[tuple[Pack, int]], runs: Sequence[Run]) -> tuple[AnyArray, Float32]:
    """The cells of sorted blocks in chunks, and their scale: see `Stack`."""
    packs = list({id(pack): pack for pack, _ in blocks}.values())
    columns = len(packs[0].column_scale)
    exact = any(pack.core.dtype == np.float32 for pack in packs)
    scale = np.ones((3, columns), np.float32) if exact else _scale(packs)
    count = runs[-1].cells.stop
    width = min(max(CHUNK // columns, _NARROWEST), count)
    kind = np.float32 if exact else np.int16
    core = np.zeros((3, -(-count // width), columns, width), kind)
    factors = {id(pack): pack.column_scale / scale for pack in packs}

    def fill(run: Run, members: Sequence[tuple[Pack, int]], h: int) -> None:
        cells = np.empty((columns, run.rank, int(run.counts.sum())), kind)
        place = 0
        for pack, j in members:
            begin, end = pack.offsets[j, 2], pack.offsets[j + 1, 2]
            block = pack.core[h, :, begin:end].astype(np.float32)
            block *= factors[id(pack)][h][:, None]
            if not exact:
                np.rint(block, out=block)
            block = block.reshape(columns, -1, run.rank)
            cells[:, :, place : place + block.shape[1]] = block.transpose(0, 2, 1)
            place += block.shape[1]
        flat = cells.reshape(columns, -1)
        for chunk, inside, outside in _pieces(run.cells, width):
            core[h, chunk, :, inside] = flat[:, outside]

    jobs, at = [], 0
    for run in runs:
        jobs += [(run, blocks[at : at + len(run.counts)], h) for h in range(3)]
        at += len(run.counts)
    parallel_map(lambda job: fill(*job), jobs)
    return core, scale


def _pieces(cells: slice, width: int) -> Iterator[tuple[int, slice, slice]]:
    """A run of cells chunk by chunk: the chunk, where in it, and where in the run."""
    at = cells.start
    while at < cells.stop:
        chunk, begin = divmod(at, width)
        count = min(width - begin, cells.stop - at)
        yield chunk, slice(begin, begin + count), slice(at - cells.start, at - cells.start + count)
        at += count


def _scale(packs: Sequence[Pack]) -> Float32:
    """The step of the 16-bit numbers that hold the half-precision ones: float32 [3, c].

    Columns without light have next to none: what is read depends on how bright a column can be.
    """
    peak = np.zeros((3, len(packs[0].column_scale)), np.float32)
    for pack in packs:
        # Half floats without their sign are ordered as their bits are
        bits = (pack.core.view(np.uint16) & 0x7FFF).max(axis=2, initial=0)
        own = bits.view(np.float16).astype(np.float32) * pack.column_scale
        np.maximum(peak, own, out=peak)
    return np.where(peak > 0, peak / np.float32(_LEVELS), _NO_LIGHT)
