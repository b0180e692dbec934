"""Paths to layers, "object.layer"; `names` resolves those to parameters."""

from __future__ import annotations

from collections.abc import Mapping

from burnish.core.errors import UnknownName
from burnish.materials.layer import Material


def resolve_layer(materials: Mapping[str, Material], path: str) -> tuple[str, str]:
    """The object id and layer name of a path.

    Object ids may hold dots: the longest that fits counts. Raises UnknownName with the
    nearest layers.
    """
    known = [
        (object_id, layer.name)
        for object_id, material in sorted(materials.items(), key=lambda item: -len(item[0]))
        for layer in material.layers
    ]
    for object_id, layer_name in known:
        if path == f"{object_id}.{layer_name}":
            return object_id, layer_name
    raise UnknownName("layer", path, [".".join(place) for place in known])
