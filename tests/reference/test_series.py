"""The series' path tracer against Mitsuba's own, wherever the two must agree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from burnish.compare import ZTest, ztest
from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.coefficients import albedo
from burnish.materials.layer import Layer, LayerState, Material
from burnish.reference import Estimate, PathTracedTruth, series_image
from burnish.reference import reflectance as reflectance_module
from burnish.reference.bsdf import reflecting_bsdf
from burnish.reference.film import trace
from burnish.reference.reflectance import FineReflectance, MatteReflectance
from burnish.reference.truth import directly_seen
from burnish.scene import Scene, load
from tests.reference.worlds import SKY, blinn, camera, initial, lambert, plane, world

RED, GREY, BLUE = (0.6, 0.2, 0.1), (0.5, 0.5, 0.5), (0.1, 0.2, 0.7)


def same(a: Estimate, b: Estimate) -> ZTest:
    return ztest(a.reflected, a.variance, b.reflected, b.variance)


def mitsuba_path(scene: Scene, bsdfs: Mapping[str, Any], bounces: int, spp: int) -> Estimate:
    """Mitsuba's own path tracer with the given BSDFs, `bounces` deep."""
    built = scene.with_bsdfs(bsdfs)
    path = mi.load_dict({"type": "path", "max_depth": bounces + 1, "rr_depth": 99})

    def radiance(sampler: Any, ray: Any) -> tuple[Any, Any]:
        return mi.Color3f(path.sample(built, sampler, ray)[0]), directly_seen(built, ray)

    return trace(radiance, scene.view(), spp, seed=77)


def forms(scene: Scene, kind: type) -> dict[str, Any]:
    """Each editable object's BSDF in one form, wherever a path meets it."""
    return {
        item.id: reflecting_bsdf(kind(item.material, item.material.initial, {}), item.two_sided)
        for item in scene.editable()
        if item.material
    }


def corner(floor: Material | None, wall: Material | None) -> Scene:
    """A floor and a wall that see each other, a lamp behind the camera and a dim sky."""
    materials = {name: m for name, m in (("floor", floor), ("wall", wall)) if m}
    T = mi.ScalarTransform4f()
    return world(
        {
            "floor": plane(size=2.0),
            "wall": {
                "type": "rectangle",
                "to_world": T.translate([0, 2, 2]) @ T.rotate([1, 0, 0], 90) @ T.scale(2),
                "bsdf": {
                    "type": "diffuse",
                    "reflectance": {"type": "rgb", "value": [0.3, 0.6, 0.3]},
                },
            },
            "lamp": plane(z=3.5, size=0.7, down=True, emitter={"type": "area", "radiance": 4.0}),
            "sky": {**SKY, "radiance": 0.2},
            "view": camera((1.0, -5.0, 2.0), (0, 1.0, 0.8), fov=35),
        },
        materials,
        resolution=(24, 24),
    )


@pytest.fixture(scope="module")
def cornell() -> Scene:
    return load("cornell-box", resolution=(48, 48))


@pytest.fixture(scope="module")
def diffuse_truth(cornell: Scene) -> Estimate:
    """Mitsuba's own integrator on Mitsuba's own BSDFs."""
    return PathTracedTruth(cornell, bounces=4).estimate(initial(cornell), spp=4096, seed=5)


def test_an_all_diffuse_box_is_mitsuba_s(cornell: Scene, diffuse_truth: Estimate) -> None:
    ours = series_image(cornell, initial(cornell), (64, 1, 1, 1), spp=4096, seed=6)
    result = same(diffuse_truth, ours)
    assert result.relative_sigma < 0.02
    assert result.passed, str(result)


