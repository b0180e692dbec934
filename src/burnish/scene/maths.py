"""The mathematics of model functions over Dr.Jit arrays of the variant in use."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import AnyArray


class DrJitMaths:
    """`burnish.materials.maths.Maths` over `mi.Float`; the functions are Dr.Jit's own."""

    pi = float(np.pi)
    sqrt = staticmethod(dr.sqrt)
    exp = staticmethod(dr.exp)
    log = staticmethod(dr.log)
    sin = staticmethod(dr.sin)
    cos = staticmethod(dr.cos)
    tan = staticmethod(dr.tan)
    acos = staticmethod(dr.acos)
    atan = staticmethod(dr.atan)
    atan2 = staticmethod(dr.atan2)
    power = staticmethod(dr.power)
    abs = staticmethod(dr.abs)
    minimum = staticmethod(dr.minimum)
    maximum = staticmethod(dr.maximum)
    select = staticmethod(dr.select)

    @staticmethod
    def lookup(table: AnyArray, x: Any) -> Any:
        """Linear interpolation of samples at x = 0 … 1; beyond the ends, the end values."""
        data = mi.Float(np.ascontiguousarray(table, dtype=np.float32))
        last = len(table) - 1
        position = dr.clip(x, 0, 1) * last
        cell = dr.minimum(mi.UInt32(position), max(last - 1, 0))
        low = dr.gather(mi.Float, data, cell)
        high = dr.gather(mi.Float, data, dr.minimum(cell + 1, last))
        return dr.lerp(low, high, position - mi.Float(cell))


drjit_maths = DrJitMaths()
