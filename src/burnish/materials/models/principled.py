"""Mitsuba's `principled`, taken apart into layers that are edited exactly or nearly so.

The model (Burley, "Physically Based Shading at Disney", 2012, as Mitsuba 3 writes it) is a
sum: a matte base with retro-reflection, sheen, a specular lobe that blends a dielectric and
a metal, and a clear coat. With base colour b, metallic m, roughness r, and the Schlick
weights Fi, Fo, Fd = (1 − cosθ)⁵ of θi, θo and θd:

- base: b (1 − m)/π · [(1 − Fi/2)(1 − Fo/2) + r · 2c²(Fi + Fo − Fi Fo) + r² · 4c⁴ Fi Fo], c = cosθd:
  three quotients, exact for every parameter;
- sheen: s (1 − m) · tint · Fd: one quotient, exact;
- specular: GGX of α = r² with the Fresnel term (1 − m)(1 − t) F(θd; ior) + a constant + a share
  of Fd: masking and the dielectric's F expand as in Cook-Torrance, all else is exact;
- coat: clearcoat/4 · D(θh) · (0.04 + 0.96 Fd) · G1(θi; ¼) G1(θo; ¼), D the GTR1 of Burley: exact.

Tints divide a colour by its luminance: t(b) = b / Y(b), white where b is black.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.colour import LUMINANCE
from burnish.core.types import Float64
from burnish.materials.maths import Maths, dot, half_vector, numpy_maths, theta_half
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.models.anchors import Expansion, stacked
from burnish.materials.models.cook_torrance import MASKING_ANCHORS, Microfacets
from burnish.materials.models.expansions import cosines, fresnel_weight
from burnish.materials.models.optics import (
    SMALLEST_ROUGHNESS,
    fresnel_dielectric,
    masking,
    schlick_weight,
)
from burnish.materials.parameter import Parameter

COLOR = Parameter("color", 0.5, kind="colour", description="base colour")
METALLIC = Parameter("metallic", 0.0, description="blends from a dielectric to a metal")
ROUGHNESS = Parameter("roughness", 0.5, description="the root of Mitsuba's alpha")

SMALLEST_SPECULAR = 1e-6
"""Below it Mitsuba's lobe vanishes whole, the metal's too."""


def ior_of_specular(specular: Any) -> Any:
    """Index of refraction of Mitsuba's `specular`: F0 = 0.08 · specular."""
    root = (0.08 * specular) ** 0.5
    return 2 / (1 - root) - 1


def specular_of_ior(ior: float) -> float:
    """The inverse of `ior_of_specular`."""
    return ((ior - 1) / (ior + 1)) ** 2 / 0.08


class _Broad(Model):
    """A layer without a curve."""

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 0.5 + 0.0 * wi.z

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))


@dataclass(frozen=True)
class PrincipledBase(_Broad):
    """The matte base with its retro-reflection; white, it reflects up to 2 % too much.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | base colour; over a texture, its tint |
    | metallic | [0, 1] | a metal has no matte base |
    | roughness | [0, 1] | strength of the retro-reflection |
    """

    name = "principled-base"
    parameters = (COLOR, METALLIC, ROUGHNESS)

    @property
    def rank(self) -> int:
        return 3

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return _base_terms(xp, wi, wo)

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        r = float(values["roughness"])  # type: ignore[arg-type]
        colour = _colour(values) * (1 - float(values["metallic"]))  # type: ignore[arg-type]
        return np.asarray(np.array([1.0, r, r * r])[:, None] * colour)

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit, r = (wi.z > 0) & (wo.z > 0), values["roughness"]
        h = half_vector(xp, wi, wo)
        retro_90 = 2 * r * dot(h, wo) * dot(h, wo)
        fi, fo = schlick_weight(wi.z), schlick_weight(wo.z)
        matte = (1 - 0.5 * fi) * (1 - 0.5 * fo)
        retro = retro_90 * (fo + fi + fo * fi * (retro_90 - 1))
        share = xp.select(lit, (matte + retro) * (1 - values["metallic"]) / xp.pi, 0.0)
        return [c * share for c in values["color"]]


