"""The diffuse base under a dielectric coat: Mitsuba's `plastic` and `roughplastic`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.models.anchors import Expansion, stacked
from burnish.materials.models.cook_torrance import ROUGHNESS
from burnish.materials.models.optics import (
    SMALLEST_ROUGHNESS,
    Distribution,
    fresnel_dielectric,
)
from burnish.materials.models.transmittance import (
    TABLE_SIZE,
    internal_reflectance,
    transmittance,
)
from burnish.materials.parameter import Parameter

POWERS = (0, 1, 2, 4, 7, 12, 20, 40)
"""The initial T is kept as Σ_i t_i (1 − cosθ)^p_i: smooth numbers that a kernel can gather."""
OUTGOING_NODES = 2017
"""Samples of s(θo) for all rows of a picture: 32 between two of the transmittance's table."""
EXTRA_POWERS = (0, 2, 8)
"""(1 − cosθ)^p that let T change with roughness and ior; p = 0 keeps its energy exact."""


@dataclass(frozen=True)
class PlasticBase(Model):
    """Light that enters a coat, is scattered by a matte base, and leaves again.

        ρ = c / (1 − R c') · T(θi; α, ior) T(θo; α, ior) / (π ior²)

    T is the coat's transmittance, R its internal diffuse reflectance, c the colour and c' the
    colour (`nonlinear`) or 1 (Mitsuba 3, `roughplastic`). The roughness and ior are the
    coat's: a material links them. T(θo) is exact, as s(θo); T(θi) expands in the initial T
    and three powers of 1 − cosθi, with exact energy and directional errors of at most 5 %
    for α up to 0.6 and ior from 1.2 to 2.2 (θi below 81°).

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | albedo of the base; over a texture, its tint |
    | roughness | [0, 1] | the coat's, Mitsuba's alpha |
    | ior | [1, 3] | the coat's relative index of refraction |

    Static: distribution of the coat; nonlinear; textured: the colour is a weight map's, and
    `color` its tint. A nonlinear map is H = (1 − R0) t / (1 − R0 t) for a texture t and the
    initial R0; a later R enters through the texture's mean, and the tint scales the result.
    Frozen: t_0 … (the initial T), internal (R0), texture_r, _g, _b (the texture's mean).
    In `evaluate`, roughness and ior must be the same in all lanes: a table of T is made.
    """

    distribution: Distribution = "ggx"
    nonlinear: bool = False
    textured: bool = False

    name = "plastic-base"
    parameters = (
        Parameter("color", 0.5, kind="colour", description="albedo of the base"),
        Parameter("roughness", ROUGHNESS.default, 0.0, 1.0, scale="square"),
        Parameter("ior", 1.5, 1.0, 3.0, 1.2, 2.2, description="relative index of refraction"),
    )
    fixed_parameters = (
        *(Parameter(f"t_{i}", float(i == 0), -1e3, 1e3) for i in range(len(POWERS))),
        Parameter("internal", 0.0),
        *(Parameter(f"texture_{channel}", 1.0) for channel in "rgb"),
    )

    @property
    def rank(self) -> int:
        return 1 + len(EXTRA_POWERS)

    def freeze(self, values: Values) -> dict[str, float]:
        alpha, ior = _coat(values)
        cos, weight = _cosines()
        true = transmittance(self.distribution, alpha, ior, cos)
        fitted = Expansion(_powers(cos, POWERS), weight).weights(true)
        return {
            **{f"t_{i}": float(value) for i, value in enumerate(fitted)},
            "internal": internal_reflectance(self.distribution, alpha, ior),
            **{f"texture_{channel}": 1.0 for channel in "rgb"},
        }

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 0.5 + 0.0 * wi.z

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        leaving = _initial(wo.z, fixed) / xp.pi
        entering = [_initial(wi.z, fixed), *(_power(1 - wi.z, p) for p in EXTRA_POWERS)]
        return [leaving * factor for factor in entering]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        alpha, ior = _coat(values)
        cos, _ = _cosines()
        coefficients = tuple(float(fixed[f"t_{i}"]) for i in range(len(POWERS)))
        expansion = _expansion(coefficients)
        entering = expansion.weights(transmittance(self.distribution, alpha, ior, cos))
        colour = np.array(self._colour({**fixed, **values}, alpha, ior))
        return np.asarray(entering[:, None] * colour / (ior * ior))

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))

    def outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64 | None:
        cos = np.linspace(0.0, 1.0, OUTGOING_NODES)
        now = transmittance(self.distribution, *_coat(values), np.maximum(cos, 1e-3))
        ratio = now / np.maximum(_initial(np.maximum(cos, 1e-3), fixed), 1e-6)
        return np.asarray(np.interp(cos_theta_o, cos, ratio))[:, None]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        alpha, ior = _coat(values)
        if alpha < SMALLEST_ROUGHNESS:
            through = [1 - fresnel_dielectric(xp, w.z, ior) for w in (wi, wo)]
        else:
            samples = np.linspace(0.0, 1.0, TABLE_SIZE)
            table = transmittance(self.distribution, alpha, ior, samples)
            through = [xp.lookup(table, w.z) for w in (wi, wo)]
        lit = (wi.z > 0) & (wo.z > 0)
        lobe = xp.select(lit, through[0] * through[1] / (xp.pi * ior * ior), 0.0)
        return [colour * lobe for colour in self._colour(values, alpha, ior)]

    def _colour(self, values: Mapping[str, Any], alpha: float, ior: float) -> list[Any]:
        """c / (1 − R c'), or its change with the coat where a nonlinear map holds it."""
        inside = internal_reflectance(self.distribution, alpha, ior)
        colour = values["color"]
        if not self.nonlinear:
            return [c / (1 - inside) for c in colour]
        if not self.textured:
            return [c / (1 - inside * c) for c in colour]
        first, mean = values["internal"], [values[f"texture_{channel}"] for channel in "rgb"]
        return [
            c * (1 - first * m) / ((1 - first) * (1 - inside * m))
            for c, m in zip(colour, mean, strict=True)
        ]


def _coat(values: Mapping[str, Any]) -> tuple[float, float]:
    """Roughness and ior as plain numbers; device arrays of one entry are read back."""
    alpha, ior = (float(np.ravel(values[name])[0]) for name in ("roughness", "ior"))
    return round(alpha, 9), round(ior, 9)


def _power(x: Any, exponent: int) -> Any:
    """x to a whole power, by squaring, for NumPy and Dr.Jit alike."""
    result, square = 1.0 + 0.0 * x, x
    while exponent:
        if exponent & 1:
            result = result * square
        square, exponent = square * square, exponent >> 1
    return result


def _initial(cos: Any, fixed: Fixed) -> Any:
    """The initial T(θ), as its fit."""
    return sum(fixed[f"t_{i}"] * _power(1 - cos, power) for i, power in enumerate(POWERS))


def _powers(cos: Float64, exponents: tuple[int, ...]) -> Float64:
    return stacked([(1 - cos) ** power for power in exponents])


@lru_cache(maxsize=1)
def _cosines() -> tuple[Float64, Float64]:
    """Points in (0, 1) and weights cosθ dcosθ, like the energy of uniform light."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    cos = (nodes + 1) / 2
    return cos, cos * weights / 2


@lru_cache(maxsize=256)
def _expansion(coefficients: tuple[float, ...]) -> Expansion:
    cos, weight = _cosines()
    initial = np.tensordot(coefficients, _powers(cos, POWERS), axes=1)
    return Expansion(np.concatenate([initial[None], _powers(cos, EXTRA_POWERS)]), weight)
