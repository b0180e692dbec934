"""Paths to what can be set: "object", "object.layer" or "object.layer.parameter"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

from burnish.core.errors import UnknownName
from burnish.materials.layer import Material

Kind = Literal["object", "layer", "parameter"]


class Path(NamedTuple):
    """A resolved path; what it does not name is ""."""

    object: str
    layer: str = ""
    parameter: str = ""


def resolve(materials: Mapping[str, Material], path: str, kind: Kind | None = None) -> Path:
    """Find what a path names; kind: what it must name, None for any.

    Object ids may hold dots: the longest id that fits counts. Raises UnknownName with the
    nearest paths of that kind.
    """
    for object_id in sorted(materials, key=len, reverse=True):
        if path != object_id and not path.startswith(object_id + "."):
            continue
        material = materials[object_id]
        layer, _, parameter = path[len(object_id) + 1 :].partition(".")
        place = Path(object_id, layer, parameter)
        depth = 1 + bool(layer) + bool(parameter)
        if kind is not None and depth != ("object", "layer", "parameter").index(kind) + 1:
            break
        if layer and layer not in material.initial.layers:
            break
        if parameter and parameter not in {p.name for p in material.parameters(layer)}:
            break
        return place
    raise UnknownName(kind or "object, layer or parameter", path, _known(materials, kind))


def _known(materials: Mapping[str, Material], kind: Kind | None) -> list[str]:
    result = []
    for object_id, material in materials.items():
        if kind in ("object", None):
            result.append(object_id)
        for layer in material.layers:
            if kind in ("layer", None):
                result.append(f"{object_id}.{layer.name}")
            if kind in ("parameter", None):
                result += [
                    f"{object_id}.{layer.name}.{parameter.name}"
                    for parameter in material.parameters(layer.name)
                ]
    return result
