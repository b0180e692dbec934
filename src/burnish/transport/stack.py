"""Stacks: a whole view's blocks of the same columns, laid out for few large products.

A stack holds what a frame or a freeze reads, in the order in which it reads it:

    light[r] = Σ_a U[r, a] Σ_b S'[b] Σ_c C[a, c, b] / w_c · coefficient_c,   S' = S · tails

Columns run fastest, so that they meet their coefficients in one matrix–vector product over
contiguous memory. Blocks are sorted by their rank b over tails, and the cells of one rank lie
[b, direction]: the sum over b is of long vectors. Cores are widened from 16-bit integers, with
a scale for each column and channel: NumPy widens those ten times faster than half floats, in
as few bytes. Column contractions are kept until their coefficients change.
"""

from __future__ import annotations

from collections.abc import Sequence
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
_CHUNK = 1 << 17
"""Numbers of a core that are widened to float32 at a time, to stay in a core's cache."""
_TASK = 1 << 20
"""Numbers of a core that one task contracts."""
_SAME = 2.0**-22
"""Relative coefficients that differ by less give the same single-precision light."""


@dataclass(frozen=True)
class Run:
    """Blocks of one rank b. cells: where they lie in the core; tails: in S [b, blocks];
    directions: in the latent directions; counts: int64 [blocks], directions of each."""

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
    cos_theta_o: float32 [r]. core: int16 or float32 [3, cells, c]; times scale, float32
    [3, c], it is the transport. S: float32 [tail directions, z]. expansion: from latent
    directions to the rows. nbytes: of the blocks as they are stored.
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
    _places: list[AnyArray] | None = field(default=None, repr=False)

    @property
    def columns(self) -> int:
        return int(self.core.shape[2])

    @property
    def directions(self) -> int:
        """Latent directions of all blocks."""
        return self.expansion.latent

    @staticmethod
    def of(packs: Sequence[Pack], rows: Rows) -> Stack:
        """The stack of at least one pack, all of the same columns."""
        first = packs[0]
        assert len({(p.object, p.indirect, p.start) for p in packs}) == 1
        blocks = [(pack, j) for pack in packs for j, (_, a, b) in enumerate(pack.shape) if a * b]
        blocks.sort(key=lambda block: int(block[0].shape[block[1], 2]))
        runs = _runs(np.array([pack.shape[j] for pack, j in blocks], np.int64).reshape(-1, 3))
        cells = runs[-1].cells.stop
        columns = len(first.column_scale)
        exact = any(pack.core.dtype == np.float32 for pack in packs)
        core = np.empty((3, cells, columns), np.float32 if exact else np.int16)
        scale = np.ones((3, columns), np.float32) if exact else _scale(packs)
        S = np.empty((runs[-1].tails.stop, first.S.shape[1]), np.float32)
        U: list[Float32] = []
        own: list[Int32] = []
        jobs = []
        at = 0
        for run in runs:
            place = 0
            for k, count in enumerate(run.counts):
                pack, j = blocks[at]
                start, end = pack.offsets[j], pack.offsets[j + 1]
                r, a, _ = pack.shape[j]
                U.append(pack.U[start[1] : end[1]].reshape(r, a))
                own.append(pack.rows[start[0] : end[0]])
                S[run.tails].reshape(run.rank, -1, S.shape[1])[:, k] = pack.S[start[3] : end[3]]
                jobs.append((run, place, pack, slice(int(start[2]), int(end[2]))))
                place += int(count)
                at += 1

        def fill(job: tuple[Run, int, Pack, slice]) -> None:
            run, place, pack, where = job
            block = pack.core[:, :, where].astype(np.float32)
            block *= pack.column_scale[:, None] / scale[:, :, None]
            if not exact:
                np.rint(block, out=block)
            block = block.reshape(3, columns, -1, run.rank).transpose(0, 3, 2, 1)
            target = core[:, run.cells].reshape(3, run.rank, -1, columns)
            target[:, :, place : place + block.shape[2]] = block

        parallel_map(fill, jobs)
        members = np.concatenate(own)
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
            expansion=Expansion.of(U),
            nbytes=sum(pack.nbytes for pack in packs),
        )

    def places(self, pixels: int) -> list[AnyArray]:
        """See `Expansion.places`; those of the view's pixels."""
        if self._places is None:
            self._places = self.expansion.places(self.pixel, pixels)
        return self._places

    # -- products ---------------------------------------------------------------------------

    def meet_tails(self, factors: Float32) -> Float32:
        """S times factors of the tails, float32 [z, q]: float32 [q, tail directions]."""
        return np.asarray(factors.T @ self.S.T)

    def fold(self, contracted: Sequence[Float32], tails: Float32) -> Float32:
        """Σ_b of contracted cells times tail directions, by latent direction.

        contracted: float32 [cells] of each channel. tails: float32 [3, n, tail directions].
        Returns float32 [3, n, directions].
        """
        n = tails.shape[1]
        result = np.empty((3, n, self.directions), np.float32)
        for run in self.runs:
            spread = run.spread(tails)
            for h in range(3):
                cells = contracted[h][run.cells].reshape(run.rank, -1)
                np.einsum("bl,nbl->nl", cells, spread[h], out=result[h, :, run.directions])
        return result

    def with_tails(self, tails: Float32) -> Float32:
        """Σ_b of the core times tail directions: float32 [3, directions, columns, n].

        tails: float32 [3, n, tail directions].
        """
        n = tails.shape[1]
        result = np.zeros((3, self.directions, self.columns, n), np.float32)
        spread = [run.spread(tails) for run in self.runs]

        def work(k: int, h: int) -> None:
            run = self.runs[k]
            core = self.core[h, run.cells].reshape(run.rank, -1, self.columns)
            for b in range(run.rank):
                part = core[b] * self.scale[h]
                for m in range(n):
                    result[h, run.directions, :, m] += part * spread[k][h, m, b][:, None]

        every = [(k, h) for k in range(len(self.runs)) for h in range(3)]
        parallel_map(work, *zip(*every, strict=True))
        return result

    def unfold(self, latent: Float32, tails: Float32) -> Float32:
        """What cells receive from latent directions [3, directions], back through `fold`.

        tails: float32 [3, tail directions]. Returns float32 [3, cells].
        """
        result = np.empty((3, self.core.shape[1]), np.float32)
        for run in self.runs:
            into = result[:, run.cells].reshape(3, run.rank, -1)
            spread = run.spread(tails[:, None])[:, 0]
            np.multiply(spread, latent[:, None, run.directions], out=into)
        return result

    def collect(self, contracted: Sequence[Float32], latent: Float32) -> Float32:
        """What tail directions receive from latent ones [3, directions], back through `fold`.

        Returns float32 [3, tail directions].
        """
        result = np.empty((3, len(self.S)), np.float32)
        for run in self.runs:
            first = np.cumsum(run.counts) - run.counts
            for h in range(3):
                cells = contracted[h][run.cells].reshape(run.rank, -1)
                received = cells * latent[h, run.directions]
                result[h, run.tails] = np.add.reduceat(received, first, axis=1).ravel()
        return result

    def back(self, cells: Float32) -> Float64:
        """Σ_cell cells[h, cell] C[h, cell, c], back through `contract`: float64 [c, 3]."""
        step = max(_TASK // self.columns, 1)
        pieces = [(h, s) for h in range(3) for s in range(0, cells.shape[1], step)]

        def work(at: tuple[int, int]) -> Float32:
            h, start = at
            part = self.core[h, start : start + step].astype(np.float32, copy=False)
            return np.asarray(cells[h, start : start + step] @ part)

        result = np.zeros((3, self.columns))
        for (h, _), own in zip(pieces, parallel_map(work, pieces), strict=True):
            result[h] += own
        return np.asarray((result * self.scale).T)


def contract(
    stacks: Sequence[Stack], weights: Sequence[Float64]
) -> list[tuple[list[Float32], Float32]]:
    """Σ_c C[h, cell, c] weights[c, h] of each stack, up to a factor of each channel.

    Returns float32 [cells] of each channel, and the factors, float32 [3]. A channel whose
    weights have changed by a factor alone is not read again.
    """
    wanted, found = [], []
    for stack, own in zip(stacks, weights, strict=True):
        peak = np.abs(own).max(axis=0)
        unit = np.divide(own, peak, out=np.zeros_like(own, np.float64), where=peak > 0)
        found.append(peak)
        for h in np.flatnonzero(peak).tolist():
            known = stack.kept.get(h)
            if known is None or np.abs(known[0] - unit[:, h]).max() > _SAME:
                wanted.append((stack, h, unit[:, h]))
    fresh = [np.empty(stack.core.shape[1], np.float32) for stack, _, _ in wanted]
    pieces = [
        (stack.core[h], (unit * stack.scale[h]).astype(np.float32), into, start)
        for (stack, h, unit), into in zip(wanted, fresh, strict=True)
        for start in range(0, len(into), max(_TASK // stack.columns, 1))
    ]
    if pieces:
        parallel_map(_contract_piece, pieces)
    for (stack, h, unit), into in zip(wanted, fresh, strict=True):
        stack.kept[h] = unit, into
    return [
        (
            [
                stack.kept[h][1] if peak[h] else np.zeros(stack.core.shape[1], np.float32)
                for h in range(3)
            ],
            peak.astype(np.float32),
        )
        for stack, peak in zip(stacks, found, strict=True)
    ]


def _contract_piece(piece: tuple[AnyArray, Float32, Float32, int]) -> None:
    """One task: cells of one channel, widened chunk by chunk."""
    core, weights, into, start = piece
    columns = core.shape[1]
    stop = min(start + max(_TASK // columns, 1), len(core))
    if core.dtype == np.float32:
        np.dot(core[start:stop], weights, out=into[start:stop])
        return
    step = max(_CHUNK // columns, 1)
    buffer = np.empty((min(step, stop - start), columns), np.float32)
    for first in range(start, stop, step):
        part = buffer[: min(step, stop - first)]
        np.copyto(part, core[first : first + len(part)], casting="unsafe")
        np.dot(part, weights, out=into[first : first + len(part)])


def stacks_of(packs: Sequence[Pack], rows: Rows) -> list[Stack]:
    """A stack for each object, kind and first column that occurs, in that order."""
    alike: dict[tuple[int, bool, int], list[Pack]] = {}
    for pack in packs:
        alike.setdefault((pack.object, pack.indirect, pack.start), []).append(pack)
    return [
        Stack.of(alike[key], rows)
        for key in sorted(alike)
        if any((pack.shape > 0).all(axis=1).any() for pack in alike[key])
    ]


def _runs(shapes: Int64) -> tuple[Run, ...]:
    """Runs of blocks (r, a, b) that are sorted by b."""
    runs = []
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


def _scale(packs: Sequence[Pack]) -> Float32:
    """The step of the 16-bit numbers that hold the half-precision ones: float32 [3, c]."""
    peak = np.zeros((3, len(packs[0].column_scale)), np.float32)
    for pack in packs:
        # Half floats without their sign are ordered as their bits are
        bits = (pack.core.view(np.uint16) & 0x7FFF).max(axis=2, initial=0)
        own = bits.view(np.float16).astype(np.float32) * pack.column_scale
        np.maximum(peak, own, out=peak)
    return np.where(peak > 0, peak / np.float32(_LEVELS), np.float32(1.0))
