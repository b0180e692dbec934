"""Leaves."""

from __future__ import annotations

import numpy as np

from burnish.core.types import Float64
from burnish.scene.examples.geometry import Mesh, joined, lofted
from burnish.scene.examples.shapes import spline


def blade(middle: Float64, out: Float64, width: Float64, fold: float) -> Mesh:
    """A leaf along a curve [n, 3] that leans towards `out`; width [n]: half of its own.

    fold: how far its edges bend up, as a fraction of the width.
    """
    t = np.linspace(-1.0, 1.0, 13)
    along = np.gradient(middle, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross([0.0, 0.0, 1.0], out)
    normal = np.cross(along, across)
    bend = fold * (width[:, None] * t * t)[..., None] * normal[:, None]
    return lofted(middle[:, None] + (width[:, None] * t)[..., None] * across - bend)


def tuft(leaves: int, height: float, seed: int) -> Mesh:
    """Sword-shaped leaves that rise from the origin and bend over."""
    random = np.random.default_rng(seed)
    parts = []
    for k in range(leaves):
        reach, rise = height * random.uniform(0.1, 0.55), height * random.uniform(0.55, 1.0)
        out = np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0.0])
        up = np.array([0.0, 0.0, rise])
        knots = [0.04 * out, 0.05 * out + 0.4 * up, 0.45 * reach * out + 0.85 * up]
        middle = spline([*knots, reach * out + (1.0 - 0.4 * reach) * up], 8)
        s = np.linspace(0.0, 1.0, len(middle))
        parts.append(
            blade(middle, out, 0.055 * height * np.sin(np.pi * (0.1 + 0.9 * s)) ** 0.6, 0.6)
        )
    return joined(*parts)
