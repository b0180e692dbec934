"""Direct light from the command line."""

from __future__ import annotations

import json
from pathlib import Path

from tests.app.conftest import Runner
from tests.app.scenes import BALL, LIGHT, scene

CAMERA = (
    '<sensor type="perspective"><transform name="to_world">'
    '<lookat origin="0, -5, 0" target="0, 0, 0" up="0, 0, 1"/></transform>'
    '<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>'
    "</film></sensor>"
)


def test_bake_and_render(burnish: Runner, tmp_path: Path) -> None:
    """A bundle of one bounce with 256 bins that says what it is, edited with no ray tracer."""
    (tmp_path / "scene.xml").write_text(scene(CAMERA, LIGHT, BALL))
    options = ("-o", "ball.burnish", "--mode", "direct", "--triangles", "100", "--spp", "4")
    outcome = burnish("bake", "scene.xml", *options, cwd=tmp_path)
    assert outcome.code == 0, outcome.err
    assert "series 256" in outcome.out
    said = json.loads(burnish("info", "ball.burnish", "--json", cwd=tmp_path).out)
    assert said["series"] == [256]
    assert said["bounces"] == 1
    edit = ("--set", "ball.diffuse.color=0.9,0.1,0.1")
    outcome = burnish(
        "render", "ball.burnish", "-o", "a.exr", *edit, cwd=tmp_path, ray_tracer=False
    )
    assert outcome.code == 0, outcome.err
    # The bundle has its mode already
    refused = burnish("render", "ball.burnish", "-o", "a.exr", "--mode", "direct", cwd=tmp_path)
    assert "--mode" in refused.complaint


def test_triangles_alone_are_refused(burnish: Runner, tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(scene(CAMERA, LIGHT, BALL))
    outcome = burnish("bake", "scene.xml", "-o", "a.burnish", "--triangles", "400", cwd=tmp_path)
    assert "mode 'direct'" in outcome.complaint
    assert not (tmp_path / "a.burnish").exists()
