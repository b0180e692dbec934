"""Ward: anisotropic Gaussian highlights, in the two forms that one curve can edit.

    ρ = color / (4π αx αy √(cosθi cosθo)) · exp(−tan²θh (cos²φh/αx² + sin²φh/αy²))

(Ward 1992, eq. 5a.) With the ratio r = αy / αx one of αx and r is frozen in the quotient and
the other edited, "in essentially the same way" as Ashikhmin-Shirley (2006, §4.3). The
coordinate is the angle γ with tanγ = tanθh · p(φh), so that the profile is exp(−tan²γ / α²).
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths, half_vector
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter

COLOUR = Parameter("color", 0.5, kind="colour", description="about the share reflected")
ROUGHNESS = Parameter(
    "roughness", 0.15, 0.01, 0.5, scale="square", description="αx, slope spread along u"
)
RATIO = Parameter(
    "ratio", 1.0, 0.05, 20.0, scale="logarithmic", description="αy / αx; above 1 wider along v"
)
FAINT = 80.0
"""Exponents of a frozen lobe stop here, at 1e-35, so that no quotient underflows to 0."""


@dataclass(frozen=True)
class _Ward(Model):
    coordinate_name = "gamma"
    coordinate_maximum = math.pi / 2
    lobe = "half"
    anisotropic = True

    @abstractmethod
    def _stretch2(self, cos2_phi: Any, sin2_phi: Any, fixed: Fixed) -> Any:
        """p²(φh), what tan²θh is multiplied by in the coordinate."""

    @abstractmethod
    def _frozen_exponent(self, tan2_x: Any, fixed: Fixed) -> Any:
        """The exponent that the quotient holds; tan2_x is tan²θh cos²φh."""

    @abstractmethod
    def _widths(self, values: Mapping[str, Any]) -> tuple[Any, Any]:
        """αx and r."""

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        h = half_vector(xp, wi, wo)
        tan2 = self._stretch2(h.x * h.x, h.y * h.y, fixed)
        return xp.atan2(xp.sqrt(tan2), h.z) * (2 / xp.pi)

    def half_angle(self, t: Float64, phi: Float64, fixed: Fixed) -> tuple[Float64, Float64]:
        gamma = t * (math.pi / 2)
        p2 = self._stretch2(np.cos(phi) ** 2, np.sin(phi) ** 2, fixed)
        sin, cos = np.sin(gamma), np.cos(gamma)
        length2 = p2 * cos * cos + sin * sin
        theta = np.arctan2(sin, np.sqrt(p2) * cos)
        return theta, sin * np.sqrt(p2) / length2**1.5 * (math.pi / 2)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        h = half_vector(xp, wi, wo)
        tan2_x = h.x * h.x / xp.maximum(h.z * h.z, 1e-12)
        exponent = xp.minimum(self._frozen_exponent(tan2_x, fixed), FAINT)
        return [xp.exp(-exponent) / (4 * xp.pi * xp.sqrt(wi.z * wo.z))]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        alpha, ratio = self._widths({**fixed, **values})
        colour = np.asarray(values["color"], np.float64).reshape(1, 3)
        return np.asarray(colour / (alpha * alpha * ratio))

    def _gaussian(self, t: Float64, alpha: float) -> Float64:
        tangent = np.tan(np.minimum(t, 1 - 1e-9) * (math.pi / 2))
        return np.asarray(np.exp(-((tangent / alpha) ** 2)))[:, None]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        alpha, ratio = self._widths(values)
        h = half_vector(xp, wi, wo)
        y = h.y / ratio
        exponent = (h.x * h.x + y * y) / (alpha * alpha * xp.maximum(h.z * h.z, 1e-12))
        lit = (wi.z > 0) & (wo.z > 0)
        cosines = xp.sqrt(xp.select(lit, wi.z * wo.z, 1.0))
        lobe = xp.exp(-exponent) / (4 * xp.pi * alpha * alpha * ratio * cosines)
        return [xp.select(lit, color * lobe, 0.0) for color in values["color"]]


@dataclass(frozen=True)
class WardWidth(_Ward):
    """The width of the highlight edited, the anisotropy frozen.

    tanγ = tanθh √(cos²φh + sin²φh / r²), f = exp(−tan²γ / αx²).

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ρs; for small α the albedo |
    | roughness | [0.01, 0.5] | αx, slope spread along u; along v it is ratio · αx |

    Frozen: ratio (αy / αx). No Fresnel; reflection fades towards grazing angles. The
    normalisation is Ward's, right for αx and αy up to about 0.2.
    """

    name = "ward-width"
    parameters = (COLOUR, ROUGHNESS)
    fixed_parameters = (RATIO,)

    def freeze(self, values: Values) -> dict[str, float]:
        return {"ratio": float(RATIO.validate(values.get("ratio", RATIO.default)))}  # type: ignore[arg-type]

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return self._gaussian(t, float(values["roughness"]))  # type: ignore[arg-type]

    def _stretch2(self, cos2_phi: Any, sin2_phi: Any, fixed: Fixed) -> Any:
        return cos2_phi + sin2_phi / (fixed["ratio"] * fixed["ratio"])

    def _frozen_exponent(self, tan2_x: Any, fixed: Fixed) -> Any:
        return 0.0 * tan2_x

    def _widths(self, values: Mapping[str, Any]) -> tuple[Any, Any]:
        return values["roughness"], values["ratio"]


@dataclass(frozen=True)
class WardRatio(_Ward):
    """The direction and amount of anisotropy edited, the width along u frozen.

    tanγ = tanθh |sinφh|, f = exp(−tan²γ / (r αx)²).

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ρs; for small α the albedo |
    | ratio | [0.05, 20] | r = αy / αx; above 1 the highlight is wider along v |

    Frozen: roughness (αx). No Fresnel, and Ward's normalisation, as in the other form.
    """

    name = "ward-ratio"
    parameters = (COLOUR, RATIO)
    fixed_parameters = (ROUGHNESS,)

    def freeze(self, values: Values) -> dict[str, float]:
        alpha = ROUGHNESS.validate(values.get("roughness", ROUGHNESS.default))
        return {"roughness": float(alpha)}  # type: ignore[arg-type]

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return self._gaussian(t, float(values["ratio"]) * float(fixed["roughness"]))  # type: ignore[arg-type]

    def _stretch2(self, cos2_phi: Any, sin2_phi: Any, fixed: Fixed) -> Any:
        return sin2_phi

    def _frozen_exponent(self, tan2_x: Any, fixed: Fixed) -> Any:
        return tan2_x / (fixed["roughness"] * fixed["roughness"])

    def _widths(self, values: Mapping[str, Any]) -> tuple[Any, Any]:
        return values["roughness"], values["ratio"]
