"""Direct light on view rows and on cells, with true shadows, under whatever lights there are.

Everything is asked of the ray tracer anew: a light that has moved is just another light. On
the view it is Mitsuba's own estimate of one bounce, by light samples and BSDF samples
combined; on cells, an irradiance by light samples.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import RGB, Float32, Int32
from burnish.precompute.encounter import open_first
from burnish.precompute.film import Camera
from burnish.precompute.relight.onward import SKIES
from burnish.precompute.relight.paths import Paths, stratified
from burnish.precompute.symbolic import PLAIN
from burnish.precompute.tracer import mis
from burnish.scene import Scene, View
from burnish.transport.gather import GatherSamples

LANES = 1 << 20


class LightFactors:
    """How much each emitter sends, as a factor of what it does in the scene."""

    def __init__(self, scene: Scene) -> None:
        self._names = [light.name for light in scene.lights]
        self._kinds = [light.kind for light in scene.lights]
        self._light = mi.UInt32(scene.light_table)
        dr.make_opaque(self._light)
        self.set({})

    def set(self, factors: Mapping[str, RGB], moved: Collection[str] = ()) -> None:
        """By the name of the light, linear RGB; 1 where it is not named. moved: lights that do
        not stand as in the scene."""
        table = np.array([factors.get(name, (1.0, 1.0, 1.0)) for name in self._names], np.float32)
        self.table = table.reshape(-1, 3)
        self.moved = np.array([name in moved for name in self._names], bool)
        shown = [
            kind in SKIES or (kind == "area" and not away)
            for kind, away in zip(self._kinds, self.moved, strict=True)
        ]
        self._factors = mi.Float(table.ravel())
        self._shown = mi.Float(np.array(shown, np.float32))
        dr.make_opaque(self._factors, self._shown)

    def of(self, emitter: Any, active: Any) -> Any:
        """The factor of each lane's emitter (mi.EmitterPtr): mi.Color3f."""
        number = dr.reinterpret_array(mi.UInt32, emitter)
        light = dr.gather(mi.UInt32, self._light, number, active)
        return dr.gather(mi.Color3f, self._factors, light, active)

    def shown(self, emitter: Any, active: Any) -> Any:
        """1 where cells show each lane's emitter itself, else 0: mi.Float."""
        number = dr.reinterpret_array(mi.UInt32, emitter)
        light = dr.gather(mi.UInt32, self._light, number, active)
        return dr.gather(mi.Float, self._shown, light, active)


