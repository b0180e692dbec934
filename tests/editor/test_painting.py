"""Painting in the editor: messages without a browser, and a pen on the picture in a real one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from burnish.app.server import EditorServer
from burnish.session import Session
from tests.editor import worlds
from tests.editor.browser import keep
from tests.editor.pages import Page
from tests.editor.test_page import assert_shows, picture, point, settled

WIDTH, HEIGHT = 160, 112
SETTINGS = {
    "brush": "diffuse-color",
    "size": 8.0,
    "strength": 1.0,
    "falloff": 0.6,
    "color": [0.0, 0.2, 0.9],
    "amount": 0.0,
    "layer": "",
    "source": None,
}


@pytest.fixture
def session() -> Session:
    return worlds.session()


@pytest.fixture
def server(session: Session, tmp_path: Path) -> Iterator[EditorServer]:
    with EditorServer(session, autosave=tmp_path / "autosave.json") as running:
        yield running


def begin(page: Page, **changes: Any) -> int:
    return page.send(
        "PaintBegin",
        view="front",
        settings={**SETTINGS, **changes},
        every=False,
        straight=False,
    )


def test_a_stroke_grows_message_by_message(server: EditorServer, session: Session) -> None:
    with Page(server) as page:
        page.picture()
        begin(page)
        page.send("PaintTo", points=[[80.0, 50.0, 1.0]])
        page.message("State", position=1)
        first = server.engine.call(lambda: session.state["ball"].strokes).result(20.0)
        page.send("PaintTo", points=[[90.0, 52.0, 0.5], [95.0, 55.0, 1.0]])
        page.send("PaintEnd")
        page.send("PaintTo", points=[[20.0, 20.0, 1.0]])  # after the end: goes nowhere
        page.send("PaintWhole", settings={**SETTINGS, "brush": "blur", "amount": 0.1})
        page.message("Refused")  # nothing is selected
        page.send("Select", objects=["ball"])
        brushes = page.message("Brushes", object="ball")
        page.send("PaintWhole", settings={**SETTINGS, "brush": "blur", "amount": 0.1})
        page.message("State", position=2)
        assert brushes["painted"] == ["ball"]
        reasons = {item["name"]: item["reason"] for item in brushes["items"]}
        assert reasons["blur"] == ""
        assert "anisotropy" in reasons["stretch"]
    drawn, whole = session.state["ball"].strokes
    assert whole.everywhere
    assert drawn.dabs[: len(first[0].dabs)] == first[0].dabs
    assert len(drawn.dabs) > len(first[0].dabs)
    # The same as from Python, and one step
    twin = worlds.session()
    way = [(80.0, 50.0, 1.0), (90.0, 52.0, 0.5), (95.0, 55.0, 1.0)]
    twin.paint("diffuse-color", way, size=8, color=(0.0, 0.2, 0.9))
    assert twin.state["ball"].strokes == (drawn,)


def test_a_refused_stroke_leaves_nothing(server: EditorServer, session: Session) -> None:
    with Page(server) as page, Page(server, name="other") as other:
        page.picture()
        begin(page, brush="stretch")
        page.send("PaintTo", points=[[80.0, 50.0, 1.0]])
        assert "anisotropy" in page.message("Refused")["text"]
        page.send("PaintTo", points=[[81.0, 50.0, 1.0]])
        page.send("PaintEnd")
        begin(page, size=-1.0)
        assert "size" in page.message("Refused")["text"]
        # One pen at a time, and a page that goes takes its own away
        begin(page)
        page.send("PaintTo", points=[[80.0, 50.0, 1.0]])
        page.message("State", position=1)
        begin(other)
        assert "another page" in other.message("Refused")["text"]
        page.drop()
        end = time.monotonic() + 20.0
        while server.engine.call(lambda: len(server.engine.pages.boxes)).result(20.0) > 1:
            assert time.monotonic() < end
            time.sleep(0.02)
        begin(other, color=[1.0, 0.0, 0.0])
        other.send("PaintTo", points=[[84.0, 50.0, 1.0]])
        other.message("State", position=2)
    assert len(session.state["ball"].strokes) == 2


def stroke(page: Any, way: list[tuple[int, int]]) -> None:
    """Draw with the mouse through pixels of the picture."""
    page.mouse.move(*point(page, *way[0]))
    page.mouse.down()
    for place in way[1:]:
        page.mouse.move(*point(page, *place), steps=5)
    page.mouse.up()


def test_a_stroke_on_the_picture(page: Any, server: EditorServer, session: Session) -> None:
    page.mouse.click(*point(page, 80, 50))
    page.get_by_role("region", name="Material of ball").wait_for()
    first = settled(page, server)
    before = picture(page)
    page.get_by_role("tab", name="Paint").click()
    assert page.get_by_role("radio", name="Stretch").is_disabled()
    assert "anisotropy" in page.get_by_role("radio", name="Stretch").get_attribute("title")
    page.get_by_role("radio", name="Diffuse colour").click()
    box = page.get_by_role("textbox", name="Size (px)")
    box.fill("9")
    box.press("Enter")
    page.get_by_role("textbox", name="Brush colour as sRGB hex").fill("#1040e0")
    page.get_by_role("textbox", name="Brush colour as sRGB hex").press("Enter")

    page.evaluate("document.activeElement.blur()")

    # A bent stroke: one step, and the screen shows the session's frame
    way = [(70, 50), (80, 58), (92, 52)]
    stroke(page, way)
    painted = settled(page, server)
    keep(page, "painted")
    assert session.history == (["Diffuse colour on ball"], 1)
    assert session.selected == ("ball",)
    keep(page, "painted")
    after = assert_shows(page, painted)

    # Pixels near the stroke have changed, and no others but by the light that it throws
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    line = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise(way)])
    distance = np.hypot(x[..., None] - line[:, 0], y[..., None] - line[:, 1]).min(axis=2)
    ball = session.object_map("front") == worlds.NAMES.index("ball")
    seen = np.abs(after.astype(int) - before.astype(int)).max(axis=2)
    assert (seen[(distance < 4) & ball] > 10).all()
    # A pixel covers more of a surface that is turned away: nothing further than twice the size
    far = (distance > 18) | ~ball
    assert seen[far].max() <= 6
    canvas = session.surface("ball", "front").canvas
    moved = canvas.maps["diffuse", "color"].scale[:-1] != 1
    flat = (distance > 18).ravel()[session.surface("ball", "front").pixel]
    assert not moved[flat].any()
    assert moved.any()

    # Undo brings back the very picture
    page.keyboard.press("Control+z")
    assert settled(page, server).tobytes() == first.tobytes()
    np.testing.assert_array_equal(picture(page), before)

    # With Shift a straight line from the first point to the last; the keys change the size
    page.keyboard.press("]")
    page.keyboard.down("Shift")
    stroke(page, way)
    page.keyboard.up("Shift")
    settled(page, server)
    (drawn,) = session.state["ball"].strokes
    twin = worlds.session()
    ends = [point_of(page, way[0]), point_of(page, way[-1])]
    twin.paint("diffuse-color", ends, size=9 * 1.2, color=drawn.edits[0].value)
    wanted = twin.state["ball"].strokes[0].dabs
    for mine, theirs in ((drawn.dabs[0], wanted[0]), (drawn.dabs[-1], wanted[-1])):
        np.testing.assert_allclose(mine.position, theirs.position, atol=0.03)
    middle = np.array([dab.position for dab in drawn.dabs])
    chord = middle[-1] - middle[0]
    off = np.cross(middle - middle[0], chord / np.linalg.norm(chord))
    assert np.abs(off[:, 2]).max() < 0.03  # in the picture's plane
    assert drawn.dabs[0].radius == pytest.approx(wanted[0].radius, rel=1e-3)

    # The eraser on all of the object
    page.get_by_role("radio", name="Eraser").click()
    page.get_by_role("button", name="Erase all of the object").click()
    assert settled(page, server).tobytes() == first.tobytes()


def test_every_brush_changes_its_parameter_where_it_goes(
    page: Any, server: EditorServer, session: Session
) -> None:
    page.mouse.click(*point(page, 80, 50))
    page.get_by_role("region", name="Material of ball").wait_for()
    page.get_by_role("tab", name="Paint").click()
    surface = session.surface("ball", "front")
    y, x = np.divmod(surface.pixel, WIDTH)
    distance = np.hypot(x - 80, y - 50)
    near, far = distance < 3, distance > 18
    assert near.any()
    assert far.any()
    page.get_by_role("radio", name="Blur").click()
    box = page.get_by_role("textbox", name="Size (px)")
    box.fill("7")
    box.press("Enter")
    page.evaluate("document.activeElement.blur()")

    def moved(layer: str, parameter: str) -> np.ndarray:
        canvas = server.engine.call(lambda: session.surface("ball", "front").canvas).result(20.0)
        item = canvas.maps[layer, parameter]
        return (item.scale[:-1] != 1) | (item.shift[:-1] != 0).any(axis=1)

    for name, places in (
        ("Specular intensity", [("specular", "weight")]),
        ("Specular colour", [("specular", "color")]),
        ("Sharpen", [("specular", "exponent")]),
        ("Blur", [("specular", "exponent")]),
        ("Metallic-ness", [("specular", "weight"), ("diffuse", "weight")]),
        ("Diffuse colour", [("diffuse", "color")]),
    ):
        first = settled(page, server)
        page.get_by_role("radio", name=name).click()
        stroke(page, [(78, 50), (82, 50)])
        painted = settled(page, server)
        assert session.history[0] == [f"{name} on ball"]
        assert set(surface.canvas.maps) == set(places)
        for place in places:
            assert moved(*place)[near].all()
            assert not moved(*place)[far].any()
        assert (painted != first).any()
        if name != "Diffuse colour":
            page.keyboard.press("Control+z")
            assert settled(page, server).tobytes() == first.tobytes()

    # The clone stamp takes what is about the place of the Alt-click, and the eraser takes it off
    page.get_by_role("radio", name="Clone stamp").click()
    page.keyboard.down("Alt")
    page.mouse.click(*point(page, 80, 50))
    page.keyboard.up("Alt")
    below = np.hypot(x - 81, y - 63) < 3
    assert below.any()
    assert not moved("diffuse", "color")[below].any()
    stroke(page, [(80, 63), (82, 63)])
    settled(page, server)
    assert session.history[0][-1] == "Clone stamp on ball"
    assert moved("diffuse", "color")[below].all()
    page.get_by_role("radio", name="Eraser").click()
    box = page.get_by_role("textbox", name="Falloff")
    box.fill("0")
    box.press("Enter")
    page.evaluate("document.activeElement.blur()")
    stroke(page, [(80, 63), (82, 63)])
    settled(page, server)
    assert not moved("diffuse", "color")[below].any()


def point_of(page: Any, pixel: tuple[int, int]) -> tuple[float, float]:
    """The middle of a pixel, where the mouse goes."""
    return pixel[0] + 0.5, pixel[1] + 0.5
