"""Materials of the caller's choice on a scene's objects, in place of what the file says."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from burnish.core.errors import InvalidValue
from burnish.materials.layer import Material
from burnish.materials.registry import material_to_json
from burnish.scene.objects import is_light
from burnish.scene.wrapping import Wrapping

if TYPE_CHECKING:
    from burnish.scene.loading import Scene


def assigned(scene: Scene, materials: Mapping[str, Material]) -> Scene:
    """The scene with the named objects made of the given materials.

    They become editable, whatever BSDF they had; no Mitsuba plugin holds them, so the path
    tracer evaluates burnish's own. Textures of the old BSDF are gone. The scene's hash changes
    with the materials. Raises UnknownName, and InvalidValue for lights, instances and
    ready-made shapes, and where a layer's group asks for a weight map.
    """
    objects = list(scene.objects)
    digest = hashlib.sha256(scene.hash.encode())
    for object_id, material in sorted(materials.items()):
        index = objects.index(scene.object(object_id))
        draft = scene.drafts[index]
        fixed = draft.ready is not None or draft.instanced
        if fixed or is_light(scene.tree, draft.shapes[0]):
            raise InvalidValue(
                f"object {object_id!r} cannot have a material of its own: it is a light, an "
                "instance or a ready-made Mitsuba shape; leave it out"
            )
        mapped = [layer.name for layer in material.layers if layer.group]
        if mapped:
            raise InvalidValue(
                f"object {object_id!r}: layers {', '.join(mapped)} name a weight map (group), "
                "which an assigned material cannot have; leave group empty"
            )
        objects[index] = replace(
            objects[index],
            material=material,
            reason="",
            maps={},
            factory=None,
            wrapping=Wrapping(({"type": "twosided"},) if objects[index].two_sided else ()),
            opacity=None,
            bend=None,
        )
        digest.update(json.dumps([object_id, material_to_json(material)]).encode())
    return replace(scene, objects=tuple(objects), hash=digest.hexdigest())
