"""Whatever a user gets wrong ends as one line that says what to do, and leaves no trace."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.app.conftest import Runner, contents
from tests.app.scenes import BALL, BROKEN_MESH, CAMERA, GLASS, LIGHT, MESH, scene


@pytest.fixture
def here(tmp_path: Path, bundle: Path) -> Path:
    """A folder with the small bundle in it."""
    shutil.copytree(bundle, tmp_path / "box.burnish")
    return tmp_path


def refused(burnish: Runner, here: Path, *arguments: object, **limits: int) -> str:
    """The complaint about a command, which changed nothing on the disk."""
    before = contents(here)
    complaint = burnish(*arguments, cwd=here, **limits).complaint
    assert contents(here) == before
    return complaint


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (scene(CAMERA, LIGHT, "<shape").replace("</scene>", ""), ["scene.xml"]),
        (scene(CAMERA, LIGHT, '<shape type="spheer"/>'), ["spheer"]),
        (scene(CAMERA, BALL), ["no light", "<emitter>"]),
        (scene(LIGHT, BALL), ["no camera", "<sensor>"]),
        (scene(CAMERA, LIGHT), ["no shapes", "<shape>"]),
        (scene(CAMERA, LIGHT, GLASS), ["no object can be edited", "ball", "diffuse"]),
        (scene(CAMERA, LIGHT, MESH), ["mesh", "NaN", "repair"]),
    ],
    ids=["malformed", "plugin", "no light", "no camera", "empty", "not editable", "nan"],
)
def test_scene(burnish: Runner, tmp_path: Path, text: str, words: list[str]) -> None:
    (tmp_path / "scene.xml").write_text(text)
    (tmp_path / "broken.obj").write_text(BROKEN_MESH)
    complaint = refused(burnish, tmp_path, "bake", "scene.xml", "-o", "out.burnish")
    assert all(word in complaint for word in words), complaint


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("bake nowhere.xml -o out.burnish", ["nowhere.xml"]),
        ("bake cornel-box -o out.burnish", ["cornel-box", "'cornell-box'"]),
        ("bake cornell-box -o nowhere/out.burnish", ["nowhere", "does not exist", "mkdir"]),
        ("bake cornell-box", ["--output", "--help"]),
        ("bake cornell-box -o out.burnish --resume", ["out.burnish", "without --resume"]),
        ("bake cornell-box -o out.burnish --editable flor", ["flor", "'floor'"]),
        ("bake cornell-box -o out.burnish --editable light", ["light", "cannot be edited"]),
        ("bake cornell-box -o out.burnish --series 64,128", ["series", "64"]),
        ("bake cornell-box -o out.burnish --series many", ["--series", "'many'", "64,1,1,1"]),
        ("bake cornell-box -o out.burnish --bins flor=8", ["flor", "'floor'"]),
        ("bake cornell-box -o out.burnish --bins floor", ["--bins", "'floor'", "OBJECT=NUMBER"]),
        ("bake cornell-box -o out.burnish --bins floor=9999", ["bins", "4096"]),
        ("bake cornell-box -o out.burnish --spp 0", ["--spp", "0", ">=1"]),
        ("bake cornell-box -o out.burnish --spp 4 --minutes 1", ["--spp", "--minutes"]),
        ("bake cornell-box -o out.burnish --series 8,1 --bounces 3", ["--series", "--bounces"]),
        ("bake cornell-box -o out.burnish --resolution 64", ["--resolution", "640x360"]),
        ("bake ring -o out.burnish --light-groups lmap", ["lmap", "'lamp'"]),
        ("bakee cornell-box", ["bakee", "'bake'"]),
    ],
)
def test_bake(burnish: Runner, tmp_path: Path, command: str, words: list[str]) -> None:
    complaint = refused(burnish, tmp_path, *command.split())
    assert all(word in complaint for word in words), complaint


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("--set flor.diffuse.color=0.5", ["flor.diffuse.color", "'floor.diffuse.color'"]),
        ("--set floor.difuse.color=0.5", ["floor.difuse.color", "'floor.diffuse.color'"]),
        ("--set floor.diffuse.colour=0.5", ["floor.diffuse.colour", "'floor.diffuse.color'"]),
        ("--set floor.diffuse.color=1.5", ["floor.diffuse.color", "[0, 1]", "1.5"]),
        ("--set floor.diffuse.color=nan", ["floor.diffuse.color", "nan"]),
        ("--set floor.diffuse.color=red", ["floor.diffuse.color", "three numbers", "'red'"]),
        ("--set floor.diffuse.color=1,2", ["three numbers", "'1,2'"]),
        ("--set floor.diffuse.color=#12", ["#rrggbb", "'#12'"]),
        ("--set floor.diffuse.color", ["--set", "OBJECT.LAYER.PARAMETER=VALUE"]),
        ("--set floor.specular.weight=-1", ["weight", "[0, 100]"]),
        ("--set light:lihgt.on=off", ["light:lihgt.on", "'light:light.on'"]),
        ("--set light:light.intensity=-1", ["light:light.intensity", "[0, 1e+06]", "-1"]),
        ("--edits nowhere.json", ["nowhere.json"]),
        ("--view nowhere", ["nowhere", "'view'"]),
        ("--tonemap aces2", ["aces2", "'aces'"]),
        ("--exposure 99", ["exposure", "[-20, 20]", "99"]),
        ("-o nowhere/out.png", ["nowhere", "does not exist", "mkdir"]),
        ("-o out.jpg", [".exr or .png", "out.jpg"]),
    ],
)
def test_render(burnish: Runner, here: Path, command: str, words: list[str]) -> None:
    complaint = refused(burnish, here, "render", "box.burnish", "-o", "out.png", *command.split())
    assert all(word in complaint for word in words), complaint


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("edit cornell-box --mode baked", ["--mode baked", "burnish bake cornell-box"]),
        ("compare ring --mode relight --triangles 400", ["--triangles", "--mode direct"]),
        ("compare box.burnish --mode relight", ["--mode", "bundle"]),
    ],
)
def test_modes(burnish: Runner, tmp_path: Path, command: str, words: list[str]) -> None:
    complaint = refused(burnish, tmp_path, *command.split())
    assert all(word in complaint for word in words), complaint


def test_more_light_groups_than_a_bake_tells_apart(burnish: Runner, tmp_path: Path) -> None:
    lamps = [f'<emitter type="point" id="lamp-{i}"/>' for i in range(4)]
    (tmp_path / "scene.xml").write_text(scene(CAMERA, LIGHT, BALL, *lamps))
    complaint = refused(
        burnish, tmp_path, "bake", "scene.xml", "-o", "out.burnish", "--light-groups", "each"
    )
    assert "at most 4 light groups" in complaint
    assert "got 5" in complaint
    assert "key=" in complaint


def test_a_scene_is_edited_by_the_same_rules(burnish: Runner, tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(scene(CAMERA, LIGHT, BALL))
    complaint = refused(
        burnish, tmp_path, "render", "scene.xml", "-o", "out.png", "--set", "bal.diffuse.color=1"
    )
    assert "'ball.diffuse." in complaint


def test_missing_bundle(burnish: Runner, tmp_path: Path) -> None:
    assert "nowhere.burnish" in refused(burnish, tmp_path, "info", "nowhere.burnish")


def test_foreign_bundle(burnish: Runner, here: Path) -> None:
    (here / "other.burnish").mkdir()
    (here / "other.burnish" / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group"}')
    assert "not a burnish bundle" in refused(burnish, here, "info", "other.burnish")
    (here / "file.burnish").write_bytes(b"\x89PNG")
    assert "file.burnish" in refused(burnish, here, "info", "file.burnish")


def test_bundle_of_a_newer_format(burnish: Runner, here: Path) -> None:
    path = here / "box.burnish" / "zarr.json"
    data = json.loads(path.read_text())
    data["attributes"]["burnish"]["format_version"] = 99
    path.write_text(json.dumps(data))
    assert "newer burnish" in refused(burnish, here, "render", "box.burnish", "-o", "out.png")


def test_truncated_header(burnish: Runner, here: Path) -> None:
    path = here / "box.burnish" / "zarr.json"
    path.write_bytes(path.read_bytes()[:200])
    assert "box.burnish" in refused(burnish, here, "render", "box.burnish", "-o", "out.png")


def test_missing_tile(burnish: Runner, here: Path) -> None:
    shutil.rmtree(here / "box.burnish" / "views" / "view" / "0")
    assert "cut short" in refused(burnish, here, "render", "box.burnish", "-o", "out.png")


def test_truncated_data(burnish: Runner, here: Path) -> None:
    tile = here / "box.burnish" / "views" / "view" / "0"
    largest = max((p for p in tile.rglob("*") if p.is_file()), key=lambda p: p.stat().st_size)
    largest.write_bytes(largest.read_bytes()[: largest.stat().st_size // 2])
    assert "view" in refused(burnish, here, "render", "box.burnish", "-o", "out.png")


@pytest.mark.parametrize("name", ["out.exr", "out.png"])
def test_full_disk_leaves_no_half_written_picture(burnish: Runner, here: Path, name: str) -> None:
    complaint = refused(burnish, here, "render", "box.burnish", "-o", name, largest_file=600)
    assert "cannot write" in complaint
    assert name in complaint


def test_full_disk_leaves_the_old_picture(burnish: Runner, here: Path) -> None:
    (here / "out.png").write_bytes(b"old")
    refused(burnish, here, "render", "box.burnish", "-o", "out.png", largest_file=600)
    assert (here / "out.png").read_bytes() == b"old"


def test_full_disk_while_baking(burnish: Runner, tmp_path: Path) -> None:
    outcome = burnish(
        "bake", "cornell-box", "-o", "out.burnish", "--resolution", "24x24",
        "--series", "64,1,1", "--spp", "16", cwd=tmp_path, largest_file=20_000,
    )  # fmt: skip
    assert outcome.code == 2
    assert outcome.err.splitlines()[-1].startswith("burnish: ")
    assert "Traceback" not in outcome.err
    # What stands under the bundle's name is a whole bundle or nothing
    assert not (tmp_path / "out.burnish").exists()
