"""Sessions of views that are traced while they are looked at: what they are asked to trace."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from burnish.materials.lights import LightGroup
from burnish.runtime.freeze import BakedTransport
from burnish.session import Session
from burnish.transport.basis import State
from burnish.transport.frozen import Frozen
from burnish.transport.pack import TiledBlocks
from tests.runtime.worlds import basis_of, random_world

PLAIN = basis_of((6, 1, 1))
GROUPED = replace(PLAIN, lights=(LightGroup("lamp", ("lamp",)), LightGroup("sky", ("sky",))))


class Traced(BakedTransport):
    """Stored light in a live view's place, blind to replaced models."""

    traces_the_scene = True
    remodels = True

    def __init__(self, source: TiledBlocks) -> None:
        super().__init__(source)
        self.asked: list[tuple[int, ...]] = []
        self.wanted: tuple[int, ...] = ()

    def ready(self, targets: tuple[int, ...], state: State) -> bool:
        self.wanted = targets
        return True

    def freeze(self, targets: tuple[int, ...], state: State, fine: tuple[int, ...] = ()) -> Frozen:
        # As it is sent to another process
        state = pickle.loads(pickle.dumps(dict(state)))
        self.asked.append(tuple(sorted({*targets, *fine})))
        return super().freeze(self.asked[-1], state)


@pytest.fixture
def picture(tmp_path: Path) -> str:
    values = np.random.default_rng(4).integers(0, 255, (4, 4, 3), np.uint8)
    Image.fromarray(values).save(tmp_path / "oak.png")
    return str(tmp_path / "oak.png")


def test_objects_with_maps_beside_the_selected_ones_are_asked_for_as_they_are_sent(
    picture: str,
) -> None:
    view = Traced(random_world(PLAIN)[0])
    session = Session({"front": view}, name="test")
    session.set_map("box.diffuse.color", picture)
    session.set("lid.specular.exponent", 40.0)
    assert session.selected == ("lid",)
    beside = session.frame()
    assert view.asked[-1] == (0, 2)
    session.select("box", "lid")
    np.testing.assert_array_equal(session.frame(), beside)


def test_another_selection_is_not_taken_for_a_change_of_the_lights() -> None:
    view = Traced(random_world(GROUPED)[0])
    session = Session({"front": view}, name="test")
    for number, name in ((0, "box"), (1, "floor"), (2, "lid")):
        session.select(name)
        session.frame()
        assert view.asked[-1] == (number,)


def test_a_map_of_a_replaced_model_stays_when_another_object_is_selected(picture: str) -> None:
    view = Traced(random_world(PLAIN)[0])
    session = Session({"front": view}, name="test")
    session.set_model("box.specular", "cook-torrance")
    session.set_map("box.specular.roughness", picture)
    session.select("lid")
    assert session.ready()
    assert view.wanted == (0, 2)


def test_saved_maps_are_those_that_the_present_model_has_a_place_for(
    picture: str, tmp_path: Path
) -> None:
    session = Session({"front": Traced(random_world(PLAIN)[0])}, name="test")
    session.set_map("box.specular.exponent", picture)
    session.set_map("box.specular.color", picture)
    session.set_model("box.specular", "cook-torrance")
    session.set_map("box.specular.roughness", picture)
    session.set_map("lid.specular.exponent", picture)
    said = json.loads(session.edits_text())["objects"]
    assert said["box"]["specular"]["maps"].keys() == {"color", "roughness"}
    kept = session.state
    session.save(tmp_path / "look.json")
    session.reset()
    session.load(tmp_path / "look.json")
    assert session.state == kept
