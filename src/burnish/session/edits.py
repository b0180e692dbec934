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

A layer's entry may have `parameters`, `curve`, `outgoing_curve` and, where its model has two
curves, `second_curve` (see `Curve`), `enabled` and `weight`; and, where it was given another
model, `model`, as a bundle would store the layer, with the values that it `started` with and
those `kept` for other layers.
An object's `strokes` are what was painted on it, in scene units, whatever view and bake they
are shown in: what a brush did, and where, as compressed numbers (see `painting.stroke`).
A layer's `maps` are pictures in place of its parameters' values (see `mapentries`).
`lights` holds what is set on lights or groups of them: {"lamp": {"intensity": 2.0, "position":
[0, 2, 1]}, "environment": {"on": false}}.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Value
from burnish.materials.curve import Curve
from burnish.materials.layer import LayerState, Material, MaterialState, Replacement
from burnish.materials.lights import LightGroup, LightState
from burnish.materials.names import WEIGHT
from burnish.materials.painting.stroke import Stroke
from burnish.materials.registry import layer_from_json, layer_to_json
from burnish.materials.two_curves import check_two_curves
from burnish.session.mapentries import map_entries, scaled_to_values, with_maps
from burnish.transport.basis import State

FORMAT = "burnish-edits"
VERSION = 4
"""Written where there are maps; with lights that have been moved, turned or replaced a file is
version 3, with paint or mixed lights alone version 2, and others stay version 1."""

Json = dict[str, Any]
_ENTRIES = ("model", "parameters", "maps", "curve", "outgoing_curve", "enabled", "weight")


def edits_to_text(
    state: State,
    materials: Mapping[str, Material],
    scene: str,
    lights: Sequence[LightGroup] = (),
) -> str:
    """The file's text for what `state` changed."""
    objects = {}
    for object_id, material in materials.items():
        now = state[object_id]
        entry = _object_entry(now, material.as_in(now))
        if entry:
            objects[object_id] = entry
    painted = any(state[object_id].strokes for object_id in materials)
    mixed = {
        group.name: _light_entry(state[group.key], group) for group in lights if group.key in state
    }
    own = {item.name for group in lights for item in group.parameters}
    version = 2 if painted or mixed else 1
    if any(own & entry.keys() for entry in mixed.values()):
        version = 3
    if any("maps" in item for entry in objects.values() for item in _layers_of(entry)):
        version = VERSION
    data = {"format": FORMAT, "version": version, "scene": scene, "objects": objects}
    if mixed:
        data["lights"] = mixed
    return json.dumps(data, indent=2, ensure_ascii=False) + "\n"


