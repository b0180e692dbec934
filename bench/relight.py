"""Relighting: the 2010 paper's Table 5, ours.

python -m bench relight
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from bench.report import Goal, Report
from bench.timing import child
from burnish.app.relight import relight_session
from burnish.session import Session

PAPER = {
    "cornell-box": (1.0, 232, 6.0),
    "tableau": (6.0, 627, 17.0),
    "still-life": (6.0, 437, 18.0),
    "interior": (10.0, 707, 25.0),
}
"""Hours of precomputation, MB at most, and seconds of the slowest freeze (2010, Table 5)."""
EDITED = {
    "cornell-box": "floor.diffuse.color",
    "tableau": "floor.diffuse.color",
    "still-life": "floor.diffuse.color",
    "interior": "floor.diffuse.color",
}
SIDE, QUICK_SIDE = 400, 96


def run(quick: bool) -> Report:
    """Each scene in a process of its own, whose peak memory is given."""
    rows, goals, data = [], [], {}
    for scene, (hours, most, freeze) in PAPER.items():
        if quick and scene != "cornell-box":
            continue
        found, peak = child("bench.relight", scene, QUICK_SIDE if quick else SIDE, int(quick))
        data[scene] = found
        rows.append(
            {
                "scene": scene,
                "|G|": f"{found['cells']:,}",
                "t [h]": f"{found['precompute'] / 3600:.3f} ({hours:g})",
                "T MB": found["T"] / 1e6,
                "D MB": found["D"] / 1e6,
                "M MB": found["M"] / 1e6,
                "max MB": f"{sum(found[k] for k in 'TDM') / 1e6:.0f} ({most})",
                "process MB": peak / 1e6,
                "f [s]": f"{found['freeze']:.2f} ({freeze:g})",
                "BRDF frames/s": found["brdf"],
                "light frames/s": found["light"],
                "path tracing s": found["truth"],
            }
        )
        goals += [
            Goal(f"{scene}: precompute, of the paper's", found["precompute"] / 3600 / hours, 0.1),
            Goal(f"{scene}: freezing, s", found["freeze"], 0.5),
            Goal(f"{scene}: frames/s while a material is edited", found["brdf"], 30, True),
            Goal(f"{scene}: frames/s while a light is edited", found["light"], 30, True),
            Goal(f"{scene}: matrices, MB", sum(found[k] for k in "TDM") / 1e6, most),
        ]
    return Report(
        name="relight",
        title="Lights and materials together (2010, Table 5)",
        notes=(
            f"{QUICK_SIDE if quick else SIDE}² pixels; in brackets the paper's. f: from a "
            "selection to its first picture under lights that have been seen before, direct light "
            "at the interactive level. Light frames: nothing selected, a light changed before each "
            "one, the interactive level of direct light. Path tracing: a Mitsuba picture of 64 "
            "samples per pixel after such an edit."
        ),
        rows=rows,
        goals=goals,
        data=data,
    )


def measure(scene: str, side: int, quick: bool) -> dict[str, Any]:
    """All of one scene's figures."""
    start = time.perf_counter()
    session = relight_session(scene, resolution=(side, side), samples=4096 if quick else 16384)
    found: dict[str, Any] = {"precompute": time.perf_counter() - start}
    view = next(iter(session.views.values()))
    found |= view.data.nbytes  # type: ignore[attr-defined]
    found["cells"] = len(view.data.samples)  # type: ignore[attr-defined]
    # As the editor has it: pictures at once, better ones in a pause
    session.light_mix.background = True
    path = EDITED[scene]
    name = path.split(".", 1)[0]
    light = session.lights[0]
    session.frame()
    session.select(name)
    session.frame()
    session.select()
    session.frame()
    start = time.perf_counter()
    session.select(name)
    session.frame()
    found["freeze"] = time.perf_counter() - start
    found["brdf"] = rate(lambda k: session.set(path, (0.3 + 0.01 * k, 0.4, 0.5)), session)
    session.select()
    session.frame()
    aimed = "rotation" if "rotation" in light.names else "position"
    place = session.get(f"{light.key}.{aimed}")

    def move(k: int) -> None:
        if aimed == "rotation":
            session.set(f"{light.key}.rotation", 2.0 * k)
        else:
            x, y, z = np.asarray(place, float)
            session.set(f"{light.key}.position", (x - 0.05 * k, y - 0.1, z))

    move(0)
    session.frame()
    found["light"] = rate(move, session)
    state = session.state
    assert session.truth is not None
    session.truth.render(state, view.name, 4)  # type: ignore[attr-defined]
    start = time.perf_counter()
    session.truth.render(state, view.name, 64)  # type: ignore[attr-defined]
    found["truth"] = time.perf_counter() - start
    return found


def rate(edit: Callable[[int], None], session: Session, count: int = 12) -> float:
    """Frames a second, an edit before each."""
    start = time.perf_counter()
    for k in range(1, count + 1):
        edit(k)
        session.frame()
    return count / (time.perf_counter() - start)


if __name__ == "__main__":
    scene, side, quick = sys.argv[1:4]
    print(json.dumps(measure(scene, int(side), quick == "1")))
