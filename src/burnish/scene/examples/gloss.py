"""A Blinn-Phong gloss that waits on a diffuse object, as in the 2008 paper's Cornell box."""

from __future__ import annotations

from dataclasses import replace

from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.scene.adapters import with_gloss
from burnish.scene.objects import SceneObject


def glossed(item: SceneObject) -> SceneObject:
    """The object with a weightless specular layer over what it has.

    Until the layer is given weight, the object's Mitsuba BSDF still holds all of its edits.
    """
    if item.material is None:
        return item
    return replace(item, material=with_gloss(item.material, BlinnPhong()))
