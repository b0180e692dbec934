"""From Mitsuba's BSDFs to editable materials, and back.

`adapt` reads a BSDF's description as a plain Mitsuba dictionary and answers with a
`Material` that starts out equal to it, or with the reason why it cannot be edited. All
numbers come from the plugin that Mitsuba itself makes of the dictionary, so that presets
("Cu"), named indices ("polypropylene"), defaults and colour conversions are Mitsuba's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mitsuba as mi

from burnish.core.errors import InvalidValue
from burnish.core.types import RGB, Value
from burnish.materials.images.image import ImageMap, Place
from burnish.materials.layer import Layer, LayerState, Link, Material, MaterialState
from burnish.materials.model import Model
from burnish.materials.models.cook_torrance import (
    CookTorrance,
    CookTorranceConductor,
    CookTorranceDielectric,
)
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.optics import SMALLEST_ROUGHNESS, Distribution
from burnish.materials.models.plastic_base import PlasticBase
from burnish.scene import principled
from burnish.scene.blend import blend
from burnish.scene.reader import Description, Fixed, Read, Reader, rgb
from burnish.scene.textures import interreflected, texture_mean
from burnish.scene.wrapping import Wrapping, unwrap


@dataclass(frozen=True)
class Adapted:
    """What became of a BSDF.

    material: None when it stays fixed, and then `reason` says why. two_sided: whether both
    faces reflect. maps: for each layer group with a texture, the Mitsuba dictionary of the
    texture that is its H. describe: gives the dictionary of Mitsuba's own plugin for a state,
    or None where no plugin holds it. wrapping: what is round it.
    """

    material: Material | None
    reason: str = ""
    two_sided: bool = False
    maps: Mapping[str, Description] = field(default_factory=dict)
    describe: Callable[[MaterialState], Description | None] | None = None
    wrapping: Wrapping = field(default_factory=Wrapping)

    def edited_bsdf(self, state: MaterialState) -> Any | None:
        """Mitsuba's own plugin for a state (mi.BSDF), or None."""
        described = self.describe(state) if self.describe is not None else None
        return None if described is None else mi.load_dict(dict(described))


def adapt(description: Description) -> Adapted:
    """The editable material of a BSDF description, or why there is none."""
    wrapping = Wrapping()
    try:
        wrapping, inner = unwrap(description)
        kind = inner["type"]
        if kind == "blendbsdf":
            found = blend(inner, adapt)
            describe = _Wrapped(wrapping, found.describe)
            both = wrapping.two_sided or found.two_sided
            return Adapted(found.material, "", both, found.maps, describe, wrapping)
        if kind not in _KINDS:
            raise Fixed(f"its BSDF is '{kind}'; editable are {', '.join(sorted(_KINDS))}")
        read = Reader(inner)
        material, maps = _KINDS[kind](read)
    except Fixed as reason:
        return Adapted(None, str(reason), wrapping.two_sided)
    for layer in material.layers:
        for parameter in material.parameters(layer.name):
            try:
                parameter.validate(material.initial.layers[layer.name].values[parameter.name])
            except InvalidValue as error:
                return Adapted(None, f"its {layer.name} {error}", wrapping.two_sided)
    describe = _Wrapped(wrapping, _Writer(inner, material, read))
    return Adapted(material, "", wrapping.two_sided, maps, describe, wrapping)


def with_gloss(material: Material, model: Model | None = None) -> Material:
    """The material with a specular layer on top that has no weight yet.

    model: one with `color` and `roughness`, by default Cook-Torrance with GGX and Schlick's
    Fresnel. Raises InvalidValue when there is a layer "specular" already.
    """
    if any(layer.name == "specular" for layer in material.layers):
        raise InvalidValue("the material has a layer 'specular' already; edit that one")
    model = model or CookTorrance("ggx")
    values: dict[str, Value] = {}
    for parameter in model.parameters:
        start = 0.3 if parameter.name == "roughness" else parameter.default
        values[parameter.name] = parameter.validate(start)
    layer = Layer.starting_at("specular", model, values)
    layers = {**material.initial.layers, "specular": LayerState(values, weight=0.0)}
    initial = replace(material.initial, layers=layers)
    return replace(material, layers=(*material.layers, layer), initial=initial)


# -- reading --------------------------------------------------------------------------------


