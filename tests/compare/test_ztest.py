"""The test of equality: calibrated where pictures are equal, able to see 2 %."""

from __future__ import annotations

import numpy as np
import pytest

from burnish.compare import ztest
from burnish.core.errors import InvalidValue
from burnish.core.types import Float32

SHAPE = (64, 64, 3)
SAMPLES = 256


def estimate(mean: Float32, seed: int) -> tuple[Float32, Float32]:
    """Mean and its variance from samples with the skew of path tracing: exponential, so
    that the relative sigma is 1/√SAMPLES."""
    draws = np.random.default_rng(seed).exponential(1.0, (SAMPLES, *mean.shape)) * mean
    return draws.mean(0), draws.var(0, ddof=1) / SAMPLES


@pytest.fixture
def picture() -> Float32:
    return np.random.default_rng(0).uniform(0.2, 1.0, SHAPE)


def test_p_values_are_uniform_on_equal_pictures() -> None:
    rng = np.random.default_rng(3)
    sigma = np.full(SHAPE, 0.1)
    a, b = (rng.normal(1.0, 0.1, SHAPE) for _ in range(2))
    result = ztest(a, sigma**2, b, sigma**2)
    p = np.sort(result.p_values().ravel())
    # Kolmogorov–Smirnov: the distance exceeds 1.95/√n with probability 0.001
    distance = np.abs(p - (np.arange(p.size) + 0.5) / p.size).max()
    assert distance < 1.95 / np.sqrt(p.size)


def test_equal_pictures_fail_as_often_as_the_significance_says() -> None:
    rng = np.random.default_rng(4)
    shape, runs, significance = (24, 24, 3), 400, 0.05
    variance = np.full(shape, 0.01)
    failures = sum(
        not ztest(
            rng.normal(1, 0.1, shape),
            variance,
            rng.normal(1, 0.1, shape),
            variance,
            significance=significance,
        ).passed
        for _ in range(runs)
    )
    expected = runs * significance
    # Overlapping squares can only make it rarer
    assert 0.3 * expected < failures < expected + 4 * np.sqrt(expected)


def test_skewed_samples_of_a_path_tracer_s_kind_pass(picture: Float32) -> None:
    result = ztest(*estimate(picture, 1), *estimate(picture, 2))
    assert result.passed, str(result)


def test_two_per_cent_everywhere_is_seen(picture: Float32) -> None:
    """At a relative sigma of 6 % in a pixel no pixel shows 2 %; the larger squares do."""
    result = ztest(*estimate(picture, 1), *estimate(picture * 1.02, 2))
    assert not result.passed
    assert result.levels[0].p > 0.01
    assert result.levels[-1].p < 1e-6


def test_one_wrong_pixel_is_seen(picture: Float32) -> None:
    wrong = picture.copy()
    wrong[11, 17, 1] *= 2
    result = ztest(*estimate(picture, 1), *estimate(wrong, 2))
    assert not result.passed
    z = result.levels[0].z
    assert np.unravel_index(np.abs(z).argmax(), z.shape) == (11, 17, 1)
    assert "17,11" in str(result)


def test_rounding_alone_never_fails_but_a_difference_without_noise_does() -> None:
    flat, nothing = np.full(SHAPE, 0.7), np.zeros(SHAPE)
    assert ztest(flat, nothing, flat * (1 + 1e-5), nothing).passed
    assert not ztest(flat, nothing, flat * 1.001, nothing).passed


def test_relative_sigma_is_that_of_the_noisier_picture(picture: Float32) -> None:
    result = ztest(picture, (0.01 * picture) ** 2, picture, (0.03 * picture) ** 2)
    assert result.relative_sigma == pytest.approx(0.03, rel=1e-6)


def test_any_size_of_picture_is_covered_once() -> None:
    for shape in ((1, 1, 3), (5, 19, 3), (17, 4, 3)):
        a = np.random.default_rng(1).uniform(0, 1, shape)
        result = ztest(a + 1, np.ones(shape), a, np.ones(shape))
        last = result.levels[-1]
        assert last.z.shape == (1, 1, 3)
        pixels = shape[0] * shape[1]
        np.testing.assert_allclose(last.z, pixels / np.sqrt(2 * pixels), rtol=1e-3)


def test_bad_input_is_refused(picture: Float32) -> None:
    good = np.ones(SHAPE)
    with pytest.raises(InvalidValue, match="shape"):
        ztest(picture, good, picture[:3], good)
    with pytest.raises(InvalidValue, match="finite"):
        ztest(picture, -good, picture, good)
    with pytest.raises(InvalidValue, match="significance"):
        ztest(picture, good, picture, good, significance=2.0)
