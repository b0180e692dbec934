"""Tables of samples, such as CUReT's 205 per material, in one array form."""

from __future__ import annotations

from typing import Literal

import numpy as np

from burnish.core.errors import MeasurementError
from burnish.core.types import AnyArray, Float64
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.measured.register import keep
from burnish.materials.measured.table import ReflectanceTable, half_difference

NEIGHBOURS = 6


def table_of_samples(
    angles: AnyArray,
    values: AnyArray,
    *,
    unit: Literal["degrees", "radians"] = "degrees",
    shape: tuple[int, int, int] = (24, 24, 24),
) -> ReflectanceTable:
    """A table from scattered isotropic measurements.

    angles: [n, 4], θi, φi, θo, φo of each: polar angles from the normal to the light and to
    the viewer, and azimuths. values: [n, 3], linear RGB in 1/sr, without the cosine. Samples
    with NaN, infinite or negative values, and those at or below the horizon, are left out.
    shape: cells of θh, θd and φd. A cell takes the mean of its nearest samples, weighted by
    1 / distance² over (√θh, θd cos 2φd, θd sin 2φd); far from any sample that is a guess.
    Raises MeasurementError.
    """
    angles, values = np.asarray(angles, np.float64), np.asarray(values, np.float64)
    if angles.ndim != 2 or angles.shape[1] != 4 or values.shape != (len(angles), 3):
        raise MeasurementError(
            "samples need angles [n, 4] (θi, φi, θo, φo) and values [n, 3] (linear RGB); got "
            f"{angles.shape} and {values.shape}"
        )
    if unit == "degrees":
        angles = np.radians(angles)
    above = np.cos(angles[:, [0, 2]]) > 1e-6
    fine = np.concatenate([np.isfinite(angles), np.isfinite(values), values >= 0, above], axis=1)
    usable = np.asarray(fine.all(axis=1))
    angles, values = angles[usable], values[usable]
    if len(values) < 4:
        raise MeasurementError(
            f"only {len(values)} of {len(usable)} samples are finite, not negative and above the "
            f"horizon; at least 4 are needed. Angles were read as {unit}"
        )
    measured = _features(
        _direction(angles[:, 0], angles[:, 1]), _direction(angles[:, 2], angles[:, 3])
    )
    empty = ReflectanceTable(np.zeros((3, *shape)))
    wi, wo = (Vector(*(np.broadcast_to(a, shape).ravel() for a in w)) for w in empty.directions())
    wanted = _features(wi, wo)
    count = min(NEIGHBOURS, len(values))
    result = np.zeros((len(wanted), 3))
    for start in range(0, len(wanted), 2048):
        part = slice(start, start + 2048)
        distance = ((wanted[part, None, :] - measured[None]) ** 2).sum(axis=2)
        near = np.argpartition(distance, count - 1, axis=1)[:, :count]
        weight = 1 / (np.take_along_axis(distance, near, axis=1) + 1e-9)
        weight /= weight.sum(axis=1, keepdims=True)
        result[part] = (weight[..., None] * values[near]).sum(axis=1)
    table = ReflectanceTable(np.ascontiguousarray(result.T.reshape(3, *shape)))
    keep(table)
    return table


def _direction(theta: Float64, phi: Float64) -> Vector:
    return Vector(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))


def _features(wi: Vector, wo: Vector) -> Float64:
    half, difference, azimuth = half_difference(numpy_maths, wi, wo)
    turn = 2 * np.pi * azimuth
    return np.stack([np.sqrt(half), difference * np.cos(turn), difference * np.sin(turn)], axis=1)
