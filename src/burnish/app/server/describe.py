"""The session in the words of the messages."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from burnish.app.messages import (
    RGB,
    CurveData,
    LayerCurve,
    LayerInfo,
    LayerValues,
    MapData,
    MetalInfo,
    ModelInfo,
    ObjectData,
    ObjectValues,
    ParameterInfo,
    Value,
    ViewData,
)
from burnish.app.server.appearance import (
    base_profile,
    outgoing_factors,
    profile,
    second_profiles,
    total_albedo,
)
from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Float64
from burnish.materials.coefficients import conserved
from burnish.materials.curve import Curve
from burnish.materials.fresnel import METALS, takes_normal_reflectance
from burnish.materials.images.files import Channel
from burnish.materials.images.image import ImageMap, Placement
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.model import Model
from burnish.materials.parameter import Parameter
from burnish.materials.replacement import choices
from burnish.materials.two_curves import TwoCurves
from burnish.session import ObjectInfo, Session
from burnish.transport.frozen import Transport

_CURVE_SAMPLES = 129
_OUTGOING_SAMPLES = 46
_NOTHING = 1e-30
"""Smaller numbers are sent as 0."""


def parameter(info: Parameter, initial: Value) -> ParameterInfo:
    """A knob, with the scene's own value as the one that a double click brings back."""
    low = info.minimum if info.soft_minimum is None else info.soft_minimum
    high = info.maximum if info.soft_maximum is None else info.soft_maximum
    return ParameterInfo(
        name=info.name,
        kind=info.kind,
        default=initial,
        minimum=_finite(info.minimum),
        maximum=_finite(info.maximum),
        soft_minimum=_finite(low),
        soft_maximum=_finite(high),
        unit=info.unit,
        choices=info.choices,
        description=info.description,
        scale=info.scale,
    )


def layer(
    item: Layer, initial: LayerState, knobs: tuple[Parameter, ...], own_model: str
) -> LayerInfo:
    """A layer's model, coordinate and knobs; a linked parameter is another layer's knob."""
    model = item.model
    coordinate, second = model.coordinate_name, "none"
    if isinstance(model, TwoCurves):
        coordinate, second = model.names
    angle = coordinate.startswith(("theta", "gamma", "alpha", "beta"))
    maximum = model.coordinate_maximum
    return LayerInfo(
        name=item.name,
        model=model.name,
        description=summary(type(model)),
        coordinate=coordinate if item.bins > 1 else "none",
        coordinate_maximum=math.degrees(maximum) if angle else maximum,
        second_coordinate=second,
        weight=initial.weight,
        own_model=own_model,
        fresnel=fresnel(model),
        parameters=tuple(
            parameter(info, initial.values.get(info.name, info.default)) for info in knobs
        ),
    )


def layers(material: Material, own: Material | None = None) -> tuple[LayerInfo, ...]:
    """The layers of a material; own: the scene's, where that has other models."""
    first = own or material
    return tuple(
        layer(
            item,
            material.initial.layers[item.name],
            material.parameters(item.name),
            first.layer(item.name).model.name,
        )
        for item in material.layers
    )


def scene_object(info: ObjectInfo, material: Material | None) -> ObjectData:
    """An object with its layers; one that cannot be edited has none."""
    found = () if material is None else layers(material)
    return ObjectData(info.id, info.editable and bool(found), info.reason or "", found)


def models() -> tuple[ModelInfo, ...]:
    """The models that a layer can be given."""
    return tuple(ModelInfo(name, summary(kind)) for name, kind in choices().items())


def metals() -> tuple[MetalInfo, ...]:
    """The metals that a layer can be made of by name."""
    return tuple(MetalInfo(item.name, item.reflectance) for item in METALS)


def metal_values(model: Model, name: str) -> dict[str, Value]:
    """The parameters that make a model reflect like a metal. Raises UnknownName, InvalidValue."""
    found = {item.name: item for item in METALS}
    if name not in found:
        raise UnknownName("metal", name, found)
    metal, kind = found[name], fresnel(model)
    if kind == "complex":
        return {"color": (1.0, 1.0, 1.0), "eta": metal.n, "k": metal.k}
    if kind == "color":
        return {"color": metal.reflectance}
    raise InvalidValue(
        f"model {model.name} has no metal's reflectance; choose cook-torrance-conductor for it"
    )