def _base_terms(xp: Maths, wi: Any, wo: Any) -> list[Any]:
    """The factors of 1, r and r² in the base."""
    fi, fo = schlick_weight(wi.z), schlick_weight(wo.z)
    cos_d = dot(wo, half_vector(xp, wi, wo))
    cos2 = cos_d * cos_d
    return [
        (1 - 0.5 * fi) * (1 - 0.5 * fo) / xp.pi,
        2 * cos2 * (fi + fo - fi * fo) / xp.pi,
        4 * cos2 * cos2 * fi * fo / xp.pi,
    ]


@dataclass(frozen=True)
class PrincipledSheen(_Broad):
    """Light at grazing angles, as cloth has it.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | base colour, whose hue tints the sheen |
    | metallic | [0, 1] | a metal has no sheen |
    | sheen | [0, 1] | strength |
    | sheen_tint | [0, 1] | from white to the base colour's hue |
    """

    name = "principled-sheen"
    parameters = (
        COLOR,
        METALLIC,
        Parameter("sheen", 0.0, description="strength of the light at grazing angles"),
        Parameter("sheen_tint", 0.0, description="from white to the base colour's hue"),
    )

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [schlick_weight(_cos_d(xp, wi, wo))]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        tint = 1 + (_tint(_colour(values)) - 1) * float(values["sheen_tint"])  # type: ignore[arg-type]
        strength = float(values["sheen"]) * (1 - float(values["metallic"]))  # type: ignore[arg-type]
        return np.asarray(strength * tint[None])

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        strength = values["sheen"] * (1 - values["metallic"])
        lobe = xp.select(lit, strength * schlick_weight(_cos_d(xp, wi, wo)), 0.0)
        blend = values["sheen_tint"]
        return [lobe * (1 - blend + blend * c) for c in _tints(xp, values["color"])]


class _PrincipledMicrofacets(Microfacets):
    """GGX of α = roughness², never a delta lobe."""

    can_be_delta = False
    # A roughness of 0.6 is an α of 0.36, and one of 0.05 as good as smooth
    usual_roughness = (0.0, 0.36)

    def _tint(self, values: Mapping[str, Any]) -> Any:
        return (1.0, 1.0, 1.0)

    def freeze(self, values: Values) -> dict[str, float]:
        return super().freeze(_with_alpha(values))

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return super().amplitudes(_with_alpha(values), fixed)

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return super().profile(t, _with_alpha(values), fixed)

    def outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64 | None:
        return super().outgoing(cos_theta_o, _with_alpha(values), fixed)

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        r = values["roughness"]
        alpha = xp.maximum(r * r, SMALLEST_ROUGHNESS * 1.000001)
        return super().evaluate(xp, wi, wo, {**values, "roughness": alpha})


