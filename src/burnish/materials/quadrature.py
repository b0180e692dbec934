"""How much energy each bin of a layer carries: the e_j of 2008, appendix B, by quadrature.

For "half" models the integral over incident directions runs over the half vector instead,
dωi = 4 (ωo·ωh) dωh, with the coordinate t as one variable. Each bin is cut into Gauss
points, so that a lobe much narrower than its bin is still averaged right; and where the
model is isotropic the azimuth stops exactly where the mirrored direction leaves the
hemisphere, so that every integrand is smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from burnish.core.types import Float64
from burnish.materials.layer import Layer
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.model import Model

OUTGOING_NODES = 24
AZIMUTH_NODES = 20
POINTS_PER_LAYER = 1024


@dataclass(frozen=True)
class EnergyTable:
    """Directional energies of a layer's quotients.

    cos_theta_o: float64 [o], quadrature nodes. weight: float64 [o], 2 cosθo dcosθo, adding
      to 1, so that an albedo is Σ_o weight · directional albedo.
    t: float64 [j, s], Gauss points inside the bins.
    density: float64 [o, k, j, s], ∫ q_k cosθi dωi over the cell of a point, so that
      Σ_js density · f(t) is the directional albedo of q_k · f.
    """

    cos_theta_o: Float64
    weight: Float64
    t: Float64
    density: Float64

    @property
    def mean_density(self) -> Float64:
        """The density averaged over outgoing directions: float64 [k, j, s]."""
        return np.tensordot(self.weight, self.density, axes=1)


def energy_table(layer: Layer) -> EnergyTable:
    """The energies of a layer, computed once per model, bins and frozen numbers."""
    return _energy_table(layer.model, layer.bins, layer.spacing, tuple(sorted(layer.fixed.items())))


@lru_cache(maxsize=256)
def _energy_table(
    model: Model, bins: int, spacing: float, fixed_items: tuple[tuple[str, float], ...]
) -> EnergyTable:
    fixed = dict(fixed_items)
    cos_o, weight = gauss_legendre(0.0, 1.0, OUTGOING_NODES)
    weight = 2 * cos_o * weight
    if model.lobe == "cosine":
        t, density = _over_cosine(model, bins, spacing, fixed, cos_o)
    else:
        t, density = _over_half_vectors(model, bins, spacing, fixed, cos_o)
    return EnergyTable(cos_o, weight, t, density)


def gauss_legendre(start: float, stop: float, count: int) -> tuple[Float64, Float64]:
    """Nodes and weights for ∫ from start to stop."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return start + (stop - start) * (nodes + 1) / 2, weights * (stop - start) / 2


def _bin_points(bins: int, spacing: float, points: int) -> tuple[Float64, Float64]:
    """Gauss points and weights inside every bin: each float64 [bins, points]."""
    edges = np.linspace(0.0, 1.0, bins + 1) ** spacing
    nodes, weights = gauss_legendre(0.0, 1.0, points)
    width = np.diff(edges)[:, None]
    return edges[:-1, None] + width * nodes, width * weights


def _over_half_vectors(
    model: Model, bins: int, spacing: float, fixed: dict[str, float], cos_o: Float64
) -> tuple[Float64, Float64]:
    points = max(2, POINTS_PER_LAYER // bins)
    if model.anisotropic:
        points = max(2, points // 2)
    t, t_weight = _bin_points(bins, spacing, points)
    density = np.zeros((len(cos_o), model.rank, t.size))
    for o, mu in enumerate(cos_o):
        sin_o = np.sqrt(1 - mu * mu)
        if not model.anisotropic:
            # The half vector's azimuth relative to ωo, up to where ωi reaches the horizon
            theta = model.half_angle(t.ravel()[:, None], np.zeros((1, 1)), fixed)[0]
            with np.errstate(divide="ignore", invalid="ignore"):
                horizon = -mu * np.cos(2 * theta) / (sin_o * np.sin(2 * theta))
            limit = np.arccos(np.clip(np.nan_to_num(horizon, nan=-1.0), -1, 1))
            nodes, weights = gauss_legendre(0.0, 1.0, AZIMUTH_NODES)
            phi, phi_weight = limit * nodes, 2 * limit * weights
            density[o] = _shell(model, fixed, Vector(sin_o, 0.0, mu), t, phi, phi_weight)
        else:
            # Outgoing azimuths in one quadrant, by the model's two mirror planes
            count = 6
            count_h = 4 * AZIMUTH_NODES
            phi = np.array((np.arange(count_h) + 0.5)[None] * (2 * np.pi / count_h))
            phi_weight = np.full_like(phi, 2 * np.pi / phi.size)
            for phi_o in (np.arange(count) + 0.5) * (np.pi / 2 / count):
                wo = Vector(sin_o * np.cos(phi_o), sin_o * np.sin(phi_o), mu)
                density[o] += _shell(model, fixed, wo, t, phi, phi_weight) / count
    density *= t_weight.ravel()
    return t, density.reshape(len(cos_o), model.rank, *t.shape)


def _shell(
    model: Model,
    fixed: dict[str, float],
    wo: Vector,
    t: Float64,
    phi: Float64,
    phi_weight: Float64,
) -> Float64:
    """∫ q_k cosθi 4 (ωo·ωh) dωh / dt over the azimuth, at every t: float64 [k, t.size]."""
    theta, solid_angle = model.half_angle(t.ravel()[:, None], phi, fixed)
    sin_h, cos_h = np.sin(theta), np.cos(theta)
    h = Vector(sin_h * np.cos(phi), sin_h * np.sin(phi), cos_h)
    o_dot_h = wo.x * h.x + wo.y * h.y + wo.z * h.z
    wi = Vector(*(2 * o_dot_h * b - a for a, b in zip(wo, h, strict=True)))
    lit = (wi.z > 0) & (o_dot_h > 0)
    # Keep unlit points away from singular quotients; their weight is zero
    wi = Vector(wi.x, wi.y, np.where(lit, wi.z, 1.0))
    jacobian = np.where(lit, wi.z * 4 * o_dot_h * solid_angle, 0.0) * phi_weight
    quotients = model.quotients(numpy_maths, wi, wo, fixed)
    return np.stack([np.sum(q * jacobian, axis=1) for q in quotients])


def _over_cosine(
    model: Model, bins: int, spacing: float, fixed: dict[str, float], cos_o: Float64
) -> tuple[Float64, Float64]:
    """For broad models, of one bin: Gauss points over the incident cosine."""
    if bins != 1 or model.anisotropic:
        raise NotImplementedError(f"{model.name}: cosine models have one bin and are isotropic")
    mu_i, mu_weight = gauss_legendre(0.0, 1.0, 64)
    phi, phi_weight = gauss_legendre(0.0, np.pi, 8)
    wi = Vector(
        np.sqrt(1 - mu_i**2)[None, :, None] * np.cos(phi),
        np.sqrt(1 - mu_i**2)[None, :, None] * np.sin(phi),
        mu_i[None, :, None] + 0.0 * phi,
    )
    mu = cos_o[:, None, None]
    wo = Vector(np.sqrt(1 - mu * mu), 0.0 * mu, mu)
    weight = (mu_i * mu_weight)[:, None] * (2 * phi_weight)
    quotients = model.quotients(numpy_maths, wi, wo, fixed)
    shape = (len(cos_o), *weight.shape)
    energy = [np.sum(np.broadcast_to(q, shape) * weight, axis=(1, 2)) for q in quotients]
    return np.full((1, 1), 0.5), np.stack(energy, axis=1)[:, :, None, None]
