"""Monomials in the equivalent albedos: multisets of variables up to a degree."""

from __future__ import annotations

from functools import cached_property
from itertools import combinations_with_replacement
from math import comb

import numpy as np

from burnish.core.errors import TooLarge
from burnish.core.types import Float64, Int32

MOST_ENTRIES = 50_000_000
"""Monomials times variables, the size of their tables, beyond which none are made."""


class Monomials:
    """All products of up to `degree` of `variables` variables, 1 included.

    Order does not matter in a product, so multisets, not sequences, are counted (2008,
    section 4): C(variables + degree, degree) of them, by rising degree.
    """

    def __init__(self, variables: int, degree: int) -> None:
        self.variables = variables
        self.degree = degree

    def __len__(self) -> int:
        return comb(self.variables + self.degree, self.degree)

    @cached_property
    def _multisets(self) -> list[tuple[int, ...]]:
        """Raises TooLarge where there are too many to list."""
        if len(self) * self.variables > MOST_ENTRIES:
            raise TooLarge(
                f"the layers of all editable objects are {self.variables} variables, whose "
                f"products make {len(self):,} terms; choose fewer editable objects (--editable "
                "A,B) or fewer bounces, or edit the scene live, without a bake"
            )
        return [
            multiset
            for degree in range(self.degree + 1)
            for multiset in combinations_with_replacement(range(self.variables), degree)
        ]

    @cached_property
    def exponents(self) -> Int32:
        """How often each variable occurs: int32 [monomials, variables]."""
        result = np.zeros((len(self._multisets), self.variables), np.int32)
        for z, multiset in enumerate(self._multisets):
            for variable in multiset:
                result[z, variable] += 1
        return result

    @cached_property
    def next(self) -> Int32:
        """next[z, m] is the monomial of z times variable m: int32 [monomials, variables].

        -1 where the product would exceed the degree.
        """
        position = {multiset: z for z, multiset in enumerate(self._multisets)}
        result = np.full((len(self._multisets), self.variables), -1, np.int32)
        for z, multiset in enumerate(self._multisets):
            for m in range(self.variables):
                result[z, m] = position.get(tuple(sorted((*multiset, m))), -1)
        return result

    def evaluate(self, values: Float64) -> Float64:
        """Every monomial at values [variables, 3]: float64 [monomials, 3]. 0⁰ is 1."""
        result = np.ones((len(self._multisets), values.shape[1]))
        for m in range(self.variables):
            result *= values[m][None, :] ** self.exponents[:, m : m + 1]
        return result
