"""Direct light for relighting: a scene of its own, whose lights are moved in place.

Implements `transport.protocols.DirectLight`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from burnish.core.types import Float32
from burnish.materials.layer import unpainted
from burnish.materials.lights import factors, lights_in, placements, without_lights
from burnish.precompute.relight.columns import DirectColumns
from burnish.precompute.relight.direct import CellLights, DirectView, LightFactors
from burnish.precompute.relight.paths import Paths
from burnish.precompute.symbolic import SymbolicMaterials
from burnish.scene import Scene
from burnish.scene.moving import LightMover
from burnish.transport.basis import Basis, State
from burnish.transport.gather import GatherData

LARGEST_PASS = 64
"""Samples per pixel that are traced at once."""

Trace = Callable[[int, int], tuple[Float32, ...]]
"""(samples, seed) to pictures, per sample."""


@dataclass
class _Estimate:
    """A mean that grows. key: of what it is an estimate."""

    key: object
    values: tuple[Float32, ...] = ()
    samples: int = 0

    def grow(self, samples: int, trace: Trace, seed: int) -> tuple[Float32, ...]:
        """With at least so many samples; what is missing comes in passes."""
        while self.samples < samples:
            count = min(samples - self.samples, LARGEST_PASS)
            count = _square(count)
            fresh = trace(count, seed + 65537 * self.samples)
            if not self.samples:
                self.values, self.samples = fresh, count
                continue
            total = self.samples + count
            a, b = np.float32(self.samples / total), np.float32(count / total)
            pairs = zip(self.values, fresh, strict=True)
            self.values = tuple(a * old + b * new for old, new in pairs)
            self.samples = total
        return self.values


class RelitScene:
    """The direct light of a scene under any lights.

    scene: nobody else may trace it, since its lights are moved in place. Answers one thread at a
    time.
    """

    def __init__(self, scene: Scene, data: GatherData) -> None:
        self.scene, self.data = scene, data
        self.lock = threading.RLock()
        self._mover, self._factors = LightMover(scene), LightFactors(scene)
        self._cells = CellLights(scene, data.samples, self._factors)
        self._lights: object = None
        self._irradiance = _Estimate(None)
        self._pictures: dict[str, _Estimate] = {}
        self._columns: dict[tuple[str, int], _Estimate] = {}
        self._tracers: dict[tuple[str, int], DirectColumns] = {}
        self._settled: tuple[object, Paths] | None = None
        basis = data.basis
        self._series = (basis.series[0], 1, 1)
        self._open = Paths(scene, SymbolicMaterials(scene, Basis(basis.objects, self._series)))
        self._places = [
            next(o for o, thing in enumerate(scene.objects) if thing.id == item.id)
            for item in basis.objects
        ]

    def _place(self, state: State) -> object:
        """Put the lights as a state has them; what says so."""
        wanted = dict(lights_in(state))
        if self._lights is None or self._lights != wanted:
            placed = placements(self.scene.lights, state)
            self._mover.place(placed)
            self._factors.set(factors(self.scene.lights, state), tuple(placed))
            self._lights = wanted
        return self._lights

    def irradiance(self, state: State, samples: int) -> tuple[Float32, Float32]:
        """E at the points of all cells: float32 [g, p, 3], linear RGB; see `DirectLight`."""
        with self.lock:
            key = self._place(state)
            if self._irradiance.key is not key:
                self._irradiance = _Estimate(key)
            every, shown = self._irradiance.grow(samples, self._cells.irradiance, 1)
            return every, shown

    def emission(self, state: State) -> Float32:
        """What cells show of the lights themselves: float32 [g, 3], linear RGB."""
        with self.lock:
            self._place(state)
            return self._cells.emission()

    def picture(
        self, view: str, state: State, without: tuple[int, ...], samples: int
    ) -> tuple[Float32, Float32]:
        """Direct light and directly seen emission: float32 [height, width, 3] each."""
        with self.lock:
            lights, materials = self._place(state), self._materials(state, without)
            known = self._pictures.get(view)
            key = lights, materials, without
            if known is None or not _same(known.key, key):
                known = self._pictures[view] = _Estimate(key)
            black = [self._places[i] for i in without]
            shown = DirectView(self._paths(materials), self.scene.view(view), self._factors, black)
            light, emission = known.grow(samples, shown.picture, 2)
            return light, emission

    def columns(self, view: str, index: int, state: State, samples: int) -> Float32:
        """Direct light on an object's rows by column: float32 [rows, columns, 3]."""
        with self.lock:
            lights = self._place(state)
            place = view, index
            if place not in self._tracers:
                rows = self.data.views[view].rows
                pixels = rows.pixel[rows.object == index]
                self._tracers[place] = DirectColumns(
                    self._open, self.scene.view(view), pixels, index, self._factors
                )
            known = self._columns.get(place)
            if known is None or known.key is not lights:
                # Those of earlier lights are not wanted again
                self._columns = {k: v for k, v in self._columns.items() if v.key is lights}
                known = self._columns[place] = _Estimate(lights)
            tracer = self._tracers[place]
            trace: Trace = lambda count, seed: (tracer.trace(count, seed),)  # noqa: E731
            return known.grow(samples, trace, 3)[0]

    def _materials(self, state: State, without: tuple[int, ...]) -> State:
        """The materials that a picture without some objects is of."""
        materials = unpainted(without_lights(state))
        for i in without:
            item = self.data.basis.objects[i]
            materials[item.id] = item.material.initial
        return materials

    def _paths(self, materials: State) -> Paths:
        if self._settled is None or self._settled[0] != materials:
            own = {item.id for item in self.data.basis.objects}
            numeric = {name: item for name, item in materials.items() if name in own}
            bare = Basis((), self._series)
            found = SymbolicMaterials(self.scene, bare, numeric, compile_for=sorted(own))
            self._settled = (materials, Paths(self.scene, found))
        return self._settled[1]


def _same(a: object, b: tuple[object, State, tuple[int, ...]]) -> bool:
    assert isinstance(a, tuple)
    return a[0] is b[0] and a[2] == b[2] and bool(a[1] == b[1])


def _square(count: int) -> int:
    """The largest square of a whole number up to `count`."""
    root = int(np.sqrt(count))
    return root * root
