"""Samples per second of a bake beside Mitsuba's `path`."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi

import burnish
from bench.report import Goal, Report
from bench.timing import seconds
from burnish.precompute.accumulate import Accumulator
from burnish.precompute.bake import ViewPlan, finished_tile, plan_views, strata
from burnish.precompute.plan import basis_for
from burnish.scene import Scene
from burnish.store.tiles import write_tile
from burnish.transport.compression import DEFAULT_TOLERANCE

BUDGETS = (256, 1024, 4096)
"""Samples per pixel for which the rate of a whole bake is stated; the last is the goal's."""


@dataclass(frozen=True)
class Case:
    """A scene, its series and its resolution."""

    scene: str
    series: tuple[int, ...]
    resolution: tuple[int, int]


CASES = (
    Case("cornell-box", (64, 1, 1, 1), (450, 450)),
    Case("teatray", (128, 1, 1, 1), (320, 240)),
)


def run(quick: bool) -> Report:
    """Rates of tracing alone, and of bakes with all that is done once per tile."""
    rows, goals = [], []
    for case in CASES:
        row = measure(case, spp=64 if quick else 256, every=4 if quick else 1, repeats=3)
        rows.append(row)
        what = f"{case.scene}, samples per second of `path`"
        goals.append(Goal(f"{what}, tracing", row["tracing / path"], 0.8, at_least=True))
        last = f"bake / path at {BUDGETS[-1]} spp"
        goals.append(
            Goal(f"{what}, bake of {BUDGETS[-1]} per pixel", row[last], 0.8, at_least=True)
        )
    notes = (
        "Camera paths per second at the same depth, scene and resolution; tiles and pictures in "
        "turns, medians of rounds. Tracing is a tile's second budget of samples, by itself; once "
        "per tile are its rows, clearing and first touching its tensor, compressing and writing "
        "it. Kernels are compiled before. A bake's rate at n samples per pixel is that of both."
    )
    return Report("bake-rate", "Bake rate", notes, rows, goals)


def measure(case: Case, spp: int, every: int, repeats: int) -> dict[str, Any]:
    """One case; ours traces every `every`-th tile."""
    scene = burnish.load(case.scene, resolution=case.resolution)
    basis = basis_for(scene, series=case.series)
    plan = plan_views(scene, basis, seed=0)[0]
    numbers = range(every // 2, len(plan.tiles), every)
    pixels = sum(plan.tiles[n].width * plan.tiles[n].height for n in numbers)
    path, lanes = path_tracer(scene, len(case.series), spp)
    times: dict[str, list[float]] = {"path": [], "tracing": [], "once": []}
    for seed in range(repeats + 1):
        own = [0.0, 0.0]
        for number in numbers:
            spent = tile_seconds(plan, number, spp, seed)
            own = [total + more for total, more in zip(own, spent, strict=True)]
        found = {"path": seconds(lambda s=seed: path(s)), "tracing": own[0], "once": own[1]}
        # The first round compiles
        for name, value in found.items() if seed else ():
            times[name].append(value)
    theirs = statistics.median(times["path"]) / lanes
    ours = statistics.median(times["tracing"]) / (pixels * sum(strata(spp)))
    once = statistics.median(times["once"]) / pixels
    return {
        "scene": case.scene,
        "series": ",".join(map(str, case.series)),
        "resolution": "×".join(map(str, case.resolution)),
        "tile": f"{plan.tiles[0].width}²",
        "path M/s": 1e-6 / theirs,
        "tracing M/s": 1e-6 / ours,
        "tracing / path": theirs / ours,
        "once per tile, µs/px": 1e6 * once,
        **{f"bake / path at {n} spp": theirs / (ours + once / n) for n in BUDGETS},
    }


def tile_seconds(plan: ViewPlan, number: int, spp: int, seed: int) -> tuple[float, float]:
    """Seconds of tracing a tile with spp samples, and of what is done with it once."""
    rectangle = plan.tiles[number]
    start = time.perf_counter()
    accumulator = Accumulator(plan.tracer, rectangle, plan.tile_rows(rectangle))
    first = add_samples(accumulator, plan, spp, 2 * seed)
    middle = time.perf_counter()
    tracing = add_samples(accumulator, plan, spp, 2 * seed + 1)
    again = time.perf_counter()
    tile = finished_tile(accumulator, DEFAULT_TOLERANCE)
    with tempfile.TemporaryDirectory() as folder:
        write_tile(Path(folder) / "tile", tile)
        end = time.perf_counter()
    # The first budget pays for the tensor's memory; what it takes longer is spent once
    return tracing, (middle - start - first) + max(first - tracing, 0.0) + (end - again)


def add_samples(accumulator: Accumulator, plan: ViewPlan, spp: int, seed: int) -> float:
    """Trace, and return the seconds."""
    start = time.perf_counter()
    for index, samples in enumerate(strata(spp)):
        accumulator.run(samples, 7919 * seed + index, plan.largest)
    dr.sync_thread()
    return time.perf_counter() - start


def path_tracer(scene: Scene, bounces: int, spp: int) -> tuple[Callable[[int], object], int]:
    """Mitsuba's `path` on the first view, by seed, and how many paths that is.

    In launches of at most 2²³ paths, so that memory does not slow it down.
    """
    view = scene.view()
    integrator = mi.load_dict({"type": "path", "max_depth": bounces + 1, "rr_depth": bounces + 2})
    per_launch = max(1, min(spp, (1 << 23) // view.pixels))
    launches = -(-spp // per_launch)

    def render(seed: int) -> None:
        for number in range(launches):
            image = integrator.render(
                scene.mi_scene, view.sensor, seed=launches * seed + number, spp=per_launch
            )
            dr.eval(image)
            dr.sync_thread()

    return render, view.pixels * per_launch * launches
