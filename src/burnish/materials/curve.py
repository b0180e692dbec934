"""Freehand edits of a model's profile: a curve is a value of its own, not a special case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import RGB, Float64

Mode = Literal["replace", "gain"]
Interpolation = Literal["cubic", "linear"]
MAXIMUM_POINTS = 4096


@dataclass(frozen=True)
class Curve:
    """A curve through control points that replaces or scales the profile f(t) (2006, §4.1).

    points: rising positions in t, each in [0, 1]. values: linear RGB at each, finite and
      >= 0. mode: "replace" puts the curve in the profile's place; "gain" multiplies it, so
      that a parameter goes on shaping the lobe below. interpolation: "cubic" is monotone
      between points (Fritsch and Carlson 1980) and so never overshoots below zero.
    Beyond its end points the curve keeps their values.
    Raises InvalidValue.
    """

    points: tuple[float, ...]
    values: tuple[RGB, ...]
    mode: Mode = "gain"
    interpolation: Interpolation = "cubic"

    def __post_init__(self) -> None:
        if self.mode not in get_args(Mode):
            raise InvalidValue(f"curve mode must be 'replace' or 'gain'; got {self.mode!r}")
        if self.interpolation not in get_args(Interpolation):
            raise InvalidValue(
                f"curve interpolation must be 'cubic' or 'linear'; got {self.interpolation!r}"
            )
        if not 1 <= len(self.points) <= MAXIMUM_POINTS or len(self.points) != len(self.values):
            raise InvalidValue(
                f"a curve needs 1 to {MAXIMUM_POINTS} points and one colour for each; "
                f"got {len(self.points)} points and {len(self.values)} colours"
            )
        if not all(0.0 <= t <= 1.0 for t in self.points):
            raise InvalidValue(f"curve points must lie in [0, 1]; got {self.points!r}")
        if any(a >= b for a, b in zip(self.points, self.points[1:], strict=False)):
            raise InvalidValue(f"curve points must rise; got {self.points!r}")
        colours = np.asarray(self.values, np.float64)
        if colours.shape != (len(self.points), 3) or not (colours >= 0).all():
            raise InvalidValue("curve values must be three numbers >= 0 (linear RGB)")
        if not np.isfinite(colours).all():
            raise InvalidValue("curve values must be finite")

    def evaluate(self, t: Float64) -> Float64:
        """The curve itself: float64 [len(t), 3]."""
        x, y = np.asarray(self.points), np.asarray(self.values)
        if len(x) == 1:
            return np.repeat(y, len(t), axis=0)
        if self.interpolation == "linear":
            return np.stack([np.interp(t, x, y[:, channel]) for channel in range(3)], axis=1)
        return _monotone_cubic(np.clip(t, x[0], x[-1]), x, y)

    def apply(self, t: Float64, profile: Float64) -> Float64:
        """The edited profile at t: float64 [len(t), 3]; `profile` is [len(t), 3 or 1]."""
        curve = self.evaluate(t)
        return curve if self.mode == "replace" else curve * profile

    def to_json(self) -> dict[str, Any]:
        """A dictionary of plain lists and strings."""
        return {
            "mode": self.mode,
            "interpolation": self.interpolation,
            "t": list(self.points),
            "values": [list(value) for value in self.values],
        }

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> Curve:
        """The inverse of `to_json`. Raises InvalidValue when a field is missing or wrong."""
        try:
            return Curve(
                points=tuple(float(t) for t in data["t"]),
                values=tuple((float(r), float(g), float(b)) for r, g, b in data["values"]),
                mode=data["mode"],
                interpolation=data["interpolation"],
            )
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, InvalidValue):
                raise
            raise InvalidValue(
                "a curve needs mode, interpolation, t and values (a list of RGB triples); "
                f"got {data!r}"
            ) from None


def _monotone_cubic(t: Float64, x: Float64, y: Float64) -> Float64:
    """Cubic Hermite interpolation with slopes limited to keep each interval monotone."""
    step = np.diff(x)[:, None]
    secant = np.diff(y, axis=0) / step
    slope = np.concatenate([secant[:1], np.zeros_like(secant[1:]), secant[-1:]])
    if len(x) > 2:
        # Brodlie's weighted harmonic mean; zero at local extrema
        before, after = secant[:-1], secant[1:]
        w1, w2 = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
        same = before * after > 0
        safe_before, safe_after = np.where(same, before, 1.0), np.where(same, after, 1.0)
        # Next to a secant near the least float the mean is 0
        with np.errstate(over="ignore"):
            mean = (w1 + w2) / (w1 / safe_before + w2 / safe_after)
        slope[1:-1] = np.where(same, mean, 0.0)
    i = np.clip(np.searchsorted(x, t, side="right") - 1, 0, len(x) - 2)
    h = step[i]
    u = (t - x[i])[:, None] / h
    result = (
        (1 + 2 * u) * (1 - u) ** 2 * y[i]
        + u * (1 - u) ** 2 * h * slope[i]
        + u * u * (3 - 2 * u) * y[i + 1]
        + u * u * (u - 1) * h * slope[i + 1]
    )
    return np.asarray(np.maximum(result, 0.0))
