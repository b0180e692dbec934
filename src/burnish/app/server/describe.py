"""The session in the words of the messages."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from burnish.app.messages import (
    RGB,
    CurveData,
    LayerCurve,
    LayerInfo,
    LayerValues,
    ObjectData,
    ObjectValues,
    ParameterInfo,
    Value,
    ViewData,
)
from burnish.app.server.appearance import base_profile, profile, total_albedo
from burnish.core.types import Float64
from burnish.materials.coefficients import conserved
from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.parameter import Parameter
from burnish.session import ObjectInfo, Session
from burnish.transport.frozen import Transport

_CURVE_SAMPLES = 129


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
    )


def layer(item: Layer, initial: LayerState, knobs: tuple[Parameter, ...]) -> LayerInfo:
    """A layer's model, coordinate and knobs; a linked parameter is another layer's knob."""
    model = item.model
    angle = model.coordinate_name.startswith(("theta", "gamma", "alpha", "beta"))
    maximum = model.coordinate_maximum
    return LayerInfo(
        name=item.name,
        model=model.name,
        description=(type(model).__doc__ or "").strip().split("\n\n")[0],
        coordinate=model.coordinate_name if item.bins > 1 else "none",
        coordinate_maximum=math.degrees(maximum) if angle else maximum,
        weight=initial.weight,
        parameters=tuple(
            parameter(info, initial.values.get(info.name, info.default)) for info in knobs
        ),
    )


def scene_object(info: ObjectInfo, material: Material | None) -> ObjectData:
    """An object with its layers; one that cannot be edited has none."""
    layers: tuple[LayerInfo, ...] = ()
    if material is not None:
        layers = tuple(
            layer(item, material.initial.layers[item.name], material.parameters(item.name))
            for item in material.layers
        )
    return ObjectData(info.id, info.editable and bool(layers), info.reason or "", layers)


def view(name: str, transport: Transport) -> ViewData:
    """A view's name and size."""
    return ViewData(name, transport.width, transport.height)


def values(material: Material, state: MaterialState) -> ObjectValues:
    """What is set on an object, and how much it reflects."""
    return ObjectValues(
        layers={
            name: LayerValues(dict(item.values), curve(item.curve), item.enabled, item.weight)
            for name, item in state.layers.items()
        },
        changed=state != material.initial,
        albedo=_rgb(total_albedo(material, conserved(material, state))),
    )


def curve(item: Curve | None) -> CurveData | None:
    """A freehand edit as lists of numbers."""
    if item is None:
        return None
    return CurveData(item.mode, item.interpolation, item.points, item.values)


def curve_from(data: CurveData) -> Curve:
    """The other way. Raises InvalidValue for lists that make no curve."""
    return Curve(data.t, data.values, data.mode, data.interpolation)


def curves(material: Material, state: MaterialState) -> tuple[LayerCurve, ...]:
    """The profiles of an object's layers, denser near the highlight."""
    result = []
    for item in material.layers:
        if item.model.coordinate_name == "none" or item.bins == 1:
            continue
        t = np.linspace(0.0, 1.0, _CURVE_SAMPLES) ** max(item.spacing, 1.0)
        own = state.layers[item.name]
        result.append(
            LayerCurve(
                layer=item.name,
                t=tuple(t.tolist()),
                base=rgb_list(base_profile(item, own, t)),
                result=rgb_list(profile(item, own, t)),
            )
        )
    return tuple(result)


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
    return tuple(_rgb(row) for row in array)


def _rgb(row: Float64) -> RGB:
    r, g, b = (float(f"{x:.6g}") if math.isfinite(x) else 0.0 for x in row)
    return r, g, b


def _finite(x: float) -> float:
    return x if math.isfinite(x) else math.copysign(1e9, x)
