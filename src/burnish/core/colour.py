"""Colour: linear RGB with Rec. 709 primaries inside, sRGB where people look or type."""

from __future__ import annotations

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import RGB, AnyArray, Float64

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
"""Weights of linear red, green and blue in the luminance Y (ITU-R BT.709)."""


def srgb_from_linear(linear: AnyArray) -> Float64:
    """sRGB's encoding of linear values, any shape, both nominally in [0, 1].

    Values outside are encoded by the same curve, odd about 0 (IEC 61966-2-1).
    """
    x = np.asarray(linear, np.float64)
    magnitude = np.abs(x)
    curved = 1.055 * np.power(magnitude, 1 / 2.4) - 0.055
    return np.copysign(np.where(magnitude <= 0.0031308, 12.92 * magnitude, curved), x)


def linear_from_srgb(encoded: AnyArray) -> Float64:
    """Linear values of sRGB-encoded ones; the inverse of `srgb_from_linear`."""
    x = np.asarray(encoded, np.float64)
    magnitude = np.abs(x)
    curved = np.power((magnitude + 0.055) / 1.055, 2.4)
    return np.copysign(np.where(magnitude <= 0.04045, magnitude / 12.92, curved), x)


def luminance(linear: AnyArray) -> AnyArray:
    """Y of linear RGB in the last axis."""
    return np.asarray(linear @ LUMINANCE.astype(linear.dtype))


def colour_from_hex(text: str) -> RGB:
    """Linear RGB of an sRGB colour written #rrggbb or #rgb. Raises InvalidValue."""
    digits = text.removeprefix("#")
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    try:
        if len(digits) != 6:
            raise ValueError
        encoded = np.frombuffer(bytes.fromhex(digits), np.uint8) / 255.0
    except ValueError:
        raise InvalidValue(f"a colour is written #rrggbb or #rgb; got {text!r}") from None
    red, green, blue = linear_from_srgb(encoded).tolist()
    return red, green, blue
