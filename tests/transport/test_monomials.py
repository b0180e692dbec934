"""Monomials: counted by the formula, closed under `next`, and products of their variables."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from burnish.core.errors import TooLarge
from burnish.transport.monomials import Monomials

SIZES = st.tuples(st.integers(0, 6), st.integers(0, 4))


@given(SIZES)
def test_there_are_as_many_as_multisets(size: tuple[int, int]) -> None:
    monomials = Monomials(*size)
    exponents = monomials.exponents
    assert len(exponents) == len(monomials) == comb(sum(size), size[1])
    assert len(np.unique(exponents, axis=0)) == len(exponents)
    degrees = exponents.sum(axis=1)
    assert (np.diff(degrees) >= 0).all()
    assert degrees.max() <= size[1]


def test_too_many_are_refused_before_they_are_listed() -> None:
    """2,000 objects over four bounces would fill the memory."""
    monomials = Monomials(2000, 3)
    for table in ("exponents", "next"):
        with pytest.raises(TooLarge, match=r"1,337,337,001 terms; choose fewer editable objects"):
            getattr(monomials, table)


@given(SIZES)
def test_next_multiplies_by_a_variable(size: tuple[int, int]) -> None:
    monomials = Monomials(*size)
    exponents = monomials.exponents
    for z, row in enumerate(monomials.next):
        for m, target in enumerate(row):
            if exponents[z].sum() == size[1]:
                assert target == -1
            else:
                expected = exponents[z] + np.eye(size[0], dtype=int)[m]
                np.testing.assert_array_equal(exponents[target], expected)


@given(SIZES, st.integers(0, 2**32 - 1))
def test_values_are_products(size: tuple[int, int], seed: int) -> None:
    monomials = Monomials(*size)
    values = np.random.default_rng(seed).random((size[0], 3))
    result = monomials.evaluate(values)
    assert (result[0] == 1).all()
    for z, row in enumerate(monomials.next):
        for m, target in enumerate(row):
            if target >= 0:
                np.testing.assert_allclose(result[target], result[z] * values[m], rtol=1e-12)


def test_zero_to_the_zero_is_one() -> None:
    result = Monomials(2, 2).evaluate(np.zeros((2, 3)))
    np.testing.assert_array_equal(result[:, 0], [1, 0, 0, 0, 0, 0])
