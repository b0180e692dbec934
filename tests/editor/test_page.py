"""The editor in a browser: what a person does, and that the screen shows what the engine says."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from burnish.app.server import EditorServer
from burnish.runtime.tonemap import OPERATORS, ToneMap
from burnish.session import Session
from tests.editor import worlds
from tests.editor.browser import keep, pixels

WIDTH, HEIGHT = 160, 112
EXPONENT = "ball.specular.exponent"


@pytest.fixture
def session() -> Session:
    return worlds.session(views=2, truth=True)


@pytest.fixture
def server(session: Session, tmp_path: Path) -> Iterator[EditorServer]:
    with EditorServer(session, autosave=tmp_path / "autosave.json") as running:
        yield running


def settled(page: Any, server: EditorServer) -> np.ndarray:
    """Wait until the engine's picture is on the screen, and return it: float32 linear RGB."""
    engine, quiet, before = server.engine, 0, -1
    while quiet < 3:
        page.wait_for_function("() => new Promise(done => setTimeout(() => done(true), 60))")
        idle = engine.call(lambda: not any(box.busy for box in engine.pages.boxes)).result(20.0)
        same = engine.session.revision == before
        quiet, before = quiet + 1 if idle and same else 0, engine.session.revision
    return engine.call(lambda: engine.session.frame("front")).result(20.0)


def picture(page: Any) -> np.ndarray:
    """The picture's pixels one to one, as they are on the screen."""
    page.keyboard.press("1")
    page.mouse.move(2, 2)
    page.wait_for_timeout(200)
    box = page.locator(".view canvas").first.bounding_box()
    x = box["x"] + round((box["width"] - WIDTH) / 2)
    y = box["y"] + round((box["height"] - HEIGHT) / 2)
    return pixels(page, x, y, WIDTH, HEIGHT)


def assert_shows(page: Any, image: np.ndarray, tone: ToneMap | None = None) -> np.ndarray:
    """The screen shows the image, within what float16 and eight bits can hold."""
    shown = picture(page).astype(int)
    expected = (tone or ToneMap()).to_bytes(image.astype(np.float16).astype(np.float32))
    difference = np.abs(shown - expected.astype(int))
    assert difference.max() <= 2
    assert (difference > 1).mean() < 0.01
    return shown


def point(page: Any, x: int, y: int) -> tuple[float, float]:
    """Where on the screen the picture's pixel lies while the picture is fitted."""
    page.keyboard.press("f")
    box = page.locator(".view canvas").first.bounding_box()
    scale = min(box["width"] / WIDTH, box["height"] / HEIGHT)
    scale = np.floor(scale) if scale > 2 else scale
    left = box["x"] + round((box["width"] - WIDTH * scale) / 2)
    top = box["y"] + round((box["height"] - HEIGHT * scale) / 2)
    return left + (x + 0.5) * scale, top + (y + 0.5) * scale


