"""burnish's layered materials as a BSDF that any Mitsuba integrator can render."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi

from burnish.core.errors import InvalidValue, MissingFile
from burnish.materials.layer import Material, MaterialState
from burnish.reference.reflectance import Reflectance, TrueReflectance
from burnish.scene.maps import WeightMap
from burnish.scene.objects import SceneObject

PLUGIN = "burnish"
MATERIAL_FORMAT = "burnish-material"
MATERIAL_VERSION = 1


def layered_bsdf(
    material: Material,
    state: MaterialState,
    maps: Mapping[str, WeightMap] | None = None,
    two_sided: bool = False,
) -> Any:
    """The true BRDF of a material in a state, as an mi.BSDF of the variant in use.

    maps: the static weight map H of each layer group that has one. two_sided: reflect on
    both faces, mirrored, like Mitsuba's `twosided`; otherwise the back is black.
    """
    return reflecting_bsdf(TrueReflectance(material, state, maps or {}), two_sided)


def reflecting_bsdf(reflectance: Reflectance, two_sided: bool) -> Any:
    """An mi.BSDF that reflects by any form of a material."""
    return layered_class()(mi.Properties(PLUGIN), reflectance, two_sided)


def wrapped(item: SceneObject, make: Callable[[bool], Any]) -> Any:
    """A BSDF of ours with what the scene puts round an object's: masks, bent normals.

    make: the BSDF, given whether it reflects on both faces by itself.
    """
    if item.wrapping.is_plain:
        return make(item.two_sided)
    inner = make(item.two_sided and not item.wrapping.two_sided)
    return mi.load_dict(item.wrapping.around(inner))


def layered_class() -> Any:
    """`LayeredBSDF` of the variant in use, registered as the plugin `burnish`.

    From a scene file the plugin takes the string `filename`, a JSON file with "format",
    "version", "material" and "state" (see `burnish.materials.registry`), or the strings
    `material` and `state` themselves; the boolean `two_sided`; and for each group of layers
    with a weight map the texture `map_GROUP`.
    """
    return _layered_class(mi.variant())


@cache
def _layered_class(variant: str) -> Any:
    # Mitsuba's classes belong to a variant, and so must what is derived from them
    class LayeredBSDF(mi.BSDF):
        """Opaque reflection by a `Reflectance`, sampled from its `Lobes`.

        Mitsuba's `si.wi` is the direction to the viewer, ωo here, and its `wo` the one to
        the light, ωi. What `BSDFContext` asks to leave out is not left out.
        """

        def __init__(
            self,
            props: Any,
            reflectance: Reflectance | None = None,
            two_sided: bool = False,
        ) -> None:
            mi.BSDF.__init__(self, props)
            if reflectance is None:
                reflectance, two_sided = _from_properties(props)
            self.reflectance = reflectance
            self.two_sided = two_sided
            sides = mi.BSDFFlags.FrontSide
            if two_sided:
                sides = sides | mi.BSDFFlags.BackSide
            components = [mi.BSDFFlags.GlossyReflection | sides]
            if reflectance.lobes.has_mirror:
                components.append(mi.BSDFFlags.DeltaReflection | sides)
            self.m_components = components
            flags = components[0]
            for component in components[1:]:
                flags = flags | component
            self.m_flags = flags

        def _turn(self, si: Any) -> tuple[Any, Any]:
            """ωo on the upper side, and the sign that brings other directions there."""
            sign = mi.Float(1)
            if self.two_sided:
                sign = dr.select(si.wi.z < 0, -1, sign)
            return mi.Vector3f(si.wi.x, si.wi.y, si.wi.z * sign), sign

        def sample(
            self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
        ) -> tuple[Any, Any]:
            outward, sign = self._turn(si)
            active = active & (outward.z > 0)
            lobes = self.reflectance.lobes
            light, is_mirror = lobes.sample(outward, sample1, sample2, active)
            pdf = lobes.pdf(light, outward, active & ~is_mirror)
            usable = active & (is_mirror | ((light.z > 0) & (pdf > 0)))
            rough = usable & ~is_mirror
            value = self.reflectance.rough(si, light, outward, rough) * light.z / pdf
            value = dr.select(rough, value, 0)
            bs = dr.zeros(mi.BSDFSample3f)
            bs.sampled_type = dr.select(
                is_mirror,
                mi.UInt32(+mi.BSDFFlags.DeltaReflection),
                mi.UInt32(+mi.BSDFFlags.GlossyReflection),
            )
            if lobes.has_mirror:
                mirrored = self.reflectance.mirror(si, outward.z, is_mirror) / lobes.p_mirror
                value = dr.select(usable & is_mirror, mirrored, value)
                pdf = dr.select(is_mirror, lobes.p_mirror, pdf)
                bs.sampled_component = dr.select(is_mirror, mi.UInt32(1), mi.UInt32(0))
            bs.wo = mi.Vector3f(light.x, light.y, light.z * sign)
            bs.pdf = dr.select(usable, pdf, 0)
            bs.eta = 1.0
            return bs, value

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            outward, sign = self._turn(si)
            light = mi.Vector3f(wo.x, wo.y, wo.z * sign)
            return self.reflectance.lobes.pdf(light, outward, active)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            outward, sign = self._turn(si)
            light = mi.Vector3f(wo.x, wo.y, wo.z * sign)
            active = active & (outward.z > 0) & (light.z > 0)
            value = self.reflectance.rough(si, light, outward, active) * light.z
            pdf = self.reflectance.lobes.pdf(light, outward, active)
            return dr.select(active, value, 0), pdf

        def to_string(self) -> str:
            names = ", ".join(layer.name for layer, _ in self.reflectance.layers)
            return f"LayeredBSDF[{names}]"

    mi.register_bsdf(PLUGIN, LayeredBSDF)
    return LayeredBSDF


def _from_properties(props: Any) -> tuple[Reflectance, bool]:
    from burnish.materials.registry import material_from_json, state_from_json

    data = _material_file(str(props["filename"])) if "filename" in props else {}
    for name in ("material", "state"):
        if name in props:
            data[name] = json.loads(props[name])
    if "material" not in data:
        raise InvalidValue("the BSDF 'burnish' needs a filename or a material; give it one")
    material = material_from_json(data["material"])
    state = state_from_json(data["state"]) if "state" in data else material.initial
    maps = {
        name.removeprefix("map_"): WeightMap(props[name], None, ())
        for name in props.keys()  # noqa: SIM118
        if name.startswith("map_")
    }
    return TrueReflectance(material, state, maps), bool(props.get("two_sided", False))


def _material_file(name: str) -> dict[str, Any]:
    """What a material's JSON file holds. Raises MissingFile, InvalidValue."""
    path = Path(str(mi.file_resolver().resolve(name)))
    if not path.is_file():
        raise MissingFile(f"no material file {name!r}; put it beside the scene")
    try:
        data = json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise InvalidValue(f"{path}: not JSON ({error}); export the material again") from None
    if not isinstance(data, dict) or data.get("format") != MATERIAL_FORMAT:
        raise InvalidValue(f'{path}: not a material ("format" must be "{MATERIAL_FORMAT}")')
    if data.get("version") != MATERIAL_VERSION:
        raise InvalidValue(
            f"{path}: version must be {MATERIAL_VERSION}; got {data.get('version')!r}: install "
            "a newer burnish"
        )
    return data
