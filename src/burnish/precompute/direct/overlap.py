"""How much of a triangle lies in each bin of a coordinate (2006, appendix A).

With the coordinate γ linear over a flat triangle, known at its corners, the share of its area
where γ < y depends on those three numbers alone. For corners sorted a ≤ b ≤ c,

    F(y) = (y - a)² / ((b - a)(c - a))          for y ≤ b,
    F(y) = 1 - (c - y)² / ((c - a)(c - b))      beyond,

and the share of a bin is the difference of F at its two edges: one evaluation for each edge
that the triangle reaches, and their sum telescopes to 1. Where the coordinate is not linear,
around a pole, the triangle is split (`Bands.bend` says by how many bins it is bent); what is
left of the bend moves all three corners, so that the mean over the triangle is right.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from burnish.materials.layer import Layer
from burnish.materials.two_curves import TwoCurves
from burnish.scene.maths import drjit_maths

TINY = 1e-20


@dataclass(frozen=True)
class Extent:
    """The coordinate t at the corners of a triangle, sorted."""

    low: Any
    middle: Any
    high: Any

    @staticmethod
    def of(t0: Any, t1: Any, t2: Any, shift: Any = 0.0) -> Extent:
        """Sort the three, all moved by `shift`."""
        low, high = dr.minimum(t0, t1), dr.maximum(t0, t1)
        middle = dr.maximum(low, dr.minimum(high, t2))
        low, high = dr.minimum(low, t2), dr.maximum(high, t2)
        return Extent(*(dr.clip(t + shift, 0, 1) for t in (low, middle, high)))

    def below(self, t: Any) -> Any:
        """F: the share of the triangle's area below t, 0 to 1."""
        a, b, c = self.low, self.middle, self.high
        rising = dr.square(dr.maximum(t - a, 0)) / dr.maximum((b - a) * (c - a), TINY)
        falling = 1 - dr.square(dr.maximum(c - t, 0)) / dr.maximum((c - a) * (c - b), TINY)
        return dr.select(t <= a, 0, dr.select(t >= c, 1, dr.select(t < b, rising, falling)))


class Axis:
    """The bins of one coordinate. Numbers are arrays of the device: see `Bands`."""

    def __init__(self, bins: int, spacing: float) -> None:
        self._bins = dr.opaque(mi.UInt32, bins)
        self._count = dr.opaque(mi.Float, bins)
        self._spacing = dr.opaque(mi.Float, spacing)
        self._square = spacing == 2.0

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

    def bend(self, t: tuple[Any, Any, Any], middle: tuple[Any, Any, Any]) -> tuple[Any, Any]:
        """How the coordinate at the middles of a triangle's edges (0-1, 1-2, 2-0) differs from
        what is linear in its corners: by how many bins at most, and by how much over the whole
        triangle were it quadratic, whose bump over an edge has mean 1/3."""
        worst, mean = mi.Float(0), mi.Float(0)
        for k in range(3):
            straight = 0.5 * (t[k] + t[(k + 1) % 3])
            off = dr.abs(self.position(middle[k]) - self.position(straight))
            worst = dr.maximum(worst, off)
            mean += (middle[k] - straight) * (1 / 3)
        return worst, mean


