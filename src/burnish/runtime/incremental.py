"""Incremental products: T · c brought up to date by its largest changes, within a budget.

Between two frames of an edit a curve changes little, and in wavelets few of its coefficients.
So the product of the last frame is kept with the coefficients that it stands for, and a frame
adds the largest terms of what is missing (2006, eq. 29–31):

    c_diff = c_perfect − c_effective,    R += T · c̃_diff,    c_effective += c̃_diff.

Frames close in on the exact product and reach it when the curve rests. T is in wavelets like c
(`wavelets`), so that their product is that of the boxes.

Which changes are largest is judged by what they change: |c_diff| times the length of T's column.
Where T's columns are alike that is the paper's order.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from burnish.core.parallel import core_count, parallel_map
from burnish.core.types import AnyArray, Float32, Float64, Int64
from burnish.runtime.wavelets import Wavelets
from burnish.transport.contraction import Contracted, contract
from burnish.transport.frozen import FrozenPart
from burnish.transport.stack import Stack

A = TypeVar("A", bound=AnyArray)

SAME = 2.0**-23
"""Of the largest term: a change that is smaller leaves the product as it is."""
WIDTH = 2048
"""Entries that one task multiplies at a time; their share of the terms stays in cache."""


def largest(change: Float64, budget: int, negligible: float = 0.0) -> Int64:
    """Which of the changes [terms] a budget goes to: their rising indices, `budget` at most."""
    size = np.abs(change)
    if budget < len(size):
        found = np.argpartition(-size, budget)[:budget] if budget else np.zeros(0, np.int64)
    else:
        found = np.arange(len(size))
    return np.sort(found[size[found] > negligible])


class Incremental:
    """Σ_term T[h, term, entry] c[h, term] of a c that changes from frame to frame.

    T: float32 [channels, chunks, terms, entries of a chunk]. importance: float64 [channels,
    terms], by which changes are compared; without it the length of each of T's columns.
    effective: float64 [channels, terms], the c that `value`, float32 [channels, chunks, entries
    of a chunk], stands for; both begin at 0.
    """

    def __init__(self, T: Float32, importance: Float64 | None = None) -> None:
        channels, chunks, terms, width = T.shape
        self.T = T
        self.effective = np.zeros((channels, terms))
        self.value = np.zeros((channels, chunks, width), np.float32)
        if importance is None:
            squares = parallel_map(lambda part: np.einsum("cte,cte->t", part, part), T)
            importance = np.sqrt(np.asarray(squares, np.float64))
        self.importance = importance

    def closer(self, perfect: Float64, budget: int) -> bool:
        """Spend a frame's budget of terms for each channel; whether `perfect` is now reached.

        perfect: float64 [channels, terms].
        """
        terms = np.abs(perfect) * self.importance
        change = (perfect - self.effective) * self.importance
        jobs, reached = [], True
        for h in range(len(perfect)):
            negligible = SAME * float(terms[h].max(initial=0.0))
            chosen = largest(change[h], budget, negligible)
            reached &= len(chosen) == np.count_nonzero(np.abs(change[h]) > negligible)
            if len(chosen):
                # What single precision leaves out is made up for by a later frame
                difference = (perfect[h] - self.effective[h])[chosen].astype(np.float32)
                self.effective[h, chosen] += difference
                jobs.append((h, chosen, difference))
        if jobs:
            self._add(jobs)
        return reached

    def settle(self, perfect: Float64, value: Float32) -> None:
        """Take over an exact product: float32 [channels, entries], of `perfect`."""
        self.effective[:] = perfect
        flat = self.value.reshape(len(self.value), -1)
        flat[:, : value.shape[1]] = value

    def _add(self, jobs: list[tuple[int, Int64, Float32]]) -> None:
        chunks = self.T.shape[1]
        step = max(len(jobs) * chunks // (4 * core_count()), 1)

        def work(h: int, chosen: Int64, difference: Float32, start: int) -> None:
            for chunk in range(start, min(start + step, chunks)):
                self.value[h, chunk] += difference @ self.T[h, chunk, chosen]

        pieces = [(*job, start) for job in jobs for start in range(0, chunks, step)]
        parallel_map(lambda piece: work(*piece), pieces)


class Columns:
    """What the columns of a frozen form are: `rank` curves of `bins` boxes, and n powers each.

    The columns stand (curve, box, power), the powers running fastest; terms alike, with the
    wavelet in the box's place.
    """

    def __init__(self, rank: int, bins: int, powers: int = 1) -> None:
        self.rank, self.bins, self.powers = rank, bins, powers
        self.wavelets = Wavelets(bins)

    @property
    def count(self) -> int:
        return self.rank * self.bins * self.powers

    @property
    def terms(self) -> int:
        return self.rank * self.wavelets.terms * self.powers

    def of_curve(self, weights: Float64) -> Float64:
        """From what multiplies the columns [count, ...] to what multiplies the terms."""
        return self._joined(self.wavelets.of_curve(self._by_bin(weights)))

    def of_transport(self, values: Float32) -> Float32:
        """From columns of the transport [count, ...] to terms [terms, ...]."""
        return self._joined(self.wavelets.of_transport(self._by_bin(values)))

    def _by_bin(self, values: A) -> A:
        shape = (self.rank, self.bins, self.powers, *values.shape[1:])
        return values.reshape(shape).swapaxes(0, 1)  # type: ignore[return-value]

    def _joined(self, by_bin: A) -> A:
        return by_bin.swapaxes(0, 1).reshape(self.terms, *by_bin.shape[3:])  # type: ignore[return-value]


class IncrementalStack:
    """The cells of a stack, contracted along its columns: `contract`, within a budget.

    columns: what they are; one power.
    """

    def __init__(self, stack: Stack, columns: Columns) -> None:
        assert columns.count == stack.columns
        self.stack, self.columns = stack, columns
        self.product = Incremental(terms_of(stack, columns, stack.core.shape[1]))

    def settle(self, weights: Float64) -> None:
        """Start from the exact cells of weights [columns, 3]."""
        ((cells, peak),) = contract([self.stack], [weights])
        exact = np.stack([own * factor for own, factor in zip(cells, peak, strict=True)])
        self.product.settle(self.columns.of_curve(weights).T, exact)

    def contracted(self, weights: Float64, budget: int) -> tuple[Contracted, bool]:
        """The cells under weights [columns, 3], and whether they are exact."""
        reached = self.product.closer(self.columns.of_curve(weights).T, budget)
        value = self.product.value
        return ([own.ravel() for own in value], np.ones(3, np.float32)), reached


class IncrementalPart:
    """The light of a dense part in its rows, or row directions: F · c, within a budget."""

    def __init__(self, part: FrozenPart, columns: Columns) -> None:
        assert columns.count == part.F.shape[2]
        rows = part.F.shape[1]
        width = min(WIDTH, max(rows, 1))
        T = np.zeros((3, -(-rows // width), columns.terms, width), np.float32)

        def work(h: int, chunk: int) -> None:
            own = part.F[h, chunk * width : (chunk + 1) * width]
            T[h, chunk, :, : len(own)] = columns.of_transport(np.ascontiguousarray(own.T))

        parallel_map(work, *zip(*np.ndindex(*T.shape[:2]), strict=True))
        self.part, self.columns, self.product = part, columns, Incremental(T)

    def light(self, weights: Float64, budget: int) -> tuple[Float32, bool]:
        """What the part adds to its rows under weights [3, columns · powers], float32 [3, r],
        outgoing factor left out, and whether that is exact."""
        reached = self.product.closer(self.columns.of_curve(weights.T).T, budget)
        flat = self.product.value.reshape(3, -1)[:, : self.part.F.shape[1]]
        expansion = self.part.expansion
        return flat if expansion is None else expansion.expand(flat), reached


def terms_of(stack: Stack, columns: Columns, chunks: int) -> Float32:
    """The first chunks of a stack's core in wavelets: float32 [3, chunks, terms, cells].

    Several of the stack's chunks are one of these, which makes the runs of a term long.
    """
    width = stack.core.shape[3]
    together = min(max(WIDTH // width, 1), chunks)
    T = np.zeros((3, -(-chunks // together), columns.terms, together * width), np.float32)

    def work(h: int, chunk: int) -> None:
        own = stack.core[h, chunk].astype(np.float32) * stack.scale[h][:, None]
        into, place = divmod(chunk, together)
        T[h, into, :, place * width : (place + 1) * width] = columns.of_transport(own)

    parallel_map(work, *zip(*np.ndindex(3, chunks), strict=True))
    return T
