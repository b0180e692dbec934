"""All of a scene's transfer, from a scene to `GatherData`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Float32, Float64, Int32, Progress
from burnish.materials.coefficients import energies
from burnish.materials.layer import Layer
from burnish.precompute.film import Camera
from burnish.precompute.prepass import find_rows
from burnish.precompute.relight.blocks import Block, Compressor, neighbourhoods, transfer_of
from burnish.precompute.relight.cells import CellFinder
from burnish.precompute.relight.onward import Onward, OnwardCells
from burnish.precompute.relight.paths import Paths
from burnish.precompute.relight.rays import Samples, from_cells, from_rows
from burnish.precompute.relight.shooting import shoot
from burnish.precompute.relight.smoothing import Smoother
from burnish.precompute.symbolic import PLAIN, SymbolicMaterials
from burnish.precompute.tracer import Tracer
from burnish.scene import Scene, View
from burnish.transport.basis import Basis
from burnish.transport.gather import (
    CellTree,
    GatherData,
    GatherSamples,
    GatherView,
    RowTransfer,
    Transfer,
)
from burnish.transport.rows import Rows

LANES = 1 << 20
"""Rays of one launch."""


@dataclass(frozen=True)
class Settings:
    """How fine the transfer is.

    samples: gather samples. rays: through each pixel, a square. bounce_rays: from each cell, a
    square. terms: nodes that a block of one layer reads, of a layer with one column and of one
    with several; bounce_terms: of a block of cells.
    """

    samples: int = 16384
    rays: int = 256
    bounce_rays: int = 256
    matte_terms: int = 1024
    glossy_terms: int = 2048
    bounce_terms: int = 2048
    seed: int = 0


def precompute(
    scene: Scene,
    basis: Basis,
    views: Sequence[str] | None = None,
    settings: Settings | None = None,
    progress: Progress | None = None,
    lit: Scene | None = None,
) -> GatherData:
    """The transfer of some views of a scene (all of them without a choice).

    basis: what can be edited; its length of series counts the bounces. progress: called with the
    fraction done; may raise to cancel. lit: the same scene with its lamps in place, where
    those of `scene` have been put away so that nothing stands in their shadow.
    """
    settings = settings or Settings()
    report = progress or (lambda fraction, what: None)
    chosen = tuple(view for view in scene.views if views is None or view.name in views)
    # A path is open at its first vertex alone, but may meet mirrors before it
    tracing = replace(basis, series=(basis.series[0], 1, 1))
    materials = SymbolicMaterials(scene, tracing)
    paths = Paths(scene, materials)
    report(0.0, "shooting gather samples")
    onward = Onward(lit or scene, tracing)
    tree, samples, finder, shown = shoot(
        scene, chosen, paths, onward, settings.samples, settings.seed
    )
    report(0.02, "light between surfaces")
    bounce = _bounce(paths, finder, tree, samples, settings)
    data = GatherData(basis, tree, samples, bounce)
    for number, view in enumerate(chosen):
        tracer = Tracer(scene, view, materials)
        geometry = find_rows(tracer, settings.seed)
        fine = geometry.rows.select(~geometry.rows.indirect)
        work = _ViewWork(paths, finder, shown, tree, settings, Camera(view), view)
        parts: list[RowTransfer] = []
        targets = [(i, np.flatnonzero(fine.object == i)) for i in range(len(basis.objects))]
        total = max(len(fine), 1)
        done = 0
        for i, own in targets:
            if not len(own):
                continue
            report(
                (number + 0.05 + 0.95 * done / total) / len(chosen),
                f"light on {basis.objects[i].id}",
            )
            parts += work.object(i, own.astype(np.int32), fine.pixel[own], fine)
            done += len(own)
        rough = np.flatnonzero(geometry.sees_fixed).astype(np.int32)
        if len(rough):
            parts += work.object(PLAIN, rough, rough, fine)
        data.views[view.name] = GatherView(view.width, view.height, fine, tuple(parts))
    report(1.0, "done")
    return data


def _bounce(
    paths: Paths, finder: CellFinder, tree: CellTree, samples: GatherSamples, settings: Settings
) -> Transfer:
    compressor = Compressor(tree, 1, settings.bounce_terms)
    blocks: list[Block] = []
    for group in _launches(_runs(len(samples)), settings.bounce_rays):
        cells = np.concatenate(group)
        found = from_cells(
            paths,
            finder,
            samples,
            cells.astype(np.int32),
            settings.bounce_rays,
            settings.seed + int(cells[0]),
        )
        blocks += _compressed(compressor, group, cells.astype(np.int32), found)
    return transfer_of(len(samples), 1, blocks)


def _runs(count: int) -> list[AnyArray]:
    """Neighbours in the order of the tree."""
    return [np.arange(start, min(start + 256, count)) for start in range(0, count, 256)]


def _launches(groups: list[AnyArray], rays: int) -> list[list[AnyArray]]:
    """Groups of rows, as many together as one launch has lanes for."""
    result: list[list[AnyArray]] = []
    room = 0
    for group in groups:
        lanes = len(group) * rays
        if lanes > room:
            result.append([])
            room = max(LANES, lanes)
        result[-1].append(group)
        room -= lanes
    return result


def _compressed(
    compressor: Compressor,
    group: list[AnyArray],
    rows: Int32,
    samples: Samples,
    smoothers: list[Smoother] | None = None,
    coverage: Float32 | None = None,
) -> list[Block]:
    """The blocks of a launch. rows: what each of the launch's rows is called in the matrix."""
    order = np.argsort(samples.row, kind="stable")
    row = samples.row[order]
    ends = np.cumsum([len(own) for own in group])
    cuts = np.searchsorted(row, np.concatenate([[0], ends]))

    def work(k: int) -> Block:
        own = order[cuts[k] : cuts[k + 1]]
        first = int(ends[k] - len(group[k]))
        part = Samples(
            samples.row[own] - first,
            samples.cell[own],
            samples.column[own],
            samples.value[own],
            samples.half[own],
        )
        last = int(ends[k])
        if smoothers is None or coverage is None:
            return compressor.block(rows[first:last], part)
        share = coverage[first:last].astype(np.float64)
        return compressor.block(rows[first:last], part, smoothers[k], share)

    return parallel_map(work, range(len(group)))


