"""Phong: a cosine power about the mirrored direction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.coordinates import normalised
from burnish.materials.maths import Maths
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter


@dataclass(frozen=True)
class Phong(Model):
    """ρ = color · (n + 2) / 2π · cosⁿθr (Phong 1975; 2006, §4), nothing beyond θr = 90°.

    θr is the angle between ωi and the mirrored ωo. The factor makes the albedo at normal
    incidence, where it is largest, exactly `color` (Lafortune and Willems 1994). No masking
    and no Fresnel: reflection fades towards grazing angles.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | albedo at normal incidence |
    | exponent | [1, 5000] | sharpness; four times Blinn's exponent gives a like lobe |
    """

    name = "phong"
    parameters = (
        Parameter("color", 0.5, kind="colour", description="albedo at normal incidence"),
        Parameter("exponent", 50.0, 1.0, 5000.0, scale="logarithmic", description="sharpness"),
    )
    coordinate_name = "theta_r"
    coordinate_maximum = math.pi / 2
    lobe = "half"
    inverse = "axis"

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return normalised(xp, "theta_r", wi, wo)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        # A freehand curve ends at 90° too
        return [xp.select(_cos_mirror(wi, wo) > 0, 1.0 + 0.0 * wi.z, 0.0)]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        n = float(values["exponent"])  # type: ignore[arg-type]
        return np.asarray(values["color"], np.float64).reshape(1, 3) * ((n + 2) / (2 * math.pi))

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        cosine = np.maximum(np.cos(t * self.coordinate_maximum), 0.0)
        return np.asarray(cosine ** float(values["exponent"]))[:, None]  # type: ignore[arg-type]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        n = values["exponent"]
        cosine = _cos_mirror(wi, wo)
        lit = (wi.z > 0) & (wo.z > 0) & (cosine > 0)
        lobe = xp.exp(n * xp.log(xp.minimum(xp.maximum(cosine, 1e-12), 1.0))) * (n + 2)
        return [xp.select(lit, color * lobe / (2 * xp.pi), 0.0) for color in values["color"]]


@dataclass(frozen=True)
class NormalisedPhong(Phong):
    """ρ = color · (n + 1) / 2π · cosⁿθr / cosθi (2015; Ramamoorthi and Hanrahan 2001).

    The cosine of the light is taken out, so that the highlight keeps its brightness towards
    grazing angles; what is reflected is at most `color`, and all of it where the lobe lies above
    the horizon. It is not reciprocal.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ks, albedo of a sharp lobe |
    | exponent | [1, 5000] | sharpness |
    """

    name = "phong-normalised"

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [xp.select(_cos_mirror(wi, wo) > 0, 1 / wi.z, 0.0)]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        n = float(values["exponent"])  # type: ignore[arg-type]
        return np.asarray(values["color"], np.float64).reshape(1, 3) * ((n + 1) / (2 * math.pi))

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        n = values["exponent"]
        below = xp.select(wi.z > 0, wi.z, 1.0) * (n + 2)
        plain = super().evaluate(xp, wi, wo, values)
        return [channel * (n + 1) / below for channel in plain]


def _cos_mirror(wi: Any, wo: Any) -> Any:
    return wi.z * wo.z - wi.x * wo.x - wi.y * wo.y
