"""Lights put elsewhere: as if the scene had been written so, in its text and in place."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from burnish.core.errors import InvalidValue, MissingFile, SceneError, UnknownName
from burnish.materials.lights import LightGroup, LightState, each, mix, placements, unmixed
from burnish.materials.placement import parameters_from_json, parameters_to_json
from burnish.scene import Scene, load
from burnish.scene.device import activate
from burnish.scene.moving import LightMover
from burnish.scene.placing import least_rotation

activate()
T = mi.ScalarTransform4f
WIDTH = 16
SKY = np.random.default_rng(3).uniform(0.1, 2.0, (8, WIDTH, 3)).astype(np.float32)


def room(**lights: Any) -> Scene:
    """A ball and these lights."""
    return load(
        {
            "type": "scene",
            "camera": {"type": "perspective", "film": {"type": "hdrfilm", "width": 8, "height": 8}},
            "ball": {"type": "sphere", "center": [0, 0, -3], "bsdf": {"type": "diffuse"}},
            **lights,
        }
    )


def looking(origin: Any, target: Any) -> Any:
    return T().look_at(origin, target, [0, 1, 0])


def lamp(at: Any, wide: float = 1.0, **other: Any) -> dict[str, Any]:
    """A square lamp that faces down, with its own emission."""
    to_world = T().translate(at).rotate([1, 0, 0], 90).scale(wide)
    return {
        "type": "rectangle",
        "to_world": to_world,
        "emitter": {"type": "area", "radiance": 2.0},
        **other,
    }


MOVES: dict[str, tuple[Any, Any, dict[str, Any]]] = {
    "point": (
        {"type": "point", "position": [0, 1, 0]},
        {"type": "point", "position": [1, 2, 3]},
        {"position": (1.0, 2.0, 3.0)},
    ),
    "spot": (
        {"type": "spot", "to_world": looking([0, 2, 0], [0, 2, -1])},
        {
            "type": "spot",
            "to_world": looking([1, 2, 1], [1, 1.5, 0]),
            "cutoff_angle": 50.0,
            "beam_width": 50.0,
        },
        {
            "position": (1.0, 2.0, 1.0),
            "direction": (0.0, -0.5, -1.0),
            "cutoff_angle": 50.0,
            "beam_width": 60.0,
        },
    ),
    "directional": (
        {"type": "directional", "direction": [0, -1, 0]},
        {"type": "directional", "direction": [1, -2, -1]},
        {"direction": (1.0, -2.0, -1.0)},
    ),
    "turned by a matrix": (
        {"type": "directional", "to_world": looking([0, 0, 0], [0, 0, 1])},
        {"type": "directional", "direction": [0, 0, -1]},
        {"direction": (0.0, 0.0, -1.0)},
    ),
    "rectangle": (lamp([0, 3, 0]), lamp([1, 4, -2], 0.5), {"position": (1, 4, -2), "size": 0.5}),
    "ball": (
        {"type": "sphere", "emitter": {"type": "area"}},
        {"type": "sphere", "center": [2, 0, 0], "radius": 0.25, "emitter": {"type": "area"}},
        {"position": (2.0, 0.0, 0.0), "size": 0.25},
    ),
    "mesh": (
        {"type": "cube", "to_world": T().translate([0, 3, 0]), "emitter": {"type": "area"}},
        {
            "type": "cube",
            "to_world": T().translate([-1, 2, 0]).scale(2.0),
            "emitter": {"type": "area"},
        },
        {"position": (-1.0, 2.0, 0.0), "size": 2.0},
    ),
    "environment": (
        {"type": "envmap", "bitmap": mi.Bitmap(SKY), "to_world": T().rotate([1, 0, 0], 90)},
        {
            "type": "envmap",
            # Against the columns' order: the picture's own turns clockwise, seen from above
            "bitmap": mi.Bitmap(np.roll(SKY, -4, axis=1)),
            "to_world": T().rotate([1, 0, 0], 90),
        },
        {"rotation": 90.0},
    ),
    "daylight": (
        {"type": "sunsky", "sun_direction": [0.6, 0, 0.8]},
        {"type": "sunsky", "sun_direction": [0, 0.6, 0.8]},
        {"rotation": 90.0},
    ),
}


def seen(built: Any) -> np.ndarray:
    """What the only light sends to points all about, and from where."""
    rng = np.random.default_rng(7)
    si = dr.zeros(mi.SurfaceInteraction3f, 256)
    si.p = mi.Point3f(rng.normal(0.0, 2.0, (3, 256)))
    si.wi = dr.normalize(mi.Vector3f(rng.normal(size=(3, 256))))
    (emitter,) = built.emitters()
    if emitter.is_environment():
        return np.array(emitter.eval(si))
    ds, weight = emitter.sample_direction(si, mi.Point2f(rng.random((2, 256))))
    return np.concatenate([np.array(ds.d), np.array(weight)])


def validated(scene: Scene, changes: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The placement that a session would ask for."""
    (group,) = each(scene.lights)
    state = group.initial
    for name, value in changes.items():
        state = state.set(name, value, group.key)
    return placements(scene.lights, {group.key: state})


