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
import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import RGB, Value
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

Description = Mapping[str, Any]
"""A Mitsuba dictionary, as for `mi.load_dict`."""


@dataclass(frozen=True)
class Adapted:
    """What became of a BSDF.

    material: None when it stays fixed, and then `reason` says why. two_sided: whether both
    faces reflect. maps: for each layer group with a texture, the Mitsuba dictionary of the
    texture that is its H. edited_bsdf: gives Mitsuba's own plugin (mi.BSDF) for a state, or
    None where no plugin holds it.
    """

    material: Material | None
    reason: str = ""
    two_sided: bool = False
    maps: Mapping[str, Description] = field(default_factory=dict)
    edited_bsdf: Callable[[MaterialState], Any] | None = None


class _Fixed(Exception):
    """The BSDF cannot be edited; the message says why."""


def adapt(description: Description) -> Adapted:
    """The editable material of a BSDF description, or why there is none."""
    two_sided = description["type"] == "twosided"
    try:
        inner = _inside(description)
        kind = inner["type"]
        if kind not in _KINDS:
            raise _Fixed(f"its BSDF is '{kind}'; editable are {', '.join(sorted(_KINDS))}")
        read = _Reader(inner)
        material, maps = _KINDS[kind](read)
    except _Fixed as reason:
        return Adapted(None, str(reason), two_sided)
    for layer in material.layers:
        for parameter in material.parameters(layer.name):
            try:
                parameter.validate(material.initial.layers[layer.name].values[parameter.name])
            except InvalidValue as error:
                return Adapted(None, f"its {layer.name} {error}", two_sided)
    return Adapted(material, "", two_sided, maps, _Writer(inner, material, two_sided, read))


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
    initial = MaterialState(
        {**material.initial.layers, "specular": LayerState(values, weight=0.0)},
        material.initial.conserve,
    )
    return replace(material, layers=(*material.layers, layer), initial=initial)


# -- reading --------------------------------------------------------------------------------


def _inside(description: Description) -> Description:
    """The BSDF inside `twosided`."""
    if description["type"] != "twosided":
        return description
    nested = [
        value
        for key, value in description.items()
        if isinstance(value, Mapping) and not key.startswith("_id")
    ]
    if len(nested) != 1:
        raise _Fixed("its two faces have different BSDFs")
    return _inside(nested[0])


class _Reader:
    """The numbers and textures of one plugin."""

    def __init__(self, description: Description) -> None:
        self.description = description
        plugin = mi.load_dict(dict(description))
        self._values = mi.traverse(plugin)

    def is_textured(self, name: str) -> bool:
        """Whether a colour varies over the surface."""
        return f"{name}.value" not in self._values and any(
            key.startswith(f"{name}.")
            for key in self._values.keys()  # noqa: SIM118
        )

    def colour(self, name: str, default: float = 1.0) -> RGB:
        """A constant colour, linear RGB. Raises _Fixed when it is textured."""
        if self.is_textured(name):
            raise _Fixed(f"its {name} is textured; only colours may be")
        if f"{name}.value" not in self._values:
            return (default,) * 3
        value = np.asarray(self._values[f"{name}.value"], np.float64).ravel()
        r, g, b = (float(x) for x in (np.repeat(value, 3) if value.size == 1 else value))
        return (r, g, b)

    def scalar(self, name: str) -> float:
        """A constant number. Raises _Fixed when it is textured."""
        if self.is_textured(name):
            raise _Fixed(f"its {name} is textured; only colours may be")
        key = f"{name}.value" if f"{name}.value" in self._values else name
        return float(np.asarray(self._values[key]).ravel()[0])

    def distribution(self) -> Distribution:
        """The microfacet distribution; Mitsuba's default is Beckmann."""
        name = str(self.description.get("distribution", "beckmann")).lower()
        return "ggx" if name == "ggx" else "beckmann"

    def texture(self, name: str) -> Description:
        """The description of a colour's texture."""
        texture = self.description[name]
        if not isinstance(texture, Mapping):
            raise _Fixed(f"its {name} is a ready-made Mitsuba object")
        if texture["type"] in ("mesh_attribute", "volume"):
            raise _Fixed(f"its {name} is a '{texture['type']}'")
        return texture

    def coloured(self, name: str) -> tuple[RGB, bool]:
        """A colour's value, or white over a texture, and whether there is one."""
        if self.is_textured(name):
            self.texture(name)
            return (1.0, 1.0, 1.0), True
        return self.colour(name), False


