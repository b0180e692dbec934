"""What all tests share: the folder of real assets, and marks by what a machine lacks."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def assets() -> Path:
    """The folder of third-party scenes and data; the test is skipped where it is absent."""
    folder = Path(os.environ.get("BURNISH_ASSETS", REPOSITORY.parent / "shared" / "assets"))
    if not folder.is_dir():
        pytest.skip(f"no assets at {folder}; set BURNISH_ASSETS to their folder")
    return folder
