"""A layer with two curves in the editor: described, drawn over messages, and plotted."""

from __future__ import annotations

from pathlib import Path

import pytest

from burnish.app.server import EditorServer, application
from burnish.session import Session
from tests.editor.pages import Page
from tests.runtime.test_switching import world
from tests.runtime.worlds import random_world

HALF = {
    "mode": "gain",
    "interpolation": "linear",
    "t": [0.0, 1.0],
    "values": [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]],
}


@pytest.fixture(autouse=True)
def page_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A page to serve."""
    (tmp_path / "index.html").write_text("<!doctype html><title>burnish</title>", "utf-8")
    monkeypatch.setattr(application, "STATIC", tmp_path)


def test_both_curves_are_described_and_drawn() -> None:
    session = Session({"front": random_world(world("metal", (6, 1)))[0]}, name="two")
    with EditorServer(session) as server, Page(server) as page:
        diffuse, specular = page.message("Welcome")["objects"][0]["layers"]
        assert (diffuse["coordinate"], diffuse["second_coordinate"]) == ("none", "none")
        assert specular["coordinate"] == "theta_h"
        assert specular["second_coordinate"] == "theta_d"
        assert specular["coordinate_maximum"] == pytest.approx(90.0)
        page.send("Select", objects=["pot"])
        curves = page.message("Curves", object="pot")
        (first,), (second,) = curves["layers"], curves["second"]
        assert first["layer"] == second["layer"] == "specular"
        assert second["base"] == second["result"]
        # The Fresnel curve of copper, at normal incidence and at grazing
        assert second["base"][0][0] == pytest.approx(0.95, abs=0.01)
        assert second["base"][-1] == pytest.approx([1.0, 1.0, 1.0], abs=1e-4)
        page.send("SetSecondCurve", layer="pot.specular", curve=HALF)
        state = page.message("State", revision=1)
        assert state["materials"]["pot"]["layers"]["specular"]["second_curve"] == HALF
        drawn = page.until(
            lambda item: (
                isinstance(item, dict)
                and item["type"] == "Curves"
                and item["second"][0]["base"] != item["second"][0]["result"]
            )
        )
        (second,) = drawn["second"]
        assert second["result"][0][0] == pytest.approx(0.5 * second["base"][0][0], rel=1e-4)
        page.send("SetSecondCurve", layer="pot.diffuse", curve=HALF)
        assert "has one curve" in page.message("Refused")["text"]
