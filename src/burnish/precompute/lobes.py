"""Directions for a vertex whose BRDF is open, or is a table: a mixture of two lobes.

One is the cosine. The other draws the half angle, θh = (π/2) u², with u piecewise
uniform: uniform over [0, 1] it is uniform over the bins, so that whatever a material
becomes has been sampled; shaped like the energy of a known material it follows that
material. Any mixture of them leaves the estimate unbiased.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float64
from burnish.materials.coefficients import (
    coarse_coefficients,
    coarse_energies,
    coefficients,
    energies,
)
from burnish.materials.layer import Layer, LayerState, MaterialState
from burnish.materials.quadrature import energy_table

CELLS = 64
"""Cells of u over which the half-angle lobe's density is constant."""

EVEN_SHARE = 0.5
"""Of the directions for a coarse encounter, the share that is even over the coarse bins."""


def lobe_of(layers: Sequence[Layer], state: MaterialState) -> tuple[Float64, float, float]:
    """Where a material's energy goes, for sampling it.

    Returns the share of each cell of u in what glossy layers reflect, float64 [CELLS] with
    sum 1, and the shares of glossy layers and of delta lobes in all that is reflected.
    """
    cells, glossy, delta, total = np.zeros(CELLS), 0.0, 0.0, 1e-12
    for layer in layers:
        c = coefficients(layer, state.layers[layer.name]).mean(axis=1)
        rank, bins = layer.model.rank, layer.bins
        _, weight, directional = energies(layer)
        per_bin = np.einsum(
            "o,okj,kj->j", weight, directional, c[: rank * bins].reshape(rank, bins)
        )
        per_bin = np.maximum(per_bin, 0.0)
        total += per_bin.sum()
        if layer.delta:
            delta += max(float(c[-1]), 0.0)
            total += max(float(c[-1]), 0.0)
        if layer.model.lobe != "half":
            continue
        glossy += per_bin.sum()
        if layer.model.coordinate_name == "theta_h":
            edges = np.sqrt(layer.edges)
            cumulative = np.concatenate([[0.0], np.cumsum(per_bin)])
            cells += np.diff(np.interp(np.linspace(0, 1, CELLS + 1), edges, cumulative))
        else:
            cells += per_bin.sum() * _within(layer, c[:rank])
    cells = cells / cells.sum() if cells.sum() > 0 else np.full(CELLS, 1 / CELLS)
    return cells, glossy / total, delta / total


