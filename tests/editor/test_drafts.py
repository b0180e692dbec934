"""The editor's pictures: drafts while something is dragged, the frame itself at rest."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from burnish.app.server import EditorServer, application
from burnish.app.server.frames import Frame, Kind
from burnish.core.types import Float32
from burnish.runtime import drafts
from burnish.runtime.drafts import Choice
from burnish.session import Session
from burnish.transport.basis import Basis
from tests.editor.pages import Page
from tests.runtime.worlds import glossy, matte, random_world

PATH = "box.specular.exponent"


@pytest.fixture(autouse=True)
def page_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A page to serve."""
    (tmp_path / "index.html").write_text("<!doctype html><title>burnish</title>", "utf-8")
    monkeypatch.setattr(application, "STATIC", tmp_path)


def test_what_rests_is_the_frame_and_what_is_dragged_a_draft(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measured = drafts.measured

    def told(*arguments: object) -> Choice:
        return replace(measured(*arguments), plain=1.0, incremental=0.1)  # type: ignore[arg-type]

    monkeypatch.setattr(drafts, "measured", told)
    basis = Basis((glossy("box", 128), matte("floor")), (128, 1), indirect_bins=2)
    session = Session({"front": random_world(basis)[0]}, name="drafted")
    drawn = 0
    draft = session.draft

    def counting(view: str | None = None) -> object:
        nonlocal drawn
        found = draft(view)
        drawn += not found.frame
        return found

    monkeypatch.setattr(session, "draft", counting)
    with EditorServer(session) as server, Page(server) as page:
        page.picture()
        page.send("Select", objects=["box"])
        # A selection shows what was shown; a pause measures and prepares
        end = time.monotonic() + 60.0
        while not server.engine.call(session.draft_choices).result(30.0):
            assert time.monotonic() < end, "nothing was measured in a minute's pause"
            time.sleep(0.02)
        # A drag that a stalled machine takes for a pause is made again
        for revision in range(1, 11):
            page.send("SetValue", path=PATH, value=700.0 - 20.0 * revision)
            page.message("State", revision=revision)
            expected = server.engine.call(lambda: session.frame()).result(30.0)
            page.until(partial(_shows, expected, revision), 60.0)
            if drawn:
                break
        assert drawn > 0


def test_drafts_that_cannot_be_prepared_end_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    basis = Basis((glossy("box", 16), matte("floor")), (16, 1), indirect_bins=2)
    session = Session({"front": random_world(basis)[0]}, name="drafted")
    tried = threading.Event()

    def refuse(view: str | None = None) -> None:
        tried.set()
        raise MemoryError

    monkeypatch.setattr(session, "prepare_drafts", refuse)
    with EditorServer(session) as server, Page(server) as page:
        page.picture()
        assert tried.wait(60.0)
        page.send("SetValue", path=PATH, value=500.0)
        page.message("State", revision=1)


def _shows(expected: Float32, revision: int, item: object) -> bool:
    if not isinstance(item, Frame) or item.kind != Kind.PICTURE or item.revision < revision:
        return False
    shown = item.pixels.view(np.float16)
    return bool(np.array_equal(shown, expected.astype(np.float16)))
