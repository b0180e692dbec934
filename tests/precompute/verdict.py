"""Whether two pictures are the same, asked with the power to see one wrong number.

The Z-test of pixels and squares looks for any difference and so for none in particular: 2 %
in one e_j changes every pixel by far less than its noise. But how it changes them is known:
by D, the derivative of the polynomial. Weighed by D over the noise, all pixels answer
together (a matched filter),

    z = Σ w (ours − theirs) / √(Σ w² (σ_ours² + σ_theirs²)),   w = D / σ²,

normal when the pictures agree, with a mean of √(Σ D² / σ²) when the number is wrong. D and
the σ in w come from samples of their own: with the judged ones, w would know their noise.
Channels share their paths, so each has a z of its own. The significance is split evenly
between both questions, and between the directions, by Šidák's correction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from burnish.compare import ZTest
from burnish.compare.ztest import ROUNDING, two_sided
from burnish.core.types import Float64
from burnish.reference import Estimate
from burnish.scene import Scene
from burnish.transport.basis import Basis
from tests.precompute.pictures import Look, Picture, pictures, same

WINDOW = 5
"""Pixels of a side of the square that σ² in a weight is averaged over."""


def filters(
    scene: Scene,
    basis: Basis,
    right: Look,
    wrong: Sequence[Look],
    *,
    spp: int,
    per_pass: int,
    seed: int = 4321,
) -> Float64:
    """The weights w of each way to be wrong: float64 [wrong, height, width, 3]."""
    base, *others = pictures(scene, basis, [right, *wrong], spp=spp, per_pass=per_pass, seed=seed)
    variance = uniform_filter(base.variance, (WINDOW, WINDOW, 1))
    change = np.stack([other.mean - base.mean for other in others])
    return np.divide(change, variance, out=np.zeros_like(change), where=variance > 0)


@dataclass(frozen=True)
class Verdict:
    """Both questions. along: float64 [wrong, 3], z in each direction and channel."""

    anywhere: ZTest
    along: Float64

    @property
    def p(self) -> float:
        """Chance of differences so large, the pictures being the same."""
        known = _any_of(float(two_sided(np.abs(self.along).max())), self.along.size)
        return _any_of(min(known, self.anywhere.p), 2)

    @property
    def significance(self) -> float:
        return self.anywhere.significance

    @property
    def relative_sigma(self) -> float:
        return self.anywhere.relative_sigma

    @property
    def passed(self) -> bool:
        return self.p > self.significance

    def p_values(self) -> Float64:
        return self.anywhere.p_values()

    def __str__(self) -> str:
        worst = np.unravel_index(int(np.abs(self.along).argmax()), self.along.shape)
        return (
            f"{'passed' if self.passed else 'FAILED'}: p = {self.p:.2e}; worst z = "
            f"{self.along[worst]:+.2f} in direction {worst[0]}, channel {worst[1]}; pixels and "
            f"squares {self.anywhere}"
        )


def verdict_of(ours: Picture, theirs: Estimate, weights: Float64) -> Verdict:
    """Whether ours and theirs are one picture, asked along the given weights too."""
    gap = ours.mean - theirs.reflected
    variance = ours.variance + theirs.variance.astype(np.float64)
    rounding = ROUNDING * np.maximum(np.abs(ours.mean), np.abs(theirs.reflected))
    total = (weights**2 * variance).sum(axis=(1, 2))
    # Rounding is one error of the whole picture
    total += (np.abs(weights) * rounding).sum(axis=(1, 2)) ** 2
    z = (weights * gap).sum(axis=(1, 2))
    along = np.divide(z, np.sqrt(total), out=np.zeros_like(z), where=total > 0)
    return Verdict(same(ours, theirs), along)


def _any_of(p: float, tests: int) -> float:
    return -math.expm1(tests * math.log1p(-p)) if p < 1 else 1.0
