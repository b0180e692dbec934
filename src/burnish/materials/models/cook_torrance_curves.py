"""Cook-Torrance over two curves: the slopes over θh, and the exact Fresnel curve over θd."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.coordinates import normalised
from burnish.materials.maths import Maths, numpy_maths, theta_half
from burnish.materials.model import Fixed, Values
from burnish.materials.models.cook_torrance import MASKING_ANCHORS, ROUGHNESS, Microfacets
from burnish.materials.models.optics import fresnel_conductor
from burnish.materials.parameter import Parameter
from burnish.materials.two_curves import TwoCurves


@dataclass(frozen=True)
class CookTorranceCurves(TwoCurves, Microfacets):
    """A metal or a dielectric whose highlight and Fresnel curve are two curves (2006, eq. 10).

        ρ = color · D(θh; α) F(θd; η, k) · G1(θi; α) G1(θo; α) / (4 cosθi cosθo)

    D is the first curve and F, exact for the n and k of each channel, the second: no expansion
    of the Fresnel term limits what one metal can be edited into. k = 0 is a dielectric. Masking
    is that of `cook_torrance`: G1(θo) exact, G1(θi) expanded about the initial α.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | multiplies the reflection |
    | roughness | [0.001, 1] | Mitsuba's alpha |
    | eta | [0, 10] per channel | real part of the index of refraction; 0 is an ideal mirror |
    | k | [0, 20] per channel | its imaginary part |

    Static: distribution, masking_terms, bins (over θh), bins2 (over θd). Frozen: masking_0 ….
    It has no perfectly smooth lobe.
    """

    name = "cook-torrance-curves"
    parameters = (
        Parameter("color", 1.0, kind="colour", description="multiplies the reflection"),
        ROUGHNESS,
        Parameter("eta", 0.0, 0.0, 10.0, kind="colour", description="index of refraction"),
        Parameter("k", 1.0, 0.0, 20.0, kind="colour", description="extinction coefficient"),
    )
    fixed_parameters = MASKING_ANCHORS
    coordinate_maximum = math.pi / 2
    can_be_delta = False
    names = ("theta_h", "theta_d")

    def __post_init__(self) -> None:
        TwoCurves.__post_init__(self)
        Microfacets.__post_init__(self)

    def coordinates(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> tuple[Any, Any]:
        return theta_half(xp, wi, wo) * (2 / xp.pi), normalised(xp, "theta_d", wi, wo)

    def second_profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        cos = np.cos(np.clip(t, 0.0, 1.0) * self.coordinate_maximum)
        return np.stack(self._fresnel(numpy_maths, cos, values), axis=1)

    @property
    def _fresnel_count(self) -> int:
        return 1

    def _fresnel_basis(self, xp: Maths, cos: Any, fixed: Fixed) -> list[Any]:
        return [1.0 + 0.0 * cos]

    def _fresnel_weights(self, values: Values, fixed: Fixed) -> Float64:
        return np.ones((1, 3))

    def _fresnel(self, xp: Maths, cos: Any, values: Mapping[str, Any]) -> list[Any]:
        pairs = zip(values["eta"], values["k"], strict=True)
        return [fresnel_conductor(xp, cos, eta, k) for eta, k in pairs]

    def _mended(
        self, cos_theta_o: Float64, alpha: float, values: Values, fixed: Fixed
    ) -> Float64 | None:
        return None

    def _freeze_fresnel(self, values: Values) -> dict[str, float]:
        return {}
