"""Maps from a page: a picture in place of a parameter, laid and taken off."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from burnish.app.server import EditorServer, application
from burnish.session import Session
from tests.editor import worlds
from tests.editor.pages import Page

PATH = "floor.diffuse.color"
PLAIN = {
    "file": "", "channel": "", "scale": 1.0, "offset": 0.0, "repeat": [1.0, 1.0], "rotate": 0.0,
}  # fmt: skip


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[EditorServer]:
    (tmp_path / "index.html").write_text("<!doctype html><title>burnish</title>", "utf-8")
    monkeypatch.setattr(application, "STATIC", tmp_path)
    with EditorServer(worlds.session()) as running:
        yield running


def test_a_picture_is_put_on_laid_and_taken_off(server: EditorServer, tmp_path: Path) -> None:
    picture = tmp_path / "grey.png"
    Image.fromarray(np.full((2, 2, 3), 188, np.uint8)).save(picture)
    session: Session = server.engine.session
    own = session.get(PATH)
    with Page(server) as page:
        page.picture()
        page.send("SetMap", path=PATH, file=str(picture), map=PLAIN)
        state = page.message("State", revision=1)
        layer = state["materials"]["floor"]["layers"]["diffuse"]
        assert layer["maps"]["color"] == {**PLAIN, "file": picture.as_posix()}
        assert layer["values"]["color"] == [1.0, 1.0, 1.0]
        lies = {**PLAIN, "scale": 0.5, "offset": 0.25, "repeat": [3.0, 2.0], "rotate": 30.0}
        page.send("SetMap", path=PATH, file=None, map=lies)
        state = page.message("State", revision=2)
        shown = state["materials"]["floor"]["layers"]["diffuse"]["maps"]["color"]
        assert shown["file"] == picture.as_posix()
        for name in ("scale", "offset", "repeat", "rotate"):
            np.testing.assert_allclose(shown[name], lies[name])
        page.send("ClearMap", path=PATH)
        state = page.message("State", revision=3)
        assert state["materials"]["floor"]["layers"]["diffuse"]["maps"] == {}
        np.testing.assert_allclose(
            session.get(PATH), 0.5 * ((188 / 255 + 0.055) / 1.055) ** 2.4 + 0.25, rtol=1e-3
        )
        for revision in (4, 5, 6):
            page.send("Undo")
            page.message("State", revision=revision)
        assert session.get(PATH) == own
        wrong = page.send("SetMap", path=PATH, file=str(tmp_path / "nowhere.png"), map=PLAIN)
        assert "nowhere.png" in page.message("Refused", seq=wrong)["text"]


def test_a_page_that_leaves_a_sheared_map_where_it_lies_keeps_the_shear(
    server: EditorServer, tmp_path: Path
) -> None:
    picture = tmp_path / "grey.png"
    Image.fromarray(np.full((2, 2, 3), 188, np.uint8)).save(picture)
    session: Session = server.engine.session
    sheared = (1.7, 0.3, 0.1, 0.4, 0.9, -0.2)
    session.set_map(PATH, picture, transform=sheared)
    with Page(server) as page:
        state = page.message("State", revision=1)
        shown = state["materials"]["floor"]["layers"]["diffuse"]["maps"]["color"]
        page.send("SetMap", path=PATH, file=None, map={**shown, "scale": 0.5})
        page.message("State", revision=2)
    image = session.map_of(PATH)
    assert image is not None
    assert image.scale == 0.5
    assert image.transform == sheared
