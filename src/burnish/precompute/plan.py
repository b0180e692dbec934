"""Planning a bake: what is symbolic, in which tiles, and whether it fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import comb

import numpy as np

from burnish.core.errors import InvalidValue, TooLarge
from burnish.materials.lights import grouped
from burnish.precompute.accumulate import Rectangle
from burnish.precompute.arrangement import arranged
from burnish.precompute.tracer import VALUE_BYTES
from burnish.scene import Scene
from burnish.transport.basis import Basis, EditableObject
from burnish.transport.rows import Rows

SQUARE = 8
"""Pixels of a side of the squares that blocks are compressed in; tiles are multiples."""

TILE_SIDES = (128, 96, 64, 48, 32, 16, 8)
TILE_BYTES = 2 << 30
MEMORY_BYTES = 8 << 30
CELLS = 7
"""Numbers that blocks keep of each row, column and channel: 4 to 7 at hundreds of samples, in
the papers' scenes and series."""

CORNER = 16
"""Directions over the rows and over the tails that a square with few rows may keep."""


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
    places = np.zeros((max(len(basis.objects), 1), 2), np.int64)
    for i in range(len(basis.objects)):
        places[i] = [arranged(basis, i, kind).places for kind in (False, True)]
    return np.asarray(places[rows.object, rows.indirect.astype(int)] * VALUE_BYTES)


def check_memory(basis: Basis, rows: Rows, width: int, height: int) -> None:
    """Refuse a bake whose editing, one object at a time, would not fit in MEMORY_BYTES.

    Raises TooLarge.
    """
    need = editing_bytes(basis, rows, width, height)
    if need > MEMORY_BYTES:
        raise TooLarge(
            f"editing this bake would need {need / 2**30:.1f} GiB and may have "
            f"{MEMORY_BYTES / 2**30:.0f}: {remedies(basis)}"
        )


def editing_bytes(basis: Basis, rows: Rows, width: int, height: int) -> int:
    """What editing one object of a view takes at most: the blocks, laid out for freezing and
    frames; V of all other rows, made once by pixel and once by power; the pictures of every
    light."""
    layers = np.array([len(item.material.layers) for item in basis.objects] or [0])
    columns = np.zeros((len(layers), 2), np.int64)
    for i in range(len(basis.objects)):
        columns[i] = [basis.columns(i, kind) for kind in (False, True)]
    y, x = np.divmod(rows.pixel.astype(np.int64), width)
    square = y // SQUARE * width + x // SQUARE
    keys = np.stack([rows.object, rows.indirect, square])
    (index, indirect, _), counts = np.unique(keys, axis=1, return_counts=True)
    few = np.minimum(counts, CORNER) * min(basis.tails, CORNER)
    cells = np.maximum(CELLS * counts, few)
    # Three channels of 16 bits; of each layer U, whole squares of it, and S
    core = 6 * int((cells * columns[index, indirect]).sum())
    own = SQUARE**2 * np.minimum(counts, SQUARE**2) + basis.tails * np.minimum(cells, CORNER)
    sides = 4 * int((layers[index] * own).sum())
    pictures = 24 * width * height * (most_powers(basis) + max(len(basis.lights), 1))
    return core + sides + pictures


def most_powers(basis: Basis) -> int:
    """The most powers that freezing one object leaves symbolic, or the mix of the lights."""
    most = max(len(basis.lights), 1)
    degree = basis.monomials.degree
    for i, item in enumerate(basis.objects):
        coarse = sum(owner == i for owner, _, _ in basis.coarse)
        groups = len(item.material.groups)
        most = max(most, comb(groups + degree, degree) * (1 + coarse))
    return most


def remedies(basis: Basis) -> str:
    """What to change when a bake is too large, with today's numbers."""
    bins = max(layer.bins for item in basis.objects for layer in item.material.layers)
    lights = f", fewer light groups (now {len(basis.lights)})" if basis.lights else ""
    return (
        f"choose fewer editable objects (now {len(basis.objects)}){lights}, fewer bounces (now "
        f"{basis.bounces}) or fewer bins (now {bins})"
    )
