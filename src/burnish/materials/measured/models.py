"""A measured BRDF as a model: table look-ups in the quotient, a factor as the curve."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from burnish.core.types import Float64
from burnish.materials.coordinates import normalised
from burnish.materials.maths import Maths, Vector, numpy_maths
from burnish.materials.measured.factors import Factors, Form, factors
from burnish.materials.measured.register import find
from burnish.materials.measured.table import ReflectanceTable
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter


@dataclass(frozen=True)
class Measured(Model):
    """One term of a factorised table: ρ · share, with one of its factors as the curve.

    Three quotients, one for each channel, q_c = ρ_c · share_c / f_c(γ), so that unedited the
    term is the interpolated table itself, however well the factors fit (2006, §4.4).

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 4] per channel, linear RGB | scales the term; 1 is as measured |

    Static: table (SHA-256 of the data, "" for a matte grey), path (its MERL file).
    """

    table: str = ""
    path: str = field(default="", compare=False)

    parameters = (
        Parameter("color", 1.0, 0.0, 4.0, 0.0, 2.0, kind="colour", description="as measured: 1"),
    )
    coordinate_maximum = math.pi / 2
    quadrature_points = 512
    form: ClassVar[Form]

    @property
    def rank(self) -> int:
        return 3

    @property
    def data(self) -> ReflectanceTable:
        """The table. Raises MissingFile, MeasurementError."""
        return find(self.table, self.path)

    @property
    def factors(self) -> Factors:
        """The factors of the table."""
        return factors(self.table, self.path, self.form)

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return normalised(xp, self.coordinate_name, wi, wo)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        rho = self.data.evaluate(xp, wi, wo)
        return [a * b for a, b in zip(rho, self._rest(xp, wi, wo), strict=True)]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return np.diag(np.asarray(values["color"], np.float64) * np.ones(3))

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        found = self.factors.evaluate(numpy_maths, self.coordinate_name, np.clip(t, 0.0, 1.0))
        return np.stack(found, axis=1)

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        up = [Vector(w.x, w.y, xp.select(lit, w.z, 1.0)) for w in (wi, wo)]
        rho, share = self.data.evaluate(xp, *up), self.share(xp, *up)
        return [
            xp.select(lit, color * r * s, 0.0)
            for color, r, s in zip(values["color"], rho, share, strict=True)
        ]

    def share(self, xp: Maths, wi: Any, wo: Any) -> list[Any]:
        """The part of each channel of ρ that is this term's; those of a material add to 1."""
        return [1.0 + 0.0 * wi.z] * 3

    def _rest(self, xp: Maths, wi: Any, wo: Any) -> list[Any]:
        """share / f(γ), per channel."""
        t = normalised(xp, self.coordinate_name, wi, wo)
        return [1 / f for f in self.factors.evaluate(xp, self.coordinate_name, t)]


@dataclass(frozen=True)
class HalfDifference(Measured):
    """Terms of ρ = q · (A(θin) A(θout) + C(θd) E(θh)), with one q (2006, eq. 18)."""

    form = "half-difference"
    diffuse: ClassVar[bool] = False

    def _all(
        self, xp: Maths, wi: Any, wo: Any
    ) -> tuple[list[Any], list[Any], list[Any], list[Any]]:
        """A(θin), A(θout), C(θd) and E(θh), per channel."""
        t = [
            ("theta_in", normalised(xp, "theta_in", wi, wo)),
            ("theta_in", normalised(xp, "theta_in", wo, wi)),
            ("theta_d", normalised(xp, "theta_d", wi, wo)),
            ("theta_h", normalised(xp, "theta_h", wi, wo)),
        ]
        light, view, difference, half = (self.factors.evaluate(xp, name, x) for name, x in t)
        return light, view, difference, half

    def share(self, xp: Maths, wi: Any, wo: Any) -> list[Any]:
        result = []
        for a, b, c, e in zip(*self._all(xp, wi, wo), strict=True):
            own = a * b if self.diffuse else c * e
            result.append(own / (a * b + c * e))
        return result

    def _rest(self, xp: Maths, wi: Any, wo: Any) -> list[Any]:
        result = []
        for a, b, c, e in zip(*self._all(xp, wi, wo), strict=True):
            other = {"theta_in": b, "theta_d": e, "theta_h": c}[self.coordinate_name]
            result.append(other / (a * b + c * e))
        return result


@dataclass(frozen=True)
class MeasuredSpecular(HalfDifference):
    """The specular term, edited over θh: f = E(θh), the measured highlight."""

    name = "measured-specular"
    coordinate_name = "theta_h"
    lobe = "half"


@dataclass(frozen=True)
class MeasuredFresnel(HalfDifference):
    """The specular term, edited over θd: f = C(θd), how it grows towards grazing angles."""

    name = "measured-fresnel"
    coordinate_name = "theta_d"
    lobe = "half"
    inverse = "axis"


@dataclass(frozen=True)
class MeasuredDiffuse(HalfDifference):
    """The diffuse term, edited over θin: f = A(θin). An `outgoing_curve` edits A(θout)."""

    name = "measured-diffuse"
    coordinate_name = "theta_in"
    inverse = "axis"
    diffuse = True


@dataclass(frozen=True)
class MeasuredHalf(Measured):
    """All of ρ = q · P(θin) Q(θh) P(θout), edited over θh: f = Q (2006, eq. 17)."""

    name = "measured-half"
    form = "homomorphic"
    coordinate_name = "theta_h"
    lobe = "half"


@dataclass(frozen=True)
class MeasuredIncident(Measured):
    """All of ρ = q · P(θin) Q(θh) P(θout), edited over θin: f = P; see `outgoing_curve`."""

    name = "measured-incident"
    form = "homomorphic"
    coordinate_name = "theta_in"
    lobe = "half"
    inverse = "axis"
