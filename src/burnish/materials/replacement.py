"""Another model in a layer's place: which ones there are, and what carries over.

What a person sees carries over: the width of the highlight, the reflectance at normal
incidence or the albedo, the layer's weight, and a freehand curve where the two models are
edited over the same coordinate. Widths are compared as the α of a microfacet model:

| model | α |
|---|---|
| Cook-Torrance, Ward | roughness |
| Blinn-Phong, Ashikhmin-Shirley | √(2 / (n + 2)) (Walter et al. 2007, §5.2) |
| Phong, Lafortune | that of a Blinn-Phong lobe of exponent 4 n, which looks as wide |
| Schlick | √roughness |
| Mitsuba's `principled` | roughness² |
| Beard-Maxwell, Torrance-Sparrow | σ |
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, cast

from burnish.core.errors import UnknownName
from burnish.core.types import RGB, Value
from burnish.materials.fresnel import ior_of, normal_reflectance, takes_normal_reflectance
from burnish.materials.layer import Layer, Material, MaterialState, Replacement
from burnish.materials.measured.models import (
    MeasuredDiffuse,
    MeasuredFresnel,
    MeasuredHalf,
    MeasuredIncident,
    MeasuredSpecular,
)
from burnish.materials.measured.pairs import MeasuredHalfDifference, MeasuredHomomorphic
from burnish.materials.measured.space import MeasuredSpace
from burnish.materials.model import Model
from burnish.materials.models.family import Family
from burnish.materials.models.plastic_base import PlasticBase
from burnish.materials.models.principled import (
    PrincipledBase,
    PrincipledCoat,
    PrincipledMetal,
    PrincipledSheen,
    PrincipledSpecular,
)
from burnish.materials.parameter import Parameter
from burnish.materials.registry import MODELS
from burnish.materials.two_curves import TwoCurves

_NOT_ALONE = (
    Family,
    MeasuredDiffuse,
    MeasuredSpecular,
    MeasuredFresnel,
    MeasuredHalf,
    MeasuredIncident,
    MeasuredHalfDifference,
    MeasuredHomomorphic,
    MeasuredSpace,
    PlasticBase,
    PrincipledBase,
    PrincipledCoat,
    PrincipledMetal,
    PrincipledSheen,
    PrincipledSpecular,
)
"""Models that need data of their own, or that are parts of one material."""


def choices() -> dict[str, type[Model]]:
    """The models that a layer can be given by name, a user's own among them."""
    return {name: kind for name, kind in MODELS.items() if not issubclass(kind, _NOT_ALONE)}


