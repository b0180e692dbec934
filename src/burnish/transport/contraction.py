"""Contractions of stacks: along columns, along tails, and both of them backwards.

What the columns of a stack were last contracted to is kept with it, and taken again while
their coefficients are the same up to a factor: a frame whose colour changes reads no block.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from burnish.core.parallel import core_count, parallel_map
from burnish.core.types import AnyArray, Float32, Float64
from burnish.transport.stack import Stack

Contracted = tuple[list[Float32], Float32]
"""Cells of each channel, float32 [cells], and the factor of each channel, float32 [3]."""

_SAME = 2.0**-22
"""Relative coefficients that differ by less give the same single-precision light."""
_DARK = 2.0**-26
"""Of the brightest column: what adds less to a cell than its last digit is not read."""


def contract(stacks: Sequence[Stack], weights: Sequence[Float64]) -> list[Contracted]:
    """Σ_c C[h, cell, c] weights[c, h] of each stack, up to a factor of each channel."""
    wanted, peaks = [], []
    for stack, own in zip(stacks, weights, strict=True):
        unit, peak = _units(own)
        peaks.append(peak.astype(np.float32))
        wanted += [
            (stack, h, unit[:, h])
            for h in np.flatnonzero(peak).tolist()
            if not _holds(stack, h, unit[:, h])
        ]
    fresh = [np.empty(stack.cells, np.float32) for stack, _, _ in wanted]
    pieces = []
    # Few tasks, since each costs, and enough to share out
    task = max(sum(stack.core.shape[1] for stack, _, _ in wanted) // (4 * core_count()), 1)
    for (stack, h, unit), into in zip(wanted, fresh, strict=True):
        chunks, _, width = stack.core.shape[1:]
        light = unit * stack.scale[h]
        span = lit_columns(light)
        own = light[span].astype(np.float32)
        pieces += [
            (stack.core[h, at : at + task, span], own, into[at * width : (at + task) * width])
            for at in range(0, chunks, task)
        ]
    if pieces:
        parallel_map(_contract_chunks, pieces)
    for (stack, h, unit), into in zip(wanted, fresh, strict=True):
        stack.kept[h] = unit, into
    return [
        (
            [stack.kept[h][1] if peak[h] else np.zeros(stack.cells, np.float32) for h in range(3)],
            peak,
        )
        for stack, peak in zip(stacks, peaks, strict=True)
    ]


def is_kept(stack: Stack, weights: Float64) -> bool:
    """Whether `contract` reads no block for weights [columns, 3]."""
    unit, peak = _units(weights)
    return all(_holds(stack, h, unit[:, h]) for h in np.flatnonzero(peak).tolist())


def _units(weights: Float64) -> tuple[Float64, Float64]:
    """Relative weights [c, 3], 1 at most, and the factor of each channel: float64 [3]."""
    peak = np.abs(weights).max(axis=0)
    unit = np.divide(weights, peak, out=np.zeros_like(weights, np.float64), where=peak > 0)
    return unit, peak


def _holds(stack: Stack, channel: int, unit: Float64) -> bool:
    """Whether what is kept of a channel is of these relative weights."""
    known = stack.kept.get(channel)
    return known is not None and bool(np.abs(known[0] - unit).max() <= _SAME)


def lit_columns(light: Float64) -> slice:
    """The columns that a contraction reads, by how bright a cell they can make: float64 [c]."""
    lit = np.flatnonzero(np.abs(light) > _DARK * np.abs(light).max())
    return slice(int(lit[0]), int(lit[-1]) + 1) if len(lit) else slice(0, 0)


def _contract_chunks(piece: tuple[AnyArray, Float32, Float32]) -> None:
    """A few chunks [chunks, c, cells] times weights [c], into [chunks · cells]."""
    core, weights, into = piece
    chunks, columns, width = core.shape
    buffer = np.empty((columns, width), np.float32)
    for chunk in range(chunks):
        # Widened in cache; a float32 core is copied, which its rarity allows
        np.copyto(buffer, core[chunk], casting="unsafe")
        np.dot(weights, buffer, out=into[chunk * width : (chunk + 1) * width])


def meet_tails(stack: Stack, factors: Float32) -> Float32:
    """S times factors of the tails, float32 [z, q]: float32 [q, tail directions]."""
    return np.ascontiguousarray((stack.S @ factors).T)


def fold(stack: Stack, cells: Sequence[Float32], tails: Float32) -> Float32:
    """Σ_b of contracted cells times tail directions, by latent direction.

    cells: float32 [cells] of each channel. tails: float32 [3, n, tail directions]. Returns
    float32 [3, n, directions].
    """
    n = tails.shape[1]
    result = np.empty((3, n, stack.directions), np.float32)
    for run in stack.runs:
        spread = run.spread(tails)
        for h in range(3):
            own = cells[h][run.cells].reshape(run.rank, -1)
            np.einsum("bl,nbl->nl", own, spread[h], out=result[h, :, run.directions])
    return result


def unfold(stack: Stack, latent: Float32, tails: Float32) -> Float32:
    """What cells receive from latent directions [3, directions], back through `fold`.

    tails: float32 [3, tail directions]. Returns float32 [3, cells].
    """
    result = np.zeros((3, stack.cells), np.float32)
    for run in stack.runs:
        spread = run.spread(tails[:, None])[:, 0] * latent[:, None, run.directions]
        result[:, run.cells] = spread.reshape(3, -1)
    return result


def collect(stack: Stack, cells: Sequence[Float32], latent: Float32) -> Float32:
    """What tail directions receive from latent ones [3, directions], back through `fold`.

    Returns float32 [3, tail directions].
    """
    result = np.empty((3, len(stack.S)), np.float32)
    for run in stack.runs:
        first = np.cumsum(run.counts) - run.counts
        for h in range(3):
            own = cells[h][run.cells].reshape(run.rank, -1) * latent[h, run.directions]
            result[h, run.tails] = np.add.reduceat(own, first, axis=1).ravel()
    return result


def back(stack: Stack, cells: Float32) -> Float64:
    """Σ_cell cells[h, cell] C[h, cell, c], back through `contract`: float64 [c, 3]."""
    chunks, columns, width = stack.core.shape[1:]
    by_chunk = cells.reshape(3, chunks, width)

    def work(h: int) -> Float64:
        result = np.zeros(columns)
        for chunk in range(chunks):
            part = stack.core[h, chunk].astype(np.float32, copy=False)
            result += part @ by_chunk[h, chunk]
        return result

    return np.stack(parallel_map(work, range(3)), axis=1) * stack.scale.T.astype(np.float64)


def with_tails(stack: Stack, tails: Float32) -> Float32:
    """Σ_b of the core times tail directions: float32 [3, directions, columns, n].

    tails: float32 [3, n, tail directions].
    """
    n = tails.shape[1]
    result = np.zeros((3, stack.directions, stack.columns, n), np.float32)

    def work(h: int) -> None:
        core = stack.core[h].transpose(0, 2, 1).reshape(-1, stack.columns)
        for run in stack.runs:
            own = core[run.cells].reshape(run.rank, -1, stack.columns)
            spread = run.spread(tails[h : h + 1])[0]
            for b in range(run.rank):
                part = own[b] * stack.scale[h]
                for m in range(n):
                    result[h, run.directions, :, m] += part * spread[m, b][:, None]

    parallel_map(work, range(3))
    return result
