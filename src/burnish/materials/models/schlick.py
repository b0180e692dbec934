"""Schlick's model of 1994: rational functions in place of microfacet theory's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths, dot, half_vector, theta_half
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.models.anchors import Expansion, stacked
from burnish.materials.models.expansions import cosines
from burnish.materials.models.optics import (
    first_reflectance,
    schlick_basis,
    schlick_weight,
    schlick_weights,
)
from burnish.materials.parameter import Parameter

ROUGHNESS = Parameter(
    "roughness", 0.02, 1e-4, 1.0, scale="square", description="r, about the square of an alpha"
)
ANCHORS = 3
"""Roughnesses whose G span the others'."""


@dataclass(frozen=True)
class Schlick(Model):
    """ρ = S(θd) · G(θi; r) G(θo; r) Z(θh; r) / (4π cosθi cosθo) (Schlick 1994, §4).

    S = F0 + (1 − F0)(1 − cosθd)⁵, Z = r / (sin²θh + r cos²θh)² and G(θ) = cosθ / (r + (1 − r)
    cosθ); isotropic (A = 1), and without the paper's diffuse term (1 − G G')/π, which a matte
    layer can stand for. Z is the curve. S is split into two quotients (2008, eq. 31–32); G(θo)
    is exact, as s(θo); G(θi) expands in the G of three roughnesses, exact at the initial r.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | F0, reflectance at normal incidence |
    | roughness | [0.0001, 1] | r; the square of Cook-Torrance's α gives a like lobe |

    Frozen: f0 (the reference quotient's reflectance), masking_0, _1, _2 (the anchors of G).
    """

    name = "schlick"
    parameters = (
        Parameter("color", 0.5, kind="colour", description="reflectance at normal incidence"),
        ROUGHNESS,
    )
    fixed_parameters = (
        Parameter("f0", 0.5, 0.02, 1.0),
        *(Parameter(f"masking_{m}", r) for m, r in enumerate((0.02, 0.0, 0.5))),
    )
    coordinate_name = "theta_h"
    coordinate_maximum = math.pi / 2
    lobe = "half"

    @property
    def rank(self) -> int:
        return 2 * ANCHORS

    def freeze(self, values: Values) -> dict[str, float]:
        r = float(values["roughness"])  # type: ignore[arg-type]
        others = sorted((0.0, 0.1, 0.5), key=lambda other: -abs(other**0.5 - r**0.5))[:2]
        anchors = {f"masking_{m}": anchor for m, anchor in enumerate((r, *others))}
        return {"f0": first_reflectance(values["color"]), **anchors}

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return theta_half(xp, wi, wo) * (2 / xp.pi)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        cos_d = xp.minimum(xp.maximum(dot(wi, half_vector(xp, wi, wo)), 0.0), 1.0)
        shared = _masking_over_cosine(wo.z, fixed["masking_0"]) / (4 * xp.pi)
        shadow = [
            shared * _masking_over_cosine(wi.z, fixed[f"masking_{m}"]) for m in range(ANCHORS)
        ]
        return [s * g for s in schlick_basis(cos_d, fixed["f0"]) for g in shadow]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        anchors = tuple(float(fixed[f"masking_{m}"]) for m in range(ANCHORS))
        r = float(values["roughness"])  # type: ignore[arg-type]
        g = _expansion(anchors).weights(cosines() * _masking_over_cosine(cosines(), r))
        fresnel = schlick_weights(values["color"], float(fixed["f0"]))
        return np.asarray((fresnel[:, None, :] * g[None, :, None]).reshape(self.rank, 3))

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        r = float(values["roughness"])  # type: ignore[arg-type]
        sin2 = np.sin(t * self.coordinate_maximum) ** 2
        return np.asarray(r / (sin2 + r * (1 - sin2)) ** 2)[:, None]

    def outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64 | None:
        r = float(values["roughness"])  # type: ignore[arg-type]
        now = _masking_over_cosine(cos_theta_o, r)
        return np.asarray(now / _masking_over_cosine(cos_theta_o, float(fixed["masking_0"])))[
            :, None
        ]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        r = values["roughness"]
        h = half_vector(xp, wi, wo)
        grazing = schlick_weight(xp.minimum(xp.maximum(dot(wi, h), 0.0), 1.0))
        spread = h.x * h.x + h.y * h.y + r * h.z * h.z
        lit = (wi.z > 0) & (wo.z > 0)
        cos_i, cos_o = xp.select(lit, wi.z, 1.0), xp.select(lit, wo.z, 1.0)
        masked = cos_i * cos_o / ((r + (1 - r) * cos_i) * (r + (1 - r) * cos_o))
        lobe = xp.select(lit, r / (spread * spread) * masked / (4 * xp.pi * cos_i * cos_o), 0.0)
        return [lobe * (f0 + (1 - f0) * grazing) for f0 in values["color"]]


def _masking_over_cosine(cos: Any, r: Any) -> Any:
    """G(θ; r) / cosθ."""
    return 1 / (r + (1 - r) * cos)


@lru_cache(maxsize=64)
def _expansion(anchors: tuple[float, ...]) -> Expansion:
    cos = cosines()
    return Expansion(stacked([cos * _masking_over_cosine(cos, r) for r in anchors]), cos**0.75)
