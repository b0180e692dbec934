"""Running passes over a rectangle of pixels and gathering what they add."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float32, Int32, Int64
from burnish.precompute.arrangement import Arrangement, arranged, plain
from burnish.precompute.tables import NONE
from burnish.precompute.tracer import CELL, Target, Tracer
from burnish.transport.rows import Rows

STRATA = 256
"""Most samples per pixel that are stratified together, and a budget is a whole number of them.
Correlated multi-jittered: on a diffuse box the error falls to a half of independent samples'
at 256. Mitsuba's ldsampler, as good in error, darkens the same picture by 0.5 %: not it."""

LANES = 1 << 20
"""Paths per kernel launch: enough to keep every core busy, few enough to stop soon."""


THREAD_BLOCK = 16384
"""Lanes of Dr.Jit's largest block, which one thread works through in order."""

WIDEST_PACKET = 16
"""Most lanes of a vector register: 4, 8 or 16 floats."""


@dataclass(frozen=True)
class Rectangle:
    """Pixels x ≤ px < x + width, y ≤ py < y + height of a view."""

    x: int
    y: int
    width: int
    height: int

    def pixels(self, view_width: int) -> Int32:
        """Pixel indices of the view, row by row: int32 [width · height]."""
        y, x = np.mgrid[self.y : self.y + self.height, self.x : self.x + self.width]
        return (y * view_width + x).ravel().astype(np.int32)


@dataclass(frozen=True)
class Run:
    """Rows start … stop of one object and kind, `columns` wide, from `offset` on in values, and
    how the values of each lie."""

    object: int
    indirect: bool
    start: int
    stop: int
    columns: int
    offset: int
    arrangement: Arrangement


@dataclass(frozen=True)
class Layout:
    """Where each row's values lie in one flat array; a value is RGB and a float of nothing.

    Rows are sorted by object and kind, so every (object, kind) is one dense run. offsets: int64
    [rows], in values.
    """

    runs: tuple[Run, ...]
    offsets: Int64
    values: int
    tails: int

    @staticmethod
    def of(tracer: Tracer, rows: Rows, side_by_side: bool = False) -> Layout:
        """Lay out the rows of a rectangle: column after column, or as an `Arrangement` has the
        quotients side by side."""
        basis, runs, offset = tracer.basis, [], 0
        offsets = np.zeros(len(rows), np.int64)
        start = 0
        while start < len(rows):
            index, indirect = int(rows.object[start]), bool(rows.indirect[start])
            same = (rows.object[start:] == index) & (rows.indirect[start:] == indirect)
            stop = start + (len(same) if same.all() else int(np.argmin(same)))
            arrangement = (arranged if side_by_side else plain)(basis, index, indirect)
            # Values that are added to two at a time begin at an even place
            offset += offset % 2
            offsets[start:stop] = offset + np.arange(stop - start) * arrangement.places
            columns = basis.columns(index, indirect)
            runs.append(Run(index, indirect, start, stop, columns, offset, arrangement))
            offset += (stop - start) * arrangement.places
            start = stop
        return Layout(tuple(runs), offsets, offset, basis.tails)

    def places(self, values: Float32) -> list[Float32]:
        """The flat array as one [rows, places, CELL] view per run."""
        flat = values.reshape(-1, CELL)
        result = []
        for run in self.runs:
            shape = run.stop - run.start, run.arrangement.places, CELL
            result.append(flat[run.offset :][: shape[0] * shape[1]].reshape(shape))
        return result

    def split(self, values: Float32) -> list[Float32]:
        """The flat array as one [rows, columns, tails, CELL] per run: a view where the values
        are in order, else a copy."""
        result = []
        for run, own in zip(self.runs, self.places(values), strict=True):
            order = run.arrangement.order
            ordered = own if order is None else own[:, order]
            result.append(ordered.reshape(len(own), run.columns, self.tails, CELL))
        return result


