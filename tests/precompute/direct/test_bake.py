"""Bakes of direct light: known answers, Mitsuba's direct light under every kind of lamp, and
that they go on where they were stopped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import burnish
from burnish.compare import metrics
from burnish.core.errors import InvalidValue
from burnish.core.types import Value
from burnish.precompute.prepass import dilate
from burnish.reference import PathTracedTruth
from burnish.scene import Scene, load
from burnish.store.bundle import Bundle
from tests.precompute.worlds import lamp
from tests.reference.worlds import SKY, blinn, camera, lambert, plane, world

VIEW = camera((1.0, -5.0, 2.0), (0.0, 0.0, 0.7), fov=35)
SPHERE = {"type": "sphere", "center": [0, 0, 0.8], "radius": 0.8}


def frame(bundle: Bundle, **edits: Value) -> np.ndarray:
    session = burnish.edit(bundle)
    for path, value in edits.items():
        session.set(path.replace("__", "."), value)
    return np.asarray(session.frame(), np.float64)


def test_a_matte_ball_in_an_even_sky(tmp_path: Path) -> None:
    """Each point sends back its albedo: ∫ cosθ / π dω = 1.

    A triangle's cosine is taken at a random place in it: over 200 of them at 16 points, with a
    deviation of 0.1 in each, 0.002 of a row's light; three pixels of a thousand are beyond
    three of these, none beyond six.
    """
    description = {"ball": SPHERE, "sky": SKY, "view": VIEW}
    scene = world(description, {"ball": lambert((0.6, 0.3, 1.0))}, resolution=(24, 24))
    bundle = burnish.bake(scene, tmp_path / "ball.burnish", mode="direct", triangles=400, spp=16)
    image = frame(bundle)
    rows = next(iter(bundle.views.values())).rows
    covered = np.zeros(24 * 24, np.bool_)
    covered[rows.pixel] = rows.weight > 0.999
    # The prepass may miss a corner of the sky: not of a pixel with covered neighbours
    inside = ~dilate(~covered.reshape(24, 24, 1)).ravel()
    assert inside.sum() > 20
    found = image.reshape(-1, 3)[inside] / [0.6, 0.3, 1.0]
    np.testing.assert_allclose(found, 1.0, atol=0.012)
    assert found.mean() == pytest.approx(1.0, abs=0.002)


def every_lamp(side: int = 20) -> Scene:
    """A floor and a ball under an environment map, a square lamp, a globe, a point and a spot."""
    sky = np.full((16, 32, 3), 0.2, np.float32)
    sky[4:6, 8:10] = (6.0, 4.0, 3.0)
    turned = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    T = mi.ScalarTransform4f()
    return world(
        {
            "floor": plane(size=2.0),
            "ball": SPHERE,
            "lamp": lamp(radiance=2.0),
            "globe": {
                "type": "sphere",
                "center": [-1.6, -0.6, 1.2],
                "radius": 0.25,
                "emitter": {"type": "area", "radiance": 3.0},
            },
            "point": {"type": "point", "position": [1.5, -1.0, 2.0], "intensity": 1.5},
            "spot": {
                "type": "spot",
                "to_world": T.look_at(origin=[0, -2, 3], target=[0.5, 0.5, 0], up=[0, 1, 0]),
                "intensity": 6.0,
            },
            "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky), "to_world": turned},
            "view": VIEW,
        },
        {
            "floor": lambert((0.5, 0.5, 0.5)),
            "ball": blinn((0.3, 0.2, 0.1), (0.5, 0.5, 0.5), 60.0, bins=128),
        },
        resolution=(side, side),
    )


def test_every_kind_of_lamp(tmp_path: Path) -> None:
    """Edited to another exponent, against Mitsuba's direct light with the true material: within
    3 % of it beyond the truth's noise. A sharper highlight would be two pixels here, as noisy in
    the truth as the limit: those are for larger pictures (`make verify`)."""
    scene = every_lamp()
    bundle = burnish.bake(scene, tmp_path / "lamps.burnish", mode="direct", triangles=400, spp=64)
    session = burnish.edit(bundle)
    session.set("ball.specular.exponent", 20.0)
    truth = PathTracedTruth(scene, bounces=1).estimate(session.state, spp=4096, seed=3)
    halves = tuple(a - b for a, b in zip(truth.halves, truth.emission_halves, strict=True))
    seen = next(iter(session.views.values())).emission
    found = metrics(session.frame() - seen, halves)  # type: ignore[arg-type]
    assert found["noise"] < 0.03
    assert found["rel_rmse_beyond_noise"] < 0.03


def test_light_groups_sum_to_the_whole(tmp_path: Path) -> None:
    """With the same seed the same light falls into more columns; what differs is rounding and
    compression, which keeps each entry to 2 %, and a sum of many to less."""
    scene = every_lamp(12)
    whole, apart = (
        burnish.bake(
            scene,
            tmp_path / f"{len(groups)}.burnish",
            mode="direct",
            triangles=200,
            spp=16,
            light_groups=groups,
        )
        for groups in ((), ("lamp", "point"))
    )
    first, second = frame(whole), frame(apart)
    assert np.abs(first - second).mean() < 0.01 * first.mean()
    # A light that is turned off takes its own light away, and no other
    dark = frame(apart, **{"light:point__on": False, "light:lamp__on": False})
    assert (dark <= second + 0.02 * second.mean()).all()
    assert dark.mean() < 0.9 * second.mean()


def test_a_mirror_shows_the_sky(tmp_path: Path) -> None:
    """A smooth conductor's delta column: in an even sky, its reflectance, also at its edge,
    where 64 samples of ours and 256 of Mitsuba's differ by 0.02 of what they see."""
    bsdf: dict[str, Any] = {"type": "conductor", "material": "Ag"}
    scene = load({"type": "scene", "ball": {**SPHERE, "bsdf": bsdf}, "sky": SKY, "view": VIEW},
                 resolution=(12, 12))  # fmt: skip
    bundle = burnish.bake(scene, tmp_path / "mirror.burnish", mode="direct", triangles=100, spp=64)
    truth = PathTracedTruth(scene, bounces=1).estimate({}, spp=256, seed=2).image
    np.testing.assert_allclose(frame(bundle), truth, atol=0.05)


