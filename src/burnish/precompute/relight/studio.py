"""Direct light for relighting: a scene of its own, whose lights are moved in place.

Implements `transport.protocols.DirectLight`.
"""

from __future__ import annotations

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

CELL_SAMPLES = 8
"""Light samples at each point of a cell: with its points, 64 of a cell."""


class RelitScene:
    """The direct light of a scene under any lights.

    scene: nobody else may trace it, since its lights are moved in place. What was asked last is
    kept. spp: samples per pixel of the view, a square.
    """

    def __init__(self, scene: Scene, data: GatherData, spp: int = 64) -> None:
        self.scene, self.data, self.spp = scene, data, spp
        self._mover, self._factors = LightMover(scene), LightFactors(scene)
        self._cells = CellLights(scene, data.samples, self._factors)
        self._lights: object = None
        self._irradiance: Float32 | None = None
        self._pictures: dict[str, tuple[object, Float32, Float32]] = {}
        self._columns: dict[tuple[str, int], tuple[object, DirectColumns, Float32]] = {}
        self._materials: dict[str, tuple[object, Paths]] = {}

    def place(self, state: State) -> None:
        """Put the lights as a state has them."""
        wanted = lights_in(state)
        if self._lights is not None and self._lights == wanted:
            return
        self._mover.place(placements(self.scene.lights, state))
        self._factors.set(factors(self.scene.lights, state))
        self._lights, self._irradiance = wanted, None
        self._pictures.clear()

    def irradiance(self, state: State) -> Float32:
        """E at the points of all cells: float32 [g, p, 3], linear RGB."""
        self.place(state)
        if self._irradiance is None:
            self._irradiance = self._cells.irradiance(CELL_SAMPLES, 1)
        return self._irradiance

    def picture(self, view: str, state: State) -> tuple[Float32, Float32]:
        """Direct light with a state's materials and directly seen emission, and of that the
        emission alone: float32 [height, width, 3]."""
        self.place(state)
        materials = unpainted(without_lights(state))
        known = self._pictures.get(view)
        if known is None or known[0] != materials:
            shown = DirectView(self._paths(materials), self.scene.view(view), self._factors)
            known = self._pictures[view] = (materials, *shown.picture(self.spp, 1))
        return known[1], known[2]

    def columns(self, view: str, index: int, state: State) -> Float32:
        """Direct light on an object's rows by column: float32 [rows, columns, 3].

        Rows in the order of the view's.
        """
        self.place(state)
        key = view, index
        lights = dict(lights_in(state))
        known = self._columns.get(key)
        if known is None:
            rows = self.data.views[view].rows
            pixels = rows.pixel[rows.object == index]
            tracer = DirectColumns(
                Paths(self.scene, self._open()), self.scene.view(view), pixels, index, self._factors
            )
            known = self._columns[key] = (lights, tracer, tracer.trace(self.spp, 1))
        elif known[0] != lights:
            known = self._columns[key] = (lights, known[1], known[1].trace(self.spp, 1))
        return known[2]

    def _open(self) -> SymbolicMaterials:
        basis = self.data.basis
        return SymbolicMaterials(self.scene, Basis(basis.objects, (basis.series[0], 1, 1)))

    def _paths(self, materials: State) -> Paths:
        known = self._materials.get("")
        if known is None or known[0] != materials:
            own = {item.id for item in self.data.basis.objects}
            numeric = {name: item for name, item in materials.items() if name in own}
            bare = Basis((), (self.data.basis.series[0], 1, 1))
            found = SymbolicMaterials(self.scene, bare, numeric, compile_for=sorted(own))
            known = self._materials[""] = (materials, Paths(self.scene, found))
        return known[1]