def fresnel(model: Model) -> Literal["", "color", "ior", "complex"]:
    """What sets a model's reflectance at normal incidence."""
    names = {item.name for item in model.parameters}
    if {"eta", "k"} <= names:
        return "complex"
    if takes_normal_reflectance(model):
        return "color"
    return "ior" if "ior" in names else ""


def summary(kind: type[Model]) -> str:
    """The first paragraph of a model's manual page."""
    return (kind.__doc__ or "").strip().split("\n\n")[0]


def view(name: str, transport: Transport) -> ViewData:
    """A view's name and size, and its camera where the transport knows it."""
    camera = tuple(getattr(transport, "camera", ()))
    return ViewData(name, transport.width, transport.height, camera)


def values(material: Material, state: MaterialState) -> ObjectValues:
    """What is set on an object, and how much it reflects."""
    return ObjectValues(
        layers={
            name: LayerValues(
                dict(item.values),
                {
                    place[1]: map_data(image)
                    for place, image in state.images.items()
                    if place[0] == name
                },
                curve(item.curve),
                curve(item.outgoing_curve),
                curve(item.second_curve),
                item.enabled,
                item.weight,
            )
            for name, item in state.layers.items()
        },
        changed=bool(state.replacements) or state != material.initial,
        albedo=rgb_list(total_albedo(material, conserved(material, state))[None])[0],
    )


def map_data(image: ImageMap) -> MapData:
    """A map in a page's words."""
    lies = Placement.of(image.transform)
    channel = cast(Channel, image.channel)
    return MapData(image.source, channel, image.scale, image.offset, lies.repeat, lies.rotate)


def curve(item: Curve | None) -> CurveData | None:
    """A freehand edit as lists of numbers."""
    if item is None:
        return None
    return CurveData(item.mode, item.interpolation, item.points, item.values)


def curve_from(data: CurveData | None) -> Curve | None:
    """The other way. Raises InvalidValue for lists that make no curve."""
    return None if data is None else Curve(data.t, data.values, data.mode, data.interpolation)


def curves(
    material: Material, state: MaterialState
) -> tuple[tuple[LayerCurve, ...], tuple[LayerCurve, ...], tuple[LayerCurve, ...]]:
    """The profiles of an object's layers, denser near the highlight, their factors on the viewing
    angle, and the second curves of those that have one."""
    linked = material.linked(state)
    profiles, factors, second = [], [], []
    even = np.linspace(0.0, 1.0, _OUTGOING_SAMPLES)
    for item in material.layers:
        own = linked.layers[item.name]
        if item.model.coordinate_name != "none" and item.bins > 1:
            spacings = [item.spacing]
            if isinstance(item.model, TwoCurves):
                spacings = [axis.spacing for axis in item.model.axes]
                t = np.linspace(0.0, 1.0, _CURVE_SAMPLES) ** spacings[1]
                second.append(_curve_of(item.name, t, *second_profiles(item, own, t)))
            t = np.linspace(0.0, 1.0, _CURVE_SAMPLES) ** max(spacings[0], 1.0)
            base, result = base_profile(item, own, t), profile(item, own, t)
            profiles.append(_curve_of(item.name, t, base, result))
        base, result = outgoing_factors(item, own, even)
        factors.append(_curve_of(item.name, even, base, result))
    return tuple(profiles), tuple(factors), tuple(second)


def _curve_of(name: str, t: Float64, base: Float64, result: Float64) -> LayerCurve:
    return LayerCurve(name, tuple(t.tolist()), rgb_list(base), rgb_list(result))


def object_numbers(session: Session, view: str, order: Mapping[str, int]) -> NDArray[np.uint16]:
    """Which object each pixel shows most of: uint16 [height, width, 1], 0 for none.

    order: object id to its place in Welcome.objects, counted from 1.
    """
    ids = [item.id for item in session.views[view].basis.objects]
    numbers = np.array([*(order.get(item, 0) for item in ids), 0], np.uint16)
    # The map's -1, for none, finds the 0 at the end.
    return numbers[session.object_map(view)][:, :, None]


def rgb_list(array: Float64) -> tuple[RGB, ...]:
    """[n, 3] as a tuple of colours, to six digits."""
    x = np.where(np.isfinite(array) & (np.abs(array) > _NOTHING), array, 0.0)
    size = 10.0 ** (5 - np.floor(np.log10(np.where(x == 0.0, 1.0, np.abs(x)))))
    return tuple((r, g, b) for r, g, b in (np.round(x * size) / size).tolist())


def _finite(x: float) -> float:
    return x if math.isfinite(x) else math.copysign(1e9, x)
