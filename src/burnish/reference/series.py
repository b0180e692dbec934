"""The series' own approximations, path traced plainly: what an unbiased bake must converge to.

Materials are projected onto their bins, and each encounter of a path with an editable
object uses the form that the series gives it (2008, sections 4.2 and 4.3):

- the first, seen directly or by mirrors alone: all bins, exact in θo;
- the first, after a rougher fixed vertex: coarse bins;
- the second: coarse bins when the series' second number is above 1;
- every other: the equivalent albedo.

Everything else is a textbook path tracer with next-event estimation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Progress
from burnish.materials.layer import MaterialState
from burnish.materials.lights import factors, placements, without_lights
from burnish.reference.bsdf import reflecting_bsdf, wrapped
from burnish.reference.film import Estimate, trace
from burnish.reference.reflectance import (
    CoarseReflectance,
    FineReflectance,
    MatteReflectance,
    Reflectance,
)
from burnish.scene import Scene, SceneObject

MIRROR_PDF = 4.0
"""A fixed vertex counts as a mirror when its sampled component is perfectly smooth or its
sampled density (per steradian) is at least this."""

FINE, COARSE, SECOND, LATER = range(4)
"""The forms of an editable material, by encounter."""


def series_image(
    scene: Scene,
    state: Mapping[str, MaterialState],
    series: Sequence[int],
    view: str | None = None,
    spp: int = 64,
    seed: int = 0,
    *,
    indirect_bins: int = 8,
    direct_plus_diffuse_indirect: bool = False,
    progress: Progress | None = None,
) -> Estimate:
    """Path-trace a view with projected materials.

    state: the objects that are editable, all others are fixed; layers carry their own number
      of fine bins. series: bins per bounce, its length is the number of scattering vertices
      (Mitsuba's max_depth − 1). indirect_bins: coarse bins of a first encounter that comes
      after rough fixed vertices.
    direct_plus_diffuse_indirect: instead of the series, full projected BRDF for direct light
      and the equivalent albedo at every encounter for the rest (2008, figure 7a).

    Raises UnknownName, InvalidValue; also for a mix of the lights and for paint, which it
    does not have.
    """
    if factors(scene.lights, state) or placements(scene.lights, state):
        raise InvalidValue(
            "a picture with the series' approximations is of the lights as the scene has them: "
            "reset the lights, or path-trace without a series"
        )
    state = without_lights(state)
    varied = [
        item.id
        for item in scene.objects
        if item.material is not None and item.id in state and item.material.varies(state[item.id])
    ]
    if varied:
        raise InvalidValue(
            f"{', '.join(varied)} is painted or has maps, and a picture with the series' "
            "approximations is of uniform materials: path-trace without a series"
        )
    if not series or any(n < 1 for n in series):
        raise InvalidValue(f"series must be numbers >= 1, like 64,1,1,1; got {tuple(series)}")
    coarse = series[1] if len(series) > 1 else 1
    objects = {item.id: item for item in scene.editable(state)}
    forms = _Forms(
        scene,
        [
            _forms_of(objects[item.id], state[item.id], coarse, indirect_bins)
            if item.id in objects
            else None
            for item in scene.objects
        ],
    )
    split = direct_plus_diffuse_indirect
    bounces = dr.opaque(mi.UInt32, len(series))

    def radiance(sampler: Any, ray: Any) -> tuple[Any, Any]:
        return _paths(scene.mi_scene, forms, sampler, mi.Ray3f(ray), bounces, split)

    return trace(radiance, scene.view(view), spp, seed, progress)


def _forms_of(
    item: SceneObject, state: MaterialState, coarse: int, indirect: int
) -> tuple[Any, ...]:
    """The mi.BSDF of each form, in the order FINE, COARSE, SECOND, LATER."""
    assert item.material is not None
    material, maps = item.material.as_in(state), item.maps
    matte = MatteReflectance(material, state, maps)
    shapes: list[Reflectance] = [
        FineReflectance(material, state, maps),
        CoarseReflectance(material, state, maps, indirect),
        CoarseReflectance(material, state, maps, coarse) if coarse > 1 else matte,
        matte,
    ]
    return tuple(wrapped(item, partial(reflecting_bsdf, shape)) for shape in shapes)


class _Forms:
    """Which BSDF stands for which object at which encounter.

    forms: per object of the scene its BSDFs in the order FINE, COARSE, SECOND, LATER, or
    None for a fixed object.
    """

    def __init__(self, scene: Scene, forms: Sequence[tuple[Any, ...] | None]) -> None:
        # Kept alive here: a kernel knows them by number alone
        self.forms = forms
        numbers = [_number(bsdf) if bsdf else 0 for item in forms for bsdf in (item or (None,) * 4)]
        self.object_of = mi.UInt32(scene.object_table)
        self.table = mi.UInt32(np.array(numbers, np.uint32))

    def look_up(self, si: Any, form: Any, active: Any) -> tuple[Any, Any]:
        """The BSDF at a hit and whether it stands for an editable object."""
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        item = dr.gather(mi.UInt32, self.object_of, shape, active)
        number = dr.gather(mi.UInt32, self.table, item * 4 + form, active)
        own = dr.reinterpret_array(mi.UInt32, si.bsdf())
        editable = active & (number != 0)
        return dr.reinterpret_array(mi.BSDFPtr, dr.select(editable, number, own)), editable


def _number(bsdf: Any) -> int:
    return int(np.asarray(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(bsdf))).item())


@dr.syntax
def _paths(
    scene: Any, forms: Any, sampler: Any, ray: Any, bounces: Any, split: bool
) -> tuple[Any, Any]:
    """Light along camera rays, and the directly seen emission in it."""
    context = mi.BSDFContext()
    after_rough, at_second = (LATER, LATER) if split else (COARSE, SECOND)
    light, seen = mi.Color3f(0), mi.Color3f(0)
    # What the next vertex's own emission, and everything behind it, is multiplied by;
    # they differ only where direct and indirect light meet different forms
    for_emission, throughput = mi.Color3f(1), mi.Color3f(1)
    depth, encounters = mi.UInt32(0), mi.UInt32(0)
    mirrors_only, active = mi.Bool(True), mi.Bool(True)
    previous = dr.zeros(mi.Interaction3f)
    previous_pdf, previous_smooth = mi.Float(1), mi.Bool(True)

    while active:
        si = scene.ray_intersect(ray, mi.RayFlags.All, depth == 0, active)

        # Emission that the path ran into
        emitter = si.emitter(scene)
        hit = active & (emitter != None)  # noqa: E711 (per lane)
        ds = mi.DirectionSample3f(scene, si, previous)
        light_pdf = scene.pdf_emitter_direction(previous, ds, hit & ~previous_smooth)
        balance = _power(previous_pdf, dr.select(previous_smooth, 0, light_pdf))
        emitted = dr.select(hit, for_emission * emitter.eval(si, hit) * balance, 0)
        light += emitted
        seen += dr.select(depth == 0, emitted, 0)

        # Which form of its material this vertex has
        active &= si.is_valid() & (depth < bounces)
        form = dr.select(mirrors_only, mi.UInt32(FINE), after_rough)
        form = dr.select(encounters == 1, at_second, form)
        form = dr.select(encounters > 1, LATER, form)
        bsdf, editable = forms.look_up(si, form, active)

        # Next-event estimation
        ds, incoming = scene.sample_emitter_direction(si, sampler.next_2d(), True, active)
        lit = active & (ds.pdf > 0)
        value, pdf = bsdf.eval_pdf(context, si, si.to_local(ds.d), lit)
        balance = dr.select(ds.delta, 1, _power(ds.pdf, pdf))
        light += dr.select(lit, throughput * value * incoming * balance, 0)

        # Go on
        bs, weight = bsdf.sample(context, si, sampler.next_1d(), sampler.next_2d(), active)
        smooth = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
        for_emission = throughput * weight
        behind = mi.Color3f(weight)
        if dr.hint(split, mode="scalar"):
            diffused = active & editable & (form == FINE)
            matte, _ = forms.look_up(si, mi.UInt32(LATER), diffused)
            diffuse = matte.eval(context, si, bs.wo, diffused)
            diffuse = dr.select(smooth | (bs.pdf <= 0), 0, diffuse / bs.pdf)
            behind = dr.select(diffused, diffuse, behind)
        throughput = throughput * behind
        mirrors_only &= editable | smooth | (bs.pdf >= MIRROR_PDF)
        straight = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null)
        encounters += dr.select(editable & ~straight, mi.UInt32(1), 0)
        previous, previous_pdf, previous_smooth = mi.Interaction3f(si), bs.pdf, smooth
        ray = si.spawn_ray(si.to_world(bs.wo))
        depth += 1
        active &= dr.any((for_emission != 0) | (throughput != 0))

    return light, seen


def _power(a: Any, b: Any) -> Any:
    """The power heuristic's weight of a sample drawn with density a, not b (Veach 1997)."""
    weight = dr.square(a) / (dr.square(a) + dr.square(b))
    return dr.select(dr.isfinite(weight), weight, 0)
