"""Array aliases that the packages share.

Axis letters in docstrings: p pixels, r rows, c columns, z tails (terms of the
polynomial), n powers, 3 linear RGB.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Bool = NDArray[np.bool_]
AnyArray = NDArray[Any]

RGB = tuple[float, float, float]
Value = float | RGB | str
"""A parameter's value: a scalar, a linear RGB colour or a choice."""

Crop = tuple[int, int, int, int]
"""Pixels of a view: left, top, width, height."""

Progress = Callable[[float, str], None]
"""Called with the fraction done, 0 to 1, and what is being done. May raise to cancel."""
