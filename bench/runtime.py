"""Freezing and frames of a made-up Cornell-sized view, for ranks that a bake may have."""

from __future__ import annotations

import tempfile
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench import editing
from bench.report import Goal, Report
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.lambert import Lambert
from burnish.store import BundleHeader, BundleWriter, ViewHeader
from burnish.transport.basis import Basis, EditableObject
from burnish.transport.block import Block, Tile
from burnish.transport.compression import column_scale
from burnish.transport.rows import Rows

NAMES = ("floor", "ceiling", "back", "left", "right", "small-box", "large-box")
TILE = 64


def made_up_basis() -> Basis:
    """Seven objects with a diffuse and a glossy layer, series (64, 1, 1, 1)."""
    layers = (Layer("diffuse", Lambert(), bins=1), Layer("specular", BlinnPhong(), bins=64))
    values = {
        "diffuse": LayerState({"color": (0.5, 0.5, 0.5)}),
        "specular": LayerState({"color": (0.2, 0.2, 0.2), "exponent": 50.0}),
    }
    material = Material(layers, MaterialState(values))
    return Basis(tuple(EditableObject(name, material) for name in NAMES), (64, 1, 1, 1))


def made_up_tile(
    basis: Basis, size: int, x: int, y: int, ranks: tuple[int, int], seed: int
) -> Tile:
    """A tile whose rows meet the objects in seven vertical bands, the wall the widest."""
    rng = np.random.default_rng(seed)
    width, height = min(TILE, size - x), min(TILE, size - y)
    rows_y, rows_x = np.divmod(np.arange(width * height), width)
    pixel = (y + rows_y) * size + x + rows_x
    # The back wall takes 22 % of the picture, the other six share the rest
    edges = np.array([0.13, 0.26, 0.48, 0.61, 0.74, 0.87])
    owner = np.searchsorted(edges, (x + rows_x) / size, side="right")
    order = np.lexsort((pixel, owner))
    pixel, owner = pixel[order].astype(np.int32), owner[order].astype(np.int32)
    count = len(pixel)
    rows = Rows(
        pixel=pixel,
        object=owner,
        indirect=np.zeros(count, np.bool_),
        weight=np.ones(count, np.float32),
        position=np.zeros((count, 3), np.float32),
        normal=np.zeros((count, 3), np.float32),
        uv=np.zeros((count, 2), np.float32),
        cos_theta_o=np.full(count, 0.7, np.float32),
    )
    blocks = []
    square = pixel // size // 8 * (size // 8 + 1) + pixel % size // 8
    for index in range(len(basis.objects)):
        scale = column_scale(basis, index)
        mine = np.flatnonzero(owner == index)
        for number, piece in product(np.unique(square[mine]), basis.slices(index)):
            which = mine[square[mine] == number].astype(np.int32)
            columns = piece.stop - piece.start
            a, b = min(ranks[0], len(which)), ranks[1]
            core = rng.standard_normal((a, columns, b, 3), np.float32)
            blocks.append(
                Block(
                    object=index,
                    indirect=False,
                    rows=which,
                    U=rng.standard_normal((len(which), a), np.float32),
                    core=core.astype(np.float16),
                    S=rng.standard_normal((b, basis.tails), np.float32) / np.float32(11),
                    column_scale=scale[piece.start : piece.stop],
                    start=piece.start,
                )
            )
    dark = np.zeros((height, width, 3), np.float32)
    return Tile(x, y, width, height, rows, blocks, dark, dark, samples=0)


def made_up_tiles(basis: Basis, size: int, ranks: tuple[int, int]) -> list[Tile]:
    """All tiles of a square view."""
    corners = [(x, y) for y in range(0, size, TILE) for x in range(0, size, TILE)]
    return [made_up_tile(basis, size, x, y, ranks, n) for n, (x, y) in enumerate(corners)]


def run(quick: bool) -> Report:
    """Freeze and frames at the ranks that a noisy and a clean bake have."""
    size = 225 if quick else 450
    rows, goals = [], []
    for ranks in ((8, 8), (24, 16)):
        found = measure(size, ranks, repeats=10 if quick else 60)
        rows.append(
            {
                "ranks": "×".join(map(str, ranks)),
                "blocks MB": found["blocks_bytes"] / 1e6,
                "frozen MB": found["frozen_bytes"] / 1e6,
                "freeze s": found["freeze_ms"] / 1e3,
                "× bw": found["freeze_bandwidth_ratio"],
                "switch s": found["switch_ms"] / 1e3,
                "cold s": found["cold_ms"] / 1e3,
                "fps": 1e3 / found["frame_ms"],
                "fps × bw": found["frame_bandwidth_ratio"],
                "bandwidth GB/s": found["gb_s"],
            }
        )
        goals.append(
            Goal(f"ranks {ranks}: frames per second", 1e3 / found["frame_ms"], 60, at_least=True)
        )
        goals.append(Goal(f"ranks {ranks}: freeze from memory, s", found["freeze_ms"] / 1e3, 0.5))
        goals.append(Goal(f"ranks {ranks}: freeze cold, s", found["cold_ms"] / 1e3, 3.0))
        if not quick:
            for what in ("freeze", "frame"):
                ratio = found[f"{what}_bandwidth_ratio"]
                goals.append(Goal(f"ranks {ranks}: {what} over memory bandwidth", ratio, 2.0))
    notes = (
        f"A made-up view of {size}×{size} pixels, seven objects of 1 + 64 columns, 120 tails "
        "(series 64,1,1,1), the edited wall on 22 % of the picture. The blocks hold random "
        "numbers of the given ranks over rows and tails: no ray tracer is needed."
    )
    return Report("runtime", "Editing at given ranks", notes, rows, goals)


def measure(size: int, ranks: tuple[int, int], repeats: int) -> dict[str, Any]:
    """Write the view as a bundle and edit its wall."""
    basis = made_up_basis()
    tiles = made_up_tiles(basis, size, ranks)
    rectangles = tuple((t.x, t.y, t.width, t.height) for t in tiles)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "made-up.burnish"
        writer = BundleWriter.create(
            path, BundleHeader(basis, (ViewHeader("view", size, size, rectangles),))
        )
        for number, tile in enumerate(tiles):
            writer.write_tile("view", number, tile)
        writer.close()
        return editing.measure(path, "back", repeats)