class CellLights:
    """Irradiance at the points of cells, which stay on the device."""

    def __init__(self, scene: Scene, samples: GatherSamples, factors: LightFactors) -> None:
        self.scene, self.factors, self._samples = scene, factors, samples
        self._lamps = _radiance(scene)
        self.shape = samples.point.shape

        def columns(values: Float32) -> Any:
            return np.ascontiguousarray(values.reshape(-1, 3).T)

        self._p = mi.Point3f(columns(samples.point))
        self._n = mi.Normal3f(columns(samples.point_normal))
        self._surface = mi.Normal3f(columns(samples.point_surface))
        dr.make_opaque(self._p, self._n, self._surface)

    def irradiance(self, count: int, seed: int) -> tuple[Float32, Float32]:
        """E at each point: float32 [g, p, 3], linear RGB; `count` light samples at each. Of all
        lights, and of those that glossy surfaces show."""
        lanes = self.shape[0] * self.shape[1]
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed & 0xFFFFFFFF, lanes)
        total, shown = dr.zeros(mi.Color3f, lanes), dr.zeros(mi.Color3f, lanes)
        for _ in range(count):
            sampler.schedule_state()
            light, share = self._sample(sampler.next_2d())
            total += light
            shown += light * share
            dr.eval(total, shown)
        every, some = (np.array(sums * (1 / count)).T for sums in (total, shown))
        return (
            np.ascontiguousarray(every, np.float32).reshape(self.shape),
            np.ascontiguousarray(some, np.float32).reshape(self.shape),
        )

    def _sample(self, u: Any) -> tuple[Any, Any]:
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(self._p))
        si.p, si.n = self._p, self._surface
        ds, light = self.scene.mi_scene.sample_emitter_direction(si, u, True, True)
        cosine = dr.dot(self._n, ds.d)
        lit = (ds.pdf != 0) & (cosine > 0) & (dr.dot(self._surface, ds.d) > 0)
        light = dr.select(lit, light * self.factors.of(ds.emitter, lit) * cosine, 0)
        return light, self.factors.shown(ds.emitter, lit)

    def emission(self) -> Float32:
        """The light that cells of the sky and of lamps show: float32 [g, 3]."""
        result = np.zeros((self.shape[0], 3), np.float32)
        scene, samples = self.scene.mi_scene, self._samples
        for number, light in enumerate(self.scene.lights):
            own = np.flatnonzero(samples.shows == number)
            if not len(own) or (self.factors.moved[number] and light.kind not in SKIES):
                continue
            if light.kind not in SKIES:
                result[own] = self._lamps[number] * self.factors.table[number]
                continue
            directions = samples.point[own].reshape(-1, 3)
            length = np.linalg.norm(directions, axis=1, keepdims=True)
            si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
            si.wi = mi.Vector3f(np.ascontiguousarray(-(directions / length).T))
            seen = np.array(mi.Color3f(scene.environment().eval(si))).T
            seen = np.broadcast_to(seen, (len(directions), 3)).reshape(len(own), -1, 3)
            result[own] = seen.mean(axis=1) * self.factors.table[number]
        return result


def _radiance(scene: Scene) -> dict[int, Float32]:
    """What lamps send straight ahead, at the middle of their textures: float32 [3] each."""
    result = {}
    for shape in scene.mi_scene.shapes():
        emitter = shape.emitter()
        if emitter is None:
            continue
        number = int(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(emitter))[0])
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi, si.uv = mi.Vector3f(0, 0, 1), mi.Point2f(0.5, 0.5)
        value = np.ravel(np.array(mi.Color3f(emitter.eval(si))))
        result[int(scene.light_table[number])] = value.astype(np.float32)
    return result


