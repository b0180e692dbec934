"""A picture on a surface in place of a parameter's one value (2008, section 5.3).

What a point has is scale · picture + offset, inside the parameter's limits; of a colour, times
the parameter's own value, which tints. The parameter's value of a scalar is the mean of that,
so that its slider scales the picture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import AnyArray, Float32, Int64
from burnish.materials.images.texels import Texels

Place = tuple[str, str]
"""(layer, parameter)."""
Transform = tuple[float, float, float, float, float, float]
"""a, b, c, d, e, f of u' = a u + b v + c, v' = d u + e v + f."""
Wrap = Literal["repeat", "clamp", "mirror"]

UPRIGHT: Transform = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
LARGEST_SCALE = 1000.0


@dataclass(frozen=True)
class ImageMap:
    """A picture, how it lies on the surface, and how it is edited.

    source: the file that it is from, "" for the scene's own; channel: which of the file's.
    transform: from the surface's uv
    to the picture's. wrap: what lies beyond it. smooth: between texels linear, else the
    nearest. Raises InvalidValue.
    """

    texels: Texels
    source: str = ""
    channel: str = ""
    scale: float = 1.0
    offset: float = 0.0
    transform: Transform = UPRIGHT
    wrap: Wrap = "repeat"
    smooth: bool = True

    def __post_init__(self) -> None:
        for name in ("scale", "offset"):
            value: float = getattr(self, name)
            if not abs(value) <= LARGEST_SCALE:
                raise InvalidValue(
                    f"a map's {name} must lie in [{-LARGEST_SCALE:g}, {LARGEST_SCALE:g}]; "
                    f"got {value!r}"
                )
        if self.wrap not in get_args(Wrap):
            raise InvalidValue(
                f"a map's wrap must be one of {', '.join(get_args(Wrap))}; got {self.wrap!r}"
            )
        if not all(map(math.isfinite, self.transform)):
            raise InvalidValue(f"a map's transform must be six numbers; got {self.transform!r}")

    @property
    def mean(self) -> tuple[float, ...]:
        """Mean of each channel as edited, limits apart."""
        return tuple(float(m) * self.scale + self.offset for m in self.texels.mean)

    def raw(self, uv: AnyArray) -> Float32:
        """The picture itself at uv [..., 2]: float32 [..., 1 or 3].

        As Mitsuba's `bitmap`: texel centres at (i + ½) / n.
        """
        a, b, c, d, e, f = self.transform
        values = self.texels.values
        height, width, _ = values.shape
        u, v = uv[..., 0].astype(np.float64), uv[..., 1].astype(np.float64)
        x, y = (a * u + b * v + c) * width, (d * u + e * v + f) * height
        if not self.smooth:
            column, row = (np.floor(at).astype(np.int64) for at in (x, y))
            nearest = _wrapped(row, height, self.wrap), _wrapped(column, width, self.wrap)
            return np.asarray(values[nearest])
        x, y = x - 0.5, y - 0.5
        left, low = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        s = (x - left).astype(np.float32)[..., None]
        t = (y - low).astype(np.float32)[..., None]
        columns = [_wrapped(left + k, width, self.wrap) for k in (0, 1)]
        rows = [_wrapped(low + k, height, self.wrap) for k in (0, 1)]
        lower, upper = (
            (1 - s) * values[row, columns[0]] + s * values[row, columns[1]] for row in rows
        )
        return np.asarray((1 - t) * lower + t * upper, np.float32)

    def at(self, uv: AnyArray) -> Float32:
        """scale · picture + offset at uv [..., 2]: float32 [..., 1 or 3]."""
        return np.asarray(self.raw(uv) * np.float32(self.scale) + np.float32(self.offset))

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "texels": self.texels.to_json(),
            "source": self.source,
            "channel": self.channel,
            "scale": self.scale,
            "offset": self.offset,
            "transform": list(self.transform),
            "wrap": self.wrap,
            "smooth": self.smooth,
        }

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> ImageMap:
        """The inverse of `to_json`. Raises InvalidValue."""
        try:
            return ImageMap(
                Texels.from_json(data["texels"]),
                str(data["source"]),
                str(data["channel"]),
                float(data["scale"]),
                float(data["offset"]),
                transform_of(data["transform"]),
                data["wrap"],
                bool(data["smooth"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidValue(f"a map has a field that is missing or wrong ({error})") from None


Images = Mapping[Place, ImageMap]


def transform_of(numbers: Any) -> Transform:
    """Six numbers as a transform. Raises InvalidValue."""
    try:
        a, b, c, d, e, f = (float(number) for number in numbers)
    except (TypeError, ValueError):
        raise InvalidValue(
            f"a map's transform must be six numbers a, b, c, d, e, f; got {numbers!r}"
        ) from None
    return a, b, c, d, e, f


def placed(
    repeat: tuple[float, float] = (1.0, 1.0),
    rotate: float = 0.0,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Transform:
    """A picture repeated so many times along u and v, turned by degrees, then shifted.

    The turn is about the middle of the unit square, so that a picture stays where it lies.
    """
    turn = math.radians(rotate)
    cos, sin = math.cos(turn), math.sin(turn)
    a, b = repeat[0] * cos, repeat[0] * sin
    d, e = -repeat[1] * sin, repeat[1] * cos
    c = repeat[0] * (0.5 - 0.5 * (cos + sin)) + shift[0]
    f = repeat[1] * (0.5 - 0.5 * (cos - sin)) + shift[1]
    return a, b, c, d, e, f


@dataclass(frozen=True)
class Placement:
    """What `placed` takes, of a transform without shear. rotate: degrees."""

    repeat: tuple[float, float]
    rotate: float
    shift: tuple[float, float]

    @staticmethod
    def of(transform: Transform) -> Placement:
        """Of a transform; where it shears, of the closest one that does not."""
        a, b, c, d, e, f = transform
        sign = 1.0 if a * e - b * d >= 0 else -1.0
        repeat = math.hypot(a, b), sign * math.hypot(d, e)
        rotate = math.atan2(b, a)
        plain = placed(repeat, math.degrees(rotate))
        return Placement(repeat, math.degrees(rotate), (c - plain[2], f - plain[5]))


def _wrapped(index: Int64, count: int, wrap: Wrap) -> Int64:
    if wrap == "clamp":
        return np.clip(index, 0, count - 1)
    if wrap == "mirror":
        folded = np.mod(index, 2 * count)
        return np.where(folded < count, folded, 2 * count - 1 - folded)
    return np.mod(index, count)