def test_a_bake_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    """With its own triangles; others are refused."""
    scene = world(
        {"floor": plane(), "sky": SKY, "view": camera((0, -3, 2), (0, 0, 0))},
        {"floor": lambert((0.5, 0.4, 0.3))},
        resolution=(8, 8),
    )
    place = tmp_path / "floor.burnish"

    def stop(fraction: float, what: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        burnish.bake(scene, place, mode="direct", triangles=200, spp=4, progress=stop)
    with pytest.raises(InvalidValue, match="200 triangles"):
        burnish.bake(scene, place, mode="direct", triangles=300, resume=True)
    bundle = burnish.bake(scene, place, resume=True)
    assert bundle.header.provenance["mode"] == "direct"
    assert bundle.header.provenance["triangles"] == 200
    assert bundle.basis.series == (256,)
    assert frame(bundle).mean() > 0.1


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"mode": "direct", "series": (64, 1)}, "one bounce"),
        ({"mode": "direct", "minutes": 1.0}, "minutes"),
        ({"triangles": 400}, "mode 'direct'"),
        ({"mode": "indirect"}, "mode must be"),
    ],
)
def test_options_that_do_not_fit(tmp_path: Path, options: dict[str, Any], rule: str) -> None:
    scene = world(
        {"floor": plane(), "sky": SKY, "view": camera((0, -3, 2), (0, 0, 0))},
        {"floor": lambert((0.5, 0.4, 0.3))},
        resolution=(8, 8),
    )
    with pytest.raises(InvalidValue, match=rule):
        burnish.bake(scene, tmp_path / "x.burnish", **options)


def test_a_scene_is_edited_with_every_option_of_its_bake_and_of_loading() -> None:
    scene = load("cornell-box", resolution=(8, 8))
    session = burnish.edit(
        scene,
        mode="direct",
        triangles=100,
        spp=1,
        seed=3,
        bins={"floor": 32},
        editable=["floor"],
        resolution=(6, 4),
    )
    (view,) = session.views.values()
    assert (view.width, view.height) == (6, 4)
    assert [item.id for item in view.basis.objects] == ["floor"]
    assert {layer.bins for layer in view.basis.objects[0].material.layers} <= {32, 1}
    with pytest.raises(InvalidValue, match="'baked'"):
        burnish.edit(scene, mode="baked")
