"""A real browser for the editor's tests: Debian's Chromium, headless, WebGL in software."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

ARGUMENTS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--force-color-profile=srgb",
]
ARTEFACTS = Path(__file__).resolve().parent.parent.parent / "test-output" / "editor"


def program() -> str:
    """Where Chromium is; the test is skipped, saying why, where there is none."""
    found = os.environ.get("BURNISH_CHROMIUM") or next(
        filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
    )
    if found is None:
        pytest.skip("browser tests need Chromium: apt-get install chromium")
    return found


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser; the test is skipped, saying why, where there is none."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="browser tests need playwright: pip install playwright"
    )
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program(), args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


def keep(page: Any, name: str) -> None:
    """Leave a screenshot of the page as an artefact."""
    ARTEFACTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(ARTEFACTS / f"{name}.png"))


def pixels(page: Any, x: float, y: float, width: int, height: int) -> np.ndarray:
    """What the screen shows of a rectangle: uint8 [height, width, 3]."""
    box = {"x": x, "y": y, "width": width, "height": height}
    with Image.open(io.BytesIO(page.screenshot(clip=box))) as image:
        return np.asarray(image.convert("RGB"))