def replaced(
    material: Material, state: MaterialState, layer_name: str, model: str, bins: int
) -> MaterialState:
    """The state with another model in a layer's place.

    material: as the scene has it; its own model's name brings the layer back as it was, with
    its own numbers and pictures. Else pictures of colours carry over; a number that has one
    becomes plain, since models mean different things by the same name. bins: of the new layer.
    Raises UnknownName.
    """
    own, old = material.layer(layer_name), state.layers[layer_name]
    now = material.as_in(state)
    before = now.layer(layer_name)
    if model == before.model.name:
        return state
    if model == own.model.name:
        first = material.initial.layers[layer_name]
        changed = replace(first, enabled=old.enabled, weight=old.weight)
        images = {
            place: image
            for place, image in material.initial.images.items()
            if place[0] == layer_name
        }
    else:
        kinds = choices()
        if model not in kinds:
            raise UnknownName("reflectance model", model, kinds)
        kind = kinds[model]()
        if isinstance(kind, TwoCurves):
            kind = kind.with_bins(bins, max(bins * kind.bins2 // kind.bins, 1))
        values = now.linked(state).layers[layer_name].values
        known = {item.name for item in kind.parameters}
        every = carried(before.model, {**before.fixed, **values}, kind)
        started = {name: value for name, value in every.items() if name in known}
        layer = Layer.starting_at(
            layer_name, kind, every, bins=bins, delta=kind.can_be_delta, group=own.group
        )
        asked = {link.source_parameter for link in material.links if link.source_layer == own.name}
        earlier = {**(old.replacement.kept if old.replacement else {}), **values}
        kept = {name: earlier[name] for name in asked - started.keys()}
        (had, had_second), (has, has_second) = _angles(before.model), _angles(kind)
        changed = replace(
            old,
            values=started,
            curve=old.curve if had == has else None,
            second_curve=old.second_curve if had_second == has_second else None,
            replacement=Replacement(layer, started, kept),
        )
        every_parameter = (*before.model.parameters, *kind.parameters)
        numbers = {item.name for item in every_parameter if item.kind != "colour"}
        images = {
            place: image
            for place, image in state.images.items()
            if place[0] == layer_name and place[1] not in numbers
        }
    others = {place: image for place, image in state.images.items() if place[0] != layer_name}
    layers = {**state.layers, layer_name: changed}
    return replace(state, layers=layers, images=others | images)


def carried(before: Model, values: Mapping[str, Value], after: Model) -> dict[str, Value]:
    """What makes a model look as like another one as it can; else its defaults.

    values: of the other one, its frozen numbers among them; those of the result are among it
    too where they set the lobe's width.
    """
    result = {item.name: item.validate(item.default) for item in after.parameters}
    ranges = {item.name: item for item in (*after.fixed_parameters, *after.parameters)}
    wanted = _colour(before, values, after)
    alpha = _alpha(before, values)
    if alpha is not None and (width := _WIDTHS.get(after.name)) is not None:
        wanted[width.parameter] = width.from_alpha(max(alpha, _LEAST_ALPHA))
        if width.parameter == "exponent_u":
            ratio = float(values.get("ratio", 1.0))  # type: ignore[arg-type]
            wanted["exponent_v"] = ratio * float(wanted["exponent_u"])  # type: ignore[arg-type]
    for name, value in wanted.items():
        if name in ranges:
            result[name] = _inside(ranges[name], value)
    return result


def _angles(model: Model) -> tuple[str, str]:
    """What a model's curve is over, and its second one, if it has two."""
    return model.names if isinstance(model, TwoCurves) else (model.coordinate_name, "")


@dataclass(frozen=True)
class _Width:
    """The parameter that sets a lobe's width, to and from α."""

    parameter: str
    to_alpha: Callable[[float], float]
    from_alpha: Callable[[float], float]


_LEAST_ALPHA = 1e-3
_PLAIN = _Width("roughness", lambda v: v, lambda a: a)
_ROOT = _Width("roughness", lambda v: v * v, math.sqrt)
_EXPONENT = _Width("exponent", lambda n: math.sqrt(2 / (n + 2)), lambda a: 2 / a**2 - 2)
_PHONG = _Width("exponent", lambda n: math.sqrt(2 / (4 * n + 2)), lambda a: (2 / a**2 - 2) / 4)
_WIDTHS: dict[str, _Width] = {
    "cook-torrance": _PLAIN,
    "cook-torrance-dielectric": _PLAIN,
    "cook-torrance-conductor": _PLAIN,
    "cook-torrance-curves": _PLAIN,
    "fresnel-curve": _PLAIN,
    "ward-width": _PLAIN,
    "ward-ratio": _PLAIN,
    "schlick": _Width("roughness", math.sqrt, lambda a: a * a),
    "principled-specular": _ROOT,
    "principled-metal": _ROOT,
    "blinn-phong": _EXPONENT,
    "ashikhmin-shirley-width": _EXPONENT,
    "ashikhmin-shirley-ratio": _EXPONENT,
    "ashikhmin-shirley-curves": replace(_EXPONENT, parameter="exponent_u"),
    "phong": _PHONG,
    "phong-normalised": _PHONG,
    "torrance-sparrow": _Width("sigma", lambda v: v, lambda a: a),
    "beard-maxwell-surface": _Width("sigma", lambda v: v, lambda a: a),
    "ward-pca": _PLAIN,
    "ward-duer-pca": _PLAIN,
    "cook-torrance-pca": _PLAIN,
    "blinn-phong-pca": _EXPONENT,
    "ashikhmin-shirley-pca": _EXPONENT,
    "lafortune-pca": _PHONG,
}


def _alpha(model: Model, values: Mapping[str, Value]) -> float | None:
    """α of a model's lobe, None for one without."""
    width = _WIDTHS.get(model.name)
    return None if width is None else width.to_alpha(float(values[width.parameter]))  # type: ignore[arg-type]


def _colour(before: Model, values: Mapping[str, Value], after: Model) -> dict[str, Value]:
    """What sets the new model's colour: reflectance at normal incidence where both have one."""
    if "color" not in values:
        return {}
    colour = cast(RGB, values["color"])
    had, has = _fresnel(before), _fresnel(after)
    if had == has == "index" or (had == has == "complex"):
        return {name: values[name] for name in ("color", "ior", "eta", "k") if name in values}
    if had == "index" and has == "complex" and isinstance(after, TwoCurves):
        # Its Fresnel curve is exact for any index
        n = float(values["ior"])  # type: ignore[arg-type]
        return {"color": colour, "eta": (n, n, n), "k": (0.0, 0.0, 0.0)}
    normal = normal_reflectance(before, values)
    if normal is None or not has:
        return {"color": colour}
    if has == "index":
        return {"color": (1.0, 1.0, 1.0), "ior": ior_of(sum(normal) / 3)}
    # A metal without an index of its own is an ideal mirror, tinted
    return {"color": normal}


def _fresnel(model: Model) -> Literal["", "colour", "index", "complex"]:
    """How a model is told its reflectance at normal incidence: see `normal_reflectance`."""
    names = {item.name for item in model.parameters}
    if {"eta", "k"} <= names:
        return "complex"
    if model.name == "cook-torrance-dielectric":
        return "index"
    return "colour" if takes_normal_reflectance(model) else ""


def _inside(parameter: Parameter, value: Value) -> Value:
    """A value moved into the parameter's range."""
    if isinstance(value, str):
        return parameter.validate(value)
    low, high = parameter.minimum, parameter.maximum
    if isinstance(value, tuple):
        return parameter.validate(tuple(min(max(x, low), high) for x in value))
    return parameter.validate(min(max(value, low), high))
