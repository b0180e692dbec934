"""Small scenes with known answers, and materials to put into them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.types import RGB, Float64
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.model import Model, Values
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.lambert import Lambert
from burnish.scene import Scene, load
from burnish.scene.device import activate

activate()

SKY = {"type": "constant", "radiance": 1.0}
MATTE = {"type": "diffuse"}


def material(*layers: tuple[str, Model, Values], bins: int = 64, delta: bool = False) -> Material:
    """A material of (name, model, values) layers, in the state that the values give."""
    return Material(
        tuple(
            Layer.starting_at(name, model, values, bins=bins, delta=delta and model.can_be_delta)
            for name, model, values in layers
        ),
        MaterialState({name: LayerState(values) for name, _, values in layers}),
    )


def lambert(color: RGB) -> Material:
    return material(("diffuse", Lambert(), {"color": color}))


def blinn(color: RGB, gloss: RGB, exponent: float, bins: int = 64) -> Material:
    return material(
        ("diffuse", Lambert(), {"color": color}),
        ("specular", BlinnPhong(), {"color": gloss, "exponent": exponent}),
        bins=bins,
    )


def world(
    description: Mapping[str, Any],
    materials: Mapping[str, Material],
    resolution: tuple[int, int] = (16, 16),
    two_sided: bool = False,
) -> Scene:
    """A scene whose named objects have the given materials, whatever the file's BSDFs are."""
    scene = load({"type": "scene", **description}, resolution=resolution)
    objects = tuple(
        replace(item, material=materials[item.id], reason="", two_sided=two_sided, factory=None)
        if item.id in materials
        else replace(item, material=None, reason="fixed here")
        for item in scene.objects
    )
    return replace(scene, objects=objects)


def initial(scene: Scene) -> dict[str, MaterialState]:
    return {item.id: item.material.initial for item in scene.editable() if item.material}


def edited(state: MaterialState, layer: str, **changes: Any) -> MaterialState:
    """A state with some of a layer's fields replaced; a parameter's name sets its value."""
    fields = {k: v for k, v in changes.items() if k in LayerState.__dataclass_fields__}
    values = {k: v for k, v in changes.items() if k not in fields}
    old = state.layers[layer]
    new = replace(old, values={**old.values, **values}, **fields)
    return replace(state, layers={**state.layers, layer: new})


def camera(
    origin: tuple[float, float, float],
    target: tuple[float, float, float],
    *,
    up: tuple[float, float, float] = (0, 0, 1),
    fov: float = 30.0,
    rfilter: str = "box",
) -> dict[str, Any]:
    return {
        "type": "perspective",
        "fov": fov,
        "to_world": mi.ScalarTransform4f().look_at(origin=origin, target=target, up=up),
        "film": {"type": "hdrfilm", "rfilter": {"type": rfilter}},
    }


def plane(z: float = 0.0, size: float = 1.0, down: bool = False, **fields: Any) -> dict[str, Any]:
    """A square of half-width `size` at height z, facing up or down."""
    T = mi.ScalarTransform4f()
    turn = T.rotate([1, 0, 0], 180) if down else T
    return {
        "type": "rectangle",
        "to_world": T.translate([0, 0, z]) @ turn @ T.scale(size),
        "bsdf": MATTE,
        **fields,
    }


def direction(theta: Float64 | float, phi: Float64 | float) -> Vector:
    return Vector(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))


def directional_albedo(item: Material, state: MaterialState, theta_o: float) -> Float64:
    """∫ ρ cosθi dωi of the rough layers for one ωo, by brute force over the hemisphere."""
    n = 1500
    theta = (np.arange(n) + 0.5) / n * (math.pi / 2)
    phi = (np.arange(2 * n) + 0.5) / (2 * n) * (2 * math.pi)
    wi = direction(theta[:, None], phi[None, :])
    wo = direction(theta_o, 0.0)
    area = np.sin(theta) * np.cos(theta) * (math.pi / 2 / n) * (2 * math.pi / (2 * n))
    result = np.zeros(3)
    for layer in item.layers:
        values = {**state.layers[layer.name].values, **layer.fixed}
        channels = layer.model.evaluate(numpy_maths, wi, wo, values)
        result += [float((area[:, None] * np.broadcast_to(v, (n, 2 * n))).sum()) for v in channels]
    return result
