"""A tile of direct light: what materials do with it gathered from triangles, the rest traced.

Columns are gathered (`gather`). Directly seen emission and what fixed objects reflect come from
the path tracer with one bounce, many samples per pixel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float32, Float64, Int64
from burnish.precompute.accumulate import Accumulator, Layout
from burnish.precompute.bake import ViewPlan, drop_unused, strata, tile_seed
from burnish.precompute.direct.compress import compress_rows
from burnish.precompute.direct.gather import Mirror, ObjectLight
from burnish.precompute.direct.lights import Lights, LightTables, find_lights
from burnish.precompute.direct.points import RowPoints, find_points
from burnish.precompute.tracer import CELL
from burnish.scene import Scene
from burnish.transport.basis import Basis
from burnish.transport.block import Block, Tile
from burnish.transport.rows import Rows

POINTS = 4

SMALLEST = 2e-6
"""Steradians of a piece that is not split any more, whatever a coordinate does in it."""

FINENESS = 0.3
"""The same as a length, over the spread of a row's normals: its points blur what is finer."""


@dataclass(frozen=True)
class DirectPlan:
    """What a bake of direct light needs beside the views' plans.

    triangles: asked for of an environment. points: of each row, at which all lights are looked
    at.
    """

    lights: Lights
    tables: LightTables
    triangles: int
    points: int

    @staticmethod
    def of(scene: Scene, basis: Basis, triangles: int, points: int = POINTS) -> DirectPlan:
        """Find the lights of a scene. Raises InvalidValue, SceneError."""
        lights = find_lights(scene, basis, triangles)
        return DirectPlan(lights, LightTables(lights), triangles, points)

    def described(self) -> dict[str, Any]:
        """What a bundle says of its bake."""
        said: dict[str, Any] = {"mode": "direct", "triangles": self.triangles}
        said |= {"lights": len(self.lights), "points": self.points}
        return said | ({"repairs": list(self.lights.repairs)} if self.lights.repairs else {})


def gather_tile(
    direct: DirectPlan,
    plan: ViewPlan,
    number: int,
    spp: int,
    seed: int,
    tolerance: float,
    report: Callable[[float], None] = lambda part: None,
) -> Tile:
    """Gather one tile and compress it. spp: of what is traced. report: called with the part done,
    0 to 1."""
    rectangle, tracer = plan.tiles[number], plan.tracer
    rows = plan.tile_rows(rectangle)
    traced = Accumulator(tracer, rectangle, rows)
    for index, samples in enumerate(strata(spp)):
        traced.run(samples, tile_seed(seed, plan.name, number, index), plan.largest)
    layout, basis = Layout.of(tracer, rows), tracer.basis
    fixed, emission = traced.image(traced.target.fixed), traced.image(traced.target.emission)
    lost, samples = int(np.array(traced.target.lost)[0]), traced.samples
    # Before as much again is needed
    del traced

    points_seed = tile_seed(seed, plan.name, number, 1 << 20)
    where = find_points(tracer, rectangle, rows, direct.points, points_seed)
    buffer = dr.zeros(mi.Float, max(layout.values, 1) * CELL)
    dr.make_opaque(buffer)
    _gather(direct, plan, rows, layout, where, buffer, points_seed, report)
    blocks: list[Block] = []
    values = np.array(buffer, copy=False)[: layout.values * CELL]
    for run, T in zip(layout.runs, layout.split(values), strict=True):
        # One bounce reaches no row by way of another surface
        if run.indirect or run.start == run.stop:
            continue
        _finish(T, basis, run.object, where.share[run.start : run.stop])
        which = np.arange(run.start, run.stop, dtype=np.int32)
        blocks += compress_rows(T, rows, which, tracer.view.width, basis, tolerance)
    kept, blocks = drop_unused(rows, blocks)
    r = rectangle
    return Tile(r.x, r.y, r.width, r.height, kept, blocks, fixed, emission, samples, lost)


def _gather(
    direct: DirectPlan,
    plan: ViewPlan,
    rows: Rows,
    layout: Layout,
    where: RowPoints,
    buffer: Any,
    seed: int,
    report: Callable[[float], None],
) -> None:
    """Sum the light at the points of all rows, object by object and point by point."""
    owner = rows.object[where.found]
    total, done = max(int(where.count.sum()), 1), 0
    for index in np.unique(owner):
        light = ObjectLight(plan.tracer, int(index), direct.tables)
        own = np.nonzero(owner == index)[0]
        for k in range(int(where.count[own].max())):
            here = own[where.count[own] > k]
            report(done / total)
            done += len(here)
            ray = where.chosen[here, k]
            light.add(
                buffer,
                mi.UInt32(layout.offsets[where.found[here]].astype(np.uint32)),
                mi.Point3f(np.ascontiguousarray(where.origin[ray].T)),
                mi.Vector3f(np.ascontiguousarray(where.direction[ray].T)),
                _mirror(where, here, k),
                k,
                seed,
            )


def _mirror(where: RowPoints, here: Int64, k: int) -> Mirror:
    """Which lights the rows `here` of `where` gather at their k-th points, and how finely."""
    spread = where.spread[here]
    return Mirror(
        mi.Vector3f(np.ascontiguousarray(where.mirror[here].T)),
        mi.Float(np.cos(where.near[here]).astype(np.float32)),
        mi.Float((1 / where.count[here]).astype(np.float32)),
        mi.Float(np.where(k < where.far[here], 1 / where.far[here], 0).astype(np.float32)),
        mi.Float(np.maximum((FINENESS * spread) ** 2, SMALLEST).astype(np.float32)),
    )


def _finish(T: Float32, basis: Basis, index: int, share: Float64) -> None:
    """Scale what was gathered by the rows' share in their pixels, in place.

    T: float32 [rows, columns, tails, CELL]. share: float64 [rows, slots, 3], see `RowPoints`.
    """
    for part in basis.slices(index):
        scale = share[:, part.layer, None, None, :].astype(np.float32)
        T[:, part.start : part.stop, :, :3] *= scale
