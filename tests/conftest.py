"""What all tests share: the folder of real assets, and properties without deadlines."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# A slow machine fails no property
settings.register_profile(
    "burnish", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)
settings.load_profile("burnish")

# What a shell runs in the background ignores Ctrl+C, and so would the commands under test
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def assets() -> Path:
    """The folder of third-party scenes and data; the test is skipped where it is absent."""
    folder = Path(os.environ.get("BURNISH_ASSETS", REPOSITORY.parent / "shared" / "assets"))
    if not folder.is_dir():
        pytest.skip(f"no assets at {folder}; set BURNISH_ASSETS to their folder")
    return folder
