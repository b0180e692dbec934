"""Freezing and frames of a Cornell-sized view, beside what memory bandwidth alone would take.

    python bench/runtime.py [--size 450] [--ranks 8 8] [--json]

A made-up view of 450 × 450 pixels, seven objects of 1 + 64 columns (Lambert and
Blinn-Phong), 120 tails (series 64,1,1,1); the edited wall covers 45,000 pixels. The blocks
hold random numbers: what is timed does not depend on them.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from burnish.core.parallel import core_count, parallel_map
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.lambert import Lambert
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.store import BundleHeader, BundleWriter, ViewHeader, open_bundle
from burnish.transport.basis import Basis, EditableObject, State, initial_state
from burnish.transport.block import Block, Tile
from burnish.transport.compression import column_scale
from burnish.transport.pack import TiledBlocks
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


def milliseconds(action: Callable[[], object], repeats: int) -> float:
    """The median time of an action, the first call left out."""
    action()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times)


def bandwidth(megabytes: int = 256) -> float:
    """Bytes per second that all cores together read from memory (a sum over float32)."""
    data = np.ones(megabytes << 18, np.float32)
    pieces = np.array_split(data, core_count())
    ones = np.ones(len(pieces[0]) // 1024, np.float32)

    def read(piece: np.ndarray) -> object:
        matrix = piece[: len(piece) // 1024 * 1024].reshape(-1, 1024)
        return matrix.T @ ones[: len(matrix)]

    return data.nbytes / (milliseconds(lambda: parallel_map(read, pieces), 9) / 1e3)


def measure(size: int, ranks: tuple[int, int]) -> dict[str, Any]:
    """Freeze and frame times, and each as a multiple of reading its data once."""
    basis = made_up_basis()
    tiles = made_up_tiles(basis, size, ranks)
    source = TiledBlocks.of(basis, size, size, tiles)
    start = initial_state(basis.objects)
    target = (NAMES.index("back"),)
    speed = bandwidth()

    # Freeze from memory
    frozen = freeze(source, target, start)
    stored = sum(pack.nbytes for pack in source.packs())
    made = sum(part.nbytes for part in frozen.parts)
    freeze_ms = milliseconds(lambda: freeze(source, target, start), 7)

    # Frames: one parameter of the wall moves each time
    renderer = Renderer(frozen)
    states = [moved(start, "back", 20.0 + n) for n in range(32)]
    turn = iter(range(1 << 30))
    frame_ms = milliseconds(lambda: renderer.image(states[next(turn) % 32]), 100)

    # Freeze with nothing read yet
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "made-up.burnish"
        rectangles = tuple((t.x, t.y, t.width, t.height) for t in tiles)
        header = BundleHeader(basis, (ViewHeader("view", size, size, rectangles),))
        writer = BundleWriter.create(path, header)
        for number, tile in enumerate(tiles):
            writer.write_tile("view", number, tile)
        writer.close()
        on_disk = open_bundle(path).size
        open_ms = milliseconds(lambda: open_bundle(path), 3)
        cold_ms = milliseconds(lambda: freeze(open_bundle(path).views["view"], target, start), 3)
    freeze_bound = 1e3 * (stored + made) / speed
    frame_bound = 1e3 * made / speed
    return {
        "cores": core_count(),
        "bandwidth_gb_s": round(speed / 1e9, 1),
        "blocks_mb": round(stored / 1e6, 1),
        "bundle_mb": round(on_disk / 1e6, 1),
        "frozen_mb": round(made / 1e6, 1),
        "target_pixels": int(sum(len(p.pixel) for p in frozen.parts if p.slice)) // 2,
        "open_ms": round(open_ms, 1),
        "freeze_ms": round(freeze_ms, 1),
        "freeze_from_disk_ms": round(cold_ms, 1),
        "freeze_times_bandwidth": round(freeze_ms / freeze_bound, 2),
        "frame_ms": round(frame_ms, 2),
        "frames_per_second": round(1e3 / frame_ms, 1),
        "frame_times_bandwidth": round(frame_ms / frame_bound, 2),
    }


def moved(state: State, name: str, exponent: float) -> dict[str, MaterialState]:
    """The state with another exponent of one object."""
    layers = dict(state[name].layers)
    values = {**layers["specular"].values, "exponent": exponent}
    layers["specular"] = LayerState(values)
    return {**state, name: MaterialState(layers)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--size", type=int, default=450, help="pixels of a side")
    parser.add_argument("--ranks", type=int, nargs=2, default=(8, 8), metavar=("A", "B"))
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    result = measure(options.size, tuple(options.ranks))
    if options.json:
        print(json.dumps(result))
    else:
        for name, value in result.items():
            print(f"{name:24} {value}")


if __name__ == "__main__":
    main()
