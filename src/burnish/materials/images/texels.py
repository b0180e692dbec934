"""The numbers of a picture that stands for a parameter."""

from __future__ import annotations

import base64
import hashlib
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from burnish.core.colour import linear_from_srgb, luminance, srgb_from_linear
from burnish.core.errors import InvalidValue
from burnish.core.types import AnyArray, Float32, Float64

LARGEST = 2048
"""The longest side that is kept; larger pictures are averaged down."""
_CODES = ("srgb8", "linear8", "float32")


@dataclass(frozen=True, eq=False)
class Texels:
    """A picture's values: float32 [height, width, 1 or 3], linear, the first row at v = 0.

    Equal when the numbers are. Raises InvalidValue for what is no picture or not finite.
    """

    values: Float32

    def __post_init__(self) -> None:
        values = np.ascontiguousarray(self.values, np.float32)
        if values.ndim != 3 or values.shape[2] not in (1, 3) or not values.size:
            raise InvalidValue(
                f"a map must be a picture of 1 or 3 channels; got an array of {values.shape}"
            )
        if not np.isfinite(values).all():
            raise InvalidValue("a map must be finite; got NaN or infinity")
        values = _reduced(values)
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of shape and values."""
        found = hashlib.sha256(str(self.values.shape).encode())
        found.update(self.values.tobytes())
        return found.hexdigest()

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        return isinstance(other, Texels) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    @cached_property
    def mean(self) -> Float64:
        """Mean of each channel: float64 [1 or 3]."""
        return np.asarray(self.values.mean(axis=(0, 1), dtype=np.float64))

    def single(self) -> Texels:
        """One channel: of a colour its luminance, as Mitsuba reads one number of a picture."""
        if self.values.shape[2] == 1:
            return self
        return Texels(luminance(self.values)[..., None])

    def coloured(self) -> Texels:
        """Three channels."""
        return Texels(np.broadcast_to(self.values, (*self.values.shape[:2], 3)))

    def to_json(self) -> dict[str, Any]:
        """Plain values; eight bits a channel where the picture has no more."""
        code, packed = _packed(self.values)
        text = base64.b64encode(zlib.compress(packed.tobytes(), 6)).decode("ascii")
        return {"shape": list(self.values.shape), "code": code, "data": text}

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> Texels:
        """The inverse of `to_json`. Raises InvalidValue."""
        try:
            code = str(data["code"])
            raw = zlib.decompress(base64.b64decode(data["data"], validate=True))
            kind = np.float32 if code == "float32" else np.uint8
            values = np.frombuffer(raw, kind).reshape(data["shape"])
            if code not in _CODES:
                raise ValueError(f"code {code!r}")
        except (KeyError, TypeError, ValueError, zlib.error) as error:
            raise InvalidValue(f"a map is damaged ({error}); bake the scene again") from None
        return Texels(_unpacked(code, values))


def _packed(values: Float32) -> tuple[str, AnyArray]:
    """The narrowest code that gives the values back to float precision."""
    if values.min() >= 0 and values.max() <= 1:
        for code, coded in (("srgb8", srgb_from_linear(values)), ("linear8", values)):
            small = np.asarray(np.round(255 * coded), np.uint8)
            if np.allclose(_unpacked(code, small), values, rtol=1e-3, atol=1e-6):
                return code, small
    return "float32", values


def _unpacked(code: str, values: AnyArray) -> Float32:
    if code == "float32":
        return np.asarray(values, np.float32)
    wide = values.astype(np.float32) / 255
    return np.asarray(linear_from_srgb(wide) if code == "srgb8" else wide, np.float32)


def _reduced(values: Float32) -> Float32:
    """Blocks of texels averaged until the longest side fits."""
    step = -(-max(values.shape[:2]) // LARGEST)
    if step == 1:
        return values.copy()
    down, across = (min(step, n) for n in values.shape[:2])
    height, width = (n // k for n, k in zip(values.shape, (down, across), strict=False))
    blocks = values[: height * down, : width * across].reshape(height, down, width, across, -1)
    return np.asarray(blocks.mean(axis=(1, 3)), np.float32)
