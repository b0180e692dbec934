"""Sampling the film's reconstruction filter, so that a pixel's samples are its own.

Splatting would spread one path over several pixels and so over several tensors. Drawing
the offset from the filter instead gives every path to one pixel and the same expectation:
Mitsuba's film divides by the accumulated filter weight, which is the filter cut off at the
film's border and normalised there; so is this.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.scene import View

CELLS_PER_PIXEL = 512


class FilterSampler:
    """Draws film positions for pixels with a separable filter, negative lobes included."""

    def __init__(self, rfilter: Any, width: int, height: int) -> None:
        self.size = (width, height)
        self.radius = float(rfilter.radius())
        cells = max(8, int(np.ceil(2 * self.radius * CELLS_PER_PIXEL)))
        x = (np.arange(cells) + 0.5) / cells * 2 * self.radius - self.radius
        value = np.asarray(rfilter.eval(mi.Float(np.abs(x).astype(np.float32)))).astype(np.float64)
        width_cell = 2 * self.radius / cells
        magnitude = np.concatenate([[0.0], np.cumsum(np.abs(value)) * width_cell])
        signed = np.concatenate([[0.0], np.cumsum(value) * width_cell])
        self.cells = cells
        self.total = float(magnitude[-1])
        self._magnitude = mi.Float((magnitude / self.total).astype(np.float32))
        self._signed = mi.Float((signed / self.total).astype(np.float32))
        self._sign = mi.Float(np.sign(value).astype(np.float32))

    def _cumulative(self, table: Any, offset: Any) -> Any:
        """The table's integral up to a signed distance from the pixel's centre."""
        position = dr.clip((offset + self.radius) * (self.cells / (2 * self.radius)), 0, self.cells)
        cell = dr.minimum(mi.UInt32(position), self.cells - 1)
        low, high = dr.gather(mi.Float, table, cell), dr.gather(mi.Float, table, cell + 1)
        return dr.lerp(low, high, position - mi.Float(cell))

    def sample_axis(self, pixel: Any, axis: int, u: Any) -> tuple[Any, Any]:
        """A film coordinate near `pixel` and its weight; u is uniform in [0, 1)."""
        # Cut the filter off where the film ends
        centre = mi.Float(pixel) + 0.5
        first = dr.maximum(-self.radius, -centre)
        last = dr.minimum(self.radius, self.size[axis] - centre)
        low = self._cumulative(self._magnitude, first)
        high = self._cumulative(self._magnitude, last)
        weight = (high - low) / (
            self._cumulative(self._signed, last) - self._cumulative(self._signed, first)
        )
        # Invert the piecewise linear distribution function
        target = dr.lerp(low, high, u)
        cell = dr.binary_search(
            0,
            self.cells,
            lambda i: dr.gather(mi.Float, self._magnitude, i + 1) <= target,
        )
        cell = dr.minimum(cell, self.cells - 1)
        below = dr.gather(mi.Float, self._magnitude, cell)
        above = dr.gather(mi.Float, self._magnitude, cell + 1)
        within = dr.clip((target - below) / dr.maximum(above - below, 1e-12), 0, 1)
        offset = (mi.Float(cell) + within) * (2 * self.radius / self.cells) - self.radius
        weight *= dr.gather(mi.Float, self._sign, cell)
        return dr.clip(centre + offset, 0, self.size[axis]), weight

    def sample(self, pixel: Any, u: Any) -> tuple[Any, Any]:
        """Film position in pixels for (x, y) pixel coordinates, and the filter weight."""
        x, weight_x = self.sample_axis(pixel.x, 0, u.x)
        y, weight_y = self.sample_axis(pixel.y, 1, u.y)
        return mi.Point2f(x, y), weight_x * weight_y


class Camera:
    """Camera rays of a view's pixels through its film's filter."""

    def __init__(self, view: View) -> None:
        self.view = view
        self._filter = FilterSampler(view.filter, view.width, view.height)

    def ray(self, place: Any, sampler: Any) -> tuple[Any, Any]:
        """A ray through pixels (x, y): mi.Point2u, and its weight: mi.Color3f."""
        position, weight = self._filter.sample(place, sampler.next_2d())
        sensor = self.view.sensor
        on_film = mi.Point2f(position.x / self.view.width, position.y / self.view.height)
        aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
        time = sensor.shutter_open()
        if sensor.shutter_open_time() > 0:
            time = time + sampler.next_1d() * sensor.shutter_open_time()
        ray, colour = sensor.sample_ray(time, 0.5, on_film, aperture)
        return ray, mi.Color3f(colour) * weight

    def numbered(self, pixel: Any, sampler: Any) -> tuple[Any, Any]:
        """The same of pixels by their number, y · width + x."""
        width = dr.opaque(mi.UInt32, self.view.width)
        return self.ray(mi.Point2u(pixel % width, pixel // width), sampler)
