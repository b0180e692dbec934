"""Least squares with bounds: one Levenberg-Marquardt step at a time, so that one can stop.

The normal equations are small (one row per unknown), so a step is the exact minimum of the
damped quadratic inside the box, found by an active set. SciPy has no solver of this kind
that can be watched, stopped and handed other weights between two steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from burnish.core.types import Float64


class Problem(Protocol):
    """½ Σ residual² + ½ Σ max(hinge, 0)², as what a step needs of it."""

    lower: Float64
    upper: Float64

    def cost(self, x: Float64) -> float:
        """The sum."""
        ...

    def normal(self, x: Float64) -> tuple[Float64, Float64]:
        """JᵀJ [n, n] and Jᵀ residual [n], hinges left out."""
        ...

    def hinges(self, x: Float64) -> tuple[Float64, Float64]:
        """The hinges [k] that may count nearby, and their derivatives [k, n]."""
        ...


@dataclass(frozen=True)
class Iterate:
    """A point on the way down. done: no step would lead further."""

    x: Float64
    cost: float
    done: bool


def descend(
    problem: Problem, start: Float64, limit: int, tolerance: float = 1e-6
) -> Iterator[Iterate]:
    """Levenberg-Marquardt with Marquardt's scaling inside the bounds; costs never rise.

    Ends after `limit` steps, or when one gains less than `tolerance` of the cost.
    """
    x = np.clip(start, problem.lower, problem.upper)
    cost, damping = problem.cost(x), 1e-3
    for _ in range(limit):
        H, g = problem.normal(x)
        hinges = problem.hinges(x)
        floor = 1e-12 * max(float(np.trace(H)) / len(x), 1e-300)
        diagonal = np.diag(H) + floor
        moved = False
        while damping < 1e12:
            damped = H + np.diag(damping * diagonal + floor)
            step = hinged_minimum(damped, g, *hinges, problem.lower - x, problem.upper - x)
            predicted = -(g @ step + 0.5 * step @ H @ step) + _hinge_gain(*hinges, step)
            if predicted <= 0.1 * tolerance * cost:
                break
            trial = np.clip(x + step, problem.lower, problem.upper)
            found = problem.cost(trial)
            if found < cost:
                moved = True
                gain = (cost - found) / predicted
                damping = max(damping * (0.1 if gain > 0.75 else 0.5 if gain > 0.25 else 2), 1e-9)
                break
            damping *= 10
        done = not moved or cost - found <= tolerance * cost
        if moved:
            x, cost = trial, found
        yield Iterate(x, cost, done)
        if done:
            return


def hinged_minimum(
    H: Float64, g: Float64, values: Float64, slopes: Float64, lower: Float64, upper: Float64
) -> Float64:
    """The same as `box_minimum` with ½ Σ max(values + slopes d, 0)² added.

    Which hinges count is guessed from the last d until the guess is right.
    """
    counts = values > 0
    step = np.zeros(len(g))
    for _ in range(2 * len(values) + 2):
        S = slopes[counts]
        step = box_minimum(H + S.T @ S, g + S.T @ values[counts], lower, upper)
        found = values + slopes @ step > 0
        if np.array_equal(found, counts):
            break
        counts = found
    return step


def _hinge_gain(values: Float64, slopes: Float64, step: Float64) -> float:
    """By how much a step lowers the hinges' part of the cost."""
    before, after = np.maximum(values, 0.0), np.maximum(values + slopes @ step, 0.0)
    return 0.5 * float((before**2).sum() - (after**2).sum())


def box_minimum(H: Float64, g: Float64, lower: Float64, upper: Float64) -> Float64:
    """The d with lower <= d <= upper that makes ½ dᵀHd + gᵀd least; H positive definite.

    lower <= 0 <= upper. Numbers that would leave the box are held at its wall, and let go
    again, worst first, while the slope there points inwards.
    """
    count = len(g)
    held = np.zeros(count, bool)
    d = np.zeros(count)
    # Whatever the slope at 0 pushes out of the box starts at the wall
    held = ((lower >= 0) & (g > 0)) | ((upper <= 0) & (g < 0))
    for _ in range(3 * count + 10):
        free = ~held
        if free.any():
            right = -g[free] - H[np.ix_(free, held)] @ d[held]
            d[free] = np.linalg.solve(H[np.ix_(free, free)], right)
        outside = free & ((d < lower) | (d > upper))
        if outside.any():
            d = np.clip(d, lower, upper)
            held |= outside
            continue
        slope = H @ d + g
        inwards = np.where(held, np.where(d <= lower, -slope, slope), 0.0)
        inwards[held & (lower == upper)] = 0.0
        worst = int(np.argmax(inwards))
        if inwards[worst] <= 1e-12 * max(float(np.abs(g).max()), 1e-300):
            break
        held[worst] = False
    return np.clip(d, lower, upper)
