"""Scenes by others in the editor's page, live: they open, are seen, selected and edited."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import burnish
from burnish.app.live import LiveStudio
from burnish.app.server import EditorServer
from burnish.runtime.tonemap import ToneMap
from tests.editor.browser import chromium, keep, pixels

pytestmark = pytest.mark.verify

SECONDS = 300.0
CASES = (
    ("cbox/cbox.xml", "box_2"),
    ("teapot_simple/scene.xml", "teapot"),
    ("matpreview/matpreview.xml", "shape-matpreview-exterior"),
    ("veach-mis/scene.xml", "SuperRough"),
    ("staircase2/scene.xml", "Wood_0003"),
    ("living-room/scene.xml", "Floor"),
)


@pytest.mark.parametrize(("file", "name"), CASES, ids=[Path(file).parent.name for file, _ in CASES])
def test_a_scene_opens_is_selected_and_edited(assets: Path, file: str, name: str) -> None:
    width, height = 128, 96
    scene = assets / "scenes" / file
    with (
        burnish.edit(scene, resolution=(width, height)) as session,
        EditorServer(session) as server,
        chromium() as browser,
    ):
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.set_default_timeout(1000 * SECONDS)
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(server.url)
        page.get_by_text("Waiting for the first picture").wait_for(state="detached")
        page.get_by_role("option", name=name, exact=True).first.click()
        panel = page.get_by_role("region", name=f"Material of {name}")
        panel.wait_for()
        denoise = page.locator("button[aria-pressed=true]", has_text="Denoise at rest")
        if denoise.count():
            denoise.click()
        view = next(iter(session.views.values()))
        until(page, lambda: view.samples >= 29)  # type: ignore[attr-defined]
        before = server.engine.call(session.frame).result(SECONDS)
        start = session.state[name]

        # An edit from the page changes what the engine shows, and the page shows that
        box = panel.get_by_role("textbox", name="Color as sRGB hex").first
        box.fill("#c03020")
        box.press("Enter")
        box.blur()
        until(page, lambda: session.state[name] != start)
        assert isinstance(session.truth, LiveStudio)
        session.truth.pause()
        page.wait_for_timeout(3000)
        after = server.engine.call(session.frame).result(SECONDS)
        assert np.abs(after - before).mean() > 0.001 * before.mean()
        difference = np.abs(shown(page, width, height) - displayed(after))
        assert difference.max() <= 2
        keep(page, f"scene-{Path(file).parent.name}")
        assert not problems


def until(page: Any, condition: Any) -> None:
    """Wait while the page goes on."""
    end = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        page.wait_for_timeout(50)


def shown(page: Any, width: int, height: int) -> np.ndarray:
    """The picture's pixels one to one, as they are on the screen."""
    page.keyboard.press("1")
    page.mouse.move(2, 2)
    page.wait_for_timeout(1000)
    box = page.locator(".view canvas").bounding_box()
    x = box["x"] + round((box["width"] - width) / 2)
    y = box["y"] + round((box["height"] - height) / 2)
    return pixels(page, x, y, width, height).astype(int)


def displayed(image: np.ndarray) -> np.ndarray:
    """The bytes that a screen is given of a picture."""
    return ToneMap().to_bytes(image.astype(np.float16).astype(np.float32)).astype(int)