@dataclass(frozen=True)
class PrincipledSpecular(_PrincipledMicrofacets):
    """The specular lobe: F = (1 − m)(1 − t) F(θd; ior) + m F_metal + (1 − m) t F_tinted.

    F_metal is Schlick's with the base colour as F0; F_tinted Schlick's with the tint of the
    base colour times the dielectric's F0.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | base colour |
    | metallic | [0, 1] | blends from a dielectric to a metal |
    | roughness | [0, 1] | α = roughness² |
    | specular | [0, 1] | F0 = 0.08 · specular, ior from 1 to 1.79 |
    | spec_tint | [0, 1] | from white to the base colour's hue |

    Static: coloured: whether the layer holds the parts that depend on the base colour; over
    a texture they are the layer `PrincipledMetal`, spec_tint must be 0, and F is
    (1 − m) F(θd; ior) + m Fd.
    Frozen: masking_0 …; ior, mix and f0 of the reference quotient
    mix · F(θd; ior) + (1 − mix)(f0 + (1 − f0) Fd). F(θd; ior) of another index is fitted by the
    initial one, 1 and Fd (without 1 where not coloured).
    """

    coloured: bool = True

    name = "principled-specular"
    parameters = (
        COLOR,
        METALLIC,
        ROUGHNESS,
        Parameter("specular", 0.5, description="F0 = 0.08 × specular"),
        Parameter("spec_tint", 0.0, description="from white to the base colour's hue"),
    )
    fixed_parameters = (
        *MASKING_ANCHORS,
        Parameter("ior", 1.5, 1.0, 3.0),
        Parameter("mix", 1.0),
        Parameter("f0", 0.04),
    )

    @property
    def _fresnel_count(self) -> int:
        return 3 if self.coloured else 2

    def _fresnel_basis(self, xp: Maths, cos: Any, fixed: Fixed) -> list[Any]:
        grazing, mix, f0 = schlick_weight(cos), fixed["mix"], fixed["f0"]
        first = mix * fresnel_dielectric(xp, cos, fixed["ior"])
        first = first + (1 - mix) * (f0 + (1 - f0) * grazing)
        return [first, 1 + 0.0 * cos, grazing] if self.coloured else [first, grazing]

    def _fresnel_weights(self, values: Values, fixed: Fixed) -> Float64:
        ior, mix, f0 = (float(fixed[name]) for name in ("ior", "mix", "f0"))
        dielectric, constant, grazing = self._shares(values)
        cos = cosines()
        fitted = _dielectric_fit(ior, self.coloured).weights(
            fresnel_dielectric(numpy_maths, cos, _ior(values))
        )
        a = dielectric * fitted[0] / mix
        b = constant - a * (1 - mix) * f0
        c = grazing + dielectric * fitted[-1] - a * (1 - mix) * (1 - f0)
        if not self.coloured:
            return stacked([a * np.ones(3), c])
        return stacked([a * np.ones(3), b + dielectric * fitted[1], c])

    def _shares(self, values: Values) -> tuple[float, Float64, Float64]:
        """What multiplies the dielectric's F, 1 and Fd."""
        m, t = float(values["metallic"]), float(values["spec_tint"])  # type: ignore[arg-type]
        if not self.coloured:
            return 1 - m, np.zeros(3), m * np.ones(3)
        colour = _colour(values)
        tinted = _tint(colour) * 0.08 * max(float(values["specular"]), SMALLEST_SPECULAR)  # type: ignore[arg-type]
        metal, rest = m * colour, (1 - m) * t
        return (1 - m) * (1 - t), metal + rest * tinted, m - metal + rest * (1 - tinted)

    def _fresnel(self, xp: Maths, cos: Any, values: Mapping[str, Any]) -> list[Any]:
        m, t = values["metallic"], values["spec_tint"]
        specular = xp.maximum(values["specular"], SMALLEST_SPECULAR)
        plain = fresnel_dielectric(xp, cos, ior_of_specular(specular))
        grazing = schlick_weight(cos)
        if not self.coloured:
            return [(1 - m) * plain + m * grazing] * 3
        result = []
        for colour, tint in zip(values["color"], _tints(xp, values["color"]), strict=True):
            f0 = tint * 0.08 * specular
            metal = colour + (1 - colour) * grazing
            tinted = f0 + (1 - f0) * grazing
            result.append((1 - m) * ((1 - t) * plain + t * tinted) + m * metal)
        return result

    def _freeze_fresnel(self, values: Values) -> dict[str, float]:
        dielectric, constant, grazing = self._shares(values)
        mix = min(1.0, max(0.05, dielectric))
        rest = constant.mean() / max(float((constant + grazing).mean()), 1e-9)
        f0 = float(rest) if mix < 1 else 0.0
        return {"ior": _ior(values), "mix": mix, "f0": min(max(f0, 0.0), 1.0)}


@dataclass(frozen=True)
class PrincipledMetal(_PrincipledMicrofacets):
    """What a metal's base colour multiplies, m (1 − Fd): for textured base colours.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | tint of the texture |
    | metallic | [0, 1] | m |
    | roughness | [0, 1] | α = roughness² |
    """

    name = "principled-metal"
    parameters = (COLOR, METALLIC, ROUGHNESS)
    fixed_parameters = MASKING_ANCHORS

    @property
    def _fresnel_count(self) -> int:
        return 1

    def _fresnel_basis(self, xp: Maths, cos: Any, fixed: Fixed) -> list[Any]:
        return [1 - schlick_weight(cos)]

    def _fresnel_weights(self, values: Values, fixed: Fixed) -> Float64:
        return float(values["metallic"]) * _colour(values)[None]  # type: ignore[arg-type]

    def _fresnel(self, xp: Maths, cos: Any, values: Mapping[str, Any]) -> list[Any]:
        share = values["metallic"] * (1 - schlick_weight(cos))
        return [c * share for c in values["color"]]

    def _freeze_fresnel(self, values: Values) -> dict[str, float]:
        return {}


