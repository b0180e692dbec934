"""Models by name, and materials as plain JSON values."""

from __future__ import annotations

import dataclasses
import importlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, cast

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Value
from burnish.materials.curve import Curve
from burnish.materials.images.image import ImageMap
from burnish.materials.layer import Layer, LayerState, Link, Material, MaterialState
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
from burnish.materials.models.ashikhmin_shirley import (
    AshikhminShirleyRatio,
    AshikhminShirleyWidth,
)
from burnish.materials.models.ashikhmin_shirley_curves import AshikhminShirleyCurves
from burnish.materials.models.beard_maxwell import BeardMaxwellSurface, BeardMaxwellVolume
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance import (
    CookTorrance,
    CookTorranceConductor,
    CookTorranceDielectric,
)
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.materials.models.family import PrincipledFamily
from burnish.materials.models.fresnel_curve import FresnelCurve
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.light_view import LightView
from burnish.materials.models.oren_nayar import OrenNayar
from burnish.materials.models.phong import NormalisedPhong, Phong
from burnish.materials.models.plastic_base import PlasticBase
from burnish.materials.models.principled import (
    PrincipledBase,
    PrincipledCoat,
    PrincipledMetal,
    PrincipledSheen,
    PrincipledSpecular,
)
from burnish.materials.models.schlick import Schlick
from burnish.materials.models.torrance_sparrow import TorranceSparrow
from burnish.materials.models.ward import WardRatio, WardWidth
from burnish.materials.painting.stroke import Stroke
from burnish.materials.pca.models import SIX

MODELS: dict[str, type[Model]] = {
    model.name: model
    for model in (
        Lambert,
        BlinnPhong,
        CookTorrance,
        CookTorranceDielectric,
        CookTorranceConductor,
        CookTorranceCurves,
        PlasticBase,
        AshikhminShirleyRatio,
        AshikhminShirleyWidth,
        AshikhminShirleyCurves,
        Phong,
        NormalisedPhong,
        TorranceSparrow,
        LightView,
        OrenNayar,
        WardWidth,
        WardRatio,
        Schlick,
        BeardMaxwellSurface,
        BeardMaxwellVolume,
        FresnelCurve,
        MeasuredDiffuse,
        MeasuredSpecular,
        MeasuredFresnel,
        MeasuredHalf,
        MeasuredIncident,
        MeasuredSpace,
        MeasuredHalfDifference,
        MeasuredHomomorphic,
        PrincipledBase,
        PrincipledSheen,
        PrincipledSpecular,
        PrincipledMetal,
        PrincipledCoat,
        PrincipledFamily,
        *SIX,
    )
}

Json = dict[str, Any]
USER_MODELS = "BURNISH_MODELS"
"""Names the modules that register models of a user's own."""


def model_to_json(model: Model) -> Json:
    """{"name": …} and the model's static choices; for a user's own, the module that defines it."""
    module = getattr(model, "module", None)
    origin = {} if module is None else {"module": module}
    return {"name": model.name, **origin, **dataclasses.asdict(cast(Any, model))}


def model_from_json(data: Mapping[str, Any]) -> Model:
    """The inverse of `model_to_json`. Raises UnknownName, InvalidValue.

    A user's own model must have been registered by its module. No file can have a module
    imported; the environment variable BURNISH_MODELS (names, separated by commas) can.
    """
    choices = {str(key): value for key, value in data.items() if key not in ("name", "module")}
    name = str(data.get("name"))
    if name not in MODELS:
        for module in filter(None, os.environ.get(USER_MODELS, "").split(",")):
            _import(module.strip())
    if name not in MODELS and "module" in data:
        raise InvalidValue(
            f"model {name!r} is a user's own, defined in {data['module']!r}: import that module "
            f"first, or name it in the environment variable {USER_MODELS}"
        )
    if name not in MODELS:
        raise UnknownName("reflectance model", name, MODELS)
    try:
        return MODELS[name](**choices)
    except TypeError:
        raise InvalidValue(f"model {name} does not take the choices {choices!r}") from None


