"""Layers with two curves in a session: drawn, undone, saved, loaded, and refused elsewhere."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.materials.curve import Curve
from burnish.session import Session
from tests.runtime.test_switching import world
from tests.runtime.worlds import plain_image, random_world

BASIS = world("metal", (6, 1))
SOURCE, TILES = random_world(BASIS)
RAMP = Curve((0.0, 1.0), ((2.0, 1.0, 0.5), (0.2, 1.0, 1.0)))
LAYER = "pot.specular"


def session_of() -> Session:
    return Session({"front": SOURCE}, name="two")


def assert_shows_its_state(session: Session) -> None:
    expected = plain_image(BASIS, TILES, session.state, SOURCE.width, SOURCE.height)
    np.testing.assert_allclose(session.frame(), expected, rtol=5e-5)


def test_both_curves_and_parameters_of_both_sides_show() -> None:
    session = session_of()
    assert_shows_its_state(session)
    for edit in (
        lambda: session.set_second_curve(LAYER, RAMP),
        lambda: session.set("pot.specular.roughness", 0.6),
        lambda: session.set("pot.specular.eta", (1.5, 1.2, 0.4)),
        lambda: session.set_curve(LAYER, RAMP),
        lambda: session.set_second_curve(LAYER, None),
        lambda: session.set_conserve("pot", True),
        lambda: session.set("floor.diffuse.color", 0.9),
    ):
        edit()
        assert_shows_its_state(session)
    while session.undo():
        assert_shows_its_state(session)


def test_edits_files_hold_the_second_curve(tmp_path: Path) -> None:
    session = session_of()
    session.set_second_curve(LAYER, RAMP)
    session.save(tmp_path / "look.json")
    saved = json.loads((tmp_path / "look.json").read_text("utf-8"))
    assert saved["objects"]["pot"]["specular"] == {"second_curve": RAMP.to_json()}
    other = session_of()
    other.load(tmp_path / "look.json")
    assert other.state == session.state
    other.reset(LAYER)
    assert other.state == session_of().state


def test_a_layer_with_one_curve_has_no_second() -> None:
    session = session_of()
    with pytest.raises(InvalidValue, match=r"floor\.diffuse has one curve, that of lambert"):
        session.set_second_curve("floor.diffuse", RAMP)
    text = json.dumps(
        {
            "format": "burnish-edits",
            "version": 1,
            "scene": "two",
            "objects": {"floor": {"diffuse": {"second_curve": RAMP.to_json()}}},
        }
    )
    with pytest.raises(InvalidValue, match="has one curve"):
        session.load_text(text)
    assert session.history == ([], 0)