def coarse_lobe_of(layer: Layer, state: LayerState, count: int) -> Float64:
    """Where the energy of a layer may lie at an encounter that uses coarse bins.

    The coefficients are constant over a coarse bin, and so are the half vectors drawn in it,
    per steradian. The bins share the directions half evenly, since a later material may have
    its energy in any of them, and half as the energy lies in the given state. A delta lobe
    lies in the first bin, under a hundredth of a steradian with 8 of them: with a density
    that does not know that bin's size, its mirror images of lamps come as rare bright paths.
    Returns the share of each cell of u: float64 [CELLS], sum 1.
    """
    if layer.model.coordinate_name != "theta_h":
        return EVEN_SHARE / CELLS + (1 - EVEN_SHARE) * _within(layer, np.eye(layer.model.rank)[0])
    energy = coarse_coefficients(layer, state, count) * coarse_energies(layer, count)[:, None]
    share = np.maximum(energy.mean(axis=1), 0.0)
    share = share / share.sum() if share.sum() > 0 else np.full(count, 1 / count)
    share = EVEN_SHARE / count + (1 - EVEN_SHARE) * share
    # The first fine bin of each coarse bin; θh = (π/2) t = (π/2) u²
    first = -(-np.arange(count + 1) * layer.bins // count)
    edges = np.sqrt(layer.edges[first])
    u = np.unique(np.concatenate([edges, np.linspace(0, 1, CELLS + 1)]))
    bin_ = np.clip(np.searchsorted(edges, u, side="right") - 1, 0, count - 1)
    below, above = (1 - np.cos(np.pi / 2 * edges[bin_ + k] ** 2) for k in (0, 1))
    within = (1 - np.cos(np.pi / 2 * u**2) - below) / (above - below)
    cumulative = (np.cumsum(share) - share)[bin_] + share[bin_] * within
    return np.diff(np.interp(np.linspace(0, 1, CELLS + 1), u, cumulative))


def _within(layer: Layer, amplitudes: Float64) -> Float64:
    """Where a glossy layer without a curve over θh sends light: float64 [CELLS], sum 1.

    amplitudes: float64 [k]. Layers of principal components have one bin, with θh in it; of any
    other the share of each cell is the same.
    """
    even = np.full(CELLS, 1 / CELLS)
    if layer.model.coordinate_name != "none" or layer.model.lobe != "half":
        return even
    table = energy_table(layer)
    t, mass = table.t[0], np.maximum(amplitudes @ table.mean_density[:, 0], 0.0)
    if mass.sum() == 0:
        return even
    edges = np.concatenate([[0.0], (t[1:] + t[:-1]) / 2, [1.0]])
    cumulative = np.concatenate([[0.0], np.cumsum(mass)]) / mass.sum()
    return np.diff(np.interp(np.linspace(0, 1, CELLS + 1) ** 2, edges, cumulative))


class HalfAngleLobes:
    """One half-angle density per object, as device tables that change without a recompile."""

    def __init__(self, objects: int, shaped: bool) -> None:
        """shaped: whether any density will ever differ from the uniform one."""
        self.shaped = shaped
        self.density = np.ones((objects, CELLS))
        self.upload()

    def set(self, obj: int, cells: Float64, uniform: float) -> None:
        """Mix an object's energy shares with a uniform lobe; takes effect at `upload`."""
        self.density[obj] = uniform + (1 - uniform) * cells * CELLS

    def upload(self) -> None:
        """Bring the tables to the device."""
        cumulative = np.zeros((len(self.density), CELLS + 1))
        cumulative[:, 1:] = np.cumsum(self.density, axis=1) / CELLS
        self._cdf = mi.Float(cumulative.astype(np.float32).ravel())
        self._pdf = mi.Float(self.density.astype(np.float32).ravel())
        dr.make_opaque(self._cdf, self._pdf)

    def sample(self, obj: Any, wo: Any, u: Any) -> Any:
        """A direction mirrored at a half vector of the object's lobe."""
        theta = (dr.pi / 2) * dr.square(self._invert(obj, u.x) if self.shaped else u.x)
        sin_theta, cos_theta = dr.sincos(theta)
        sin_phi, cos_phi = dr.sincos(2 * dr.pi * u.y)
        wh = mi.Vector3f(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
        return 2 * dr.dot(wo, wh) * wh - wo

    def _invert(self, obj: Any, x: Any) -> Any:
        """The u at which an object's distribution function is x."""
        first = obj * (CELLS + 1)
        cell = dr.binary_search(
            0, CELLS, lambda i: dr.gather(mi.Float, self._cdf, first + i + 1) <= x
        )
        cell = dr.minimum(cell, CELLS - 1)
        low = dr.gather(mi.Float, self._cdf, first + cell)
        high = dr.gather(mi.Float, self._cdf, first + cell + 1)
        within = dr.clip((x - low) / dr.maximum(high - low, 1e-12), 0, 1)
        return (mi.Float(cell) + within) * (1 / CELLS)

    def pdf(self, obj: Any, wi: Any, wo: Any) -> Any:
        """Density per steradian of `sample`.

        p(θh) = p(u) du/dθ = p(u) / (π u); over the ring 2π sin θh; and
        dωh/dωi = 1 / (4 ωo·ωh).
        """
        wh = dr.normalize(wi + wo)
        # sin θh from x and y keeps its digits where the cosine has none
        sin_theta = dr.sqrt(dr.square(wh.x) + dr.square(wh.y))
        u = dr.sqrt(dr.atan2(sin_theta, wh.z) * (2 / dr.pi))
        density = 1 / (2 * dr.square(dr.pi) * dr.maximum(u * sin_theta, 1e-12))
        if self.shaped:
            cell = dr.minimum(mi.UInt32(u * CELLS), CELLS - 1)
            density *= dr.gather(mi.Float, self._pdf, obj * CELLS + cell)
        return density / (4 * dr.maximum(dr.dot(wo, wh), 1e-6))
