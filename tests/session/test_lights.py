"""The mix in a session: set, undone, saved; by the transport's groups or by traced shares."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from burnish.core.errors import InvalidValue, MissingRayTracer, SceneError, UnknownName
from burnish.core.types import Float32
from burnish.materials.lights import LightGroup, lights_in, mix, placements
from burnish.materials.placement import parameters_of
from burnish.session import Session, lightmix
from burnish.session.fitting import fit
from burnish.session.lightmix import ratio
from burnish.transport.basis import State
from burnish.transport.frozen import Frozen, Transport
from tests.runtime.worlds import basis_of, plain_image, random_world

LIGHTS = (LightGroup("lamp", ("lamp",)), LightGroup("sky", ("sky",)))
PLAIN = basis_of((6, 1, 1))
GROUPED = replace(PLAIN, lights=LIGHTS)
SOURCE, _ = random_world(PLAIN)
APART, TILES = random_world(GROUPED)


@dataclass
class Shares:
    """A light tracer whose lamp gives a third of every pixel, and what it was asked for."""

    asked: list[State] = field(default_factory=list)
    failing: bool = False

    def light_pictures(
        self, state: State, view: str, groups: Sequence[LightGroup], spp: int, seed: int
    ) -> tuple[Float32, Float32]:
        self.asked.append(state)
        if self.failing:
            raise SceneError("the scene is gone")
        picture = np.random.default_rng(seed).random((SOURCE.height, SOURCE.width, 3), np.float32)
        shares = np.stack([picture, 2 * picture])
        return shares, 0.5 * shares


def by_groups() -> Session:
    return Session({"front": APART}, name="test")


def by_shares(tracer: Shares | None = None) -> Session:
    return Session({"front": SOURCE}, name="test", lights=LIGHTS, light_pictures=tracer or Shares())


@pytest.fixture(params=["groups", "shares"])
def session(request: pytest.FixtureRequest) -> Session:
    return by_groups() if request.param == "groups" else by_shares()


def test_set_get_undo_and_reset(session: Session) -> None:
    start = session.frame()
    session.set("light:lamp.intensity", 2)
    session.set("light:lamp.tint", "#ff0000")
    session.set("light:sky.on", "off")
    assert session.get("light:lamp.intensity") == 2.0
    assert session.get("light:lamp.tint") == (1.0, 0.0, 0.0)
    assert session.get("light:sky.on") is False
    assert session.light("lamp").intensity == 2.0
    assert session.history[0][-1] == "Set light:sky.on to off"
    assert session.selected == ()
    assert not session.frame()[..., 1:].any()
    for _ in range(3):
        session.undo()
    np.testing.assert_array_equal(session.frame(), start)
    assert not lights_in(session.state)
    session.redo()
    session.reset("light:lamp")
    assert not lights_in(session.state)
    session.set("light:sky.solo", True)
    session.reset("light:sky.solo")
    assert not lights_in(session.state)


def test_the_lights_sum_to_the_unmixed_picture(session: Session) -> None:
    whole, total = session.frame(), 0.0
    for group in session.lights:
        session.set(f"{group.key}.solo", True)
        total = total + session.frame().astype(np.float64)
        session.undo()
    np.testing.assert_allclose(total, whole, rtol=1e-5)


def test_dark_is_black_and_no_number_is_lost(session: Session) -> None:
    for group in session.lights:
        session.set(f"{group.key}.on", False)
    assert not session.frame().any()
    assert not session.emission().any()


def test_edits_files_hold_the_mix(session: Session, tmp_path: Path) -> None:
    session.set("light:lamp.intensity", 3.0)
    session.set("light:sky.tint", (0.2, 0.4, 0.6))
    session.set("light:sky.solo", True)
    session.set("box.diffuse.color", 0.3)
    kept, image = session.state, session.frame()
    session.save(tmp_path / "look.json")
    said = json.loads((tmp_path / "look.json").read_text())
    assert said["lights"] == {
        "lamp": {"intensity": 3.0},
        "sky": {"tint": [0.2, 0.4, 0.6], "solo": True},
    }
    session.reset()
    session.load(tmp_path / "look.json")
    assert session.state == kept
    np.testing.assert_allclose(session.frame(), image, rtol=1e-6)
    session.reset()
    session.restore(kept)
    assert session.state == kept


def test_without_a_mix_the_file_is_what_it_was(session: Session) -> None:
    session.set("box.diffuse.color", 0.3)
    said = json.loads(session.edits_text())
    assert (said["version"], "lights" in said) == (1, False)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("light:lmap.intensity", 1.0, "nearest: 'light:lamp.intensity'"),
        ("light:lamp.intensty", 1.0, "nearest: 'light:lamp.intensity'"),
        ("light:lamp.intensity", -1.0, r"light:lamp.intensity must lie in \[0, 1e\+06\]; got -1"),
        ("light:lamp.intensity", float("nan"), "must lie in"),
        ("light:lamp.tint", (1.0, 2.0, 0.0), "light:lamp.tint must lie in"),
        ("light:lamp.on", "perhaps", "light:lamp.on must be on or off; got 'perhaps'"),
    ],
)
def test_what_cannot_be_set(session: Session, path: str, value: object, message: str) -> None:
    with pytest.raises((UnknownName, InvalidValue), match=message):
        session.set(path, value)
    assert not lights_in(session.state)


@pytest.mark.parametrize(
    "lights",
    [{"lmap": {"on": False}}, {"lamp": {"colour": 1}}, {"lamp": {"on": 3}}, {"lamp": 2}, [1]],
)
def test_edits_files_that_are_wrong_change_nothing(session: Session, lights: object) -> None:
    data = {"format": "burnish-edits", "version": 2, "objects": {}, "lights": lights}
    with pytest.raises((UnknownName, InvalidValue)):
        session.load_text(json.dumps(data))
    assert not lights_in(session.state)


def test_materials_under_a_mix_of_groups_are_exact_whatever_is_edited_last() -> None:
    session = by_groups()
    steps: list[tuple[str, object]] = [
        ("box.diffuse.color", 0.7),
        ("light:lamp.intensity", 0.2),
        ("light:lamp.tint", (1.0, 0.5, 0.0)),
        ("box.specular.exponent", 60.0),
        ("floor.diffuse.color", 0.1),
        ("light:sky.intensity", 4.0),
        ("floor.diffuse.color", 0.9),
    ]
    for path, value in steps:
        session.set(path, value)
        expected = plain_image(GROUPED, TILES, session.state, APART.width, APART.height)
        np.testing.assert_allclose(session.frame(), expected, rtol=3e-5)


def test_shares_are_traced_for_the_materials_that_are_shown() -> None:
    tracer = Shares()
    session = by_shares(tracer)
    session.frame()
    assert not tracer.asked
    session.set("light:lamp.intensity", 4.0)
    np.testing.assert_allclose(session.frame(), 2 * by_shares().frame(), rtol=1e-5)
    session.set("light:sky.intensity", 2.5)
    session.frame()
    assert len(tracer.asked) == 1
    session.set("box.diffuse.color", 0.7)
    session.frame()
    assert len(tracer.asked) == 2
    assert tracer.asked[1]["box"] == session.state["box"]
    assert not lights_in(tracer.asked[1])


def test_in_the_background_the_last_shares_serve_until_there_are_new_ones() -> None:
    tracer = Shares()
    session = by_shares(tracer)
    session.light_mix.background = True
    session.set("light:lamp.on", False)
    until_ready(session)
    session.frame()
    session.set("box.diffuse.color", 0.7)
    assert "earlier materials" in session.light_mix.notice("front", session.state)
    session.frame()
    end = time.monotonic() + 60
    while session.light_mix.notice("front", session.state):
        assert time.monotonic() < end
        session.frame()
        time.sleep(0.01)
    assert tracer.asked[-1]["box"] == session.state["box"]


def test_shares_that_cannot_be_traced_are_said() -> None:
    session = by_shares(Shares(failing=True))
    session.light_mix.background = True
    session.set("light:lamp.on", False)
    until_ready(session)
    with pytest.raises(SceneError, match="the scene is gone"):
        session.frame()
    session.undo()
    session.frame()
    untraced = Session({"front": SOURCE}, lights=LIGHTS)
    untraced.set("light:lamp.on", False)
    with pytest.raises(MissingRayTracer, match="--light-groups"):
        untraced.frame()


def until_ready(session: Session) -> None:
    end = time.monotonic() + 60
    while not session.ready():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_shares_hold_where_a_pixel_has_no_light() -> None:
    images = np.zeros((2, 1, 2, 3), np.float32)
    images[:, 0, 0] = [[1.0, 0.0, -1.0], [3.0, 0.0, 1.0]]
    found = ratio(images, mix_of(2.0, 6.0))
    np.testing.assert_allclose(found[0, 0], [5.0, 4.0, 6.0])
    # No light here: the shares of the whole picture, or equal ones where there is none
    np.testing.assert_allclose(found[0, 1], [5.0, 4.0, 6.0])


def mix_of(*factors: float) -> np.ndarray:
    state = {
        group.key: replace(group.initial, intensity=factor)
        for group, factor in zip(LIGHTS, factors, strict=True)
    }
    return mix(LIGHTS, state)


def test_a_fit_under_shares_is_refused_and_under_groups_is_not() -> None:
    session = by_shares()
    session.set("light:lamp.on", False)
    target = np.full((SOURCE.height, SOURCE.width, 3), 0.5, np.float32)
    with pytest.raises(InvalidValue, match="--light-groups"):
        fit(session, target, objects=["box"])
    grouped = by_groups()
    grouped.set("light:lamp.intensity", 0.5)
    grouped.set("box.diffuse.color", 0.6)
    wish = grouped.frame()
    grouped.undo()
    found = fit(grouped, wish, objects=["box"], parameters=["diffuse.color"])
    assert found.values["box.diffuse.color"] == pytest.approx((0.6, 0.6, 0.6), abs=1e-3)


def test_a_tracer_that_comes_back_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lightmix, "RETRY_SECONDS", 0.01)
    tracer = Shares(failing=True)
    session = by_shares(tracer)
    session.light_mix.background = True
    session.set("light:lamp.on", False)
    until_ready(session)
    with pytest.raises(SceneError, match="the scene is gone"):
        session.frame()
    tracer.failing = False
    revision, end = session.light_mix.revision, time.monotonic() + 60
    while session.light_mix.revision == revision or session.light_mix.notice(
        "front", session.state
    ):
        assert time.monotonic() < end
        session.ready()
        time.sleep(0.01)
    session.frame()


TORCH = LightGroup(
    "lamp",
    ("lamp",),
    parameters_of("spot", {"position": (0, 3, 0), "direction": (0, -1, 0), "cutoff_angle": 30.0}),
)
DOME = LightGroup("sky", ("sky",), parameters_of("envmap", {}))


@dataclass(frozen=True)
class Anywhere:
    """A transport that shows lights wherever they stand; it counts how often it was asked."""

    inner: Transport
    relights: bool = True
    asked: list[State] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def freeze(self, targets: tuple[int, ...], state: State, *others: Any) -> Frozen:
        self.asked.append(state)
        return self.inner.freeze(targets, state, *others)


def movable() -> tuple[Session, Anywhere]:
    stored = Session({"front": SOURCE}).views["front"]
    transport = Anywhere(stored)
    session = Session(
        {"front": cast(Transport, transport)}, lights=(TORCH, DOME), light_pictures=Shares()
    )
    return session, transport


def test_lights_are_moved_undone_and_saved(tmp_path: Path) -> None:
    session, transport = movable()
    assert session.lights_fixed == ""
    session.frame()
    session.frame()
    assert len(transport.asked) == 1
    session.set("light:lamp.position", (1, 2, 3))
    session.set("light:lamp.direction", (0.0, 3.0, 4.0))
    session.set("light:sky.rotation", 90)
    assert session.get("light:lamp.position") == (1.0, 2.0, 3.0)
    assert session.get("light:lamp.direction") == (0.0, 0.6, 0.8)
    assert session.get("light:lamp.cutoff_angle") == 30.0
    assert session.history[0][0] == "Set light:lamp.position to (1, 2, 3)"
    session.frame()
    assert len(transport.asked) == 2
    assert placements([], transport.asked[1]).keys() == {"lamp", "sky"}
    kept = session.state
    session.save(tmp_path / "look.json")
    said = json.loads((tmp_path / "look.json").read_text())
    assert said["version"] == 3
    assert said["lights"] == {
        "lamp": {"position": [1.0, 2.0, 3.0], "direction": [0.0, 0.6, 0.8]},
        "sky": {"rotation": 90.0},
    }
    session.reset("light:lamp.position")
    session.reset("light:lamp.direction")
    assert session.get("light:lamp.position") == (0.0, 3.0, 0.0)
    assert lights_in(session.state).keys() == {"light:sky"}
    session.undo()
    session.undo()
    assert session.state == kept
    session.reset()
    session.load(tmp_path / "look.json")
    assert session.state == kept
    with pytest.raises(UnknownName, match=r"nearest: 'light:lamp\.position'"):
        session.set("light:lamp.postion", (0, 0, 0))
    with pytest.raises(UnknownName):
        session.set("light:sky.position", (0, 0, 0))


def test_shares_are_traced_anew_where_lights_stand_elsewhere() -> None:
    session, _ = movable()
    assert isinstance(session.light_mix.tracer, Shares)
    asked = session.light_mix.tracer.asked
    session.set("light:lamp.intensity", 2.0)
    session.frame()
    session.set("light:sky.exposure", 1.0)
    session.frame()
    assert len(asked) == 1
    assert not lights_in(asked[0])
    session.set("light:lamp.position", (1, 2, 3))
    session.frame()
    session.set("light:lamp.intensity", 1.0)
    session.frame()
    assert len(asked) == 2
    # What each adds is asked for as the scene's own, at its new place
    assert lights_in(asked[1]) == {
        "light:lamp": TORCH.initial.set("position", (1, 2, 3), TORCH.key)
    }


def test_a_bake_holds_the_light_of_where_the_lights_stood() -> None:
    session = Session({"front": SOURCE}, lights=(TORCH, DOME), light_pictures=Shares())
    before = session.frame()
    for path, value in (("light:lamp.position", (1, 2, 3)), ("light:sky.rotation", 90.0)):
        with pytest.raises(InvalidValue, match=rf"{path} cannot change here: a bake.*open the"):
            session.set(path, value)
    moved = {TORCH.key: TORCH.initial.set("cutoff_angle", 10.0, TORCH.key)}
    with pytest.raises(InvalidValue, match=r"light:lamp\.cutoff_angle cannot change here"):
        session.restore({**session.state, **moved})
    data = {"format": "burnish-edits", "version": 3, "lights": {"sky": {"rotation": 5.0}}}
    with pytest.raises(InvalidValue, match=r"light:sky\.rotation cannot change here"):
        session.load_text(json.dumps(data))
    assert not lights_in(session.state)
    # What the scene has, and what only scales
    session.set("light:lamp.position", TORCH.initial.get("position"))
    session.set("light:sky.exposure", 1.0)
    session.set("light:lamp.intensity", 2.0)
    np.testing.assert_allclose(session.frame(), 2 * before, rtol=1e-5)
