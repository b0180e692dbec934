"""A one-parameter model as a layer of principal components (2010, §3.3–4)."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.components import SHAPE, grid
from burnish.materials.maths import Maths, numpy_maths, theta_half
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter
from burnish.materials.pca.term import MEMBERS, NODES, Sampling, TermBasis, term_basis

SPECULAR = Parameter("color", 0.2, kind="colour", description="ρs, scales the reflection")


@dataclass(frozen=True)
class ComponentModel(Model):
    """ρ = color · fF(ωi, ωo) · fE(γ, x), with fE by its components (2010, eq. 5–6).

    Quotients are fF b0, fF b1, …; amplitudes are color · (1, c1(γ), …). There is one bin and
    no curve: a layer has as many columns as quotients, whatever the number of bins.

    Static: error, the relative RMS that decides how many components there are. It is that of
    ρ over all pairs of directions, each weighted by cosθi cosθo and the solid angles of both,
    and over γ in even steps of log γ, every member relative to itself; so the figure means
    what it means for other components (see `materials.components`).
    """

    error: float = 1e-3

    coordinate_maximum = np.pi / 2
    lobe = "half"
    quadrature_points = 256
    gamma: ClassVar[str]
    """The name of the parameter that is edited."""

    def __post_init__(self) -> None:
        if not 1e-6 <= self.error <= 0.5:
            raise InvalidValue(f"error must lie in [1e-6, 0.5]; got {self.error!r}")

    # What each model answers

    @abstractmethod
    def term(self, gamma: Float64, x: Float64) -> Float64:
        """fE(γ, x); both broadcast."""

    @abstractmethod
    def position(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        """x in [0, 1] of a pair of directions."""

    @abstractmethod
    def fixed_term(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        """fF without ρs; wi.z > 0 and wo.z > 0 is given."""

    # The model

    @property
    def edited(self) -> Parameter:
        """The parameter γ."""
        return next(item for item in self.parameters if item.name == self.gamma)

    @property
    def basis(self) -> TermBasis:
        """The mean and the components, computed once per model and error."""
        return _basis(self)

    def sampling(self) -> Sampling:
        """The members and the measure of the error; see the class."""
        edited, start = self.edited, self.freeze({})
        x = np.linspace(0.0, 1.0, NODES)
        nodes = grid()
        lit = nodes.weight > 0
        wi, wo = (type(w)(*(a[lit] for a in (w.x, w.y, w.z))) for w in (nodes.wi, nodes.wo))
        share = nodes.weight[lit] * self.fixed_term(numpy_maths, wi, wo, start) ** 2
        cells = SHAPE[0] - 1
        edges = (np.arange(cells + 2) - 0.5) / cells
        where = np.clip(self.position(numpy_maths, wi, wo, start), 0.0, 1.0)
        mass, _ = np.histogram(where, edges, weights=share)
        weight = np.interp(x, np.arange(cells + 1) / cells, mass)
        gammas = np.geomspace(edited.minimum, edited.maximum, MEMBERS)
        return Sampling(gammas, x, np.asarray(weight / weight.sum()))

    @property
    def rank(self) -> int:
        return 1 + len(self.basis.components)

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return theta_half(xp, wi, wo) * (2 / xp.pi)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        x = self.position(xp, wi, wo, fixed)
        scale = self.fixed_term(xp, wi, wo, fixed)
        return [scale * xp.lookup(table, x) for table in self.basis.tables]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        gamma = np.asarray(values[self.gamma], np.float64)
        c = self.basis.project(self.term(gamma, np.linspace(0.0, 1.0, NODES)))
        return c[:, None] * (np.asarray(values["color"], np.float64) * np.ones(3))

    def amplitude_sizes(self) -> Float64:
        return self.basis.sizes

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))


@lru_cache(maxsize=32)
def _basis(model: ComponentModel) -> TermBasis:
    sampling = model.sampling()
    return term_basis(sampling.members(model.term), sampling.weight, model.error)
