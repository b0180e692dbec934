"""A Blinn-Phong gloss that waits on a diffuse object, as in the 2008 paper's Cornell box."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from burnish.materials.layer import MaterialState
try:
    from burnish.scene.adapters import with_gloss
except ModuleNotFoundError:
    pass
from burnish.scene.objects import SceneObject


def glossed(item: SceneObject) -> SceneObject:
    """The object with a weightless specular layer over what it has.

    Until the layer is given weight the object is the scene's own, and its edits are still
    held by Mitsuba's own plugin.
    """
    if item.material is None:
        return item
    own = {layer.name for layer in item.material.layers}
    material, factory = with_gloss(item.material), item.factory

    def edited(state: MaterialState) -> Any | None:
        layers = {name: layer for name, layer in state.layers.items() if name in own}
        added = (layer for name, layer in state.layers.items() if name not in own)
        if factory is None or any(layer.enabled and layer.weight for layer in added):
            return None
        return factory(replace(state, layers=layers))

    return replace(item, material=material, factory=edited)
