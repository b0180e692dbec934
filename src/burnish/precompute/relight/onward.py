"""What a glossy surface shows of the lights, beside the matte light of its cell.

A cell sends the same light towards all sides, as the paper's M_s has it. That is far from
true of a polished floor under an environment, which throws a picture of it on what stands
there. So a path goes on once more from where it lands, along the glossy layers of what it has
met, as they are in the scene; where it then leaves the scene, or meets a lamp, it has found a
cell of the sky or the lamp's own. Light that comes by that way is no part of a cell's matte
light.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import AnyArray
from burnish.precompute.encounter import open_first
from burnish.precompute.relight.cells import CellFinder
from burnish.precompute.relight.paths import Met
from burnish.precompute.symbolic import NUMERIC, SymbolicMaterials
from burnish.scene import Scene
from burnish.transport.basis import Basis

SKIES = ("envmap", "constant")
"""Backgrounds that cells of the sky can show: others have a sun in them."""


class Onward:
    """Paths that go on along glossy layers.

    scene: with its lamps in place.
    """

    def __init__(self, scene: Scene, basis: Basis) -> None:
        numeric = {item.id: item.material.initial for item in basis.objects}
        self._materials = SymbolicMaterials(scene, Basis((), (basis.series[0], 1, 1)), numeric)
        self.scene = scene
        slots = max(self._materials.slots, 1)
        glossy = np.zeros((len(scene.objects), slots), np.float32)
        for o, layers in enumerate(self._materials.layered):
            glossy[o, : len(layers)] = [layer.model.lobe == "half" for layer in layers]
        self._glossy = mi.Float(glossy.ravel())
        dr.make_opaque(self._glossy)
        self._light = mi.UInt32(scene.light_table)
        lamp = [light.kind == "area" and bool(light.shapes) for light in scene.lights]
        self._lamp = mi.UInt32(np.array(lamp, np.uint32))
        self.lamps = np.flatnonzero(lamp)
        skies = [n for n, light in enumerate(scene.lights) if light.kind in SKIES]
        self.sky = skies[0] if skies else -1
        self.glossy = np.flatnonzero(glossy.any(axis=1))
        dr.make_opaque(self._light, self._lamp)

    @property
    def useful(self) -> bool:
        """Whether there is anything to find and anything that shows it."""
        return len(self.glossy) > 0 and (self.sky >= 0 or len(self.lamps) > 0)

    def go(self, met: Met, random: Any) -> tuple[Any, Any, Any, Any]:
        """From vertices of `Paths` on the same scene: (weight, reached sky, direction, light
        or whatever where no lamp is met, with weight 0)."""
        m, si = self._materials, met.si
        symbolic = dr.gather(mi.Int32, m.symbolic, met.obj, met.valid)
        ours = met.valid & (symbolic == NUMERIC)
        frame = m.orient(si, met.obj, ours)
        ours &= frame.wo.z > 0
        u1 = random.next_float32()
        u2 = mi.Point2f(random.next_float32(), random.next_float32())
        layouts = m.look_up(met.obj, ours)
        no = ours & mi.Bool(False)
        wo = frame.wo
        opened = open_first(m, met.obj, layouts, mi.Vector3f(0, 0, 1), wo, u1, u2, ours, no, ours)
        H = m.weight_maps(si, met.obj, ours)
        terms = []
        for layout, term, h in zip(layouts, opened.bounced, H, strict=True):
            glossy = dr.gather(mi.Float, self._glossy, layout.entry, ours)
            quotients = [q * glossy for q in term.quotients]
            terms.append(replace(term, quotients=quotients, H=h))
        outward, shade = frame.to_shading(opened.wi)
        scale = dr.select(opened.delta, 1, opened.wi.z) / opened.wi_pdf * shade
        scale = dr.select(ours & (opened.wi_pdf > 0), scale, 0)
        colour = m.contract(met.obj, terms, wo, opened.delta, ours) * scale
        weight = dr.mean(colour)
        going = ours & (weight != 0)
        direction = si.to_world(outward)
        hit = self.scene.mi_scene.ray_intersect(
            si.spawn_ray(direction), mi.RayFlags.All, False, going
        )
        sky = going & ~hit.is_valid() & mi.Bool(self.sky >= 0)
        emitter = hit.emitter(self.scene.mi_scene)
        lit = going & hit.is_valid() & (emitter != None) & (hit.wi.z > 0)  # noqa: E711
        light = dr.gather(mi.UInt32, self._light, dr.reinterpret_array(mi.UInt32, emitter), lit)
        lit &= dr.gather(mi.UInt32, self._lamp, light, lit) != 0
        return dr.select(sky | lit, weight, 0), sky, direction, light


class OnwardCells:
    """The cells that paths which went on have reached.

    owners: the first of the trees of sky cells, one for each of the scene's objects. lamp:
    int32 [objects, lights], the cell of each lamp through each object.
    """

    def __init__(self, onward: Onward, finder: CellFinder, owners: int, lamp: AnyArray) -> None:
        self._onward, self._finder, self._owners = onward, finder, owners
        self._lights = max(lamp.shape[1], 1)
        self._cell = mi.UInt32(np.maximum(lamp, 0).astype(np.uint32).ravel())
        dr.make_opaque(self._cell)

    def reach(self, met: Met, random: Any) -> tuple[Any, Any]:
        """The cell that a path reached, and its weight, 0 where it reached none."""
        weight, sky, direction, light = self._onward.go(met, random)
        owner = met.obj + dr.opaque(mi.UInt32, self._owners)
        found = self._finder.find(owner, direction, mi.Vector3f(0), sky)
        at = met.obj * dr.opaque(mi.UInt32, self._lights) + light
        lamp = dr.gather(mi.UInt32, self._cell, at, (weight != 0) & ~sky)
        return dr.select(sky, found, lamp), weight
