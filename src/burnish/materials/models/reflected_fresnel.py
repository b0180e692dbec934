"""Fresnel reflection as a glossy lobe shows it, by the angle from which it is seen.

An expansion of F(θd) over a few anchors can be far off where nothing like the true curve is
among them: a metal edited to k = 0 reflects totally beyond a critical angle, a step. But a lobe
sees θd near θo alone, so what it reflects in all is mended by a factor of θo, which costs no
column: the directional albedo with the true F over the one with the expanded.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import numpy_maths
from burnish.materials.models.optics import SMALLEST_ROUGHNESS, Distribution, masking

ANGLES = 88
"""θo of the table, every degree from 0 to 87°."""
_LARGEST = np.radians(87.0)
_RADII, _TURNS = 32, 8
_SLACK = 2e-3
"""Relative to the largest F: an expansion that is closer needs no mending."""
_MOST = 8.0


def fresnel_factor(
    distribution: Distribution,
    alpha: float,
    true: Float64,
    fitted: Float64,
    cos: Float64,
    cos_theta_o: Float64,
) -> Float64 | None:
    """What a lobe reflects with `true` over what it reflects with `fitted`: float64 [r, 3].

    true, fitted: F at rising cosines `cos`, float64 [n, 3]. None where they agree.
    """
    if np.abs(true - fitted).max() <= _SLACK * max(float(true.max()), 1e-9):
        return None
    cos_d, weight = _lobe(distribution, round(max(alpha, SMALLEST_ROUGHNESS), 6))
    ratio = np.ones((ANGLES, 3))
    for h in range(3):
        wanted, had = (
            (weight * np.interp(cos_d, cos, curve[:, h])).sum(axis=1) for curve in (true, fitted)
        )
        shows = np.abs(had) > 1e-3 * float(np.abs(fitted[:, h]).max())
        ratio[:, h] = np.where(shows, wanted / np.where(shows, had, 1.0), 1.0)
    ratio = np.clip(ratio, 1 / _MOST, _MOST)
    # Linear between the table's angles
    at = np.arccos(np.clip(cos_theta_o, 0, 1)) * ((ANGLES - 1) / _LARGEST)
    low = np.minimum(at.astype(np.int64), ANGLES - 2)
    share = np.minimum(at - low, 1.0)[:, None]
    return np.asarray((1 - share) * ratio[low] + share * ratio[low + 1])


@lru_cache(maxsize=64)
def _lobe(distribution: Distribution, alpha: float) -> tuple[Float64, Float64]:
    """cosθd of half vectors drawn like the lobe, and what light there counts: [θo, samples]."""
    u = (np.arange(_RADII) + 0.5) / _RADII
    slope2 = -np.log1p(-u) if distribution == "beckmann" else u / (1 - u)
    theta = np.arctan(alpha * np.sqrt(slope2))[:, None]
    phi = (np.arange(_TURNS) + 0.5) * (np.pi / _TURNS)
    angle = np.linspace(0.0, _LARGEST, ANGLES)[:, None, None]
    cos_d = np.sin(angle) * np.sin(theta) * np.cos(phi) + np.cos(angle) * np.cos(theta)
    cos_i = 2 * cos_d * np.cos(theta) - np.cos(angle)
    lit = (cos_i > 0) & (cos_d > 0)
    shadow = masking(numpy_maths, distribution, np.maximum(cos_i, 1e-4), alpha)
    weight = np.where(lit, cos_d / np.cos(theta) * shadow, 0.0)
    shape = ANGLES, -1
    return np.clip(cos_d, 0, 1).reshape(shape), np.asarray(weight.reshape(shape))
