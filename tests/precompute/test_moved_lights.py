"""Lights that move while materials are edited: the same as a scene written with them there."""

from __future__ import annotations

import gc
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.compare import ztest
from burnish.materials.lights import LightState, each, placements
from burnish.precompute.light_pictures import LightTracer
from burnish.precompute.live import LiveEstimate
from burnish.precompute.plan import basis_for
from burnish.reference import PathTracedTruth
from burnish.scene import Scene
from burnish.scene.device import activate
from burnish.scene.moving import LightMover
from burnish.transport.basis import Basis, State, initial_state
from tests.precompute import worlds
from tests.precompute.pictures import Look, pictures, same
from tests.reference.worlds import lambert

activate()
T = mi.ScalarTransform4f
SKY = np.random.default_rng(3).uniform(0.05, 0.2, (16, 32, 3)).astype(np.float32)
SKY[3:6, 5:9] = (12.0, 10.0, 8.0)
MOVES: dict[str, dict[str, Any]] = {
    # Nearer, smaller, and in view of the camera
    "lamp": {"position": (-0.6, 0.8, 1.6), "direction": (0.0, 0.6, -0.8), "size": 0.5},
    "spot": {
        "position": (1.0, -1.5, 2.0),
        "direction": (-0.5, 1.0, -0.6),
        "cutoff_angle": 35.0,
        "beam_width": 10.0,
    },
    "window": {"rotation": 135.0},
}


def room(moved: bool, side: int = 16) -> Scene:
    """A lamp, a spot and a sky with a bright window; moved: written as in MOVES."""
    down = T().rotate([1, 0, 0], 180)
    lamp = worlds.lamp(radiance=8.0)
    lamp["to_world"] = T().translate([0, 0, 3.5]) @ down @ T().scale(0.7)
    if moved:
        tilt = T().rotate([1, 0, 0], float(np.degrees(np.arctan2(0.6, 0.8))))
        lamp["to_world"] = T().translate([-0.6, 0.8, 1.6]) @ tilt @ down @ T().scale(0.35)
    spot: dict[str, Any] = {
        "type": "spot",
        "intensity": 20.0,
        "to_world": T().look_at([1.5, -1, 3], [0.3, 0.5, 0], [0, 1, 0]),
        "cutoff_angle": 25.0,
    }
    if moved:
        spot["to_world"] = T().look_at([1.0, -1.5, 2.0], [0.5, -0.5, 1.4], [0, 1, 0])
        spot |= {"cutoff_angle": 35.0, "beam_width": 10.0}
    sky = {
        "type": "envmap",
        # 135 degrees are 12 of the 32 columns
        "bitmap": mi.Bitmap(np.roll(SKY, -12, axis=1) if moved else SKY),
        "to_world": T().rotate([1, 0, 0], 90),
    }
    materials = {"floor": lambert(worlds.GREY), "wall": lambert(worlds.RED)}
    lights = {"lamp": lamp, "spot": spot, "window": sky}
    return worlds.corner(materials, lights=lights, side=side)


def repainted(basis: Basis) -> State:
    """The floor in another colour."""
    state = dict(initial_state(basis.objects))
    (name, layer), *_ = state["floor"].layers.items()
    bright = replace(layer, values={**layer.values, "color": (0.2, 0.7, 0.4)})
    state["floor"] = replace(state["floor"], layers={**state["floor"].layers, name: bright})
    return state


def with_lights(
    scene: Scene, state: State, moves: Mapping[str, Mapping[str, Any]] = MOVES
) -> State:
    """The state with the lights moved."""
    found = dict(state)
    for group in each(scene.lights):
        light: LightState = group.initial
        for name, value in moves[group.name].items():
            light = light.set(name, value, group.key)
        found[group.key] = light
    return found


def test_moved_lights_are_those_of_a_scene_with_the_lights_there() -> None:
    """A lamp, a spot, a turned environment, and a material that is edited, all at once: the
    path tracer's and the estimate's, against Mitsuba's own scene with the picture rolled."""
    scene, there = room(moved=False), room(moved=True)
    basis = basis_for(scene, None, (1, 1, 1))
    state = repainted(basis)
    moved = with_lights(scene, state)
    written = PathTracedTruth(there, bounces=3).estimate(state, spp=2048, seed=5)

    truth = PathTracedTruth(scene, bounces=3).estimate(moved, spp=2048, seed=6)
    result = ztest(truth.reflected, truth.variance, written.reflected, written.variance)
    assert result.passed, str(result)

    before, _ = pictures(scene, basis, [Look(state)] * 2, spp=256, per_pass=64)
    assert not same(before, written).passed
    LightMover(scene).place(placements(scene.lights, moved))
    estimate, wrong = pictures(
        scene, basis, [Look(state), Look(initial_state(basis.objects))], spp=2048, per_pass=64
    )
    assert estimate.lost == 0
    assert same(estimate, written).passed, str(same(estimate, written))
    assert not same(wrong, written).passed


def test_shares_of_moved_lights_are_of_where_they_stand() -> None:
    """What the sum of the shares' pictures is: the path tracer's picture."""
    scene, there = room(moved=False), room(moved=True)
    basis = basis_for(scene, None, (1, 1, 1))
    state = repainted(basis)
    LightMover(scene).place(placements(scene.lights, with_lights(scene, state)))
    groups = each(scene.lights)
    tracer = LightTracer(scene, scene.view(), basis, state, groups)
    passes = np.stack([np.subtract(*tracer.pictures(16, seed)) for seed in range(32)]).sum(axis=1)
    written = PathTracedTruth(there, bounces=3).estimate(state, spp=512, seed=6)
    variance = passes.var(axis=0, ddof=1) / len(passes)
    result = ztest(passes.mean(axis=0), variance, written.reflected, written.variance)
    assert result.passed, str(result)


def test_a_moved_light_compiles_nothing() -> None:
    """And an estimate that begins again has samples of where the lights stand now alone."""
    # Scenes of other tests that go meanwhile take their lights out of the kernels
    gc.collect()
    scene = room(moved=False)
    basis = basis_for(scene, None, (8, 1))
    state = initial_state(basis.objects)
    mover = LightMover(scene)
    estimate = LiveEstimate(scene, scene.view(), basis, ["floor"], state, (), 1)
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    try:
        own, first = picture(estimate), kernels()
        for number, spin in enumerate((20.0, 90.0, 135.0, 250.0)):
            x = 0.1 * number
            mover.place(
                {
                    "lamp": {"position": (x, 0.0, 3.0), "size": 1.0 - x},
                    "spot": {"position": (x, 0.0, 2.0), "cutoff_angle": 30.0 + x},
                    "window": {"rotation": spin},
                }
            )
            estimate.restart(state, number)
            kernels()
            moved = picture(estimate)
            assert kernels() <= first
    finally:
        dr.set_flag(dr.JitFlag.KernelHistory, False)
    assert abs(moved - own).max() > 0.1
    mover.place({})
    estimate.restart(state, 1)
    assert estimate.samples == 0
    np.testing.assert_allclose(picture(estimate), own, rtol=1e-3, atol=1e-5)


def kernels() -> set[str]:
    """What has been launched since this was last asked."""
    return {item["hash"] for item in dr.kernel_history() if item["type"] == dr.KernelType.JIT}


def picture(estimate: LiveEstimate) -> np.ndarray:
    """All sums of the estimate after its first samples, as one array."""
    estimate.step()
    outputs = [np.empty(part.shape, np.float32) for part in estimate.parts()]
    estimate.write(outputs)
    return np.concatenate([item.ravel() for item in (*outputs, *estimate.base())])
