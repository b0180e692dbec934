"""Curve switching: of two curves one is edited, and the other's boxes are contracted away.

    T_A[r, j] = Σ_l c_B[l] U[r, j, l],    light[r] = Σ_j c_A[j] T_A[r, j]    (2006, eq. 26)

and the other way round. Which curve is dormant follows from what changed: as long as its
coefficients stay as they are the contraction holds, and a drag of the other one touches a vector
per row. All quotients keep their own columns, since their amplitudes are the first curve's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from burnish.core.parallel import core_count, parallel_map
from burnish.core.types import Float32, Float64
from burnish.materials.two_curves import TwoCurves
from burnish.transport.contraction import lit_columns
from burnish.transport.frozen import FoldedPart, FrozenPart
from burnish.transport.stack import CHUNK, Stack

Sides = tuple[Float64, Float64]
"""Coefficients A [k, j, 3] and B [k, l, 3] of the two curves."""


@dataclass(frozen=True)
class _Form:
    """A part with one side contracted: live is 0 where the first curve is edited, else 1."""

    live: int
    dormant: Float64
    part: FoldedPart | FrozenPart


class Switch:
    """A part of a layer with two curves, in the form of the one that is edited."""

    def __init__(self, part: FoldedPart | FrozenPart, model: TwoCurves) -> None:
        self.part = part
        self.shape = model.rank, model.bins, model.bins2
        self._form: _Form | None = None
        self._last: Sides | None = None

    @property
    def live(self) -> int | None:
        """Which curve is edited: 0 for the first, 1 for the second, None before any frame."""
        return None if self._form is None else self._form.live

    def under(self, sides: Sides) -> tuple[FoldedPart | FrozenPart, Float64]:
        """The part for coefficients of both sides, and what its columns meet: float64
        [columns, 3]."""
        form, last = self._form, self._last
        if form is None or not np.array_equal(form.dormant, sides[1 - form.live]):
            first_rests = last is not None and np.array_equal(last[0], sides[0])
            form = None
            # Let go of the old form first: two of them may not fit
            self._form = None
            live = 1 if first_rests else 0
            form = _Form(live, sides[1 - live], contracted(self.part, self.shape, live, sides))
            self._form = form
        self._last = sides
        return form.part, sides[form.live].reshape(-1, 3)


def contracted(
    part: FoldedPart | FrozenPart, shape: tuple[int, int, int], live: int, sides: Sides
) -> FoldedPart | FrozenPart:
    """A part whose columns are (quotient, bin of the live side), the dormant side contracted.

    shape: quotients, bins of the first curve, bins of the second.
    """
    if isinstance(part, FoldedPart):
        return replace(part, stack=_contracted_stack(part.stack, shape, live, sides[1 - live]))
    rank, bins, bins2 = shape
    powers = part.F.shape[2] // (rank * bins * bins2)
    rule = "rkjln,kl->rkjn" if live == 0 else "rkjln,kj->rkln"

    def work(h: int) -> Float32:
        F = part.F[h].reshape(-1, rank, bins, bins2, powers)
        dormant = sides[1 - live][:, :, h].astype(np.float32)
        return np.asarray(np.einsum(rule, F, dormant, optimize=True)).reshape(len(F), -1)

    return replace(part, F=np.stack(parallel_map(work, range(3))))


def _contracted_stack(
    stack: Stack, shape: tuple[int, int, int], live: int, dormant: Float64
) -> Stack:
    """The stack of the live side: its core float32, [quotient, bin] in the columns' place."""
    rank, bins, bins2 = shape
    left = rank * (bins if live == 0 else bins2)
    _, chunks, _, width = stack.core.shape
    together = min(max(CHUNK // left // width, 1), chunks)
    core = np.zeros((3, -(-chunks // together), left, together * width), np.float32)
    scale = stack.scale.reshape(3, *shape)
    spread = np.expand_dims(dormant.transpose(2, 0, 1), 2 + live)
    weights = (spread * scale).astype(np.float32)
    # Dormant bins that no cell can show are not read
    dark = 2 if live == 0 else 1
    spans = [_lit(weights[h], dark) for h in range(3)]
    block = max(CHUNK // (bins2 * width), 1)

    def work(h: int, start: int) -> None:
        js = range(bins) if live == 0 else range(bins)[spans[h]]
        ls = spans[h] if live == 0 else slice(0, bins2)
        buffer = np.empty((block, len(range(bins2)[ls]), width), np.float32)
        for chunk, k in product(range(start, min(start + step, chunks)), range(rank)):
            into, place = divmod(chunk, together)
            cells = stack.core[h, chunk].reshape(*shape, width)[k]
            found = core[h, into, :, place * width : (place + 1) * width].reshape(rank, -1, width)[
                k
            ]
            for at in range(0, len(js), block):
                own = js[at : at + block]
                some = slice(own.start, own.stop), ls
                # Widened in cache, piece by piece
                piece = buffer[: len(own)]
                np.copyto(piece, cells[some], casting="unsafe")
                meet = weights[h, k][some]
                if live == 0:
                    found[some[0]] = np.matmul(meet[:, None], piece)[:, 0]
                else:
                    found += np.matmul(meet.T[:, None], piece.transpose(1, 0, 2))[:, 0]

    step = max(chunks // (4 * core_count()), 1)
    starts = range(0, chunks, step)
    parallel_map(work, *zip(*product(range(3), starts), strict=True))
    return replace(stack, core=core, scale=np.ones((3, left), np.float32), kept={})


def _lit(weights: Float32, axis: int) -> slice:
    """The dormant bins that are read: weights [k, j, l], along an axis of them."""
    others = tuple(n for n in range(3) if n != axis)
    return lit_columns(np.abs(weights.astype(np.float64)).max(axis=others))
