"""Materials as glTF's metallic-roughness: what Mitsuba's `principled` can say of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from burnish.app.export.closest import is_smooth
from burnish.core.types import RGB, Float64
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import numpy_maths
from burnish.materials.models.principled import (
    PrincipledBase,
    PrincipledMetal,
    PrincipledSpecular,
)
from burnish.materials.reflectance import (
    Difference,
    difference,
    layer_reflectance,
    sample_directions,
)

ROUGHNESSES = tuple(float(r) for r in np.linspace(0.04, 1.0, 25))
SPECULARS = (1e-6, 0.1, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class Surface:
    """A `principled`: numbers, or Mitsuba's textures where they vary.

    group: of the weight map that the base colour tints, or "".
    """

    base_color: Any
    metallic: Any = 0.0
    roughness: Any = 0.5
    specular: float = 0.5
    clearcoat: Any = 0.0
    clearcoat_gloss: float = 1.0
    sheen: float = 0.0
    group: str = ""


def surface_of(description: Mapping[str, Any]) -> tuple[Surface, list[str]]:
    """Of Mitsuba's `principled`, and what glTF lacks."""
    lost = ["spec_tint"] if description.get("spec_tint") else []
    lost += ["sheen_tint"] if description.get("sheen_tint") and description.get("sheen") else []
    remarks = [f"its {name} is left out: glTF has none" for name in lost]
    sheen = description.get("sheen", 0.0)
    if isinstance(sheen, Mapping):
        remarks.append("the texture of its sheen is left out")
        sheen = 0.0
    surface = Surface(
        description["base_color"],
        description["metallic"],
        description["roughness"],
        float(description["specular"]),
        description["clearcoat"],
        float(description["clearcoat_gloss"]),
        float(sheen),
    )
    return surface, remarks


def closest_surface(material: Material, state: MaterialState) -> tuple[Surface, Difference, str]:
    """The metallic-roughness surface that is closest to a material, fitted, and how close.

    state: with links filled in and energy conserved.
    """
    wi, wo, weight = sample_directions()
    true = np.zeros((3, len(weight)))
    smooth: list[tuple[Layer, LayerState]] = []
    matte = ""
    for layer in material.layers:
        own = state.layers[layer.name]
        if not own.enabled or own.weight <= 0:
            continue
        if is_smooth(layer, own):
            smooth.append((layer, own))
            continue
        true += own.weight * layer_reflectance(layer, own, wi, wo)
        if layer.group and (not matte or layer.model.lobe == "cosine"):
            matte = layer.group
    if smooth:
        return _with_mirror(true, weight, smooth, matte)
    metallic, roughness, specular = _best(true)
    scaled, constant = _parts(metallic, roughness, specular)
    colour = _colour(true - constant, weight, scaled)
    surface = Surface(_rgb(colour), metallic, roughness, specular, group=matte)
    return surface, difference(true, _values(surface, colour), weight), ""


def _with_mirror(
    true: Float64, weight: Float64, smooth: list[tuple[Layer, LayerState]], group: str
) -> tuple[Surface, Difference, str]:
    """With a perfectly smooth part, as rough as `principled` can be smooth."""
    f0 = np.zeros(3)
    for layer, own in smooth:
        factor = layer.model.delta_outgoing(np.ones(1), own.values, layer.fixed) * np.ones((1, 3))
        f0 += own.weight * layer.model.delta(own.values, layer.fixed) * factor[0]
    remark = "what it mirrors is not in that figure"
    if f0.max() > 0.08:
        surface = Surface(_rgb(np.clip(f0, 0, 1)), 1.0, 0.0, group=group)
        return surface, difference(true, np.zeros_like(true), weight), remark
    specular = float(np.clip(f0.mean() / 0.08, 1e-6, 1.0))
    base = _parts(0.0, 0.5, 1e-6)[0]
    colour = _colour(true, weight, base)
    surface = Surface(_rgb(colour), 0.0, 0.0, specular, group=group)
    return surface, difference(true, colour[:, None] * base, weight), remark


def _best(true: Float64) -> tuple[float, float, float]:
    """Metallic, roughness and specular that leave the least, each with its best colour.

    Of Σ w (ρ − c a − b)² for tables a and b, all inner products at once.
    """
    tried, weighted_a, weighted_b, aa, ab, bb = _tables()
    ta, tb = true @ weighted_a.T, true @ weighted_b.T
    colour = np.clip((ta - ab) / aa, 0.0, 1.0)
    left = bb - 2 * tb + colour * (colour * aa - 2 * (ta - ab))
    return tried[int(np.argmin(left.sum(axis=0)))]


@lru_cache(maxsize=1)
def _tables() -> tuple[
    list[tuple[float, float, float]], Float64, Float64, Float64, Float64, Float64
]:
    """What is tried, w a and w b [m, n] of its parts, and Σ w a², Σ w a b and Σ w b² [m]."""
    tried = [
        (metallic, roughness, specular)
        for roughness in ROUGHNESSES
        for metallic, speculars in ((0.0, SPECULARS), (1.0, (0.5,)))
        for specular in speculars
    ]
    parts = [_parts(*item) for item in tried]
    a, b = (np.stack([part[k] for part in parts]) for k in (0, 1))
    weight = sample_directions()[2]
    aa, ab, bb = (np.einsum("mn,mn,n->m", x, y, weight) for x, y in ((a, a), (a, b), (b, b)))
    return tried, a * weight, b * weight, aa, ab, bb


def _colour(true: Float64, weight: Float64, scaled: Float64) -> Float64:
    """The colour c, 0 to 1, for which c · scaled is closest: float64 [3]."""
    return np.clip(true @ (weight * scaled) / float(weight @ scaled**2), 0.0, 1.0)


def _values(surface: Surface, colour: Float64) -> Float64:
    scaled, constant = _parts(surface.metallic, surface.roughness, surface.specular)
    return np.asarray(colour[:, None] * scaled + constant)


@lru_cache(maxsize=8)
def _parts(metallic: float, roughness: float, specular: float) -> tuple[Float64, Float64]:
    """ρ = colour · first + second, each float64 [n], of a `principled`."""
    wi, wo, _ = sample_directions()
    values = {
        "color": (1.0,) * 3,
        "metallic": metallic,
        "roughness": roughness,
        "specular": specular,
        "spec_tint": 0.0,
    }
    first = PrincipledMetal("ggx") if metallic else PrincipledBase()
    rest = PrincipledSpecular("ggx", coloured=False)
    scaled, constant = (m.evaluate(numpy_maths, wi, wo, values)[0] for m in (first, rest))
    return np.asarray(scaled), np.asarray(constant)


def tinted(surface: Surface, texture: Any) -> Surface:
    """With a texture in the place of the base colour."""
    return replace(surface, base_color=texture)


def _rgb(colour: Float64) -> RGB:
    red, green, blue = (float(c) for c in colour)
    return red, green, blue
