"""The lights of a scene: their names, which emitter is whose, and changing them in its text."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import RGB, Value
from burnish.materials.lights import Light
from burnish.materials.placement import parameters_of
from burnish.scene.objects import Draft
from burnish.scene.placing import (
    Placement,
    can_move,
    emitter_values,
    lamp_values,
    place_emitter,
    place_shape,
)
from burnish.scene.tree import Reference, Tree, UniqueNames

_SENT = {
    "area": "radiance",
    "constant": "radiance",
    "directional": "irradiance",
    "directionalarea": "radiance",
    "point": "intensity",
    "projector": "irradiance",
    "spot": "intensity",
}
"""The property that an emitter's light is proportional to, by plugin."""

_SCALES = {
    "envmap": ("scale",),
    "sunsky": ("sun_scale", "sky_scale"),
    "timed_sunsky": ("sun_scale", "sky_scale"),
}
"""Numbers that scale an emitter whose light is not one property."""

_UNTINTED = ("sunsky", "timed_sunsky")
"""Plugins that nothing tints."""

_BACKGROUNDS = ("constant", "envmap", "sunsky", "timed_sunsky")


@dataclass(frozen=True)
class SceneLight(Light):
    """A light and its nodes in the tree: its emitters', none for a ready-made one, and those of
    the shapes that they are on."""

    nodes: tuple[int, ...] = ()
    shapes: tuple[int, ...] = ()


def draft_lights(tree: Tree, drafts: Sequence[Draft]) -> list[SceneLight]:
    """The lights before the scene is built: those on objects, by the object's name, then the
    others, by their own id or else what they are. The latter get their name as id."""
    unique = UniqueNames()
    found = []
    for draft in drafts:
        nodes = [
            node
            for shape in draft.shapes
            for _, node in tree.children(shape, mi.ObjectType.Emitter)
        ]
        if nodes:
            kind = tree.plugin(nodes[0])
            found.append(SceneLight(unique(draft.id), kind, (), tuple(nodes), draft.shapes))
    for _, node in tree.children(0, mi.ObjectType.Emitter):
        kind = tree.plugin(node)
        name = unique(tree.id(node) or ("environment" if kind in _BACKGROUNDS else kind))
        tree.node(node).props.set_id(name)
        found.append(SceneLight(name, kind, (), (node,)))
    return found


def find_lights(
    found: Sequence[SceneLight],
    drafts: Sequence[Draft],
    shapes: Sequence[Sequence[Any]],
    built: Any,
) -> tuple[tuple[SceneLight, ...], NDArray[np.uint32]]:
    """The lights of a built scene (mi.Scene), ready-made ones too, and whose each emitter is.

    Those that the tree describes get their parameters, as they stand in the built scene.
    shapes: those of each draft. The table goes from an emitter's number in Mitsuba
    (`dr.reinterpret_array(mi.UInt32, si.emitter(scene))`) to the light's: uint32.
    """
    lights = list(found)
    position = {light.name: number for number, light in enumerate(lights)}
    unique = UniqueNames()
    for light in lights:
        unique(light.name)
    numbers: dict[int, int] = {}
    low, high = np.ravel(built.bbox().min), np.ravel(built.bbox().max)
    extent = (float(low.min()), float(high.max())) if (low <= high).all() else (-1.0, 1.0)

    def described(name: str, values: Mapping[str, Value]) -> None:
        light = lights[position[name]]
        if light.nodes:
            parameters = parameters_of(light.kind, values, extent)
            lights[position[name]] = replace(light, parameters=parameters)

    def add(emitter: Any, name: str) -> None:
        if name not in position:
            # A ready-made shape or emitter, which no node describes
            position[name] = len(lights)
            lights.append(SceneLight(unique(name), "ready-made"))
        numbers[_number(emitter)] = position[name]

    for draft, own in zip(drafts, shapes, strict=True):
        for shape in own:
            if shape.emitter() is not None:
                add(shape.emitter(), draft.id)
        if draft.id in position and not draft.instanced and all(map(can_move, own)):
            described(draft.id, lamp_values(own))
    for emitter in built.emitters():
        if _number(emitter) not in numbers:
            name = emitter.id() or "emitter"
            add(emitter, name)
            described(name, emitter_values(emitter, lights[position[name]].kind))
    table = np.zeros(max(numbers, default=0) + 1, np.uint32)
    table[list(numbers)] = list(numbers.values())
    return tuple(lights), table


def by_channel(
    lights: Sequence[SceneLight], factors: Mapping[str, RGB]
) -> tuple[dict[str, RGB], ...]:
    """The factors for one picture of all channels, or for one of each: where a light that
    Mitsuba cannot tint has another colour, a picture of it in grey is right in one channel."""
    tinted = {
        light.name
        for light in lights
        if light.kind in _UNTINTED and len(set(factors.get(light.name, (1.0, 1.0, 1.0)))) > 1
    }
    if not tinted:
        return (dict(factors),)
    return tuple(
        {name: (f[channel],) * 3 if name in tinted else f for name, f in factors.items()}
        for channel in range(3)
    )


def changed(
    tree: Tree,
    lights: Sequence[SceneLight],
    factors: Mapping[str, RGB],
    folder: Path,
    placed: Mapping[str, Placement],
) -> Tree:
    """A copy of a scene's tree in which the named lights stand as in `placed`, and send
    `factors` (linear RGB) as much.

    folder: where images of lights that get another colour are written; they must stay there
    as long as the tree is used. A light with factor 0 stays an emitter, and is black. Raises
    UnknownName, InvalidValue for a light that Mitsuba has no scale for.
    """
    copy = Tree(tree.config, mi.parser.ParserState(tree.state), tree.label)
    for name, placement in placed.items():
        light = _described(lights, name)
        values = {item.name: item.default for item in light.parameters}
        if light.shapes:
            for node in light.shapes:
                place_shape(copy, node, values, placement)
        else:
            place_emitter(copy, light.nodes[0], values, placement)
    for name, factor in factors.items():
        for node in _described(lights, name).nodes:
            _scale_emitter(copy, node, factor, folder)
    return copy


