"""Baking: every editable material left symbolic, tile by tile, into a bundle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.precompute.accumulate import STRATA, Accumulator, Rectangle
from burnish.precompute.plan import check_memory, tiles_for
from burnish.precompute.prepass import find_rows
from burnish.precompute.symbolic import SymbolicMaterials
from burnish.precompute.tracer import Tracer
from burnish.scene import Scene
from burnish.transport.basis import Basis
from burnish.transport.block import Block, Tile
from burnish.transport.compression import compress_tile
from burnish.transport.rows import Rows


@dataclass
class ViewPlan:
    """One view of a bake: its tracer, rows and tiles."""

    name: str
    tracer: Tracer
    rows: Rows
    tiles: list[Rectangle]

    @property
    def largest(self) -> int:
        """Pixels of the largest tile."""
        return max(tile.width * tile.height for tile in self.tiles)

    def tile_rows(self, tile: Rectangle) -> Rows:
        """The rows inside a tile."""
        width = self.tracer.view.width
        x, y = self.rows.pixel % width, self.rows.pixel // width
        inside = (x >= tile.x) & (x < tile.x + tile.width)
        inside &= (y >= tile.y) & (y < tile.y + tile.height)
        return self.rows.select(inside)


def plan_views(scene: Scene, basis: Basis, seed: int) -> list[ViewPlan]:
    """Rows and tiles of every view. Raises TooLarge before anything is traced."""
    materials = SymbolicMaterials(scene, basis)
    plans = []
    for view in scene.views:
        tracer = Tracer(scene, view, materials)
        rows = find_rows(tracer, tile_seed(seed, view.name, -1, 0)).rows
        check_memory(basis, rows, view.width, view.height)
        tiles = tiles_for(basis, rows, view.width, view.height)
        plans.append(ViewPlan(view.name, tracer, rows, tiles))
    return plans


def trace_tile(plan: ViewPlan, number: int, spp: int, seed: int, tolerance: float) -> Tile:
    """Trace one tile to the end and compress it."""
    rectangle = plan.tiles[number]
    accumulator = Accumulator(plan.tracer, rectangle, plan.tile_rows(rectangle))
    for index, samples in enumerate(strata(spp)):
        accumulator.run(samples, tile_seed(seed, plan.name, number, index), plan.largest)
    return finished_tile(accumulator, tolerance)


def finished_tile(accumulator: Accumulator, tolerance: float) -> Tile:
    """What an accumulator has gathered, compressed."""
    rectangle, tracer = accumulator.rectangle, accumulator.tracer
    blocks: list[Block] = []
    # Sums, not means: scaling a whole tile copies up to a gigabyte, of which most is zero
    for run, T in zip(accumulator.layout.runs, accumulator.places(), strict=True):
        which = np.arange(run.start, run.stop, dtype=np.int32)
        blocks += compress_tile(
            T,
            accumulator.rows,
            which,
            tracer.view.width,
            tracer.basis,
            tolerance,
            1 / max(accumulator.samples, 1),
            run.arrangement.keys,
        )
    rows, blocks = drop_unused(accumulator.rows, blocks)
    t = accumulator.target
    return Tile(
        rectangle.x,
        rectangle.y,
        rectangle.width,
        rectangle.height,
        rows,
        blocks,
        accumulator.image(t.fixed),
        accumulator.image(t.emission),
        accumulator.samples,
        int(np.array(t.lost)[0]),
    )


def drop_unused(rows: Rows, blocks: list[Block]) -> tuple[Rows, list[Block]]:
    """Without the rows that were only a precaution: never seen, and in no block."""
    used = rows.weight > 0
    for block in blocks:
        used[block.rows] = True
    position = np.cumsum(used) - 1
    renumbered = [replace(block, rows=position[block.rows].astype(np.int32)) for block in blocks]
    return rows.select(used), renumbered


def strata(spp: int) -> list[int]:
    """Split a budget into powers of four that are each stratified by themselves.

    At most STRATA each, and of two sizes at most, the smaller a quarter of the larger, since
    each size is a kernel of its own. Rounds up.
    """
    if spp < 1:
        raise InvalidValue(f"spp must be at least 1; got {spp}")
    size = _stratum(spp)
    quarter = max(size // 4, 1)
    count, rest = divmod(spp, size)
    quarters = -(-rest // quarter)
    if rest and quarters == size // quarter:
        return strata(size * (count + 1))
    return [size] * count + [quarter] * quarters


def whole_strata(spp: float) -> int:
    """The most samples, at least one, that are no more than `spp` and split without rest."""
    most = max(int(spp), 1)
    quarter = max(_stratum(most) // 4, 1)
    return most // quarter * quarter


def _stratum(spp: int) -> int:
    """The larger of the sizes that a budget is split into."""
    size = STRATA
    while size > spp:
        size //= 4
    return size


def tile_seed(seed: int, view: str, tile: int, stratum: int) -> int:
    """A 32-bit seed of its own for every stratum of every tile of every view."""
    words = [seed & 0xFFFFFFFF, *view.encode(), tile & 0xFFFFFFFF, stratum]
    return int(np.random.SeedSequence(words).generate_state(1)[0])
