"""Samples that fit in a time: a timed pilot on small pieces of the picture."""

from __future__ import annotations

import time
from collections.abc import Iterator

import drjit as dr
import numpy as np

from burnish.precompute.accumulate import STRATA, Accumulator, Rectangle
from burnish.precompute.bake import ViewPlan, finished_tile, whole_strata

PIECES = 6
SIDE = 32
"""Pixels of a side of a piece, at most."""
AFTERWARDS = 0.2
"""What writing, reading back and the preview take, as a share of compressing."""


def samples_for(plans: list[ViewPlan], deadline: float, seed: int, tolerance: float) -> int:
    """Samples per pixel with which a bake ends at `deadline`, by `time.perf_counter`.

    What the pilot compiles is what the bake runs, and its time counts. It traces pieces over
    the whole picture with as many samples as are stratified together, and compresses them.
    """
    tracing = finishing = samples = pixels = compiling = 0.0
    begun = time.perf_counter()
    for number, (plan, rectangle) in enumerate(_pieces(plans)):
        start = time.perf_counter()
        if number and start > deadline - 0.8 * (deadline - begun):
            break
        accumulator = Accumulator(plan.tracer, rectangle, plan.tile_rows(rectangle))
        if not number:
            accumulator.run(STRATA, seed, plan.largest)
            dr.sync_thread()
            compiling = time.perf_counter() - start
        start = time.perf_counter()
        accumulator.run(STRATA, seed + 1 + number, plan.largest)
        dr.sync_thread()
        middle = time.perf_counter()
        finished_tile(accumulator, tolerance)
        tracing, finishing = tracing + middle - start, finishing + time.perf_counter() - middle
        pixels += rectangle.width * rectangle.height
        samples += STRATA * rectangle.width * rectangle.height

    total = sum(plan.tracer.view.width * plan.tracer.view.height for plan in plans)
    left = deadline - time.perf_counter() - (1 + AFTERWARDS) * finishing / pixels * total
    spp = left / total * samples / tracing
    if spp < STRATA:
        # Smaller strata are another kernel
        spp = (left - compiling) / total * samples / tracing
    return whole_strata(spp)


def _pieces(plans: list[ViewPlan]) -> Iterator[tuple[ViewPlan, Rectangle]]:
    """Pieces in the middle of tiles, spread over the views, those of one kernel in turn."""
    for plan in plans:
        count = min(max(PIECES // len(plans), 1), len(plan.tiles))
        for number in np.linspace(0, len(plan.tiles) - 1, count).astype(int):
            tile = plan.tiles[number]
            # Whole squares, where the tile begins
            width, height = min(SIDE, tile.width), min(SIDE, tile.height)
            x = tile.x + (tile.width - width) // 16 * 8
            y = tile.y + (tile.height - height) // 16 * 8
            yield plan, Rectangle(x, y, width, height)
