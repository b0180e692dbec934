"""An isotropic BRDF as a table over half and difference angles (Rusinkiewicz 1998)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from burnish.core.errors import MeasurementError
from burnish.core.types import RGB, Bool, Float32, Float64
from burnish.materials.coordinates import RIGHT_ANGLE, theta_difference
from burnish.materials.maths import Maths, Vector, half_vector, numpy_maths, theta_half


@dataclass(frozen=True, eq=False)
class ReflectanceTable:
    """Reflectances in cells of (θh, θd, φd).

    raw: float64 [3, h, d, p], linear RGB in the units of its file; negative, infinite and NaN
      cells are invalid. scale: what turns each channel into 1/sr, without the cosine.

    Cell i of h covers θh / 90° from (i / h)² to ((i + 1) / h)², narrow at the highlight; the
    cells of θd, 0 to 90°, and of φd, 0 to 180°, are equal. φd and φd + 180° are the same by
    reciprocity. Between cell centres the table is interpolated linearly in √θh, θd and φd.
    Invalid cells take the value of the nearest valid one along φd, then θd, then θh.
    Raises MeasurementError when the shape is wrong or no cell is valid.
    """

    raw: Float64
    scale: RGB = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if self.raw.ndim != 4 or self.raw.shape[0] != 3 or min(self.raw.shape[1:]) < 2:
            raise MeasurementError(
                "a reflectance table must have shape [3, h, d, p] with at least 2 cells on each "
                f"axis; got {self.raw.shape}"
            )
        if not self.valid.any():
            raise MeasurementError(
                "a reflectance table has no valid cell: all are negative or not finite; "
                "check its units and the order of its axes"
            )

    @cached_property
    def valid(self) -> Bool:
        """Which cells hold a measurement in all channels: bool [h, d, p]."""
        return np.asarray((np.isfinite(self.raw) & (self.raw >= 0)).all(axis=0))

    @property
    def invalid_count(self) -> int:
        """How many cells were filled from their neighbours."""
        return int((~self.valid).sum())

    @cached_property
    def key(self) -> str:
        """SHA-256 of the numbers, the table's identity."""
        digest = hashlib.sha256(repr((self.raw.shape, self.scale)).encode())
        digest.update(np.ascontiguousarray(self.raw).data)
        return digest.hexdigest()

    @cached_property
    def filled(self) -> Float32:
        """Reflectances in 1/sr with no invalid cell: float32 [3, h, d, p]."""
        values = self.raw * np.asarray(self.scale)[:, None, None, None]
        return np.asarray(_filled(values, self.valid), np.float32)

    @cached_property
    def samples(self) -> Float32:
        """`filled` with φd's last cell before its first and its first after its last."""
        return closed(self.filled)

    def angles(self) -> tuple[Float64, Float64, Float64]:
        """θh, θd and φd of the cell centres, radians: float64 [h], [d], [p]."""
        h, d, p = ((np.arange(n) + 0.5) / n for n in self.raw.shape[1:])
        return h * h * RIGHT_ANGLE, d * RIGHT_ANGLE, p * np.pi

    def directions(self) -> tuple[Vector, Vector]:
        """ωi and ωo at the cell centres, components float64 [h, d, p]; some lie below."""
        h, d, p = (a.reshape(s) for a, s in zip(self.angles(), _AXES, strict=True))
        x, y, z = np.sin(d) * np.cos(p), np.sin(d) * np.sin(p) + 0 * h, np.cos(d)
        sin, cos = np.sin(h), np.cos(h)
        return (
            Vector(cos * x + sin * z, y, cos * z - sin * x),
            Vector(sin * z - cos * x, -y, cos * z + sin * x),
        )

    def evaluate(self, xp: Maths, wi: Any, wo: Any) -> list[Any]:
        """The interpolated reflectance of each channel, in 1/sr, without the cosine."""
        return xp.lookup3(self.samples, *self.place(xp, wi, wo))

    def place(self, xp: Maths, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
        """Where a pair of directions lies in `samples`: 0 to 1 along each axis."""
        half, difference, azimuth = half_difference(xp, wi, wo)
        _, h, d, p = self.raw.shape
        return (
            (xp.sqrt(half) * h - 0.5) / (h - 1),
            (difference * d - 0.5) / (d - 1),
            (azimuth * p + 0.5) / (p + 1),
        )

    def nearest(self, wi: Vector, wo: Vector) -> Float64:
        """The cell of each pair of directions, as MERL's own code looks it up: [3, …], 1/sr.

        NaN where the cell is invalid.
        """
        angles = half_difference(numpy_maths, wi, wo)
        steps = (np.sqrt(angles[0]), angles[1], angles[2])
        cells = tuple(
            np.clip((np.asarray(a) * n).astype(np.int64), 0, n - 1)
            for a, n in zip(steps, self.raw.shape[1:], strict=True)
        )
        values = self.raw[(slice(None), *cells)] * np.reshape(
            self.scale, (3,) + (1,) * np.ndim(wi.z)
        )
        return np.where(self.valid[cells], values, np.nan)


def closed(cells: Float32) -> Float32:
    """Cells [..., p] with the last one before the first and the first after the last."""
    return np.concatenate([cells[..., -1:], cells, cells[..., :1]], axis=-1)


_AXES = ((-1, 1, 1), (1, -1, 1), (1, 1, -1))


def half_difference(xp: Maths, wi: Any, wo: Any) -> tuple[Any, Any, Any]:
    """θh / 90°, θd / 90° and φd / 180°, each in [0, 1] (Rusinkiewicz 1998).

    φd is the azimuth of ωi about the half vector, from the direction away from the normal.
    """
    h = half_vector(xp, wi, wo)
    across = xp.sqrt(h.x * h.x + h.y * h.y)
    tilted = across > 1e-7
    length = xp.select(tilted, across, 1.0)
    cos, sin = xp.select(tilted, h.x / length, 1.0), xp.select(tilted, h.y / length, 0.0)
    x = h.z * (cos * wi.x + sin * wi.y) - across * wi.z
    y = cos * wi.y - sin * wi.x
    # Reciprocity: turned by 180° the two directions change places
    lower = (y < 0) | ((y == 0) & (x < 0))
    x, y = xp.select(lower, -x, x), xp.select(lower, -y, y)
    apart = xp.abs(x) + y > 1e-12
    azimuth = xp.atan2(xp.select(apart, y, 0.0), xp.select(apart, x, 1.0)) / xp.pi
    half = theta_half(xp, wi, wo) * (2 / xp.pi)
    difference = theta_difference(xp, wi, wo) * (2 / xp.pi)
    return xp.minimum(half, 1.0), xp.minimum(difference, 1.0), azimuth


def _filled(values: Float64, valid: Bool) -> Float64:
    """Values [3, h, d, p] with invalid cells taken from the nearest valid one along an axis."""
    values, valid = np.where(valid, values, 0.0), valid.copy()
    for axis, periodic in ((2, True), (1, False), (0, False)):
        if valid.all():
            break
        source, found = _nearest_along(valid, axis, periodic)
        values = np.take_along_axis(values, np.broadcast_to(source, values.shape), axis + 1)
        valid = found
    return values


def _nearest_along(valid: Bool, axis: int, periodic: bool) -> tuple[Any, Bool]:
    """Per cell the index of the nearest valid one along an axis, itself where there is none."""
    n = valid.shape[axis]
    repeated = np.concatenate([valid] * 3, axis) if periodic else valid
    size = repeated.shape[axis]
    shape = [1, 1, 1]
    shape[axis] = size
    index = np.arange(size).reshape(shape)
    before = np.maximum.accumulate(np.where(repeated, index, -10 * size), axis)
    after = np.flip(
        np.minimum.accumulate(np.flip(np.where(repeated, index, 10 * size), axis), axis), axis
    )
    nearest = np.where(index - before <= after - index, before, after)
    found = (nearest >= 0) & (nearest < size)
    nearest = np.where(found, nearest, index)
    if periodic:
        middle = np.arange(n, 2 * n)
        nearest, found = np.take(nearest, middle, axis) % n, np.take(found, middle, axis)
    return nearest[None], found
