"""Daubechies-4: orthonormal, invertible, and products are kept, for every length."""

from __future__ import annotations

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.runtime.wavelets import HIGH, LOW, Wavelets

LENGTHS = [*range(1, 40), 63, 64, 65, 100, 127, 128, 192, 250, 256, 300]


def test_the_filters_are_those_of_the_paper() -> None:
    # 2006, appendix B
    paper = [0.4829629131445341, 0.8365163037378077, 0.2241438680420134, -0.1294095225512603]
    np.testing.assert_allclose(LOW, paper, rtol=1e-14)
    np.testing.assert_allclose(HIGH, [LOW[3], -LOW[2], LOW[1], -LOW[0]])
    # Two vanishing moments: constants and slopes leave no differences
    np.testing.assert_allclose([HIGH.sum(), HIGH @ np.arange(4)], 0.0, atol=1e-15)


@pytest.mark.parametrize("length", [1, 2, 4, 6, 8, 12, 16, 24, 64, 128, 256])
def test_the_matrix_is_orthonormal(length: int) -> None:
    # Lengths that need no padding: the transform is a square matrix
    wavelets = Wavelets(length)
    assert wavelets.terms == length
    S = wavelets.of_curve(np.eye(length))
    np.testing.assert_allclose(S @ S.T, np.eye(length), atol=1e-13)
    np.testing.assert_array_equal(wavelets.of_transport(np.eye(length)), S)


@pytest.mark.parametrize("length", LENGTHS)
def test_every_length_is_reconstructed_and_keeps_products(length: int) -> None:
    rng = np.random.default_rng(length)
    wavelets = Wavelets(length)
    curve, transport = rng.normal(size=(length, 3)), rng.normal(size=(length, 5))
    coefficients = wavelets.of_curve(curve)
    assert length <= wavelets.terms <= length * 9 / 8
    np.testing.assert_allclose(wavelets.curve(coefficients), curve, atol=1e-13)
    product = wavelets.of_transport(transport).T @ coefficients
    np.testing.assert_allclose(product, transport.T @ curve, atol=1e-12)


def test_single_precision_stays_single() -> None:
    rng = np.random.default_rng(1)
    wide = rng.normal(size=(256, 4))
    narrow = Wavelets(256).of_transport(wide.astype(np.float32))
    assert narrow.dtype == np.float32
    # Eight levels of four products each
    np.testing.assert_allclose(narrow, Wavelets(256).of_transport(wide), atol=1e-5)


def test_a_smooth_curve_has_small_differences() -> None:
    t = (np.arange(256) + 0.5) / 256
    wavelets = Wavelets(256)
    coefficients = np.abs(wavelets.of_curve(np.sin(np.pi * t) ** 4))
    # With two vanishing moments, Taylor's remainder about the first of the four values
    second_derivative = 4 * np.pi**2
    remainder = np.abs(HIGH) @ np.arange(4) ** 2 / 2 * second_derivative / 256**2
    assert coefficients[128:].max() <= remainder
    assert coefficients[64:128].max() <= 2**2.5 * 1.1 * remainder


def test_an_edit_of_a_part_touches_few_terms() -> None:
    wavelets = Wavelets(256)
    bump = np.zeros(256)
    bump[100:108] = 0.1
    touched = np.count_nonzero(np.abs(wavelets.of_curve(bump)) > 1e-12)
    # A level takes 8 / 2^l values and the taps that reach them from outside, one more at most
    assert touched <= sum(8 // 2**level + 2 for level in range(1, 9)) + 1


def test_what_cannot_be_transformed_says_why() -> None:
    with pytest.raises(InvalidValue, match="1 or more"):
        Wavelets(0)
    with pytest.raises(InvalidValue, match="length 8 got an axis of length 7"):
        Wavelets(8).of_curve(np.zeros(7))