def edits_from_text(
    text: str,
    materials: Mapping[str, Material],
    where: str,
    lights: Sequence[LightGroup] = (),
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
    return state | _lights(data.get("lights", {}), lights, where)


def _light_entry(light: MaterialState, group: LightGroup) -> Json:
    assert isinstance(light, LightState)
    return _plain(
        {
            name: light.get(name)
            for name in group.names
            if light.get(name) != group.initial.get(name)
        }
    )


def _lights(entries: object, lights: Sequence[LightGroup], where: str) -> dict[str, MaterialState]:
    """What is set on lights. Raises InvalidValue, UnknownName."""
    state: dict[str, MaterialState] = {}
    groups = {group.name: group for group in lights}
    for name, entry in _mapping(entries, f"{where}: lights").items():
        if name not in groups:
            raise UnknownName("light", name, groups)
        light, key = groups[name].initial, groups[name].key
        for parameter, value in _mapping(entry, f"{where}: {key}").items():
            if parameter not in groups[name].names:
                raise UnknownName("light parameter", parameter, groups[name].names)
            light = light.set(parameter, value, f"{where}: {key}")
        if light != groups[name].initial:
            state[key] = light
    return state


def _layers_of(entry: Json) -> list[Json]:
    return [item for item in entry.values() if isinstance(item, dict)]


def _object_entry(state: MaterialState, material: Material) -> Json:
    """material: as in the state."""
    entry: Json = {}
    initial = material.initial
    for name, layer in state.layers.items():
        changed = _layer_entry(layer, initial.layers[name])
        maps = map_entries(material, name, state.images)
        if maps:
            changed["maps"] = maps
        if layer.replacement is not None:
            changed = {"model": _model_entry(layer.replacement), **changed}
        if changed:
            entry[name] = changed
    if state.conserve != initial.conserve:
        entry["conserve"] = state.conserve
    if state.strokes:
        entry["strokes"] = [item.to_json() for item in state.strokes]
    return entry


def _layer_entry(layer: LayerState, initial: LayerState) -> Json:
    entry: Json = {}
    parameters = _plain(
        {name: value for name, value in layer.values.items() if value != initial.values[name]}
    )
    if parameters:
        entry["parameters"] = parameters
    if layer.curve != initial.curve:
        entry["curve"] = None if layer.curve is None else layer.curve.to_json()
    if layer.outgoing_curve != initial.outgoing_curve:
        outward = layer.outgoing_curve
        entry["outgoing_curve"] = None if outward is None else outward.to_json()
    if layer.second_curve != initial.second_curve:
        second = layer.second_curve
        entry["second_curve"] = None if second is None else second.to_json()
    if layer.enabled != initial.enabled:
        entry["enabled"] = layer.enabled
    if layer.weight != initial.weight:
        entry["weight"] = layer.weight
    return entry


def _model_entry(item: Replacement) -> Json:
    return {
        **layer_to_json(item.layer),
        "started": _plain(item.values),
        "kept": _plain(item.kept),
    }


def _plain(values: Mapping[str, Value]) -> Json:
    return {k: list(value) if isinstance(value, tuple) else value for k, value in values.items()}


def _edited(material: Material, entry: Mapping[str, Any], where: str) -> MaterialState:
    layers = dict(material.initial.layers)
    images = material.initial.images
    conserve = material.initial.conserve
    strokes: tuple[Stroke, ...] = ()
    for name, changes in entry.items():
        if name == "conserve":
            conserve = _boolean(changes, f"{where}.conserve")
            continue
        if name == "strokes":
            strokes = _strokes(changes, f"{where}.strokes")
            continue
        if name not in layers:
            raise UnknownName("layer", f"{where}.{name}", [f"{where}.{item}" for item in layers])
        field = f"{where}.{name}"
        given = dict(_mapping(changes, field))
        if "model" in given:
            layers[name] = _with_model(material, name, given.pop("model"), f"{field}.model")
        maps = _mapping(given.pop("maps", {}), f"{field}.maps")
        now = material.as_in(MaterialState(layers))
        own = now.initial.images
        images = {place: images[place] for place in images if place[0] != name or place in own}
        layers[name] = _edited_layer(now, name, layers[name], given, field)
        state = MaterialState(layers, images=images)
        values = given.get("parameters", {}).keys() - maps.keys()
        state = scaled_to_values(now, state, name, dict.fromkeys(values))
        state = with_maps(now, state, name, maps, f"{field}.maps")
        layers, images = dict(state.layers), state.images
    return MaterialState(layers, conserve, strokes, images)


def _strokes(value: object, where: str) -> tuple[Stroke, ...]:
    """The strokes of an object. Raises InvalidValue."""
    if not isinstance(value, list):
        raise InvalidValue(f"{where} must be a list in brackets; got {value!r}")
    return tuple(
        Stroke.from_json(_mapping(item, f"{where}[{number}]")) for number, item in enumerate(value)
    )


def _with_model(material: Material, name: str, entry: object, where: str) -> LayerState:
    """A layer's state with another model. Raises UnknownName, InvalidValue."""
    data = _mapping(entry, where)
    layer = layer_from_json({**data, "name": name, "group": material.layer(name).group})
    started, kept = (dict(_mapping(data.get(key, {}), where)) for key in ("started", "kept"))
    values = {item.name: item.validate(started.get(item.name), where) for item in layer.parameters}
    others = {
        link.source_parameter: material.initial.layers[name].values[link.source_parameter]
        for link in material.links
        if link.source_layer == name and link.source_parameter not in values
    }
    own = material.layer(name)
    for key in others:
        if key in kept:
            others[key] = own.parameter(key).validate(kept[key], f"{where}.")
    first = material.initial.layers[name]
    return replace(first, values=values, replacement=Replacement(layer, values, others))


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
        elif key in ("outgoing_curve", "second_curve"):
            field = f"{where}.{key}"
            drawn = None if value is None else Curve.from_json(_mapping(value, field))
            if key == "second_curve" and drawn is not None:
                check_two_curves(material.layer(name).model, where)
            if key == "second_curve":
                layer = replace(layer, second_curve=drawn)
            else:
                layer = replace(layer, outgoing_curve=drawn)
        elif key == "enabled":
            layer = replace(layer, enabled=_boolean(value, f"{where}.enabled"))
        elif key == "weight":
            layer = replace(layer, weight=cast(float, WEIGHT.validate(value, f"{where}.")))
        else:
            raise UnknownName("entry", key, (*_ENTRIES, "second_curve"))
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
