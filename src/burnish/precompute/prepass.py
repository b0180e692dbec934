"""Which objects each pixel meets first: the rows of a view, found before a bake."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import AnyArray, Bool, Float64, Int32
from burnish.precompute.symbolic import NUMERIC, PLAIN
from burnish.precompute.tracer import MIRROR_PDF, Tracer
from burnish.transport.rows import POINTS, Rows

SAMPLES = 32
"""Camera samples per pixel of the prepass. An object that covers less of a pixel than these
can see is still found when a neighbouring pixel sees it."""

ENOUGH = 8
"""Samples of a row whose mean stands by itself."""

LANES = 1 << 21


@dataclass
class Geometry:
    """Rows of a view and whether a pixel sees a rough fixed object: bool [pixels]."""

    rows: Rows
    sees_fixed: Bool


def find_rows(tracer: Tracer, seed: int, samples: int = SAMPLES) -> Geometry:
    """Count first encounters per (pixel, object), then average their geometry.

    samples: camera samples per pixel.
    """
    view = tracer.view
    pixels, objects = view.width * view.height, len(tracer.basis.objects)
    counts = dr.zeros(mi.UInt32, max(pixels * objects, 1))
    fixed_seen = dr.zeros(mi.UInt32, pixels)
    dr.make_opaque(counts, fixed_seen)
    for pixel, sampler in _passes(tracer, seed, samples):
        si, symbolic, rough, _ = _first_encounter(tracer, pixel, sampler)
        met = si.is_valid() & (symbolic >= 0)
        dr.scatter_add(counts, mi.UInt32(1), pixel * objects + mi.UInt32(symbolic), met)
        dr.scatter_add(fixed_seen, mi.UInt32(1), pixel, rough)
        dr.eval(counts, fixed_seen)
    count = np.array(counts)[: pixels * objects].reshape(pixels, objects)
    seen = dilate((count > 0).reshape(view.height, view.width, objects)).reshape(pixels, objects)
    rough = dilate((np.array(fixed_seen) > 0).reshape(view.height, view.width, 1)).reshape(pixels)

    # Fine rows where an object is seen; indirect rows of every object where a fixed one is
    fine_object, fine_pixel = np.nonzero(seen.T)
    indirect_pixel = np.nonzero(rough)[0]
    rows = Rows.empty()
    parts = []
    for i in range(objects):
        own = fine_pixel[fine_object == i]
        parts.append(_blank(own, i, False))
        parts.append(_blank(indirect_pixel, i, True))
    rows = Rows.concatenate(parts)
    rows.weight[:] = np.where(rows.indirect, 0, count[rows.pixel, rows.object] / samples).astype(
        np.float32
    )
    _average_geometry(tracer, seed, samples, rows)
    _spread_points(tracer, seed, rows)
    return Geometry(rows, rough)


def dilate(mask: Bool) -> Bool:
    """True where a 3 × 3 neighbourhood has a True: bool [height, width, n]."""
    padded = np.pad(mask, ((1, 1), (1, 1), (0, 0)))
    height, width = mask.shape[:2]
    result = np.zeros_like(mask)
    for dy in range(3):
        for dx in range(3):
            result |= padded[dy : dy + height, dx : dx + width]
    return result


def row_table(rows: Rows, pixels: int, objects: int) -> Int32:
    """Position of each (pixel, object, indirect) in `rows`, -1 for none."""
    table = np.full((pixels, max(objects, 1), 2), -1, np.int32)
    table[rows.pixel, rows.object, rows.indirect.astype(np.int32)] = np.arange(len(rows))
    return table


def _passes(tracer: Tracer, seed: int, samples: int) -> Any:
    """Lanes of camera samples, a few samples per pixel at a time."""
    pixels = tracer.view.width * tracer.view.height
    per_pass = max(1, min(samples, LANES // pixels))
    while samples % per_pass:
        per_pass -= 1
    sampler = mi.load_dict({"type": "independent"})
    for number in range(samples // per_pass):
        sampler.seed(seed + 7919 * number, pixels * per_pass)
        yield dr.arange(mi.UInt32, pixels * per_pass) // per_pass, sampler


def _first_encounter(
    tracer: Tracer, pixel: Any, sampler: Any, place: Any = None
) -> tuple[Any, Any, Any, Any]:
    """Follow mirror-like fixed vertices to the first symbolic object.

    place: where in the pixel's filter the ray begins, in the unit square; at random without it.
    Returns (hit, symbolic index or -1, met a rough fixed object, cosθo in the frame that the
    object's material reflects in).
    """
    width = tracer.view.width
    drawn = sampler if place is None else _Placed(sampler, place)
    ray, _ = tracer.camera.ray(mi.Point2u(pixel % width, pixel // width), drawn)
    scene, bounces = tracer.scene.mi_scene, tracer.basis.bounces

    def body(
        ray: Any,
        hit: Any,
        cos_theta_o: Any,
        symbolic: Any,
        rough: Any,
        depth: Any,
        active: Any,
        sampler: Any,
    ) -> tuple[Any, ...]:
        si = scene.ray_intersect(ray, mi.RayFlags.All, True, active)
        valid = active & si.is_valid()
        obj, found = tracer.object_of(si, valid)
        passing = mi.Bool(False)
        if tracer.materials.masks:
            passing = tracer.materials.passes(si, obj, sampler.next_1d(), valid & (found != PLAIN))
        frame = tracer.materials.orient(si, obj, valid & (found != PLAIN))
        met = valid & (found >= 0) & ~passing
        hit = dr.select(met, si, hit)
        cos_theta_o = dr.select(met, dr.abs(frame.wo.z), cos_theta_o)
        symbolic = dr.select(met, found, symbolic)
        plain = valid & ~met & ~passing
        u1, u2 = sampler.next_1d(), sampler.next_2d()
        bs, weight = si.bsdf(ray).sample(mi.BSDFContext(), si, u1, u2, plain & (found == PLAIN))
        mirror = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta) | (bs.pdf >= MIRROR_PDF)
        reflects = plain & dr.any(weight != 0)
        direction = mi.Vector3f(bs.wo)
        if tracer.materials.any_numeric:
            numeric = plain & (found == NUMERIC) & (frame.wo.z > 0)
            wi, pdf, is_delta = tracer.materials.sample(obj, frame.wo, u1, u2)
            direction = dr.select(numeric, frame.to_shading(wi)[0], direction)
            mirror = dr.select(numeric, is_delta | (pdf >= MIRROR_PDF), mirror)
            reflects |= numeric & (pdf > 0)
        # A lobe is sampled both ways in time: one rough sample marks the pixel
        rough |= reflects & ~mirror
        depth += 1
        ray = si.spawn_ray(dr.select(passing, ray.d, si.to_world(direction)))
        going = (passing | (reflects & mirror)) & (depth < bounces)
        return ray, hit, cos_theta_o, symbolic, rough, depth, going, sampler

    _, hit, cos_theta_o, symbolic, rough, _, _, _ = dr.while_loop(
        (
            ray,
            dr.zeros(mi.SurfaceInteraction3f, dr.width(pixel)),
            mi.Float(1),
            mi.Int32(-1),
            mi.Bool(False),
            mi.UInt32(0),
            dr.full(mi.Bool, True, dr.width(pixel)),
            sampler,
        ),
        lambda *state: state[6],
        body,
        label="first encounters",
    )
    return hit, symbolic, rough, cos_theta_o


def _blank(pixel: Any, index: int, indirect: bool) -> Rows:
    count = len(pixel)
    return Rows(
        pixel=pixel.astype(np.int32),
        object=np.full(count, index, np.int32),
        indirect=np.full(count, indirect, np.bool_),
        weight=np.zeros(count, np.float32),
        position=np.zeros((count, 3), np.float32),
        normal=np.zeros((count, 3), np.float32),
        uv=np.zeros((count, 2), np.float32),
        cos_theta_o=np.ones(count, np.float32),
    )


def _average_geometry(tracer: Tracer, seed: int, samples: int, rows: Rows) -> None:
    """Fill the means of position, normal, uv and outgoing cosine of the fine rows."""
    pixels, objects = tracer.view.width * tracer.view.height, len(tracer.basis.objects)
    table = mi.Int32(row_table(rows, pixels, objects).ravel())
    sums = dr.zeros(mi.Float, max(len(rows), 1) * 10)
    # A literal array would carry its length into the kernel, and compile one for each
    dr.make_opaque(sums)
    for pixel, sampler in _passes(tracer, seed, samples):
        si, symbolic, _, cos_theta_o = _first_encounter(tracer, pixel, sampler)
        met = si.is_valid() & (symbolic >= 0)
        row = dr.gather(
            mi.Int32, table, (pixel * objects + mi.UInt32(dr.maximum(symbolic, 0))) * 2, met
        )
        met &= row >= 0
        values = [1.0, *si.p, *si.n, *si.uv, cos_theta_o]
        for k, value in enumerate(values):
            dr.scatter_add(sums, mi.Float(value), mi.UInt32(row) * 10 + k, met)
        dr.eval(sums)
    total = np.array(sums).reshape(-1, 10)[: len(rows)]
    known = total[:, 0] > 0
    mean = total[known, 1:] / total[known, :1]
    rows.position[known] = mean[:, 0:3]
    length = np.linalg.norm(mean[:, 3:6], axis=1, keepdims=True)
    rows.normal[known] = mean[:, 3:6] / np.maximum(length, 1e-12)
    rows.uv[known] = mean[:, 6:8]
    cosine = _steadied(tracer, rows, total[:, 9].astype(np.float64), total[:, 0])
    rows.cos_theta_o[known] = np.clip(cosine[known], 0, 1)
    _borrow(rows, known, tracer.view.width)


def _steadied(tracer: Tracer, rows: Rows, sums: Float64, counts: AnyArray) -> Float64:
    """Mean outgoing cosines, those of rows that few samples met drawn towards their neighbours'.

    At a silhouette a single sample may graze the surface, and then the row's factor s(θo) for a
    much smoother surface would be hundreds of times too large.
    sums, counts: of the samples of each row, [r]. Returns float64 [r].
    """
    width, height = tracer.view.width, tracer.view.height
    table = row_table(rows, width * height, len(tracer.basis.objects))[:, :, 0]
    few = np.flatnonzero((counts > 0) & (counts < ENOUGH))
    y, x = np.divmod(rows.pixel[few], width)
    near_sum, near_count = np.zeros(len(few)), np.zeros(len(few))
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            inside = (y + dy >= 0) & (y + dy < height) & (x + dx >= 0) & (x + dx < width)
            pixel = np.where(inside, (y + dy) * width + x + dx, 0)
            row = table[pixel, rows.object[few]]
            use = inside & (row >= 0)
            near_sum += np.where(use, sums[row], 0.0)
            near_count += np.where(use, counts[row], 0.0)
    result = sums / np.maximum(counts, 1)
    lacking = ENOUGH - counts[few]
    result[few] = (sums[few] + lacking * near_sum / near_count) / ENOUGH
    return np.asarray(result)


@dataclass
class _Placed:
    """A sampler whose first point, the one on the film, is given."""

    sampler: Any
    first: Any

    def next_2d(self) -> Any:
        point, self.first = self.first, None
        return self.sampler.next_2d() if point is None else point

    def next_1d(self) -> Any:
        return self.sampler.next_1d()


def _spread_points(tracer: Tracer, seed: int, rows: Rows) -> None:
    """Where in uv the fine rows' points lie, one from each cell of a grid over the pixel."""
    pixels, objects = tracer.view.width * tracer.view.height, len(tracer.basis.objects)
    side = round(POINTS**0.5)
    assert side * side == POINTS
    table = mi.Int32(row_table(rows, pixels, objects).ravel())
    found = dr.zeros(mi.Float, max(len(rows), 1) * POINTS * 3)
    dr.make_opaque(found)
    for number in range(POINTS):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed + 104729 * (number + 1), pixels)
        corner = mi.UInt32(number % side), mi.UInt32(number // side)
        dr.make_opaque(*corner)
        pixel = dr.arange(mi.UInt32, pixels)
        place = (mi.Point2f(*map(mi.Float, corner)) + sampler.next_2d()) / side
        si, symbolic, _, _ = _first_encounter(tracer, pixel, sampler, place)
        met = si.is_valid() & (symbolic >= 0)
        row = dr.gather(
            mi.Int32, table, (pixel * objects + mi.UInt32(dr.maximum(symbolic, 0))) * 2, met
        )
        met &= row >= 0
        # A literal number would be a kernel of its own
        at = (mi.UInt32(row) * POINTS + corner[1] * side + corner[0]) * 3
        for k, value in enumerate([1.0, *si.uv]):
            dr.scatter(found, mi.Float(value), at + k, met)
        dr.eval(found)
    points = np.array(found).reshape(-1, POINTS, 3)[: len(rows)]
    known = points[..., 0] > 0
    # Points that met something else stand for one that did
    order = np.argsort(~known, axis=1, kind="stable")
    count = known.sum(axis=1)
    turn = np.arange(POINTS) % np.maximum(count, 1)[:, None]
    uv = np.take_along_axis(points[..., 1:], order[..., None], axis=1)
    uv = np.take_along_axis(uv, turn[..., None], axis=1)
    own = (count > 0) & ~rows.indirect
    rows.uv[own] = uv[own].mean(axis=1)
    rows.spread[own] = uv[own] - rows.uv[own][:, None]


def _borrow(rows: Rows, known: Bool, width: int) -> None:
    """Rows that no prepass sample met take their outgoing cosine from a neighbour's row."""
    fine = ~rows.indirect
    for i in np.unique(rows.object):
        own = fine & (rows.object == i)
        missing = np.nonzero(own & ~known)[0]
        source = np.nonzero(own & known)[0]
        if not len(missing) or not len(source):
            continue
        at = {int(p): int(r) for p, r in zip(rows.pixel[source], source, strict=True)}
        for r in missing:
            pixel = int(rows.pixel[r])
            for offset in (-1, 1, -width, width, -width - 1, -width + 1, width - 1, width + 1):
                if pixel + offset in at:
                    near = at[pixel + offset]
                    for name in ("position", "normal", "uv", "cos_theta_o"):
                        getattr(rows, name)[r] = getattr(rows, name)[near]
                    break
