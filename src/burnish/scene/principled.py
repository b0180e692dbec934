"""Mitsuba's `principled` as layers, and back.

A base colour that varies over the surface becomes the weight map H of the layers that it
multiplies: the base's, and of the metal's reflection t m (1 − Fd) + m Fd the first part, a layer
of its own. Roughness and metallic that vary are pictures, looked up row by row.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from burnish.core.types import Value
from burnish.materials.layer import Layer, LayerState, Link, Material, MaterialState
from burnish.materials.model import Model
from burnish.materials.models.principled import (
    SMALLEST_SPECULAR,
    PrincipledBase,
    PrincipledCoat,
    PrincipledMetal,
    PrincipledSheen,
    PrincipledSpecular,
    specular_of_ior,
)
from burnish.scene.reader import Description, Fixed, Read, Reader
from burnish.scene.textures import Factor, product

Part = tuple[str, Model, tuple[Factor, ...]]
"""A layer's name, its model and the factors of its weight map."""

_SCALED = ("sheen", "clearcoat")
"""Numbers whose texture is a weight map, edited by a factor."""
_PICTURED = ("roughness", "metallic")
"""Numbers whose texture is looked up row by row."""


def read(source: Reader) -> Read:
    """The material of a `principled` plugin. Raises Fixed."""
    for name, why in (
        ("spec_trans", "it transmits light (spec_trans)"),
        ("anisotropic", "its reflection is anisotropic"),
        ("flatness", "it imitates light under the surface (flatness)"),
    ):
        if source.is_textured(name) or source.scalar(name) != 0:
            raise Fixed(why)
    values = _values(source)
    parts = _parts(source)
    layers, states, maps = [], {}, {}
    for name, model, factors in parts:
        own = {item.name: values[item.name] for item in model.parameters}
        group = name if factors else ""
        if factors:
            maps[group] = product(factors)
        layers.append(Layer.starting_at(name, model, own, group=group))
        states[name] = LayerState(own)
    links = _links(source, layers)
    shared = _share_groups(layers, maps)
    images = source.images({("diffuse", "color"): "base_color"})
    for name in _PICTURED:
        picture = source.varying(name)[1]
        if picture is not None:
            images["specular", name] = picture
    return Material(tuple(shared), MaterialState(states, images=images), links), maps


def _values(source: Reader) -> dict[str, Value]:
    colour, textured = source.coloured("base_color")
    values: dict[str, Value] = {"color": colour}
    for name in _PICTURED:
        values[name] = min(max(source.varying(name)[0], 0.0), 1.0)
    for name in ("sheen_tint", "spec_tint", "clearcoat_gloss"):
        values[name] = source.scalar(name)
    for name in _SCALED:
        values[name] = 1.0 if source.is_textured(name) else source.scalar(name)
    if textured and values["spec_tint"] != 0:
        raise Fixed("its spec_tint takes a hue from a textured base_color")
    if textured and values["sheen_tint"] != 0 and values["sheen"] != 0:
        raise Fixed("its sheen_tint takes a hue from a textured base_color")
    if textured:
        values["sheen_tint"] = 0.0
    if source.has("eta"):
        ior = source.scalar("eta")
        if ior < 1:
            raise Fixed(f"its relative index of refraction, {ior:g}, lies below 1")
        values["specular"] = specular_of_ior(ior)
    else:
        values["specular"] = source.scalar("specular")
    if values["specular"] == 0 and values["metallic"] != 0:
        raise Fixed("its index of refraction is 1, where Mitsuba lets no metal reflect")
    return values


def _parts(source: Reader) -> list[Part]:
    """The layers in their order, bottom up."""
    base = [Factor(source.texture("base_color"))] if source.is_textured("base_color") else []
    scaled = {
        name: [Factor(source.texture(name), single=True)] if source.is_textured(name) else []
        for name in _SCALED
    }
    parts: list[tuple[str, Model, list[Factor]]] = [
        ("diffuse", PrincipledBase(), base),
        ("sheen", PrincipledSheen(), scaled["sheen"]),
        ("specular", PrincipledSpecular("ggx", coloured=not base), []),
    ]
    if base:
        parts.append(("metal", PrincipledMetal("ggx"), base))
    parts.append(("coat", PrincipledCoat(), scaled["clearcoat"]))
    return [(name, model, tuple(factors)) for name, model, factors in parts]


def _links(source: Reader, layers: list[Layer]) -> tuple[Link, ...]:
    """Which parameters are knobs of another layer, or of none (linked to themselves)."""
    sources = {
        "color": "diffuse",
        "metallic": "specular",
        "roughness": "specular",
        "specular": "specular",
        "spec_tint": "specular",
    }
    textured = source.is_textured("base_color")
    links = []
    for layer in layers:
        for name in (item.name for item in layer.model.parameters):
            frozen = textured and name in ("sheen_tint", "spec_tint")
            frozen |= textured and name == "color" and layer.name in ("sheen", "specular")
            origin = layer.name if frozen else sources.get(name, layer.name)
            if frozen or origin != layer.name:
                links.append(Link(layer.name, name, origin, name))
    return tuple(links)


def _share_groups(layers: list[Layer], maps: dict[str, Description]) -> list[Layer]:
    """Layers with the same weight map share a group, and so a variable of the polynomial."""
    first: dict[str, str] = {}
    result = []
    for layer in layers:
        if layer.group:
            key = repr(maps[layer.group])
            if key in first:
                del maps[layer.group]
                layer = replace(layer, group=first[key])
            else:
                first[key] = layer.group
        result.append(layer)
    return result


def edited(source: Reader, material: Material, state: MaterialState) -> dict[str, Any]:
    """Mitsuba's dictionary of an edited state. Raises Fixed when none holds it."""
    for layer in material.layers:
        own = state.layers[layer.name]
        if not own.enabled or own.weight != 1:
            raise Fixed("a layer's weight has no parameter in Mitsuba's principled")
    values: dict[str, Any] = {}
    for changed in state.layers.values():
        for name, value in changed.values.items():
            values.setdefault(name, value)
    values["specular"] = max(
        float(state.layers["specular"].values["specular"]),  # type: ignore[arg-type]
        SMALLEST_SPECULAR,
    )
    result: dict[str, Any] = {"type": "principled"}
    names = ("roughness", "metallic", "specular", "spec_tint", "sheen", "sheen_tint")
    for name in (*names, "clearcoat", "clearcoat_gloss"):
        if name in _PICTURED:
            number = float(state.layers["specular"].values[name])  # type: ignore[arg-type]
            picture = state.images.get(("specular", name))
            result[name] = source.edited_number(name, number, picture)
        elif name in _SCALED and source.is_textured(name):
            if values[name] != 1:
                raise Fixed(f"a scaled texture of {name}")
            result[name] = dict(source.texture(name))
        else:
            result[name] = float(values[name])
    colour = state.layers["diffuse"].values["color"]
    picture = state.images.get(("diffuse", "color"))
    return result | source.edited_colour("base_color", colour, picture)  # type: ignore[arg-type]
