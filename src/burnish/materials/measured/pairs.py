"""Terms of a measured BRDF with both of their factors as curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.coordinates import normalised
from burnish.materials.maths import Maths, numpy_maths
from burnish.materials.measured.models import HalfDifference, Measured
from burnish.materials.model import Fixed, Values
from burnish.materials.two_curves import TwoCurves


@dataclass(frozen=True)
class _Pair(TwoCurves, Measured):
    """Two factors, over the angles of `names`, are the curves."""

    def coordinates(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> tuple[Any, Any]:
        first, second = (normalised(xp, name, wi, wo) for name in self.names)
        return first, second

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return self._factor(0, t)

    def second_profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return self._factor(1, t)

    def _factor(self, side: int, t: Float64) -> Float64:
        found = self.factors.evaluate(numpy_maths, self.names[side], np.clip(t, 0.0, 1.0))
        return np.stack(found, axis=1)


@dataclass(frozen=True)
class MeasuredHalfDifference(_Pair, HalfDifference):
    """The specular term of a measured BRDF over θh and θd: f_A = E, f_B = C (2006, eq. 18).

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 4] per channel, linear RGB | scales the term; 1 is as measured |

    Static: table, path (see `measured`), bins (over θh), bins2 (over θd).
    """

    name = "measured-half-difference"
    names = ("theta_h", "theta_d")

    def _rest(self, xp: Maths, wi: Any, wo: Any) -> list[Any]:
        parts = zip(*self._all(xp, wi, wo), strict=True)
        return [1 / (a * b + c * e) for a, b, c, e in parts]


@dataclass(frozen=True)
class MeasuredHomomorphic(_Pair):
    """All of a measured ρ = q · P(θin) Q(θh) P(θout), over θh and θin: f_A = Q, f_B = P
    (McCool et al. 2001; 2006, eq. 17). An `outgoing_curve` edits P(θout).

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 4] per channel, linear RGB | scales it; 1 is as measured |

    Static: table, path (see `measured`), bins (over θh), bins2 (over θin).
    """

    name = "measured-homomorphic"
    form = "homomorphic"
    names = ("theta_h", "theta_in")

    def _rest(self, xp: Maths, wi: Any, wo: Any) -> list[Any]:
        sides = [
            self.factors.evaluate(xp, name, normalised(xp, name, wi, wo)) for name in self.names
        ]
        return [1 / (q * p) for q, p in zip(*sides, strict=True)]