def _diffuse(read: Reader) -> Read:
    colour, textured = read.coloured("reflectance")
    group = "diffuse" if textured else ""
    values: dict[str, Value] = {"color": colour}
    layer = Layer.starting_at("diffuse", Lambert(), values, group=group)
    maps = {"diffuse": read.texture("reflectance")} if textured else {}
    images = read.images({("diffuse", "color"): "reflectance"})
    initial = MaterialState({"diffuse": LayerState(values)}, images=images)
    return Material((layer,), initial), maps


def _conductor(read: Reader) -> Read:
    return _metal(read, "ggx", (0.0, None))


def _roughconductor(read: Reader) -> Read:
    if "alpha_u" in read.description or "alpha_v" in read.description:
        if read.scalar("alpha_u") != read.scalar("alpha_v"):
            raise Fixed("its roughness differs along u and v (alpha_u, alpha_v)")
        return _metal(read, read.distribution(), (read.scalar("alpha_u"), None))
    return _metal(read, read.distribution(), read.varying("alpha"))


def _metal(
    read: Reader, distribution: Distribution, roughness: tuple[float, ImageMap | None]
) -> Read:
    alpha, picture = roughness
    colour, textured = read.coloured("specular_reflectance")
    values: dict[str, Value] = {
        "color": colour,
        "roughness": alpha if alpha >= SMALLEST_ROUGHNESS else 0.0,
        "eta": read.colour("eta", 0.0),
        "k": read.colour("k", 1.0),
    }
    layer = Layer.starting_at(
        "specular",
        CookTorranceConductor(distribution),
        values,
        delta=alpha < SMALLEST_ROUGHNESS,
        group="specular" if textured else "",
    )
    maps = {"specular": read.texture("specular_reflectance")} if textured else {}
    images = read.images({("specular", "color"): "specular_reflectance"})
    if picture is not None:
        images["specular", "roughness"] = picture
    initial = MaterialState({"specular": LayerState(values)}, images=images)
    return Material((layer,), initial), maps


def _plastic(read: Reader) -> Read:
    return _coated(read, "ggx", 0.0)


def _roughplastic(read: Reader) -> Read:
    return _coated(read, read.distribution(), read.scalar("alpha"))


def _coated(read: Reader, distribution: Distribution, alpha: float) -> Read:
    ior = read.scalar("eta")
    if not 1.0 < ior <= 3.0:
        raise Fixed(f"its relative index of refraction, {ior:g}, lies outside (1, 3]")
    base_colour, base_textured = read.coloured("diffuse_reflectance")
    coat_colour, coat_textured = read.coloured("specular_reflectance")
    nonlinear = bool(read.description.get("nonlinear", False))
    shared: dict[str, Value] = {
        "roughness": alpha if alpha >= SMALLEST_ROUGHNESS else 0.0,
        "ior": ior,
    }
    base_model = PlasticBase(distribution, nonlinear, base_textured)
    base = Layer.starting_at(
        "diffuse",
        base_model,
        {"color": base_colour, **shared},
        group="diffuse" if base_textured else "",
    )
    coat_values: dict[str, Value] = {"color": coat_colour, **shared}
    coat = Layer.starting_at(
        "specular",
        CookTorranceDielectric(distribution),
        coat_values,
        delta=alpha < SMALLEST_ROUGHNESS,
        group="specular" if coat_textured else "",
    )
    maps: dict[str, Description] = {}
    if coat_textured:
        maps["specular"] = read.texture("specular_reflectance")
    if base_textured:
        maps["diffuse"] = read.texture("diffuse_reflectance")
        if nonlinear:
            inside = float(base.fixed["internal"])
            mean = texture_mean(maps["diffuse"])
            fixed = {f"texture_{c}": m for c, m in zip("rgb", mean, strict=True)}
            base = replace(base, fixed={**base.fixed, **fixed})
            maps["diffuse"] = interreflected(maps["diffuse"], inside)
    images = read.images({("specular", "color"): "specular_reflectance"})
    if not nonlinear:
        images |= read.images({("diffuse", "color"): "diffuse_reflectance"})
    initial = MaterialState(
        {"diffuse": LayerState({"color": base_colour}), "specular": LayerState(coat_values)},
        images=images,
    )
    links = tuple(Link("diffuse", name, "specular", name) for name in ("roughness", "ior"))
    return Material((base, coat), initial, links), maps


_KINDS: dict[str, Callable[[Reader], Read]] = {
    "diffuse": _diffuse,
    "conductor": _conductor,
    "roughconductor": _roughconductor,
    "plastic": _plastic,
    "roughplastic": _roughplastic,
    "principled": principled.read,
}


