"""What a bundle says about itself: a basis, views, objects and where they came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from burnish.core.errors import BundleError, BurnishError
from burnish.core.types import Value
from burnish.materials.layer import Layer, Material
from burnish.materials.lights import Light, LightGroup
from burnish.materials.parameter import Parameter
from burnish.materials.placement import parameters_from_json, parameters_to_json
from burnish.materials.registry import material_from_json, material_to_json
from burnish.transport.basis import Basis, EditableObject

FORMAT = "burnish-bundle"
FORMAT_VERSION = 2
"""2 tells light groups apart; a bundle without them is written as 1, which older ones read."""

Json = dict[str, Any]


@dataclass(frozen=True)
class ViewHeader:
    """One view: its name, size, and the rectangles (x, y, width, height) of its tiles.

    camera: plain numbers that an editor may show, such as a transform or a field of view.
    """

    name: str
    width: int
    height: int
    tiles: tuple[tuple[int, int, int, int], ...]
    camera: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ObjectHeader:
    """An object of the scene; `reason` says why it is not editable ("" when it is)."""

    id: str
    editable: bool
    reason: str = ""


@dataclass(frozen=True)
class BundleHeader:
    """Everything in a bundle but its tiles.

    name: of the scene. objects: all of the scene's, the basis's among them. provenance:
    JSON values such as scene hash, source, seed, samples, version. lights: the scene's.
    """

    basis: Basis
    views: tuple[ViewHeader, ...]
    objects: tuple[ObjectHeader, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    lights: tuple[Light, ...] = ()

    def to_json(self) -> Json:
        """Plain JSON values, format and version first."""
        basis = self.basis
        return {
            "format": FORMAT,
            "format_version": FORMAT_VERSION if basis.lights else 1,
            "name": self.name,
            "series": list(basis.series),
            "indirect_bins": basis.indirect_bins,
            "editable": [
                {"id": item.id, "material": material_to_json(item.material)}
                for item in basis.objects
            ],
            "objects": [
                {"id": item.id, "editable": item.editable, "reason": item.reason}
                for item in self.objects
            ],
            "views": [
                {
                    "name": view.name,
                    "width": view.width,
                    "height": view.height,
                    "tiles": [list(tile) for tile in view.tiles],
                    "camera": dict(view.camera),
                }
                for view in self.views
            ],
            "lights": [{"name": light.name, "kind": light.kind} for light in self.lights],
            "light_parameters": {
                light.name: parameters_to_json(light.parameters)
                for light in self.lights
                if light.parameters
            },
            "light_groups": _groups_json(basis.lights),
            "provenance": dict(self.provenance),
        }

    @staticmethod
    def from_json(data: object, where: str) -> BundleHeader:
        """The inverse of `to_json`. Raises BundleError naming the file."""
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            raise BundleError(f"{where}: not a burnish bundle; make one with `burnish bake`")
        version = data.get("format_version")
        if not isinstance(version, int) or version > FORMAT_VERSION:
            raise BundleError(
                f"{where}: the bundle has format {version!r} and this burnish reads up to "
                f"{FORMAT_VERSION}: install a newer burnish"
            )
        try:
            objects = tuple(
                EditableObject(item["id"], material_from_json(item["material"]))
                for item in data["editable"]
            )
            own = {
                name: parameters_from_json(given)
                for name, given in data.get("light_parameters", {}).items()
            }
            return BundleHeader(
                basis=Basis(
                    objects,
                    tuple(data["series"]),
                    data["indirect_bins"],
                    tuple(_group(group, own) for group in data.get("light_groups", ())),
                ),
                views=tuple(
                    ViewHeader(
                        view["name"],
                        view["width"],
                        view["height"],
                        tuple((x, y, w, h) for x, y, w, h in view["tiles"]),
                        view["camera"],
                    )
                    for view in data["views"]
                ),
                objects=tuple(ObjectHeader(**item) for item in data["objects"]),
                provenance=data["provenance"],
                name=data["name"],
                lights=tuple(
                    Light(light["name"], light["kind"], own.get(light["name"], ()))
                    for light in data.get("lights", ())
                ),
            )
        except (KeyError, TypeError, ValueError, AttributeError, BurnishError) as error:
            raise BundleError(
                f"{where}: the bundle's header is damaged ({error}); bake the scene again"
            ) from None

    def info(self) -> Json:
        """What `burnish info --json` prints."""
        materials = {item.id: item.material for item in self.basis.objects}
        listed = self.objects or tuple(ObjectHeader(name, True) for name in materials)
        objects = []
        for item in listed:
            entry: Json = {"id": item.id, "editable": item.id in materials}
            if item.reason:
                entry["reason"] = item.reason
            if item.id in materials:
                material = materials[item.id]
                entry["layers"] = [_layer_info(material, layer) for layer in material.layers]
            objects.append(entry)
        view = self.views[0] if self.views else None
        return {
            "name": self.name,
            "objects": objects,
            "views": [
                {"name": view.name, "width": view.width, "height": view.height}
                for view in self.views
            ],
            "bounces": self.basis.bounces,
            "series": list(self.basis.series),
            "lights": [_light_info(light) for light in self.lights],
            "light_groups": _groups_json(self.basis.lights),
            "resolution": [view.width, view.height] if view else None,
            "provenance": dict(self.provenance),
        }


def _groups_json(groups: tuple[LightGroup, ...]) -> list[Json]:
    return [{"name": group.name, "members": list(group.members)} for group in groups]


def _group(data: Json, own: Mapping[str, tuple[Parameter, ...]]) -> LightGroup:
    """A light group; a single light keeps its parameters."""
    members = tuple(data["members"])
    parameters = own.get(members[0], ()) if len(members) == 1 else ()
    return LightGroup(data["name"], members, parameters)


def _light_info(light: Light) -> Json:
    parameters = {item.name: _parameter_info(item, item.default) for item in light.parameters}
    return {"id": light.name, "kind": light.kind, "parameters": parameters}


def _layer_info(material: Material, layer: Layer) -> Json:
    values, images = material.initial.layers[layer.name].values, material.initial.images
    parameters = {
        item.name: _parameter_info(item, values[item.name])
        for item in material.parameters(layer.name)
    }
    for name, entry in parameters.items():
        if (layer.name, name) in images:
            height, width, _ = images[layer.name, name].texels.values.shape
            entry["map"] = {"width": width, "height": height}
    return {
        "name": layer.name,
        "model": layer.model.name,
        "bins": layer.bins,
        "parameters": parameters,
    }


def _parameter_info(parameter: Parameter, value: Value) -> Json:
    """A parameter's value, what it may be and its unit."""
    entry: Json = {"value": list(value) if isinstance(value, tuple) else value}
    if parameter.kind == "choice":
        entry["choices"] = list(parameter.choices)
    elif parameter.kind != "file":
        entry |= {"min": parameter.minimum, "max": parameter.maximum}
    return entry | {"unit": parameter.unit}
