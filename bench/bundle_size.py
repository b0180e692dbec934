"""The bundle beside RGBE with zeros dropped, and what its compression costs in the picture."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import burnish
from bench.pictures import glossy_state, picture_of
from bench.report import Goal, Report
from burnish.compare.tone import auto_exposure, display
from burnish.core.types import Float32
from burnish.precompute.accumulate import Accumulator, Rectangle
from burnish.precompute.bake import ViewPlan, finished_tile, plan_views, strata
from burnish.precompute.plan import basis_for
from burnish.store.tiles import write_tile
from burnish.transport.basis import initial_state
from burnish.transport.compression import DEFAULT_TOLERANCE, rgbe_bytes

RESOLUTION = (450, 450)
SERIES = (64, 1, 1, 1)
BROAD = (5.0, 10.0, 20.0, 50.0)
SHARP = 1000.0
PLACES = {
    "back wall": (200, 104),
    "large box's edge": (144, 200),
    "small box and floor": (256, 336),
    "ceiling and lamp": (200, 40),
}
"""Corners of the squares of the picture that are traced, multiples of 8 pixels."""


def run(quick: bool) -> Report:
    """Sizes and errors of a few parts of the Cornell box at its full resolution."""
    side, spp = (24, 4096) if quick else (48, 4096)
    places = dict(list(PLACES.items())[: 2 if quick else None])
    scene = burnish.load("cornell-box", resolution=RESOLUTION)
    plan = plan_views(scene, basis_for(scene, series=SERIES), seed=0)[0]
    measured = [
        measure(plan, name, Rectangle(x, y, side, side), spp, 2 if quick else 8)
        for name, (x, y) in places.items()
    ]
    total = sum(row["RGBE bytes"] for row in measured)
    size = sum(row["bundle bytes"] for row in measured)
    broad = max(row[f"added error % at {n:g}"] for row in measured for n in BROAD)
    loss = max(row["PSNR loss dB at 1000"] for row in measured)
    notes = (
        f"Cornell box, {RESOLUTION[0]}×{RESOLUTION[1]}, series {','.join(map(str, SERIES))}, "
        f"{spp:,} samples per pixel, squares of {side}×{side} pixels. RGBE: four bytes for each "
        "(row, column, tail) that is not black, positions not counted (2008, section 6); bundle: "
        "files on disk. Added error: rel. RMSE between pictures with and without compression, "
        "all seven objects with a Blinn-Phong lobe of that exponent. PSNR loss: of the "
        "displayed picture at exponent 1000 against an independent uncompressed trace of "
        f"{2 if quick else 8} times the samples; negative where compression takes noise away."
    )
    goals = [
        Goal("bundle over RGBE", size / total, 1 / 3),
        Goal("largest square's bundle over RGBE", max(r["ratio"] for r in measured), 1.0),
        Goal("added error on exponents 5 to 50, %", broad, 1.0),
        Goal("PSNR loss at exponent 1000, dB", loss, 1.0),
    ]
    return Report("bundle-size", "Bundle size", notes, measured, goals)


def measure(
    plan: ViewPlan, name: str, rectangle: Rectangle, spp: int, longer: int
) -> dict[str, Any]:
    """One part of the picture."""
    tensor = traced(plan, rectangle, spp, seed=1)
    start = initial_state(tensor.tracer.basis.objects)
    plain, packed = finished_tile(tensor, 0.0), finished_tile(tensor, DEFAULT_TOLERANCE)
    rgbe = sum(rgbe_bytes(T) for T in tensor.transport())
    with tempfile.TemporaryDirectory() as folder:
        write_tile(Path(folder) / "tile", packed)
        size = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
    row: dict[str, Any] = {
        "place": name,
        "RGBE bytes": rgbe,
        "bundle bytes": size,
        "ratio": size / rgbe,
    }
    for exponent in BROAD:
        state = glossy_state(tensor.tracer.basis, start, exponent)
        before, after = (picture_of(tensor, tile, state) for tile in (plain, packed))
        error = np.linalg.norm(after - before) / np.linalg.norm(before)
        row[f"added error % at {exponent:g}"] = 100 * float(error)
    state = glossy_state(tensor.tracer.basis, start, SHARP)
    before, after = (picture_of(tensor, tile, state) for tile in (plain, packed))
    longer_trace = traced(plan, rectangle, spp * longer, seed=2)
    truth = picture_of(longer_trace, finished_tile(longer_trace, 0.0), state)
    row["PSNR dB without"] = psnr(before, truth)
    row["PSNR loss dB at 1000"] = psnr(before, truth) - psnr(after, truth)
    return row


def traced(plan: ViewPlan, rectangle: Rectangle, spp: int, seed: int) -> Accumulator:
    """The tensor of a rectangle."""
    accumulator = Accumulator(plan.tracer, rectangle, plan.tile_rows(rectangle))
    for index, samples in enumerate(strata(spp)):
        accumulator.run(samples, 100_003 * seed + index)
    return accumulator


def psnr(image: Float32, truth: Float32) -> float:
    """dB, of the pictures as `compare` shows them."""
    exposure = auto_exposure(truth)
    difference = display(image, exposure).astype(np.float64) - display(truth, exposure)
    return float(-10 * np.log10(np.mean(difference**2)))
