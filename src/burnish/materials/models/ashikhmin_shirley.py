"""Ashikhmin-Shirley: anisotropic highlights, in the two forms that one curve can edit.

    ρ = √((nu + 1)(nv + 1)) / 8π · (cosθh)^(nu cos²φh + nv sin²φh) F(θd)
        / ((ωi·ωh) max(cosθi, cosθo))

(Ashikhmin and Shirley 2000; 2006, eq. 11.) With the ratio r = nv / nu, one of nu and r is
frozen in the quotient and the other edited (2008, eq. 33–35). The coordinate is the angle γ
with cosγ = (cosθh)^p(φh), so that the profile is a plain power of its cosine (2006, eq. 15).
Fresnel is Schlick's, split into two quotients (2008, eq. 31–32), so `color` is editable too.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import (
    Maths,
    Vector,
    dot,
    half_vector,
    log_one_plus,
    numpy_maths,
    one_minus_exp,
)
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.models.optics import (
    first_reflectance,
    schlick_basis,
    schlick_weight,
    schlick_weights,
)
from burnish.materials.parameter import Parameter

COLOUR = Parameter("color", 0.5, kind="colour", description="reflectance at normal incidence")
EXPONENT = Parameter(
    "exponent", 225.0, 1.0, 10000.0, scale="logarithmic", description="nu, sharpness along u"
)
RATIO = Parameter(
    "ratio", 1.0, 0.05, 20.0, scale="logarithmic", description="nv / nu; above 1 sharper along v"
)
FIRST_REFLECTANCE = Parameter("f0", 0.5, 0.02, 1.0)


@dataclass(frozen=True)
class _AshikhminShirley(Model):
    coordinate_name = "gamma"
    coordinate_maximum = math.pi / 2
    lobe = "half"
    anisotropic = True

    @abstractmethod
    def _power(self, cos2_phi: Any, sin2_phi: Any, fixed: Fixed) -> Any:
        """p(φh), the power of cosθh that the profile holds."""

    @abstractmethod
    def _frozen_lobe(self, xp: Maths, log_cos: Any, cos2_phi: Any, fixed: Fixed) -> Any:
        """The power of cosθh that the quotient holds; log_cos is −log cosθh."""

    @abstractmethod
    def _exponents(self, values: Mapping[str, Any]) -> tuple[Any, Any]:
        """nu and r."""

    @property
    def rank(self) -> int:
        return 2

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        log_cos, cos2_phi, sin2_phi = half_angles(xp, half_vector(xp, wi, wo))
        x = log_cos * self._power(cos2_phi, sin2_phi, fixed)
        return xp.atan2(xp.sqrt(one_minus_exp(xp, 2 * x)), xp.exp(-x)) * (2 / xp.pi)

    def half_angle(self, t: Float64, phi: Float64, fixed: Fixed) -> tuple[Float64, Float64]:
        gamma = t * (math.pi / 2)
        power = self._power(np.cos(phi) ** 2, np.sin(phi) ** 2, fixed)
        log_cos = -np.log(np.cos(gamma)) / power
        cosine = np.exp(-log_cos)
        sine = np.sqrt(one_minus_exp(numpy_maths, 2 * log_cos))
        return np.arctan2(sine, cosine), cosine / power * np.tan(gamma) * (math.pi / 2)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        h = half_vector(xp, wi, wo)
        cos_d = xp.minimum(xp.maximum(dot(wi, h), 1e-6), 1.0)
        log_cos, cos2_phi, _ = half_angles(xp, h)
        lobe = self._frozen_lobe(xp, log_cos, cos2_phi, fixed)
        shared = lobe / (8 * xp.pi * cos_d * xp.maximum(wi.z, wo.z))
        return [shared * f for f in schlick_basis(cos_d, fixed["f0"])]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        nu, ratio = self._exponents({**fixed, **values})
        normalisation = math.sqrt((nu + 1) * (ratio * nu + 1))
        return schlick_weights(values["color"], float(fixed["f0"])) * normalisation

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        nu, ratio = self._exponents(values)
        return lobe(xp, wi, wo, nu, ratio * nu, values["color"])


@dataclass(frozen=True)
class AshikhminShirleyRatio(_AshikhminShirley):
    """The direction and amount of anisotropy edited, the exponent frozen (2008, eq. 33–35).

    cosγ = (cosθh)^(sin²φh), f = (cosγ)^(r nu): the factor γr^r of 2008, eq. 34, over the angle
    of 2006, eq. 16, whose bins do not depend on nu.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | reflectance at normal incidence |
    | ratio | [0.05, 20] | r = nv / nu; above 1 the highlight is narrower along v |

    Frozen: exponent (nu), f0 (the reference quotient's reflectance).
    """

    name = "ashikhmin-shirley-ratio"
    parameters = (COLOUR, RATIO)
    fixed_parameters = (EXPONENT, FIRST_REFLECTANCE)

    def freeze(self, values: Values) -> dict[str, float]:
        exponent = EXPONENT.validate(values.get("exponent", EXPONENT.default))
        return {"exponent": float(exponent), "f0": first_reflectance(values["color"])}  # type: ignore[arg-type]

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return _cosine_power(t, float(values["ratio"]) * float(fixed["exponent"]))  # type: ignore[arg-type]

    def _power(self, cos2_phi: Any, sin2_phi: Any, fixed: Fixed) -> Any:
        return sin2_phi

    def _frozen_lobe(self, xp: Maths, log_cos: Any, cos2_phi: Any, fixed: Fixed) -> Any:
        return xp.exp(-fixed["exponent"] * cos2_phi * log_cos)

    def _exponents(self, values: Mapping[str, Any]) -> tuple[Any, Any]:
        return values["exponent"], values["ratio"]


@dataclass(frozen=True)
class AshikhminShirleyWidth(_AshikhminShirley):
    """The width of the highlight edited, the anisotropy frozen (2008, appendix A).

    cosγ = (cosθh)^(cos²φh + r sin²φh), f = cosⁿγ with n = nu.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | reflectance at normal incidence |
    | exponent | [1, 10000] | nu, sharpness along u; along v it is ratio · nu |

    Frozen: ratio (nv / nu), f0 (the reference quotient's reflectance).
    """

    name = "ashikhmin-shirley-width"
    parameters = (COLOUR, EXPONENT)
    fixed_parameters = (RATIO, FIRST_REFLECTANCE)

    def freeze(self, values: Values) -> dict[str, float]:
        ratio = RATIO.validate(values.get("ratio", RATIO.default))
        return {"ratio": float(ratio), "f0": first_reflectance(values["color"])}  # type: ignore[arg-type]

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return _cosine_power(t, float(values["exponent"]))  # type: ignore[arg-type]

    def _power(self, cos2_phi: Any, sin2_phi: Any, fixed: Fixed) -> Any:
        return cos2_phi + fixed["ratio"] * sin2_phi

    def _frozen_lobe(self, xp: Maths, log_cos: Any, cos2_phi: Any, fixed: Fixed) -> Any:
        return 1.0 + 0.0 * log_cos

    def _exponents(self, values: Mapping[str, Any]) -> tuple[Any, Any]:
        return values["exponent"], values["ratio"]


def lobe(xp: Maths, wi: Any, wo: Any, nu: Any, nv: Any, color: Sequence[Any]) -> list[Any]:
    """ρ of each channel (2006, eq. 11), by the paper's own formula; color: F0."""
    h = half_vector(xp, wi, wo)
    cos_d = xp.maximum(dot(wi, h), 1e-6)
    across = xp.maximum(h.x * h.x + h.y * h.y, 1e-12)
    exponent = (nu * h.x * h.x + nv * h.y * h.y) / across
    value = xp.exp(exponent * xp.log(xp.minimum(xp.maximum(h.z, 1e-6), 1.0)))
    value = value * xp.sqrt((nu + 1) * (nv + 1)) / (8 * xp.pi * cos_d)
    lit = (wi.z > 0) & (wo.z > 0)
    value = xp.select(lit, value / xp.select(lit, xp.maximum(wi.z, wo.z), 1.0), 0.0)
    grazing = schlick_weight(cos_d)
    return [value * (f0 + (1 - f0) * grazing) for f0 in color]


def half_angles(xp: Maths, h: Vector) -> tuple[Any, Any, Any]:
    """−log cosθh, with its digits near the normal, and cos²φh and sin²φh, each with its own."""
    across = h.x * h.x + h.y * h.y
    log_cos = 0.5 * log_one_plus(xp, across / xp.maximum(h.z * h.z, 1e-12))
    across = xp.maximum(across, 1e-20)
    return log_cos, h.x * h.x / across, h.y * h.y / across


def _cosine_power(t: Float64, exponent: float) -> Float64:
    return np.asarray(np.maximum(np.cos(t * (math.pi / 2)), 0.0) ** exponent)[:, None]
