"""Every example runs, and the demo too."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from burnish.app.pictures import read_picture

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

SMALL = {
    "before_and_after": ["out.png", "--side", "24", "--spp", "16"],
    "match_a_picture": ["out.png", "--side", "24", "--spp", "64"],
    "gallery": ["out.png", "--height", "16", "--spp", "4", "--only", "earrings"],
    "light_mix": ["out.png", "--width", "32", "--spp", "16"],
    "moving_lights": ["out.png", "--width", "24", "--spp", "16"],
    "painting": ["out.png", "--width", "32", "--spp", "16"],
    "own_model": ["out.png", "--side", "24", "--spp", "16"],
}
"""Arguments under which an example is quick."""


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example(path: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, path, *SMALL[path.stem]],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert read_picture(tmp_path / "out.png").mean() > 0.01


def test_demo(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "burnish.app.demo", "--bake", "--side", "32", "--spp", "16",
         "--truth-spp", "16"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    written = [line.strip() for line in done.stdout.splitlines() if line.endswith(".png")]
    assert len(written) == 5
    assert all((tmp_path / name).stat().st_size > 0 for name in written)
    # The same again, over what the first run left
    again = subprocess.run(
        [sys.executable, "-m", "burnish.app.demo", "--bake", "--side", "16", "--spp", "4",
         "--truth-spp", "4"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert again.returncode == 0, again.stderr