@dataclass
class _ViewWork:
    """Makes the transfer to one view."""

    paths: Paths
    finder: CellFinder
    onward: OnwardCells | None
    tree: CellTree
    settings: Settings
    camera: Camera
    view: View

    def object(self, index: int, rows: Int32, pixels: Int32, fine: Rows) -> list[RowTransfer]:
        """The transfer to the rows of one object, layer by layer."""
        settings = self.settings
        columns = [3] if index == PLAIN else [x.columns for x in self._layers(index)]
        compressors = [self._compressor(index, s, count) for s, count in enumerate(columns)]
        blocks: list[list[Block]] = [[] for _ in columns]
        tints = [np.zeros((len(rows), 3), np.float32) for _ in columns]
        place = np.stack([pixels % self.view.width, pixels // self.view.width], axis=1)
        for group in _launches(neighbourhoods(place.astype(np.float64)), settings.rays):
            own = np.concatenate(group).astype(np.int32)
            seed = settings.seed + 7 * int(pixels[own[0]]) + 104729 * (index + 2)
            found = from_rows(
                self.paths,
                self.finder,
                self.camera,
                pixels[own],
                index,
                settings.rays,
                seed,
                self.onward,
            )
            smoothers = None
            if index != PLAIN:
                smoothers = self._smoothers(group, place, rows, fine, found[0].coverage)
            for s, layer in enumerate(found):
                tints[s][own] = layer.tint
                blocks[s] += _compressed(
                    compressors[s], group, own, layer.samples, smoothers, layer.coverage
                )
        return [
            RowTransfer(index, s, rows, tints[s], transfer_of(len(rows), columns[s], blocks[s]))
            for s in range(len(columns))
        ]

    @staticmethod
    def _smoothers(
        group: list[AnyArray], place: Int32, rows: Int32, fine: Rows, coverage: Float32
    ) -> list[Smoother]:
        starts = np.cumsum([0, *(len(own) for own in group)])

        def work(k: int) -> Smoother:
            own = group[k]
            normal, position = fine.normal[rows[own]], fine.position[rows[own]]
            share = coverage[starts[k] : starts[k + 1]]
            return Smoother(*(x.astype(np.float64) for x in (place[own], normal, position, share)))

        return parallel_map(work, range(len(group)))

    def _layers(self, index: int) -> tuple[Layer, ...]:
        return self.paths.materials.basis.objects[index].material.layers

    def _compressor(self, index: int, layer: int, columns: int) -> Compressor:
        if index == PLAIN:
            return Compressor(self.tree, columns, self.settings.matte_terms)
        item = self._layers(index)[layer]
        terms = self.settings.matte_terms if columns == 1 else self.settings.glossy_terms
        return Compressor(self.tree, columns, terms, column_weights(item))


def column_weights(layer: Layer) -> Float64:
    """How much a layer's columns count against each other: float64 [columns].

    A lobe that lies in one bin has coefficients of one over the bin's energy e, a broad one has
    like ones in all: the weight between is e to the power of −½. Principal components count by
    how large their coefficients are.
    """
    sizes = layer.model.amplitude_sizes()
    if sizes is None:
        _, weight, directional = energies(layer)
        energy = np.abs(np.einsum("o,okj->kj", weight, directional))
        peak = float(energy.max()) or 1.0
        scale = 1 / np.sqrt(np.maximum(energy / peak, 1e-4)).ravel()
    else:
        scale = np.maximum(sizes / sizes.max(), 1e-2)
    return np.concatenate([scale, np.ones(int(layer.delta))])
