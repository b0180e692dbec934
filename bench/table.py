"""The 2008 paper's Table 2, ours: bakes of its series, their sizes, freezing and frames."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.report import Goal, Report
from bench.timing import child

MEMORY_GB = 8.0


@dataclass(frozen=True)
class Row:
    """A line of the table; edited: the object whose freezing and frames are timed.

    paper: B/px, seconds of freezing and frames per second of 2008, Table 2. goals: seconds of
    a freeze from memory and cold, and frames per second; None where nothing was promised.
    """

    scene: str
    resolution: tuple[int, int]
    series: tuple[int, ...]
    edited: str
    paper: tuple[int, float, float]
    freeze: float | None
    cold: float | None
    fps: float
    spp: int = 512


ROWS = (
    Row("cornell-box", (450, 450), (64, 1, 1, 1), "back", (7215, 10, 22), 0.5, 3.0, 60),
    Row("teatray", (320, 240), (128, 1, 1, 1), "tray", (3255, 3, 25), None, None, 25, 256),
    Row("teatray", (320, 240), (16, 8, 1, 1), "tray", (6315, 3, 16), None, None, 16, 256),
    Row("teatray", (320, 240), (128, 8, 1), "tray", (11_700, 15, 5), None, 3.0, 15, 128),
    Row("ring", (400, 400), (64, 16), "ring", (3919, 16, 6), None, None, 15, 256),
)


def run(quick: bool) -> Report:
    """Bake each row in a process of its own, then edit it in another."""
    rows, goals, data = [], [], []
    for row in ROWS:
        with tempfile.TemporaryDirectory() as folder:
            found = measure(row, Path(folder) / "scene.burnish", quick)
        rows.append(shown(row, found))
        data.append(found)
        goals += goals_of(row, found, quick)
    notes = (
        "Each bake in a process of its own, whose peak memory is given; freezing and frames in "
        "another, through a session, with one parameter moving. In brackets the paper's figure "
        "(2008, Table 2). × bw: over the time that reading as many bytes with all cores takes, "
        "measured in turns with it: of a freeze the lit columns, tails and row directions of the "
        "other objects' blocks and what is made of them, of a frame the lit columns of the edited "
        "object's, the light of the others and the picture. A freeze keeps nothing of earlier "
        "ones; a switch is from another object, just edited, to the first frame. Cold: files "
        "dropped from the system's cache."
    )
    return Report("table", "Table 2 of 2008", notes, rows, goals, {"rows": data})


def measure(row: Row, path: Path, quick: bool) -> dict[str, Any]:
    """One line's raw figures."""
    width, height = (n // 4 if quick else n for n in row.resolution)
    spp = 16 if quick else row.spp
    series = ",".join(map(str, row.series))
    bake, memory = child("bench.bake_child", row.scene, width, height, series, spp, path)
    repeats = 10 if quick else 60
    editing, edit_memory = child("bench.editing", path, row.edited, "--repeats", repeats)
    return {
        **editing,
        "scene": row.scene,
        "resolution": [width, height],
        "series": series,
        "spp": spp,
        "bake_seconds": bake["seconds"],
        "bundle_bytes": bake["bytes"],
        "bake_memory_bytes": memory,
        "edit_memory_bytes": edit_memory,
    }


def shown(row: Row, found: dict[str, Any]) -> dict[str, Any]:
    """A line as the paper prints it."""
    width, height = found["resolution"]
    paper_bytes, paper_freeze, paper_fps = row.paper
    return {
        "scene": row.scene,
        "resolution": f"{width}×{height}",
        "series": found["series"],
        "spp": found["spp"],
        "precompute s": found["bake_seconds"],
        "MB": found["bundle_bytes"] / 1e6,
        "B/px": f"{found['bundle_bytes'] / (width * height):.0f} ({paper_bytes})",
        "edited": row.edited,
        "freeze s": f"{found['freeze_ms'] / 1e3:.3f} ({paper_freeze})",
        "× bw": found["freeze_bandwidth_ratio"],
        "switch s": found["switch_ms"] / 1e3,
        "cold s": found["cold_ms"] / 1e3,
        "fps": f"{1e3 / found['frame_ms']:.0f} ({paper_fps})",
        "fps × bw": found["frame_bandwidth_ratio"],
        "frozen MB": found["frozen_bytes"] / 1e6,
        "peak GB": found["bake_memory_bytes"] / 1e9,
    }


def goals_of(row: Row, found: dict[str, Any], quick: bool) -> list[Goal]:
    """What is promised of a line; of small pictures, whose frames cost calls rather than bytes,
    nothing about bandwidth."""
    name = f"{row.scene} ({found['series']}), edited {row.edited}"
    goals = [
        Goal(f"{name}: frames per second", 1e3 / found["frame_ms"], row.fps, at_least=True),
        Goal(f"{name}: peak memory of the bake, GB", found["bake_memory_bytes"] / 1e9, MEMORY_GB),
    ]
    if row.freeze is not None:
        goals.append(Goal(f"{name}: freeze from memory, s", found["freeze_ms"] / 1e3, row.freeze))
    if row.cold is not None:
        goals.append(Goal(f"{name}: freeze cold, s", found["cold_ms"] / 1e3, row.cold))
    if row.scene == "cornell-box" and not quick:
        goals += [
            Goal(f"{name}: freeze over memory bandwidth", found["freeze_bandwidth_ratio"], 2.0),
            Goal(f"{name}: frame over memory bandwidth", found["frame_bandwidth_ratio"], 2.0),
        ]
    return goals
