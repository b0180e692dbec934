"""Cook-Torrance with its Fresnel curve edited: the θd half of 2006's half-difference forms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.coordinates import normalised
from burnish.materials.maths import Maths, dot, half_vector, numpy_maths
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.models.optics import (
    SMALLEST_ROUGHNESS,
    Distribution,
    fresnel_conductor,
    masking,
    microfacet_density,
)
from burnish.materials.parameter import Parameter

ROUGHNESS = Parameter("roughness", 0.2, SMALLEST_ROUGHNESS, 1.0, scale="square")


@dataclass(frozen=True)
class FresnelCurve(Model):
    """ρ = color · F(θd; eta, k) · D(θh; α) G1(θi; α) G1(θo; α) / (4 cosθi cosθo).

    2006, eq. 10, with the curve f_B = F(θd) edited, for any index of refraction and freehand,
    and D and G frozen in the quotient at the initial roughness. F is the exact unpolarised
    reflectance of a conductor, per channel; k = 0 is a dielectric.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | tint |
    | eta | [0, 10] per channel | real part of the index of refraction |
    | k | [0, 20] per channel | extinction coefficient |

    Static: distribution, "ggx" or "beckmann". Frozen: roughness (α, Mitsuba's alpha).
    """

    distribution: Distribution = "ggx"

    name = "fresnel-curve"
    parameters = (
        Parameter("color", 1.0, kind="colour", description="tint"),
        Parameter("eta", 1.5, 0.0, 10.0, 0.0, 5.0, kind="colour", description="index, real part"),
        Parameter("k", 0.0, 0.0, 20.0, 0.0, 10.0, kind="colour", description="extinction"),
    )
    fixed_parameters = (ROUGHNESS,)
    coordinate_name = "theta_d"
    coordinate_maximum = math.pi / 2
    lobe = "half"
    inverse = "axis"

    def __post_init__(self) -> None:
        if self.distribution not in ("beckmann", "ggx"):
            raise InvalidValue(
                f"distribution must be 'beckmann' or 'ggx'; got {self.distribution!r}"
            )

    def freeze(self, values: Values) -> dict[str, float]:
        alpha = ROUGHNESS.validate(values.get("roughness", ROUGHNESS.default))
        return {"roughness": float(alpha)}  # type: ignore[arg-type]

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return normalised(xp, "theta_d", wi, wo)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        # Where D underflows the quotient stays positive, at nothing that could be seen
        return [xp.maximum(_lobe(xp, self.distribution, wi, wo, fixed["roughness"]), 1e-30)]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return np.asarray(values["color"], np.float64).reshape(1, 3)

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        cos = np.maximum(np.cos(t * self.coordinate_maximum), 0.0)[:, None]
        eta, k = (np.asarray(values[name], np.float64) * np.ones(3) for name in ("eta", "k"))
        return np.asarray(fresnel_conductor(numpy_maths, cos, eta, k))

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        cos_d = xp.minimum(xp.maximum(dot(wi, half_vector(xp, wi, wo)), 0.0), 1.0)
        lobe = xp.select(lit, _lobe(xp, self.distribution, wi, wo, values["roughness"]), 0.0)
        return [
            color * lobe * fresnel_conductor(xp, cos_d, eta, k)
            for color, eta, k in zip(values["color"], values["eta"], values["k"], strict=True)
        ]


def _lobe(xp: Maths, distribution: Distribution, wi: Any, wo: Any, alpha: Any) -> Any:
    h = half_vector(xp, wi, wo)
    density = microfacet_density(xp, distribution, h.x * h.x + h.y * h.y, h.z, alpha)
    masked = masking(xp, distribution, wi.z, alpha) * masking(xp, distribution, wo.z, alpha)
    return density * masked / (4 * xp.maximum(wi.z * wo.z, 1e-12))
