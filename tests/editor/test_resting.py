"""The noise estimate against known noise, and when a picture is cleaned."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from burnish.app.server.resting import REFRESH_SECONDS, Cleaned, NoiseMeter, Resting
from burnish.core.types import Float32
from tests.editor import worlds

SHAPE = (64, 48, 3)
SIGMA = 0.5


def means(counts: list[int], seed: int = 3) -> list[Float32]:
    """Means of growing numbers of the same noisy pictures of a grey 1."""
    rng = np.random.default_rng(seed)
    total, taken, result = np.zeros(SHAPE), 0, []
    for count in counts:
        for _ in range(count - taken):
            total += 1.0 + rng.normal(0.0, SIGMA, SHAPE)
        taken = count
        result.append((total / count).astype(np.float32))
    return result


@pytest.mark.parametrize("counts", [[1, 2], [4, 5], [13, 29], [61, 64]])
def test_two_pictures_tell_the_noise(counts: list[int]) -> None:
    meter, lamp = NoiseMeter(), np.full(SHAPE, 7.0, np.float32)
    assert meter.noise(counts[0]) < 0
    for count, image in zip(counts, means(counts), strict=True):
        meter.take("look", count, image + lamp, lamp)
    # 9216 numbers: the spread is known to 0.7 %
    relative = SIGMA / np.sqrt(1.0 + SIGMA**2 / counts[1])
    for samples in (counts[1], 400):
        expected = relative / np.sqrt(samples)
        assert meter.noise(samples) == pytest.approx(expected, rel=0.04)


def test_an_edit_keeps_the_figure_and_a_selection_drops_it() -> None:
    meter, black = NoiseMeter(), np.zeros(SHAPE, np.float32)
    for count, image in zip([4, 8], means([4, 8]), strict=True):
        meter.take((0, ("ball",)), count, image, black)
    known = meter.noise(8)
    meter.edited((1, ("ball",)))
    assert meter.noise(8) == known
    meter.take((1, ("wall",)), 1, means([1])[0], black)
    assert meter.noise(1) < 0


class Halver:
    """Stands in for a denoiser."""

    denoiser_missing = ""

    def denoise(self, image: Float32, view: str) -> Float32:
        return image / 2


def test_a_state_is_cleaned_at_once_and_its_revisions_from_time_to_time() -> None:
    session, done, arrived = worlds.session(), [], threading.Event()
    session.denoiser = Halver()

    def take(answer: Cleaned | str) -> None:
        done.append(answer)
        arrived.set()

    resting = Resting(session, take)
    assert resting.active
    assert resting.due("front", "look", 1, 0.0)
    resting.begin("front", "look", 1, np.ones(SHAPE, np.float32), 0.0)
    assert arrived.wait(20.0)
    assert isinstance(done[0], Cleaned)
    assert done[0].image.max() == 0.5
    assert not resting.due("front", "look", 1, 10.0)
    assert not resting.due("front", "look", 2, REFRESH_SECONDS / 2)
    assert resting.due("front", "look", 2, REFRESH_SECONDS)
    assert resting.due("front", "another look", 2, 0.1)


def test_a_bundle_is_not_denoised_and_says_why() -> None:
    resting = Resting(worlds.session(), lambda answer: None)
    assert not resting.active
    assert "bake" in resting.unavailable
