"""The stock Mitsuba material that is closest to a material of ours, and how close that is.

Where Mitsuba's own plugin holds a state, it is that plugin. A freehand curve, a layer of
another model, linked weights or a weight that a plugin lacks leave two candidates:

- the scene's plugin in the same state with what it cannot hold left out;
- a blend of `diffuse` and `roughconductor`, or a `roughplastic`, fitted: for microfacets of
  either distribution, any roughness and several Fresnel curves, non-negative colours by least
  squares.

The one with the smaller relative RMS is taken (see `materials.reflectance`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from burnish.core.types import RGB, Float64
from burnish.materials.coefficients import conserved
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import numpy_maths
from burnish.materials.models.cook_torrance import CookTorranceConductor, CookTorranceDielectric
from burnish.materials.models.optics import Distribution
from burnish.materials.models.plastic_base import PlasticBase
from burnish.materials.reflectance import (
    Difference,
    difference,
    layer_reflectance,
    reflectance,
    sample_directions,
)
from burnish.scene import SceneObject
from burnish.scene.reader import Description, rgb

Textured = Callable[[Sequence[tuple[str, RGB]]], Any]
"""From weight maps, by group, and the colours that multiply them to a Mitsuba description."""

ROUGHNESSES = tuple(float(alpha) for alpha in np.geomspace(0.005, 1.0, 22))
FRESNEL = ((0.0, 1.0), (1.5, 0.0), (2.0, 0.0), (3.0, 0.0))
"""η and k of the metals that are tried; (0, 1) reflects all light, k = 0 is a dielectric."""
IORS = (1.3, 1.5, 1.8)
"""Indices of refraction of the plastics that are tried."""


@dataclass(frozen=True)
class Stock:
    """A stock material.

    description: for `mi.load_dict`, with what the scene puts round it. difference: None where
    it is exact. remark: what was done, "" where it is exact.
    """

    description: Description
    difference: Difference | None = None
    remark: str = ""


def closest(item: SceneObject, state: MaterialState, textured: Textured) -> Stock:
    """The stock material of an object in a state.

    textured: makes the description of a colour under weight maps.
    """
    assert item.material is not None
    exact = None if state.replacements else item.described(state)
    if exact is not None:
        return Stock(exact)
    material = item.material.as_in(state)
    settled = conserved(material, state)
    true = _sampled(material, settled)
    found = [_fitted(item, material, settled, true, textured)]
    for plain in _plain(item.material, settled) if not state.replacements else ():
        described = item.described(plain)
        if described is not None:
            off = _difference(true, _sampled(item.material, plain))
            remark = f"'{item.plugin}' without what it cannot hold: {off.words()}"
            found.append(Stock(described, off, remark))
    return min(found, key=lambda stock: stock.difference.rms if stock.difference else 0.0)


def _plain(material: Material, state: MaterialState) -> list[MaterialState]:
    """States in which the scene's plugin may hold the most: no curves, then no weights."""
    own = {layer.name for layer in material.layers}
    bare = {
        name: replace(layer, curve=None, outgoing_curve=None)
        for name, layer in state.layers.items()
        if name in own
    }
    scaled = {}
    for name, layer in bare.items():
        strength = layer.weight if layer.enabled else 0.0
        values = {
            key: min(strength * float(value), 1.0)  # type: ignore[arg-type]
            if key in ("sheen", "clearcoat", "specular")
            else value
            for key, value in layer.values.items()
        }
        scaled[name] = LayerState(values)
    rest = {
        name: replace(layer, enabled=False)
        for name, layer in material.initial.layers.items()
        if name not in bare
    }
    return [MaterialState({**layers, **rest}, images=state.images) for layers in (bare, scaled)]


# -- the fit --------------------------------------------------------------------------------


def _sampled(material: Material, state: MaterialState) -> Float64:
    """ρ at the quadrature's directions: float64 [3, n]."""
    wi, wo, _ = sample_directions(_turns(material))
    return reflectance(material, state, wi, wo)


