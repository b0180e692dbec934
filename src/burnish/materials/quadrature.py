"""How much energy each bin of a layer carries: the e_j of 2008, appendix B, by quadrature.

For "half" models the integral over incident directions runs over the half vector instead,
dωi = 4 (ωo·ωh) dωh, with the coordinate t as one variable. Each bin is cut into Gauss
points, so that a lobe much narrower than its bin is still averaged right; and where the
model is isotropic the azimuth stops exactly where the mirrored direction leaves the
hemisphere, so that every integrand is smooth. Coordinates that are angles about another axis
are inverted likewise (see `coordinates`); any other coordinate is sorted into its bins from a
dense rule over directions. Glossy models without a coordinate, those of principal components,
have one bin, and θh in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from burnish.core.types import Float64
from burnish.materials.boxes import Side, box_energies
from burnish.materials.coordinates import around_axis
from burnish.materials.layer import Layer
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.model import Model
from burnish.materials.nodes import bin_points, gauss_legendre
from burnish.materials.two_curves import TwoCurves

OUTGOING_NODES = 24
AZIMUTH_NODES = 20
RING_NODES = 40
SCATTER_NODES = (192, 48)
"""Polar and azimuthal nodes for coordinates that nothing inverts."""


@dataclass(frozen=True)
class EnergyTable:
    """Directional energies of a layer's quotients.

    cos_theta_o: float64 [o], quadrature nodes. weight: float64 [o], 2 cosθo dcosθo, adding
      to 1, so that an albedo is Σ_o weight · directional albedo.
    t: float64 [j, s], Gauss points inside the bins.
    density: float64 [o, k, j, s], ∫ q_k cosθi dωi over the cell of a point, so that
      Σ_js density · f(t) is the directional albedo of q_k · f.
    sides: of a model with two curves, whose boxes j have no t; None for one curve.
    """

    cos_theta_o: Float64
    weight: Float64
    t: Float64
    density: Float64
    sides: tuple[Side, Side] | None = None

    @cached_property
    def mean_density(self) -> Float64:
        """The density averaged over outgoing directions: float64 [k, j, s]."""
        return np.tensordot(self.weight, self.density, axes=1)

    @cached_property
    def per_bin(self) -> Float64:
        """The density of whole bins: float64 [o, k, j]."""
        return np.asarray(self.density.sum(axis=3))


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
    if isinstance(model, TwoCurves):
        boxes, sides = box_energies(model, fixed, cos_o, weight)
        return EnergyTable(cos_o, weight, np.zeros((bins, 1)), boxes[..., None], sides)
    if model.coordinate_name == "none" and model.lobe == "cosine":
        t, density = _over_cosine(model, bins, fixed, cos_o)
    elif model.inverse == "half":
        t, density = _over_half_vectors(model, bins, spacing, fixed, cos_o)
    elif model.inverse == "axis" and not model.anisotropic:
        t, density = _over_rings(model, bins, spacing, fixed, cos_o)
    else:
        t, density = _scattered(model, bins, spacing, fixed, cos_o)
    return EnergyTable(cos_o, weight, t, density)


def _over_half_vectors(
    model: Model, bins: int, spacing: float, fixed: dict[str, float], cos_o: Float64
) -> tuple[Float64, Float64]:
    points = max(2, model.quadrature_points // bins)
    if model.anisotropic:
        points = max(2, points // 2)
    t, t_weight = bin_points(bins, spacing, points)
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


def _over_rings(
    model: Model, bins: int, spacing: float, fixed: dict[str, float], cos_o: Float64
) -> tuple[Float64, Float64]:
    t, t_weight = bin_points(bins, spacing, max(2, model.quadrature_points // bins))
    u, u_weight = gauss_legendre(0.0, 1.0, RING_NODES)
    density = np.zeros((len(cos_o), model.rank, t.size))
    for o, mu in enumerate(cos_o):
        ring = around_axis(model.coordinate_name, t.ravel(), u, u_weight, float(mu))
        wo = Vector(np.sqrt(1 - mu * mu), 0.0, mu)
        jacobian = ring.wi.z * ring.solid_angle
        quotients = model.quotients(numpy_maths, ring.wi, wo, fixed)
        density[o] = [np.sum(q * jacobian, axis=1) for q in quotients]
    density *= t_weight.ravel()
    return t, density.reshape(len(cos_o), model.rank, *t.shape)


def _scattered(
    model: Model, bins: int, spacing: float, fixed: dict[str, float], cos_o: Float64
) -> tuple[Float64, Float64]:
    """Sort a dense rule over ωi into cells of the bins by the coordinate itself."""
    cells = max(2, model.quadrature_points // bins)
    count = bins * cells
    t = ((np.arange(count) + 0.5) / count) ** spacing
    directions = _turned if model.anisotropic else _straight
    density = np.zeros((len(cos_o), model.rank, count))
    for o, mu in enumerate(cos_o):
        for wo, share in directions(float(mu)):
            wi, solid_angle = _rule(model, wo)
            position = np.clip(model.coordinate(numpy_maths, wi, wo, fixed), 0.0, 1.0)
            cell = np.minimum((position ** (1 / spacing) * count).astype(int), count - 1)
            weight = wi.z * solid_angle * share
            for k, q in enumerate(model.quotients(numpy_maths, wi, wo, fixed)):
                density[o, k] += np.bincount(cell, q * weight, count)
    shape = (bins, cells)
    return t.reshape(shape), density.reshape(len(cos_o), model.rank, *shape)


def _straight(mu: float) -> list[tuple[Vector, float]]:
    return [(Vector(np.sqrt(1 - mu * mu), 0.0, mu), 1.0)]


def _turned(mu: float) -> list[tuple[Vector, float]]:
    """Outgoing azimuths all round: nothing is assumed of a user's model."""
    sin, phi = np.sqrt(1 - mu * mu), (np.arange(8) + 0.5) * (2 * np.pi / 8)
    return [(Vector(sin * np.cos(a), sin * np.sin(a), mu), 1 / 8) for a in phi]


