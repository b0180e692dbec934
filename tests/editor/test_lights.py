"""The lights in the editor: from a page's switch to the pixels, and back by undo."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from burnish.app.server import EditorServer
from burnish.core.types import Float32
from burnish.materials.lights import LightGroup
from burnish.session import Session
from burnish.transport.basis import State
from tests.editor import worlds
from tests.editor.browser import keep
from tests.editor.pages import Page

LIGHTS = (LightGroup("lamp", ("lamp",)), LightGroup("window", ("window", "sky")))


class Halves:
    """Traces a lamp that lights the left half of every picture, and a window the rest."""

    def light_pictures(
        self, state: State, view: str, groups: Sequence[LightGroup], spp: int, seed: int
    ) -> tuple[Float32, Float32]:
        source = worlds.world() if view == "front" else worlds.world(96, 112, turn=0.7)
        light = np.zeros((2, source.height, source.width, 3), np.float32)
        middle = source.width // 2
        light[0, :, :middle], light[1, :, middle:] = 1.0, 1.0
        return light, 0 * light


@pytest.fixture
def session() -> Session:
    plain = worlds.session(views=2)
    return Session(
        plain.views, plain.objects, name="lit room", lights=LIGHTS, light_pictures=Halves()
    )


@pytest.fixture
def server(session: Session, tmp_path: Path) -> Iterator[EditorServer]:
    with EditorServer(session, autosave=tmp_path / "autosave.json") as running:
        yield running


def mean(server: EditorServer, half: int) -> float:
    """The left (0) or right half's mean light, as the engine has it."""
    frame = server.engine.call(lambda: server.engine.session.frame("front")).result(20.0)
    middle = frame.shape[1] // 2
    return float(frame[:, half * middle : (half + 1) * middle].mean())


def test_a_page_is_told_of_the_lights_and_sets_them(server: EditorServer, tmp_path: Path) -> None:
    with Page(server) as page:
        told = page.message("Lights")
        assert [item["path"] for item in told["items"]] == ["light:lamp", "light:window"]
        assert told["items"][1]["members"] == ["window", "sky"]
        before = page.picture().pixels.view(np.float16).astype(np.float32)
        page.send("SetValue", path="light:lamp.on", value="off")
        page.until(
            lambda item: (
                isinstance(item, dict) and item["type"] == "Lights" and not item["items"][0]["on"]
            )
        )
        shown = page.picture(revision=1).pixels.view(np.float16).astype(np.float32)
        middle = before.shape[1] // 2
        assert not shown[:, :middle].any()
        np.testing.assert_array_equal(shown[:, middle:], before[:, middle:])
        page.send("SetValue", path="light:lmap.on", value="off")
        assert "nearest: 'light:lamp.on'" in page.message("Refused")["text"]
    server.close()
    assert '"lamp"' in (tmp_path / "autosave.json").read_text()


def until(page: Any, condition: Any) -> None:
    """Wait for what a click does in its own time."""
    for _ in range(600):
        if condition():
            return
        page.wait_for_timeout(50)
    raise AssertionError("the click did nothing")


def test_switch_solo_stops_tint_and_undo(page: Any, server: EditorServer, session: Session) -> None:
    whole = [mean(server, half) for half in (0, 1)]
    page.get_by_role("region", name="Lights of the scene").get_by_text("window").click()
    lamp = page.get_by_role("region", name="Light lamp", exact=True)
    lamp.wait_for()

    lamp.get_by_role("switch", name="Light lamp on").set_checked(False, force=True)
    until(page, lambda: session.get("light:lamp.on") is False)
    assert (mean(server, 0), mean(server, 1)) == (0.0, pytest.approx(whole[1]))
    keep(page, "lights")

    lamp.get_by_role("switch", name="Light lamp on").set_checked(True, force=True)
    lamp.get_by_role("button", name="Solo").click()
    until(page, lambda: session.light("lamp").solo)
    assert (mean(server, 0), mean(server, 1)) == (pytest.approx(whole[0]), 0.0)
    lamp.get_by_role("button", name="Solo").click()
    until(page, lambda: not session.light("lamp").solo)

    stops = lamp.get_by_role("textbox", name="Stops")
    stops.fill("2")
    stops.press("Enter")
    until(page, lambda: session.get("light:lamp.intensity") == 4.0)
    assert mean(server, 0) == pytest.approx(4 * whole[0], rel=1e-5)
    number = lamp.get_by_role("textbox", name="Intensity")
    until(page, lambda: number.input_value() == "4")

    tint = lamp.get_by_role("textbox", name="Tint as sRGB hex")
    tint.fill("#ff0000")
    tint.press("Enter")
    until(page, lambda: session.get("light:lamp.tint") == (1.0, 0.0, 0.0))

    lamp.get_by_role("button", name="Reset").click()
    until(page, lambda: mean(server, 0) == pytest.approx(whole[0]))
    page.keyboard.press("Control+z")
    until(page, lambda: session.get("light:lamp.tint") == (1.0, 0.0, 0.0))
