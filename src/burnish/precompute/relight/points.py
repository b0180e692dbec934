"""The paper's own sum over gather samples, without a matrix: what sub-area samples are worth.

    I(x) = Σ_g L_g V_g(x) / |M_g| Σ_{q in M_g} f(x, ωq, ωo) cosθ / p(ωq)        (2010, eq. 3–4)

with q on a disk K_g of the sample's area and 1/p(ωq) = |A_g| (N_g · ωq) / |x − q|². With one q,
the sample itself, glossy reflections miss what lies between samples (its figure 2). Made to be
compared with: `rays` draws q where the lobes want it, and asks for each one's own visibility.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float32, Int32
from burnish.precompute.film import Camera
from burnish.precompute.relight.paths import Paths, stratified
from burnish.scene import View
from burnish.transport.gather import GatherSamples


class PointGather:
    """Sums over the samples of surfaces for one view and settled materials.

    paths: with every object numeric. radiance: L, float32 [g, 3].
    """

    def __init__(self, paths: Paths, view: View, samples: GatherSamples, radiance: Float32) -> None:
        self.paths, self.camera = paths, Camera(view)
        surface = np.flatnonzero(radiance.any(axis=1) & (np.abs(samples.normal).sum(axis=1) > 0))
        self.count = len(surface)

        def table(values: Float32) -> Any:
            array = mi.Float(np.ascontiguousarray(values[surface]).ravel())
            dr.make_opaque(array)
            return array

        self._position, self._normal = table(samples.position), table(samples.normal)
        self._area, self._light = table(samples.area), table(radiance)

    def picture(self, pixels: Int32, sub_areas: int, spp: int, seed: int) -> Float32:
        """The light of some pixels that comes round: float32 [p, 3], linear RGB.

        sub_areas: |M_g|, 1 for the sample itself. spp: camera samples of a pixel, a square.
        """
        m = self.paths.materials
        lanes = len(pixels) * spp
        sampler, random = stratified(spp, lanes, seed)
        row = dr.arange(mi.UInt32, lanes) // spp
        pixel = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), row)
        ray, weight = self.camera.numbered(pixel, sampler)
        met, random = self.paths.meet(ray, random, dr.full(mi.Bool, True, lanes))
        si, frame = met.si, met.frame
        active = met.valid & (frame.wo.z > 0)
        layouts = m.look_up(met.obj, active)
        H = m.weight_maps(si, met.obj, active)
        of_disk = dr.opaque(mi.Bool, sub_areas > 1)
        share = dr.opaque(mi.Float, 1 / sub_areas)
        each, last = dr.opaque(mi.UInt32, sub_areas), dr.opaque(mi.UInt32, self.count * sub_areas)

        def body(step: Any, total: Any, random: Any) -> tuple[Any, ...]:
            g = step // each
            centre = dr.gather(mi.Point3f, self._position, g, active)
            normal = dr.gather(mi.Vector3f, self._normal, g, active)
            area = dr.gather(mi.Float, self._area, g, active)
            u = mi.Point2f(random.next_float32(), random.next_float32())
            disk = mi.warp.square_to_uniform_disk_concentric(u) * dr.sqrt(area * dr.inv_pi)
            about = mi.Frame3f(normal)
            q = dr.select(of_disk, centre + disk.x * about.s + disk.y * about.t, centre)
            way = q - si.p
            square = dr.maximum(dr.squared_norm(way), 1e-8)
            d = way * dr.rsqrt(square)
            wi, shade = frame.to_local(si.to_local(d))
            cosine = dr.dot(normal, -d)
            lit = active & (wi.z > 0) & (cosine > 0)
            # All of a sample's points inherit its visibility
            lit &= ~self.paths.scene.mi_scene.ray_test(si.spawn_ray_to(centre), lit)
            columns = m.columns(layouts, wi, frame.wo, H, lit, lit)
            value = m.contract(met.obj, columns, frame.wo, mi.Bool(False), lit)
            value *= wi.z * shade * cosine * area / square * share
            light = dr.gather(mi.Color3f, self._light, g, lit)
            total = total + dr.select(lit, value * light, 0)
            return step + 1, total, random

        step = dr.zeros(mi.UInt32, lanes)
        _, total, _ = dr.while_loop(
            (step, dr.zeros(mi.Color3f, lanes), random),
            lambda step, total, random: step < last,
            body,
            label="points of gather samples",
        )
        total = total * met.throughput * weight
        dr.eval(total)
        means = [np.asarray(dr.block_sum(total[c], spp) / spp, np.float32) for c in range(3)]
        return np.stack(means, axis=1)
