"""Daubechies' wavelets of four taps: orthonormal, periodised, for axes of any length.

(Daubechies 1988; 2006, appendix B.) One level replaces an even number n of values by n / 2
sums and n / 2 differences,

    low_i = Σ_k h_k x_(2i+k),    high_i = Σ_k g_k x_(2i+k),    indices modulo n,

and the next one takes the sums. Coefficients stand coarsest first. With the synthesis matrix S
of 2006, T · c = (S T) · (S c): S is orthonormal, so that what multiplies a curve and the curve
itself are transformed alike.

A length that is no power of two is padded by at most an eighth, to as many levels as that
allows. In the padding the transport is zero and the curve keeps its last value, which leaves
their product as it was and adds no jump to the curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import AnyArray

_ROOT = np.sqrt(3.0)
LOW = np.array([1 + _ROOT, 3 + _ROOT, 3 - _ROOT, 1 - _ROOT]) / (4 * np.sqrt(2.0))
"""h, the low-pass filter."""
HIGH = np.array([LOW[3], -LOW[2], LOW[1], -LOW[0]])
"""g, the high-pass filter."""

_PADDING = 1 / 8
"""Of a length, the largest share that padding may add to it."""

A = TypeVar("A", bound=AnyArray)


@dataclass(frozen=True)
class Wavelets:
    """The transform of axes of one length, at least 1. Raises InvalidValue."""

    length: int

    def __post_init__(self) -> None:
        if self.length < 1:
            raise InvalidValue(
                f"a wavelet transform needs a length of 1 or more; got {self.length}"
            )

    @property
    def levels(self) -> int:
        """How often sums are taken of sums."""
        most = self.length.bit_length() - 1
        room = self.length * (1 + _PADDING)
        return max(level for level in range(most + 1) if _whole(self.length, level) <= room)

    @property
    def terms(self) -> int:
        """Number of coefficients: the length, padded."""
        return _whole(self.length, self.levels)

    def of_curve(self, curve: A) -> A:
        """The coefficients of curves [length, ...]: [terms, ...], in their own precision."""
        return self._forward(self._padded(curve, "edge"))

    def of_transport(self, transport: A) -> A:
        """What multiplies the coefficients, from what multiplies a curve [length, ...]."""
        return self._forward(self._padded(transport, "constant"))

    def curve(self, coefficients: A) -> A:
        """The curves [length, ...] of coefficients [terms, ...]."""
        result = np.array(coefficients)
        size = self.terms >> self.levels
        for _ in range(self.levels):
            low, high = result[:size], result[size : 2 * size]
            merged = np.empty_like(result[: 2 * size])
            h, g = LOW.astype(result.dtype), HIGH.astype(result.dtype)
            before, above = np.roll(low, 1, axis=0), np.roll(high, 1, axis=0)
            merged[0::2] = h[0] * low + h[2] * before + g[0] * high + g[2] * above
            merged[1::2] = h[1] * low + h[3] * before + g[1] * high + g[3] * above
            size *= 2
            result[:size] = merged
        return result[: self.length]  # type: ignore[return-value]

    def _forward(self, padded: A) -> A:
        result, size = padded, self.terms
        for _ in range(self.levels):
            h, g = LOW.astype(result.dtype), HIGH.astype(result.dtype)
            even, odd = result[0:size:2], result[1:size:2]
            after, beyond = np.roll(even, -1, axis=0), np.roll(odd, -1, axis=0)
            low = h[0] * even + h[1] * odd + h[2] * after + h[3] * beyond
            high = g[0] * even + g[1] * odd + g[2] * after + g[3] * beyond
            size //= 2
            result[:size], result[size : 2 * size] = low, high
        return result

    def _padded(self, values: A, mode: str) -> A:
        """A copy with the padding, in floating point."""
        if len(values) != self.length:
            raise InvalidValue(
                f"a transform of length {self.length} got an axis of length {len(values)}"
            )
        kind = values.dtype if values.dtype in (np.float32, np.float64) else np.float64
        result = np.empty((self.terms, *values.shape[1:]), kind)
        result[: self.length] = values
        result[self.length :] = values[-1] if mode == "edge" else 0.0
        return result  # type: ignore[return-value]


def _whole(length: int, levels: int) -> int:
    """The length rounded up to what can be halved so often."""
    step = 1 << levels
    return -(-length // step) * step