@pytest.mark.parametrize("kind", MOVES)
def test_a_moved_light_is_one_that_was_written_there(kind: str) -> None:
    before, after, changes = MOVES[kind]
    scene, expected = room(light=before), seen(room(light=after).mi_scene)
    own, placed = seen(scene.mi_scene), validated(scene, changes)
    assert abs(own - expected).max() > 0.1
    tolerance = {"rtol": 2e-4, "atol": 2e-5}
    written = seen(scene.with_lights({}, placed=placed).build())
    np.testing.assert_allclose(written, expected, **tolerance)

    mover = LightMover(scene)
    assert mover.place(placed)
    assert not mover.place(placed)
    np.testing.assert_allclose(seen(scene.mi_scene), expected, **tolerance)
    assert mover.place({})
    np.testing.assert_allclose(seen(scene.mi_scene), own, **tolerance)


QUAD = """v -1 2 -1
v 1 2 -1
v 1 2 1
v -1 2 1
vn 0 -1 0
vn 0.6 -0.8 0
f 1//1 2//2 3//2
f 1//1 3//2 4//1
"""


def test_a_mesh_turns_with_its_normals(tmp_path: Path) -> None:
    (tmp_path / "quad.obj").write_text(QUAD)
    mesh = {"type": "obj", "filename": str(tmp_path / "quad.obj"), "emitter": {"type": "area"}}
    scene = room(panel=mesh)
    (light,) = scene.lights
    values = {item.name: item.default for item in light.parameters}
    assert values["position"] == (0.0, 2.0, 0.0)
    np.testing.assert_allclose(values["direction"], (0.0, -1.0, 0.0), atol=1e-6)
    placed = validated(scene, {"position": (3.0, 0.0, 0.0), "direction": (-1.0, 0.0, 0.0)})
    built = scene.with_lights({}, placed=placed).build()
    LightMover(scene).place(placed)
    written, moved = mi.traverse(built), mi.traverse(scene.mi_scene)
    for name in ("vertex_positions", "vertex_normals"):
        a, b = (np.ravel(params[f"panel.{name}"]) for params in (written, moved))
        np.testing.assert_allclose(b, a, atol=1e-6)
    np.testing.assert_allclose(np.ravel(moved["panel.vertex_positions"])[::3], 3.0, atol=1e-6)
    np.testing.assert_allclose(seen(scene.mi_scene), seen(built), rtol=2e-4, atol=2e-5)


def test_a_lamp_may_be_named_as_its_material_is(tmp_path: Path) -> None:
    """As in Mitsuba's Cornell box, where Mitsuba itself tells the two apart by a number."""
    (tmp_path / "quad.obj").write_text(QUAD)
    (tmp_path / "scene.xml").write_text(
        """<scene version="3.0.0"><sensor type="perspective"/>
        <bsdf type="diffuse" id="light"/>
        <shape type="obj"><string name="filename" value="quad.obj"/><ref id="light"/>
          <emitter type="area"/></shape></scene>"""
    )
    scene = load(tmp_path / "scene.xml")
    assert [light.name for light in scene.lights] == ["light"]
    placed = validated(scene, {"position": (3.0, 0.0, 0.0), "size": 2.0})
    built = scene.with_lights({}, placed=placed).build()
    LightMover(scene).place(placed)
    np.testing.assert_allclose(seen(scene.mi_scene), seen(built), rtol=2e-4, atol=2e-5)


