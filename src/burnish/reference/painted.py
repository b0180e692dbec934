"""Painted materials for the path tracer: maps in texture space, looked up at every bounce.

Strokes lie on the surface, so they paint the texels of a texture as they paint the rows of a
view. Nothing of the fast path is used: neither its tables nor its mean at further bounces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float32
from burnish.materials.images.image import Place
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.painting.canvas import Canvas
from burnish.materials.painting.stroke import WEIGHT
from burnish.materials.painting.varied import (
    painted_over,
    painted_values,
    painted_weights,
    pictured,
)
from burnish.reference.bsdf import reflecting_bsdf, wrapped
from burnish.reference.lobes import Lobe, Lobes
from burnish.reference.reflectance import Reflectance, is_smooth
from burnish.scene import SceneObject
from burnish.scene.maps import WeightMap
from burnish.scene.maths import drjit_maths

SIDE = 1024
"""Texels along each side of uv space."""
_GROWN = 4
"""Texels by which islands grow, so that interpolation at their borders finds paint."""


def painted_maps(
    material: Material, state: MaterialState, shape: Any, side: int = SIDE
) -> dict[Place, Float32]:
    """What strokes and maps make of parameters over a shape's uv space: float32 [side, side, 1
    or 3].

    Values as the model takes them; H for weights. shape: an mi.Shape whose uv tells its points
    apart. Where uv meets no surface, the nearest texels' values and then the material's own.
    Raises InvalidValue for a shape without uv.
    """
    position, normal, found = _texels(shape, side)
    if not found.any():
        raise InvalidValue("the shape has no uv coordinates, so paint cannot become a texture")
    canvas = Canvas(position[found], normal[found])
    canvas.show(state.strokes)
    images = {
        place: image for place, image in state.images.items() if material.inherent(place) != image
    }
    uv = _centres(side)[found][:, None]
    maps = {}
    for place in {**canvas.maps, **images}:
        item = canvas.maps.get(place)
        if place in images:
            seen = images[place].at(uv).astype(np.float64)
            base = pictured(material, state, place, seen)
            if item is not None:
                base = painted_over(material, place, item, base)
            values = np.concatenate([base[:, 0], base[:, 0].mean(axis=0, keepdims=True)])
        elif item is not None and place[1] == WEIGHT:
            values = painted_weights(item).astype(np.float64)[:, None]
        else:
            assert item is not None
            values = painted_values(material, state, place, item)
        texture = np.broadcast_to(values[-1], (side * side, values.shape[1])).astype(np.float32)
        texture[found] = values[:-1]
        shape_of = (side, side, -1)
        maps[place] = _grown(texture.reshape(shape_of), found.reshape(side, side))
    return maps


class PaintedReflectance(Reflectance):
    """The true BRDF of a painted material, each layer from its model's own formula.

    uv_maps: those of `painted_maps`. Raises InvalidValue for what has no formula that takes
    a number per point: freehand curves, linked weights, mirrors, and the base of a rough
    plastic, whose table is of one roughness.
    """

    def __init__(
        self,
        material: Material,
        state: MaterialState,
        maps: Mapping[str, WeightMap],
        uv_maps: Mapping[Place, Float32],
    ) -> None:
        _check(material, state, uv_maps)
        self._material, self._state, self._uv_maps = material, state, uv_maps
        self._textures = {
            place: mi.Texture2f(
                mi.TensorXf(np.ascontiguousarray(values)),
                filter_mode=dr.FilterMode.Linear,
                wrap_mode=dr.WrapMode.Clamp,
            )
            for place, values in uv_maps.items()
        }
        super().__init__(material, replace(state, strokes=(), images={}), maps)

    def rough(self, si: Any, wi: Any, wo: Any, active: Any) -> Any:
        result = mi.Color3f(0)
        painted = {
            place: [mi.Float(value) for value in texture.eval(si.uv, active)]
            for place, texture in self._textures.items()
        }
        for layer, layer_state in self.layers:
            values = self._values(layer, layer_state, painted)
            lobe = mi.Color3f(*layer.model.evaluate(drjit_maths, wi, wo, values))
            weight = dr.opaque(mi.Float, float(layer_state.weight))
            if (layer.name, WEIGHT) in painted:
                weight = weight * painted[layer.name, WEIGHT][0]
            result += lobe * weight * self._weight(layer.group, si, active)
        return result

    def _values(
        self, layer: Layer, layer_state: LayerState, painted: Mapping[Place, list[Any]]
    ) -> dict[str, Any]:
        """The model's numbers at each point, painted ones and links to them included."""
        values: dict[str, Any] = {}
        for name, value in {**layer_state.values, **layer.fixed}.items():
            if isinstance(value, str):
                values[name] = value
            elif isinstance(value, tuple):
                values[name] = [dr.opaque(mi.Float, item) for item in value]
            else:
                values[name] = dr.opaque(mi.Float, float(value))
        own = {name: (layer.name, name) for name in values}
        for link in self._material.links:
            if link.layer == layer.name:
                own[link.parameter] = (link.source_layer, link.source_parameter)
        for name, place in own.items():
            if place in painted:
                values[name] = painted[place] if len(painted[place]) == 3 else painted[place][0]
        return values

    def _lobes(self) -> Lobes:
        """Those of the material itself and of the extremes that were painted."""
        lobes = []
        for layer, layer_state in self.layers:
            for share, values in self._extremes(layer, layer_state):
                lobes.append(Lobe(layer, share, _profile(layer, values)))
        return Lobes(lobes)

    def _extremes(
        self, layer: Layer, layer_state: LayerState
    ) -> list[tuple[float, dict[str, Any]]]:
        found: list[dict[str, Any]] = [dict(layer_state.values)]
        for (name, parameter), values in self._uv_maps.items():
            if name == layer.name and parameter != WEIGHT and values.shape[2] == 1:
                ends = (float(values.min()), float(values.max()))
                found += [{**layer_state.values, parameter: end} for end in ends]
        return [(1.0 / len(found), values) for values in found]


