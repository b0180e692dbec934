"""The editor on a live session: a real worker traces, a real browser shows."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import burnish
from burnish.app.live import LiveStudio, LiveView
from burnish.app.server import EditorServer, publishing
from burnish.app.worker import Mapped
from burnish.core.errors import SceneError
from burnish.core.types import Float32
from burnish.materials.fresnel import METALS
from burnish.runtime.tonemap import ToneMap
from burnish.session import Session
from tests.editor.browser import keep, pixels

SIDE = 64
SECONDS = 60.0


@pytest.fixture(scope="module")
def session() -> Iterator[Session]:
    with burnish.edit("cornell-box", resolution=(SIDE, SIDE)) as live:
        yield live


@pytest.fixture
def server(session: Session) -> Iterator[EditorServer]:
    session.reset()
    session.select()
    with EditorServer(session) as running:
        yield running


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.02)


def studio_of(session: Session) -> LiveStudio:
    assert isinstance(session.truth, LiveStudio)
    return session.truth


def view_of(session: Session) -> LiveView:
    return next(iter(studio_of(session).views.values()))


def in_engine(server: EditorServer, picture: Callable[[], Float32]) -> Float32:
    return server.engine.call(picture).result(SECONDS)


def rest(page: Any, server: EditorServer) -> Float32:
    """Stop refining, let the page take the last picture, and return it."""
    studio = studio_of(server.engine.session)
    studio.pause()
    before = -1
    while before != view_of(server.engine.session).revision:
        before = view_of(server.engine.session).revision
        page.wait_for_timeout(600)
    return in_engine(server, server.engine.session.frame)


def as_it_is(page: Any) -> None:
    """Show the picture at rest as it is, not denoised."""
    page.locator("button[aria-pressed=true]", has_text="Denoise at rest").click()
    page.locator("button[aria-pressed=false]", has_text="Denoise at rest").wait_for()


def shown(page: Any) -> np.ndarray:
    """The picture's pixels one to one, as they are on the screen."""
    page.keyboard.press("1")
    page.mouse.move(2, 2)
    page.wait_for_timeout(200)
    box = page.locator(".view canvas").bounding_box()
    x = box["x"] + round((box["width"] - SIDE) / 2)
    y = box["y"] + round((box["height"] - SIDE) / 2)
    return pixels(page, x, y, SIDE, SIDE).astype(int)


def as_displayed(image: Float32) -> np.ndarray:
    return ToneMap().to_bytes(image.astype(np.float16).astype(np.float32)).astype(int)


def click_picture(page: Any, x: int, y: int) -> None:
    page.keyboard.press("f")
    box = page.locator(".view canvas").bounding_box()
    scale = np.floor(min(box["width"], box["height"]) / SIDE)
    left = box["x"] + round((box["width"] - SIDE * scale) / 2)
    top = box["y"] + round((box["height"] - SIDE * scale) / 2)
    at = left + (x + 0.5) * scale, top + (y + 0.5) * scale
    # The objects under the pixels come after the first picture
    end = time.monotonic() + SECONDS
    while not page.locator(".object.hovered").count():
        assert time.monotonic() < end, "the page knows no object there"
        page.mouse.move(2, 2)
        page.mouse.move(*at)
        page.wait_for_timeout(100)
    page.mouse.click(*at)


def drag(page: Any, x: float, y: float, dx: float, dy: float) -> None:
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=12)
    page.mouse.up()


