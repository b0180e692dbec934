"""The selected BRDF by itself: a lit ball and a polar plot, in NumPy."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from PIL import Image

from burnish.core.types import AnyArray, Float64
from burnish.materials.coefficients import (
    albedo,
    conserved,
    edited_second_profile,
    outgoing,
)
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import Vector
from burnish.materials.reflectance import reflectance

_SIZE = 104
_AMBIENT = 0.18
_BOX_CENTRE = np.array([-0.55, 0.65, 0.75])
_BOX_HALF = 0.32
_BOX_RADIANCE = 7.0
_LIGHTS = 7
"""Along a side of the box: enough that a lobe of α = 0.04 shows a box and no dots."""


def reflected(material: Material, state: MaterialState, wi: Vector, wo: Vector) -> Float64:
    """ρ(ωi, ωo) of all layers that are on, delta lobes left out: float64 [n, 3], linear RGB.

    wi, wo: unit directions in the local frame, components [n]; 0 where one is below the
    surface. Freehand curves are in it, that on the viewing angle too.
    """
    shape = np.broadcast_shapes(np.shape(wi.z), np.shape(wo.z))
    result = np.zeros((*shape, 3))
    lit = np.broadcast_to((np.asarray(wi.z) > 1e-4) & (np.asarray(wo.z) > 1e-4), shape)
    wi = Vector(*(np.broadcast_to(c, shape)[lit] for c in wi))
    wo = Vector(*(np.broadcast_to(c, shape)[lit] for c in wo))
    result[lit] = reflectance(material, state, wi, wo).T
    return result


def profile(layer: Layer, state: LayerState, t: AnyArray) -> Float64:
    """f(t) with the freehand edit on it: float64 [len(t), 3]."""
    base = base_profile(layer, state, t)
    return base if state.curve is None else np.asarray(state.curve.apply(t, base))


def second_profiles(layer: Layer, state: LayerState, t: Float64) -> tuple[Float64, Float64]:
    """The second curve of a layer with two, as the parameters make it and as edited: each
    float64 [len(t), 3]."""
    plain, edited = (
        np.broadcast_to(edited_second_profile(layer, own, t), (len(t), 3)).astype(np.float64)
        for own in (replace(state, second_curve=None), state)
    )
    return plain, edited


def outgoing_factors(layer: Layer, state: LayerState, t: Float64) -> tuple[Float64, Float64]:
    """s(θo) at t = θo / 90°, as the parameters make it and as edited: each float64 [len(t), 3]."""
    cosine = np.cos(t * (np.pi / 2))
    both = []
    for own in (replace(state, outgoing_curve=None), state):
        factor = outgoing(layer, own, cosine, delta=False)
        both.append(np.ones((len(t), 3)) * (1.0 if factor is None else factor))
    return both[0], both[1]


def base_profile(layer: Layer, state: LayerState, t: AnyArray) -> Float64:
    """f(t) as the parameters make it: float64 [len(t), 3]."""
    values = layer.model.profile(np.asarray(t, np.float64), state.values, layer.fixed)
    return np.broadcast_to(values, (len(t), 3)).astype(np.float64)


def polar(
    material: Material, state: MaterialState, theta_i: float, count: int = 181
) -> tuple[Float64, Float64]:
    """θo in degrees [count] and ρ cosθi [count, 3] in the plane of incidence."""
    theta = np.linspace(-90.0, 90.0, count)
    wi = _in_plane(np.full(count, -np.clip(theta_i, 0.0, 89.0)))
    wo = _in_plane(theta)
    return theta, reflected(material, state, wi, wo) * wi.z[:, None]


def _in_plane(degrees: Float64) -> Vector:
    radians = np.radians(degrees)
    return Vector(np.sin(radians), np.zeros_like(radians), np.cos(radians))


def ball(material: Material, state: MaterialState) -> str:
    """A sphere under a soft box and a dim room, as a PNG data URL with a clear background."""
    normals, inside = _sphere()
    frame = _frames(normals)
    eye = np.array([0.0, 0.0, 1.0])
    wo = _local(frame, np.broadcast_to(eye, normals.shape))
    radiance = np.zeros_like(normals)
    lights = _softbox(_LIGHTS)
    solid_angle = (2.0 * _BOX_HALF) ** 2 / float(_BOX_CENTRE @ _BOX_CENTRE) / len(lights)
    for light in lights:
        wi = _local(frame, np.broadcast_to(light, normals.shape))
        cosine = np.maximum(wi.z, 0.0)[:, None]
        radiance += reflected(material, state, wi, wo) * cosine * _BOX_RADIANCE * solid_angle
    settled = conserved(material, state)
    room = _AMBIENT * (0.65 + 0.35 * normals[:, 1:2])
    radiance += room * total_albedo(material, settled)
    mirrored = 2.0 * wo.z[:, None] * normals - eye
    radiance += _delta(material, settled, wo.z) * _studio(mirrored)
    return _data_url(radiance, inside)


def total_albedo(material: Material, settled: MaterialState) -> Float64:
    """The reflected share of the light under a uniform sky: float64 [3]."""
    parts = [albedo(layer, settled.layers[layer.name]) for layer in material.layers]
    return np.asarray(np.sum(parts, axis=0))


def _delta(material: Material, settled: MaterialState, cos_theta_o: Float64) -> Float64:
    result = np.zeros((len(cos_theta_o), 3))
    for layer in material.layers:
        state = settled.layers[layer.name]
        if layer.delta and state.enabled:
            factor = outgoing(layer, state, cos_theta_o, delta=True)
            weight = layer.model.delta(state.values, layer.fixed) * state.weight
            result += weight if factor is None else np.asarray(factor) * weight
    return result


def _sphere() -> tuple[Float64, AnyArray]:
    axis = (np.arange(_SIZE) + 0.5) / _SIZE * 2.1 - 1.05
    x, y = np.meshgrid(axis, -axis)
    inside = x * x + y * y < 0.999
    x, y = x[inside], y[inside]
    return np.stack([x, y, np.sqrt(1.0 - x * x - y * y)], axis=1), inside


def _frames(normals: Float64) -> tuple[Float64, Float64, Float64]:
    tangent = np.stack([normals[:, 2], np.zeros(len(normals)), -normals[:, 0]], axis=1)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
    return tangent, np.cross(normals, tangent), normals


def _local(frame: tuple[Float64, Float64, Float64], directions: Float64) -> Vector:
    return Vector(*((axis * directions).sum(axis=1) for axis in frame))


def _softbox(count: int) -> Float64:
    """Directions spread over the box: [count², 3]."""
    right, up = _box_axes()
    steps = ((np.arange(count) + 0.5) / count * 2.0 - 1.0) * _BOX_HALF
    points = [_BOX_CENTRE + right * a + up * b for a in steps for b in steps]
    result = np.array(points)
    return np.asarray(result / np.linalg.norm(result, axis=1, keepdims=True))


def _box_axes() -> Iterable[Float64]:
    right = np.cross([0.0, 1.0, 0.0], _BOX_CENTRE)
    right /= np.linalg.norm(right)
    up = np.cross(_BOX_CENTRE, right)
    return right, up / np.linalg.norm(up)


def _studio(directions: Float64) -> Float64:
    """What a mirror ball shows of the room and its box: radiance [n, 1]."""
    right, up = _box_axes()
    distance = directions @ _BOX_CENTRE / float(_BOX_CENTRE @ _BOX_CENTRE)
    scale = 1.0 / np.maximum(distance, 1e-6)
    inside = (
        (distance > 0.0)
        & (np.abs(directions @ right * scale) < _BOX_HALF)
        & (np.abs(directions @ up * scale) < _BOX_HALF)
    )
    room = _AMBIENT * (0.65 + 0.35 * directions[:, 1])
    return np.where(inside, _BOX_RADIANCE, room)[:, None]


def _data_url(radiance: Float64, inside: AnyArray) -> str:
    shown = np.clip(radiance, 0.0, 1.0)
    encoded = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    pixels = np.zeros((_SIZE, _SIZE, 4), np.uint8)
    pixels[inside, :3] = np.round(encoded * 255.0)
    pixels[inside, 3] = 255
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode("ascii")
