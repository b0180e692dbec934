"""The anchors of masking and of Fresnel reflection, and the fits on them (see `anchors`)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import numpy_maths
from burnish.materials.models.anchors import Expansion, choose_anchors, stacked
from burnish.materials.models.optics import (
    Distribution,
    fresnel_conductor,
    fresnel_dielectric,
    masking,
    schlick_weight,
)


@lru_cache(maxsize=1)
def _points() -> tuple[Float64, Float64]:
    """Points in (0, 1] for the fits, the last of them 1, and their spacing as weights."""
    nodes, weights = np.polynomial.legendre.leggauss(96)
    return np.append((nodes + 1) / 2, 1.0), np.append(weights / 2, 0.0)


def cosines() -> Float64:
    """The cosines at which an expansion samples its functions: float64 [n], rising to 1."""
    return _points()[0]


def fresnel_weight(curve: Float64) -> Float64:
    """Relative error counts, grazing angles less, and normal incidence is pinned."""
    cos, spacing = _points()
    weight = (cos + 0.02) / (curve + 0.02) ** 2 * (spacing + 1e-9)
    weight[-1] = 100 * weight.sum()
    return weight


def _masking_curves(distribution: Distribution, alphas: tuple[float, ...]) -> Float64:
    return stacked([masking(numpy_maths, distribution, cosines(), alpha) for alpha in alphas])


def _masking_weight() -> Float64:
    """A little less than cosθ dcosθ: grazing angles carry less light, but Fresnel is bright."""
    cos, spacing = _points()
    return np.asarray(cos**0.75 * spacing)


@lru_cache(maxsize=256)
def masking_expansion(distribution: Distribution, anchors: tuple[float, ...]) -> Expansion:
    """G1(θ; α) over G1(θ; α_m) at `cosines`."""
    return Expansion(_masking_curves(distribution, anchors), _masking_weight())


FAMILY = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
"""Roughnesses that the masking expansion is chosen for."""
Range = tuple[float, float]
USUAL: Range = (0.05, 0.6)
"""Where most edits stay; errors outside count a third."""


@lru_cache(maxsize=2)
def _directional_energy(distribution: Distribution) -> Float64:
    """Relative change of the directional albedo per change of G1(θi; α): float64 [m, e, n].

    For the roughnesses m of FAMILY and θo of 0° to 80°, over the points n of `cosines`.
    """
    cos = cosines()
    x, x_weight = np.polynomial.legendre.leggauss(48)
    cdf, density = 1 - ((1 - x) / 2) ** 2, (1 - x) / 2 * x_weight
    slope2 = -np.log1p(-cdf) if distribution == "beckmann" else cdf / (1 - cdf)
    phi = (np.arange(48) + 0.5) * (np.pi / 48)
    angles = np.radians([0, 30, 50, 60, 70, 75, 80])
    result = np.zeros((len(FAMILY), len(angles), len(cos)))
    for m, alpha in enumerate(FAMILY):
        theta = np.arctan(alpha * np.sqrt(slope2))[:, None]
        for e, angle in enumerate(angles):
            cos_d = np.sin(angle) * np.sin(theta) * np.cos(phi) + np.cos(angle) * np.cos(theta)
            cos_i = 2 * cos_d * np.cos(theta) - np.cos(angle)
            energy = np.where((cos_i > 0) & (cos_d > 0), density[:, None] * cos_d, 0.0)
            energy = energy / np.cos(theta)
            energy *= 0.04 + 0.96 * schlick_weight(np.maximum(cos_d, 0))
            # Each sample's energy goes to the two points on either side of its cosine
            upper = np.clip(np.searchsorted(cos, cos_i), 1, len(cos) - 1)
            share = np.clip((cos_i - cos[upper - 1]) / (cos[upper] - cos[upper - 1]), 0, 1)
            np.add.at(result[m, e], upper, energy * share)
            np.add.at(result[m, e], upper - 1, energy * (1 - share))
            result[m, e] /= result[m, e] @ _masking_curves(distribution, (alpha,))[0]
    return result


@lru_cache(maxsize=256)
def masking_anchors(
    distribution: Distribution, first: float, count: int, usual: Range = USUAL
) -> tuple[float, ...]:
    """The α_m for a layer that starts at α = `first`; 0 stands for no masking.

    usual: the roughnesses whose errors count in full.
    """
    pool = (0.0, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
    choices = (first, *(alpha for alpha in pool if abs(alpha - first) > 0.04))
    spread = _directional_energy(distribution)
    alphas = np.array(FAMILY)
    importance = np.where((alphas >= usual[0]) & (alphas <= usual[1]), 1.0, 1 / 3)

    def worst(error: Float64) -> float:
        each = np.abs(np.einsum("men,mn->me", spread, error)).max(axis=1)
        return float((each * importance).max())

    chosen = choose_anchors(
        _masking_curves(distribution, (first,)),
        _masking_curves(distribution, choices[1:]),
        _masking_curves(distribution, FAMILY),
        count,
        _masking_weight(),
        worst,
    )
    return tuple(choices[index] for index in chosen)


MIRROR_INDEX = 1e4
"""An index of refraction that reflects practically everything."""


@lru_cache(maxsize=256)
def dielectric_expansion(anchors: tuple[float, ...]) -> Expansion:
    """F(θd; ior) over F(θd; ior_f) at `cosines`."""
    rows = [fresnel_dielectric(numpy_maths, cosines(), ior) for ior in anchors]
    return Expansion(stacked(rows), fresnel_weight(rows[0]))


@lru_cache(maxsize=256)
def dielectric_anchors(first: float, count: int) -> tuple[float, ...]:
    """The ior_f for a layer that starts at ior = `first`."""
    cos = cosines()

    def curves(iors: tuple[float, ...]) -> Float64:
        return stacked([fresnel_dielectric(numpy_maths, cos, ior) for ior in iors])

    pool = tuple(
        ior
        for ior in (1.05, 1.2, 1.33, 1.5, 1.8, 2.2, 3.0, MIRROR_INDEX)
        if abs(ior - first) > 0.05
    )
    family = curves((1.2, 1.33, 1.5, 1.8, 2.2, 2.5, 3.0))
    own = curves((first,))
    weight = fresnel_weight(own[0])

    def worst(error: Float64) -> float:
        return float(np.abs(error / family)[:, cos > 0.17].max())

    chosen = choose_anchors(own, curves(pool), family, count, weight, worst)
    return tuple((first, *pool)[index] for index in chosen)


Index = tuple[float, float]


@lru_cache(maxsize=256)
def conductor_expansion(anchors: tuple[Index, ...]) -> Expansion:
    """F(θd; eta, k) over F(θd; eta_f, k_f) at `cosines`."""
    rows = [fresnel_conductor(numpy_maths, cosines(), *index) for index in anchors]
    return Expansion(stacked(rows), fresnel_weight(rows[0]))


METALS: tuple[Index, ...] = (
    (0.143, 3.983), (0.375, 2.386), (1.442, 1.603),  # gold
    (0.2, 3.912), (0.924, 2.452), (1.102, 2.142),  # copper
    (1.657, 9.224), (0.88, 6.27), (0.521, 4.837),  # aluminium
    (4.37, 5.206), (2.917, 4.231), (1.655, 3.755),  # chromium
    (2.95, 3.07), (2.65, 2.8), (0.14, 3.1),  # iron, silver
)  # fmt: skip
"""eta, k per channel of metals that edits may ask for (refractiveindex.info, linear RGB)."""


CONDUCTOR_POOL: tuple[Index, ...] = (
    (0.0, 1.0), (1.5, 0.0), (4.4, 3.5), (2.5, 2.5), (1.0, 2.0), (0.15, 2.5), (1.4, 1.6),
)  # fmt: skip
"""Unlike Fresnel curves: an ideal mirror, glass, and strongly to weakly absorbing metals."""


@lru_cache(maxsize=256)
def conductor_anchors(own: tuple[Index, ...], count: int) -> tuple[Index, ...]:
    """The (eta_f, k_f) for a layer whose channels start at `own`."""
    cos = cosines()

    def curves(indices: tuple[Index, ...]) -> Float64:
        return stacked([fresnel_conductor(numpy_maths, cos, *index) for index in indices])

    own = tuple(dict.fromkeys(own))
    pool = tuple(index for index in CONDUCTOR_POOL if index not in own)
    start, family = curves(own), curves(METALS)
    weight = fresnel_weight(start[0])

    def worst(error: Float64) -> float:
        return float(np.abs(error / family)[:, cos > 0.17].max())

    chosen = choose_anchors(start, curves(pool), family, count, weight, worst)
    return tuple((*own, *pool)[index] for index in chosen)