class Bands:
    """The bins of a layer as bands on the sphere of incident directions: of its coordinate, or
    the boxes of its two coordinates.

    Numbers are arrays of the device, so that objects with the same models share a kernel.
    """

    def __init__(self, layer: Layer) -> None:
        self.layer = layer
        self.model = layer.model
        self.plain = layer.model.coordinate_name == "none"
        if isinstance(layer.model, TwoCurves):
            self.axes = [Axis(axis.bins, axis.spacing) for axis in layer.model.axes]
            self._second = dr.opaque(mi.UInt32, layer.model.bins2)
        else:
            self.axes = [Axis(layer.bins, layer.spacing)]
        numbers = {item.name: item.default for item in self.model.fixed_parameters}
        self.fixed = {
            name: dr.opaque(mi.Float, float(layer.fixed.get(name, default)))  # type: ignore[arg-type]
            for name, default in numbers.items()
        }

    def coordinates(self, wi: Any, wo: Any) -> list[Any]:
        """t along each axis of incident directions in the material's frame, 0 to 1."""
        if isinstance(self.model, TwoCurves):
            found = list(self.model.coordinates(drjit_maths, wi, wo, self.fixed))
        else:
            found = [self.model.coordinate(drjit_maths, wi, wo, self.fixed)]
        return [dr.clip(t, 0, 1) for t in found]

    def quotients(self, wi: Any, wo: Any) -> list[Any]:
        """q_k, the reference one not below zero, as everywhere."""
        found = self.model.quotients(drjit_maths, wi, wo, self.fixed)
        return [dr.maximum(found[0], 0), *found[1:]]

    def extents(
        self, corners: Sequence[Any], middles: Sequence[Any], wo: Any
    ) -> tuple[list[Extent], Any]:
        """What a triangle reaches along each axis, and by how many bins the worst is bent.

        corners, middles: directions to its corners and to the middles of its edges, 0-1, 1-2
        and 2-0.
        """
        at_corners = [self.coordinates(w, wo) for w in corners]
        at_middles = [self.coordinates(w, wo) for w in middles]
        found, bent = [], mi.Float(0)
        for k, axis in enumerate(self.axes):
            t0, t1, t2 = (t[k] for t in at_corners)
            m0, m1, m2 = (t[k] for t in at_middles)
            bend, shift = axis.bend((t0, t1, t2), (m0, m1, m2))
            bent = dr.maximum(bent, bend)
            found.append(Extent.of(t0, t1, t2, shift))
        return found, bent

    def spread(
        self, extents: Sequence[Extent], deposit: Callable[[Any, Any, Any], None], active: Any
    ) -> None:
        """Call deposit(bin, share, active) for every bin, or box, that the triangle reaches."""
        if len(self.axes) == 2:
            self._spread_boxes(extents, deposit, active)
            return
        (extent,), (axis,) = extents, self.axes
        first, last = axis.bin(extent.low), axis.bin(extent.high)

        def body(j: Any, below: Any) -> tuple[Any, Any]:
            # The last bin takes what is left, so that the shares sum to 1
            above = dr.select(j >= last, mi.Float(1), extent.below(axis.edge(j + 1)))
            deposit(j, above - below, active & (j <= last))
            return j + 1, above

        dr.while_loop(
            (first, dr.zeros(mi.Float, dr.width(first))),
            lambda j, below: active & (j <= last),
            body,
            label="bins of a triangle",
        )

    def _spread_boxes(
        self, extents: Sequence[Extent], deposit: Callable[[Any, Any, Any], None], active: Any
    ) -> None:
        """The share of a box is the product of the shares of its two bins (2006, eq. 25)."""
        first = [axis.bin(extent.low) for axis, extent in zip(self.axes, extents, strict=True)]
        last = [axis.bin(extent.high) for axis, extent in zip(self.axes, extents, strict=True)]

        def share(side: int, j: Any) -> Any:
            axis, extent = self.axes[side], extents[side]
            above = dr.select(j >= last[side], mi.Float(1), extent.below(axis.edge(j + 1)))
            below = dr.select(j <= first[side], mi.Float(0), extent.below(axis.edge(j)))
            return above - below

        def body(j: Any, k: Any) -> tuple[Any, Any]:
            here = active & (j <= last[0])
            deposit(j * self._second + k, share(0, j) * share(1, k), here)
            over = k >= last[1]
            return dr.select(over, j + 1, j), dr.select(over, first[1], k + 1)

        dr.while_loop(
            (first[0], first[1]),
            lambda j, k: active & (j <= last[0]),
            body,
            label="boxes of a triangle",
        )