Read = tuple[Material, dict[str, Description]]


def _diffuse(read: _Reader) -> Read:
    colour, textured = read.coloured("reflectance")
    group = "diffuse" if textured else ""
    values: dict[str, Value] = {"color": colour}
    layer = Layer.starting_at("diffuse", Lambert(), values, group=group)
    maps = {"diffuse": read.texture("reflectance")} if textured else {}
    return Material((layer,), MaterialState({"diffuse": LayerState(values)})), maps


def _conductor(read: _Reader) -> Read:
    return _metal(read, "ggx", 0.0)


def _roughconductor(read: _Reader) -> Read:
    if "alpha_u" in read.description or "alpha_v" in read.description:
        if read.scalar("alpha_u") != read.scalar("alpha_v"):
            raise _Fixed("its roughness differs along u and v (alpha_u, alpha_v)")
        return _metal(read, read.distribution(), read.scalar("alpha_u"))
    return _metal(read, read.distribution(), read.scalar("alpha"))


def _metal(read: _Reader, distribution: Distribution, alpha: float) -> Read:
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
    return Material((layer,), MaterialState({"specular": LayerState(values)})), maps


def _plastic(read: _Reader) -> Read:
    return _coated(read, "ggx", 0.0)


def _roughplastic(read: _Reader) -> Read:
    return _coated(read, read.distribution(), read.scalar("alpha"))


def _coated(read: _Reader, distribution: Distribution, alpha: float) -> Read:
    ior = read.scalar("eta")
    if not 1.0 < ior <= 3.0:
        raise _Fixed(f"its relative index of refraction, {ior:g}, lies outside (1, 3]")
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
            mean = _texture_mean(maps["diffuse"])
            fixed = {f"texture_{c}": m for c, m in zip("rgb", mean, strict=True)}
            base = replace(base, fixed={**base.fixed, **fixed})
            maps["diffuse"] = interreflected(maps["diffuse"], inside)
    initial = MaterialState(
        {"diffuse": LayerState({"color": base_colour}), "specular": LayerState(coat_values)}
    )
    links = tuple(Link("diffuse", name, "specular", name) for name in ("roughness", "ior"))
    return Material((base, coat), initial, links), maps


_KINDS: dict[str, Callable[[_Reader], Read]] = {
    "diffuse": _diffuse,
    "conductor": _conductor,
    "roughconductor": _roughconductor,
    "plastic": _plastic,
    "roughplastic": _roughplastic,
}


# -- textures -------------------------------------------------------------------------------


def interreflected(texture: Description, internal: float) -> Description:
    """A texture t seen through a coat that throws `internal` back: (1 − R) t / (1 − R t).

    The nonlinear colour of Mitsuba's `plastic`, up to a factor, as the dictionary of a
    texture plugin that is registered with the current variant.
    """
    _register_interreflected()
    return {"type": _PLUGIN, "internal": internal, "nested": dict(texture)}


_PLUGIN = "burnish_interreflected"
_registered: set[str] = set()


def _register_interreflected() -> None:
    if mi.variant() in _registered:
        return

    class Interreflected(mi.Texture):
        def __init__(self, props: Any) -> None:
            mi.Texture.__init__(self, props)
            self.nested = props["nested"]
            self.internal = float(props["internal"])

        def eval(self, si: Any, active: Any = True) -> Any:
            t = self.nested.eval(si, active)
            return (1 - self.internal) * t / (1 - self.internal * t)

        def mean(self) -> Any:
            t = self.nested.mean()
            return (1 - self.internal) * t / (1 - self.internal * t)

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"Interreflected[internal={self.internal}, nested={self.nested}]"

    mi.register_texture(_PLUGIN, Interreflected)
    _registered.add(mi.variant())


