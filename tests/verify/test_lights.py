"""At full size: mixes of lights against Mitsuba, and what a bake keeps of their sum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import burnish
from burnish.materials.lights import LightState, placements
from burnish.precompute.plan import basis_for
from burnish.reference import PathTracedTruth
from burnish.scene import Scene
from burnish.scene.moving import LightMover
from burnish.transport.basis import initial_state
from tests.precompute.pictures import Look, pictures, same
from tests.precompute.test_lights import lamp_and_window, mixed_state, two_lamps
from tests.precompute.test_moved_lights import repainted, room, with_lights
from tests.verify.report import Figures

pytestmark = pytest.mark.verify

SIDE, SPP = 32, 16384
MIXES: list[LightState] = [
    LightState(on=False),
    LightState(intensity=0.25, tint=(1.0, 0.6, 0.2)),
    LightState(intensity=8.0),
    LightState(solo=True, tint=(0.3, 0.5, 1.0)),
]


@pytest.mark.parametrize("scene", [two_lamps, lamp_and_window])
def test_mixes_are_mitsuba_s(figures: Figures, scene: Callable[[int], Scene]) -> None:
    """Every mix of each light, from the same samples, with the emitters scaled in Mitsuba."""
    loaded = scene(SIDE)
    basis = basis_for(loaded, None, (1, 1, 1, 1), light_groups=("each",))
    cases = [
        (group.name, n, mixed_state(basis, **{group.name: light}))
        for group in basis.lights
        for n, light in enumerate(MIXES)
    ]
    looks = [Look(state) for _, _, state in cases] + [Look(initial_state(basis.objects))]
    *ours, unmixed = pictures(loaded, basis, looks, spp=SPP, per_pass=64)
    truth = PathTracedTruth(loaded, bounces=4)
    for (name, n, state), picture in zip(cases, ours, strict=True):
        theirs = truth.estimate(state, spp=SPP // 2, seed=7)
        what = f"{name}, mix {n}"
        figures.equal(what, same(picture, theirs), picture.mean, theirs.reflected)
        figures.different(f"{what}: the unmixed picture", same(unmixed, theirs))


def test_moved_lights_are_mitsuba_s(figures: Figures) -> None:
    """Ten random placements of a lamp, a spot and an environment at once, the floor repainted:
    the estimate with the lights moved in place, against Mitsuba's scene described anew."""
    scene = room(moved=False, side=SIDE)
    basis = basis_for(scene, None, (1, 1, 1, 1))
    state, rng, mover = repainted(basis), np.random.default_rng(11), LightMover(scene)
    truth = PathTracedTruth(scene, bounces=4)
    before = truth.estimate(state, spp=SPP // 4, seed=7)
    for number in range(10):
        moves = {
            "lamp": {
                "position": rng.uniform((-1.5, -1.0, 1.0), (1.5, 1.5, 3.5)),
                "direction": rng.normal(size=3) - (0.0, 0.0, 2.0),
                "size": rng.uniform(0.3, 1.5),
            },
            "spot": {
                "position": rng.uniform((-2.0, -2.0, 1.5), (2.0, 0.0, 4.0)),
                "direction": rng.normal(size=3) * 0.4 + (0.0, 0.5, -1.0),
                "cutoff_angle": rng.uniform(10.0, 60.0),
            },
            "window": {"rotation": rng.uniform(-180.0, 180.0)},
        }
        moved = with_lights(scene, state, moves)
        theirs = truth.estimate(moved, spp=SPP // 4, seed=8 + number)
        mover.place(placements(scene.lights, moved))
        (ours,) = pictures(scene, basis, [Look(state)], spp=SPP // 4, per_pass=64)
        mover.place({})
        what = f"lights moved, {number}"
        figures.equal(what, same(ours, theirs), ours.mean, theirs.reflected)
        figures.different(f"{what}: where they were", same(ours, before))


def test_a_bake_sums_to_its_unmixed_picture(figures: Figures, tmp_path: Path) -> None:
    """Compressed, and with every other bundle of the same samples that has no groups."""
    scene = burnish.load("ring", resolution=(160, 120))
    plain, apart = (
        burnish.bake(
            scene, tmp_path / f"{len(groups)}.burnish", spp=1024, light_groups=groups or None
        )
        for groups in ((), ("each",))
    )
    session = burnish.edit(apart)
    whole, total = session.frame(), 0.0
    for group in session.lights:
        session.set(f"{group.key}.solo", True)
        total = total + session.frame().astype(np.float64)
        session.undo()
    figures.at_most(
        "largest difference of the sum over groups, of the brightest pixel",
        float(np.abs(total - whole).max() / whole.max()),
        1e-6,
    )
    other = burnish.edit(plain).frame()
    figures.note(
        "what compressing groups changes, relative RMS",
        float(np.linalg.norm(whole - other) / np.linalg.norm(other)),
    )
    figures.note("bytes with two groups, times those without", apart.size / plain.size)
    mixed = replace(session.lights[0].initial, intensity=0.5)
    state = {**session.state, session.lights[0].key: mixed}
    session.restore(state)
    found = burnish.compare_with_truth(session, scene, spp=1024, bounces=4)
    figures.note("a mix: rel_rmse_beyond_noise", found.numbers["rel_rmse_beyond_noise"])
    session.reset()
    found = burnish.compare_with_truth(session, scene, spp=1024, bounces=4)
    figures.note("unmixed: rel_rmse_beyond_noise", found.numbers["rel_rmse_beyond_noise"])
