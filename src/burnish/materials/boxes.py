"""How much energy each box of a model with two curves carries, and how it lies along each side.

Over half vectors as for one curve (`quadrature`). Where the coordinates fix the half vector,
each box has Gauss points of its own. Else the first coordinate has them, the azimuth is cut
evenly up to where the mirrored direction leaves the hemisphere, and the second coordinate is
sorted into cells of its bins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.model import Fixed
from burnish.materials.nodes import bin_points
from burnish.materials.two_curves import TwoCurves

POINTS = 1024
"""Values of the first coordinate, all bins together."""
CELLS = 4
"""Into which a bin of the second coordinate is cut, where directions are sorted."""
BOX_POINTS = 128
"""Values of each coordinate where both are inverted."""
SIDE_POINTS = 8
"""Of a bin, along which a curve is averaged where both coordinates are inverted."""
TURNS = 3
"""Outgoing azimuths in one quadrant of an anisotropic model."""


@dataclass(frozen=True)
class Side:
    """Energy along one curve, that of the other curve's bins added up.

    t: float64 [j, s], points inside the bins. density: float64 [k, j, s], the mean over
    outgoing directions of ∫ q_k cosθi dωi over the cell of a point.
    """

    t: Float64
    density: Float64

    @property
    def share(self) -> Float64:
        """Of each point in what its bin carries: float64 [k, j, s]; even where that is none."""
        total = self.density.sum(axis=2, keepdims=True)
        even = np.full_like(self.density, 1 / self.density.shape[2])
        return np.asarray(np.divide(self.density, total, out=even, where=total > 0))


def box_energies(
    model: TwoCurves, fixed: Fixed, cos_o: Float64, weight: Float64
) -> tuple[Float64, tuple[Side, Side]]:
    """The energy of every box by outgoing direction, float64 [o, k, bins · bins2], and its sides.

    cos_o, weight: outgoing directions and their weights in a mean.
    """
    probe = np.full((1, 1), 0.5)
    if model.half_vectors(probe, probe, fixed) is None:
        return _sorted(model, fixed, cos_o, weight)
    return _inverted(model, fixed, cos_o, weight)


def _sorted(
    model: TwoCurves, fixed: Fixed, cos_o: Float64, weight: Float64
) -> tuple[Float64, tuple[Side, Side]]:
    first, second = model.axes
    t, t_weight = bin_points(first.bins, first.spacing, max(2, POINTS // first.bins))
    cells = second.bins * CELLS
    t2 = (((np.arange(cells) + 0.5) / cells) ** second.spacing).reshape(second.bins, CELLS)
    count = max(2 * second.bins, 64)
    theta = model.half_angle(t.reshape(-1, 1), np.zeros((1, 1)), fixed)[0]
    row = np.arange(t.size)[:, None] // t.shape[1] * cells
    energy = np.zeros((len(cos_o), model.rank, model.boxes))
    along = np.zeros((model.rank, t.size))
    across = np.zeros((model.rank, cells))
    for o, mu in enumerate(cos_o):
        wo = Vector(np.sqrt(1 - mu * mu), 0.0, mu)
        with np.errstate(divide="ignore", invalid="ignore"):
            horizon = -mu * np.cos(2 * theta) / (wo.x * np.sin(2 * theta))
        limit = np.arccos(np.clip(np.nan_to_num(horizon, nan=-1.0), -1, 1))
        phi = limit * (np.arange(count) + 0.5) / count
        theta_h, solid_angle = model.half_angle(t.reshape(-1, 1), phi, fixed)
        area = solid_angle * (2 * limit / count) * t_weight.reshape(-1, 1)
        wi, parts = _mirrored(model, fixed, wo, theta_h, phi, area)
        position = np.clip(model.coordinates(numpy_maths, wi, wo, fixed)[1], 0.0, 1.0)
        cell = np.minimum((position ** (1 / second.spacing) * cells).astype(np.int64), cells - 1)
        place = (row + cell).ravel()
        for k, part in enumerate(parts):
            found = np.bincount(place, part.ravel(), first.bins * cells)
            energy[o, k] = found.reshape(-1, CELLS).sum(axis=1)
            along[k] += weight[o] * part.sum(axis=1)
            across[k] += weight[o] * found.reshape(first.bins, cells).sum(axis=0)
    sides = Side(t, along.reshape(-1, *t.shape)), Side(t2, across.reshape(-1, *t2.shape))
    return energy, sides


def _inverted(
    model: TwoCurves, fixed: Fixed, cos_o: Float64, weight: Float64
) -> tuple[Float64, tuple[Side, Side]]:
    points = [max(1, BOX_POINTS // axis.bins) for axis in model.axes]
    (t, w), (t2, w2) = (
        bin_points(axis.bins, axis.spacing, count)
        for axis, count in zip(model.axes, points, strict=True)
    )
    found = model.half_vectors(t.reshape(-1, 1), t2.reshape(1, -1), fixed)
    assert found is not None
    theta, phi, density = found
    area = density * w.reshape(-1, 1) * w2.reshape(1, -1)
    shape = model.rank, model.bins, points[0], model.bins2, points[1]
    energy = np.zeros((len(cos_o), model.rank, model.boxes))
    for o, mu in enumerate(cos_o):
        sine = np.sqrt(1 - mu * mu)
        total = np.zeros((model.rank, *area.shape))
        for turn in (np.arange(TURNS) + 0.5) * (np.pi / 2 / TURNS):
            wo = Vector(sine * np.cos(turn), sine * np.sin(turn), mu)
            # The model's two mirror planes: one quadrant of ωo, and all four of the half vector
            for azimuth in (phi, np.pi - phi, np.pi + phi, -phi):
                total += np.stack(_mirrored(model, fixed, wo, theta, azimuth, area)[1])
        energy[o] = (total / TURNS).reshape(shape).sum(axis=(2, 4)).reshape(model.rank, -1)

    # Along a side the boxes' energy lies as the half vectors do
    mean = np.tensordot(weight, energy, axes=1).reshape(model.rank, model.bins, model.bins2)
    sides = []
    for number, axis in enumerate(model.axes):
        fine, own = bin_points(axis.bins, axis.spacing, SIDE_POINTS)
        middle = np.full_like(fine, 0.5)
        where = (fine, middle) if number == 0 else (middle, fine)
        found = model.half_vectors(*where, fixed)
        assert found is not None
        lie = found[2] * own
        lie = lie / lie.sum(axis=1, keepdims=True)
        sides.append(Side(fine, mean.sum(axis=2 - number)[:, :, None] * lie))
    return energy, (sides[0], sides[1])


def _mirrored(
    model: TwoCurves, fixed: Fixed, wo: Vector, theta: Float64, phi: Float64, area: Float64
) -> tuple[Vector, list[Float64]]:
    """ωo mirrored at half vectors, and q_k cosθi dωi of each, with dωi = 4 (ωo·ωh) dωh."""
    sine, cosine = np.sin(theta), np.cos(theta)
    h = Vector(sine * np.cos(phi), sine * np.sin(phi), cosine)
    o_dot_h = wo.x * h.x + wo.y * h.y + wo.z * h.z
    wi = Vector(*(2 * o_dot_h * b - a for a, b in zip(wo, h, strict=True)))
    lit = (wi.z > 0) & (o_dot_h > 0)
    # Keep unlit points away from singular quotients; their weight is zero
    wi = Vector(wi.x, wi.y, np.where(lit, wi.z, 1.0))
    solid_angle = np.where(lit, wi.z * 4 * o_dot_h * area, 0.0)
    return wi, [q * solid_angle for q in model.quotients(numpy_maths, wi, wo, fixed)]
