"""Where in a row direct light is gathered: a few of the camera's samples, for all that meet it.

Many samples tell how much of a pixel an object covers and what its texture is there; light
varies more slowly, and is gathered at a few of them, evenly chosen: at more where the normals
differ so much inside a pixel that sharp reflections do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float32, Float64, Int32, Int64
from burnish.materials.layer import Layer
from burnish.precompute.accumulate import Rectangle
from burnish.precompute.tracer import Tracer
from burnish.transport.rows import Rows

SAMPLES = 256
"""Camera samples per pixel that coverage and textures are averaged over; a square number."""

MOST_POINTS = 64

LANES = 1 << 20

CURVED = ((0.006, 4, 1), (0.03, 16, 4))
"""Standard deviation of a row's normals in radians, and how many times as many points it gets
from there on where its object is glossy: for the lights around its mirror direction, no more
than MOST_POINTS in all, and for the others."""

NEAR = 0.35
"""Radians around the mirror direction of a curved row in which all its points gather light, and
twice the spread of its normals more."""

MATTE = 4
"""How many times as many points the rows of other objects get: they are as much faster, and
what is left to see in them are the edges of shadows."""


@dataclass(frozen=True)
class RowPoints:
    """Where the rows of a rectangle are gathered.

    found: int32 [n], the rows that any sample met. count: int64 [n], points of each. chosen:
    int64 [n, most points], which camera rays: of origin, direction, float32 [rays, 3]; only the
    first `count` of each row are meant. share: float64 [rows, slots, 3], what the mean over the
    points is multiplied by for each layer slot: the part of the pixel's filter that the object
    covers, times the mean of the layer's weight map over it. mirror: float32 [n, 3], where the
    mean normal mirrors the eye to; near: float64 [n], radians around it in which all points of
    a row gather light, and the first `far`, int64 [n], alone elsewhere; spread: float64 [n],
    standard deviation of the normals in radians.
    """

    found: Int32
    count: Int64
    chosen: Int64
    origin: Float32
    direction: Float32
    share: Float64
    mirror: Float32
    near: Float64
    far: Int64
    spread: Float64


def find_points(
    tracer: Tracer, rectangle: Rectangle, rows: Rows, points: int, seed: int
) -> RowPoints:
    """Send camera rays through a rectangle and choose of each row's.

    points: how many of a row that is not curved.
    """
    area, objects = rectangle.width * rectangle.height, len(tracer.basis.objects)
    slots = max(tracer.materials.slots, 1)
    table = _row_table(tracer, rectangle, rows)
    sums = dr.zeros(mi.Float, max(len(rows), 1) * slots * 3)
    normals = dr.zeros(mi.Float, max(len(rows), 1) * 3)
    dr.make_opaque(sums, normals)
    per_pass = max(1, min(SAMPLES, LANES // area))
    per_pass = 1 << (per_pass.bit_length() - 1)
    sampler = mi.load_dict({"type": "multijitter", "sample_count": SAMPLES})
    sampler.set_samples_per_wavefront(per_pass)
    sampler.seed(seed & 0xFFFFFFFF, area * per_pass)
    local = dr.arange(mi.UInt32, area * per_pass) // per_pass
    pixel = mi.Point2u(
        rectangle.x + local % rectangle.width, rectangle.y + local // rectangle.width
    )
    dr.make_opaque(pixel, local)
    met_rows, origins, directions = [], [], []
    for number in range(SAMPLES // per_pass):
        if number:
            sampler.advance()
        sampler.schedule_state()
        dr.eval()
        ray, weight = tracer.camera.ray(pixel, sampler)
        row, normal, H = _met(tracer, ray, sampler, table, local, objects)
        for k in range(3):
            dr.scatter_add(normals, normal[k], mi.UInt32(row) * 3 + k, row >= 0)
        for s in range(slots):
            value = weight if not H or H[s] is None else weight * H[s]
            for k in range(3):
                dr.scatter_add(sums, value[k], (mi.UInt32(row) * slots + s) * 3 + k, row >= 0)
        dr.eval(sums, normals, row, ray)
        met_rows.append(np.array(row))
        origins.append(np.array(ray.o).T)
        directions.append(np.array(ray.d).T)
    met = np.concatenate(met_rows)
    counts = np.bincount(met[met >= 0], minlength=len(rows))
    found = np.nonzero(counts)[0].astype(np.int32)
    normal = np.array(normals).astype(np.float64).reshape(-1, 3)[found] / counts[found, None]
    length = np.linalg.norm(normal, axis=1)
    spread = np.sqrt(np.maximum(1 - length * length, 0))
    wanted = np.zeros(len(rows), np.int64)
    wanted[found], far, near = _wanted(tracer, rows.object[found], spread, points)
    chosen = _choose(met, counts, wanted, found)
    direction = np.concatenate(directions).astype(np.float32)
    eye = -direction[chosen[:, 0]]
    normal /= np.maximum(length, 1e-12)[:, None]
    return RowPoints(
        found,
        wanted[found],
        chosen,
        np.concatenate(origins).astype(np.float32),
        direction,
        np.array(sums).astype(np.float64).reshape(-1, slots, 3)[: len(rows)] / SAMPLES,
        (2 * (eye * normal).sum(axis=1, keepdims=True) * normal - eye).astype(np.float32),
        near,
        far,
        spread,
    )


def _wanted(
    tracer: Tracer, objects: Int32, spread: Float64, points: int
) -> tuple[Int64, Int64, Float64]:
    """How many points rows get, int64 [n], how many of them for lights elsewhere than within
    an angle round the mirror direction, and this angle."""
    glossy = np.array([_is_glossy(item.material.layers) for item in tracer.basis.objects])[objects]
    factor = np.where(glossy, 1, MATTE)
    elsewhere = np.ones(len(objects), np.int64)
    for least, more, far in CURVED:
        factor[(spread > least) & glossy] = more
        elsewhere[(spread > least) & glossy] = far
    curved = glossy & (factor > 1)
    near = np.where(curved, np.minimum(NEAR + 2 * spread, np.pi), np.pi)
    count = np.minimum(points * factor, MOST_POINTS)
    return count, np.minimum(points * elsewhere, count), near


def _is_glossy(layers: Sequence[Layer]) -> bool:
    return any(
        layer.model.lobe == "half" or layer.model.coordinate_name == "theta_r" for layer in layers
    )


def _row_table(tracer: Tracer, rectangle: Rectangle, rows: Rows) -> Any:
    """The fine row of each (pixel of the rectangle, object), or -1: mi.Int32."""
    objects = max(len(tracer.basis.objects), 1)
    table = np.full((rectangle.width * rectangle.height, objects), -1, np.int32)
    x = rows.pixel % tracer.view.width - rectangle.x
    y = rows.pixel // tracer.view.width - rectangle.y
    fine = ~rows.indirect
    local = y * rectangle.width + x
    table[local[fine], rows.object[fine]] = np.nonzero(fine)[0]
    result = mi.Int32(table.ravel())
    dr.make_opaque(result)
    return result


def _met(
    tracer: Tracer, ray: Any, sampler: Any, table: Any, local: Any, objects: int
) -> tuple[Any, Any, list[Any]]:
    """The row that each ray's first hit belongs to, or -1; its normal and its weight maps."""
    m = tracer.materials
    si = tracer.scene.mi_scene.ray_intersect(ray)
    valid = si.is_valid()
    obj, symbolic = tracer.object_of(si, valid)
    ours = valid & (symbolic >= 0)
    if m.masks:
        ours &= ~m.passes(si, obj, sampler.next_1d(), ours)
    frame = m.orient(si, obj, ours)
    ours &= frame.wo.z > 0
    index = local * max(objects, 1) + mi.UInt32(dr.maximum(symbolic, 0))
    row = dr.select(ours, dr.gather(mi.Int32, table, index, ours), -1)
    normal = si.to_world(frame.to_shading(mi.Vector3f(0, 0, 1))[0])
    return row, normal, m.weight_maps(si, obj, ours)


def _choose(met: Int32, counts: Int64, wanted: Int64, found: Int32) -> Int64:
    """Samples of each found row, evenly among those that met it: int64 [n, most points]."""
    order = np.argsort(met, kind="stable")
    first = len(met) - counts.sum() + np.cumsum(counts) - counts
    most = int(wanted[found].max(initial=1))
    steps = (np.arange(most) + 0.5) / wanted[found, None]
    at = first[found, None] + (np.minimum(steps, 0.999) * counts[found, None]).astype(np.int64)
    return order[at]