class DirectView:
    """Direct light on one view, for materials that are settled.

    without: the scene's objects that are left black.
    """

    def __init__(
        self, paths: Paths, view: View, factors: LightFactors, without: Sequence[int] = ()
    ) -> None:
        self.paths, self.view, self.camera, self.factors = paths, view, Camera(view), factors
        lit = np.ones(len(paths.scene.objects), np.float32)
        lit[list(without)] = 0.0
        self._lit = mi.Float(lit)
        dr.make_opaque(self._lit)

    def picture(self, spp: int, seed: int) -> tuple[Float32, Float32]:
        """What is reflected, and directly seen emission: float32 [height, width, 3].

        spp: a square.
        """
        pixels = self.view.pixels
        band = max(1, LANES // spp)
        light, emission = np.zeros((pixels, 3), np.float32), np.zeros((pixels, 3), np.float32)
        for start in range(0, pixels, band):
            own = np.arange(start, min(start + band, pixels), dtype=np.int32)
            found, seen = self._band(own, spp, seed + start)
            light[own], emission[own] = found, seen
        shape = (self.view.height, self.view.width, 3)
        return light.reshape(shape), emission.reshape(shape)

    def _band(self, pixels: Int32, spp: int, seed: int) -> tuple[Float32, Float32]:
        lanes = len(pixels) * spp
        sampler, random = stratified(spp, lanes, seed)
        row = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, spp)
        first = dr.opaque(mi.UInt32, int(pixels[0]))
        ray, weight = self.camera.numbered(row + first, sampler)
        u_light, u1, u2 = sampler.next_2d(), sampler.next_1d(), sampler.next_2d()
        active = dr.full(mi.Bool, True, lanes)
        met, _ = self.paths.meet(ray, random, active, emission=self.factors)
        light = self._reflected(met, u_light, u1, u2) * weight
        reflected, seen = _per_pixel([light, met.emission * weight], spp)
        return reflected, seen

    def _reflected(self, met: Any, u_light: Any, u1: Any, u2: Any) -> Any:
        scene, m = self.paths.scene.mi_scene, self.paths.materials
        si, obj, frame = met.si, met.obj, met.frame
        plain = met.valid & (met.symbolic == PLAIN)
        ours = met.valid & ~plain & (frame.wo.z > 0)
        ds, light = scene.sample_emitter_direction(si, u_light, True, met.valid)
        lit = met.valid & (ds.pdf != 0)
        light *= self.factors.of(ds.emitter, lit)
        shading = si.to_local(ds.d)
        wi, shade = frame.to_local(shading)
        above = lit & ours & (wi.z > 0)
        value, pdf, bs, bs_weight = si.bsdf(met.ray).eval_pdf_sample(
            mi.BSDFContext(), si, shading, u1, u2, plain
        )
        total = dr.select(lit & plain, light * value * _light_mis(ds, pdf), 0)
        layouts = m.look_up(obj, ours)
        H = m.weight_maps(si, obj, ours)
        opened = open_first(m, obj, layouts, wi, frame.wo, u1, u2, ours, above, ours)
        columns, bounced = (
            [replace(term, H=h) for term, h in zip(terms, H, strict=True)]
            for terms in (opened.columns, opened.bounced)
        )
        reflected = m.contract(obj, columns, frame.wo, mi.Bool(False), above)
        total += dr.select(
            above, light * reflected * (wi.z * shade * _light_mis(ds, opened.pdf)), 0
        )
        # The light that a direction of the BSDF's own runs into
        outward, shade = frame.to_shading(opened.wi)
        delta = opened.delta & ours
        scale = dr.select(delta, 1, opened.wi.z) / opened.wi_pdf * shade
        scale = dr.select(ours & (opened.wi_pdf > 0), scale, 0)
        weight = m.contract(obj, bounced, frame.wo, delta, ours) * scale
        weight = dr.select(plain, bs_weight, weight)
        pdf = dr.select(plain, bs.pdf, opened.wi_pdf)
        delta |= plain & mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
        going = (plain | ours) & dr.any(weight != 0)
        onward = si.spawn_ray(si.to_world(dr.select(plain, bs.wo, outward)))
        hit = scene.ray_intersect(onward, mi.RayFlags.All, False, going)
        lamp = going & (hit.emitter(scene) != None)  # noqa: E711 (a device comparison)
        towards = mi.DirectionSample3f(scene, hit, mi.Interaction3f(si))
        light_pdf = scene.pdf_emitter_direction(mi.Interaction3f(si), towards, lamp & ~delta)
        light_pdf = dr.select(delta, 0, light_pdf)
        emitted = hit.emitter(scene).eval(hit, lamp) * self.factors.of(hit.emitter(scene), lamp)
        emitted *= weight * mis(pdf, light_pdf)
        seen = dr.gather(mi.Float, self._lit, obj, met.valid)
        return (total + dr.select(lamp, emitted, 0)) * met.throughput * seen


def _light_mis(ds: Any, pdf: Any) -> Any:
    return dr.select(ds.delta, 1, mis(ds.pdf, pdf))


def _per_pixel(colours: Sequence[Any], spp: int) -> list[Float32]:
    """Means over each pixel's samples: float32 [pixels, 3] each, all in one kernel."""
    flat = [mi.Float(mi.Color3f(colour)[c]) for colour in colours for c in range(3)]
    dr.eval(flat)
    if spp > 1:
        flat = [dr.block_sum(channel, spp) * (1 / spp) for channel in flat]
        dr.eval(flat)
    planes = [np.asarray(channel, np.float32) for channel in flat]
    return [np.stack(planes[k : k + 3], axis=1) for k in range(0, len(planes), 3)]
