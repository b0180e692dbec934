"""Materials beyond Mitsuba's: a gloss that waits on an object, and layers put together freely."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from burnish.core.types import Value
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.model import Model
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.scene.adapters import with_gloss
from burnish.scene.objects import SceneObject

Parts = Mapping[str, tuple[Model, Mapping[str, Value]]]
"""Layers from below: name to model and values, frozen ones among them."""


def glossed(item: SceneObject) -> SceneObject:
    """The object with a weightless specular layer over what it has, as in the 2008 paper.

    Until the layer is given weight, the object's Mitsuba BSDF still holds all of its edits.
    """
    if item.material is None:
        return item
    return replace(item, material=with_gloss(item.material, BlinnPhong()))


def layered(item: SceneObject, parts: Parts, bins: Mapping[str, int] | None = None) -> SceneObject:
    """The object made of such layers; its BSDF in the scene only stands in for them.

    bins: for layers that want other numbers than the usual.
    """
    layers, states = [], {}
    for name, (model, given) in parts.items():
        values = {p.name: p.validate(given.get(p.name, p.default)) for p in model.parameters}
        count = (bins or {}).get(name, 64)
        layers.append(Layer.starting_at(name, model, {**given, **values}, bins=count))
        states[name] = LayerState(values)
    return replace(item, material=Material(tuple(layers), MaterialState(states)), factory=None)
