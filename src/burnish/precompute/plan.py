"""Planning a bake: what is symbolic, in which tiles, and whether it fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from burnish.core.errors import InvalidValue, TooLarge
from burnish.materials.lights import grouped
from burnish.precompute.accumulate import Rectangle
from burnish.precompute.tracer import VALUE_BYTES
from burnish.scene import Scene
from burnish.transport.basis import Basis, EditableObject
from burnish.transport.rows import Rows

SQUARE = 8
"""Pixels of a side of the squares that blocks are compressed in; tiles are multiples."""

TILE_SIDES = (128, 96, 64, 48, 32, 16, 8)
TILE_BYTES = 2 << 30
MEMORY_BYTES = 8 << 30
DIRECTIONS = 0.25
"""Row directions that a compressed square keeps, as a share of its rows: 16 of 64 is what
the compression's limit leaves at thousands of samples, fewer at less."""


def basis_for(
    scene: Scene,
    editable: Sequence[str] | None = None,
    series: Sequence[int] = (64, 1, 1, 1),
    bins: Mapping[str, int] | None = None,
    light_groups: Sequence[str] = (),
) -> Basis:
    """The basis of a bake of the chosen objects (all editable ones without a choice).

    series: see `Basis`; its first number is the bins of every layer. bins: other numbers of
      bins by object id or "object.layer". light_groups: see `materials.lights.grouped`.
      Raises UnknownName, InvalidValue.
    """
    materials = {
        item.id: item.material for item in scene.editable(editable) if item.material is not None
    }
    wanted = dict(bins or {})
    known = set(materials) | {
        f"{name}.{layer.name}" for name, material in materials.items() for layer in material.layers
    }
    for name in wanted:
        if name not in known:
            from burnish.core.errors import UnknownName

            raise UnknownName("editable object or layer", name, known)
    objects = []
    for name, material in materials.items():
        default = wanted.get(name, int(series[0]))
        layers = tuple(
            layer.with_bins(wanted.get(f"{name}.{layer.name}", default))
            for layer in material.layers
        )
        objects.append(EditableObject(name, replace(material, layers=layers)))
    if not objects:
        raise InvalidValue(
            f"scene {scene.name} has no editable object; `burnish info` names the reason for each"
        )
    groups = grouped(scene.lights, light_groups)
    return Basis(tuple(objects), tuple(int(n) for n in series), lights=groups)


def tiles_for(basis: Basis, rows: Rows, width: int, height: int) -> list[Rectangle]:
    """Rectangles that cover a view, each with a tensor of at most TILE_BYTES.

    Raises TooLarge with the remedy when even the smallest does not fit.
    """
    cost = row_bytes(basis, rows)
    per_pixel = np.bincount(rows.pixel, weights=cost, minlength=width * height)
    for side in TILE_SIDES:
        tiles = [
            Rectangle(x, y, min(side, width - x), min(side, height - y))
            for y in range(0, height, side)
            for x in range(0, width, side)
        ]
        largest = max(float(per_pixel[tile.pixels(width)].sum()) for tile in tiles)
        if largest <= TILE_BYTES:
            return tiles
    raise TooLarge(
        f"a tile of {SQUARE} × {SQUARE} pixels needs {largest / 2**30:.1f} GiB and may have "
        f"{TILE_BYTES / 2**30:.0f}: {remedies(basis)}"
    )


def row_bytes(basis: Basis, rows: Rows) -> np.ndarray:
    """Uncompressed bytes of each row: int64 [rows]."""
    columns = np.array(
        [[basis.columns(i, kind) for kind in (False, True)] for i in range(len(basis.objects))]
    )
    each = columns[rows.object, rows.indirect.astype(int)].astype(np.int64)
    return np.asarray(each * basis.tails * VALUE_BYTES)


def check_memory(basis: Basis, rows: Rows, pixels: int) -> None:
    """Refuse a bake whose editing would not fit in MEMORY_BYTES.

    The largest frozen form holds one object's columns with the powers of its variables, for
    the row directions of its squares, and every other row's powers. Raises TooLarge.
    """
    powers = basis.bounces * (1 + basis.coarse_bins if basis.coarse else 1)
    worst = 0.0
    for i in range(len(basis.objects)):
        own = (rows.object == i) & ~rows.indirect
        worst = max(worst, float(own.sum()) * DIRECTIONS * basis.columns(i) * powers * 12)
    lights = max(len(basis.lights), 1)
    need = worst + len(rows) * powers * 12 + pixels * lights * 24
    if need > MEMORY_BYTES:
        raise TooLarge(
            f"editing this bake would need {need / 2**30:.1f} GiB and may have "
            f"{MEMORY_BYTES / 2**30:.0f}: {remedies(basis)}"
        )


def remedies(basis: Basis) -> str:
    """What to change when a bake is too large, with today's numbers."""
    bins = max(layer.bins for item in basis.objects for layer in item.material.layers)
    lights = f", fewer light groups (now {len(basis.lights)})" if basis.lights else ""
    return (
        f"choose fewer editable objects (now {len(basis.objects)}){lights}, fewer bounces (now "
        f"{basis.bounces}) or fewer bins (now {bins})"
    )
