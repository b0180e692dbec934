"""Maps from a scene's textures to pictures of a bundle, against the path tracer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

import burnish
from burnish.app.assignments import parse_map
from burnish.app.cli import cli
from burnish.core.errors import InvalidValue, MissingFile, UnknownName
from burnish.core.types import Float32
from burnish.scene import Scene
from burnish.session import Session

NUMBERS = {"specular.roughness": 0.5, "specular.metallic": 0.5}


def described(folder: Path) -> dict[str, Any]:
    """A wall whose roughness, metallic and colour are textures, under a lamp; a plain sphere."""
    import mitsuba as mi

    rng = np.random.default_rng(2)
    for name, shape in (("rough", (4, 4)), ("metal", (4, 4)), ("colour", (4, 4, 3))):
        values = rng.integers(64, 224, shape, np.uint8)
        Image.fromarray(values).resize((64, 64), Image.Resampling.BICUBIC).save(
            folder / f"{name}.png"
        )

    def texture(name: str, raw: bool) -> dict[str, Any]:
        return {"type": "bitmap", "filename": str(folder / f"{name}.png"), "raw": raw}

    T = mi.ScalarTransform4f
    return {
        "type": "scene",
        "wall": {
            "type": "rectangle",
            "to_world": T().rotate([1, 0, 0], -35),
            "bsdf": {
                "type": "principled",
                "roughness": texture("rough", True),
                "metallic": texture("metal", True),
                "base_color": texture("colour", False),
            },
        },
        "ball": {
            "type": "sphere",
            "center": [0.5, -0.2, 0.6],
            "radius": 0.25,
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.5, 0.3, 0.2]}},
        },
        "lamp": {
            "type": "rectangle",
            "to_world": T().look_at([0, 3, 2], [0, 0, 0], [0, 0, 1]).scale(0.8),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 6.0}},
        },
        "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 0.3}},
        "camera": {
            "type": "perspective",
            "fov": 40,
            "to_world": T().look_at([0, -0.4, 3.2], [0, 0, 0], [0, 1, 0]),
            "film": {
                "type": "hdrfilm", "width": 24, "height": 18, "rfilter": {"type": "box"},
            },
        },
    }  # fmt: skip


class World:
    def __init__(self, folder: Path) -> None:
        self.scene: Scene = burnish.load(described(folder))
        self.bundle = burnish.bake(
            self.scene, folder / "wall.burnish", series=(64, 1), spp=2048, seed=3
        )
        self.folder = folder

    def session(self) -> Session:
        return burnish.edit(self.bundle)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    from burnish.scene.device import activate

    activate()
    return World(tmp_path_factory.mktemp("maps"))


def stripes(folder: Path) -> Path:
    path = folder / "stripes.png"
    pixels = np.zeros((16, 16, 3), np.uint8)
    pixels[:, :8], pixels[:, 8:] = (220, 60, 40), (40, 90, 200)
    Image.fromarray(pixels).save(path)
    return path


def off(world: World, session: Session) -> float:
    found = burnish.compare_with_truth(session, world.scene, spp=2048, bounces=2)
    return found.numbers["rel_rmse_beyond_noise"]


def test_textured_numbers_are_editable_and_the_picture_is_the_truth(world: World) -> None:
    session = world.session()
    for path, mean in NUMBERS.items():
        assert session.map_of(f"wall.{path}") is not None
        assert abs(float(session.get(f"wall.{path}")) - mean) < 0.15  # type: ignore[arg-type]
    # Masking away from the mean roughness, noise of 2,048 samples, compression
    assert off(world, session) < 0.03


@pytest.mark.parametrize(
    "edit",
    [
        lambda s, f: s.set("wall.specular.roughness", 0.25),
        lambda s, f: s.set_map("wall.specular.roughness", scale=-0.5, offset=0.7),
        lambda s, f: s.set_map("wall.specular.metallic", f / "rough.png", rotate=90.0),
        lambda s, f: s.set_map("wall.diffuse.color", stripes(f), repeat=2.0),
        lambda s, f: s.set_map("wall.diffuse.color", scale=0.5, offset=0.3),
        lambda s, f: s.clear_map("wall.diffuse.color"),
        lambda s, f: s.set_map("ball.diffuse.color", stripes(f)),
    ],
    ids=["mean", "scale", "metal", "picture", "brighter", "flat", "ball"],
)
def test_edited_maps_are_the_truth(world: World, edit: Any) -> None:
    session = world.session()
    before = session.frame()
    edit(session, world.folder)
    assert off(world, session) < 0.04
    # Once more from an edits file, and back
    again = world.session()
    again.load_text(session.edits_text())
    again.select(*session.selected)
    np.testing.assert_array_equal(again.frame(), session.frame())
    assert session.undo()
    np.testing.assert_allclose(session.frame(), before, rtol=1e-5, atol=1e-6)


def test_an_unselected_object_keeps_its_maps_while_another_is_edited(world: World) -> None:
    session, other = world.session(), world.session()
    session.select("wall")
    other.set("ball.diffuse.color", (0.5, 0.3, 0.2))
    other.select("ball")
    np.testing.assert_allclose(other.frame(), session.frame(), rtol=2e-4, atol=1e-5)


def test_resetting_brings_the_scenes_own_map_back(world: World) -> None:
    session = world.session()
    session.select("wall")
    before, own = session.frame(), session.map_of("wall.specular.roughness")
    session.clear_map("wall.specular.roughness")
    assert session.map_of("wall.specular.roughness") is None
    session.reset("wall.specular.roughness")
    assert session.map_of("wall.specular.roughness") == own
    np.testing.assert_array_equal(session.frame(), before)


def test_what_cannot_be_says_why(world: World, tmp_path: Path) -> None:
    session = world.session()
    with pytest.raises(UnknownName, match="rougness"):
        session.set_map("wall.specular.rougness", "a.png")
    with pytest.raises(MissingFile, match=r"nowhere\.png"):
        session.set_map("wall.specular.roughness", tmp_path / "nowhere.png")
    with pytest.raises(InvalidValue, match="no map yet"):
        session.set_map("ball.diffuse.color", scale=2.0)
    with pytest.raises(InvalidValue, match="has no map whose scale"):
        session.set("ball.diffuse.color.scale", 2.0)
    with pytest.raises(InvalidValue, match="scale must lie"):
        session.set_map("wall.specular.roughness", scale=float("nan"))
    with pytest.raises(InvalidValue, match="no channel to choose"):
        session.set_map("wall.specular.roughness", channel="red")
    assert not session.undo()


def test_the_command_line_takes_maps(world: World, tmp_path: Path) -> None:
    picture = stripes(tmp_path)
    target = tmp_path / "out.exr"
    arguments = ["render", str(world.bundle.path), "-o", str(target)]
    arguments += ["--set-map", f"wall.diffuse.color={picture},repeat=2"]
    arguments += ["--set-map", "wall.specular.roughness=,scale=0.5"]
    found = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert found.exit_code == 0, found.output
    session = world.session()
    session.set_map("wall.diffuse.color", picture, repeat=2.0)
    session.set_map("wall.specular.roughness", scale=0.5)
    from burnish.app.pictures import read_picture

    written: Float32 = read_picture(target)
    np.testing.assert_allclose(written, session.frame(), rtol=2e-3, atol=2e-3)


def test_a_files_name_may_hold_commas() -> None:
    assert parse_map("a.b.c=x,y=1.png,scale=2,rotate=30,repeat=4x2") == (
        "a.b.c",
        "x,y=1.png",
        {"scale": 2.0, "rotate": 30.0, "repeat": (4.0, 2.0)},
    )
    assert parse_map("a.b.c=scale=2") == ("a.b.c", None, {"scale": 2.0})
    for text in ("a.b.c", "=x.png", "a.b.c=x.png,scale=big"):
        with pytest.raises(InvalidValue):
            parse_map(text)
