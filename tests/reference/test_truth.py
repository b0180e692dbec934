"""The truth holds Mitsuba's own plugins where it can, and burnish's BSDF equals them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from burnish.compare import ztest
from burnish.core.errors import InvalidValue, UnknownName
from burnish.materials.curve import Curve
from burnish.materials.lights import each
from burnish.reference import Estimate, PathTracedTruth, layered_class, series_image
from burnish.reference.truth import edited_bsdf
from burnish.scene import Scene, load
from tests.reference.worlds import SKY, camera, edited, plane

RED = {"type": "rgb", "value": [0.6, 0.2, 0.1]}
CHECKERS = {
    "type": "checkerboard",
    "color0": {"type": "rgb", "value": [0.1, 0.2, 0.3]},
    "color1": {"type": "rgb", "value": [0.9, 0.7, 0.5]},
}
PLUGINS: dict[str, dict[str, Any]] = {
    "diffuse": {"type": "diffuse", "reflectance": RED},
    "textured": {"type": "twosided", "inner": {"type": "diffuse", "reflectance": CHECKERS}},
    "conductor": {"type": "conductor", "material": "Au"},
    "roughconductor": {
        "type": "roughconductor",
        "material": "Cu",
        "distribution": "ggx",
        "alpha": 0.2,
    },
    "plastic": {"type": "plastic", "diffuse_reflectance": RED, "nonlinear": True},
    "roughplastic": {"type": "roughplastic", "diffuse_reflectance": RED, "alpha": 0.15},
}


def ball(bsdf: dict[str, Any]) -> Scene:
    """A ball over a floor, under a lamp and a dim sky."""
    return load(
        {
            "type": "scene",
            "ball": {"type": "sphere", "bsdf": bsdf},
            "floor": plane(z=-1.0, size=6.0),
            "lamp": plane(z=3.5, size=1.2, down=True, emitter={"type": "area", "radiance": 4.0}),
            "sky": {**SKY, "radiance": 0.3},
            "view": camera((0, -6, 1), (0, 0, 0)),
        },
        resolution=(24, 24),
    )


def without_plugins(scene: Scene) -> Scene:
    """The scene as if Mitsuba had no plugin for any edit."""
    return replace(scene, objects=tuple(replace(item, factory=None) for item in scene.objects))


def agree(a: Estimate, b: Estimate) -> None:
    result = ztest(a.reflected, a.variance, b.reflected, b.variance)
    assert result.passed, str(result)
    assert result.relative_sigma < 0.03


@pytest.mark.parametrize("name", PLUGINS)
def test_our_bsdf_is_mitsuba_s_plugin(name: str) -> None:
    """Independent sources of the same picture: the models are checked against Mitsuba here."""
    scene = ball(PLUGINS[name])
    material = scene.object("ball").material
    assert material is not None
    layer = material.layers[-1].name
    # A weight that no plugin knows the default of, so that the state counts as edited
    state = {"ball": edited(material.initial, layer, weight=0.9)}
    theirs = PathTracedTruth(scene, 2).estimate(state, spp=1024, seed=1)
    ours = PathTracedTruth(without_plugins(scene), 2).estimate(state, spp=1024, seed=2)
    agree(theirs, ours)


@pytest.mark.verify
@pytest.mark.parametrize("roughness", [0.05, 0.15, 0.6])
@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
def test_our_bsdf_is_mitsuba_s_plugin_over_its_range(distribution: str, roughness: float) -> None:
    plugin = {**PLUGINS["roughconductor"], "distribution": distribution}
    scene = ball(plugin)
    material = scene.object("ball").material
    assert material is not None
    state = {"ball": edited(material.initial, "specular", roughness=roughness)}
    theirs = PathTracedTruth(scene, 3).estimate(state, spp=16384, seed=1)
    ours = PathTracedTruth(without_plugins(scene), 3).estimate(state, spp=16384, seed=2)
    agree(theirs, ours)


@pytest.mark.parametrize("name", ["textured", "conductor", "plastic"])
def test_maps_and_mirrors_reach_the_series(name: str) -> None:
    scene = ball(PLUGINS[name])
    material = scene.object("ball").material
    assert material is not None
    state = {"ball": material.initial}
    theirs = PathTracedTruth(scene, 2).estimate(state, spp=1024, seed=1)
    agree(theirs, series_image(scene, state, (64, 1), spp=1024, seed=2))


def test_an_unedited_object_keeps_the_scene_s_own_bsdf() -> None:
    scene = ball(PLUGINS["roughconductor"])
    item = scene.object("ball")
    assert item.material is not None
    truth = PathTracedTruth(scene)
    assert truth.mi_scene({"ball": item.material.initial}) is scene.mi_scene
    assert truth.mi_scene({}) is scene.mi_scene


def test_the_scene_is_built_again_only_when_the_materials_change() -> None:
    scene = ball(PLUGINS["roughconductor"])
    item = scene.object("ball")
    assert item.material is not None
    truth = PathTracedTruth(scene)
    states = [
        {"ball": edited(item.material.initial, "specular", roughness=r)} for r in (0.3, 0.3, 0.4)
    ]
    built = [truth.mi_scene(state) for state in states]
    assert built[0] is built[1]
    assert built[0] is not built[2]


def test_an_edit_that_mitsuba_can_hold_is_held_by_mitsuba() -> None:
    item = ball(PLUGINS["roughconductor"]).object("ball")
    assert item.material is not None
    rougher = edited(item.material.initial, "specular", roughness=0.4)
    assert not isinstance(edited_bsdf(item, rougher), layered_class())
    curve = Curve((0.0, 1.0), ((2.0,) * 3, (0.1,) * 3))
    drawn = edited(item.material.initial, "specular", curve=curve)
    assert isinstance(edited_bsdf(item, drawn), layered_class())


def test_render_is_the_estimate_s_picture_in_linear_rgb() -> None:
    scene = ball(PLUGINS["diffuse"])
    truth = PathTracedTruth(scene)
    image = truth.render({}, scene.view().name, 8, seed=3)
    assert image.dtype == np.float32
    assert image.shape == (24, 24, 3)
    np.testing.assert_allclose(image, truth.estimate({}, spp=8, seed=3).image, rtol=1e-4, atol=1e-6)


def test_bounces_are_mitsuba_s_depth_less_one() -> None:
    scene = ball(PLUGINS["diffuse"])
    direct = PathTracedTruth(scene, bounces=1).estimate({}, spp=512)
    integrator = mi.load_dict({"type": "direct"})
    theirs = np.asarray(mi.render(scene.mi_scene, integrator=integrator, spp=512, seed=9))
    assert direct.image.mean() == pytest.approx(theirs.mean(), rel=0.01)
    assert PathTracedTruth(scene).estimate({}, spp=512).image.mean() > 1.02 * theirs.mean()


def test_unknown_names_and_fixed_objects_are_refused() -> None:
    scene = ball(PLUGINS["diffuse"])
    material = scene.object("ball").material
    assert material is not None
    state = edited(material.initial, "diffuse", color=(0.1, 0.1, 0.1))
    with pytest.raises(UnknownName, match="bal1"):
        PathTracedTruth(scene).estimate({"bal1": state}, spp=2)
    with pytest.raises(InvalidValue, match="lamp"):
        PathTracedTruth(scene).estimate({"lamp": state}, spp=2)


def test_tinted_daylight_is_the_sum_of_its_channels() -> None:
    """Mitsuba has no tint for it; light adds up, so the tinted picture is known from others."""
    scene = load(
        {
            "type": "scene",
            "ball": {"type": "sphere", "bsdf": PLUGINS["roughplastic"]},
            "floor": plane(z=-1.0, size=6.0, bsdf={"type": "diffuse", "reflectance": RED}),
            "lamp": plane(z=3.5, size=1.2, down=True, emitter={"type": "area", "radiance": 4.0}),
            "day": {"type": "sunsky", "sun_direction": [-0.4, -0.6, 0.6], "sun_scale": 0.01},
            "view": camera((0, -6, 1), (0, 0, 0)),
        },
        resolution=(24, 24),
    )
    lamp, day = each(scene.lights)
    tint = (0.2, 1.0, 0.5)
    truth = PathTracedTruth(scene, bounces=2)
    tinted = {day.key: replace(day.initial, tint=tint, intensity=1.5)}
    parts = [
        truth.estimate({day.key: replace(day.initial, on=False)}, spp=256, seed=1),
        truth.estimate({lamp.key: replace(lamp.initial, on=False)}, spp=256, seed=2),
    ]
    factors = np.array([(1.0, 1.0, 1.0), tint]) * [[1.0], [1.5]]
    expected = sum(f * part.reflected for f, part in zip(factors, parts, strict=True))
    variance = sum(f**2 * part.variance for f, part in zip(factors, parts, strict=True))
    found = truth.estimate(tinted, spp=256, seed=3)
    result = ztest(found.reflected, found.variance, expected, variance)
    assert result.passed, str(result)
    with pytest.raises(InvalidValue, match="no one Mitsuba scene holds tinted daylight"):
        truth.mi_scene(tinted)
    plain = truth.estimate({day.key: replace(day.initial, intensity=1.5)}, spp=256, seed=3)
    # Through the same points of every pixel
    np.testing.assert_allclose(found.emission, plain.emission * tint, rtol=1e-4, atol=1e-6)
    assert not ztest(found.reflected, found.variance, plain.reflected, plain.variance).passed