def _described(lights: Sequence[SceneLight], name: str) -> SceneLight:
    """The light of that name. Raises UnknownName; InvalidValue where the tree has no node."""
    for light in lights:
        if light.name == name:
            if light.nodes:
                return light
            raise InvalidValue(
                f"light {name!r} is a ready-made Mitsuba object, which the path tracer cannot "
                "change; describe it in the scene, or leave it as it is"
            )
    raise UnknownName("light", name, [light.name for light in lights])


def _scale_emitter(tree: Tree, node: int, factor: RGB, folder: Path) -> None:
    plugin, props = tree.plugin(node), tree.node(node).props
    grey = factor[0] == factor[1] == factor[2]
    if not any(factor) and plugin not in _SENT:
        # Some divide by what they send
        black = mi.Properties("constant")
        black.set_id(props.id())
        black["radiance"] = mi.ScalarColor3d(0.0)
        tree.node(node).props = black
    elif not any(factor):
        # An image of zeros cannot be sampled
        props[_SENT[plugin]] = mi.ScalarColor3d(0.0)
    elif plugin in _SENT:
        _scale_property(tree, node, _SENT[plugin], factor, folder)
    elif plugin in _SCALES and grey:
        for name in _SCALES[plugin]:
            props[name] = float(props.get(name, 1.0)) * factor[0]
    elif plugin == "envmap" and "filename" in props:
        props["filename"] = _scaled_picture(tree, node, factor, folder)
    elif plugin == "envmap" and isinstance(props.get("bitmap", None), mi.Bitmap):
        props["bitmap"] = _scaled_bitmap(props["bitmap"], factor)
    else:
        raise InvalidValue(
            f"{tree.place(node)}: the path tracer cannot change a light of type {plugin} like "
            f"this; {'reset its tint' if plugin in _SCALES else 'leave it as it is'}"
        )


def _scale_property(tree: Tree, node: int, name: str, factor: RGB, folder: Path) -> None:
    """Multiply one property of a node: a number, a colour, a spectrum or a texture."""
    value = tree.node(node).props.get(name, 1.0)
    if isinstance(value, Reference):
        # Another emitter may share the texture
        texture = _copied(tree, value.index())
        plugin, own = tree.plugin(texture), tree.node(texture).props
        tree.node(node).props[name] = Reference(texture)
        if plugin == "bitmap" and "filename" in own:
            own["filename"] = _scaled_picture(tree, texture, factor, folder)
            own["raw"] = True
            return
        if plugin == "checkerboard":
            for inner in ("color0", "color1"):
                _scale_property(tree, texture, inner, factor, folder)
            return
    tree.node(node).props[name] = mi.ScalarColor3d(
        np.multiply(_as_rgb(tree, node, value), factor).tolist()
    )


def _as_rgb(tree: Tree, node: int, value: Any) -> RGB:
    """What an emitter's property is in linear RGB. Raises InvalidValue where it varies."""
    if isinstance(value, (int, float)):
        return (float(value),) * 3
    if isinstance(value, mi.ScalarColor3d):
        return float(value[0]), float(value[1]), float(value[2])
    if isinstance(value, Reference):
        value = tree.as_dict(value.index())
    elif isinstance(value, mi.Spectrum) and value.is_uniform():
        value = {"type": "spectrum", "value": float(value.values[0])}
    elif isinstance(value, mi.Spectrum):
        pairs = zip(map(float, value.wavelengths), map(float, value.values), strict=True)
        value = {"type": "spectrum", "value": list(pairs)}
    emitter = mi.load_dict({"type": "constant", "radiance": value})
    if mi.has_flag(emitter.flags(), mi.EmitterFlags.SpatiallyVarying):
        raise InvalidValue(
            f"{tree.place(node)}: the path tracer cannot scale this light's texture; give it an "
            "image or a colour, or leave it as it is"
        )
    r, g, b = np.ravel(mi.Color3f(emitter.eval(dr.zeros(mi.SurfaceInteraction3f)))).tolist()
    return r, g, b


def _copied(tree: Tree, node: int) -> int:
    """A copy of a node; what it refers to is shared."""
    copy = tree.add(tree.node(node).type, tree.plugin(node))
    # A new node may move all others: what was known of them does not hold
    props = tree.node(node).props
    for name in props:
        tree.node(copy).props[name] = props[name]
    return copy


def _scaled_picture(tree: Tree, node: int, factor: RGB, folder: Path) -> str:
    """A node's image times a colour, written as linear EXR; returns the new file's name."""
    props = tree.node(node).props
    source = Path(str(props["filename"]))
    image = mi.Bitmap(str(source))
    if bool(props.get("raw", False)):
        image.set_srgb_gamma(False)
    said = f"{source} {factor} {bool(props.get('raw', False))}"
    name = f"{source.stem}-{hashlib.sha256(said.encode()).hexdigest()[:8]}.exr"
    place = folder / name
    _scaled_bitmap(image, factor).write(str(place))
    return str(place)


def _scaled_bitmap(image: Any, factor: RGB) -> Any:
    """A mi.Bitmap times a colour: mi.Bitmap, linear RGB."""
    linear = image.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    values = np.array(linear) * np.array(factor, np.float32)
    return mi.Bitmap(np.ascontiguousarray(values, np.float32))


def _number(emitter: Any) -> int:
    return int(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(emitter))[0])