def _texture_mean(texture: Description) -> RGB:
    """Mean colour over the unit square of uv, on a 128² grid."""
    side = 128
    index = np.arange(side * side)
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(
        mi.Float(((index % side + 0.5) / side).astype(np.float32)),
        mi.Float(((index // side + 0.5) / side).astype(np.float32)),
    )
    colour = np.asarray(mi.Color3f(mi.load_dict(dict(texture)).eval(si)), np.float64)
    r, g, b = np.broadcast_to(colour.reshape(3, -1), (3, side * side)).mean(axis=1)
    return (float(r), float(g), float(b))


# -- writing --------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Writer:
    """Gives Mitsuba's own plugin for an edited state."""

    description: Description
    material: Material
    two_sided: bool
    read: _Reader

    def __call__(self, state: MaterialState) -> Any | None:
        """mi.BSDF, or None where Mitsuba's plugin cannot hold the state."""
        own = {layer.name for layer in self.material.layers}
        extra = [layer for name, layer in state.layers.items() if name not in own]
        if state.conserve or any(layer.enabled and layer.weight > 0 for layer in extra):
            return None
        colours: dict[str, RGB] = {}
        for name in own:
            layer = state.layers[name]
            if layer.curve is not None:
                return None
            strength = layer.weight if layer.enabled else 0.0
            r, g, b = (strength * float(c) for c in layer.values["color"])  # type: ignore[union-attr]
            colours[name] = (r, g, b)
        try:
            edited = self._edited(state, colours)
        except _Fixed:
            return None
        return mi.load_dict({"type": "twosided", "bsdf": edited} if self.two_sided else edited)

    def _edited(self, state: MaterialState, colours: Mapping[str, RGB]) -> dict[str, Any]:
        kind = self.description["type"]
        if kind == "diffuse":
            return {"type": kind, **self._colour("reflectance", colours["diffuse"])}
        values = state.layers["specular"].values
        alpha = float(values["roughness"])  # type: ignore[arg-type]
        smooth = alpha < SMALLEST_ROUGHNESS
        edited: dict[str, Any] = {} if smooth else {"alpha": alpha, **self._distribution()}
        edited.update(self._colour("specular_reflectance", colours["specular"]))
        if "conductor" in kind:
            edited["type"] = "conductor" if smooth else "roughconductor"
            for name in ("eta", "k"):
                edited[name] = _rgb(values[name])
            return edited
        base = self.material.layer("diffuse").model
        assert isinstance(base, PlasticBase)
        layer = state.layers["diffuse"]
        if base.nonlinear and (layer.weight != 1 or not layer.enabled):
            raise _Fixed("a nonlinear colour does not scale")
        if base.nonlinear and base.textured and colours["diffuse"] != (1.0, 1.0, 1.0):
            raise _Fixed("a tint of a nonlinear texture scales the result, not the texture")
        edited["type"] = "plastic" if smooth else "roughplastic"
        edited["nonlinear"] = base.nonlinear
        edited["int_ior"], edited["ext_ior"] = float(values["ior"]), 1.0  # type: ignore[arg-type]
        edited.update(self._colour("diffuse_reflectance", colours["diffuse"]))
        return edited

    def _distribution(self) -> dict[str, Any]:
        model = self.material.layer("specular").model
        assert isinstance(model, (CookTorranceConductor, CookTorranceDielectric))
        return {"distribution": model.distribution}

    def _colour(self, name: str, colour: RGB) -> dict[str, Any]:
        """The dictionary entry of a colour, or of its tinted texture."""
        if max(colour) > 1 and not self.read.is_textured(name):
            raise _Fixed("Mitsuba's colours end at 1")
        if not self.read.is_textured(name):
            return {name: _rgb(colour)}
        texture = self.read.texture(name)
        return {name: dict(texture) if colour == (1.0, 1.0, 1.0) else _tinted(texture, colour)}


def _rgb(colour: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(c) for c in colour]}


def _tinted(texture: Description, colour: RGB) -> Any:
    """A bitmap with scaled texels. Raises _Fixed for other textures and colours above 1."""
    plugin = mi.load_dict(dict(texture))
    values = mi.traverse(plugin)
    if texture["type"] != "bitmap" or max(colour) > 1:
        raise _Fixed("only bitmaps can be tinted")
    data = np.asarray(values["data"])
    if data.shape[2] == 1:
        if len(set(colour)) > 1:
            raise _Fixed("a grey bitmap cannot be tinted")
        colour = colour[:1]  # type: ignore[assignment]
    values["data"] = mi.TensorXf(data * np.asarray(colour, np.float32))
    values.update()
    return plugin