def layer_to_json(layer: Layer) -> Json:
    """A layer's structure, frozen numbers included."""
    return {
        "name": layer.name,
        "model": model_to_json(layer.model),
        "bins": layer.bins,
        "spacing": layer.spacing,
        "fixed": dict(layer.fixed),
        "delta": layer.delta,
        "group": layer.group,
    }


def layer_from_json(data: Mapping[str, Any]) -> Layer:
    """The inverse of `layer_to_json`. Raises UnknownName, InvalidValue."""
    with _complaint("layer", data):
        return Layer(
            name=data["name"],
            model=model_from_json(data["model"]),
            bins=data["bins"],
            spacing=data["spacing"],
            fixed={name: float(value) for name, value in data["fixed"].items()},
            delta=data["delta"],
            group=data["group"],
        )


def layer_state_to_json(state: LayerState) -> Json:
    """What was set on one layer."""
    outward, second = state.outgoing_curve, state.second_curve
    values = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in state.values.items()
    }
    return {
        "values": values,
        "curve": None if state.curve is None else state.curve.to_json(),
        "outgoing_curve": None if outward is None else outward.to_json(),
        "enabled": state.enabled,
        "weight": state.weight,
        **({} if second is None else {"second_curve": second.to_json()}),
    }


def layer_state_from_json(data: Mapping[str, Any]) -> LayerState:
    """The inverse of `layer_state_to_json`. Raises InvalidValue."""
    with _complaint("layer state", data):
        values: dict[str, Value] = {
            name: (float(value[0]), float(value[1]), float(value[2]))
            if isinstance(value, list)
            else value
            for name, value in data["values"].items()
        }
        curves = (data["curve"], data.get("outgoing_curve"), data.get("second_curve"))
        curve, outward, second = (
            None if item is None else Curve.from_json(item) for item in curves
        )
        enabled, weight = bool(data["enabled"]), float(data["weight"])
        return LayerState(values, curve, enabled, weight, outward, second_curve=second)


def state_to_json(state: MaterialState) -> Json:
    """What was set on one material."""
    painted: Json = {}
    if state.strokes:
        painted["strokes"] = [item.to_json() for item in state.strokes]
    if state.images:
        painted["images"] = [
            {"layer": layer, "parameter": parameter, **item.to_json()}
            for (layer, parameter), item in state.images.items()
        ]
    return {
        "layers": {name: layer_state_to_json(layer) for name, layer in state.layers.items()},
        "conserve": state.conserve,
        **painted,
    }


def state_from_json(data: Mapping[str, Any]) -> MaterialState:
    """The inverse of `state_to_json`. Raises InvalidValue."""
    with _complaint("material state", data):
        layers = {name: layer_state_from_json(layer) for name, layer in data["layers"].items()}
        strokes = tuple(Stroke.from_json(item) for item in data.get("strokes", ()))
        images = {
            (item["layer"], item["parameter"]): ImageMap.from_json(item)
            for item in data.get("images", ())
        }
        return MaterialState(layers, bool(data["conserve"]), strokes, images)


def material_to_json(material: Material) -> Json:
    """Layers, links and the initial state."""
    return {
        "layers": [layer_to_json(layer) for layer in material.layers],
        "links": [dataclasses.asdict(link) for link in material.links],
        "initial": state_to_json(material.initial),
    }


def material_from_json(data: Mapping[str, Any]) -> Material:
    """The inverse of `material_to_json`. Raises UnknownName, InvalidValue."""
    with _complaint("material", data):
        return Material(
            layers=tuple(layer_from_json(layer) for layer in data["layers"]),
            initial=state_from_json(data["initial"]),
            links=tuple(Link(**link) for link in data["links"]),
        )


def _import(module: str) -> None:
    try:
        importlib.import_module(module)
    except ImportError as error:
        raise InvalidValue(
            f"{USER_MODELS} names {module!r}, which cannot be imported ({error}); put its folder "
            "into PYTHONPATH"
        ) from error


@contextmanager
def _complaint(kind: str, data: object) -> Iterator[None]:
    """Turn a missing or misshapen field into an InvalidValue that shows it."""
    try:
        yield
    except UnknownName:
        raise
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise InvalidValue(
            f"a {kind} has a field that is missing or of the wrong shape ({error}): "
            f"{data!r}; the file may come from another version of burnish"
        ) from None