def drag(page: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(*end, steps=12)
    page.mouse.up()


def slider(page: Any, label: str) -> tuple[float, float, float]:
    """Left end, width and height of the middle of a slider's track."""
    box = page.get_by_role("slider", name=label, exact=True).first.bounding_box()
    return box["x"], box["width"], box["y"] + box["height"] / 2


def test_open_select_drag_undo_reload(page: Any, server: EditorServer, session: Session) -> None:
    keep(page, "opened")
    first = settled(page, server)
    assert_shows(page, first)

    # Click the ball: the list, the panel and the session agree on what is selected.
    page.mouse.click(*point(page, 80, 50))
    page.get_by_role("region", name="Material of ball").wait_for()
    assert page.get_by_role("option", name="ball").get_attribute("aria-selected") == "true"
    assert session.selected == ("ball",)
    page.locator(".ball img").wait_for()
    keep(page, "selected")

    # Drag a slider: one step of undo, and the screen shows the session's frame.
    left, width, y = slider(page, "Exponent")
    drag(page, (left + 0.5 * width, y), (left + 0.15 * width, y))
    edited = settled(page, server)
    assert len(session.history[0]) == 1
    assert session.get(EXPONENT) < 30.0
    assert np.abs(edited - first).max() > 0.02
    assert_shows(page, edited)
    keep(page, "slider")

    # Drag a point of the curve.
    handle = page.locator('.layer:has-text("specular") [data-point="3"]').bounding_box()
    x, y = handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2
    drag(page, (x, y), (x + 3, y - 45))
    curved = settled(page, server)
    curve = session.state["ball"].layers["specular"].curve
    assert curve is not None
    assert max(v[0] for v in curve.values) > 1.05
    assert len(session.history[0]) == 2
    assert np.abs(curved - edited).max() > 0.005
    assert_shows(page, curved)
    keep(page, "curve")

    # Undo both; then reload, and redo: nothing was lost with the page.
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    assert_shows(page, settled(page, server))
    assert session.history[1] == 0
    page.keyboard.press("Control+y")
    assert_shows(page, settled(page, server))
    page.reload()
    page.get_by_text("Waiting for the first picture").wait_for(state="detached")
    page.get_by_role("region", name="Material of ball").wait_for()
    assert_shows(page, settled(page, server))
    assert page.locator(".step[aria-current]").inner_text().startswith(f"Set {EXPONENT}")


def test_display_agrees_with_the_tone_maps_of_saved_pictures(
    page: Any, server: EditorServer
) -> None:
    image = settled(page, server)
    exposure = page.get_by_role("textbox", name="Exposure (stops)")
    exposure.fill("0.75")
    exposure.press("Enter")
    exposure.blur()
    for operator in OPERATORS:
        page.get_by_role("combobox", name="Tone mapping").select_option(operator)
        assert_shows(page, image, ToneMap(operator, exposure=0.75))


def test_hover_outlines_and_tells_the_pixel(page: Any, server: EditorServer) -> None:
    image = settled(page, server)
    page.mouse.move(*point(page, 80, 50))
    page.wait_for_timeout(300)
    told = page.locator(".probe").inner_text()
    assert "80, 50" in told
    assert "ball" in told
    value = float(np.float16(image[50, 80, 0]))
    assert f"{value:.4g}"[:5] in told
    assert page.get_by_role("option", name="ball").get_attribute("class").endswith("hovered")


def test_layers_colours_and_number_boxes(page: Any, server: EditorServer, session: Session) -> None:
    page.get_by_role("option", name="wall").click()
    panel = page.get_by_role("region", name="Material of wall")
    panel.wait_for()
    panel.get_by_role("textbox", name="Color as sRGB hex").first.fill("#ff8000")
    panel.get_by_role("textbox", name="Color as sRGB hex").first.press("Enter")
    settled(page, server)
    assert session.get("wall.diffuse.color") == pytest.approx((1.0, 0.2158605, 0.0), abs=1e-5)

    box = panel.get_by_role("textbox", name="Exponent")
    box.fill("123")
    box.press("Enter")
    settled(page, server)
    assert session.get("wall.specular.exponent") == 123.0
    box.fill("1e12")
    box.press("Enter")
    settled(page, server)
    maximum = session.material("wall").layer("specular").model.parameters[1].maximum  # type: ignore[union-attr]
    assert session.get("wall.specular.exponent") == maximum

    panel.get_by_text("Exponent").dblclick()
    settled(page, server)
    assert session.get("wall.specular.exponent") == 60.0

    panel.get_by_role("switch", name="Layer diffuse on").set_checked(False, force=True)
    settled(page, server)
    assert not session.state["wall"].layers["diffuse"].enabled
    panel.get_by_role("button", name="Solo").first.click()
    settled(page, server)
    states = session.state["wall"].layers
    assert (states["diffuse"].enabled, states["specular"].enabled) == (True, False)

    panel.get_by_role("button", name="Color, #ff8000").click()
    page.get_by_role("group", name="Color picker").wait_for()
    keep(page, "colour")
    pad = page.get_by_role("slider", name="Saturation and value").bounding_box()
    drag(page, (pad["x"] + 5, pad["y"] + 5), (pad["x"] + 60, pad["y"] + 40))
    settled(page, server)
    assert session.get("wall.diffuse.color") != pytest.approx((1.0, 0.2158605, 0.0), abs=1e-3)


def test_mix_panel_and_two_views(page: Any, server: EditorServer, session: Session) -> None:
    page.get_by_role("button", name="side").click()
    page.get_by_role("tab", name="Mix").click()
    page.get_by_text("Waiting for the first picture").wait_for(state="detached")
    page.wait_for_timeout(250)
    before = page.locator(".view canvas").nth(1).screenshot()
    floor = page.get_by_role("region", name="floor")
    floor.get_by_role("textbox", name="Color as sRGB hex").first.fill("#208020")
    floor.get_by_role("textbox", name="Color as sRGB hex").first.press("Enter")
    settled(page, server)
    page.wait_for_timeout(250)
    assert page.locator(".view canvas").nth(1).screenshot() != before
    assert session.get("floor.diffuse.color")[1] > 0.2  # type: ignore[index]
    keep(page, "mix")


def test_keep_a_look_and_compare(page: Any, server: EditorServer, session: Session) -> None:
    page.get_by_role("option", name="ball").click()
    first = settled(page, server)
    page.keyboard.press("k")
    page.get_by_role("button", name="Restore Look 1").wait_for()
    session_value = session.get(EXPONENT)
    left, width, y = slider(page, "Exponent")
    drag(page, (left + 0.5 * width, y), (left + 0.1 * width, y))
    second = settled(page, server)

    # Right of the wipe lies the kept look, left of it the edited picture.
    page.get_by_role("button", name="A/B").click()
    page.wait_for_timeout(300)
    shown = picture(page).astype(int)
    half = WIDTH // 2
    tone = ToneMap()
    assert np.abs(shown[:, : half - 2] - tone.to_bytes(second)[:, : half - 2]).max() <= 2
    assert np.abs(shown[:, half + 2 :] - tone.to_bytes(first)[:, half + 2 :]).max() <= 2
    page.keyboard.press("f")
    keep(page, "wipe")

    page.get_by_role("button", name="Restore Look 1").click()
    settled(page, server)
    assert session.get(EXPONENT) == session_value

    page.get_by_role("combobox", name="Samples per pixel of the reference").select_option("16")
    page.get_by_role("button", name="Path-trace").click()
    page.get_by_text("FLIP").wait_for()
    page.wait_for_function(
        "() => [...document.querySelectorAll('.compare dd')].every(d => d.innerText !== '–')"
    )
    page.get_by_role("radio", name="Error").click()
    keep(page, "reference")


def test_a_reference_of_a_rectangle(page: Any, server: EditorServer, session: Session) -> None:
    image = settled(page, server)
    part = page.get_by_role("combobox", name="Part of the picture for the reference")
    part.select_option("rectangle")
    trace = page.get_by_role("button", name="Path-trace")
    assert trace.is_disabled()
    # Too small a rectangle is refused in words; the next one is taken
    drag(page, point(page, 60, 30), point(page, 66, 60))
    page.get_by_text("needs at least 16").wait_for()
    part.select_option("whole")
    part.select_option("rectangle")
    drag(page, point(page, 60, 30), point(page, 100, 70))
    page.locator(".marking").wait_for()
    assert session.selected == ()
    keep(page, "rectangle")
    page.get_by_role("combobox", name="Samples per pixel of the reference").select_option("16")
    trace.click()
    page.get_by_text("40 × 40 pixels").wait_for()
    page.wait_for_function(
        "() => document.querySelectorAll('.compare dd').length === 4 &&"
        " [...document.querySelectorAll('.compare dd')].every(d => d.innerText !== '–')"
    )
    # The other picture is there inside the rectangle, the edited one around it
    page.get_by_role("radio", name="Other").click()
    page.wait_for_timeout(300)
    shown = picture(page).astype(int)
    expected = ToneMap().to_bytes(image).astype(int)
    outside = np.ones((HEIGHT, WIDTH), bool)
    outside[28:74, 58:104] = False
    assert np.abs(shown - expected)[outside].max() <= 2
    assert np.abs(shown - expected)[34:68, 64:98].max() > 2
    page.get_by_role("radio", name="Edit").click()
    part.select_option("visible")
    trace.click()
    page.get_by_text("160 × 112 pixels").wait_for()


def test_the_viewing_angle_has_a_curve_of_its_own(
    page: Any, server: EditorServer, session: Session
) -> None:
    page.get_by_role("option", name="ball").click()
    panel = page.get_by_role("region", name="Material of ball")
    panel.get_by_role("button", name="Viewing angle").first.click()
    box = panel.get_by_role("group", name="over the viewing angle")
    box.wait_for()
    first = settled(page, server)
    box.scroll_into_view_if_needed()
    handle = box.locator('[data-point="4"]').bounding_box()
    x, y = handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2
    drag(page, (x, y), (x, y + 60))
    edited = settled(page, server)
    curve = session.state["ball"].layers["diffuse"].outgoing_curve
    assert curve is not None
    assert min(v[1] for v in curve.values) < 0.8
    assert np.abs(edited - first).max() > 0.01
    assert_shows(page, edited)
    panel.get_by_text("not reciprocal").wait_for()
    keep(page, "viewing-angle")
    page.keyboard.press("Control+z")
    panel.get_by_text("not reciprocal").wait_for(state="detached")
    assert_shows(page, settled(page, server))


def test_a_bake_says_why_its_models_are_fixed(page: Any) -> None:
    page.get_by_role("option", name="ball").click()
    chooser = page.get_by_role("combobox", name="Model of specular")
    chooser.wait_for()
    assert chooser.is_disabled()
    assert "open the scene itself" in chooser.get_attribute("title")
    assert chooser.input_value() == "blinn-phong"


def test_the_keyboard_reaches_and_works_every_part(
    page: Any, server: EditorServer, session: Session
) -> None:
    def focused() -> str:
        return str(
            page.evaluate(
                "() => document.activeElement.getAttribute('aria-label')"
                " || document.activeElement.textContent.trim()"
            )
        )

    page.locator("body").press("Tab")
    seen = []
    for _ in range(120):
        seen.append(focused())
        if seen[-1] == "ball":
            page.keyboard.press("Enter")
            page.get_by_role("region", name="Material of ball").wait_for()
        if seen[-1] == "Exponent":
            break
        page.keyboard.press("Tab")
    # The order is that of the page: bar, objects, comparing, history, picture, material
    wanted = ["Search objects", "ball", "Keep look", "As loaded", "Picture of view front"]
    wanted += ["Incidence angle of the polar plot", "Layer diffuse on", "Exponent"]
    assert [name for name in seen if name in wanted] == wanted
    before = float(session.get(EXPONENT))  # type: ignore[arg-type]
    page.keyboard.press("ArrowRight")
    settled(page, server)
    assert float(session.get(EXPONENT)) > before  # type: ignore[arg-type]
    # A point of the curve, then the picture itself
    page.locator('.layer:has-text("specular") [data-point="2"]').focus()
    page.keyboard.press("ArrowUp")
    page.wait_for_function(
        "() => [...document.querySelectorAll('.curve .tools button')]"
        ".some(b => b.innerText === 'Remove' && !b.disabled)"
    )
    settled(page, server)
    assert session.state["ball"].layers["specular"].curve is not None
    page.locator(".view canvas").first.focus()
    zoom = page.locator(".statusbar").get_by_text("%", exact=False).last.inner_text()
    page.keyboard.press("+")
    page.wait_for_timeout(200)
    assert page.locator(".statusbar").get_by_text("%", exact=False).last.inner_text() != zoom
    page.keyboard.press("Escape")
    page.get_by_text("Click an object in the picture").wait_for()
    assert session.selected == ()


def test_files(page: Any, server: EditorServer, session: Session, tmp_path: Path) -> None:
    session_image = settled(page, server)
    page.get_by_role("option", name="ball").click()
    box = page.get_by_role("textbox", name="Exponent")
    box.fill("9")
    box.press("Enter")
    box.blur()
    settled(page, server)
    assert page.title().startswith("•")
    with page.expect_download() as saved:
        page.keyboard.press("Control+s")
    edits = tmp_path / "edits.json"
    saved.value.save_as(edits)
    assert json.loads(edits.read_text("utf-8"))["objects"].keys() == {"ball"}
    settled(page, server)
    assert not page.title().startswith("•")

    page.keyboard.press("Control+z")
    with page.expect_download() as png:
        page.get_by_role("button", name="PNG").click()
    place = tmp_path / "picture.png"
    png.value.save_as(place)
    from PIL import Image

    with Image.open(place) as image:
        array = np.asarray(image.convert("RGB")).astype(int)
    assert array.shape == session_image.shape
    expected = ToneMap().to_bytes(server.engine.call(lambda: session.frame("front")).result(20.0))
    assert np.abs(array - expected).max() <= 2

    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Open").click()
    chooser.value.set_files(edits)
    page.wait_for_timeout(300)
    settled(page, server)
    assert session.get(EXPONENT) == 9.0


def test_a_lost_server_is_said_and_found_again(browser: Any, session: Session) -> None:
    server = EditorServer(session).start()
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    try:
        page.goto(server.url)
        page.get_by_text("Waiting for the first picture").wait_for(state="detached")
        server.close()
        page.get_by_text("Connection lost").wait_for()
        again = EditorServer(session, port=server.port)
        again.close()
    finally:
        page.close()
        server.close()


def test_keys_help_and_panels(page: Any) -> None:
    page.keyboard.press("?")
    page.get_by_role("dialog", name="Keys").wait_for()
    keep(page, "keys")
    page.keyboard.press("Escape")
    page.get_by_role("dialog", name="Keys").wait_for(state="hidden")
    page.keyboard.press("h")
    page.locator("aside.left").wait_for(state="hidden")
    page.keyboard.press("h")
    page.locator("aside.left").wait_for(state="visible")


def test_every_control_has_a_name(page: Any) -> None:
    page.get_by_role("option", name="ball").click()
    page.locator(".ball img").wait_for()
    nameless = page.evaluate(
        """() => [...document.querySelectorAll('button, input, select, [role=slider]')]
             .filter(e => !(e.getAttribute('aria-label') || e.textContent.trim()
                            || e.closest('label') || e.getAttribute('title')))
             .map(e => e.outerHTML)"""
    )
    assert nameless == []


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (3840, 2160)])
def test_readable_on_small_and_large_screens(
    browser: Any, server: EditorServer, width: int, height: int
) -> None:
    page = browser.new_page(viewport={"width": width, "height": height})
    try:
        page.goto(server.url)
        page.get_by_text("Waiting for the first picture").wait_for(state="detached")
        page.get_by_role("option", name="ball").click()
        page.locator(".curve svg").wait_for()
        cut = page.evaluate(
            """() => [...document.querySelectorAll('.right button, .left button, .topbar button')]
                 .filter(e => { const b = e.getBoundingClientRect();
                                const p = e.closest('aside, header').getBoundingClientRect();
                                return b.right > p.right + 1 || b.left < p.left - 1; })
                 .map(e => e.textContent)"""
        )
        assert cut == []
        size = page.evaluate("() => parseFloat(getComputedStyle(document.body).fontSize)")
        assert size >= (12 if width < 2000 else 18)
        page.wait_for_timeout(300)
        keep(page, f"screen-{width}")
    finally:
        page.close()
