"""How much of a triangle lies in each bin of a coordinate (2006, appendix A).

With the coordinate γ linear over a flat triangle, known at its corners, the share of its area
where γ < y depends on those three numbers alone. For corners sorted a ≤ b ≤ c,

    F(y) = (y - a)² / ((b - a)(c - a))          for y ≤ b,
    F(y) = 1 - (c - y)² / ((c - a)(c - b))      beyond,

and the share of a bin is the difference of F at its two edges: one evaluation for each edge
that the triangle reaches, and their sum telescopes to 1. Where the coordinate is not linear,
around a pole, the triangle is split (`Bands.bend` says by how many bins it is bent).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from burnish.materials.layer import Layer
from burnish.scene.maths import drjit_maths

TINY = 1e-20


@dataclass(frozen=True)
class Extent:
    """The coordinate t at the corners of a triangle, sorted."""

    low: Any
    middle: Any
    high: Any

    @staticmethod
    def of(t0: Any, t1: Any, t2: Any) -> Extent:
        """Sort the three."""
        low, high = dr.minimum(t0, t1), dr.maximum(t0, t1)
        return Extent(
            dr.minimum(low, t2),
            dr.maximum(low, dr.minimum(high, t2)),
            dr.maximum(high, t2),
        )

    def below(self, t: Any) -> Any:
        """F: the share of the triangle's area below t, 0 to 1."""
        a, b, c = self.low, self.middle, self.high
        rising = dr.square(dr.maximum(t - a, 0)) / dr.maximum((b - a) * (c - a), TINY)
        falling = 1 - dr.square(dr.maximum(c - t, 0)) / dr.maximum((c - a) * (c - b), TINY)
        return dr.select(t <= a, 0, dr.select(t >= c, 1, dr.select(t < b, rising, falling)))


class Bands:
    """The bins of a layer as bands on the sphere of incident directions.

    Numbers are arrays of the device, so that objects with the same models share a kernel.
    """

    def __init__(self, layer: Layer) -> None:
        self.layer = layer
        self.model = layer.model
        self.plain = layer.model.coordinate_name == "none"
        self._bins = dr.opaque(mi.UInt32, layer.bins)
        self._count = dr.opaque(mi.Float, layer.bins)
        self._spacing = dr.opaque(mi.Float, layer.spacing)
        self._square = layer.spacing == 2.0
        numbers = {item.name: item.default for item in self.model.fixed_parameters}
        self.fixed = {
            name: dr.opaque(mi.Float, float(layer.fixed.get(name, default)))  # type: ignore[arg-type]
            for name, default in numbers.items()
        }

    def coordinate(self, wi: Any, wo: Any) -> Any:
        """t of incident directions in the material's frame, 0 to 1."""
        return dr.clip(self.model.coordinate(drjit_maths, wi, wo, self.fixed), 0, 1)

    def quotients(self, wi: Any, wo: Any) -> list[Any]:
        """q_k, the reference one not below zero, as everywhere."""
        found = self.model.quotients(drjit_maths, wi, wo, self.fixed)
        return [dr.maximum(found[0], 0), *found[1:]]

    def position(self, t: Any) -> Any:
        """t in bins: 0 to the number of bins."""
        u = dr.sqrt(t) if self._square else dr.power(t, 1 / self._spacing)
        return u * self._count

    def edge(self, j: Any) -> Any:
        """t of the lower edge of bin j."""
        u = mi.Float(j) / self._count
        return dr.square(u) if self._square else dr.power(u, self._spacing)

    def bin(self, t: Any) -> Any:
        """The bin of t."""
        return dr.minimum(mi.UInt32(self.position(t)), self._bins - 1)

    def bend(self, t: tuple[Any, Any, Any], middle: tuple[Any, Any, Any]) -> Any:
        """By how many bins the coordinate at the middles of a triangle's edges (0-1, 1-2, 2-0)
        differs from what is linear in its corners."""
        worst = mi.Float(0)
        for k in range(3):
            straight = 0.5 * (t[k] + t[(k + 1) % 3])
            off = dr.abs(self.position(middle[k]) - self.position(straight))
            worst = dr.maximum(worst, off)
        return worst

    def spread(self, extent: Extent, deposit: Callable[[Any, Any, Any], None], active: Any) -> None:
        """Call deposit(bin, share, active) for every bin that the triangle reaches."""
        first, last = self.bin(extent.low), self.bin(extent.high)

        def body(j: Any, below: Any) -> tuple[Any, Any]:
            # The last bin takes what is left, so that the shares sum to 1
            above = dr.select(j >= last, mi.Float(1), extent.below(self.edge(j + 1)))
            deposit(j, above - below, active & (j <= last))
            return j + 1, above

        dr.while_loop(
            (first, dr.zeros(mi.Float, dr.width(first))),
            lambda j, below: active & (j <= last),
            body,
            label="bins of a triangle",
        )
