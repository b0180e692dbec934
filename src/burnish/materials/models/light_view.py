"""Light-View: a diffuse lobe that is a product of a factor per direction."""

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
class LightView(Model):
    """ρ = color · (p + 2) / 2π · G(θin) H(θout), G = cosᵖθin and H = cos^qθout.

    The diffuse half of 2006, eq. 18 ("LV" of its table 1), with the two factors as powers of
    the cosine: with p = q it is Minnaert's law (1941, k = p + 1). G is the curve and H the
    exact factor s(θo), which a freehand `outgoing_curve` edits too. Reciprocal where p = q.
    The directional albedo is color · cos^qθo.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | albedo at normal incidence |
    | light_falloff | [0, 8] | p: how fast slanting light loses its effect; 0 is Lambert |
    | view_falloff | [0, 8] | q: how fast the surface darkens towards its rim |
    """

    name = "light-view"
    parameters = (
        Parameter("color", 0.5, kind="colour", description="albedo at normal incidence"),
        Parameter("light_falloff", 0.5, 0.0, 8.0, 0.0, 3.0, description="power of cos θin"),
        Parameter("view_falloff", 0.5, 0.0, 8.0, 0.0, 3.0, description="power of cos θout"),
    )
    coordinate_name = "theta_in"
    coordinate_maximum = math.pi / 2
    inverse = "axis"

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return normalised(xp, "theta_in", wi, wo)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [1 / (2 * xp.pi) + 0.0 * wi.z]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        p = float(values["light_falloff"])  # type: ignore[arg-type]
        return np.asarray(values["color"], np.float64).reshape(1, 3) * (p + 2)

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        cosine = np.maximum(np.cos(t * self.coordinate_maximum), 0.0)
        return np.asarray(cosine ** float(values["light_falloff"]))[:, None]  # type: ignore[arg-type]

    def outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64 | None:
        return np.asarray(cos_theta_o ** float(values["view_falloff"]))[:, None]  # type: ignore[arg-type]

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        p, q = values["light_falloff"], values["view_falloff"]
        lit = (wi.z > 0) & (wo.z > 0)
        light, view = (xp.log(xp.maximum(w.z, 1e-12)) for w in (wi, wo))
        lobe = xp.select(lit, xp.exp(p * light + q * view) * (p + 2) / (2 * xp.pi), 0.0)
        return [color * lobe for color in values["color"]]
