"""A real browser, and the editor's page in it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from burnish.app.server import EditorServer, application
from tests.editor.browser import chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Headless Chromium, one for each module."""
    if not (application.STATIC / "index.html").exists():
        pytest.skip("the editor's page is not built: python client/build.py")
    with chromium() as running:
        yield running


@pytest.fixture
def page(browser: Any, server: EditorServer) -> Iterator[Any]:
    """The page of the module's `server`, showing a picture; no error in it may go unseen."""
    context = browser.new_context(
        viewport={"width": 1280, "height": 720}, accept_downloads=True, reduced_motion="reduce"
    )
    page = context.new_page()
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("console", lambda m: problems.append(m.text) if m.type == "error" else None)
    page.goto(server.url)
    page.get_by_text("Waiting for the first picture").wait_for(state="detached")
    yield page
    context.close()
    assert not problems
