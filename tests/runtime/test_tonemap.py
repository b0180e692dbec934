"""Tone mapping: black stays black, light rises, and known values come out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from burnish.core.errors import InvalidValue, UnknownName
from burnish.runtime.tonemap import OPERATORS, ToneMap

GREYS = np.repeat(np.geomspace(1e-4, 1e3, 200, dtype=np.float32)[:, None], 3, axis=1)


@pytest.mark.parametrize("operator", sorted(OPERATORS))
def test_greys_rise_from_black_and_stay_grey(operator: str) -> None:
    shown = ToneMap(operator).display(GREYS)
    assert shown.dtype == np.float32
    assert shown.min() >= 0
    assert shown.max() <= 1
    assert (np.diff(shown[:, 1]) >= -1e-6).all()
    # The matrices' rows add up to 1 within five digits
    assert np.ptp(shown, axis=1).max() < 2e-3
    assert ToneMap(operator).to_bytes(np.zeros((1, 1, 3), np.float32)).max() <= 1


def test_srgb_shows_known_values() -> None:
    image = np.array([[0.0, 0.2158605, 1.0], [2.0, -1.0, 0.0031308]], np.float32)
    np.testing.assert_array_equal(ToneMap().to_bytes(image), [[0, 128, 255], [255, 0, 10]])


def test_reinhard_halves_a_luminance_of_one() -> None:
    image = np.ones((1, 3), np.float32)
    expected = ToneMap().display(np.full((1, 3), 0.5, np.float32))
    np.testing.assert_allclose(ToneMap("reinhard").display(image), expected, rtol=1e-4)


@given(st.floats(-8, 8), st.tuples(*[st.floats(0.1, 10.0)] * 3))
def test_exposure_is_in_stops_and_white_becomes_grey(
    stops: float, white: tuple[float, float, float]
) -> None:
    image = np.array([white], np.float32) * np.float32(2.0**-stops)
    shown = ToneMap(exposure=stops, white=white).display(image)
    expected = ToneMap().display(np.full((1, 3), np.mean(white), np.float32))
    np.testing.assert_allclose(shown, expected, rtol=1e-3, atol=1e-6)


def test_bad_settings_are_refused() -> None:
    with pytest.raises(UnknownName, match="filmic"):
        ToneMap("filmik")
    with pytest.raises(InvalidValue, match="exposure"):
        ToneMap(exposure=21.0)
    with pytest.raises(InvalidValue, match="white"):
        ToneMap(white=(1.0, 0.0, 1.0))