class Accumulator:
    """The tensor of one rectangle of pixels, and the passes that fill it."""

    def __init__(self, tracer: Tracer, rectangle: Rectangle, rows: Rows) -> None:
        """rows: those of the rectangle, `pixel` indices of the whole view."""
        self.tracer = tracer
        self.rectangle = rectangle
        self.rows = rows
        self.layout = Layout.of(tracer, rows, side_by_side=True)
        if self.layout.values * CELL >= NONE:
            raise MemoryError("a tile's tensor must have fewer than 2³² values")
        pixels, objects = rectangle.width * rectangle.height, max(len(tracer.basis.objects), 1)
        table = np.full((pixels, objects, 2), NONE, np.uint32)
        x = rows.pixel % tracer.view.width - rectangle.x
        y = rows.pixel // tracer.view.width - rectangle.y
        local = y * rectangle.width + x
        table[local, rows.object, rows.indirect.astype(np.int32)] = self.layout.offsets
        lights = max(tracer.groups.count, 1)
        self.target = Target(
            rows=mi.UInt32(table.ravel()),
            # Whole pairs, since two are added to at a time; one where nothing is symbolic
            transport=dr.zeros(mi.Float, (self.layout.values // 2 + 1) * 2 * CELL),
            apart=False,
            fixed=dr.zeros(mi.Float, lights * pixels * 3),
            emission=dr.zeros(mi.Float, lights * pixels * 3),
            lost=dr.zeros(mi.UInt32, 1),
            pixels=dr.opaque(mi.UInt32, pixels),
        )
        self.samples = 0

    def run(self, spp: int, seed: int, pixels: int = 0) -> None:
        """Add `spp` samples per pixel, stratified together.

        pixels: those that a launch has room for, if more than there are: samples per launch are
        part of the kernel, and tiles of several sizes should share one.
        """
        area = self.rectangle.width * self.rectangle.height
        per_launch = max(1, min(spp, LANES // max(area, pixels)))
        per_launch = 1 << (per_launch.bit_length() - 1)
        sampler = mi.load_dict({"type": "multijitter", "sample_count": spp})
        sampler.set_samples_per_wavefront(per_launch)
        sampler.seed(seed & 0xFFFFFFFF, area * per_launch)
        local = dr.arange(mi.UInt32, area * per_launch) // per_launch
        pixel = mi.Point2u(
            self.rectangle.x + local % self.rectangle.width,
            self.rectangle.y + local // self.rectangle.width,
        )
        dr.make_opaque(pixel, local)
        self.target.apart = threads_are_apart(area * per_launch, per_launch)
        for number in range(spp // per_launch):
            if number:
                sampler.advance()
            # A state that is still to be computed would make the first launch a kernel of its own
            sampler.schedule_state()
            dr.eval()
            state = mi.UInt64((seed & 0xFFFFFFFF) << 16 | number)
            dr.make_opaque(state)
            self.tracer.trace(self.target, pixel, local, sampler, state)
            sampler.schedule_state()
            self._evaluate()
        self.samples += spp

    def _evaluate(self) -> None:
        t = self.target
        dr.eval(t.transport, t.fixed, t.emission, t.lost)

    def transport(self) -> list[Float32]:
        """T of each run of the layout: float32 [rows, columns, tails, 3], per sample."""
        scale = np.float32(1 / max(self.samples, 1))
        return [total[..., :3] * scale for total in self.sums()]

    def sums(self) -> list[Float32]:
        """T of each run, summed over the samples: float32 [rows, columns, tails, CELL]."""
        return self.layout.split(self._values())

    def places(self) -> list[Float32]:
        """The same as it lies: float32 [rows, places, CELL], views of the device's memory where
        it is ours."""
        return self.layout.places(self._values())

    def _values(self) -> Float32:
        values = np.array(self.target.transport, copy=False)
        return np.asarray(values[: self.layout.values * CELL], np.float32)

    def image(self, buffer: Any) -> Float32:
        """A per-pixel sum as float32 [height, width, 3], per sample; [lights, height, width, 3]
        where light groups are told apart."""
        apart = (self.tracer.groups.count,) if self.tracer.groups.count else ()
        shape = (*apart, self.rectangle.height, self.rectangle.width, 3)
        scale = np.float32(1 / max(self.samples, 1))
        return np.asarray(np.array(buffer).reshape(shape) * scale, np.float32)


def threads_are_apart(lanes: int, per_pixel: int) -> bool:
    """Whether Dr.Jit's threads each take whole pixels of a launch, per_pixel lanes in a row.

    A thread takes blocks of lanes, one after another: of THREAD_BLOCK lanes where there are
    more than two for each thread, else equal shares of whole packets, two for each thread.
    Never on a GPU.
    """
    if dr.backend_v(mi.Float) != dr.JitBackend.LLVM:
        return False
    threads = dr.thread_count()
    if threads <= 1 or lanes > 2 * threads * THREAD_BLOCK:
        return threads <= 1 or THREAD_BLOCK % per_pixel == 0
    block, rest = divmod(lanes, 2 * threads)
    return rest == 0 and block % math.lcm(per_pixel, WIDEST_PACKET) == 0
