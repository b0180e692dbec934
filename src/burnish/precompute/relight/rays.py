"""Rays from rows to cells: the samples that transfer matrices are made of.

A row's reflected light is an integral over directions; a ray samples one, and where it lands
is a sub-area sample q of a cell g (2010, eq. 3):

    T_g(x) = 1/N Σ_{rays that land in A_g} f(x, ωq, ωo) cosθ / p(ωq),

with f left open as the quotients of a column. The paper draws q on a disk about g; here a
mixture of the lobes draws it, and finds the true visibility of q along with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import AnyArray, Float32, Int32
from burnish.precompute.encounter import open_first
from burnish.precompute.film import Camera
from burnish.precompute.relight.cells import CellFinder
from burnish.precompute.relight.onward import OnwardCells
from burnish.precompute.relight.paths import Paths, stratified
from burnish.precompute.symbolic import PLAIN
from burnish.transport.gather import GatherSamples


@dataclass
class Samples:
    """What rays found: n samples of some rows.

    row: int32 [n], position among the rows asked. cell: int32 [n]. column: int32 [n] of the
    layer. value: float32 [n], per ray of the row. half: bool [n], which half of the rays.
    """

    row: Int32
    cell: Int32
    column: Int32
    value: Float32
    half: AnyArray


@dataclass
class LayerSamples:
    """Samples of one layer's columns. tint: float32 [rows, 3], see `RowTransfer`; coverage:
    float32 [rows], the share of the pixel's filter that the row has."""

    samples: Samples
    tint: Float32
    coverage: Float32


def from_rows(
    paths: Paths,
    finder: CellFinder,
    camera: Camera,
    pixels: Int32,
    index: int,
    rays: int,
    seed: int,
    onward: OnwardCells | None = None,
) -> list[LayerSamples]:
    """`rays` (a square) through each of some pixels, from where they meet an object.

    index: of the object in the basis; PLAIN for any fixed surface, whose columns are the
    channels of what it reflects. onward: what glossy surfaces show of the lights, to be
    counted too. Gives the samples of every layer.
    """
    m = paths.materials
    lanes = len(pixels) * rays
    sampler, random = stratified(rays, lanes, seed)
    row = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, rays)
    ray, weight = camera.numbered(
        dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), row), sampler
    )
    u1, u2 = sampler.next_1d(), sampler.next_2d()
    met, random = paths.meet(ray, random, dr.full(mi.Bool, True, lanes))
    si, obj, wo = met.si, met.obj, met.frame.wo
    own = met.valid & (met.symbolic == dr.opaque(mi.Int32, index))
    through = met.throughput * weight
    u3 = mi.Point2f(random.next_float32(), random.next_float32())
    if index == PLAIN:
        bs, value = si.bsdf(met.ray).sample(mi.BSDFContext(), si, u1, u2, own)
        value = dr.select(own, value * through, 0)
        going = own & dr.any(value != 0)
        cell, hit = _land(paths, finder, si, si.to_world(bs.wo), u3, random, going, onward)
        ones = np.ones((len(pixels), 3), np.float32)
        columns = [(mi.UInt32(c), value[c]) for c in range(3)]
        found = _collect(row, cell, hit, columns, len(pixels), rays)
        return [LayerSamples(found, ones, ones[:, 0])]
    covered = mi.Float(dr.select(own, dr.mean(weight), 0))
    own &= wo.z > 0
    layouts = m.look_up(obj, own)
    no = mi.Bool(False)
    opened = open_first(m, obj, layouts, mi.Vector3f(0, 0, 1), wo, u1, u2, own, no & own, own)
    outward, shade = met.frame.to_shading(opened.wi)
    scale = dr.select(opened.delta, 1, opened.wi.z) / opened.wi_pdf * shade
    scale = dr.select(own & (opened.wi_pdf > 0), scale * dr.mean(weight), 0)
    going = own & (scale != 0)
    cell, hit = _land(paths, finder, si, si.to_world(outward), u3, random, going, onward)
    # A matte layer is gathered by its own lobe alone, whose shares add up to one
    p_cosine = 1 - dr.gather(mi.Float, m.half_share, obj) - dr.gather(mi.Float, m.delta_share, obj)
    even = own & (u1 >= 1 - p_cosine) & (opened.wi.z > 0)
    even_scale = dr.select(even, dr.pi / p_cosine * shade * dr.mean(weight), 0)
    H = m.weight_maps(si, obj, own)
    layers = m.basis.objects[index].material.layers
    coverage = np.asarray(dr.block_sum(covered, rays) / rays, np.float32)
    result = []
    for s, layer in enumerate(layers):
        term = opened.bounced[s]
        own_scale = even_scale if layer.model.lobe == "cosine" and not layer.delta else scale
        columns = [
            (term.column + k * term.stride, own_scale * q)
            for k, q in enumerate(term.quotients[: layer.model.rank])
        ]
        first = sum(item.columns for item in layers[:s])
        found = _collect(row, cell, hit, columns, len(pixels), rays)
        found.column -= first
        colour = through if H[s] is None else through * H[s]
        tint = _tints(row, own, mi.Color3f(colour), mi.Float(dr.mean(weight)), len(pixels))
        result.append(LayerSamples(found, tint, coverage))
    return result


