"""Models with two editable curves: ρ = s(θo) Σ_k a_k q_k(ωi, ωo) f_A(γ_A) f_B(γ_B).

(2006, eq. 9 and table 1.) Boxes of γ_A and of γ_B make a grid, and what a path tracer sees is
the box of the grid that a pair of directions falls into: `coordinate` is its number,
j · bins2 + l, with half a box added, over the number of all of them. So everything that stores or
sorts by one coordinate serves two as well; a layer has bins · bins2 boxes of even spacing.

Coefficients are outer products (eq. 23): c_kjl = A_kj B_kl, each side averaged over its own bins.
While one curve is edited the other is dormant, and the transport is contracted over it once
(eq. 26, `runtime.switching`).
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.maths import Maths
from burnish.materials.model import Fixed, Model, Values

MAXIMUM_BOXES = 1 << 16
"""Of both curves together."""
USUAL_BOXES = 1 << 14
"""As many as 2006, table 3, has: 128 × 128 or 256 × 64."""


@dataclass(frozen=True)
class Axis:
    """One of the curves: its angle's symbol, γ_max in radians, and its bins.

    Bin edges lie at t = (j / bins) ** spacing.
    """

    name: str
    maximum: float
    bins: int
    spacing: float

    @property
    def edges(self) -> Float64:
        """Bin edges in t: float64 [bins + 1], from 0 to 1."""
        return np.linspace(0.0, 1.0, self.bins + 1) ** self.spacing

    def bin_of(self, xp: Maths, t: Any) -> Any:
        """The bin of t in [0, 1], a whole number in floating point."""
        u = xp.maximum(t, 0.0)
        if self.spacing == 2.0:
            u = xp.sqrt(u)
        elif self.spacing != 1.0:
            u = xp.power(u, 1 / self.spacing)
        return xp.floor(xp.minimum(u * self.bins, self.bins - 0.5))


@dataclass(frozen=True)
class TwoCurves(Model):
    """A model of this module's form. bins, bins2: of the first and of the second curve.

    The first coordinate is an angle of the half vector, which `half_angle` inverts, of a model
    that is isotropic; others answer `half_vectors`.
    """

    bins: int = 128
    bins2: int = 32

    coordinate_name = "boxes"
    coordinate_maximum = np.pi / 2
    lobe = "half"
    inverse = "none"
    names: ClassVar[tuple[str, str]]
    """The symbols of γ_A and γ_B."""
    spacings: ClassVar[tuple[float, float]] = (2.0, 1.0)

    def __post_init__(self) -> None:
        if min(self.bins, self.bins2) < 1 or self.bins * self.bins2 > MAXIMUM_BOXES:
            raise InvalidValue(
                f"the bins of two curves must be 1 or more, {MAXIMUM_BOXES} boxes together; "
                f"got {self.bins} × {self.bins2}"
            )

    @property
    def axes(self) -> tuple[Axis, Axis]:
        """The first curve's axis and the second one's."""
        first, second = (
            Axis(name, self.coordinate_maximum, bins, spacing)
            for name, bins, spacing in zip(
                self.names, (self.bins, self.bins2), self.spacings, strict=True
            )
        )
        return first, second

    @property
    def boxes(self) -> int:
        """How many pairs of bins there are."""
        return self.bins * self.bins2

    def with_bins(self, bins: int, bins2: int | None = None) -> Self:
        """The same model with other bins."""
        return replace(self, bins=bins, bins2=self.bins2 if bins2 is None else bins2)

    @abstractmethod
    def coordinates(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> tuple[Any, Any]:
        """t = γ / γ_max in [0, 1] of the first curve and of the second."""

    @abstractmethod
    def second_profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        """f_B(t): float64 [len(t), 3 or 1]; `profile` is f_A."""

    def half_vectors(
        self, t: Float64, t2: Float64, fixed: Fixed
    ) -> tuple[Float64, Float64, Float64] | None:
        """θh and φh, in the first quadrant, where the coordinates are t and t2, and
        dωh / (dt dt2); arrays broadcast. None where the two do not fix the half vector."""
        return None

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        first, second = self.coordinates(xp, wi, wo, fixed)
        a, b = self.axes
        box = a.bin_of(xp, first) * self.bins2 + b.bin_of(xp, second)
        return (box + 0.5) / self.boxes


def check_two_curves(model: Model, where: str) -> None:
    """Raises InvalidValue for a model with one curve; where: of its layer, for the message."""
    if not isinstance(model, TwoCurves):
        raise InvalidValue(
            f"{where} has one curve, that of {model.name}; a second one have "
            "cook-torrance-curves and other models over two curves"
        )
