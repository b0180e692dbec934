"""Laws of the figures: what equal, scaled and noisy pictures must score."""

from __future__ import annotations

import math

import numpy as np
import pytest

from burnish.compare import display, flip, metrics
from burnish.compare.metrics import Metrics
from burnish.core.errors import InvalidValue
from burnish.core.types import Float32

SHAPE = (48, 64, 3)


@pytest.fixture
def truth() -> Float32:
    return np.random.default_rng(1).uniform(0.1, 0.9, SHAPE).astype(np.float32)


def noisy(picture: Float32, sigma: float, seed: int) -> Float32:
    noise = np.random.default_rng(seed).normal(0, sigma, picture.shape)
    return (picture + noise).astype(np.float32)


def nothing_but_noise(figures: Metrics) -> bool:
    """Whether the excess is within four standard errors of its square, which is what is
    normally distributed."""
    excess, error = figures["rel_rmse_beyond_noise"], figures["rel_rmse_beyond_noise_error"]
    return excess**2 < 4 * ((excess + error) ** 2 - excess**2)


def test_equal_pictures_score_perfectly(truth: Float32) -> None:
    figures = metrics(truth, (truth, truth))
    for name in ("rmse", "rel_rmse", "rel_rmse_beyond_noise", "noise", "flip"):
        assert figures[name] == 0.0
    assert figures["psnr"] == 120.0
    assert figures["mean_image"] == pytest.approx(truth.mean(), rel=1e-6)


def test_a_scaled_picture_is_off_by_the_scale(truth: Float32) -> None:
    figures = metrics(truth * np.float32(1.25), (truth, truth))
    assert figures["rel_rmse"] == pytest.approx(0.25, rel=1e-5)
    assert figures["rel_rmse_beyond_noise"] == pytest.approx(0.25, rel=1e-5)
    assert figures["mean_image"] == pytest.approx(1.25 * figures["mean_reference"], rel=1e-5)


def test_relative_figures_do_not_depend_on_the_unit_of_light(truth: Float32) -> None:
    a = metrics(noisy(truth, 0.02, 2), (noisy(truth, 0.03, 3), noisy(truth, 0.03, 4)))
    k = np.float32(64)  # a power of two: exact in float32
    b = metrics(k * noisy(truth, 0.02, 2), (k * noisy(truth, 0.03, 3), k * noisy(truth, 0.03, 4)))
    for name in ("rel_rmse", "rel_rmse_beyond_noise", "noise", "psnr", "flip"):
        assert a[name] == pytest.approx(b[name], rel=1e-5)
    assert b["rmse"] == pytest.approx(64 * a["rmse"], rel=1e-6)


def test_noise_is_the_error_of_the_mean_of_the_halves(truth: Float32) -> None:
    sigma = 0.05
    halves = (noisy(truth, sigma, 5), noisy(truth, sigma, 6))
    figures = metrics(truth, halves)
    expected = sigma / math.sqrt(2) / math.sqrt(float((truth**2).mean()))
    assert abs(figures["noise"] - expected) < 4 * figures["noise_error"]
    assert figures["noise_error"] < 0.05 * figures["noise"]


def test_noise_goes_out_in_quadrature_and_the_excess_remains(truth: Float32) -> None:
    halves = (noisy(truth, 0.05, 7), noisy(truth, 0.05, 8))
    nothing = metrics(truth, halves)
    assert nothing_but_noise(nothing)
    biased = metrics(truth * np.float32(1.1), halves)
    assert not nothing_but_noise(biased)
    assert abs(biased["rel_rmse_beyond_noise"] - 0.1) < 4 * biased["rel_rmse_beyond_noise_error"]


def test_a_noisy_image_gives_its_own_halves(truth: Float32) -> None:
    reference = (noisy(truth, 0.02, 9), noisy(truth, 0.02, 10))
    image = (noisy(truth, 0.2, 11), noisy(truth, 0.2, 12))
    blind = metrics((image[0] + image[1]) / 2, reference)
    aware = metrics(image, reference)
    assert blind["rel_rmse_beyond_noise"] > 0.2
    assert nothing_but_noise(aware)
    assert aware["rel_rmse_beyond_noise"] < 0.1
    assert aware["rel_rmse"] == pytest.approx(blind["rel_rmse"], rel=1e-5)


def test_the_standard_error_is_the_spread_over_repetitions(truth: Float32) -> None:
    runs = [
        metrics(truth, (noisy(truth, 0.05, 100 + 2 * k), noisy(truth, 0.05, 101 + 2 * k)))
        for k in range(40)
    ]
    spread = np.std([run["noise"] for run in runs], ddof=1)
    # The relative error of a standard deviation from n runs is 1/√(2 (n − 1)): 11 % here
    assert runs[0]["noise_error"] == pytest.approx(spread, rel=0.4)


def test_directly_seen_emission_is_left_out_of_both(truth: Float32) -> None:
    emission = np.zeros(SHAPE, np.float32)
    emission[10:20, 10:20] = 512
    plain = metrics(truth * np.float32(1.25), (truth, truth))
    lit = metrics(
        truth * np.float32(1.25) + emission, (truth + emission, truth + emission), emission=emission
    )
    assert lit["rel_rmse"] == pytest.approx(plain["rel_rmse"], rel=1e-3)
    assert lit["mean_reference"] == pytest.approx(plain["mean_reference"], rel=1e-4)


def test_each_half_can_leave_out_the_emission_that_it_saw(truth: Float32) -> None:
    seen = [
        (512 * np.random.default_rng(k).uniform(0, 1, SHAPE)).astype(np.float32) for k in (20, 21)
    ]
    figures = metrics(
        truth, (truth + seen[0], truth + seen[1]), reference_emission=(seen[0], seen[1])
    )
    assert figures["rel_rmse"] < 1e-3
    both = metrics(
        (truth + seen[0], truth + seen[1]),
        (truth, truth),
        emission=(seen[0], seen[1]),
        reference_emission=np.zeros(SHAPE, np.float32),
    )
    assert both["rel_rmse"] < 1e-3
    assert both["noise"] < 1e-3


def test_a_black_scene_has_figures_too() -> None:
    black = np.zeros(SHAPE, np.float32)
    figures = metrics(black, (black, black))
    assert figures["rel_rmse"] == 0.0
    assert figures["psnr"] == 120.0


def test_bad_pictures_are_refused(truth: Float32) -> None:
    with pytest.raises(InvalidValue, match="shape"):
        metrics(truth[:10], (truth, truth))
    broken = truth.copy()
    broken[0, 0, 0] = np.nan
    with pytest.raises(InvalidValue, match="finite"):
        metrics(broken, (truth, truth))
    with pytest.raises(InvalidValue, match=r"\[0, 1\]"):
        flip(truth * 2, truth)


def test_flip_grows_with_the_difference_and_is_between_0_and_1(truth: Float32) -> None:
    means = [flip(display(truth * np.float32(k)), display(truth)).mean for k in (1, 1.1, 1.5, 0)]
    assert means[0] == 0 < means[1] < means[2] < means[3] <= 1
    heat = flip(display(truth * np.float32(1.5)), display(truth)).heat
    assert heat.shape == SHAPE
    assert 0 <= heat.min() <= heat.max() <= 1