def from_cells(
    paths: Paths, finder: CellFinder, samples: GatherSamples, cells: Int32, rays: int, seed: int
) -> Samples:
    """`rays` (a square) cosine-distributed rays from the points of each of some cells: M.

    One column, whose values add up to at most 1: what is gathered is an irradiance over π.
    """
    lanes = len(cells) * rays
    sampler, random = stratified(rays, lanes, seed)
    row = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, rays)
    points = samples.point.shape[1]
    own = (cells[:, None] * points + np.arange(points)).ravel()
    which = dr.minimum(mi.UInt32(sampler.next_1d() * points), points - 1) + row * points

    def gathered(values: Float32) -> Any:
        table = mi.Float(np.ascontiguousarray(values.reshape(-1, 3)[own]).ravel())
        return dr.gather(mi.Vector3f, table, which)

    si = dr.zeros(mi.SurfaceInteraction3f, lanes)
    si.p, si.n = mi.Point3f(gathered(samples.point)), mi.Normal3f(gathered(samples.point_surface))
    frame = mi.Frame3f(gathered(samples.point_normal))
    d = frame.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
    above = dr.dot(si.n, d) > 0
    u3 = mi.Point2f(random.next_float32(), random.next_float32())
    cell, hit = _land(paths, finder, si, d, u3, random, above, None)
    return _collect(row, cell, hit, [(mi.UInt32(0), mi.Float(1))], len(cells), rays)


def _land(
    paths: Paths,
    finder: CellFinder,
    si: Any,
    d: Any,
    u: Any,
    random: Any,
    active: Any,
    onward: OnwardCells | None,
) -> tuple[list[Any], list[Any]]:
    """The cells where rays land, and how much of each arrives: 0 where nothing does.

    The cell that is met, and one of a light that it shows.
    """
    met, random = paths.meet(si.spawn_ray(d), random, active)
    hit = met.si
    flip = dr.select(hit.wi.z < 0, -1, mi.Float(1))
    cell = finder.find_blurred(met.obj, hit.p, hit.sh_frame.n * flip, u, met.valid)
    share = dr.select(met.valid, dr.mean(met.throughput), 0)
    if onward is None:
        return [cell], [share]
    further, weight = onward.reach(met, random)
    return [cell, further], [share, share * weight]


def _collect(
    row: Any,
    cells: list[Any],
    hits: list[Any],
    columns: list[tuple[Any, Any]],
    rows: int,
    rays: int,
) -> Samples:
    """Lanes of several columns as one list, without those of no light."""
    values = [mi.Float(value * hit) for _, value in columns for hit in hits]
    numbers = [mi.UInt32(column) for column, _ in columns for _ in hits]
    places = [mi.UInt32(cell) for _ in columns for cell in cells]
    dr.eval(row, values, numbers, places)
    lanes = rows * rays
    at = np.array(row)
    half = (np.arange(lanes) % 2).astype(bool)
    parts = []
    for number, value, place in zip(numbers, values, places, strict=True):
        own = np.broadcast_to(np.array(value), lanes)
        kept = np.flatnonzero(own)
        which = np.broadcast_to(np.array(number), lanes)[kept]
        found = np.broadcast_to(np.array(place), lanes)[kept]
        parts.append((at[kept], found, which, own[kept] / np.float32(rays), half[kept]))
    joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return Samples(
        joined[0].astype(np.int32),
        joined[1].astype(np.int32),
        joined[2].astype(np.int32),
        joined[3].astype(np.float32),
        joined[4],
    )


def _tints(row: Any, own: Any, colour: Any, weight: Any, rows: int) -> Float32:
    """The mean of a colour over each row's samples: float32 [rows, 3]."""
    dr.eval(row, own, colour, weight)
    used = np.array(own)
    at = np.array(row)
    lanes = len(at)
    share = np.where(used, np.broadcast_to(np.array(weight), lanes), 0)
    total = np.bincount(at, share, rows)
    result = np.zeros((rows, 3), np.float32)
    for c in range(3):
        own_colour = np.where(used, np.broadcast_to(np.array(colour[c]), lanes), 0)
        sums = np.bincount(at, own_colour, rows)
        result[:, c] = np.divide(sums, total, out=np.zeros(rows), where=total != 0)
    return result
