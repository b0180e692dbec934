"""Light groups in the tracer: their sum is the unmixed light, and a mix is Mitsuba's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest

from burnish.compare import ztest
from burnish.core.errors import TooLarge
from burnish.materials.lights import LightGroup, LightState, each
from burnish.precompute import plan
from burnish.precompute.light_pictures import LightTracer
from burnish.precompute.plan import basis_for
from burnish.reference import PathTracedTruth
from burnish.scene import Scene, load
from burnish.scene.examples import catalogue
from burnish.transport.basis import Basis, EditableObject, State, initial_state
from burnish.transport.rows import Rows
from tests.precompute import worlds
from tests.precompute.pictures import Look, accumulator, pictures, same
from tests.reference.worlds import lambert


def two_lamps(side: int = 16) -> Scene:
    """The Cornell box with a second, blue lamp on the floor, as wide as a hand."""
    place = Path()
    scene = catalogue.find("cornell-box").describe(place)
    scene["second"] = {
        "type": "sphere",
        "center": [4.2, 0.5, 1.0],
        "radius": 0.3,
        "bsdf": {"type": "diffuse"},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [6.0, 9.0, 30.0]}},
    }
    return load(scene, resolution=(side, side))


def lamp_and_window(side: int = 16) -> Scene:
    """A lamp, and an environment map with a bright window."""
    sky = np.random.default_rng(3).uniform(0.1, 0.5, (16, 32, 3))
    sky[3:6, 5:9] = (12.0, 10.0, 8.0)
    window = {
        "type": "envmap",
        "bitmap": mi.Bitmap(sky.astype(np.float32)),
        "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], 90),
    }
    materials = {"floor": lambert(worlds.GREY), "wall": lambert(worlds.RED)}
    return worlds.corner(materials, lights={"window": window, "lamp": worlds.lamp()}, side=side)


CASES: list[tuple[Callable[[], Scene], tuple[int, ...]]] = [
    (two_lamps, (8, 1, 1)),
    (lamp_and_window, (1, 1, 1)),
    (worlds.glossy, (16, 4)),
]


@pytest.mark.parametrize(("scene", "series"), CASES, ids=[case.__name__ for case, _ in CASES])
def test_the_sum_over_groups_is_the_unmixed_light(
    scene: Callable[[], Scene], series: tuple[int, ...]
) -> None:
    """The same paths, added up in another order: to float precision."""
    loaded = scene()
    plain = basis_for(loaded, None, series)
    apart = replace(plain, lights=each(loaded.lights))
    whole, split = (accumulator(loaded, basis) for basis in (plain, apart))
    for tensor in (whole, split):
        tensor.run(16, 3)
    count = len(apart.lights)
    for one, many in zip(whole.transport(), split.transport(), strict=True):
        by_group = many.reshape(*many.shape[:2], count, *one.shape[2:])
        np.testing.assert_allclose(by_group.sum(axis=2), one, rtol=1e-4, atol=1e-6 * one.max())
    for name in ("fixed", "emission"):
        one, many = (t.image(getattr(t.target, name)) for t in (whole, split))
        np.testing.assert_allclose(many.sum(axis=0), one, rtol=1e-4, atol=1e-6 * one.max(initial=1))


def mixed_state(basis: Basis, **lights: LightState) -> State:
    groups = {group.name: group for group in basis.lights}
    return {
        **initial_state(basis.objects),
        **{
            groups[name].key: replace(light, members=groups[name].members)
            for name, light in lights.items()
        },
    }


WARM = LightState(intensity=0.4, tint=(1.0, 0.5, 0.1))
BRIGHT = LightState(intensity=3.0)
OFF = LightState(on=False)


@pytest.mark.parametrize(
    ("scene", "lights"),
    [
        (two_lamps, {"light": WARM, "second": BRIGHT}),
        (lamp_and_window, {"window": WARM, "lamp": OFF}),
    ],
    ids=["two lamps", "lamp and window"],
)
def test_a_mix_is_mitsuba_with_scaled_emitters(
    scene: Callable[[], Scene], lights: dict[str, LightState]
) -> None:
    """Of the same samples as the unmixed picture, which fails the same test."""
    loaded = scene()
    basis = basis_for(loaded, None, (1, 1, 1), light_groups=("each",))
    state = mixed_state(basis, **lights)
    truth = PathTracedTruth(loaded, bounces=3).estimate(state, spp=2048, seed=5)
    right, wrong = pictures(
        loaded, basis, [Look(state), Look(initial_state(basis.objects))], spp=2048, per_pass=64
    )
    assert same(right, truth).passed, str(same(right, truth))
    assert not same(wrong, truth).passed


def test_pictures_of_each_light_are_mitsuba_s_with_the_others_muted() -> None:
    loaded = lamp_and_window()
    groups = each(loaded.lights)
    basis = basis_for(loaded, None, (1, 1, 1))
    tracer = LightTracer(loaded, loaded.view(), basis, {}, groups)
    passes = np.stack([np.stack(tracer.pictures(16, seed)) for seed in range(32)])
    light = passes[:, 0] - passes[:, 1]
    for g, group in enumerate(groups):
        # A session's state names the lights that something is set on, and no other
        state = {group.key: replace(group.initial, solo=True)}
        truth = PathTracedTruth(loaded, bounces=3).estimate(state, spp=512, seed=6)
        mean, variance = light[:, g].mean(axis=0), light[:, g].var(axis=0, ddof=1) / len(light)
        result = ztest(mean, variance, truth.reflected, truth.variance)
        assert result.passed, str(result)


def test_the_check_of_sizes_counts_the_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Basis((EditableObject("a", lambert(worlds.GREY)),), (1, 1, 1))
    apart = replace(plain, lights=(LightGroup("a", ("a",)), LightGroup("b", ("b",))))
    rows = replace(
        Rows.empty(),
        pixel=np.arange(64, dtype=np.int32),
        object=np.zeros(64, np.int32),
        indirect=np.zeros(64, np.bool_),
    )
    assert (plan.row_bytes(apart, rows) == 2 * plan.row_bytes(plain, rows)).all()
    monkeypatch.setattr(plan, "TILE_BYTES", int(1.5 * plan.row_bytes(plain, rows).sum()))
    assert len(plan.tiles_for(plain, rows, 8, 8)) == 1
    with pytest.raises(TooLarge, match=r"fewer light groups \(now 2\)"):
        plan.tiles_for(apart, rows, 8, 8)
