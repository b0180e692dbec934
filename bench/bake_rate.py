"""Samples per second of the symbolic path tracer beside Mitsuba's `path`."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
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
from burnish.transport.compression import DEFAULT_TOLERANCE

BUDGET = 4096
"""Samples per pixel for which the share of compression is stated."""


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
    """Rates of tracing alone, and of a bake with its compression."""
    rows, goals = [], []
    for case in CASES:
        row = measure(case, spp=64 if quick else 256, every=4 if quick else 1, repeats=3)
        rows.append(row)
        what = f"{case.scene}, samples per second of `path`"
        goals.append(Goal(f"{what}, tracing", row["tracing / path"], 0.8, at_least=True))
    notes = (
        "Camera paths per second at the same depth, scene and resolution; pictures of each in "
        "turns, medians. Tracing includes clearing each tile's tensor; the last column adds "
        f"compression, once per tile, at {BUDGET:,} samples per pixel."
    )
    return Report("bake-rate", "Bake rate", notes, rows, goals)


def measure(case: Case, spp: int, every: int, repeats: int) -> dict[str, Any]:
    """One case; ours traces every `every`-th tile."""
    scene = burnish.load(case.scene, resolution=case.resolution)
    basis = basis_for(scene, series=case.series)
    plan = plan_views(scene, basis, seed=0)[0]
    numbers = range(every // 2, len(plan.tiles), every)
    ours = sum(plan.tiles[n].width * plan.tiles[n].height for n in numbers) * sum(strata(spp))
    path, lanes = path_tracer(scene, len(case.series), spp)
    compressing = 0.0

    def trace(seed: int, compress: bool = False) -> float:
        """Seconds of tracing the tiles."""
        nonlocal compressing
        total = 0.0
        for number in numbers:
            accumulator: list[Accumulator] = []
            total += seconds(lambda n=number, a=accumulator: a.append(traced(plan, n, spp, seed)))
            if compress:
                compressing += seconds(lambda a=accumulator: finished_tile(a[0], DEFAULT_TOLERANCE))
        return total

    # The first round compiles, and times the compression
    path(0)
    trace(0, compress=True)
    times: dict[str, list[float]] = {"path": [], "tracing": []}
    for seed in range(1, repeats + 1):
        times["path"].append(seconds(lambda s=seed: path(s)))
        times["tracing"].append(trace(seed))
    theirs_rate = lanes / statistics.median(times["path"])
    ours_rate = ours / statistics.median(times["tracing"])
    pixels = ours / sum(strata(spp))
    whole = BUDGET * pixels / (BUDGET * pixels / ours_rate + compressing)
    return {
        "scene": case.scene,
        "series": ",".join(map(str, case.series)),
        "resolution": "×".join(map(str, case.resolution)),
        "tile": f"{plan.tiles[0].width}²",
        "path M/s": theirs_rate / 1e6,
        "tracing M/s": ours_rate / 1e6,
        "tracing / path": ours_rate / theirs_rate,
        "compression µs/px": 1e6 * compressing / pixels,
        f"bake / path at {BUDGET} spp": whole / theirs_rate,
    }


def traced(plan: ViewPlan, number: int, spp: int, seed: int) -> Accumulator:
    """A tile's tensor, traced to the end."""
    rectangle = plan.tiles[number]
    accumulator = Accumulator(plan.tracer, rectangle, plan.tile_rows(rectangle))
    for index, samples in enumerate(strata(spp)):
        accumulator.run(samples, 7919 * seed + 101 * number + index)
    dr.sync_thread()
    return accumulator


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
