"""Other reflectance models in a scene's layers, chosen before anything is traced."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from burnish.core.errors import InvalidValue
from burnish.materials.layer import Link, Material
from burnish.materials.paths import resolve_layer
from burnish.materials.replacement import replaced

if TYPE_CHECKING:
    from burnish.scene.loading import Scene

_BINS = 128


def remodelled(scene: Scene, models: Mapping[str, str]) -> Scene:
    """The scene with the named layers ("teapot.specular") of other models, by their names.

    What can carries over; weight maps, masks and bent normals stay. No Mitsuba plugin holds the
    objects any more, so the path tracer evaluates burnish's own. The scene's hash changes with
    the models. Raises UnknownName, and InvalidValue for pictures that do not carry over: of
    numbers, and of colours that the model lacks.
    """
    materials = {item.id: item.material for item in scene.objects if item.material is not None}
    objects, digest = list(scene.objects), hashlib.sha256(scene.hash.encode())
    for path, model in sorted(models.items()):
        object_id, layer = resolve_layer(materials, path)
        index = objects.index(next(item for item in objects if item.id == object_id))
        material = materials[object_id] = with_model(materials[object_id], layer, model)
        objects[index] = replace(objects[index], material=material, factory=None)
        digest.update(json.dumps([path, model]).encode())
    return replace(scene, objects=tuple(objects), hash=digest.hexdigest())


def with_model(material: Material, layer: str, model: str) -> Material:
    """The material with another model in a layer, as if it had had it from the beginning.

    What other layers took from the layer, and the model lacks, keeps its value. Raises
    UnknownName, InvalidValue.
    """
    state = replaced(material, material.initial, layer, model, _BINS)
    new = material.as_in(state)
    now = new.layer(layer)
    known = {item.name for item in now.parameters}
    for name, parameter in material.initial.images:
        carries_over = parameter in known and (name, parameter) in new.initial.images
        if name == layer and not carries_over:
            raise InvalidValue(
                f"layer {layer} has a picture for {parameter}, which does not carry over to "
                f"{model}; choose another model, or give the layer a plain value"
            )
    layers = {name: replace(item, replacement=None) for name, item in new.initial.layers.items()}
    links = []
    for link in new.links:
        if link.source_layer != layer or link.source_parameter in known:
            links.append(link)
            continue
        # A link to itself: the value that it has
        kept = material.linked(material.initial).layers[link.layer].values[link.parameter]
        own = layers[link.layer]
        layers[link.layer] = replace(own, values={**own.values, link.parameter: kept})
        links.append(Link(link.layer, link.parameter, link.layer, link.parameter))
    return Material(new.layers, replace(new.initial, layers=layers), tuple(links))
