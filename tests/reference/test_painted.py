"""Painted materials path-traced: as two meshes with two materials, and as a session shows them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import burnish
from burnish.core.errors import InvalidValue
from burnish.materials.painting.stroke import Dab, Edit, Stroke
from burnish.reference.truth import PathTracedTruth
from tests.reference.worlds import blinn, camera, initial, plane, world

SIDE = 24
START = blinn((0.3, 0.2, 0.1), (0.3, 0.3, 0.3), 20.0)


def lamp(x: float, y: float, z: float) -> dict[str, Any]:
    to_world = mi.ScalarTransform4f().look_at([x, y, z], [0, 0, 0], [0, 0, 1])
    return {
        "type": "rectangle",
        "to_world": to_world @ mi.ScalarTransform4f().scale(0.5),
        "emitter": {"type": "area", "radiance": 8.0},
    }


BEHIND = lamp(0.4, 1.6, 1.6)
BESIDE = lamp(-1.2, -1.6, 2.4)
VIEW = camera((0.0, -2.4, 2.0), (0, 0, 0), fov=34.0)
EDITS = (
    Edit("set", "diffuse", "color", (0.1, 0.6, 0.3)),
    Edit("add", "specular", "exponent", (0.3,), base=float(np.log(20) / np.log(5000))),
)


def right_half(falloff: float = 0.0) -> Stroke:
    """Paint on the floor where x > 0, by dabs so large that their edge is straight."""
    return Stroke("b", EDITS, (Dab((500.0, 0.0, 0.0), (0, 0, 1), 500.0),), 1.0, falloff)


def test_a_painted_step_is_two_meshes_with_two_materials() -> None:
    one = world({"floor": plane(), "lamp": BEHIND, "view": VIEW}, {"floor": START}, (SIDE, SIDE))
    painted = {"floor": replace(START.initial, strokes=(right_half(),))}
    sharp = blinn((0.1, 0.6, 0.3), (0.3, 0.3, 0.3), 20.0 * 5000**0.3)
    move = mi.ScalarTransform4f().translate
    half = mi.ScalarTransform4f().scale([0.5, 1, 1])
    two = world(
        {
            "left": {**plane(), "to_world": move([-0.5, 0, 0]) @ half},
            "right": {**plane(), "to_world": move([0.5, 0, 0]) @ half},
            "lamp": BEHIND,
            "view": VIEW,
        },
        {"left": START, "right": sharp},
        (SIDE, SIDE),
    )
    a, b = (
        PathTracedTruth(scene, 1).estimate(state, spp=512, seed=seed)
        for scene, state, seed in ((one, painted, 1), (two, initial(two), 2))
    )
    # One texel is a sixtieth of a pixel here; the two columns at the step may differ by that
    away = np.abs(np.arange(SIDE) - (SIDE - 1) / 2) > 1
    assert np.abs(a.image[:, 14:].mean() / a.image[:, :10].mean() - 1) > 0.2
    sigma = np.sqrt(a.variance + b.variance)
    lit = (sigma > 0) & away[:, None]
    assert lit.mean() > 0.5
    z = (np.abs(a.image - b.image) / np.where(lit, sigma, 1))[lit]
    assert (z > 5).sum() == 0
    assert np.abs(z.mean() - np.sqrt(2 / np.pi)) < 0.1


def test_a_session_shows_what_the_path_tracer_does(tmp_path: Path) -> None:
    ball = {"type": "sphere", "center": [0, 0, 0.5], "radius": 0.5}
    scene = world(
        {"ball": ball, "floor": plane(size=3.0), "lamp": BESIDE, "view": VIEW},
        {"ball": START, "floor": START},
        (SIDE, SIDE),
    )
    bundle = burnish.bake(scene, tmp_path / "one.burnish", series=(64,), spp=1024)
    truth = PathTracedTruth(scene, 1)

    def distance(paint: bool, ends: tuple[float, float]) -> float:
        session = burnish.edit(bundle)
        session.set("ball.specular.exponent", ends[0])
        if paint:
            target = float(np.log(ends[1] / ends[0]) / np.log(5000))
            brush = "sharpen" if target > 0 else "blur"
            session.paint(brush, [(9, 8), (15, 14)], size=7, amount=abs(target))
            session.paint("diffuse-color", [(15, 8)], size=5, color=(0.6, 0.05, 0.05))
        shown = session.frame()
        found = truth.estimate(session.materials, spp=1024, seed=3)
        on_ball = session.object_map() == [o.id for o in session.objects].index("ball")
        off, light = (shown - found.image)[on_ball], found.image[on_ball]
        if paint:
            plain = replace(session.state["ball"], strokes=())
            other = truth.estimate({**session.state, "ball": plain}, spp=64, seed=4).image
            assert np.linalg.norm((other - shown)[on_ball]) > 10 * np.linalg.norm(off)
        return float(np.linalg.norm(off) / np.linalg.norm(light))

    # As near as the two uniform materials that it lies between: noise and bins are the same
    uniform = max(distance(False, (20.0, 0)), distance(False, (200.0, 0)))
    assert distance(True, (20.0, 200.0)) < 1.3 * uniform


def test_what_has_no_formula_per_point_says_so() -> None:
    scene = world({"floor": plane(), "lamp": BESIDE, "view": VIEW}, {"floor": START}, (4, 4))
    painted = replace(START.initial, strokes=(right_half(),))
    with pytest.raises(InvalidValue, match="floor is painted"):
        burnish.path_trace(scene, {"floor": painted}, series=(64,), spp=4)
    state = replace(painted, conserve=True)
    with pytest.raises(InvalidValue, match="linked layers"):
        PathTracedTruth(scene, 1).render({"floor": state}, scene.views[0].name, 4)
