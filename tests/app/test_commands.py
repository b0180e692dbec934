"""The commands on a small bundle: what they print and what they write."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import burnish as api
from burnish.app.pictures import read_picture
from tests.app.conftest import Outcome, Runner
from tests.app.scenes import BALL, CAMERA, GLASS, LIGHT, scene


def well_shaped(said: dict[str, object]) -> None:
    """The shape that other programs rely on (DESIGN, section 4)."""
    assert {"objects", "views", "bounces", "series", "resolution"} <= set(said)
    assert isinstance(said["series"], list)
    assert said["bounces"] == len(said["series"])
    assert isinstance(said["resolution"], list)
    assert len(said["resolution"]) == 2
    assert isinstance(said["objects"], list)
    for item in said["objects"]:
        assert {"id", "editable"} <= set(item)
        if not item["editable"]:
            assert item["reason"]
            continue
        for layer in item["layers"]:
            assert {"name", "model", "parameters"} <= set(layer)
            for parameter in layer["parameters"].values():
                assert {"value", "unit"} <= set(parameter)
                if "choices" not in parameter:
                    value = np.asarray(parameter["value"])
                    assert (parameter["min"] <= value).all()
                    assert (value <= parameter["max"]).all()


def test_info_of_a_bundle(burnish: Runner, bundle: Path) -> None:
    outcome = burnish("info", bundle, "--json", cwd=bundle.parent, ray_tracer=False)
    assert outcome.code == 0, outcome.err
    said = json.loads(outcome.out)
    well_shaped(said)
    assert said["resolution"] == [24, 24]
    assert said["series"] == [8, 1, 1]
    assert [item["id"] for item in said["objects"] if item["editable"]] == [
        "floor", "ceiling", "back", "left", "right", "small-box", "large-box",
    ]  # fmt: skip


def test_info_of_a_scene_says_why_an_object_is_fixed(burnish: Runner, tmp_path: Path) -> None:
    glass = GLASS.replace('"ball"', '"glass"')
    (tmp_path / "scene.xml").write_text(scene(CAMERA, LIGHT, BALL, glass))
    outcome = burnish("info", "scene.xml", "--json", cwd=tmp_path)
    assert outcome.code == 0, outcome.err
    said = json.loads(outcome.out)
    well_shaped(said)
    assert [(item["id"], item["editable"]) for item in said["objects"]] == [
        ("ball", True),
        ("glass", False),
    ]
    plain = burnish("info", "scene.xml", cwd=tmp_path).out
    assert "glass: fixed, " in plain
    assert "in [0, 1]" in plain


def test_a_bundle_is_edited_without_a_ray_tracer(burnish: Runner, bundle: Path) -> None:
    """Every edit, the picture and the edits file, where Mitsuba cannot be imported."""
    cwd = bundle.parent
    for name, settings in (("plain.exr", []), ("red.exr", ["--set", "back.diffuse.color=#c83c28"])):
        outcome = burnish("render", bundle, "-o", name, *settings, cwd=cwd, ray_tracer=False)
        assert outcome.code == 0, outcome.err
        assert outcome.out.strip() == name
    plain, red = read_picture(cwd / "plain.exr"), read_picture(cwd / "red.exr")
    assert plain.shape == red.shape == (24, 24, 3)
    assert np.isfinite(red).all()
    # A redder wall lends less green and blue to the whole room
    assert (red.sum(axis=(0, 1)) < plain.sum(axis=(0, 1))).all()
    assert red[..., 1:].sum() < 0.95 * plain[..., 1:].sum()
    session = api.edit(bundle)
    session.set("back.diffuse.color", "#c83c28")
    session.select()
    np.testing.assert_allclose(red, session.frame(), rtol=1e-4, atol=1e-6)


def test_a_scene_needs_a_ray_tracer(burnish: Runner, tmp_path: Path) -> None:
    complaint = burnish("info", "cornell-box", cwd=tmp_path, ray_tracer=False).complaint
    assert "pip install mitsuba" in complaint


def test_png_and_exr_show_the_same_picture(burnish: Runner, bundle: Path) -> None:
    for name in ("same.png", "same.exr"):
        assert burnish("render", bundle, "-o", name, cwd=bundle.parent).code == 0
    shown = read_picture(bundle.parent / "same.png")
    light = np.clip(read_picture(bundle.parent / "same.exr"), 0, 1)
    # Half a step of 8 bits is at most 0.5 / 255 / (d sRGB / d linear ≥ 0.44) in linear light
    assert np.abs(shown - light).max() <= 0.5 / 255 / 0.44 + 1e-6


def test_edits_of_a_file_come_before_those_of_the_line(burnish: Runner, bundle: Path) -> None:
    cwd = bundle.parent
    session = api.edit(bundle)
    session.set("floor.diffuse.color", 0.1)
    session.set("left.diffuse.color", 0.9)
    session.save(cwd / "edits.json")
    session.set("left.diffuse.color", 0.2)
    session.select()
    outcome = burnish(
        "render", bundle, "-o", "both.exr", "--edits", "edits.json", "--set",
        "left.diffuse.color=0.2", cwd=cwd, ray_tracer=False,
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    np.testing.assert_allclose(
        read_picture(cwd / "both.exr"), session.frame(), rtol=1e-4, atol=1e-6
    )


FIGURES = {
    "rmse", "rel_rmse", "rel_rmse_beyond_noise", "noise", "psnr", "flip", "seconds_edit",
    "seconds_reference", "mean_image", "mean_reference",
}  # fmt: skip


def test_compare(burnish: Runner, bundle: Path) -> None:
    outcome = burnish(
        "compare", bundle, "--set", "back.diffuse.color=0.5,0.1,0.1", "--spp", "16",
        "-o", "sheet.png", "--json", cwd=bundle.parent,
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    said = json.loads(outcome.out)
    assert set(said) >= FIGURES
    assert all(np.isfinite(value) for value in said.values())
    assert said["mean_image"] == pytest.approx(said["mean_reference"], rel=0.1)
    assert (bundle.parent / "sheet.png").stat().st_size > 10_000


def test_moved_lights_from_the_command_line(burnish: Runner, bundle: Path, tmp_path: Path) -> None:
    """Listed, rendered, held against the truth by a live estimate, refused of a bundle."""
    camera = (
        '<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="12"/>'
        '<integer name="height" value="12"/></film><transform name="to_world">'
        '<lookat origin="0, -4, 0" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>'
    )
    light = '<emitter type="point" id="torch"><point name="position" x="0" y="9" z="0"/></emitter>'
    (tmp_path / "scene.xml").write_text(scene(camera, light, BALL))
    info = json.loads(burnish("info", "scene.xml", "--json", cwd=tmp_path).out)
    assert info["lights"][0]["parameters"]["position"]["value"] == [0.0, 9.0, 0.0]

    # From behind the ball, where it shows nothing, to before it
    moved = "--set", "light:torch.position=0,-9,3", "--set", "ball.diffuse.color=0.8"
    found = burnish("compare", "scene.xml", *moved, "--spp", "64", "--json", cwd=tmp_path)
    assert found.code == 0, found.err
    said = json.loads(found.out)
    assert said["mean_reference"] > 1e-4
    assert said["mean_image"] == pytest.approx(said["mean_reference"], rel=0.1)

    refused = burnish(
        "render", bundle, "-o", "out.png", "--set", "light:light.size=2", cwd=tmp_path
    )
    assert "light:light.size cannot change here: a bake holds" in refused.complaint


def test_compare_says_when_the_scene_has_changed(burnish: Runner, tmp_path: Path) -> None:
    film = CAMERA.replace("<film", '<film type="hdrfilm"><integer name="width" value="8"/>'
                          '<integer name="height" value="8"/></film><sampler')  # fmt: skip
    film = film.replace('<sampler type="hdrfilm"/>', "")
    (tmp_path / "scene.xml").write_text(scene(film, LIGHT, BALL))
    baked = burnish(
        "bake", "scene.xml", "-o", "out.burnish", "--series", "1,1", "--spp", "4", cwd=tmp_path
    )
    assert baked.code == 0, baked.err
    shutil.move(tmp_path / "scene.xml", tmp_path / "moved.xml")
    assert "--scene" in burnish("compare", "out.burnish", cwd=tmp_path).complaint
    found = burnish("compare", "out.burnish", "--scene", "moved.xml", "--spp", "2", cwd=tmp_path)
    assert found.code == 0, found.err
    (tmp_path / "scene.xml").write_text(
        scene(film, LIGHT, BALL.replace('"diffuse"', '"conductor"'))
    )
    assert "has changed" in burnish("compare", "out.burnish", cwd=tmp_path).complaint


def test_examples_are_listed(burnish: Runner, tmp_path: Path) -> None:
    outcome = burnish("examples", cwd=tmp_path)
    assert outcome.code == 0
    assert outcome.out.startswith("cornell-box ")


@pytest.mark.parametrize("command", ["edit", "bake", "render", "compare", "info", "examples"])
def test_help_shows_examples(burnish: Runner, tmp_path: Path, command: str) -> None:
    outcome: Outcome = burnish(command, "--help", cwd=tmp_path, ray_tracer=False)
    assert outcome.code == 0
    assert f"  burnish {command}" in outcome.out.partition("Examples:")[2]


def test_importing_burnish_imports_no_ray_tracer() -> None:
    """The package, the command line and all that a bundle needs stay free of Mitsuba."""
    question = (
        "import sys, burnish, burnish.app.cli\n"
        "light = 'numpy' not in sys.modules\n"
        "import burnish.app.commands, burnish.app.opening, burnish.session, burnish.store\n"
        "import burnish.runtime, burnish.compare\n"
        "print(light, {'mitsuba', 'drjit'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", question], capture_output=True, text=True, check=True
    )
    assert done.stdout.split(maxsplit=1) == ["True", "set()\n"]