def test_select_drag_denoise(
    page: Any,
    server: EditorServer,
    session: Session,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # However many samples there are by the time that a busy machine's page has been asked
    monkeypatch.setattr(publishing, "ENOUGH_SAMPLES", 1 << 30)
    toggle = page.get_by_role("button", name="Denoise at rest")
    as_it_is(page)

    # Click the large box and drag: edits are taken before its first samples are there
    click_picture(page, 25, 40)
    panel = page.get_by_role("region", name="Material of large-box")
    panel.wait_for()
    assert session.selected == ("large-box",)
    track = panel.get_by_role("slider", name="Weight", exact=True).nth(1).bounding_box()
    drag(page, track["x"] + 2, track["y"] + track["height"] / 2, 0.6 * track["width"], 0)
    until(lambda: session.state["large-box"].layers["specular"].weight > 0.5)
    assert len(session.history[0]) == 1
    until(lambda: view_of(session).samples >= 29)
    # Known from two pictures of one look
    page.locator(".noise").wait_for()
    image = rest(page, server)
    assert np.abs(shown(page) - as_displayed(image)).max() <= 2
    assert "samples" in page.locator(".refining").inner_text()
    assert "%" in page.locator(".noise").inner_text()

    handle = panel.locator('[data-point="2"]').bounding_box()
    drag(page, handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2, 2, -40)
    until(lambda: session.state["large-box"].layers["specular"].curve is not None)
    page.wait_for_timeout(300)
    curved = in_engine(server, session.frame)
    assert np.abs(curved - image).max() > 0.005
    raw = shown(page)
    assert np.abs(raw - as_displayed(curved)).max() <= 2

    # The denoised picture is for the eye alone: saved ones stay as they are
    toggle.click()
    cleaned = as_displayed(in_engine(server, session.denoised))
    assert np.abs(cleaned - raw).max() > 10
    end = time.monotonic() + SECONDS
    while np.abs(shown(page) - cleaned).max() > 2:
        assert time.monotonic() < end, "the page does not show the denoised picture"
    keep(page, "live-denoised")
    with page.expect_download() as png:
        page.get_by_role("button", name="PNG").click()
    png.value.save_as(tmp_path / "picture.png")
    with Image.open(tmp_path / "picture.png") as saved:
        assert np.abs(np.asarray(saved.convert("RGB")).astype(int) - raw).max() <= 2

    # An edit shows at once, not denoised; it is at rest soon after
    page.keyboard.press("Control+z")
    page.wait_for_timeout(100)
    toggle.click()
    assert np.abs(shown(page) - as_displayed(in_engine(server, session.frame))).max() <= 2
    toggle.click()
    studio_of(session).pause(False)


def test_another_model_and_a_metal(page: Any, server: EditorServer, session: Session) -> None:
    as_it_is(page)
    page.get_by_role("option", name="large-box").click()
    panel = page.get_by_role("region", name="Material of large-box")
    panel.wait_for()
    chooser = panel.get_by_role("combobox", name="Model of specular")
    assert chooser.input_value() == "blinn-phong"
    chooser.select_option("cook-torrance-conductor")
    page.get_by_text("being traced anew").wait_for()
    panel.get_by_role("slider", name="Roughness").wait_for()
    assert session.material("large-box").layer("specular").model.name == "cook-torrance-conductor"  # type: ignore[union-attr]
    panel.get_by_role("combobox", name="Metal").select_option("gold")
    boxes = panel.get_by_role("textbox", name="Weight", exact=True)
    boxes.nth(1).fill("1")
    boxes.nth(1).press("Enter")
    boxes.nth(1).blur()
    until(lambda: session.state["large-box"].layers["specular"].weight == 1.0)
    eta = session.get("large-box.specular.eta")
    assert eta == next(metal.n for metal in METALS if metal.name == "gold")
    until(lambda: view_of(session).samples >= 29)
    image = rest(page, server)
    assert np.abs(shown(page) - as_displayed(image)).max() <= 2
    assert panel.get_by_role("combobox", name="Metal").input_value() == "gold"
    keep(page, "another-model")

    # The path tracer renders the new model: the gold reflects as warmly in both
    studio_of(session).pause(False)
    truth = session.truth.render(dict(session.state), "view", 64, 1)  # type: ignore[union-attr]
    emission = view_of(session).emission
    both = [(picture - emission).mean(axis=(0, 1)) for picture in (image, truth)]
    assert both[0] == pytest.approx(both[1], rel=0.05)

    # Undone step by step, the scene's own model is back
    for _ in range(3):
        page.keyboard.press("Control+z")
    until(lambda: not session.state["large-box"].replacements)
    panel.get_by_role("slider", name="Exponent").wait_for()
    until(lambda: view_of(session).samples >= 13)


def test_pictures_come_by_themselves_and_outlive_the_worker(
    page: Any, server: EditorServer, session: Session
) -> None:
    studio = studio_of(session)
    page.get_by_role("option", name="back").click()
    page.get_by_role("region", name="Material of back").wait_for()
    until(lambda: view_of(session).samples >= 13)
    as_it_is(page)
    first = shown(page)
    until(lambda: bool((shown(page) != first).any()))

    restarts = studio.restarts
    os.kill(studio._process.pid or 0, signal.SIGKILL)
    box = page.get_by_role("textbox", name="Color as sRGB hex").first
    box.fill("#204080")
    box.press("Enter")
    until(lambda: float(session.get("back.diffuse.color")[0]) < 0.1)  # type: ignore[index]
    # Another selection while there is nobody to trace it: the last picture stays
    page.get_by_role("option", name="floor").click()
    page.get_by_role("region", name="Material of floor").wait_for()
    assert shown(page).mean() > 10
    until(lambda: studio.restarts == restarts + 1 and view_of(session).samples >= 13)
    image = rest(page, server)
    assert np.abs(shown(page) - as_displayed(image)).max() <= 2
    studio.pause(False)


@pytest.mark.parametrize(("module", "later"), [("cli edit", 0.0), ("demo", 1.0)])
def test_the_command_ends_its_worker(tmp_path: Path, module: str, later: float) -> None:
    """By Ctrl+C as soon as the address is there, and while the command does nothing but wait."""
    if not Path("/proc/self/task").is_dir():
        pytest.skip("finding the worker needs /proc")
    command = [sys.executable, "-m", *f"burnish.app.{module} cornell-box".split()]
    no_display = {"DISPLAY": "", "WAYLAND_DISPLAY": ""}
    environment = {**os.environ, **no_display, "XDG_STATE_HOME": str(tmp_path)}
    errors = tmp_path / "errors"
    with (
        errors.open("w") as stderr,
        subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            start_new_session=True,
            env=environment,
        ) as process,
    ):
        assert process.stdout is not None
        assert any("http://" in line for line in process.stdout)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        assert children
        time.sleep(later)
        # As Ctrl+C in a terminal does, to the whole group
        os.killpg(process.pid, signal.SIGINT)
        try:
            assert process.wait(timeout=SECONDS) == 0
        finally:
            # Or else the end of the block would wait for it for ever
            process.kill()
    assert "Traceback" not in errors.read_text("utf-8")
    until(lambda: not any(Path(f"/proc/{child}").exists() for child in children))


