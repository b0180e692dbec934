"""Frames while something is dragged: incremental where that is measured to be faster.

For each part of a frozen form whose curve has many bins, a piece of it is timed both ways once:
the plain product of all columns that are lit, and a frame's budget of wavelet terms (2006,
section 6). At modern bandwidths the plain one often wins, and then a draft is the frame itself.
A draft is for the eye alone: it closes in on the exact frame while the curve rests, and whoever
saves or compares a picture takes `Renderer.image`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from burnish.core.types import Float32, Float64
from burnish.runtime.freeze import machine_memory
from burnish.runtime.incremental import Columns, Incremental, IncrementalStack, terms_of
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import State
from burnish.transport.contraction import Contracted, contract, is_kept
from burnish.transport.frozen import FoldedPart, FrozenPart
from burnish.transport.stack import Stack

BUDGET = 30 / 256
"""Of a curve's terms, the share that a frame may add (2006, section 7.3)."""
FEWEST_BINS = 96
"""Below which a plain product costs less than choosing terms."""
_ADVANTAGE = 1.25
"""How much faster drafts must be to be worth their memory."""
_WORTHWHILE = 1e-3
"""Seconds of processor time that a frame must save."""
_SAMPLE_BYTES = 24 << 20
"""Of the core, what is timed: more than caches hold."""
_TURNS = 5
_MEMORY_SHARE = 8


@dataclass(frozen=True)
class Choice:
    """What was measured for one part of a frozen form: a frame's contraction, in seconds of
    processor time, which a busy machine does not stretch.

    plain: of all lit columns; incremental: of `budget` out of `terms` wavelets for each channel.
    """

    object: str
    layer: str
    columns: int
    terms: int
    budget: int
    plain: float
    incremental: float
    fits: bool = True
    """Whether the terms have room in memory."""

    @property
    def drafts(self) -> bool:
        """Whether the part is drawn incrementally."""
        faster = self.incremental * _ADVANTAGE < self.plain
        return self.fits and faster and self.plain - self.incremental > _WORTHWHILE


