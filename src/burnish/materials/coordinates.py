"""The named coordinates γ of a curve: angles around an axis, with their inverses.

| name | γ | axis | range |
|---|---|---|---|
| theta_h | between the half vector and the normal | normal | 0 to 90° |
| theta_d | between the half vector and either direction | ωo, at twice γ | 0 to 90° |
| theta_r | between ωi and the mirrored ωo | mirrored ωo | 0 to 90°, beyond it 90° |
| theta_in | between ωi and the normal | normal | 0 to 90° |

(2006, table 1.) All keep their digits near 0. But for theta_h, each is an angle of ωi about
an axis that ωo gives, and `around_axis` inverts it: integrals over ωi become integrals over γ
and an azimuth that is measured from the side of the normal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths, Vector, theta_half

RIGHT_ANGLE = math.pi / 2


def theta_difference(xp: Maths, wi: Any, wo: Any) -> Any:
    """θd in radians: half the angle between the directions."""
    return 0.5 * _angle(xp, wi, wo)


def theta_mirror(xp: Maths, wi: Any, wo: Any) -> Any:
    """θr in radians, 0 to π: the angle between ωi and ωo mirrored at the normal."""
    return _angle(xp, wi, Vector(-wo.x, -wo.y, wo.z))


def theta_incident(xp: Maths, wi: Any, wo: Any) -> Any:
    """θin in radians: the angle between ωi and the normal."""
    return xp.atan2(xp.sqrt(wi.x * wi.x + wi.y * wi.y), wi.z)


COORDINATES: Mapping[str, Callable[[Maths, Any, Any], Any]] = {
    "theta_h": theta_half,
    "theta_d": theta_difference,
    "theta_r": theta_mirror,
    "theta_in": theta_incident,
}


def normalised(xp: Maths, name: str, wi: Any, wo: Any) -> Any:
    """t = γ / 90°, in [0, 1], of a named coordinate."""
    return xp.minimum(COORDINATES[name](xp, wi, wo) * (2 / xp.pi), 1.0)


@dataclass(frozen=True)
class Ring:
    """Incident directions where an axis coordinate has given values.

    wi: components float64 [t, φ]; solid_angle: float64 [t, φ], dωi per dt and per node of the
    azimuth, 0 below the horizon. Both mirrored halves of the azimuth are counted.
    """

    wi: Vector
    solid_angle: Float64


def around_axis(name: str, t: Float64, u: Float64, u_weight: Float64, cos_o: float) -> Ring:
    """Where "theta_in", "theta_r" or "theta_d" is 90° · t, for ωo in the plane of x and z.

    t: float64 [t]. u, u_weight: a rule on [0, 1]; the azimuth φ = φ_max u², so that nodes
    crowd on the side of the normal, and φ_max is where ωi meets the horizon.
    """
    sin_o = math.sqrt(1 - cos_o * cos_o)
    sideways = {"theta_in": 0.0, "theta_r": -sin_o, "theta_d": sin_o}[name]
    along = 1.0 if name == "theta_in" else cos_o
    scale = RIGHT_ANGLE * (2 if name == "theta_d" else 1)
    angle = (t * scale)[:, None]
    sin, cos = np.sin(angle), np.cos(angle)
    # Unit vector across the axis, on the side of the normal
    across = (-math.copysign(along, sideways), abs(sideways)) if sideways else (1.0, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        horizon = -cos * along / (sin * across[1])
    horizon = np.where(np.isnan(horizon), -1.0, horizon)
    limit = np.arccos(np.clip(horizon, -1, 1))
    phi = limit * u * u
    weight = 2 * limit * 2 * u * u_weight
    ahead = sin * np.cos(phi)
    z = cos * along + ahead * across[1]
    wi = Vector(cos * sideways + ahead * across[0], sin * np.sin(phi), np.maximum(z, 1e-12))
    return Ring(wi, np.where(z > 0, sin * scale * weight, 0.0))


def _angle(xp: Maths, a: Any, b: Any) -> Any:
    """The angle between unit vectors, by Kahan's formula: exact where it is small."""
    apart = (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y) + (a.z - b.z) * (a.z - b.z)
    joint = (a.x + b.x) * (a.x + b.x) + (a.y + b.y) * (a.y + b.y) + (a.z + b.z) * (a.z + b.z)
    return 2 * xp.atan2(xp.sqrt(apart), xp.sqrt(joint))
