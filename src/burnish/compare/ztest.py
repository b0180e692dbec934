"""Are two noisy pictures estimates of the same one?

A Z-test per pixel and channel alone would miss a small error that is everywhere, so the
same test is made on the means of growing squares up to the whole picture. A picture passes
when no square differs. Šidák's correction, over the squares of a size and then over the
sizes, keeps the chance that equal pictures fail at the significance asked for (a little
below it, since squares overlap), and lets the few large squares not pay for the many pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float32, Float64

ROUNDING = 2e-5
"""Relative error of a float32 sum that is added up in parallel; no two pictures agree better."""


@dataclass(frozen=True)
class Level:
    """The test on the means of squares of side `side` (cut at the border).

    z: float64 [rows, columns, 3], the difference in standard deviations.
    """

    side: int
    z: Float64

    @property
    def p(self) -> float:
        """Chance of so large a |z| anywhere in the level, the pictures being equal."""
        return _any_of(float(two_sided(np.abs(self.z).max())), self.z.size)


@dataclass(frozen=True)
class ZTest:
    """The verdict on two pictures.

    levels: pixels first, the whole picture last. relative_sigma: median over pixels and
    channels of σ/μ, σ of the noisier picture: the budget is large enough for a verdict when
    it is at most 0.02.
    """

    levels: tuple[Level, ...]
    significance: float
    relative_sigma: float

    @property
    def p(self) -> float:
        """Chance of so large a difference anywhere, the pictures being equal."""
        return _any_of(min(level.p for level in self.levels), len(self.levels))

    @property
    def passed(self) -> bool:
        return self.p > self.significance

    def p_values(self) -> Float64:
        """Two-sided p-value of every pixel and channel: float64 [height, width, 3]."""
        return two_sided(self.levels[0].z)

    def __str__(self) -> str:
        worst = min(self.levels, key=lambda level: level.p)
        at = np.unravel_index(int(np.abs(worst.z).argmax()), worst.z.shape)
        return (
            f"{'passed' if self.passed else 'FAILED'}: p = {self.p:.2e} at significance "
            f"{self.significance:g}; worst z = {worst.z[at]:+.2f} in the {worst.side}-pixel square "
            f"{int(at[1])},{int(at[0])}, channel {int(at[2])}; "
            f"median relative sigma {self.relative_sigma:.4f}"
        )


def ztest(
    mean_a: Float32,
    variance_a: Float32,
    mean_b: Float32,
    variance_b: Float32,
    *,
    significance: float = 0.01,
    growth: int = 4,
) -> ZTest:
    """Test whether two pictures have the same expectation.

    mean_*: [height, width, 3]. variance_*: of those means (not of one sample), same shape;
    pixels independent of each other. significance: chance that equal pictures fail, in
    (0, 1). growth: factor between the sides of the squares, 2 or more.

    Raises InvalidValue when shapes differ or a number is not finite or a variance negative.
    """
    a, b, va, vb = (
        np.asarray(item, np.float64) for item in (mean_a, mean_b, variance_a, variance_b)
    )
    for name, item in (("mean_b", b), ("variance_a", va), ("variance_b", vb)):
        if item.shape != a.shape or a.ndim != 3:
            raise InvalidValue(
                f"{name} must have the shape [height, width, 3] of mean_a; "
                f"got {item.shape} and {a.shape}"
            )
    if not all(np.isfinite(item).all() for item in (a, b, va, vb)) or min(va.min(), vb.min()) < 0:
        raise InvalidValue("means and variances must be finite and variances not negative")
    if not (0 < significance < 1 and growth >= 2):
        raise InvalidValue("significance must lie in (0, 1) and growth be 2 or more")

    difference, variance = a - b, va + vb
    rounding = ROUNDING * np.maximum(np.abs(a), np.abs(b))
    levels, side, largest = [], 1, max(a.shape[:2])
    while True:
        # Rounding does not average out: it is one error of the whole square
        total = np.sqrt(_pool(variance, side) + _pool(rounding, side) ** 2)
        gap = _pool(difference, side)
        z = np.divide(gap, total, out=np.zeros_like(gap), where=total > 0)
        levels.append(Level(side, z))
        if side >= largest:
            break
        side = min(side * growth, largest)
    sigma, level = np.sqrt(np.maximum(va, vb)), np.abs(a + b) / 2
    lit = level > 0
    relative = float(np.median(sigma[lit] / level[lit])) if lit.any() else 0.0
    return ZTest(tuple(levels), significance, relative)


def _pool(values: Float64, side: int) -> Float64:
    """Sums over squares: float64 [⌈height/side⌉, ⌈width/side⌉, 3]."""
    rows = np.add.reduceat(values, np.arange(0, values.shape[0], side), axis=0)
    return np.add.reduceat(rows, np.arange(0, values.shape[1], side), axis=1)


def two_sided(z: Float64) -> Float64:
    """P(|Z| ≥ |z|) of a standard normal Z, elementwise."""
    return np.asarray(_erfc(np.abs(z) / math.sqrt(2)))


def _any_of(p: float, tests: int) -> float:
    """Chance that the smallest of `tests` independent p-values is p or less (Šidák 1967)."""
    return -math.expm1(tests * math.log1p(-p)) if p < 1 else 1.0


_erfc = np.vectorize(math.erfc, otypes=[np.float64])
