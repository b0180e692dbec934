"""Live sessions in the hand: from a selection to its first picture, and frames while dragging.

python -m bench live-drag
"""

from __future__ import annotations

import json
import sys
import time
from itertools import cycle
from typing import Any

import numpy as np

import burnish
from bench.report import Goal, Report
from bench.timing import child
from burnish.app.live import LiveView
from burnish.session import Session

SCENE, OBJECT, OTHER = "cornell-box", "back", "floor"
"""The back wall covers the most of the picture, a quarter of it, and half with its light."""
PATH = f"{OBJECT}.specular.exponent"
PACE = 64.0
"""Frames a second that are asked for: a display's sixty, and some for those that come late."""


def run(quick: bool) -> Report:
    """At 512 × 512 pixels."""
    size, seconds = (256, 4.0) if quick else (512, 15.0)
    # The first process fills the cache of compiled kernels
    child("bench.live_drag", size, time.time())
    fresh, _ = child("bench.live_drag", size, time.time())
    with burnish.edit(SCENE, resolution=(size, size)) as session:
        session.set(f"{OBJECT}.specular.weight", 0.5)
        session.select(OBJECT)
        session.frame()
        cached = float(np.median([selection(session, name) for name in (OTHER, OBJECT) * 3]))
        settle(session)
        idle = pass_rate(session, seconds)
        intervals, dragged = drag(session, seconds)
        rows = view_of(session)
        share = rows.rows.pixel[~rows.rows.indirect & (rows.rows.object == index(session))]
        covered = len(np.unique(share)) / size**2
    late = float(np.percentile(intervals, 95)) * 1e3
    rate = len(intervals) / float(np.sum(intervals))
    return Report(
        name="live-drag",
        title="Live sessions while dragging",
        notes=(
            f"{SCENE}, {size} × {size} pixels, {OBJECT} (seen in {100 * covered:.0f} % of them) "
            f"with a glossy layer; {seconds:g} s of dragging its exponent, {PACE:g} frames a "
            "second asked for, passes going on in the worker. Idle: the same time without frames. "
            "Fresh: from a new process's first line to the first editable picture, kernels in "
            "Dr.Jit's cache."
        ),
        rows=[
            {
                "select s": cached,
                "fresh process s": fresh["seconds"],
                "frames/s": rate,
                "p95 interval ms": late,
                "passes kept %": 100 * dragged / idle,
            }
        ],
        goals=[
            Goal("selection to first picture, s", cached, 1.5),
            Goal("fresh process to first picture, s", fresh["seconds"], 5.0),
            Goal("engine frames a second while dragging", rate, 60.0, at_least=True),
            Goal("p95 interval, ms", late, 33.0),
            Goal("passes kept while dragging, %", 100 * dragged / idle, 50.0, at_least=True),
        ],
    )


def view_of(session: Session) -> LiveView:
    """The only view."""
    view = next(iter(session.views.values()))
    assert isinstance(view, LiveView)
    return view


def index(session: Session) -> int:
    """The place of the dragged object in the basis."""
    return view_of(session).basis.index(OBJECT)


def selection(session: Session, name: str) -> float:
    """Seconds from a selection to its first picture."""
    start = time.perf_counter()
    session.select(name)
    session.frame()
    return time.perf_counter() - start


def settle(session: Session) -> None:
    """Wait until the first, small passes are over."""
    while view_of(session).samples < 64:
        time.sleep(0.05)


def pass_rate(session: Session, seconds: float) -> float:
    """Samples per pixel a second with nothing else going on, between two publications."""
    return _rate(session, seconds, lambda: time.sleep(0.02))


def drag(session: Session, seconds: float) -> tuple[np.ndarray, float]:
    """Frames at a display's pace: the seconds between them, and the pass rate meanwhile."""
    values, times = cycle(np.linspace(20.0, 800.0, 157).tolist()), [time.perf_counter()]
    due = times[0]

    def frame() -> None:
        nonlocal due
        # One that is late is made up for, no more than one
        due = max(due + 1.0 / PACE, time.perf_counter() - 1.0 / PACE)
        time.sleep(max(due - time.perf_counter(), 0.0))
        session.set(PATH, next(values))
        session.frame()
        times.append(time.perf_counter())

    with session.gesture():
        rate = _rate(session, seconds, frame)
    return np.diff(times), rate


def _rate(session: Session, seconds: float, step: Any) -> float:
    view = view_of(session)
    before = view.samples
    while view.samples == before:
        step()
    start, first = time.perf_counter(), view.samples
    last = start, first
    while time.perf_counter() < start + seconds or last[1] == first:
        step()
        if view.samples != last[1]:
            last = time.perf_counter(), view.samples
    return (last[1] - first) / (last[0] - start)


def main() -> None:
    """Open a scene, select, show; prints the seconds since the time that it was started at."""
    size, start = int(sys.argv[1]), float(sys.argv[2])
    with burnish.edit(SCENE, resolution=(size, size)) as session:
        session.select(OBJECT)
        session.frame()
        spent = time.time() - start
    print(json.dumps({"seconds": spent}))


if __name__ == "__main__":
    main()
