"""Lights that are moved in the editor: by numbers, and by handles in the picture."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from burnish.app.server import EditorServer
from burnish.materials.lights import LightGroup, lights_in
from burnish.materials.placement import parameters_of
from burnish.session import Session
from burnish.transport.basis import State
from burnish.transport.frozen import Frozen, Transport
from tests.editor import worlds
from tests.editor.browser import keep
from tests.editor.pages import Page
from tests.editor.test_lights import until

HEAD = parameters_of(
    "spot",
    {
        "position": (0.5, 1.2, 1.0),
        "direction": (0.0, -1.0, 0.0),
        "cutoff_angle": 30.0,
        "beam_width": 20.0,
    },
    (-2.0, 2.0),
)
LIGHTS = (
    LightGroup("torch", ("torch",), HEAD),
    LightGroup("dome", ("dome",), parameters_of("envmap", {})),
)


def camera(width: int = 160, height: int = 112) -> tuple[float, ...]:
    """Of `worlds`: an eye that looks along −z, at (0, 0.9, 4.2); its rays written backwards."""
    x_scale, y_scale = 0.42 * width / height, 0.42
    eye = np.array([0.0, 0.9, 4.2])
    column = width / 2 * np.array([1 / x_scale, 0.0, -1.0])
    row = height / 2 * np.array([0.0, -1 / y_scale, -1.0 + 0.12 / y_scale])
    rotation = np.stack([column, row, [0.0, 0.0, -1.0]])
    matrix = np.concatenate([rotation, -(rotation @ eye)[:, None]], axis=1)
    return tuple(matrix.ravel().tolist())


@dataclass
class Lit:
    """A transport that stands for a live one: its pictures are as bright as the torch is high,
    and may have to be waited for."""

    inner: Transport
    relights: bool = True
    camera: tuple[float, ...] = camera()
    shows: threading.Event = field(default_factory=threading.Event)
    asked: list[float] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def ready(self, targets: tuple[int, ...], state: State) -> bool:
        return self.shows.is_set()

    def freeze(self, targets: tuple[int, ...], state: State, *others: Any) -> Frozen:
        found = lights_in(state).get("light:torch", LIGHTS[0].initial)
        position = cast(tuple[float, float, float], found.get("position"))
        self.asked.append(position[1])
        return self.inner.freeze(targets, state, *others)


@pytest.fixture
def lit() -> Lit:
    transport = Lit(worlds.session().views["front"])
    transport.shows.set()
    return transport


@pytest.fixture
def session(lit: Lit) -> Session:
    return Session({"front": cast(Transport, lit)}, name="stage", lights=LIGHTS)


@pytest.fixture
def server(session: Session, tmp_path: Path) -> Iterator[EditorServer]:
    with EditorServer(session, autosave=tmp_path / "autosave.json") as running:
        yield running


def test_a_page_is_told_what_lights_have(server: EditorServer, session: Session) -> None:
    with Page(server) as page:
        assert page.message("Welcome")["views"][0]["camera"] == list(camera())
        told = page.message("Lights")
        torch, dome = told["items"]
        assert told["fixed"] == ""
        assert [item["name"] for item in dome["parameters"]] == ["rotation", "exposure", "file"]
        place = torch["parameters"][0]
        assert (place["kind"], place["default"]) == ("vector", [0.5, 1.2, 1.0])
        assert torch["values"]["cutoff_angle"] == 30.0
        page.send("SetValue", path="light:torch.position", value=[0.0, 2.0, 1.0])
        assert "traced anew" in page.message("Notice")["text"]
        page.send("SetValue", path="light:torch.direction", value=[0.0, 0.0, 0.0])
        assert "not all zero" in page.message("Refused")["text"]
    assert session.get("light:torch.position") == (0.0, 2.0, 1.0)


def test_a_bake_offers_what_it_can_show(tmp_path: Path) -> None:
    stored = Session(dict(worlds.session().views), name="baked", lights=LIGHTS)
    with (
        EditorServer(stored, autosave=tmp_path / "autosave.json") as running,
        Page(running) as page,
    ):
        told = page.message("Lights")
        assert "open the scene itself" in told["fixed"]
        names = [[knob["name"] for knob in item["parameters"]] for item in told["items"]]
        assert names == [[], ["exposure"]]


def test_a_light_that_is_dragged_is_seen_on_its_way(server: EditorServer, lit: Lit) -> None:
    """The next place waits until the picture of the last one is there; the last one counts."""
    with Page(server) as page:
        page.picture()
        lit.shows.clear()
        page.send("Gesture", active=True)
        page.send("SetValue", path="light:torch.position", value=[0.0, 2.0, 0.0])
        until_waiting(server)
        for height in (3.0, 4.0, 5.0):
            page.send("SetValue", path="light:torch.position", value=[0.0, height, 0.0])
        until_queued(server, 5.0)
        # The engine goes on with its rounds meanwhile
        assert server.engine.call(lambda: server.engine.session.revision).result(20.0) == 1
        lit.shows.set()
        page.picture(revision=1)
        page.picture(revision=2)
        assert lit.asked[-2:] == [2.0, 5.0]
        lit.shows.clear()
        page.send("SetValue", path="light:torch.position", value=[0.0, 6.0, 0.0])
        until_waiting(server)
        page.send("SetValue", path="light:torch.position", value=[0.0, 7.0, 0.0])
        until_queued(server, 7.0)
        # What is not a light's place waits for nothing, and lets nothing pass it
        page.send("Gesture", active=False)
        page.message("State", revision=4)
        lit.shows.set()
        page.picture(revision=4)
        assert lit.asked[-1] == 7.0
        page.send("Undo")
        page.message("State", revision=5)
    assert server.engine.session.get("light:torch.position") == (0.5, 1.2, 1.0)


def until_waiting(server: EditorServer) -> None:
    """The engine waits for a picture."""
    eventually(lambda: server.engine.call(lambda: server.engine._out.waits).result(20.0))


def until_queued(server: EditorServer, height: float) -> None:
    """A light's place has arrived and is held back."""

    def heights() -> list[float]:
        with server.engine._changed:
            return [item.value[1] for box, item in server.engine._queue if box is not None]

    eventually(lambda: heights() == [height])


