"""An object's surface as one view sees it: what a brush meets, and where paint is kept."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from burnish.core.types import AnyArray, Bool, Float32, Float64, Int32, Int64
from burnish.materials.painting.canvas import Canvas
from burnish.transport.frozen import Transport

_GRAZING = 0.05
"""A row seen at a lower cosine counts no larger an area than this."""


class Surface:
    """The fine rows of one object in one view.

    pixel: int32 [r], rising. position, normal: float32 [r, 3], world space. weight,
    cos_theta_o: float32 [r].
    """

    def __init__(self, transport: Transport, index: int) -> None:
        rows = transport.rows
        own = np.flatnonzero((rows.object == index) & ~rows.indirect)
        own = own[np.argsort(rows.pixel[own], kind="stable")]
        self.width, self.height = transport.width, transport.height
        self.rows = rows
        self.pixel: Int32 = rows.pixel[own]
        self.position: Float32 = rows.position[own]
        self.normal: Float32 = rows.normal[own]
        self.uv: Float32 = rows.uv[own]
        self.uv_points: Float32 = rows.select(own).uv_points
        self.weight: AnyArray = rows.weight[own]
        self.cos_theta_o: AnyArray = rows.cos_theta_o[own]
        self.canvas = Canvas(self.position, self.normal)

    def row_at(self, pixel: Int64) -> Int64:
        """The row of each pixel, -1 where the object is not seen."""
        if not len(self.pixel):
            return np.full(len(pixel), -1, np.int64)
        at = np.minimum(np.searchsorted(self.pixel, pixel), len(self.pixel) - 1)
        return np.where(self.pixel[at] == pixel, at, -1)

    @cached_property
    def footprint(self) -> Float64:
        """The size of a pixel at each row, across the line of sight: float64 [r], scene units.

        The lesser extent of the step to the neighbouring pixels' rows: tilting a surface
        lengthens the other one alone. Rows without two such neighbours have the median.
        """
        dx, has_x = self._step(1)
        dy, has_y = self._step(self.width)
        xx, yy, xy = (dx * dx).sum(axis=1), (dy * dy).sum(axis=1), (dx * dy).sum(axis=1)
        # The smaller eigenvalue of the steps' inner products
        spread = np.sqrt(np.maximum((xx - yy) ** 2 / 4 + xy * xy, 0.0))
        least = np.sqrt(np.maximum((xx + yy) / 2 - spread, 0.0))
        known = has_x & has_y & (least > 0)
        usual = float(np.median(least[known])) if known.any() else self._extent / self.width
        held = np.where(known, np.clip(least, 0.25 * usual, 4 * usual), usual)
        return self._smoothed(held)

    @cached_property
    def area(self) -> Float64:
        """The visible area of each row: float64 [r], zero where nothing was seen."""
        area = self.weight * self.footprint**2 / np.maximum(self.cos_theta_o, _GRAZING)
        return np.asarray(area, np.float64)

    @cached_property
    def along_u(self) -> Float64:
        """The direction in which u grows, as a unit vector: float64 [r, 3], zero if unknown."""
        dx, has_x = self._step(1)
        dy, has_y = self._step(self.width)
        du_x, du_y = self._step(1, self.uv[:, :1])[0], self._step(self.width, self.uv[:, :1])[0]
        dv_x, dv_y = self._step(1, self.uv[:, 1:])[0], self._step(self.width, self.uv[:, 1:])[0]
        # dP = P_u du + P_v dv along both steps, solved for P_u
        determinant = du_x * dv_y - du_y * dv_x
        known = (has_x & has_y)[:, None] & (np.abs(determinant) > 1e-12)
        p_u = (dx * dv_y - dy * dv_x) / np.where(known, determinant, 1.0)
        length = np.linalg.norm(p_u, axis=1, keepdims=True)
        return np.asarray(np.where(known & (length > 0), p_u / np.maximum(length, 1e-30), 0.0))

    def _smoothed(self, values: Float64) -> Float64:
        """Means over the rows of 7 × 7 pixels: positions are noisy means of a few samples."""
        image = np.zeros((2, self.height + 7, self.width + 7))
        y, x = np.divmod(self.pixel, self.width)
        image[0, y + 4, x + 4], image[1, y + 4, x + 4] = values, 1.0
        sums = image.cumsum(axis=1).cumsum(axis=2)
        boxes = sums[:, 7:, 7:] - sums[:, :-7, 7:] - sums[:, 7:, :-7] + sums[:, :-7, :-7]
        total, count = boxes[:, y, x]
        return np.asarray(total / count)

    @property
    def _extent(self) -> float:
        if not len(self.position):
            return 1.0
        return float(np.ptp(self.position.astype(np.float64), axis=0).max()) or 1.0

    def _step(self, offset: int, values: AnyArray | None = None) -> tuple[Float64, Bool]:
        """How values change to the pixel at an offset, or from the one before: [r, n], [r]."""
        v = (self.position if values is None else values).astype(np.float64)
        pixel = self.pixel.astype(np.int64)
        after, before = self.row_at(pixel + offset), self.row_at(pixel - offset)
        if offset == 1:
            column = pixel % self.width
            after = np.where(column == self.width - 1, -1, after)
            before = np.where(column == 0, -1, before)
        found = np.where((after >= 0)[:, None], v[after] - v, v - v[before])
        known = (after >= 0) | (before >= 0)
        return np.where(known[:, None], found, 0.0), known
