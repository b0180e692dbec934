"""What paths of relighting meet: first from the camera, then at the other end of a ray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi

from burnish.precompute.orientation import Orientation
from burnish.precompute.symbolic import PLAIN, SymbolicMaterials
from burnish.precompute.tracer import MIRROR_PDF
from burnish.scene import Scene

CHAIN = 4
"""Most mirror-like fixed vertices and masks that a path passes before it counts as lost."""


@dataclass
class Met:
    """A vertex that reflects, seen from where a ray began.

    obj: the scene's object; symbolic: its index in the basis, or PLAIN or NUMERIC. frame: that
    materials of ours reflect in. throughput: mi.Color3f, of what was passed on the way.
    emission: directly seen, that way. ray: the last one. valid: whether anything was met.
    """

    si: Any
    obj: Any
    symbolic: Any
    frame: Orientation
    throughput: Any
    emission: Any
    ray: Any
    valid: Any


class Emission(Protocol):
    """What a lamp's light is multiplied by."""

    def of(self, emitter: Any, active: Any) -> Any: ...


class Paths:
    """Rays through a scene with a set of materials."""

    def __init__(self, scene: Scene, materials: SymbolicMaterials) -> None:
        self.scene, self.materials = scene, materials
        self._objects = mi.UInt32(scene.object_table)
        dr.make_opaque(self._objects)

    def object_of(self, si: Any, active: Any) -> tuple[Any, Any]:
        """Scene object of a hit, and its index in the basis."""
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        obj = dr.gather(mi.UInt32, self._objects, shape, active)
        return obj, dr.gather(mi.Int32, self.materials.symbolic, obj, active)

    def meet(
        self, ray: Any, random: Any, active: Any, emission: Emission | None = None
    ) -> tuple[Met, Any]:
        """Follow a ray through masks and mirror-like fixed vertices to the first other one.

        random: mi.PCG32, returned as it is then. emission: count what is seen on the way,
        with these factors of the lights.
        """
        scene, m = self.scene.mi_scene, self.materials

        def body(
            ray: Any, throughput: Any, seen: Any, depth: Any, going: Any, done: Any, random: Any
        ) -> tuple[Any, ...]:
            si = scene.ray_intersect(ray, mi.RayFlags.All, depth == 0, going)
            if emission is not None:
                lamp = going & (si.emitter(scene) != None)  # noqa: E711 (a device comparison)
                sent = si.emitter(scene).eval(si, lamp) * emission.of(si.emitter(scene), lamp)
                seen += dr.select(lamp, throughput * sent, 0)
            valid = going & si.is_valid()
            obj, symbolic = self.object_of(si, valid)
            passing = mi.Bool(False)
            if m.masks:
                chance = random.next_float32()
                passing = m.passes(si, obj, chance, valid & (symbolic != PLAIN))
            plain = valid & (symbolic == PLAIN)
            u1 = random.next_float32()
            u2 = mi.Point2f(random.next_float32(), random.next_float32())
            bs, weight = si.bsdf(ray).sample(mi.BSDFContext(), si, u1, u2, plain)
            mirror = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta) | (bs.pdf >= MIRROR_PDF)
            mirror &= plain & dr.any(weight != 0)
            further = (passing | mirror) & (depth < CHAIN)
            done |= valid & ~further & ~passing
            throughput = dr.select(further & mirror, throughput * weight, throughput)
            onward = si.spawn_ray(dr.select(passing, ray.d, si.to_world(bs.wo)))
            ray = dr.select(further, onward, ray)
            return ray, throughput, seen, depth + 1, further, done, random

        lanes = dr.width(ray)
        ray, throughput, seen, _, _, done, random = dr.while_loop(
            (
                mi.Ray3f(ray),
                dr.full(mi.Color3f, 1, lanes),
                dr.zeros(mi.Color3f, lanes),
                dr.zeros(mi.UInt32, lanes),
                mi.Bool(active),
                dr.full(mi.Bool, False, lanes),
                random,
            ),
            lambda *state: state[4],
            body,
            label="to what reflects",
        )
        # Met again: an interaction is too much for a loop to carry
        si = scene.ray_intersect(ray, mi.RayFlags.All, True, done)
        valid = done & si.is_valid()
        obj, symbolic = self.object_of(si, valid)
        frame = m.orient(si, obj, valid & (symbolic != PLAIN))
        return Met(si, obj, symbolic, frame, throughput, seen, ray, valid), random


def stratified(count: int, lanes: int, seed: int) -> tuple[Any, Any]:
    """A sampler with `count` samples stratified together in consecutive lanes, and plain
    random numbers: mi.Sampler and mi.PCG32. count: a square."""
    sampler = mi.load_dict({"type": "multijitter", "sample_count": count})
    sampler.set_samples_per_wavefront(count)
    sampler.seed(seed & 0xFFFFFFFF, lanes)
    state = mi.UInt64(seed & 0xFFFFFFFFFFFF)
    dr.make_opaque(state)
    return sampler, mi.PCG32(lanes, state)