# -- writing --------------------------------------------------------------------------------


def is_freehand(layer: LayerState) -> bool:
    """Whether a curve was drawn on a layer."""
    return layer.curve is not None or layer.outgoing_curve is not None


@dataclass(frozen=True)
class _Wrapped:
    """Describes a BSDF inside what the scene puts round it."""

    wrapping: Wrapping
    inner: Callable[[MaterialState], Description | None]

    def __call__(self, state: MaterialState) -> Description | None:
        """The dictionary, or None where there is none of the BSDF inside."""
        described = self.inner(state)
        return None if described is None else self.wrapping.around(described)


@dataclass(frozen=True)
class _Writer:
    """Describes Mitsuba's own plugin in an edited state."""

    description: Description
    material: Material
    read: Reader

    @property
    def _holds(self) -> set[Place]:
        """Where Mitsuba's plugin takes a picture."""
        places = {("diffuse", "color"), ("specular", "roughness")}
        if self.description["type"] == "principled":
            return places | {("specular", "metallic")}
        return places | {("specular", "color")}

    def __call__(self, state: MaterialState) -> Description | None:
        """Its dictionary, or None where Mitsuba's plugin cannot hold the state."""
        own = {layer.name for layer in self.material.layers}
        extra = [layer for name, layer in state.layers.items() if name not in own]
        if state.conserve or any(layer.enabled and layer.weight > 0 for layer in extra):
            return None
        if any(is_freehand(state.layers[name]) for name in own):
            return None
        if set(state.images) - self._holds:
            return None
        if self.description["type"] == "principled":
            return self._held(lambda: principled.edited(self.read, self.material, state))
        colours: dict[str, RGB] = {}
        for name in own:
            layer = state.layers[name]
            strength = layer.weight if layer.enabled else 0.0
            r, g, b = (strength * float(c) for c in layer.values["color"])  # type: ignore[union-attr]
            colours[name] = (r, g, b)
        return self._held(lambda: self._edited(state, colours))

    @staticmethod
    def _held(describe: Callable[[], dict[str, Any]]) -> Description | None:
        try:
            return describe()
        except Fixed:
            return None

    def _edited(self, state: MaterialState, colours: Mapping[str, RGB]) -> dict[str, Any]:
        kind = self.description["type"]
        if kind == "diffuse":
            return {"type": kind, **self._colour("reflectance", "diffuse", colours, state)}
        values = state.layers["specular"].values
        alpha = float(values["roughness"])  # type: ignore[arg-type]
        picture = state.images.get(("specular", "roughness"))
        smooth = alpha < SMALLEST_ROUGHNESS and picture is None
        roughness = self.read.edited_number("alpha", alpha, picture)
        edited: dict[str, Any] = {} if smooth else {"alpha": roughness, **self._distribution()}
        edited.update(self._colour("specular_reflectance", "specular", colours, state))
        if "conductor" in kind:
            edited["type"] = "conductor" if smooth else "roughconductor"
            for name in ("eta", "k"):
                edited[name] = rgb(values[name])
            return edited
        if picture is not None:
            raise Fixed("Mitsuba's roughplastic has one roughness")
        base = self.material.layer("diffuse").model
        assert isinstance(base, PlasticBase)
        layer = state.layers["diffuse"]
        if base.nonlinear and (layer.weight != 1 or not layer.enabled):
            raise Fixed("a nonlinear colour does not scale")
        if base.nonlinear and base.textured and colours["diffuse"] != (1.0, 1.0, 1.0):
            raise Fixed("a tint of a nonlinear texture scales the result, not the texture")
        edited["type"] = "plastic" if smooth else "roughplastic"
        edited["nonlinear"] = base.nonlinear
        edited["int_ior"], edited["ext_ior"] = float(values["ior"]), 1.0  # type: ignore[arg-type]
        edited.update(self._colour("diffuse_reflectance", "diffuse", colours, state))
        return edited

    def _colour(
        self, name: str, layer: str, colours: Mapping[str, RGB], state: MaterialState
    ) -> dict[str, Any]:
        return self.read.edited_colour(name, colours[layer], state.images.get((layer, "color")))

    def _distribution(self) -> dict[str, Any]:
        model = self.material.layer("specular").model
        assert isinstance(model, (CookTorranceConductor, CookTorranceDielectric))
        return {"distribution": model.distribution}