def test_surroundings_are_replaced_by_a_file(tmp_path: Path) -> None:
    other = np.random.default_rng(4).uniform(0.1, 2.0, (6, 12, 3)).astype(np.float32)
    path = tmp_path / "other.exr"
    mi.Bitmap(other).write(str(path))
    described = {"type": "envmap", "bitmap": mi.Bitmap(SKY), "scale": 0.5}
    scene = room(sky=described)
    own = seen(scene.mi_scene)
    expected = seen(room(sky={**described, "bitmap": mi.Bitmap(other)}).mi_scene)
    placed = validated(scene, {"file": str(path)})
    written = scene.with_lights({"sky": (2.0, 1.0, 1.0)}, placed=placed).build()
    factor = np.array([[2.0], [1.0], [1.0]])
    np.testing.assert_allclose(seen(written), factor * expected, rtol=1e-3)
    mover = LightMover(scene)
    mover.place(placed)
    np.testing.assert_allclose(seen(scene.mi_scene), expected, rtol=1e-5)
    mover.place({})
    np.testing.assert_allclose(seen(scene.mi_scene), own, rtol=1e-5)

    (group,) = each(scene.lights)
    with pytest.raises(MissingFile, match=r"no file 'gone\.exr'"):
        group.initial.set("file", "gone.exr", group.key)
    with pytest.raises(InvalidValue, match="path of a picture"):
        group.initial.set("file", str(tmp_path), group.key)
    (tmp_path / "broken.exr").write_text("nothing")
    with pytest.raises(SceneError, match="cannot be read as an environment map"):
        mover.place({"sky": {"file": str(tmp_path / "broken.exr")}})
    np.testing.assert_allclose(seen(scene.mi_scene), own, rtol=1e-5)


def test_the_least_rotation() -> None:
    rng = np.random.default_rng(0)
    pairs = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(20, 2, 3))]
    pairs += [np.array([v, s * v]) for v in np.eye(3) for s in (1.0, -1.0)]
    for a, b in pairs:
        rotation = least_rotation(a, b)
        np.testing.assert_allclose(rotation @ a, b, atol=1e-12)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        # By the angle between them and no more
        assert np.trace(rotation) == pytest.approx(1 + 2 * a @ b, abs=1e-12)


def test_what_a_light_has_is_data() -> None:
    """Names, limits, the scene's values; written and read; wrong values say what is right."""
    scene = room(light=MOVES["spot"][0], sky={"type": "constant"}, lamp=lamp([0, 3, 0]))
    torch, sky, panel = (
        next(light for light in scene.lights if light.name == name)
        for name in ("light", "sky", "lamp")
    )
    values = {item.name: item.default for item in torch.parameters}
    assert values["position"] == (0.0, 2.0, 0.0)
    np.testing.assert_allclose(values["direction"], (0.0, 0.0, -1.0), atol=1e-6)
    assert (values["cutoff_angle"], values["beam_width"]) == (20.0, 15.0)
    assert [item.name for item in sky.parameters] == ["exposure"]
    assert [item.name for item in panel.parameters] == ["position", "direction", "size"]
    for light in scene.lights:
        assert parameters_from_json(parameters_to_json(light.parameters)) == light.parameters
    state = each([torch])[0].initial
    assert state.set("direction", (0, 0, -5), "light:light").get("direction") == (0.0, 0.0, -1.0)
    for name, wrong, words in (
        ("position", (1, 2), r"light:light\.position must be three numbers \(x, y, z\)"),
        ("position", (1, 2, np.nan), "must lie in"),
        ("direction", (0, 0, 0), "not all zero"),
        ("cutoff_angle", 200.0, r"must lie in \[0.01, 180\]"),
    ):
        with pytest.raises(InvalidValue, match=words):
            state.set(name, wrong, "light:light")
    with pytest.raises(UnknownName):
        scene.with_lights({}, placed={"lmap": {"position": (0.0, 0.0, 0.0)}})


def test_exposure_scales_and_a_place_does_not() -> None:
    sky = LightGroup("sky", ("sky",), room(sky={"type": "constant"}).lights[0].parameters)
    bright = sky.initial.set("exposure", 2.0, sky.key).set("intensity", 0.5, sky.key)
    np.testing.assert_allclose(mix([sky], {sky.key: bright}), 2.0)
    assert placements([], {sky.key: bright}) == {}
    assert unmixed([sky], {sky.key: bright}) == {}

    torch = LightGroup("torch", ("torch",), room(torch=MOVES["spot"][0]).lights[0].parameters)
    moved = torch.initial.set("position", (1, 2, 3), torch.key).set("intensity", 3.0, torch.key)
    state = {sky.key: bright, torch.key: moved}
    lights = room(torch=MOVES["spot"][0]).lights
    assert placements(lights, state) == {"torch": {"position": (1.0, 2.0, 3.0)}}
    left = unmixed([sky, torch], state)
    assert left.keys() == {torch.key}
    assert isinstance(left[torch.key], LightState)
    np.testing.assert_allclose(mix([sky, torch], left), 1.0)
