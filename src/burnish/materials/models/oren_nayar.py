"""Oren-Nayar: matte surfaces that are rough, by static terms with scalar amplitudes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.coordinates import theta_incident
from burnish.materials.maths import Maths
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter


@dataclass(frozen=True)
class OrenNayar(Model):
    """Lambertian V-grooves with interreflection (Oren and Nayar 1994, eq. 27–30).

        ρ = c/π [C1 + cosφ C2 tanβ + (1 − |cosφ|) C3 tan((α + β)/2)]
            + 0.17 c²/π σ²/(σ² + 0.13) [1 − cosφ (2β/π)²]

    with α and β the larger and the smaller of θi and θo, φ the azimuth between them, and
    C1 = 1 − 0.5 σ²/(σ² + 0.33), C2 = 0.45 σ²/(σ² + 0.09) (sinα − [cosφ < 0] (2β/π)³),
    C3 = 0.125 σ²/(σ² + 0.09) (4αβ/π²)². The user's variables only scale static terms
    (2006, §4.3): three quotients, and no coordinate.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | albedo of a facet |
    | roughness | [0, 0.6] rad | σ, standard deviation of the facets' slope angle; 0 is Lambert |

    Beyond 0.6 the paper's formula turns negative at grazing angles. For white facets it
    reflects up to 3 % more than it receives there, by its term for interreflection.
    """

    name = "oren-nayar"
    parameters = (
        Parameter("color", 0.5, kind="colour", description="albedo of a facet"),
        Parameter("roughness", 0.3, 0.0, 0.6, unit="rad", description="spread of facet slopes"),
    )

    @property
    def rank(self) -> int:
        return 3

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 0.5 + 0.0 * wi.z

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [term / xp.pi for term in (1.0 + 0.0 * wi.z, *_terms(xp, wi, wo))]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        colour = np.asarray(values["color"], np.float64)
        s2 = float(values["roughness"]) ** 2  # type: ignore[arg-type]
        between = 0.17 * colour**2 * s2 / (s2 + 0.13)
        return np.stack(
            [
                colour * (1 - 0.5 * s2 / (s2 + 0.33)) + between,
                colour * s2 / (s2 + 0.09),
                -between,
            ]
        )

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        theta_i, theta_o = theta_incident(xp, wi, wo), theta_incident(xp, wo, wi)
        alpha, beta = xp.maximum(theta_i, theta_o), xp.minimum(theta_i, theta_o)
        cos_phi, s2 = _cos_azimuth(xp, wi, wo), values["roughness"] * values["roughness"]
        b = 2 * beta / xp.pi
        c1 = 1 - 0.5 * s2 / (s2 + 0.33)
        c2 = 0.45 * s2 / (s2 + 0.09) * (xp.sin(alpha) - xp.select(cos_phi < 0, b * b * b, 0.0))
        groove = 4 * alpha * beta / (xp.pi * xp.pi)
        c3 = 0.125 * s2 / (s2 + 0.09) * groove * groove
        direct = c1 + cos_phi * c2 * xp.tan(beta)
        direct = direct + (1 - xp.abs(cos_phi)) * c3 * xp.tan((alpha + beta) / 2)
        twice = 0.17 * s2 / (s2 + 0.13) * (1 - cos_phi * b * b)
        lit = (wi.z > 0) & (wo.z > 0)
        return [
            xp.select(lit, color * (direct + color * twice) / xp.pi, 0.0)
            for color in values["color"]
        ]


def _terms(xp: Maths, wi: Any, wo: Any) -> tuple[Any, Any]:
    """What σ²/(σ² + 0.09) scales, and what the interreflection takes away."""
    theta_i, theta_o = theta_incident(xp, wi, wo), theta_incident(xp, wo, wi)
    alpha, beta = xp.maximum(theta_i, theta_o), xp.minimum(theta_i, theta_o)
    cos_phi = _cos_azimuth(xp, wi, wo)
    b = 2 * beta / xp.pi
    facing = cos_phi * (xp.sin(alpha) - xp.select(cos_phi < 0, b * b * b, 0.0)) * xp.tan(beta)
    groove = 4 * alpha * beta / (xp.pi * xp.pi)
    across = (1 - xp.abs(cos_phi)) * groove * groove * xp.tan((alpha + beta) / 2)
    return 0.45 * facing + 0.125 * across, cos_phi * b * b


def _cos_azimuth(xp: Maths, wi: Any, wo: Any) -> Any:
    """cos(φi − φo); 1 where either direction is the normal, whose azimuth is anything."""
    length2 = (wi.x * wi.x + wi.y * wi.y) * (wo.x * wo.x + wo.y * wo.y)
    cosine = (wi.x * wo.x + wi.y * wo.y) / xp.sqrt(xp.maximum(length2, 1e-20))
    return xp.select(length2 > 1e-20, xp.minimum(xp.maximum(cosine, -1.0), 1.0), 1.0)
