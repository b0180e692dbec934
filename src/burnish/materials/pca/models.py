"""The six models of the 2010 paper, each as edited and fixed term (its tables 3 and 4).

| model | fixed term fF / ρs | edited term fE |
|---|---|---|
| Blinn-Phong | 1 | (γ + 2) / 2π · cos^γ δ |
| Ward | 1 / √(cosθi cosθo) | exp(−tan²δ / γ²) / 4πγ² |
| Ward-Duer | 1 / (cosθi cosθo) | the same |
| Lafortune | 1 | (γ + 2) / 2π · u^γ |
| Cook-Torrance | G F / (cosθi cosθo cos⁴δ) | exp(−tan²δ / γ²) / πγ² |
| Ashikhmin-Shirley | F / (cosθd max(cosθi, cosθo)) | (γ + 1) / 8π · cos^γ δ |

δ is the angle θh between the half vector and the normal, u = (Cx lx vx + Cy ly vy + Cz lz vz) /
max |C|, and γ the parameter that is edited, in the ranges of table 5. The formulae are the
paper's, its normalisations too: what each reflects at most is said by its model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths, dot, half_vector, theta_half
from burnish.materials.model import Fixed, Values
from burnish.materials.models.optics import schlick_weight
from burnish.materials.parameter import Parameter
from burnish.materials.pca.model import SPECULAR, ComponentModel

EXPONENT = Parameter("exponent", 50.0, 3.0, 300.0, scale="logarithmic", description="γ, sharpness")
ROUGHNESS = Parameter(
    "roughness", 0.2, 0.05, 2.0, scale="logarithmic", description="γ, spread of the slopes"
)
F0 = Parameter("f0", 0.5, 0.0, 1.0, description="reflectance at normal incidence")


@dataclass(frozen=True)
class _OverHalfAngle(ComponentModel):
    """Terms of δ = θh; x = √(δ / 90°), so that nodes are dense about the highlight."""

    def position(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return xp.sqrt(theta_half(xp, wi, wo) * (2 / xp.pi))


@dataclass(frozen=True)
class _WithFresnel(_OverHalfAngle):
    """Terms with Schlick's Fresnel factor, whose F0 is frozen (2010, §4)."""

    fixed_parameters = (F0,)

    def freeze(self, values: Values) -> dict[str, float]:
        return {"f0": float(F0.validate(values.get("f0", F0.default)))}  # type: ignore[arg-type]


