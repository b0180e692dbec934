"""A bake to a given error beside Mitsuba rendering one of its materials to the same error."""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

import burnish
from bench.pictures import picture_of
from bench.report import Report
from bench.timing import seconds
from burnish.core.types import Bool, Float32, Float64
from burnish.materials.layer import LayerState, MaterialState
from burnish.precompute.accumulate import Accumulator, Rectangle
from burnish.precompute.bake import finished_tile, plan_views
from burnish.precompute.plan import basis_for
from burnish.precompute.prepass import dilate
from burnish.scene import Scene
from burnish.scene.device import activate
from burnish.scene.examples.cornell_box import describe
from burnish.transport.basis import State, initial_state

ROUGHNESS = (0.4, 0.15, 0.05)
SERIES = (64, 1, 1, 1)
WALL = "back"


def run(quick: bool) -> Report:
    """Time to equal noise, for three roughnesses of the back wall."""
    size, spp, runs = (64, 64, 4) if quick else (128, 256, 8)
    scenes = {name: wall_scene(size, name) for name in ("independent", "multijitter")}
    bake = Bake(scenes["independent"])
    rows = [compare(scenes, bake, alpha, spp, runs) for alpha in ROUGHNESS]
    notes = (
        f"Cornell box, {size}×{size}, box filter, its back wall a rough conductor (Beckmann) that "
        f"alone is editable, series {','.join(map(str, SERIES))}, {spp} samples per pixel, {runs} "
        "independent runs in turns. Error: the standard deviation between runs, which has no part "
        "of the bins' bias. Each ratio is the bake's time to reach Mitsuba's error over "
        "Mitsuba's, error² falling as 1/time: (error² · time) over (error² · time). `path` knows "
        "the material; the bake serves all of them, and its time leaves compression out. Wall: "
        "pixels that see the wall; the lamp is left out. mj: `path` with Mitsuba's multijitter "
        "sampler."
    )
    return Report("equal-error", "Bake to a given error", notes, rows)


class Bake:
    """The wall's bake of the whole picture in one tile."""

    def __init__(self, scene: Scene) -> None:
        self.basis = basis_for(scene, [WALL], SERIES)
        self.plan = plan_views(scene, self.basis, seed=0)[0]
        view = scene.view()
        self.area = Rectangle(0, 0, view.width, view.height)
        self.sees_wall = np.zeros(view.pixels, bool)
        rows = self.plan.rows
        self.sees_wall[rows.pixel[~rows.indirect & (rows.weight > 0.99)]] = True

    def trace(self, spp: int, seed: int) -> Accumulator:
        """The tensor of the whole picture."""
        accumulator = Accumulator(self.plan.tracer, self.area, self.plan.rows)
        accumulator.run(spp, seed)
        dr.sync_thread()
        return accumulator


def wall_scene(size: int, sampler: str) -> Scene:
    """The box whose back wall is a rough conductor."""
    activate()
    with tempfile.TemporaryDirectory() as folder:
        description = describe(Path(folder))
    description[WALL]["bsdf"] = {
        "type": "roughconductor",
        "distribution": "beckmann",
        "material": "Al",
        "alpha": 0.15,
    }
    view = description["view"]
    view["film"] = {**view["film"], "rfilter": {"type": "box"}}
    view["sampler"] = {"type": sampler}
    return burnish.load(description, resolution=(size, size))


def compare(
    scenes: dict[str, Scene], bake: Bake, alpha: float, spp: int, runs: int
) -> dict[str, Any]:
    """One roughness: the bake, and `path` with each sampler, run by run in turns."""
    state = rough(initial_state(bake.basis.objects), alpha)
    integrator = mi.load_dict(
        {"type": "path", "max_depth": len(SERIES) + 1, "rr_depth": len(SERIES) + 2}
    )
    pictures: dict[str, list[Float32]] = {name: [] for name in ("bake", *scenes)}
    times: dict[str, list[float]] = {name: [] for name in pictures}

    def render(mi_scene: Any) -> Callable[[int], Float32]:
        def action(seed: int) -> Float32:
            image = integrator.render(mi_scene, mi_scene.sensors()[0], seed=seed, spp=spp)
            dr.eval(image)
            dr.sync_thread()
            return np.array(image)[..., :3]

        return action

    peers = {
        name: render(scene.with_bsdfs({WALL: scene.object(WALL).edited_bsdf(state[WALL])}))
        for name, scene in scenes.items()
    }
    for seed in range(runs + 1):
        tensors: list[Accumulator] = []
        found: dict[str, list[Float32]] = {name: [] for name in peers}
        spent = {"bake": seconds(lambda s=seed, t=tensors: t.append(bake.trace(spp, s)))}
        for name, peer in peers.items():
            spent[name] = seconds(lambda p=peer, s=seed, f=found[name]: f.append(p(s)))
        # The first round compiles
        if seed:
            tile = finished_tile(tensors[0], 0.0)
            pictures["bake"].append(picture_of(tensors[0], tile, state))
            # The edge of a lamp is noisier than all else, and has nothing to do with materials
            lamp = dilate(tile.emission.any(axis=2, keepdims=True)).ravel()
            for name in peers:
                pictures[name].append(found[name][0])
            for name, value in spent.items():
                times[name].append(value)

    row: dict[str, Any] = {"α": alpha}
    for where, mask in (("", ~lamp), (" wall", bake.sees_wall & ~lamp)):
        cost = {
            name: statistics.median(times[name]) * variance(pictures[name], mask)
            for name in pictures
        }
        if where:
            row["rel. noise % bake"] = noise(pictures["bake"], mask)
            row["rel. noise % path"] = noise(pictures["independent"], mask)
        row[f"bake / path{where}"] = cost["bake"] / cost["independent"]
        row[f"bake / path mj{where}"] = cost["bake"] / cost["multijitter"]
    return row


def rough(start: State, alpha: float) -> State:
    """The wall with that roughness."""
    layers = {
        name: LayerState({**layer.values, "roughness": alpha}, weight=layer.weight)
        if "roughness" in layer.values
        else layer
        for name, layer in start[WALL].layers.items()
    }
    return {**start, WALL: MaterialState(layers)}


def variance(pictures: list[Float32], mask: Bool) -> float:
    """The mean over pixels of the variance between runs."""
    return float(_chosen(pictures, mask).var(axis=0, ddof=1).mean())


def noise(pictures: list[Float32], mask: Bool) -> float:
    """Per cent of the picture."""
    chosen = _chosen(pictures, mask)
    return 100 * float(np.sqrt(variance(pictures, mask) / (chosen.mean(axis=0) ** 2).mean()))


def _chosen(pictures: list[Float32], mask: Bool) -> Float64:
    return np.stack(pictures).astype(np.float64).reshape(len(pictures), -1, 3)[:, mask]
