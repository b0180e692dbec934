"""Beard-Maxwell: painted surfaces, as a first surface and a static volume.

    ρ = F(θd) B cosθh / (σ² + tan²θh) · SO(θh, θd) / (4 cosθi cosθo)  +  ρD + 2 ρV / (cosθi + cosθo)

    SO = (1 + θh/Ω · exp(−2 θd/τ)) / (1 + θh/Ω)

(Maxwell, Beard, Weiner and Ladd 1973, in the form of Westlund and Meyer 2002, with the
modified Cauchy distribution of the NEF database for the zero-bistatic scan.) SO is shadowing
and obscuration. The two sums are two layers: a curve over θh, and terms with amplitudes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.coordinates import theta_difference
from burnish.materials.maths import Maths, dot, half_vector, theta_half
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.models.optics import (
    first_reflectance,
    schlick_basis,
    schlick_weight,
    schlick_weights,
)
from burnish.materials.parameter import Parameter

TAU = Parameter("tau", 0.5, 0.01, 10.0, unit="rad", description="τ, how fast shadowing sets in")
OMEGA = Parameter("omega", 0.5, 0.01, 10.0, unit="rad", description="Ω, how much is shadowed")


@dataclass(frozen=True)
class BeardMaxwellSurface(Model):
    """The first surface of Beard-Maxwell, edited over θh.

    f = B cosθh / (σ² + tan²θh); the quotient holds SO and 1 / (4 cosθi cosθo); Fresnel is
    Schlick's, split into two quotients (2008, eq. 31–32). Nothing in the model conserves
    energy: at grazing angles and for a large B it reflects more than it receives.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | F0, reflectance at normal incidence |
    | bias | [0, 2] | B, the height of the lobe |
    | sigma | [0.005, 1] | σ, its width: half the height at tanθh = σ |

    Frozen: tau and omega (shadowing), f0 (the reference quotient's reflectance).
    """

    name = "beard-maxwell-surface"
    parameters = (
        Parameter("color", 0.2, kind="colour", description="reflectance at normal incidence"),
        Parameter("bias", 0.1, 0.0, 2.0, 0.0, 0.5, description="B, height of the lobe"),
        Parameter("sigma", 0.1, 0.005, 1.0, scale="square", description="σ, width of the lobe"),
    )
    fixed_parameters = (TAU, OMEGA, Parameter("f0", 0.5, 0.02, 1.0))
    coordinate_name = "theta_h"
    coordinate_maximum = math.pi / 2
    lobe = "half"

    @property
    def rank(self) -> int:
        return 2

    def freeze(self, values: Values) -> dict[str, float]:
        tau, omega = (p.validate(values.get(p.name, p.default)) for p in (TAU, OMEGA))
        shadowing = {"tau": float(tau), "omega": float(omega)}  # type: ignore[arg-type]
        return {**shadowing, "f0": first_reflectance(values["color"])}

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return theta_half(xp, wi, wo) * (2 / xp.pi)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        cos_d = xp.minimum(xp.maximum(dot(wi, half_vector(xp, wi, wo)), 0.0), 1.0)
        shared = _shadowing(xp, wi, wo, fixed) / (4 * wi.z * wo.z)
        return [shared * s for s in schlick_basis(cos_d, fixed["f0"])]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        bias = float(values["bias"])  # type: ignore[arg-type]
        return np.asarray(schlick_weights(values["color"], float(fixed["f0"])) * bias)

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        theta = t * self.coordinate_maximum
        sin2, cos = np.sin(theta) ** 2, np.maximum(np.cos(theta), 0.0)
        sigma2 = float(values["sigma"]) ** 2  # type: ignore[arg-type]
        return np.asarray(cos**3 / (sigma2 * cos**2 + sin2))[:, None]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        h = half_vector(xp, wi, wo)
        tan2 = (h.x * h.x + h.y * h.y) / xp.maximum(h.z * h.z, 1e-12)
        scan = values["bias"] * h.z / (values["sigma"] * values["sigma"] + tan2)
        lit = (wi.z > 0) & (wo.z > 0)
        cosines = xp.select(lit, wi.z * wo.z, 1.0)
        lobe = xp.select(lit, scan * _shadowing(xp, wi, wo, values) / (4 * cosines), 0.0)
        grazing = schlick_weight(xp.minimum(xp.maximum(dot(wi, h), 0.0), 1.0))
        return [lobe * (f0 + (1 - f0) * grazing) for f0 in values["color"]]


@dataclass(frozen=True)
class BeardMaxwellVolume(Model):
    """The rest of Beard-Maxwell, static but for two colours: ρD + 2 ρV / (cosθi + cosθo).

    ρD = color / π and ρV = volume / 4π, so that neither term's directional albedo exceeds
    its colour; energy is conserved where color + volume <= 1.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | albedo of the matte term |
    | volume | [0, 1] per channel, linear RGB | scale of the volume, brightest at the rim |
    """

    name = "beard-maxwell-volume"
    parameters = (
        Parameter("color", 0.3, kind="colour", description="albedo of the matte term"),
        Parameter("volume", 0.2, kind="colour", description="scattering in the volume"),
    )

    @property
    def rank(self) -> int:
        return 2

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 0.5 + 0.0 * wi.z

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [1 / xp.pi + 0.0 * wi.z, 1 / (2 * xp.pi * (wi.z + wo.z))]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return np.array([values["color"], values["volume"]], np.float64)

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        total = xp.select(lit, wi.z + wo.z, 1.0)
        return [
            xp.select(lit, matte / xp.pi + 2 * (volume / (4 * xp.pi)) / total, 0.0)
            for matte, volume in zip(values["color"], values["volume"], strict=True)
        ]


def _shadowing(xp: Maths, wi: Any, wo: Any, numbers: Mapping[str, Any]) -> Any:
    tilt = theta_half(xp, wi, wo) / numbers["omega"]
    fade = xp.exp(-2 * theta_difference(xp, wi, wo) / numbers["tau"])
    return (1 + tilt * fade) / (1 + tilt)