@dataclass(frozen=True)
class BlinnPhongComponents(_OverHalfAngle):
    """Blinn-Phong by principal components: ρ = ρs (γ + 2) / 2π · cos^γ θh.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ρs; at most 4 ρs of the light is reflected |
    | exponent | [3, 300] | γ, sharpness |

    Seven components and the mean for the default error of 1e-3.
    """

    name = "blinn-phong-pca"
    parameters = (SPECULAR, EXPONENT)
    gamma = "exponent"

    def term(self, gamma: Float64, x: Float64) -> Float64:
        return (gamma + 2) / (2 * math.pi) * _cosine(x) ** gamma

    def fixed_term(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 1.0 + 0.0 * wi.z

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        n = values["exponent"]
        cos = half_vector(xp, wi, wo).z
        lit = (wi.z > 0) & (wo.z > 0)
        lobe = xp.select(lit, _power(xp, cos, n) * (n + 2) / (2 * xp.pi), 0.0)
        return [color * lobe for color in values["color"]]


@dataclass(frozen=True)
class WardComponents(_OverHalfAngle):
    """Isotropic Ward by principal components.

    ρ = ρs exp(−tan²θh / γ²) / (4πγ² √(cosθi cosθo)) (Ward 1992).

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ρs; no more of uniform light is reflected |
    | roughness | [0.05, 2] | γ, spread of the slopes |
    """

    name = "ward-pca"
    parameters = (SPECULAR, ROUGHNESS)
    gamma = "roughness"
    power: ClassVar[float] = 0.5
    """Of cosθi cosθo, in the denominator."""

    def term(self, gamma: Float64, x: Float64) -> Float64:
        return _gaussian(gamma, x) / (4 * math.pi * gamma**2)

    def fixed_term(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 1 / xp.sqrt(wi.z * wo.z)

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        gamma2 = values["roughness"] * values["roughness"]
        h = half_vector(xp, wi, wo)
        tan2 = (h.x * h.x + h.y * h.y) / xp.maximum(h.z * h.z, 1e-12)
        cosines = xp.select(lit, wi.z * wo.z, 1.0)
        cosines = xp.sqrt(cosines) if self.power == 0.5 else cosines
        lobe = xp.select(lit, xp.exp(-tan2 / gamma2) / (4 * xp.pi * gamma2 * cosines), 0.0)
        return [color * lobe for color in values["color"]]


@dataclass(frozen=True)
class WardDuerComponents(WardComponents):
    """Ward in Dür's form by principal components.

    ρ = ρs exp(−tan²θh / γ²) / (4πγ² cosθi cosθo) (Dür 2006). It keeps the light that Ward's
    form loses towards grazing angles, and reflects many times what it receives there.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ρs; no more of uniform light is reflected |
    | roughness | [0.05, 2] | γ, spread of the slopes |
    """

    name = "ward-duer-pca"
    power = 1.0

    def fixed_term(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 1 / (wi.z * wo.z)


@dataclass(frozen=True)
class LafortuneComponents(ComponentModel):
    """A lobe of Lafortune's by principal components (Lafortune et al. 1997).

    ρ = ρs (γ + 2) / 2π · u^γ with u = (cxy (lx vx + ly vy) + cz lz vz) / max(|cxy|, cz), nothing
    where u < 0. cxy = −1 and cz = 1 is Phong's lobe about the mirror direction; a smaller cz leans
    it towards grazing angles, cxy > 0 sends light back, and cxy = 0 is matte.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ρs; for cxy = −cz the albedo at normal incidence |
    | exponent | [3, 300] | γ, sharpness |

    Frozen: cxy, cz. Cx and Cy are one number here: the lobe is isotropic.
    """

    name = "lafortune-pca"
    parameters = (SPECULAR, EXPONENT)
    fixed_parameters = (
        Parameter("cxy", -1.0, -1.0, 1.0, description="Cx and Cy"),
        Parameter("cz", 1.0, 0.05, 1.0, description="Cz"),
    )
    gamma = "exponent"

    def freeze(self, values: Values) -> dict[str, float]:
        return {
            item.name: float(item.validate(values.get(item.name, item.default)))  # type: ignore[arg-type]
            for item in self.fixed_parameters
        }

    def term(self, gamma: Float64, x: Float64) -> Float64:
        return (gamma + 2) / (2 * math.pi) * np.maximum(1 - x * x, 0.0) ** gamma

    def position(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        """x = √(1 − u)."""
        u = _lafortune(xp, wi, wo, fixed)
        return xp.sqrt(xp.minimum(xp.maximum(1 - u, 0.0), 1.0))

    def fixed_term(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 1.0 + 0.0 * wi.z

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        n, u = values["exponent"], _lafortune(xp, wi, wo, values)
        lit = (wi.z > 0) & (wo.z > 0) & (u > 0)
        lobe = xp.select(lit, _power(xp, u, n) * (n + 2) / (2 * xp.pi), 0.0)
        return [color * lobe for color in values["color"]]


@dataclass(frozen=True)
class CookTorranceComponents(_WithFresnel):
    """Cook-Torrance by principal components, with V-groove masking.

    ρ = ρs G F / (cosθi cosθo cos⁴θh) · exp(−tan²θh / γ²) / πγ²,
    G = min(1, 2 cosθh cosθo / cosθd, 2 cosθh cosθi / cosθd) (Cook and Torrance 1982),
    and Schlick's F.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ρs; at most 4 ρs of the light is reflected |
    | roughness | [0.1, 2] | γ, spread of the slopes: Beckmann's m |

    Frozen: f0, the reflectance at normal incidence.
    """

    name = "cook-torrance-pca"
    parameters = (
        SPECULAR,
        Parameter(
            "roughness", 0.2, 0.1, 2.0, scale="logarithmic", description="γ, spread of the slopes"
        ),
    )
    gamma = "roughness"

    def term(self, gamma: Float64, x: Float64) -> Float64:
        return _gaussian(gamma, x) / (math.pi * gamma**2)

    def fixed_term(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        h = half_vector(xp, wi, wo)
        cos2 = xp.maximum(h.z * h.z, 1e-12)
        masked = _grooves(xp, wi, wo, h) * _fresnel(xp, wi, h, fixed["f0"])
        return masked / (wi.z * wo.z * cos2 * cos2)

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        h, gamma2 = half_vector(xp, wi, wo), values["roughness"] * values["roughness"]
        cos2 = xp.maximum(h.z * h.z, 1e-12)
        facets = xp.exp(-(h.x * h.x + h.y * h.y) / (cos2 * gamma2)) / (gamma2 * cos2 * cos2)
        cosines = xp.select(lit, wi.z * wo.z, 1.0)
        lobe = facets * _grooves(xp, wi, wo, h) * _fresnel(xp, wi, h, values["f0"])
        lobe = xp.select(lit, lobe / (xp.pi * cosines), 0.0)
        return [color * lobe for color in values["color"]]


@dataclass(frozen=True)
class AshikhminShirleyComponents(_WithFresnel):
    """Isotropic Ashikhmin-Shirley by principal components.

    ρ = ρs F / (cosθd max(cosθi, cosθo)) · (γ + 1) / 8π · cos^γ θh (Ashikhmin and Shirley 2000).

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | ρs, at most what is reflected |
    | exponent | [3, 300] | γ, sharpness |

    Frozen: f0, the reflectance at normal incidence.
    """

    name = "ashikhmin-shirley-pca"
    parameters = (SPECULAR, EXPONENT)
    gamma = "exponent"

    def term(self, gamma: Float64, x: Float64) -> Float64:
        return (gamma + 1) / (8 * math.pi) * _cosine(x) ** gamma

    def fixed_term(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        h = half_vector(xp, wi, wo)
        cos_d = xp.maximum(dot(wi, h), 1e-6)
        return _fresnel(xp, wi, h, fixed["f0"]) / (cos_d * xp.maximum(wi.z, wo.z))

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        n, h = values["exponent"], half_vector(xp, wi, wo)
        below = xp.maximum(dot(wi, h), 1e-6) * xp.select(lit, xp.maximum(wi.z, wo.z), 1.0)
        lobe = _power(xp, h.z, n) * (n + 1) / (8 * xp.pi) * _fresnel(xp, wi, h, values["f0"])
        return [color * xp.select(lit, lobe / below, 0.0) for color in values["color"]]


SIX = (
    BlinnPhongComponents,
    WardComponents,
    WardDuerComponents,
    LafortuneComponents,
    CookTorranceComponents,
    AshikhminShirleyComponents,
)


def _cosine(x: Float64) -> Float64:
    """cos δ at x = √(δ / 90°)."""
    return np.asarray(np.maximum(np.cos(math.pi / 2 * x * x), 0.0))


def _gaussian(gamma: Float64, x: Float64) -> Float64:
    tangent = np.tan(math.pi / 2 * np.minimum(x * x, 1 - 1e-9))
    return np.asarray(np.exp(-((tangent / gamma) ** 2)))


def _power(xp: Maths, base: Any, exponent: Any) -> Any:
    return xp.exp(exponent * xp.log(xp.minimum(xp.maximum(base, 1e-6), 1.0)))


def _lafortune(xp: Maths, wi: Any, wo: Any, numbers: Mapping[str, Any]) -> Any:
    cxy, cz = numbers["cxy"], numbers["cz"]
    across = wi.x * wo.x + wi.y * wo.y
    return (cxy * across + cz * wi.z * wo.z) / xp.maximum(xp.abs(cxy), cz)


def _grooves(xp: Maths, wi: Any, wo: Any, h: Any) -> Any:
    """G, the V-grooves' masking and shadowing."""
    twice = 2 * h.z / xp.maximum(dot(wi, h), 1e-6)
    return xp.minimum(1.0 + 0.0 * wi.z, twice * xp.minimum(wi.z, wo.z))


def _fresnel(xp: Maths, wi: Any, h: Any, f0: Any) -> Any:
    return f0 + (1 - f0) * schlick_weight(xp.minimum(xp.maximum(dot(wi, h), 0.0), 1.0))
