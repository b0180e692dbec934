"""Maps in an edits file: where the picture is, and how it is edited.

    "maps": {
      "roughness": {"file": "/looks/scratches.png", "channel": "green", "scale": 0.5},
      "color": {"transform": [2, 0, 0, 0, 2, 0]},
      "metallic": null
    }

Without a `file` it is the scene's own picture; null takes it off.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from burnish.core.errors import InvalidValue, UnknownName
from burnish.materials.images.files import read_texels
from burnish.materials.images.image import UPRIGHT, ImageMap, Images, transform_of
from burnish.materials.layer import Material, MaterialState
from burnish.materials.names import to_mean, with_image

Json = dict[str, Any]
_FIELDS = ("file", "channel", "scale", "offset", "transform", "wrap")


def map_entries(material: Material, layer: str, now: Images) -> Json:
    """The "maps" of a layer: those that are not as the scene has them.

    material: as in the state. A state may hold colours for which its model has no parameter.
    """
    entries: Json = {}
    initial, known = material.initial.images, {item.name for item in material.parameters(layer)}
    for place in {**initial, **now}:
        if place[0] != layer or place[1] not in known:
            continue
        if now.get(place) != initial.get(place):
            image = now.get(place)
            entries[place[1]] = None if image is None else _entry(image, initial.get(place))
    return entries


def with_maps(
    material: Material, state: MaterialState, layer: str, entries: Mapping[str, Any], where: str
) -> MaterialState:
    """A state with the maps that a file's entry describes. Raises UnknownName, InvalidValue."""
    for name, entry in entries.items():
        known = {item.name: item for item in material.parameters(layer)}
        if name not in known:
            raise UnknownName("parameter", f"{where}.{name}", [f"{where}.{item}" for item in known])
        place = layer, name
        if entry is None:
            state = replace(state, images={k: v for k, v in state.images.items() if k != place})
            continue
        own = material.initial.images.get(place)
        image = _image(entry, own, known[name].kind == "colour", f"{where}.{name}")
        state = with_image(known[name], state, place, image)
    return state


def scaled_to_values(
    material: Material, state: MaterialState, layer: str, changed: Mapping[str, Any]
) -> MaterialState:
    """A state whose maps follow the values that an entry without maps gives them."""
    images = dict(state.images)
    for name in changed:
        place = layer, name
        if place in images and material.layer(layer).parameter(name).kind != "colour":
            mean = float(state.layers[layer].values[name])  # type: ignore[arg-type]
            images[place] = to_mean(images[place], mean)
    return replace(state, images=images)


def _entry(image: ImageMap, own: ImageMap | None) -> Json:
    """What tells a map from the picture upright and as it is."""
    entry: Json = {}
    plain = ImageMap(image.texels)
    if own is not None and own.texels == image.texels and own.source == image.source:
        plain = own
    else:
        entry["file"] = image.source
        if image.channel:
            entry["channel"] = image.channel
    for name in ("scale", "offset", "wrap"):
        if getattr(image, name) != getattr(plain, name):
            entry[name] = getattr(image, name)
    if image.transform != plain.transform:
        entry["transform"] = list(image.transform)
    return entry


def _image(entry: object, own: ImageMap | None, colour: bool, where: str) -> ImageMap:
    if not isinstance(entry, dict):
        raise InvalidValue(f"{where} must be an object in braces or null; got {entry!r}")
    for name in entry:
        if name not in _FIELDS:
            raise UnknownName("entry", f"{where}.{name}", [f"{where}.{item}" for item in _FIELDS])
    if "file" in entry:
        channel = entry.get("channel", "")
        texels = read_texels(str(entry["file"]), colour, channel)
        image = ImageMap(texels, str(entry["file"]), channel, transform=UPRIGHT)
    elif own is not None:
        image = own
    else:
        raise InvalidValue(f"{where} names no file, and the scene has no map there")
    try:
        numbers = {name: float(entry[name]) for name in ("scale", "offset") if name in entry}
    except (TypeError, ValueError):
        raise InvalidValue(f"{where}: scale and offset must be numbers") from None
    image = replace(image, **numbers)  # type: ignore[arg-type]
    if "transform" in entry:
        image = replace(image, transform=transform_of(entry["transform"]))
    return replace(image, wrap=entry["wrap"]) if "wrap" in entry else image
