"""Gauss's quadrature rules, over an interval and over every bin of a curve."""

from __future__ import annotations

import numpy as np

from burnish.core.types import Float64


def gauss_legendre(start: float, stop: float, count: int) -> tuple[Float64, Float64]:
    """Nodes and weights for ∫ from start to stop."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return start + (stop - start) * (nodes + 1) / 2, weights * (stop - start) / 2


def bin_points(bins: int, spacing: float, points: int) -> tuple[Float64, Float64]:
    """Gauss points and weights inside every bin: each float64 [bins, points]."""
    edges = np.linspace(0.0, 1.0, bins + 1) ** spacing
    nodes, weights = gauss_legendre(0.0, 1.0, points)
    width = np.diff(edges)[:, None]
    return edges[:-1, None] + width * nodes, width * weights
