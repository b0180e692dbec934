"""Families of functions through a few of their own members.

A factor such as G1(θi; α) does not split into α and θi. But a few members of the family
span all of it well: g(θ; v) ≈ Σ_k w_k(v) g(θ; v_k), a reduced basis. The first anchor is
the value that a layer starts with, so that an unedited layer is exact; the others are
chosen so that the worst member is met best. The anchors are plain numbers: they can be
gathered per lane inside a kernel, and the functions stay closed forms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from burnish.core.types import Float64


@dataclass(frozen=True, eq=False)
class Expansion:
    """Least squares on the span of the anchors.

    anchors: float64 [k, n], the members sampled at n points. weight: float64 [n].
    """

    anchors: Float64
    weight: Float64

    @cached_property
    def _solve(self) -> Float64:
        root = np.sqrt(self.weight)
        inverse = np.linalg.pinv((self.anchors * root).T, rcond=1e-7)
        return np.asarray(inverse * root)

    def weights(self, samples: Float64) -> Float64:
        """w_k of functions sampled at the n points, float64 [n, …]: float64 [k, …]."""
        return np.asarray(self._solve @ samples)

    def error(self, members: Float64) -> Float64:
        """Fit minus truth of members float64 [m, n]: float64 [m, n]."""
        return np.asarray(self.weights(members.T).T @ self.anchors - members)


def choose_anchors(
    own: Float64,
    candidates: Float64,
    family: Float64,
    count: int,
    weight: Float64,
    worst: Callable[[Float64], float],
) -> list[int]:
    """Which rows of [own; candidates] span best; indices into that stack, `count` of them.

    own: float64 [a, n], where the layer starts (several for colour channels); candidates:
    float64 [b, n]; family: float64 [m, n], what edits may ask for; worst: the size of the
    errors float64 [m, n] of the family. Among all choices that start with one of `own`,
    takes the one with the least sum of the family's worst error and five times the largest
    error of `own`.
    """
    stack = np.concatenate([own, candidates])
    best: tuple[float, list[int]] = (np.inf, [])
    for first in range(len(own)):
        for rest in combinations(range(first + 1, len(stack)), count - 1):
            chosen = [first, *rest]
            expansion = Expansion(stack[chosen], weight)
            error = 5 * float(np.abs(expansion.error(own)[:, weight > 0]).max())
            if error < best[0]:
                error += worst(expansion.error(family))
            if error < best[0]:
                best = (error, chosen)
    return best[1]


def stacked(rows: Sequence[Float64]) -> Float64:
    """Rows to float64 [m, n]."""
    return np.stack([np.asarray(row, np.float64) for row in rows])