def _difference(true: Float64, other: Float64) -> Difference:
    plain = sample_directions()[2]
    turns = true.shape[1] // len(plain), other.shape[1] // len(plain)
    count = max(turns)
    true, other = (
        np.tile(a, (1, count // turn)) for a, turn in zip((true, other), turns, strict=True)
    )
    return difference(true, other, np.tile(plain, count) / count)


def _turns(material: Material) -> int:
    return 8 if any(layer.model.anisotropic for layer in material.layers) else 1


def _fitted(
    item: SceneObject,
    material: Material,
    state: MaterialState,
    true: Float64,
    textured: Textured,
) -> Stock:
    """A blend of matte, glossy and mirror-like parts, or a plastic."""
    turns = _turns(material)
    wi, wo, weight = sample_directions(turns)
    groups: dict[str, Float64] = {}
    mirrors: list[tuple[Layer, LayerState]] = []
    for layer in material.layers:
        own = state.layers[layer.name]
        if not own.enabled or own.weight <= 0:
            continue
        if is_smooth(layer, own):
            mirrors.append((layer, own))
            continue
        part = own.weight * layer_reflectance(layer, own, wi, wo)
        groups[layer.group] = groups.get(layer.group, 0.0) + part
    reflected = [_mirror(layer, own) for layer, own in mirrors]
    taken = sum(part.largest for part in reflected)
    total = sum(groups.values(), np.zeros_like(true))
    shape = _best_shape(total, weight, turns, taken)
    basis = np.tile(shape.basis(), turns)
    colours = {group: _nonnegative(part, basis, weight) for group, part in groups.items()}
    kd = sum((kd for kd, _ in colours.values()), np.zeros(3))
    ks = sum((ks for _, ks in colours.values()), np.zeros(3))
    scale = shape.room(kd, ks, taken)
    off = _difference(true, scale * (kd[:, None] * basis[0] + ks[:, None] * basis[1]))
    remark = f"{shape.words}: {off.words()}"
    if scale < 1:
        remark += ", darkened because stock parts cannot reflect as much"
    if mirrors:
        remark += ", beside a mirror whose Fresnel curve is that of a metal"
    matte = _Part({group: scale * kd for group, (kd, _) in colours.items()}, _matte)
    glossy = _Part({group: scale * ks for group, (_, ks) in colours.items()}, shape.metal)
    mirrored = [part.scaled(scale) for part in reflected]
    inner: Description
    if shape.ior:
        plastic = shape.plastic(textured(matte.rgb()), textured(glossy.rgb()))
        rest = _Part({"": np.full(3, 1 - taken)}, lambda _: plastic)
        inner = _blended([rest, *mirrored], textured) if mirrored else plastic
    else:
        inner = _blended([matte, glossy, *mirrored], textured)
    return Stock(item.wrapping.around(_sided(item, inner)), off, remark)


def _sided(item: SceneObject, inner: Description) -> Description:
    """With both faces where they were both inside the blend of the scene's own."""
    if item.two_sided and not item.wrapping.two_sided:
        return {"type": "twosided", "bsdf": inner}
    return inner


@dataclass(frozen=True)
class _Shape:
    """A matte and a glossy part that colours multiply.

    A blend of `diffuse` and a rough metal that reflects as much as its Fresnel curve lets it;
    with `ior`, a `roughplastic`.
    """

    distribution: Distribution
    alpha: float
    eta: float = 0.0
    k: float = 1.0
    ior: float = 0.0

    def basis(self) -> Float64:
        """ρ of the two at the quadrature's directions: float64 [2, n]."""
        return _basis(self)

    def room(self, kd: Float64, ks: Float64, taken: float) -> float:
        """The factor, 1 or less, that brings the colours into what the plugins take."""
        largest = max(float(kd.max()), 0.0), max(float(ks.max()), 0.0)
        need = max(largest) + taken if self.ior else sum(largest) + taken
        return 1.0 / max(need, 1.0)

    @property
    def words(self) -> str:
        """What it is."""
        kind = "roughplastic" if self.ior else "blend of diffuse and roughconductor"
        return f"a fitted {kind}"

    def metal(self, reflectance: Any) -> dict[str, Any]:
        """Mitsuba's `roughconductor` with a specular reflectance."""
        return {
            "type": "roughconductor",
            "distribution": self.distribution,
            "alpha": self.alpha,
            "eta": rgb([self.eta] * 3),
            "k": rgb([self.k] * 3),
            "specular_reflectance": reflectance,
        }

    def plastic(self, diffuse: Any, specular: Any) -> dict[str, Any]:
        """Mitsuba's `roughplastic` with two reflectances."""
        return {
            "type": "roughplastic",
            "distribution": self.distribution,
            "alpha": self.alpha,
            "int_ior": self.ior,
            "ext_ior": 1.0,
            "diffuse_reflectance": diffuse,
            "specular_reflectance": specular,
        }


@lru_cache(maxsize=1024)
def _basis(shape: _Shape) -> Float64:
    wi, wo, _ = sample_directions()
    values: dict[str, Any] = {"color": (1.0,) * 3, "roughness": shape.alpha}
    if shape.ior:
        values["ior"] = shape.ior
        base = PlasticBase(shape.distribution)
        coat = CookTorranceDielectric(shape.distribution)
        parts = [model.evaluate(numpy_maths, wi, wo, values)[0] for model in (base, coat)]
    else:
        values |= {"eta": (shape.eta,) * 3, "k": (shape.k,) * 3}
        metal = CookTorranceConductor(shape.distribution)
        parts = [np.full(len(wi.z), 1 / np.pi), metal.evaluate(numpy_maths, wi, wo, values)[0]]
    return np.stack([np.asarray(part, np.float64) for part in parts])


def _best_shape(true: Float64, weight: Float64, turns: int, taken: float) -> _Shape:
    """The shape that leaves the least: a scan, then three finer ones."""
    folded = true.reshape(3, turns, -1).mean(axis=1)
    own = weight.reshape(turns, -1).sum(axis=0)

    def left(shape: _Shape) -> float:
        basis = shape.basis()
        kd, ks = _nonnegative(folded, basis, own)
        scale = shape.room(kd, ks, taken)
        rest = folded - scale * (kd[:, None] * basis[0] + ks[:, None] * basis[1])
        return float(np.sum(rest**2 * own))

    kinds: tuple[Distribution, ...] = ("ggx", "beckmann")
    best = min(
        (
            shape
            for kind in kinds
            for alpha in ROUGHNESSES
            for shape in (
                *(_Shape(kind, alpha, eta, k) for eta, k in FRESNEL),
                *(_Shape(kind, alpha, ior=ior) for ior in IORS),
            )
        ),
        key=left,
    )
    step = ROUGHNESSES[1] / ROUGHNESSES[0]
    for _ in range(3):
        step **= 1 / 3
        finer = [best.alpha * step**i for i in (-2, -1, 0, 1, 2)]
        best = min((replace(best, alpha=min(alpha, 1.0)) for alpha in finer), key=left)
    return best


def _nonnegative(true: Float64, basis: Float64, weight: Float64) -> tuple[Float64, Float64]:
    """Non-negative kd and ks, each [3], that bring kd · basis₀ + ks · basis₁ closest."""
    first, second = basis
    mm, ml, ll = (
        float(np.sum(weight * a * b))
        for a, b in ((first, first), (first, second), (second, second))
    )
    m, l = true @ (weight * first), true @ (weight * second)
    determinant = mm * ll - ml * ml
    kd, ks = (ll * m - ml * l) / determinant, (mm * l - ml * m) / determinant
    kd, ks = np.where(ks < 0, m / mm, kd), np.where(kd < 0, l / ll, ks)
    return np.maximum(kd, 0.0), np.maximum(ks, 0.0)


# -- parts of a blend -----------------------------------------------------------------------


@dataclass(frozen=True)
class _Part:
    """Colours by group of weight maps, and the plugin that reflects them."""

    colours: Mapping[str, Float64]
    describe: Callable[[Any], Description]

    @property
    def largest(self) -> float:
        """The brightest channel where all maps are 1: the least share that the part needs."""
        return float(max(sum(self.colours.values(), np.zeros(3)).max(), 0.0))

    def scaled(self, scale: float) -> _Part:
        """With every colour multiplied."""
        return replace(self, colours={g: scale * c for g, c in self.colours.items()})

    def rgb(self) -> list[tuple[str, RGB]]:
        """The colours as plugins take them."""
        return [(group, _rgb(colour)) for group, colour in self.colours.items()]


def _matte(reflectance: Any) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": reflectance}


def _mirror(layer: Layer, state: LayerState) -> _Part:
    """A perfectly smooth layer as a smooth metal."""
    if isinstance(layer.model, CookTorranceConductor):
        eta, k = (np.asarray(state.values[name], np.float64) for name in ("eta", "k"))
        tint = np.asarray(state.values["color"], np.float64)
    else:
        tint = layer.model.delta(state.values, layer.fixed)
        f0 = layer.model.delta_outgoing(np.ones(1), state.values, layer.fixed) * np.ones((1, 3))
        root = np.sqrt(np.clip(f0[0], 0.0, 0.98))
        eta, k = (1 + root) / (1 - root), np.zeros(3)

    def describe(reflectance: Any) -> dict[str, Any]:
        metal = {"eta": rgb(eta), "k": rgb(k), "specular_reflectance": reflectance}
        return {"type": "conductor", **metal}

    return _Part({layer.group: tint * state.weight}, describe)


def _blended(parts: Sequence[_Part], textured: Textured) -> Description:
    """The sum of parts as nested `blendbsdf`, each with the share that its colour needs."""
    used = [part for part in parts if part.largest > 0] or list(parts[:1])
    whole = sum(part.largest for part in used)
    result: Description = {}
    share = 0.0
    for part in used:
        own = part.largest / whole if len(used) > 1 else 1.0
        described = part.describe(textured(part.scaled(1 / own).rgb()))
        share += own
        if result:
            blend = {"type": "blendbsdf", "weight": own / share}
            result = {**blend, "first": result, "second": described}
        else:
            result = described
    return result


def _rgb(colour: Float64) -> RGB:
    red, green, blue = (min(float(c), 1.0) for c in colour)
    return red, green, blue


def is_smooth(layer: Layer, state: LayerState) -> bool:
    """Whether a layer is a perfect mirror in this state."""
    return layer.delta and bool(layer.model.delta(state.values, layer.fixed).any())