def _rule(model: Model, wo: Vector) -> tuple[Vector, Float64]:
    """Incident directions above the horizon and their solid angles: each float64 [n].

    Gauss points over half vectors, θh = (π/2) u², for glossy models, else over the cosine.
    """
    polar, azimuths = SCATTER_NODES
    u, weight = gauss_legendre(0.0, 1.0, polar)
    phi = ((np.arange(2 * azimuths) + 0.5) * (np.pi / azimuths))[None]
    around = np.pi / azimuths
    if model.lobe == "cosine":
        sin = np.sqrt(1 - u * u)[:, None]
        wi = Vector(sin * np.cos(phi), sin * np.sin(phi), u[:, None] + 0 * phi)
        return Vector(*(a.ravel() for a in wi)), np.repeat(weight * around, phi.size)
    theta = (np.pi / 2 * u * u)[:, None]
    h = Vector(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi)
    o_dot_h = wo.x * h.x + wo.y * h.y + wo.z * h.z
    wi = Vector(*(2 * o_dot_h * b - a for a, b in zip(wo, h, strict=True)))
    solid_angle = 4 * o_dot_h * np.sin(theta) * np.pi * u[:, None] * weight[:, None] * around
    lit = (wi.z > 0) & (o_dot_h > 0)
    return Vector(*(a[lit] for a in wi)), solid_angle[lit]


def _over_cosine(
    model: Model, bins: int, fixed: dict[str, float], cos_o: Float64
) -> tuple[Float64, Float64]:
    """For models without a coordinate: Gauss points over the incident cosine."""
    if bins != 1 or model.anisotropic:
        raise NotImplementedError(f"{model.name}: without a coordinate one bin, and isotropic")
    mu_i, mu_weight = gauss_legendre(0.0, 1.0, 64)
    phi, phi_weight = gauss_legendre(0.0, np.pi, 16)
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
