"""A bake that is cut off keeps its tiles and goes on to the same bundle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import burnish
from burnish.app.progress import progress_bar
from burnish.core.errors import InvalidValue
from burnish.store.writer import partial_path

BAKE = """
import sys
import burnish.precompute.plan as plan
plan.TILE_SIDES = (8,)
from burnish.app.cli import main
main(["bake", "cornell-box", "-o", "out.burnish", "--resolution", "24x24", "--series", "8,1",
      "--spp", "16", *sys.argv[1:]])
"""
"""The bake of the command line in nine tiles."""


def finish(cwd: Path, *options: str) -> None:
    """Run the bake to its end."""
    process = start(cwd, *options)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err


def start(cwd: Path, *options: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", BAKE, *options], cwd=cwd, stderr=subprocess.PIPE, text=True
    )


def cut_off(cwd: Path, how: signal.Signals) -> tuple[int, str]:
    """Start the bake and send a signal once it has a tile: exit code and stderr."""
    process = start(cwd)
    first = partial_path(cwd / "out.burnish") / "views" / "view" / "0"
    deadline = time.monotonic() + 120
    while not first.exists():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline
        time.sleep(0.01)
    os.kill(process.pid, how)
    _, err = process.communicate(timeout=60)
    return process.returncode, err


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_bake_goes_on(tmp_path: Path, how: signal.Signals) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    whole.mkdir()
    cut.mkdir()
    finish(whole)
    code, err = cut_off(cut, how)
    if how is signal.SIGINT:
        assert code == 130
        assert "Traceback" not in err
        assert "--resume" in err.splitlines()[-1]
    assert not (cut / "out.burnish").exists()
    kept = partial_path(cut / "out.burnish") / "views" / "view" / "0"
    before = kept.stat().st_mtime_ns
    finish(cut, "--resume")
    assert (cut / "out.burnish" / "views" / "view" / "0").stat().st_mtime_ns == before
    assert not partial_path(cut / "out.burnish").exists()
    frames = [burnish.edit(folder / "out.burnish").frame() for folder in (whole, cut)]
    # The same seeds trace the same paths; scattered sums differ in their order alone
    np.testing.assert_allclose(frames[0], frames[1], rtol=2e-3, atol=1e-4)


def looped(error: BaseException) -> None:
    """Raise as Dr.Jit does for what is raised inside a loop that it traces."""
    with progress_bar("loop"):
        raise RuntimeError("dr.while_loop(): encountered an exception") from error


def test_ctrl_c_inside_a_traced_loop_is_an_interruption() -> None:
    with pytest.raises(KeyboardInterrupt):
        looped(KeyboardInterrupt())
    with pytest.raises(RuntimeError):
        looped(ValueError("another one"))


def test_a_bake_is_not_resumed_with_other_settings(tmp_path: Path) -> None:
    scene = burnish.load("cornell-box", resolution=(8, 8))

    def stop(fraction: float, what: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        burnish.bake(scene, tmp_path / "out.burnish", series=(8, 1), spp=4, progress=stop)
    for settings in (
        {"series": (8, 1, 1)},
        {"bins": {"floor": 4}},
        {"spp": 64},
        {"seed": 5},
        {"mode": "direct"},
    ):
        with pytest.raises(InvalidValue, match="unfinished bake has"):
            burnish.bake(scene, tmp_path / "out.burnish", resume=True, **settings)
    other = burnish.load("cornell-box", resolution=(9, 8))
    with pytest.raises(InvalidValue, match="has changed"):
        burnish.bake(other, tmp_path / "out.burnish", resume=True)
    bundle = burnish.bake(scene, tmp_path / "out.burnish", resume=True, mode="baked")
    assert bundle.basis.series == (8, 1)
