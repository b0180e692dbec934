"""The one rendition in which two pictures are compared by eye: exposure, then sRGB."""

from __future__ import annotations

import numpy as np

from burnish.core.colour import luminance, srgb_from_linear
from burnish.core.types import Float32

HIGHLIGHT_PERCENTILE = 98.0
HIGHLIGHT_LEVEL = 0.9


def auto_exposure(reference: Float32) -> float:
    """The factor that shows a picture's 98th percentile of luminance at 0.9 of white.

    reference: linear RGB [..., 3], directly seen emission left out, so that one lamp in view
    does not darken the rest. 1 for a black picture.
    """
    level = float(np.percentile(luminance(np.asarray(reference, np.float64)), HIGHLIGHT_PERCENTILE))
    return HIGHLIGHT_LEVEL / level if level > 0 else 1.0


def display(image: Float32, exposure: float = 1.0) -> Float32:
    """sRGB in [0, 1] of a linear picture: float32, same shape."""
    shown = np.clip(np.asarray(image, np.float64) * exposure, 0.0, 1.0)
    return srgb_from_linear(shown).astype(np.float32)
