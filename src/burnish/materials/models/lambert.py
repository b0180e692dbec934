"""Lambert: light leaves a matte surface evenly in all directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.maths import Maths
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter


@dataclass(frozen=True)
class Lambert(Model):
    """Diffuse reflection, ρ = color / π.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | albedo; over a texture, its tint |
    """

    name = "lambert"
    parameters = (Parameter("color", 0.5, kind="colour", description="share of light reflected"),)

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return 0.5 + 0.0 * wi.z

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [1 / xp.pi + 0.0 * wi.z]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return np.array([values["color"]], np.float64).reshape(1, 3)

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        return [xp.select(lit, color / xp.pi, 0.0) for color in values["color"]]