def eventually(condition: Callable[[], bool]) -> None:
    for _ in range(1200):
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError("it did not come to that")


def handle(page: Any, label: str) -> tuple[float, float]:
    """Where on the screen a handle's middle is."""
    box = page.get_by_label(label, exact=True).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def screen(page: Any, place: tuple[float, float, float]) -> tuple[float, float]:
    """Where on the screen a place of the world is: the picture is fitted and in the middle."""
    matrix = np.reshape(camera(), (3, 4))
    column, row, depth = matrix @ [*place, 1.0]
    box = page.get_by_label("Picture of view front").bounding_box()
    fit = min(box["width"] / 160, box["height"] / 112)
    scale = np.floor(fit) if fit > 2 else fit
    x = round((box["width"] - 160 * scale) / 2) + scale * column / depth
    y = round((box["height"] - 112 * scale) / 2) + scale * row / depth
    return box["x"] + x, box["y"] + y


def test_handles_move_and_aim_and_numbers_do(page: Any, session: Session) -> None:
    page.get_by_role("region", name="Lights of the scene").get_by_text("torch").click()
    page.get_by_label("Move light torch", exact=True).wait_for()
    np.testing.assert_allclose(
        handle(page, "Move light torch"), screen(page, HEAD[0].default), atol=1
    )

    # In the plane of the screen: the depth stays
    goal = (-0.4, 1.5, 1.0)
    drag(page, "Move light torch", screen(page, goal))
    until(page, lambda: np.allclose(session.get("light:torch.position"), goal, atol=0.03))
    assert session.get("light:torch.position")[2] == pytest.approx(1.0, abs=1e-6)
    assert len(session.history[0]) == 1
    np.testing.assert_allclose(handle(page, "Move light torch"), screen(page, goal), atol=2)

    # Away: on the same line of sight
    page.keyboard.down("Shift")
    x, y = handle(page, "Move light torch")
    drag(page, "Move light torch", (x, y - 40))
    page.keyboard.up("Shift")
    until(page, lambda: session.get("light:torch.position")[2] < 0.95)
    np.testing.assert_allclose(screen(page, session.get("light:torch.position")), (x, y), atol=2)

    # To the right, from straight down
    before = handle(page, "Aim light torch")
    drag(page, "Aim light torch", (before[0] + 70, before[1] - 20))
    until(page, lambda: session.get("light:torch.direction")[0] > 0.3)
    assert np.linalg.norm(session.get("light:torch.direction")) == pytest.approx(1.0)
    keep(page, "moved-lights")

    torch = page.get_by_role("region", name="Light torch", exact=True)
    box = torch.get_by_role("textbox", name="Position y")
    box.fill("0.75")
    box.press("Enter")
    until(page, lambda: session.get("light:torch.position")[1] == 0.75)
    torch.get_by_role("textbox", name="Cutoff angle (°)").fill("45")
    torch.get_by_role("textbox", name="Cutoff angle (°)").press("Enter")
    until(page, lambda: session.get("light:torch.cutoff_angle") == 45.0)
    torch.get_by_role("button", name="Reset").click()
    until(page, lambda: not lights_in(session.state))


def test_the_surroundings_turn_and_are_replaced(
    page: Any, session: Session, tmp_path: Path
) -> None:
    picture = tmp_path / "sky.exr"
    picture.write_bytes(b"only its name is read here")
    page.get_by_role("region", name="Lights of the scene").get_by_text("dome").click()
    dome = page.get_by_role("region", name="Light dome", exact=True)
    assert page.get_by_label("Move light dome", exact=True).count() == 0
    for name, text, path, value in (
        ("Rotation (°)", "120", "light:dome.rotation", 120.0),
        ("Exposure (stops)", "1", "light:dome.exposure", 1.0),
        ("File", str(picture), "light:dome.file", str(picture)),
    ):
        box = dome.get_by_role("textbox", name=name, exact=True)
        box.fill(text)
        box.press("Enter")
        until(page, lambda path=path, value=value: session.get(path) == value)
    box = dome.get_by_role("textbox", name="File", exact=True)
    box.fill("/nowhere/at/all.exr")
    box.press("Enter")
    page.get_by_text("no file '/nowhere/at/all.exr'").wait_for()
    box.fill("")
    box.press("Enter")
    until(page, lambda: session.get("light:dome.file") == "")


def drag(page: Any, label: str, to: tuple[float, float]) -> None:
    """Take a handle, go a way and let go."""
    x, y = handle(page, label)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move((x + to[0]) / 2, (y + to[1]) / 2)
    page.mouse.move(*to)
    page.mouse.up()
