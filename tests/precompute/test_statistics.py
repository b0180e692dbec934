"""The statistics that the acceptance figures rest on, where their answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.core.types import Float32, Float64
from burnish.reference import Estimate
from tests.precompute.pictures import Picture, same
from tests.precompute.verdict import verdict_of
from tests.verify.pictures import Pair, certainty

SHAPE = (24, 24, 3)
TRIALS = 400


def halves(rng: np.random.Generator, mean: Float64, sigma: float) -> Pair:
    first, second = (rng.normal(mean, sigma).astype(np.float32) for _ in range(2))
    return first, second


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_a_ratio_at_its_limit_is_a_standard_normal_away(share: float) -> None:
    """Errors whose ratio is exactly the limit: certainty has mean 0 and deviation 1."""
    rng = np.random.default_rng(1)
    truth = rng.uniform(0.5, 1.5, SHAPE)
    error = rng.normal(0, 0.05, SHAPE)
    other = share * error + (1 - share) * rng.normal(0, 0.05, SHAPE)
    limit = float(np.linalg.norm(error) / np.linalg.norm(other))
    z = []
    for _ in range(TRIALS):
        reference = halves(rng, truth, 0.04)
        ours = halves(rng, truth + error, 0.06)
        plainer = halves(rng, truth + other, 0.02)
        z.append(certainty(ours, plainer, reference, limit))
    # Mean and variance of TRIALS numbers, at four standard errors
    assert abs(np.mean(z)) < 4 / np.sqrt(TRIALS)
    assert abs(np.var(z) - 1) < 4 * np.sqrt(2 / TRIALS)
    assert certainty(ours, plainer, reference, 2 * limit) > 4
    assert certainty(ours, plainer, reference, limit / 2) < -4


def estimate(image: Float64, sigma: float) -> Estimate:
    picture = image.astype(np.float32)
    nothing = np.zeros_like(picture)
    variance = np.full(SHAPE, sigma**2, np.float32)
    return Estimate(picture, (picture, picture), nothing, (nothing, nothing), variance, 4096)


def picture(passes: Float32) -> Picture:
    variance = passes.var(axis=0, ddof=1, dtype=np.float64) / len(passes)
    return Picture(passes.mean(axis=0, dtype=np.float64), variance, np.zeros(SHAPE), 0, passes)


def test_few_passes_fail_equal_pictures_no_more_often_than_many() -> None:
    """Eight passes: pixels far out are Student's, and p stays a probability."""
    rng = np.random.default_rng(2)
    p = [
        same(
            picture(rng.normal(1.0, 0.1, (8, *SHAPE)).astype(np.float32)),
            estimate(rng.normal(1.0, 0.01, SHAPE), 0.01),
        ).p
        for _ in range(TRIALS)
    ]
    # p or less occurs in a share p of all cases, at four standard errors
    for level in (0.01, 0.1):
        assert np.mean(np.array(p) <= level) <= level + 4 * np.sqrt(level / TRIALS)


def test_a_known_direction_is_seen_below_the_noise_of_every_pixel() -> None:
    rng = np.random.default_rng(3)
    change = rng.uniform(0, 0.02, SHAPE)
    passes = rng.normal(1.0, 0.8, (64, *SHAPE)).astype(np.float32)
    ours, theirs = picture(passes), estimate(rng.normal(1.0, 0.1, SHAPE), 0.1)
    weights = (change / 0.02)[None]
    right = verdict_of(ours, theirs, weights)
    wrong = verdict_of(replace(ours, mean=ours.mean + change), theirs, weights)
    assert right.passed
    assert not wrong.passed
    assert wrong.anywhere.levels[0].p > 0.01
    # Every pixel's variance is 0.8² / 64 + 0.1²
    expected = np.linalg.norm(change, axis=(0, 1)) / np.sqrt(0.02)
    np.testing.assert_allclose(wrong.along[0] - right.along[0], expected, rtol=0.05)
