"""Ashikhmin-Shirley over two curves: both axes of the highlight, each by itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths, dot, half_vector, one_minus_exp
from burnish.materials.model import Fixed, Values
from burnish.materials.models.ashikhmin_shirley import COLOUR, FIRST_REFLECTANCE, half_angles, lobe
from burnish.materials.models.optics import (
    first_reflectance,
    schlick_basis,
    schlick_weights,
)
from burnish.materials.parameter import Parameter
from burnish.materials.two_curves import TwoCurves


@dataclass(frozen=True)
class AshikhminShirleyCurves(TwoCurves):
    """The highlight along u and along v as two curves (2006, eq. 11–16).

        ρ = α(γα) β(γβ) F(θd) / (8π (ωi·ωh) max(cosθi, cosθo))
        cosγα = (cosθh)^cos²φh, α = √(nu + 1) cosγα^nu;  cosγβ = (cosθh)^sin²φh, β alike

    Fresnel is Schlick's, in two quotients (2008, eq. 31–32). With a = −log cosγα and
    b = −log cosγβ, a + b = −log cosθh and a / (a + b) = cos²φh: the two coordinates are the half
    vector, and dωh = e^(−a−b) da db / (2 √(a b)) in each quadrant.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | reflectance at normal incidence |
    | exponent_u | [1, 10000] | nu, sharpness along u |
    | exponent_v | [1, 10000] | nv, sharpness along v |

    Static: bins (over γα), bins2 (over γβ). Frozen: f0 (the reference quotient's reflectance).
    """

    bins2: int = 128

    name = "ashikhmin-shirley-curves"
    parameters = (
        COLOUR,
        *(
            Parameter(
                f"exponent_{axis}",
                225.0,
                1.0,
                10000.0,
                scale="logarithmic",
                description=f"n{axis}, sharpness along {axis}",
            )
            for axis in "uv"
        ),
    )
    fixed_parameters = (FIRST_REFLECTANCE,)
    anisotropic = True
    names = ("gamma_alpha", "gamma_beta")
    spacings = (2.0, 2.0)

    @property
    def rank(self) -> int:
        return 2

    def freeze(self, values: Values) -> dict[str, float]:
        return {"f0": first_reflectance(values["color"])}

    def coordinates(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> tuple[Any, Any]:
        log_cos, cos2_phi, sin2_phi = half_angles(xp, half_vector(xp, wi, wo))
        return _angle(xp, log_cos * cos2_phi), _angle(xp, log_cos * sin2_phi)

    def half_vectors(
        self, t: Float64, t2: Float64, fixed: Fixed
    ) -> tuple[Float64, Float64, Float64] | None:
        gamma_a, gamma_b = t * self.coordinate_maximum, t2 * self.coordinate_maximum
        a, b = -np.log(np.cos(gamma_a)), -np.log(np.cos(gamma_b))
        cosine = np.exp(-(a + b))
        theta = np.arctan2(np.sqrt(-np.expm1(-2 * (a + b))), cosine)
        phi = np.arctan2(np.sqrt(b), np.sqrt(a))
        density = cosine * np.tan(gamma_a) * np.tan(gamma_b) / (2 * np.sqrt(a * b))
        return theta, phi, density * self.coordinate_maximum**2

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        h = half_vector(xp, wi, wo)
        cos_d = xp.minimum(xp.maximum(dot(wi, h), 1e-6), 1.0)
        shared = 1 / (8 * xp.pi * cos_d * xp.maximum(wi.z, wo.z))
        return [shared * f for f in schlick_basis(cos_d, fixed["f0"])]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return schlick_weights(values["color"], float(fixed["f0"]))

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return _power(t, float(values["exponent_u"]))  # type: ignore[arg-type]

    def second_profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return _power(t, float(values["exponent_v"]))  # type: ignore[arg-type]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        return lobe(xp, wi, wo, values["exponent_u"], values["exponent_v"], values["color"])


def _angle(xp: Maths, log_cos: Any) -> Any:
    """γ / 90° from −log cosγ."""
    return xp.atan2(xp.sqrt(one_minus_exp(xp, 2 * log_cos)), xp.exp(-log_cos)) * (2 / xp.pi)


def _power(t: Float64, exponent: float) -> Float64:
    """√(n + 1) cosⁿγ: float64 [t, 1]."""
    cosine = np.maximum(np.cos(t * (math.pi / 2)), 0.0)
    return np.asarray(math.sqrt(exponent + 1) * cosine**exponent)[:, None]
