"""Principal components of an edited term of one parameter (2010, eq. 10–15).

    fE(γ, x) ≈ b0(x) + Σ_j c_j(γ) b_j(x)

with the mean b0 kept apart and c(γ) the projection of the current term, H · (fE(γ) − b0).
x in [0, 1] says where a term's angle lies; nodes are equally spaced in x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from burnish.core.types import Float64
from burnish.materials.principal import leading

NODES = 1024
MEMBERS = 256
"""Parameter values that components are made of."""
MOST = 32

Term = Callable[[Float64, Float64], Float64]
"""fE(γ, x) over arrays that broadcast."""


@dataclass(frozen=True, eq=False)
class TermBasis:
    """The mean and the components of a term, and the projection on them.

    mean: b0, float64 [n]. components: b_j, float64 [k, n], orthonormal under the weight that
    they were made with. projector: H, float64 [k, n]. errors: float64, the relative RMS over
    the members with 0, 1, 2, … components. worst: that of the worst member.
    """

    mean: Float64
    components: Float64
    projector: Float64
    errors: Float64
    worst: Float64
    sizes: Float64

    @property
    def tables(self) -> Float64:
        """b0, b1, …: float64 [1 + k, n]."""
        return np.concatenate([self.mean[None], self.components])

    def project(self, samples: Float64) -> Float64:
        """1, c_1, c_2, … of a term at the nodes, float64 [n] to float64 [1 + k] (eq. 14–15)."""
        return np.concatenate([[1.0], self.projector @ (samples - self.mean)])


def term_basis(
    members: Float64, weight: Float64, error: float, alike: bool = True, most: int = MOST
) -> TermBasis:
    """The basis of members float64 [m, n] for a relative RMS error.

    weight: float64 [n], of squared errors at the nodes. alike: whether the error of each
    member is relative to itself; otherwise to the RMS of all, which neglects the dim ones.
    """
    root = np.sqrt(weight)
    norms = np.linalg.norm(members * root, axis=1)
    if not alike:
        norms = np.full_like(norms, np.sqrt((norms**2).mean()))
    mean = members.mean(axis=0)
    rest = (members - mean) / norms[:, None]
    found = leading(rest * root, error, most)
    # The same combinations of the members themselves, so that tables reach where weights do not
    components = found.mixing.T @ rest
    projector = components * weight
    each = np.concatenate([1 / norms[:, None], rest @ projector.T], axis=1)
    sizes = np.sqrt((each**2).mean(axis=0))
    return TermBasis(mean, components, projector, found.errors, found.worst, sizes)


@dataclass(frozen=True)
class Sampling:
    """How a term's parameter and its angle are sampled.

    gammas: float64 [m]. x: float64 [n], nodes. weight: float64 [n].
    """

    gammas: Float64
    x: Float64
    weight: Float64

    def members(self, term: Term) -> Float64:
        """Every member at every node: float64 [m, n]."""
        return np.asarray(term(self.gammas[:, None], self.x[None]))


def papers_sampling(least: float, greatest: float, x: Float64, members: int = MEMBERS) -> Sampling:
    """Even steps of the parameter, and nodes that all count alike (2010, §4).

    x: float64 [n], where even steps of the angle δ lie.
    """
    return Sampling(np.linspace(least, greatest, members), x, np.full(len(x), 1 / len(x)))
