"""Names of what can be edited: "object.layer.parameter", and OpenPBR's where it has one.

| alias | is | conversion |
|---|---|---|
| `object.base_color` | diffuse.color; of a metal specular.color | |
| `object.base_weight` | the weight of "diffuse" | |
| `object.specular_weight` | the weight of "specular" | |
| `object.specular_color` | specular.color, of a dielectric | |
| `object.base_metalness` | specular.metallic | |
| `object.specular_roughness` | specular.roughness | α = (OpenPBR's)²; `principled`: none |
| `object.specular_ior` | specular.ior | |

Where a parameter has a map, "object.layer.parameter.scale" and ".offset" are that map's, and the
parameter itself is the map's mean, or a colour's tint.

A layer's own `roughness` is Mitsuba's alpha, and OpenPBR's `specular_roughness` its root; the
layers of Mitsuba's `principled` have the root already.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Value
from burnish.materials.images.image import ImageMap, Place
from burnish.materials.layer import Material, MaterialState
from burnish.materials.parameter import Parameter

WEIGHT = Parameter("weight", 1.0, 0.0, 100.0, 0.0, 1.0, description="scales a whole layer")

ALIASES: dict[str, tuple[tuple[str, str], ...]] = {
    "base_color": (("diffuse", "color"), ("specular", "color")),
    "base_metalness": (("specular", "metallic"),),
    "base_weight": (("diffuse", "weight"),),
    "specular_weight": (("specular", "weight"),),
    "specular_color": (("specular", "color"),),
    "specular_roughness": (("specular", "roughness"),),
    "specular_ior": (("specular", "ior"),),
}
"""OpenPBR's name to the places that it may stand for, the first that exists."""


@dataclass(frozen=True)
class Address:
    """One editable value. parameter is a parameter of the layer's model, or "weight".

    squared: the name is OpenPBR's roughness, whose square is the layer's. of_map: "scale" or
    "offset" of the parameter's map, "" for the parameter itself.
    """

    object: str
    layer: str
    parameter: str
    squared: bool = False
    of_map: str = ""

    def read(self, state: MaterialState) -> Value:
        """The value in a state, as the name means it."""
        layer = state.layers[self.layer]
        if self.of_map:
            image = state.images.get((self.layer, self.parameter))
            neutral = 1.0 if self.of_map == "scale" else 0.0
            return neutral if image is None else float(getattr(image, self.of_map))
        if self.parameter == "weight":
            return layer.weight
        value = layer.values[self.parameter]
        return math.sqrt(float(value)) if self.squared else value  # type: ignore[arg-type]

    def write(self, material: Material, state: MaterialState, value: Any) -> MaterialState:
        """The state with another value. Raises InvalidValue when it is out of range."""
        layer = state.layers[self.layer]
        where = f"{self.object}.{self.layer}."
        parameter = None if self.parameter == "weight" else self._parameter(material)
        if self.of_map and parameter is not None:
            return self._write_map(parameter, state, value)
        if parameter is None:
            changed = replace(layer, weight=float(WEIGHT.validate(value, where)))  # type: ignore[arg-type]
        else:
            if self.squared:
                value = _squared(value, f"{self.object}.specular_roughness")
            checked = parameter.validate(value, where)
            changed = replace(layer, values={**layer.values, self.parameter: checked})
            place = self.layer, self.parameter
            if place in state.images and parameter.kind != "colour":
                scaled = to_mean(state.images[place], float(checked))  # type: ignore[arg-type]
                state = replace(state, images={**state.images, place: scaled})
        return replace(state, layers={**state.layers, self.layer: changed})

    def _parameter(self, material: Material) -> Parameter:
        return material.layer(self.layer).parameter(self.parameter)

    def _write_map(self, parameter: Parameter, state: MaterialState, value: Any) -> MaterialState:
        """The state with another scale or offset of a map. Raises InvalidValue."""
        path = f"{self.object}.{self.layer}.{self.parameter}"
        image = state.images.get((self.layer, self.parameter))
        if image is None:
            raise InvalidValue(f"{path} has no map whose {self.of_map} could be set; give it one")
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = math.nan
        if self.of_map == "scale":
            changed = replace(image, scale=number)
        else:
            changed = replace(image, offset=number)
        return with_image(parameter, state, (self.layer, self.parameter), changed)


def with_image(
    parameter: Parameter, state: MaterialState, place: Place, image: ImageMap
) -> MaterialState:
    """A state in which a parameter has a map. A scalar's own value becomes the map's mean."""
    layer = state.layers[place[0]]
    value: Value = layer.values[place[1]]
    if parameter.kind != "colour":
        value = min(max(image.mean[0], parameter.minimum), parameter.maximum)
    layer = replace(layer, values={**layer.values, place[1]: value})
    images = {**state.images, place: image}
    return replace(state, layers={**state.layers, place[0]: layer}, images=images)


def to_mean(image: ImageMap, mean: float) -> ImageMap:
    """A map scaled, its offset kept, so that its mean is a number."""
    own = float(image.texels.mean[0])
    if own <= 0:
        return replace(image, offset=mean)
    return replace(image, scale=(mean - image.offset) / own)


def resolve(materials: Mapping[str, Material], path: str) -> Address:
    """What a path names; object ids may hold dots, and the longest that fits counts.

    Raises UnknownName with the nearest names.
    """
    for object_id in sorted(materials, key=len, reverse=True):
        if not path.startswith(object_id + "."):
            continue
        found = _inside(object_id, materials[object_id], path[len(object_id) + 1 :])
        if found is not None:
            return found
    raise UnknownName("parameter", path, known(materials))


def known(materials: Mapping[str, Material]) -> list[str]:
    """Every path that `resolve` takes."""
    paths = []
    for object_id, material in materials.items():
        for layer in material.layers:
            names = [item.name for item in material.parameters(layer.name)]
            paths += [f"{object_id}.{layer.name}.{name}" for name in (*names, "weight")]
        paths += [
            f"{object_id}.{alias}" for alias in ALIASES if _inside(object_id, material, alias)
        ]
    return paths


def _inside(object_id: str, material: Material, rest: str) -> Address | None:
    if rest in ALIASES:
        for layer, parameter in ALIASES[rest]:
            if _has(material, layer, parameter) and _fits(material, rest):
                squared = rest == "specular_roughness" and _is_alpha(material, layer)
                return Address(object_id, layer, parameter, squared)
        return None
    layer, _, parameter = rest.partition(".")
    if _has(material, layer, parameter):
        return Address(object_id, layer, parameter)
    parameter, _, of_map = parameter.rpartition(".")
    if of_map in ("scale", "offset") and parameter != "weight" and _has(material, layer, parameter):
        return Address(object_id, layer, parameter, of_map=of_map)
    return None


def _has(material: Material, layer: str, parameter: str) -> bool:
    if layer not in {item.name for item in material.layers}:
        return False
    names = {item.name for item in material.parameters(layer)}
    return parameter in names or parameter == "weight"


def _is_alpha(material: Material, layer: str) -> bool:
    """Whether a layer's roughness is Mitsuba's alpha: then a slider travels over its root."""
    return material.layer(layer).parameter("roughness").scale == "square"


def _fits(material: Material, alias: str) -> bool:
    """A metal's colour is its base colour; only a coat has a specular one."""
    return alias != "specular_color" or any(item.name == "diffuse" for item in material.layers)


def _squared(value: Any, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not 0 <= number <= 1:
        raise InvalidValue(f"{where} must lie in [0, 1]; got {value!r}")
    return number * number
