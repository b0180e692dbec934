"""A whole family of BRDFs as one layer, by principal components.

For families that do not split into a quotient and a curve. Edits of the parameters that
were sampled move the amplitudes; there is one bin and no profile. Sharp lobes need many
components, so where a model splits its layers are the better form: docs/components.md
holds Mitsuba's `principled` against its layers.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any, ClassVar

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.components import Components, damping, grid, half_difference, principal
from burnish.materials.maths import Maths, numpy_maths, theta_half
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.models.principled import (
    COLOR,
    METALLIC,
    PrincipledBase,
    PrincipledCoat,
    PrincipledSpecular,
)
from burnish.materials.parameter import Parameter


@dataclass(frozen=True)
class Family(Model):
    """What every family shares: ρ = Σ_k a_k q_k, ρ affine in one colour.

    Static: varied: names of the scalar parameters that components are made for; the others
    keep `held`, (name, value) pairs, or their defaults. error: relative RMS asked for.
    """

    varied: tuple[str, ...] = ()
    held: tuple[tuple[str, float], ...] = ()
    error: float = 1e-3

    coordinate_maximum = np.pi / 2
    lobe = "half"
    quadrature_points = 256
    levels: ClassVar[Mapping[str, Sequence[float]]]
    """The values at which each scalar parameter is sampled."""

    def __post_init__(self) -> None:
        # JSON has no tuples
        object.__setattr__(self, "varied", tuple(self.varied))
        object.__setattr__(self, "held", tuple((name, value) for name, value in self.held))
        for name in (*self.varied, *(name for name, _ in self.held)):
            if name not in self.levels:
                raise InvalidValue(
                    f"varied and held must name {', '.join(self.levels)}; got {name!r}"
                )

    @abstractmethod
    def brdf(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        """The family's own formula, three channels, no cosine, above the horizon."""

    @property
    def components(self) -> Components:
        """The tables, computed once per family and choice."""
        return _components(self)

    def settled(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Values with those that are not varied held."""
        fixed = {item.name: item.default for item in self.parameters if item.kind != "colour"}
        fixed |= dict(self.held)
        return {**values, **{k: v for k, v in fixed.items() if k not in self.varied}}

    def members(self) -> Float64:
        """All members that components are made of: float64 [m, *SHAPE]."""
        rows = []
        for choice in product(*(self.levels[name] for name in self.varied)):
            black, white = self._ends(dict(zip(self.varied, choice, strict=True)))
            rows += [black, white - black]
        return np.stack(rows)

    def _ends(self, values: Mapping[str, Any]) -> tuple[Float64, Float64]:
        """The BRDF at the grid for a black and a white colour."""
        colour = (0.0, 1.0, 1.0)
        settled = {**self.settled(values), "color": colour}
        black, white, _ = self.brdf(numpy_maths, grid().wi, grid().wo, settled)
        return np.asarray(black), np.asarray(white)

    @property
    def rank(self) -> int:
        return len(self.components.tables)

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return theta_half(xp, wi, wo) * (2 / xp.pi)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        damp = damping(wi, wo)
        tables = self.components.damped
        return [q / damp for q in xp.lookup3(tables, *half_difference(xp, wi, wo))]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        black, white = self._ends(values)
        a = self.components.project(np.stack([black, white - black], axis=-1))
        colour = np.asarray(values["color"], np.float64) * np.ones(3)
        return np.asarray(a[:, :1] + a[:, 1:] * colour)

    def amplitude_sizes(self) -> Float64:
        return self.components.sizes

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        return [xp.select(lit, c, 0.0) for c in self.brdf(xp, wi, wo, self.settled(values))]


@lru_cache(maxsize=32)
def _components(family: Family) -> Components:
    return principal(family.members(), family.error)


@dataclass(frozen=True)
class PrincipledFamily(Family):
    """Mitsuba's `principled` by components, without sheen and tints.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 1] per channel, linear RGB | base colour |
    | metallic | [0, 1] | blends from a dielectric to a metal |
    | roughness | [0.2, 1] | α = roughness² |
    | specular | [0.01, 1] | F0 = 0.08 · specular |
    | clearcoat | [0, 1] | strength of the coat, of gloss 0 |
    """

    varied: tuple[str, ...] = ("roughness",)

    name = "principled-family"
    parameters = (
        COLOR,
        METALLIC,
        Parameter("roughness", 0.5, 0.2, 1.0, description="the root of Mitsuba's alpha"),
        Parameter("specular", 0.5, 0.01, 1.0, description="F0 = 0.08 × specular"),
        Parameter("clearcoat", 0.0, description="strength of the coat"),
    )
    levels: ClassVar[Mapping[str, Sequence[float]]] = {
        "roughness": tuple(0.2 * 5 ** (i / 19) for i in range(20)),
        "metallic": (0.0, 0.5, 1.0),
        "specular": (0.01, 0.1, 0.3, 0.6, 1.0),
        "clearcoat": (0.0, 1.0),
    }

    def brdf(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        full = {**values, "spec_tint": 0.0, "clearcoat_gloss": 0.0}
        parts = [
            model.evaluate(xp, wi, wo, full)
            for model in (PrincipledBase(), PrincipledSpecular(), PrincipledCoat())
        ]
        return [sum(part[c] for part in parts) for c in range(3)]