def _profile(layer: Layer, values: dict[str, Any]) -> Any:
    return lambda t: layer.model.profile(t, values, layer.fixed)


def _check(material: Material, state: MaterialState, uv_maps: Mapping[Place, Float32]) -> None:
    for place in material.initial.images:
        inherent = material.inherent(place)
        if inherent is not None and state.images.get(place) != inherent:
            raise InvalidValue(
                f"{'.'.join(place)}: another picture in place of the scene's own, on a material "
                "that no plugin of Mitsuba's holds, cannot be path-traced"
            )
    if state.conserve:
        raise InvalidValue("a painted material with linked layers cannot be path-traced: unlink it")
    for layer in material.layers:
        own = state.layers[layer.name]
        if own.curve is not None or own.outgoing_curve is not None or is_smooth(layer, own):
            raise InvalidValue(
                f"layer {layer.name}: a freehand curve or a mirror on a painted material cannot "
                "be path-traced"
            )
        linked = {
            link.parameter
            for link in material.links
            if link.layer == layer.name and (link.source_layer, link.source_parameter) in uv_maps
        }
        uniform = {"roughness", "ior"} if layer.model.name == "plastic-base" else set()
        if linked & uniform:
            raise InvalidValue(
                f"layer {layer.name}: {layer.model.name} cannot be path-traced with a painted "
                f"{', '.join(sorted(linked & uniform))}; compare it unpainted"
            )


def painted_bsdf(item: SceneObject, state: MaterialState, shapes: list[Any]) -> Any:
    """The mi.BSDF of an object of some mi.Shapes in a painted state. Raises InvalidValue."""
    if item.material is None:
        raise InvalidValue(f"object {item.id!r} cannot be edited: {item.reason}; leave it out")
    if len(shapes) != 1:
        raise InvalidValue(
            f"object {item.id!r} of {len(shapes)} shapes is painted and cannot be path-traced: "
            "paint becomes a texture of one shape"
        )
    material = item.material.as_in(state)
    uv_maps = painted_maps(material, state, shapes[0])
    painted = PaintedReflectance(material, state, item.maps, uv_maps)
    return wrapped(item, lambda sides: reflecting_bsdf(painted, sides))


def _centres(side: int) -> Float32:
    """uv of the texels' centres: float32 [side², 2]."""
    at = ((np.arange(side) + 0.5) / side).astype(np.float32)
    return np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)


def _texels(shape: Any, side: int) -> tuple[Float32, Float32, np.ndarray]:
    """Position and normal at the texels' centres: float32 [side², 3] each, and where there are."""
    u, v = _centres(side).T
    uv = mi.Point2f(np.ascontiguousarray(u), np.ascontiguousarray(v))
    si = shape.eval_parameterization(uv, int(mi.RayFlags.All), True)
    count = (side * side,)
    found = np.broadcast_to(np.array(si.is_valid()), count)
    position = np.array(si.p, np.float32).T
    normal = np.broadcast_to(np.array(si.n, np.float32).T, position.shape)
    return position, normal, found


def _grown(values: Float32, known: np.ndarray) -> Float32:
    """Values of texels that have some, carried over to their neighbours a few times."""
    values, known = values.copy(), known.copy()
    for _ in range(_GROWN):
        total = np.zeros(values.shape, np.float64)
        count = np.zeros(known.shape, np.float64)
        for axis in (0, 1):
            for step in (-1, 1):
                there = np.roll(known, step, axis)
                total += np.where(there[..., None], np.roll(values, step, axis), 0)
                count += there
        fresh = ~known & (count > 0)
        values[fresh] = (total[fresh] / count[fresh][:, None]).astype(np.float32)
        known |= fresh
    return values
