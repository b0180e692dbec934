"""Principal components of a family of isotropic BRDFs (2010, generalised).

A family ρ(ωi, ωo; v) is sampled over its parameters v in half and difference angles
(θh, θd, φd), where lobes stay put as they change. The mean of all members is the first
component; the others are the principal components of what the mean leaves over. Then
ρ ≈ Σ_k a_k(v) q_k with tables q_k, and a_k(v) the projection of the current BRDF.

The error is the relative RMS of a member, weighted by cosθi cosθo and the solid angles of
both directions; the RMS over all members decides how many components there are. Reciprocity
and the mirror symmetry of an isotropic surface leave φd in [0, π/2].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths, Vector, dot, half_vector
from burnish.materials.principal import leading

SHAPE = (96, 24, 12)
"""Nodes over θh, θd and φd, denser near θh = 0 for narrow lobes and near θd = 90°."""

DAMPING = 0.02
"""Tables hold ρ (cosθi + 0.02)(cosθo + 0.02), which is smooth where ρ rises to grazing angles."""

HORIZON = 2e-3
"""The least cosine that is sampled; beyond the horizon a table holds its value there."""


def half_difference(xp: Maths, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
    """(u, v, w) in [0, 1] of a pair of directions: √(θh / 90°), 1 − √(1 − θd / 90°), φd / 90°.

    φd is folded into the first quadrant.
    """
    h = half_vector(xp, wi, wo)
    sin_h = xp.sqrt(h.x * h.x + h.y * h.y)
    theta_h = xp.atan2(sin_h, h.z)
    cos_d = xp.minimum(xp.maximum(dot(wi, h), 0.0), 1.0)
    dx, dy, dz = wi.x - wo.x, wi.y - wo.y, wi.z - wo.z
    theta_d = xp.atan2(0.5 * xp.sqrt(dx * dx + dy * dy + dz * dz), cos_d)
    # The difference vector along the meridian of h and across it
    safe = xp.maximum(sin_h, 1e-9)
    cos_m, sin_m = h.x / safe, h.y / safe
    along = h.z * (cos_m * dx + sin_m * dy) - sin_h * dz
    across = cos_m * dy - sin_m * dx
    phi_d = xp.atan2(xp.abs(across), xp.maximum(xp.abs(along), 1e-12))
    quarter = 2 / xp.pi
    v = 1 - xp.sqrt(xp.maximum(1 - theta_d * quarter, 0.0))
    return xp.sqrt(theta_h * quarter), v, phi_d * quarter


def damping(wi: Any, wo: Any) -> Any:
    """The factor of a table over its BRDF."""
    return (wi.z + DAMPING) * (wo.z + DAMPING)


@dataclass(frozen=True)
class Grid:
    """Directions at the nodes of a table: each component float64 SHAPE, and their weight."""

    wi: Vector
    wo: Vector
    weight: Float64


@lru_cache(maxsize=1)
def grid() -> Grid:
    """The nodes, moved to the horizon where they lie below it."""
    u, v, w = (np.linspace(0.0, 1.0, count) for count in SHAPE)
    theta_h, theta_d, phi_d = np.meshgrid(
        u * u * np.pi / 2, (1 - (1 - v) ** 2) * np.pi / 2, w * np.pi / 2, indexing="ij"
    )
    # cosθi = cosθh cosθd − sinθh sinθd cosφd is the lower of the two; it falls with θd
    lean = np.sin(theta_h) * np.cos(phi_d)
    length = np.hypot(np.cos(theta_h), lean)
    limit = np.arccos(np.minimum(HORIZON / np.maximum(length, HORIZON), 1.0))
    limit = limit - np.arctan2(lean, np.cos(theta_h))
    inside = theta_d <= limit
    theta = np.clip(theta_d, 0.0, np.maximum(limit, 0.0))
    wi, wo = (_direction(theta_h, theta, phi_d, sign) for sign in (1, -1))
    weight = np.where(inside, np.maximum(wi.z, 0) * np.maximum(wo.z, 0), 0.0)
    weight *= np.sin(theta_h) * np.sin(theta_d) * np.cos(theta_d) * u[:, None, None]
    weight *= (1 - v)[None, :, None]
    return Grid(wi, wo, np.asarray(weight / weight.sum()))


def _direction(theta_h: Float64, theta_d: Float64, phi_d: Float64, sign: int) -> Vector:
    x = sign * np.sin(theta_d) * np.cos(phi_d)
    y = sign * np.sin(theta_d) * np.sin(phi_d)
    z = np.cos(theta_d)
    cos_h, sin_h = np.cos(theta_h), np.sin(theta_h)
    up = np.maximum(z * cos_h - x * sin_h, 1e-6)
    return Vector(x * cos_h + z * sin_h, y, up)


@dataclass(frozen=True, eq=False)
class Components:
    """Tables q_k, the mean first.

    tables: float64 [k, *SHAPE], BRDFs at the grid. errors: float64 [most], the relative RMS
    over the members with the first 1, 2, … components. worst: float64 [most], that of the
    worst member. sizes: float64 [k], the RMS of each a_k over members of the same brightness.
    """

    tables: Float64
    errors: Float64
    worst: Float64
    sizes: Float64

    @cached_property
    def damped(self) -> Float64:
        """The tables as they are interpolated, ready for `damping`: float64 [k, *SHAPE]."""
        return np.asarray(self.tables * damping(grid().wi, grid().wo))

    @cached_property
    def _projector(self) -> Float64:
        root = np.sqrt(grid().weight.ravel())
        rows = self.tables.reshape(len(self.tables), -1) * root
        return np.asarray(np.linalg.pinv(rows.T, rcond=1e-9) * root)

    def project(self, samples: Float64) -> Float64:
        """a_k of BRDFs sampled at the grid: float64 [*SHAPE, n] to float64 [k, n]."""
        return np.asarray(self._projector @ samples.reshape(-1, samples.shape[-1]))


def principal(members: Float64, error: float, most: int = 64) -> Components:
    """The components of members float64 [m, *SHAPE] for a relative RMS error.

    All members count alike, however bright. Gives no more than `most` components.
    """
    root = np.sqrt(grid().weight.ravel())
    rows = members.reshape(len(members), -1) * root
    norms = np.linalg.norm(rows, axis=1)
    used = norms > 1e-12 * norms.max()
    rows = rows[used] / norms[used, None]
    mean = rows.mean(axis=0)
    direction = mean / np.linalg.norm(mean)
    rest = rows - np.outer(rows @ direction, direction)
    found = leading(rest, error, most - 1)
    # The same combinations of the members themselves, so that tables reach where weights do not
    whole = members.reshape(len(members), -1)[used] / norms[used, None]
    first = whole.mean(axis=0)
    residual = whole - np.outer(rows @ direction, first / np.linalg.norm(mean))
    tables = np.concatenate([first[None], found.mixing.T @ residual])
    # What a member of size one is made of
    shares = [rows @ direction / np.linalg.norm(mean), *(rest @ (rest.T @ found.mixing)).T]
    sizes = np.sqrt((np.stack(shares) ** 2).mean(axis=1))
    return Components(tables.reshape(-1, *SHAPE), found.errors, found.worst, sizes)
