"""Mitsuba's `principled` as layers, and back.

A base colour or a metallic weight that varies over the surface becomes the weight map H of
the layers that it multiplies. With base colour t and metallic M that is, for the base
t (1 − M); for the metal's reflection, t M (1 − Fd) + M Fd, two layers; (1 − M) for the
dielectric's. A metallic map leaves no knob "metallic".
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
        if source.is_textured("metallic"):
            own |= {"metallic": float(name in ("metal", "edge"))} if "metallic" in own else {}
        group = name if factors else ""
        if factors:
            maps[group] = product(factors)
        layers.append(Layer.starting_at(name, model, own, group=group))
        states[name] = LayerState(own)
    links = _links(source, layers)
    shared = _share_groups(layers, maps)
    return Material(tuple(shared), MaterialState(states), links), maps


def _values(source: Reader) -> dict[str, Value]:
    colour, textured = source.coloured("base_color")
    values: dict[str, Value] = {"color": colour, "roughness": source.scalar("roughness")}
    for name in ("sheen_tint", "spec_tint", "clearcoat_gloss"):
        values[name] = source.scalar(name)
    for name in ("metallic", *_SCALED):
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
    metal, rest = [], []
    if source.is_textured("metallic"):
        texture = source.texture("metallic")
        metal = [Factor(texture, single=True)]
        rest = [Factor(texture, -1.0, 1.0, single=True)]
    scaled = {
        name: [Factor(source.texture(name), single=True)] if source.is_textured(name) else []
        for name in _SCALED
    }
    parts: list[tuple[str, Model, list[Factor]]] = [
        ("diffuse", PrincipledBase(), base + rest),
        ("sheen", PrincipledSheen(), scaled["sheen"] + rest),
        ("specular", PrincipledSpecular("ggx", coloured=not base), rest),
    ]
    if base:
        parts.append(("metal", PrincipledMetal("ggx"), base + metal))
        if metal:
            parts.append(("edge", PrincipledSpecular("ggx", coloured=False), metal))
    elif metal:
        parts.append(("metal", PrincipledSpecular("ggx"), metal))
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
            frozen = name == "metallic" and source.is_textured("metallic")
            frozen |= textured and name in ("sheen_tint", "spec_tint")
            frozen |= textured and name == "color" and layer.name in ("sheen", "specular", "edge")
            # A metal has no index of refraction of its own, nor a tint
            frozen |= layer.name in ("metal", "edge") and name in ("specular", "spec_tint")
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
    values["metallic"] = state.layers["specular"].values["metallic"]
    values["roughness"] = state.layers["specular"].values["roughness"]
    result: dict[str, Any] = {"type": "principled"}
    names = ("roughness", "metallic", "specular", "spec_tint", "sheen", "sheen_tint")
    for name in (*names, "clearcoat", "clearcoat_gloss"):
        if name != "specular" and source.is_textured(name):
            if name in _SCALED and values[name] != 1:
                raise Fixed(f"a scaled texture of {name}")
            result[name] = dict(source.texture(name))
        else:
            result[name] = float(values[name])
    colour = state.layers["diffuse"].values["color"]
    return result | source.edited_colour("base_color", colour)  # type: ignore[arg-type]
