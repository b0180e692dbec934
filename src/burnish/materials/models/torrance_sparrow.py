"""Torrance-Sparrow, simplified: a Gaussian of the half angle, without masking and Fresnel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths, theta_half
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter


@dataclass(frozen=True)
class TorranceSparrow(Model):
    """ρ = color / (4 cosθi cosθo) · exp(−θh² / σ²) / πσ² (Ramamoorthi and Hanrahan 2001; 2015).

    The microfacet model as the 2015 report paints with it. Nothing darkens it towards grazing
    angles, where it reflects more than it receives; of uniform light it reflects no more than
    `color` for σ up to 0.5.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ks; for small σ the albedo |
    | sigma | [0.01, 0.5] rad | σ, width of the highlight |
    """

    name = "torrance-sparrow"
    parameters = (
        Parameter("color", 0.5, kind="colour", description="ks, about the share reflected"),
        Parameter(
            "sigma", 0.1, 0.01, 0.5, unit="rad", scale="square", description="σ, width of the lobe"
        ),
    )
    coordinate_name = "theta_h"
    coordinate_maximum = math.pi / 2
    lobe = "half"

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return theta_half(xp, wi, wo) * (2 / xp.pi)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [1 / (4 * wi.z * wo.z)]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return np.asarray(values["color"], np.float64).reshape(1, 3)

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        sigma = float(values["sigma"])  # type: ignore[arg-type]
        lobe = np.exp(-((t * self.coordinate_maximum / sigma) ** 2))
        return np.asarray(lobe / (math.pi * sigma**2))[:, None]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        theta, sigma2 = theta_half(xp, wi, wo), values["sigma"] * values["sigma"]
        cosines = xp.select(lit, 4 * wi.z * wo.z, 1.0)
        lobe = xp.select(lit, xp.exp(-theta * theta / sigma2) / (xp.pi * sigma2 * cosines), 0.0)
        return [color * lobe for color in values["color"]]