COAT_MASKING = 0.25
"""The roughness α of the coat's masking, whatever its gloss."""


@dataclass(frozen=True)
class PrincipledCoat(Model):
    """The clear coat: a sharp lobe with a long tail.

    | parameter | range | meaning |
    |---|---|---|
    | clearcoat | [0, 1] | strength |
    | clearcoat_gloss | [0, 1] | from satin (α = 0.1) to gloss (α = 0.001) |
    """

    name = "principled-coat"
    parameters = (
        Parameter("clearcoat", 0.0, description="strength of the coat"),
        Parameter("clearcoat_gloss", 0.0, description="from satin to gloss"),
    )
    coordinate_name = "theta_h"
    coordinate_maximum = math.pi / 2
    lobe = "half"

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return theta_half(xp, wi, wo) * (2 / xp.pi)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [_coat_quotient(xp, wi, wo)]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return np.full((1, 3), float(values["clearcoat"]))  # type: ignore[arg-type]

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        theta = t * self.coordinate_maximum
        gloss = float(values["clearcoat_gloss"])  # type: ignore[arg-type]
        return np.asarray(_gtr1(numpy_maths, np.sin(theta) ** 2, gloss))[:, None]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        h = half_vector(xp, wi, wo)
        density = _gtr1(xp, h.x * h.x + h.y * h.y, values["clearcoat_gloss"])
        lobe = values["clearcoat"] * density * _coat_quotient(xp, wi, wo)
        return [xp.select((wi.z > 0) & (wo.z > 0), lobe, 0.0)] * 3


def _coat_quotient(xp: Maths, wi: Any, wo: Any) -> Any:
    shadow = [masking(xp, "ggx", w.z, COAT_MASKING) for w in (wi, wo)]
    fresnel = 0.04 + 0.96 * schlick_weight(_cos_d(xp, wi, wo))
    return 0.25 * fresnel * shadow[0] * shadow[1]


def _gtr1(xp: Maths, sin2: Any, gloss: Any) -> Any:
    """D(θh) of Burley's GTR1 (2012, eq. 4), whose α goes from 0.1 to 0.001."""
    alpha = 0.1 + (0.001 - 0.1) * gloss
    alpha2 = alpha * alpha
    # 1 + (α² − 1) cos²θ, with its digits where both terms nearly cancel
    spread = sin2 + alpha2 * (1 - sin2)
    return (alpha2 - 1) / (xp.pi * xp.log(alpha2) * spread)


def _cos_d(xp: Maths, wi: Any, wo: Any) -> Any:
    return xp.minimum(xp.maximum(dot(wo, half_vector(xp, wi, wo)), 0.0), 1.0)


def _colour(values: Values) -> Float64:
    return np.asarray(values["color"], np.float64) * np.ones(3)


def _tint(colour: Float64) -> Float64:
    luminance = float(colour @ LUMINANCE)
    return colour / luminance if luminance > 0 else np.ones(3)


def _tints(xp: Maths, colour: Any) -> list[Any]:
    weights = [float(w) for w in LUMINANCE]
    luminance = sum(w * c for w, c in zip(weights, colour, strict=True))
    bright = luminance > 0
    return [xp.select(bright, c / xp.select(bright, luminance, 1.0), 1.0) for c in colour]


def _with_alpha(values: Values) -> Values:
    r = float(values["roughness"])  # type: ignore[arg-type]
    return {**values, "roughness": max(r * r, SMALLEST_ROUGHNESS)}


def _ior(values: Values) -> float:
    specular = max(float(values["specular"]), SMALLEST_SPECULAR)  # type: ignore[arg-type]
    return float(ior_of_specular(specular))


def _dielectric_fit(ior: float, constant: bool) -> Expansion:
    """F(θd; any index) over F(θd; ior), 1 (if `constant`) and Fd."""
    cos = cosines()
    own = fresnel_dielectric(numpy_maths, cos, ior)
    rows = [own, np.ones_like(cos), schlick_weight(cos)]
    if not constant:
        del rows[1]
    return Expansion(stacked(rows), fresnel_weight(own))
