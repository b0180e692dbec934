"""Slider travel: 0 at the start of a slider and 1 at its end, equal steps looking alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.parameter import Parameter


@dataclass(frozen=True)
class Travel:
    """The travel of a scalar parameter: linear in `Parameter.scale` between its soft limits.

    Values stay inside the hard limits and, where a model can be perfectly smooth, rough: a
    mirror is another lobe, with a jump between the two.
    """

    parameter: Parameter

    @property
    def low(self) -> float:
        """The least value."""
        item = self.parameter
        low = max(item.minimum, item.rough_minimum or item.minimum)
        return low if low > 0 or item.scale == "linear" else 1e-3 * item.maximum

    @property
    def high(self) -> float:
        """The largest value."""
        return self.parameter.maximum

    def of(self, value: Any) -> Float64:
        """The travel of a value."""
        start, stop = self._ends()
        clipped = np.clip(np.asarray(value, np.float64), self.low, self.high)
        return np.asarray((self._forward(clipped) - start) / (stop - start))

    def at(self, travel: Any) -> Float64:
        """The value at some travel."""
        start, stop = self._ends()
        y = start + np.asarray(travel, np.float64) * (stop - start)
        if self.parameter.scale == "logarithmic":
            value = np.exp(y)
        else:
            value = y * np.abs(y) if self.parameter.scale == "square" else y
        return np.asarray(np.clip(value, self.low, self.high))

    def nodes(self, count: int) -> Float64:
        """Values from the least to the largest, rising, between which a lobe changes little.

        Lobes change by the ratio of two widths: spaced by ratios where the scale says so, and
        denser towards the least value where it does not.
        """
        x = np.linspace(0.0, 1.0, count)
        if self.parameter.scale == "linear":
            return np.asarray(self.low + (self.high - self.low) * x * x)
        nodes = self.low * (self.high / self.low) ** x
        nodes[0], nodes[-1] = self.low, self.high
        return np.asarray(nodes)

    def position(self, count: int) -> Callable[[Float64], Float64]:
        """From values to their places among `nodes`, 0 to count - 1."""
        low, high = self.low, self.high
        if self.parameter.scale == "linear":
            return lambda value: (count - 1) * np.sqrt((value - low) / (high - low))
        return lambda value: (count - 1) * np.log(value / low) / np.log(high / low)

    def _ends(self) -> tuple[float, float]:
        item = self.parameter
        low = self.low if item.soft_minimum is None else max(item.soft_minimum, self.low)
        high = self.high if item.soft_maximum is None else item.soft_maximum
        return float(self._forward(low)), float(self._forward(high))

    def _forward(self, value: Any) -> Float64:
        if self.parameter.scale == "logarithmic":
            return np.asarray(np.log(value))
        root = np.sqrt(np.maximum(value, 0.0))
        return np.asarray(root if self.parameter.scale == "square" else value)
