"""Random transport of small made-up views, and the plain sum that the fast path must equal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from burnish.core.types import Float32, Float64
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.lights import mix
from burnish.materials.model import Fixed, Values
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.lambert import Lambert
from burnish.transport.basis import Basis, EditableObject, State
from burnish.transport.block import Tile
from burnish.transport.compression import compress_tile
from burnish.transport.pack import TiledBlocks
from burnish.transport.rows import Rows

Dense = dict[tuple[int, bool], tuple[np.ndarray, Float32]]
"""(object, indirect) to the row indices and T [r, c, z, 3] of those rows."""


def glossy(name: str, bins: int = 6, **state: float) -> EditableObject:
    """An object with a diffuse and a Blinn-Phong layer."""
    layers = (
        Layer("diffuse", Lambert(), bins=1),
        Layer("specular", BlinnPhong(), bins=bins),
    )
    values = {
        "diffuse": LayerState({"color": (0.5, 0.4, 0.2)}),
        "specular": LayerState({"color": (0.2, 0.2, 0.3), "exponent": 20.0, **state}),
    }
    return EditableObject(name, Material(layers, MaterialState(values)))


def matte(name: str) -> EditableObject:
    """An object with a diffuse layer alone."""
    layer = Layer("diffuse", Lambert(), bins=1)
    state = MaterialState({"diffuse": LayerState({"color": (0.3, 0.6, 0.9)})})
    return EditableObject(name, Material((layer,), state))


@dataclass(frozen=True)
class ShadedPhong(BlinnPhong):
    """Blinn-Phong with what models with masking or a mirror lobe have: outgoing factors and a
    delta column."""

    name = "shaded-phong"

    def outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64:
        return (0.2 + 0.5 * cos_theta_o ** (float(values["exponent"]) / 100.0))[:, None]

    def delta(self, values: Values, fixed: Fixed) -> Float64:
        return np.array(values["color"]) * 0.3

    def delta_outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.stack([cos_theta_o, 1 - cos_theta_o, cos_theta_o**2], axis=1)


def shaded(name: str) -> EditableObject:
    """An object with every kind of column: plain, with an outgoing factor, delta."""
    layers = (
        Layer("diffuse", Lambert(), bins=1),
        Layer("specular", ShadedPhong(), bins=5, delta=True),
    )
    values = {
        "diffuse": LayerState({"color": (0.1, 0.2, 0.3)}),
        "specular": LayerState({"color": (0.4, 0.3, 0.2), "exponent": 40.0}),
    }
    return EditableObject(name, Material(layers, MaterialState(values)))


def basis_of(series: Sequence[int], lid: EditableObject | None = None) -> Basis:
    """Three objects: a glossy box, a matte floor and a lid (default: glossy)."""
    items = (glossy("box", 6), matte("floor"), lid or glossy("lid", 4))
    return Basis(items, tuple(series), indirect_bins=2)


def random_tile(
    basis: Basis, x: int, y: int, width: int, height: int, view_width: int, seed: int
) -> tuple[Tile, Dense]:
    """A tile of random rows and smooth-free transport, compressed without loss."""
    rng = np.random.default_rng(seed)
    pixels = ((y + np.arange(height))[:, None] * view_width + x + np.arange(width)[None]).ravel()
    parts, kinds = [], []
    for index in range(len(basis.objects)):
        for indirect in (False, True):
            seen = pixels[rng.random(len(pixels)) < (0.6 if not indirect else 0.2)]
            parts.append(seen)
            kinds += [(index, indirect)] * len(seen)
    count = len(kinds)
    rows = Rows(
        pixel=np.concatenate(parts).astype(np.int32),
        object=np.array([k[0] for k in kinds], np.int32),
        indirect=np.array([k[1] for k in kinds], np.bool_),
        weight=rng.random(count).astype(np.float32),
        position=rng.random((count, 3)).astype(np.float32),
        normal=rng.random((count, 3)).astype(np.float32),
        uv=rng.random((count, 2)).astype(np.float32),
        cos_theta_o=rng.random(count).astype(np.float32),
    )
    dense: Dense = {}
    blocks = []
    for index in range(len(basis.objects)):
        for indirect in (False, True):
            which = np.flatnonzero((rows.object == index) & (rows.indirect == indirect))
            if not len(which):
                continue
            shape = (len(which), basis.columns(index, indirect), basis.tails, 3)
            T = rng.random(shape).astype(np.float32)
            blocks += compress_tile(
                T, rows, which.astype(np.int32), view_width, basis, tolerance=0.0
            )
            dense[index, indirect] = (which, T)
    shape = (*((len(basis.lights),) if basis.lights else ()), height, width, 3)
    fixed = rng.random(shape).astype(np.float32)
    emission = rng.random(shape).astype(np.float32)
    tile = Tile(x, y, width, height, rows, blocks, fixed, emission, samples=1)
    return tile, dense


def random_world(
    basis: Basis, width: int = 20, height: int = 12, seed: int = 1
) -> tuple[TiledBlocks, list[tuple[Tile, Dense]]]:
    """A view of two tiles."""
    half = width // 2
    tiles = [
        random_tile(basis, 0, 0, half, height, width, seed),
        random_tile(basis, half, 0, width - half, height, width, seed + 1),
    ]
    return TiledBlocks.of(basis, width, height, [tile for tile, _ in tiles]), tiles


def edited(state: State, *ids: str, **values: object) -> dict[str, MaterialState]:
    """The state with some parameters of some objects changed, where they have them."""
    result = dict(state)
    for object_id in ids:
        layers = {
            name: replace(
                layer,
                values={
                    **layer.values,
                    **{key: value for key, value in values.items() if key in layer.values},
                },
            )
            for name, layer in state[object_id].layers.items()
        }
        result[object_id] = MaterialState(layers)
    return result


def plain_image(
    basis: Basis, tiles: list[tuple[Tile, Dense]], state: State, width: int, height: int
) -> Float64:
    """B by the sums of 2008, eq. 26 and 29, term by term: float64 [height, width, 3]."""
    image = np.zeros((height * width, 3))
    tails = basis.tail_values(state)
    for tile, dense in tiles:
        area = np.zeros((height, width, 3))
        base = tile.fixed.astype(np.float64) + tile.emission
        if basis.lights:
            base = np.einsum("ghwc,gc->hwc", base, mix(basis.lights, state))
        area[tile.y : tile.y + tile.height, tile.x : tile.x + tile.width] = base
        image += area.reshape(-1, 3)
        for (index, indirect), (which, T) in dense.items():
            c = basis.column_coefficients(index, state, indirect)
            factors = np.ones((len(which), len(c), 3))
            if not indirect:
                s = basis.outgoing_factors(index, state, tile.rows.cos_theta_o[which].astype(float))
                for part, factor in zip(basis.slices(index), s, strict=True):
                    if factor is not None:
                        factors[:, part.start : part.stop] = factor[:, None, :]
            light = np.einsum("rczh,ch,zh,rch->rh", T.astype(np.float64), c, tails, factors)
            np.add.at(image, tile.rows.pixel[which], light)
    return image.reshape(height, width, 3)
