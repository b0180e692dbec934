"""The edits file: small, readable JSON that holds only what differs from the scene.

    {
      "format": "burnish-edits",
      "version": 1,
      "scene": "teatray",
      "objects": {
        "teapot": {"specular": {"parameters": {"roughness": 0.12}}},
        "tray": {"diffuse": {"enabled": false}, "conserve": true}
      }
    }

A layer's entry may have `parameters`, `curve` (see `Curve`), `enabled` and `weight`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Value
from burnish.materials.curve import Curve
from burnish.materials.layer import LayerState, Material, MaterialState
from burnish.materials.names import WEIGHT
from burnish.transport.basis import State

FORMAT = "burnish-edits"
VERSION = 1

Json = dict[str, Any]


def edits_to_text(state: State, materials: Mapping[str, Material], scene: str) -> str:
    """The file's text for what `state` changed."""
    objects = {}
    for object_id, material in materials.items():
        entry = _object_entry(state[object_id], material.initial)
        if entry:
            objects[object_id] = entry
    data = {"format": FORMAT, "version": VERSION, "scene": scene, "objects": objects}
    return json.dumps(data, indent=2, ensure_ascii=False) + "\n"


def edits_from_text(
    text: str, materials: Mapping[str, Material], where: str
) -> dict[str, MaterialState]:
    """The state that a file's text describes: the scene's own, with the edits made.

    where: the file, for messages. Raises InvalidValue for a text that is no edits file or
    a value out of range, UnknownName for a name that the scene lacks.
    """
    try:
        data = json.loads(text)
    except ValueError as error:
        raise InvalidValue(f"{where}: not JSON ({error}); save the edits again") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise InvalidValue(f'{where}: not a burnish edits file ("format" must be "{FORMAT}")')
    version = data.get("version")
    if not isinstance(version, int) or not 1 <= version <= VERSION:
        raise InvalidValue(
            f"{where}: version must be 1 to {VERSION}; got {version!r}: install a newer burnish"
        )
    state = {object_id: material.initial for object_id, material in materials.items()}
    for object_id, entry in _mapping(data.get("objects", {}), f"{where}: objects").items():
        if object_id not in materials:
            raise UnknownName("editable object", object_id, materials)
        field = f"{where}: {object_id}"
        state[object_id] = _edited(materials[object_id], _mapping(entry, field), field)
    return state


def _object_entry(state: MaterialState, initial: MaterialState) -> Json:
    entry: Json = {}
    for name, layer in state.layers.items():
        changed = _layer_entry(layer, initial.layers[name])
        if changed:
            entry[name] = changed
    if state.conserve != initial.conserve:
        entry["conserve"] = state.conserve
    return entry


def _layer_entry(layer: LayerState, initial: LayerState) -> Json:
    entry: Json = {}
    parameters = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in layer.values.items()
        if value != initial.values[name]
    }
    if parameters:
        entry["parameters"] = parameters
    if layer.curve != initial.curve:
        entry["curve"] = None if layer.curve is None else layer.curve.to_json()
    if layer.enabled != initial.enabled:
        entry["enabled"] = layer.enabled
    if layer.weight != initial.weight:
        entry["weight"] = layer.weight
    return entry


def _edited(material: Material, entry: Mapping[str, Any], where: str) -> MaterialState:
    layers = dict(material.initial.layers)
    conserve = material.initial.conserve
    for name, changes in entry.items():
        if name == "conserve":
            conserve = _boolean(changes, f"{where}.conserve")
            continue
        if name not in layers:
            raise UnknownName("layer", f"{where}.{name}", [f"{where}.{item}" for item in layers])
        field = f"{where}.{name}"
        layers[name] = _edited_layer(material, name, layers[name], _mapping(changes, field), field)
    return MaterialState(layers, conserve)


def _edited_layer(
    material: Material, name: str, layer: LayerState, changes: Mapping[str, Any], where: str
) -> LayerState:
    for key, value in changes.items():
        if key == "parameters":
            values = dict(layer.values)
            for parameter, number in _mapping(value, f"{where}.parameters").items():
                values[parameter] = _checked(material, name, parameter, number, where)
            layer = replace(layer, values=values)
        elif key == "curve":
            curve = None if value is None else Curve.from_json(_mapping(value, f"{where}.curve"))
            layer = replace(layer, curve=curve)
        elif key == "enabled":
            layer = replace(layer, enabled=_boolean(value, f"{where}.enabled"))
        elif key == "weight":
            layer = replace(layer, weight=cast(float, WEIGHT.validate(value, f"{where}.")))
        else:
            raise UnknownName("entry", key, ["parameters", "curve", "enabled", "weight"])
    return layer


def _checked(material: Material, layer: str, name: str, value: object, where: str) -> Value:
    """`value` as the parameter `name` of a layer takes it. Raises UnknownName, InvalidValue."""
    known = {item.name: item for item in material.parameters(layer)}
    if name not in known:
        raise UnknownName("parameter", f"{where}.{name}", [f"{where}.{item}" for item in known])
    return known[name].validate(value, f"{where}.")


def _mapping(value: object, where: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InvalidValue(f"{where} must be an object in braces; got {value!r}")
    return value


def _boolean(value: object, where: str) -> bool:
    if not isinstance(value, bool):
        raise InvalidValue(f"{where} must be true or false; got {value!r}")
    return value