def test_one_energy_off_by_two_per_cent_is_seen(
    cornell: Scene, diffuse_truth: Estimate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One e_j of one wall scaled by 1.02: the test above must have the power to fail."""
    wall = cornell.object("back").material
    assert wall is not None

    def tampered(layer: Layer, state: LayerState) -> Float64:
        return albedo(layer, state) * (1.02 if state is mine else 1.0)

    # A state of its own, so that the other white walls are left alone
    mine = replace(wall.initial.layers["diffuse"])
    state = initial(cornell)
    state["back"] = replace(wall.initial, layers={**wall.initial.layers, "diffuse": mine})
    monkeypatch.setattr(reflectance_module, "albedo", tampered)
    ours = series_image(cornell, state, (64, 1, 1, 1), spp=4096, seed=6)
    result = same(diffuse_truth, ours)
    assert not result.passed, str(result)


@pytest.mark.verify
def test_the_verdict_is_right_time_after_time(cornell: Scene) -> None:
    """Sixteen independent pairs of the equal pictures above: at significance 0.01 two or
    more failures would be seen once in a hundred times."""
    truth, state = PathTracedTruth(cornell, bounces=4), initial(cornell)
    verdicts = [
        same(
            truth.estimate(state, spp=4096, seed=100 + k),
            series_image(cornell, state, (64, 1, 1, 1), spp=4096, seed=300 + k),
        )
        for k in range(16)
    ]
    failed = [str(verdict) for verdict in verdicts if not verdict.passed]
    assert len(failed) <= 1, failed


def test_variance_falls_with_the_samples(cornell: Scene) -> None:
    few, many = (
        series_image(cornell, initial(cornell), (64, 1), spp=spp, seed=1) for spp in (64, 1024)
    )
    assert few.variance.mean() / many.variance.mean() == pytest.approx(16, rel=0.25)


@pytest.mark.parametrize(
    ("floor", "wall"),
    [(blinn(RED, GREY, 30.0), None), (None, blinn(RED, GREY, 30.0))],
    ids=["floor", "wall"],
)
def test_one_flat_glossy_object_is_met_once_with_all_bins(
    floor: Material | None, wall: Material | None
) -> None:
    """With as many coarse bins as fine ones both classes of first encounter are the same
    BRDF, and Mitsuba's path tracer can have it too."""
    scene = corner(floor, wall)
    theirs = mitsuba_path(scene, forms(scene, FineReflectance), 2, 2048)
    ours = series_image(scene, initial(scene), (64, 1), spp=2048, indirect_bins=64)
    assert same(theirs, ours).passed, str(same(theirs, ours))


def test_after_a_rough_vertex_the_first_encounter_has_coarse_bins() -> None:
    scene = corner(None, blinn((0.0, 0.0, 0.0), (0.9, 0.9, 0.9), 400.0))
    full, coarse = (
        series_image(scene, initial(scene), (64, 1), spp=2048, indirect_bins=n) for n in (64, 2)
    )
    # The wall itself, seen directly, is the same; what it throws on the floor is blurred
    upper, lower = np.s_[:8], np.s_[16:]
    for rows, equal in ((upper, True), (lower, False)):
        result = ztest(
            full.reflected[rows], full.variance[rows], coarse.reflected[rows], coarse.variance[rows]
        )
        assert result.passed == equal, str(result)


def test_the_second_encounter_has_the_bins_that_the_series_gives_it() -> None:
    """(64, 64) over two bounces is the full projected BRDF everywhere; (64, 1) is not."""
    scene = corner(blinn(GREY, GREY, 30.0), blinn(RED, GREY, 30.0))
    theirs = mitsuba_path(scene, forms(scene, FineReflectance), 2, 2048)
    full = series_image(scene, initial(scene), (64, 64), spp=2048)
    assert same(theirs, full).passed, str(same(theirs, full))
    matte = series_image(scene, initial(scene), (64, 1), spp=2048)
    assert not same(theirs, matte).passed


def test_later_encounters_count_by_albedo() -> None:
    """With every layer matte, one bin is everything and any series is the true picture."""
    scene = corner(lambert(GREY), lambert(RED))
    theirs = mitsuba_path(scene, forms(scene, MatteReflectance), 4, 1024)
    ours = series_image(scene, initial(scene), (16, 8, 1, 1), spp=1024)
    assert same(theirs, ours).passed, str(same(theirs, ours))


def test_direct_plus_diffuse_indirect_is_the_sum_that_its_name_says() -> None:
    """2008, figure 7a: K(R_J) G E + K(R_1) G Σ (…): direct light of the glossy scene, and of
    the matte scene everything but the direct light."""
    scene = corner(blinn(GREY, GREY, 30.0), blinn(RED, GREY, 30.0))
    spp = 2048
    glossy = mitsuba_path(scene, forms(scene, FineReflectance), 1, spp)
    all_matte, direct_matte = (
        mitsuba_path(scene, forms(scene, MatteReflectance), bounces, spp) for bounces in (3, 1)
    )
    ours = series_image(
        scene, initial(scene), (64, 1, 1), spp=spp, direct_plus_diffuse_indirect=True
    )
    expected = glossy.reflected + all_matte.reflected - direct_matte.reflected
    # The last two share their random numbers; the sum of all variances is an upper bound
    # only if they are not negatively correlated, so they are given twice
    variance = glossy.variance + 2 * (all_matte.variance + direct_matte.variance)
    result = ztest(expected, variance, ours.reflected, ours.variance)
    assert result.passed, str(result)
    series = series_image(scene, initial(scene), (64, 1, 1), spp=spp)
    assert not same(series, ours).passed


def test_a_mirror_shows_the_edit_with_all_bins() -> None:
    """The picture in a perfect mirror is that of the mirrored camera, turned left to right."""
    item = blinn(RED, GREY, 400.0)
    T = mi.ScalarTransform4f()
    # The plane x = 2, facing the floor; big enough to fill the picture that looks into it
    mirror = {
        "type": "rectangle",
        "to_world": T.translate([2, 0, 0]) @ T.rotate([0, 1, 0], -90) @ T.scale(20),
        "bsdf": {"type": "conductor", "material": "none"},
    }
    shared = {
        "floor": plane(size=1.5),
        "lamp": plane(z=3.0, size=0.4, down=True, emitter={"type": "area", "radiance": 8.0}),
    }
    # x → 4 − x takes one camera to the other
    straight = world(
        {**shared, "view": camera((5, -1, 2.5), (0, 0, 0), fov=20)},
        {"floor": item},
        resolution=(24, 24),
    )
    reflected = world(
        {**shared, "mirror": mirror, "view": camera((-1, -1, 2.5), (4, 0, 0), fov=20)},
        {"floor": item},
        resolution=(24, 24),
    )
    direct = series_image(straight, initial(straight), (64,), spp=1024, seed=1)
    shown = series_image(reflected, initial(reflected), (64, 1), spp=1024, seed=2)
    result = ztest(direct.image, direct.variance, shown.image[:, ::-1], shown.variance[:, ::-1])
    assert direct.reflected.max() > 3 * direct.reflected.mean()
    assert result.passed, str(result)


def test_bad_requests_are_refused(cornell: Scene) -> None:
    with pytest.raises(InvalidValue, match="series"):
        series_image(cornell, initial(cornell), ())
    with pytest.raises(KeyError, match="no-such"):
        series_image(cornell, {"no-such": initial(cornell)["back"]}, (1,))