def test_a_selection_that_ends_every_worker_is_given_up(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    studio = studio_of(session)
    receive = studio._receive

    def deadly(message: object) -> None:
        receive(message)
        if isinstance(message, Mapped):
            os.kill(studio._process.pid or 0, signal.SIGKILL)

    with monkeypatch.context() as patch:
        patch.setattr(studio, "_receive", deadly)
        session.select("left")
        with pytest.raises(SceneError, match="3 times"):
            until(session.ready)
    # Another one is traced as if nothing had happened
    session.select("right")
    assert session.frame().mean() > 0.01


TWO_VIEWS = """<scene version="3.0.0">
  <emitter type="constant"/>
  <shape type="sphere" id="ball"><bsdf type="roughplastic"/></shape>
  <sensor type="perspective" id="front">
    <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="24"/>
      <integer name="height" value="24"/></film>
  </sensor>
  <sensor type="perspective" id="side">
    <transform name="to_world"><lookat origin="4, 0, 0" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="24"/>
      <integer name="height" value="24"/></film>
  </sensor>
</scene>"""


def test_views_that_are_looked_at_get_the_samples(tmp_path: Path) -> None:
    (tmp_path / "two.xml").write_text(TWO_VIEWS, "utf-8")
    with burnish.edit(tmp_path / "two.xml") as live:
        front, side = live.views["front"], live.views["side"]
        assert isinstance(front, LiveView)
        assert isinstance(side, LiveView)
        side.watch(True)
        live.select("ball")
        live.frame("side")
        until(lambda: side.samples >= 100)
        assert 0 < front.samples < side.samples / 4
        side.watch(False)
        front.watch(True)
        until(lambda: front.samples > side.samples)
