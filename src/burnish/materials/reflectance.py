"""What a material in a state reflects, in NumPy: the BRDF itself, and how far two differ."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from burnish.core.types import Float64
from burnish.materials.coefficients import (
    conserved,
    edited_profile,
    edited_second_profile,
    outgoing,
)
from burnish.materials.components import grid
from burnish.materials.layer import Layer, LayerState, Material, MaterialState, freehand
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.models.phong import NormalisedPhong
from burnish.materials.two_curves import TwoCurves


def reflectance(material: Material, state: MaterialState, wi: Vector, wo: Vector) -> Float64:
    """ρ(ωi, ωo): float64 [3, n], linear RGB, no cosine; weight maps and delta lobes left out.

    wi, wo: unit directions above the surface, components float64 [n]. From each model's own
    formula, or through its quotients where a curve was drawn on a layer.
    """
    settled = conserved(material, state)
    total = np.zeros((3, len(wi.z)))
    for layer in material.layers:
        own = settled.layers[layer.name]
        if own.enabled and own.weight > 0:
            total += own.weight * layer_reflectance(layer, own, wi, wo)
    return total


def layer_reflectance(layer: Layer, state: LayerState, wi: Vector, wo: Vector) -> Float64:
    """One layer's ρ, its weight left out: float64 [3, n]."""
    model = layer.model
    if not freehand(state):
        channels = model.evaluate(numpy_maths, wi, wo, {**layer.fixed, **state.values})
        return np.stack([np.broadcast_to(channel, wi.z.shape) for channel in channels])
    if isinstance(model, TwoCurves):
        first, second = (
            np.broadcast_to(np.clip(t, 0.0, 1.0), wi.z.shape)
            for t in model.coordinates(numpy_maths, wi, wo, layer.fixed)
        )
        profile = edited_profile(layer, state, first)
        profile = profile * edited_second_profile(layer, state, second)
    else:
        t = np.clip(model.coordinate(numpy_maths, wi, wo, layer.fixed), 0.0, 1.0)
        profile = edited_profile(layer, state, np.broadcast_to(t, wi.z.shape))
    quotients = model.quotients(numpy_maths, wi, wo, layer.fixed)
    amplitudes = model.amplitudes(state.values, layer.fixed)
    scale = sum(a[:, None] * q for a, q in zip(amplitudes, quotients, strict=True))
    factor = outgoing(layer, state, wo.z, delta=False)
    return np.asarray(scale * profile.T * (1.0 if factor is None else factor.T))


@dataclass(frozen=True)
class Difference:
    """How far one material is from another.

    rms: relative RMS of ρ over all pairs of directions, each weighted by cosθi cosθo and its
    solid angles. albedo: relative change of the share of uniform light that is reflected,
    of the worst channel.
    """

    rms: float
    albedo: float

    def words(self) -> str:
        """The figures as a user reads them."""
        return (
            f"{100 * self.rms:.2g} % RMS over all pairs of directions, "
            f"{100 * self.albedo:.2g} % in the reflected light"
        )


@lru_cache(maxsize=4)
def sample_directions(turns: int = 1) -> tuple[Vector, Vector, Float64]:
    """ωi and ωo, components float64 [n], and weights float64 [n] that add to 1.

    The quadrature of `components.grid`: dense about the highlight. The weights hold
    cosθi cosθo and the solid angles of both directions. turns: how many azimuths of the whole
    pair, one after the other; 1 is enough for an isotropic material.
    """
    nodes = grid()
    used = nodes.weight > 0
    weight = nodes.weight[used]
    pairs: list[tuple[Vector, Vector]] = []
    for turn in range(turns):
        angle = 2 * np.pi * (turn + 0.5) / turns if turns > 1 else 0.0
        cos, sin = np.cos(angle), np.sin(angle)
        wi, wo = (
            Vector(cos * w.x - sin * w.y, sin * w.x + cos * w.y, w.z)
            for w in (Vector(*(a[used] for a in (n.x, n.y, n.z))) for n in (nodes.wi, nodes.wo))
        )
        pairs.append((wi, wo))
    wi, wo = (
        Vector(*(np.concatenate([pair[side][axis] for pair in pairs]) for axis in range(3)))
        for side in range(2)
    )
    return wi, wo, np.tile(weight, turns) / turns


def difference(true: Float64, other: Float64, weight: Float64) -> Difference:
    """Between two BRDFs sampled at `sample_directions`, each float64 [3, n].

    A material that reflects nothing differs by 0 from its like and by 1 from any other.
    """
    square = float(np.sum(true**2 * weight))
    off = float(np.sum((other - true) ** 2 * weight))
    if square == 0:
        return Difference(float(off > 0), float(off > 0))
    energy, change = (true * weight).sum(axis=1), ((other - true) * weight).sum(axis=1)
    scale = np.maximum(energy, 1e-3 * energy.max())
    return Difference(float(np.sqrt(off / square)), float(np.max(np.abs(change) / scale)))


def asymmetry(material: Material, state: MaterialState) -> float:
    """How far ρ changes when light and eye change places; 0 for a reciprocal material.

    ∫∫ |ρ(ωi, ωo) − ρ(ωo, ωi)| / ∫∫ (ρ(ωi, ωo) + ρ(ωo, ωi)) / 2 over pairs of directions with
    cosθi cosθo, channels together. Asked only of layers that may break it: those edited over
    the angle of one direction, and those with a curve drawn over the viewing angle.
    """
    settled = material.linked(state)
    if all(_reciprocal(layer, settled.layers[layer.name]) for layer in material.layers):
        return 0.0
    wi, wo, weight = sample_directions()
    some = slice(None, None, 7)
    wi, wo = (Vector(*(axis[some] for axis in (w.x, w.y, w.z))) for w in (wi, wo))
    there, back = reflectance(material, state, wi, wo), reflectance(material, state, wo, wi)
    both = float(np.sum((there + back) * weight[some])) / 2
    return float(np.sum(np.abs(there - back) * weight[some])) / both if both > 0 else 0.0


def _reciprocal(layer: Layer, state: LayerState) -> bool:
    if not state.enabled or state.weight == 0:
        return True
    one_sided = layer.model.coordinate_name in ("theta_in", "theta_out")
    one_sided = one_sided or isinstance(layer.model, NormalisedPhong)
    return state.outgoing_curve is None and not one_sided
