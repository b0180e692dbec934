"""Microfacets and Fresnel reflection, written once for NumPy and Dr.Jit."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths

Distribution = Literal["beckmann", "ggx"]

SMALLEST_ROUGHNESS = 1e-3
"""The least roughness α of a lobe with a width; below it a surface is perfectly smooth."""


def microfacet_density(
    xp: Maths, distribution: Distribution, sin2: Any, cos: Any, alpha: Any
) -> Any:
    """D(ωh), the area of microfacets that face ωh, with ∫ D cosθh dωh = 1.

    sin2 is sin²θh, taken from x and y so that it keeps its digits near the normal. Beckmann
    (Cook and Torrance 1982, eq. 8) and GGX (Walter et al. 2007, eq. 33) with the same α.
    """
    alpha2 = alpha * alpha
    cos2 = xp.maximum(cos * cos, 1e-12)
    if distribution == "beckmann":
        return xp.exp(-sin2 / (alpha2 * cos2)) / (xp.pi * alpha2 * cos2 * cos2)
    spread = sin2 / alpha2 + cos2
    return 1 / (xp.pi * alpha2 * spread * spread)


def masking(xp: Maths, distribution: Distribution, cos: Any, alpha: Any) -> Any:
    """Smith's G1(θ; α) for one direction, in [0, 1]; 1 for α = 0 and cosθ > 0.

    GGX in closed form; for Beckmann the rational fit of Walter et al. (2007, §5.2), whose
    relative error is below 0.35 %, as in Mitsuba.
    """
    cos2 = xp.maximum(cos * cos, 1e-12)
    sin2 = xp.maximum(1 - cos2, 0.0)
    if distribution == "ggx":
        return 2 / (1 + xp.sqrt(1 + alpha * alpha * sin2 / cos2))
    a = xp.sqrt(cos2 / xp.maximum(alpha * alpha * sin2, 1e-14))
    a = xp.minimum(a, 1.6)
    rational = (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a)
    return xp.select(a < 1.6, rational, 1.0)


def fresnel_dielectric(xp: Maths, cos: Any, ior: Any) -> Any:
    """Unpolarised reflectance where light meets a medium of relative index `ior` > 0.

    cos: cosine to the (micro)facet's normal, in [0, 1]. Total reflection gives 1.
    """
    cos2_t = 1 - (1 - cos * cos) / (ior * ior)
    cos_t = xp.sqrt(xp.maximum(cos2_t, 0.0))
    across = (cos - ior * cos_t) / xp.maximum(cos + ior * cos_t, 1e-12)
    along = (cos_t - ior * cos) / xp.maximum(cos_t + ior * cos, 1e-12)
    return xp.select(cos2_t > 0, 0.5 * (across * across + along * along), 1.0)


def fresnel_conductor(xp: Maths, cos: Any, eta: Any, k: Any) -> Any:
    """Unpolarised reflectance of a medium of index eta + i k (Cook and Torrance 1982).

    eta = 0 reflects everything. The common form with a² + b² = |n² − sin²θ|.
    """
    cos2 = cos * cos
    sin2 = 1 - cos2
    difference = eta * eta - k * k - sin2
    modulus = xp.sqrt(xp.maximum(difference * difference + 4 * eta * eta * k * k, 0.0))
    a = xp.sqrt(xp.maximum(0.5 * (modulus + difference), 0.0))
    sum_s, term = modulus + cos2, 2 * cos * a
    across = (sum_s - term) / xp.maximum(sum_s + term, 1e-12)
    sum_p, term_p = modulus * cos2 + sin2 * sin2, term * sin2
    along = across * (sum_p - term_p) / xp.maximum(sum_p + term_p, 1e-12)
    return 0.5 * (across + along)


def schlick_weight(cos: Any) -> Any:
    """(1 − cosθd)⁵, the grazing part of Schlick's Fresnel approximation (1994)."""
    x = 1 - cos
    return x * x * x * x * x


def schlick_basis(cos: Any, first: Any) -> list[Any]:
    """Two functions of θd that span every Schlick curve: the one from `first`, and (1 − c)⁵.

    2008, eq. 31–32, with the initial curve in place of 1, so that the first function alone is
    the best stand-in for the material.
    """
    grazing = schlick_weight(cos)
    return [first + (1 - first) * grazing, grazing]


def schlick_weights(colour: Any, first: float) -> Float64:
    """What multiplies `schlick_basis` to give F0 + (1 − F0)(1 − c)⁵: float64 [2, 3]."""
    f0 = np.asarray(colour, np.float64) * np.ones(3)
    ratio = f0 / first
    return np.stack([ratio, (1 - f0) - ratio * (1 - first)])


def first_reflectance(colour: Any) -> float:
    """The `first` of a layer that starts with a colour; kept away from 0."""
    return min(1.0, max(0.02, float(np.mean(colour))))
