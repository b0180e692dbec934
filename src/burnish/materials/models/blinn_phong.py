"""Blinn-Phong: a cosine power of the half angle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths, half_vector, theta_half
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter


@dataclass(frozen=True)
class BlinnPhong(Model):
    """ρ = color · N(n) · cosⁿθh (Blinn 1977), the single-curve lobe of 2006 and 2008.

    N(n) = (n + 2)(n + 4) / (8π (2^(−n/2) + n)) makes the albedo at normal incidence, where
    it is largest, exactly `color` (Giesen, "Phong and Blinn-Phong normalization factors",
    2009). No masking and no Fresnel: reflection fades towards grazing angles.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | albedo at normal incidence |
    | exponent | [1, 5000] | sharpness; α ≈ √(2 / (n + 2)) gives a like lobe of Cook-Torrance |
    """

    name = "blinn-phong"
    parameters = (
        Parameter("color", 0.5, kind="colour", description="albedo at normal incidence"),
        Parameter("exponent", 50.0, 1.0, 5000.0, scale="logarithmic", description="sharpness"),
    )
    coordinate_name = "theta_h"
    coordinate_maximum = math.pi / 2
    lobe = "half"

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return theta_half(xp, wi, wo) * (2 / xp.pi)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [1.0 + 0.0 * wi.z]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        n = float(values["exponent"])  # type: ignore[arg-type]
        normalisation = (n + 2) * (n + 4) / (8 * math.pi * (2 ** (-n / 2) + n))
        return np.asarray(values["color"], np.float64).reshape(1, 3) * normalisation

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        cosine = np.maximum(np.cos(t * self.coordinate_maximum), 0.0)
        return np.asarray(cosine ** float(values["exponent"]))[:, None]  # type: ignore[arg-type]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        n = values["exponent"]
        cos_half = half_vector(xp, wi, wo).z
        normalisation = (n + 2) * (n + 4) / (8 * xp.pi * (xp.exp(-n * (math.log(2) / 2)) + n))
        lit = (wi.z > 0) & (wo.z > 0)
        lobe = xp.exp(n * xp.log(xp.maximum(cos_half, 1e-6))) * normalisation
        return [xp.select(lit, color * lobe, 0.0) for color in values["color"]]