class Drafts:
    """Drafts of a renderer's frames.

    >>> drafts = Drafts(renderer)                              # doctest: +SKIP
    >>> drafts.prepare(state)                                  # doctest: +SKIP
    >>> picture, exact = drafts.image(edited)                  # doctest: +SKIP
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.choices: dict[int, Choice] = {}
        """By the stack that they are about (its `id`)."""
        self._ready: dict[int, IncrementalStack] = {}
        self.exact, self.drawn = True, False
        self._known: dict[int, Stack] = {}
        """Every stack that a choice is about, so that no other takes its place."""

    def prepare(self, state: State, force: bool = False) -> None:
        """Measure what has not been measured, and start drafts from the exact frame of `state`.

        For a pause: making a part's terms takes as long as a few frames. force: draw parts
        incrementally whatever was measured.
        """
        present = self.renderer.present(state)
        stacks = {id(part.stack): part.stack for part, _ in present if isinstance(part, FoldedPart)}
        # A switched curve has left its form behind
        for key in [key for key in self._known if key not in stacks]:
            del self._known[key]
            self.choices.pop(key, None)
            self._ready.pop(key, None)
        for part, weights in present:
            if isinstance(part, FoldedPart):
                self._prepare(part, weights, force)

    @property
    def useful(self) -> bool:
        """Whether anything is drawn incrementally."""
        return bool(self._ready)

    def image(self, state: State) -> tuple[Float32, bool]:
        """A draft, float32 [h, w, 3], linear RGB, and whether it is the exact frame, up to
        rounding. Asking again comes closer."""
        with self.drawing():
            return self.renderer.image(state), self.exact

    @contextmanager
    def drawing(self) -> Iterator[None]:
        """The renderer's images are drafts in here; then `exact` says whether they were exact up
        to rounding, and `drawn` whether anything was drawn incrementally at all."""
        self.exact, self.drawn = True, False
        self.renderer.contraction = self._contraction
        try:
            yield
        finally:
            self.renderer.contraction = contract

    def _contraction(self, stacks: Sequence[Stack], weights: Sequence[Float64]) -> list[Contracted]:
        # What was kept is read for nothing, such as while a colour is dragged
        plain = [
            k
            for k, stack in enumerate(stacks)
            if id(stack) not in self._ready or is_kept(stack, weights[k])
        ]
        found = contract([stacks[k] for k in plain], [weights[k] for k in plain])
        result = dict(zip(plain, found, strict=True))
        for k, stack in enumerate(stacks):
            if k not in result:
                budget = self.choices[id(stack)].budget
                result[k], reached = self._ready[id(stack)].contracted(weights[k], budget)
                self.exact &= reached
                self.drawn = True
        return [result[k] for k in range(len(stacks))]

    def _prepare(self, part: FoldedPart, weights: Float64, force: bool) -> None:
        key = id(part.stack)
        columns = self._columns(part)
        if columns is None:
            return
        if key not in self._known:
            basis = self.renderer.frozen.basis
            item = basis.objects[part.object]
            self.choices[key] = measured(
                part.stack,
                columns,
                weights,
                item.id,
                item.material.layers[part.slice.layer].name,
                sum(other.product.T.nbytes for other in self._ready.values()),
            )
            self._known[key] = part.stack
        if not (force or self.choices[key].drafts):
            return
        if key not in self._ready:
            self._ready[key] = IncrementalStack(part.stack, columns)
        self._ready[key].settle(weights)

    def _columns(self, part: FoldedPart | FrozenPart) -> Columns | None:
        """What a part's columns are, where they are enough for wavelets."""
        if part.slice is None or part.indirect or part.slice.delta:
            return None
        assert isinstance(part, FoldedPart)
        model = self.renderer.frozen.basis.objects[part.object].material.layers[part.slice.layer]
        bins, rest = divmod(part.stack.columns, model.model.rank)
        if rest or bins < FEWEST_BINS:
            return None
        return Columns(model.model.rank, bins)


def _clock() -> float:
    """Processor time of all threads, or the time of day where that is known too coarsely."""
    fine = time.get_clock_info("process_time").resolution < 1e-5
    return time.process_time() if fine else time.perf_counter()


def measured(
    stack: Stack,
    columns: Columns,
    weights: Float64,
    object_id: str = "",
    layer: str = "",
    held: int = 0,
) -> Choice:
    """Time a stack's contraction both ways, on a piece of it, interleaved, and scale it up.

    held: bytes that the terms of other parts take.
    """
    chunks = stack.core.shape[1]
    per_chunk = stack.core[:, :1].nbytes
    some = min(max(_SAMPLE_BYTES // max(per_chunk, 1), 1), chunks)
    piece = replace(stack, core=np.ascontiguousarray(stack.core[:, :some]), kept={})
    product = Incremental(terms_of(piece, columns, some))
    budget = max(int(np.ceil(BUDGET * columns.terms)), 1)
    perfect = columns.of_curve(weights).T
    # Changes of all terms, so that every turn spends its budget
    rng = np.random.default_rng(0)
    plain, incremental = [], []
    for _ in range(_TURNS):
        other = perfect * rng.uniform(0.5, 2.0, perfect.shape)
        piece.kept.clear()
        start = _clock()
        contract([piece], [weights])
        middle = _clock()
        product.closer(other, budget)
        plain.append(middle - start)
        incremental.append(_clock() - middle)
    scale = chunks / some
    need = 4 * stack.core.size * columns.terms // max(columns.count, 1)
    return Choice(
        object_id,
        layer,
        columns.count,
        columns.terms,
        budget,
        min(plain) * scale,
        min(incremental) * scale,
        held + need < machine_memory() // _MEMORY_SHARE,
    )
