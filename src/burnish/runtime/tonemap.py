"""From linear RGB to what a screen shows.

Pictures are linear sRGB primaries; a tone curve maps [0, ∞) to [0, 1] and the sRGB
transfer function encodes it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from burnish.core.colour import luminance, srgb_from_linear
from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Float32


@dataclass(frozen=True)
class ToneMap:
    """How a picture is shown.

    operator: one of `OPERATORS`. exposure: in stops, -20 to 20. white: the linear RGB that
    is shown as neutral, each > 0; a picture of that colour comes out grey.
    """

    operator: str = "srgb"
    exposure: float = 0.0
    white: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        if self.operator not in OPERATORS:
            raise UnknownName("tone-mapping operator", self.operator, OPERATORS)
        if not -20.0 <= self.exposure <= 20.0:
            raise InvalidValue(f"exposure must lie in [-20, 20] stops; got {self.exposure!r}")
        if np.shape(self.white) != (3,) or not all(0.0 < w < np.inf for w in self.white):
            raise InvalidValue(f"white must be three numbers above 0; got {self.white!r}")

    def display(self, image: Float32) -> Float32:
        """Encoded sRGB in [0, 1]: float32, the shape of `image` [..., 3]."""
        white = np.asarray(self.white, np.float32)
        gain = np.float32(2.0**self.exposure) * (white.mean(dtype=np.float32) / white)
        linear = OPERATORS[self.operator](np.maximum(image, np.float32(0.0)) * gain)
        return srgb_from_linear(np.clip(linear, 0.0, 1.0)).astype(np.float32)

    def to_bytes(self, image: Float32) -> np.ndarray:
        """uint8 [..., 3], ready for a PNG."""
        return (self.display(image) * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)


def _reinhard(x: Float32) -> Float32:
    """Reinhard et al. 2002, eq. 3, on luminance."""
    return np.asarray(x / (1.0 + luminance(x)[..., None]))


def _filmic(x: Float32) -> Float32:
    """Hable's curve (Uncharted 2, GDC 2010), white at 11.2."""

    def curve(v: Float32) -> Float32:
        a, b, c, d, e, f = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30
        return np.asarray((v * (a * v + c * b) + d * e) / (v * (a * v + b) + d * f) - e / f)

    return curve(np.float32(2.0) * x) / curve(np.array(11.2, np.float32))


_ACES_IN = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]],
    np.float32,
)
_ACES_OUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]],
    np.float32,
)


def _aces(x: Float32) -> Float32:
    """Hill's fit of the ACES reference and output transforms (BakingLab, MIT licence)."""
    v = x @ _ACES_IN.T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    return np.clip(v @ _ACES_OUT.T, 0.0, 1.0).astype(np.float32)


_AGX_IN = np.array(
    [
        [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
        [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
        [0.0423756549057051, 0.0784336, 0.879142973793104],
    ],
    np.float32,
)


def _agx(x: Float32) -> Float32:
    """Wrensch's minimal fit of Sobotka's AgX base look, brought back to linear sRGB."""
    low, high = -12.47393, 4.026069
    v = np.log2(np.maximum(x @ _AGX_IN.T, 1e-10))
    v = (np.clip(v, low, high) - low) / (high - low)
    v2 = v * v
    v4 = v2 * v2
    contrast = 15.5 * v4 * v2 - 40.14 * v4 * v + 31.96 * v4 - 6.868 * v2 * v
    contrast = contrast + 0.4298 * v2 + 0.1191 * v - 0.00232
    v = contrast.astype(np.float32) @ np.linalg.inv(_AGX_IN).T.astype(np.float32)
    return np.asarray(np.power(np.clip(v, 0.0, 1.0), np.float32(2.2)))


OPERATORS: dict[str, Callable[[Float32], Float32]] = {
    "srgb": lambda x: x,
    "reinhard": _reinhard,
    "filmic": _filmic,
    "aces": _aces,
    "agx": _agx,
}
"""Tone curves by name: linear in, linear display light out."""
