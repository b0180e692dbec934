"""The 2006 paper's Table 3, ours: bakes of direct light with 4,000 and with 400 lights."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.report import Goal, Report
from bench.timing import child, seconds

SCENES = ("teatray", "earrings")
COUNTS = (4000, 400)

PAPER: Mapping[str, Mapping[int, float]] = {
    "teatray": {4000: 6.3 + 2.1, 400: 0.9 + 1.2},
    "earrings": {4000: 11 + 4.3, 400: 1.5 + 2.8},
}
"""Minutes of a scene in 2006, Table 3: of its precomputation and of its visibility."""


def run(quick: bool) -> Report:
    """Bake each scene with each number of lights in a process of its own."""
    width, height = (32, 24) if quick else (512, 512)
    rows: list[dict[str, Any]] = []
    goals: list[Goal] = []
    data = []
    for scene in SCENES:
        found: dict[int, Any] = {}
        with tempfile.TemporaryDirectory() as folder:
            for count in COUNTS:
                path = Path(folder) / f"{count}.burnish"
                bake, memory = child("bench.direct_child", scene, width, height, count, path)
                found[count] = bake | {"memory": memory}
            objects = objects_of(Path(folder) / f"{COUNTS[0]}.burnish")
            rate = seconds_of_a_frame(Path(folder) / f"{COUNTS[0]}.burnish")
        rows += [{"scene": scene, **item} for item in objects]
        minutes = {f"minutes, {n} lights": found[n]["seconds"] / 60 for n in COUNTS}
        paper = {f"paper, {n}": PAPER[scene][n] for n in COUNTS}
        total = sum(item["compressed MB"] for item in objects)
        whole = {"raw MB": sum(item["raw MB"] for item in objects), "compressed MB": total}
        rows.append({"scene": scene, "object": "all", **whole, **minutes, **paper, "frame s": rate})
        goals.append(Goal(f"{scene}: peak memory, GB", found[COUNTS[0]]["memory"] / 1e9, 8.0))
        data.append({"scene": scene, "bakes": found, "objects": objects})
    notes = (
        "Columns as in 2006, Table 3: pixels that show an object, its models, its bands, its "
        "transport as float32 and as stored (in the bundle, RGB, all layers). Ours bakes "
        "visibility with the rest, and several points a pixel; the paper's minutes are the sum "
        "of its two, with its optimised visibility for 4,000 lights. A frame: one material "
        "changed, all rows contracted."
    )
    return Report("direct", "Table 3 of 2006", notes, rows, goals, {"scenes": data})


def objects_of(path: Path) -> list[dict[str, Any]]:
    """A line for each object of a bundle."""
    import burnish

    bundle = burnish.open_bundle(path)
    view = next(iter(bundle.views.values()))
    lines = []
    for index, item in enumerate(bundle.basis.objects):
        own = view.rows.object == index
        columns = bundle.basis.columns(index)
        stored = sum(pack.nbytes for pack in view.packs() if pack.object == index)
        lines.append(
            {
                "object": item.id,
                "pixels": int((own & (view.rows.weight > 0)).sum()),
                "model": " + ".join(layer.model.name for layer in item.material.layers),
                "bands": "/".join(str(layer.bins) for layer in item.material.layers),
                "raw MB": float(own.sum()) * columns * 12 / 1e6,
                "compressed MB": stored / 1e6,
            }
        )
    return lines


def seconds_of_a_frame(path: Path) -> float:
    """The median time of a frame of the first rough object while its roughness moves."""
    import burnish

    with burnish.edit(path) as session:
        # A linked parameter is in no state
        item, layer = next(
            (name, layer)
            for name, state in session.materials.items()
            for layer, own in getattr(state, "layers", {}).items()
            if "roughness" in own.values
        )
        session.select(item)
        times = []
        for number in range(12):
            session.set(f"{item}.{layer}.roughness", 0.1 + 0.02 * number)
            times.append(seconds(session.frame))
    return float(np.median(times[2:]))
