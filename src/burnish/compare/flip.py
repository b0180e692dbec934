"""LDR-FLIP of two displayed pictures, by NVIDIA's own implementation.

Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flip_evaluator import evaluate

from burnish.core.errors import InvalidValue
from burnish.core.types import Float32

PIXELS_PER_DEGREE = 67.0
"""A 0.7 m wide 4K monitor seen from 0.7 m: the evaluator's default."""


@dataclass(frozen=True)
class Flip:
    """mean: 0 (no visible difference) to 1. heat: float32 [height, width, 3], the error map
    in the magma palette, sRGB in [0, 1]."""

    mean: float
    heat: Float32


def flip(image: Float32, reference: Float32) -> Flip:
    """FLIP between two sRGB pictures in [0, 1], each [height, width, 3].

    Raises InvalidValue when they differ in shape or leave the range.
    """
    for name, picture in (("image", image), ("reference", reference)):
        if picture.shape != reference.shape or picture.ndim != 3 or picture.shape[2] != 3:
            raise InvalidValue(
                f"image and reference must both be [height, width, 3]; got {image.shape} and "
                f"{reference.shape}"
            )
        if not (np.isfinite(picture).all() and picture.min() >= 0 and picture.max() <= 1):
            raise InvalidValue(f"{name} must lie in [0, 1]; apply burnish.compare.display first")
    heat, mean, _ = evaluate(
        np.ascontiguousarray(reference, np.float32),
        np.ascontiguousarray(image, np.float32),
        "LDR",
        parameters={"ppd": PIXELS_PER_DEGREE},
    )
    return Flip(float(mean), np.asarray(heat, np.float32))
