"""Direct light on the rows of an object, its columns left open."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float32, Int32
from burnish.precompute.encounter import open_first
from burnish.precompute.film import Camera
from burnish.precompute.relight.direct import LightFactors
from burnish.precompute.relight.paths import Paths, stratified
from burnish.precompute.symbolic import Terms
from burnish.precompute.tracer import mis
from burnish.scene import View

LANES = 1 << 20


class DirectColumns:
    """A[row, column] of one object in one view: light · q cosθ H, without the coefficients.

    pixels: int32 [r], of the rows.
    """

    def __init__(
        self, paths: Paths, view: View, pixels: Int32, index: int, factors: LightFactors
    ) -> None:
        self.paths, self.view, self.index, self.factors = paths, view, index, factors
        self.camera, self.pixels = Camera(view), pixels
        self.columns = paths.materials.basis.columns(index)

    def trace(self, spp: int, seed: int) -> Float32:
        """float32 [rows, columns, 3] of `spp` samples, a square, through each row's pixel."""
        result = np.zeros((len(self.pixels), self.columns, 3), np.float32)
        band = max(1, LANES // spp)
        for start in range(0, len(self.pixels), band):
            own = self.pixels[start : start + band]
            result[start : start + len(own)] = self._band(own, spp, seed + start)
        return result

    def _band(self, pixels: Int32, spp: int, seed: int) -> Float32:
        scene, m = self.paths.scene.mi_scene, self.paths.materials
        lanes = len(pixels) * spp
        sampler, random = stratified(spp, lanes, seed)
        row = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, spp)
        pixel = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), row)
        ray, weight = self.camera.numbered(pixel, sampler)
        u_light, u1, u2 = sampler.next_2d(), sampler.next_1d(), sampler.next_2d()
        met, _ = self.paths.meet(ray, random, dr.full(mi.Bool, True, lanes))
        si, frame = met.si, met.frame
        own = met.valid & (met.symbolic == dr.opaque(mi.Int32, self.index)) & (frame.wo.z > 0)
        through = met.throughput * weight
        ds, light = scene.sample_emitter_direction(si, u_light, True, own)
        wi, shade = frame.to_local(si.to_local(ds.d))
        lit = own & (ds.pdf != 0) & (wi.z > 0)
        light *= self.factors.of(ds.emitter, lit)
        layouts = m.look_up(met.obj, own)
        opened = open_first(m, met.obj, layouts, wi, frame.wo, u1, u2, own, lit, own)
        H = m.weight_maps(si, met.obj, own)
        share = dr.select(ds.delta, 1, mis(ds.pdf, opened.pdf))
        value = through * light * (wi.z * shade * share)
        target = dr.zeros(mi.Float, len(pixels) * self.columns * 3)
        dr.make_opaque(target)
        self._add(target, row, opened.columns, H, value, lit)
        # The light that a direction of the lobes runs into
        outward, shade = frame.to_shading(opened.wi)
        scale = dr.select(opened.delta, 1, opened.wi.z) / opened.wi_pdf * shade
        going = own & (opened.wi_pdf > 0)
        hit = scene.ray_intersect(si.spawn_ray(si.to_world(outward)), mi.RayFlags.All, False, going)
        lamp = going & (hit.emitter(scene) != None)  # noqa: E711 (a device comparison)
        towards = mi.DirectionSample3f(scene, hit, mi.Interaction3f(si))
        light_pdf = scene.pdf_emitter_direction(mi.Interaction3f(si), towards, lamp & ~opened.delta)
        light_pdf = dr.select(opened.delta, 0, light_pdf)
        sent = hit.emitter(scene).eval(hit, lamp) * self.factors.of(hit.emitter(scene), lamp)
        value = through * sent * (scale * mis(opened.wi_pdf, light_pdf))
        self._add(target, row, opened.bounced, H, value, lamp)
        dr.eval(target)
        sums = np.array(target).reshape(len(pixels), self.columns, 3)
        return np.asarray(sums / np.float32(spp), np.float32)

    def _add(
        self, target: Any, row: Any, terms: list[Terms], H: list[Any], value: Any, active: Any
    ) -> None:
        active &= dr.any(value != 0)
        count = dr.opaque(mi.UInt32, self.columns)
        for term, h in zip(terms, H, strict=True):
            own = replace(term, H=h)
            colour = value if own.H is None else value * own.H
            for k, q in enumerate(own.quotients):
                at = (row * count + own.column + k * own.stride) * 3
                for channel in range(3):
                    dr.scatter_add(target, colour[channel] * q, at + channel, active & (q != 0))
