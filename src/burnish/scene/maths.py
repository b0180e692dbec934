"""The mathematics of model functions over Dr.Jit arrays of the variant in use."""

from __future__ import annotations

from functools import lru_cache
from itertools import product
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
    floor = staticmethod(dr.floor)
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

    @staticmethod
    def lookup3(tables: AnyArray, x: Any, y: Any, z: Any) -> list[Any]:
        """Trilinear interpolation of k tables [k, a, b, c] at points in [0, 1]³."""
        data, shape = _on_device(tables), tables.shape
        cells, shares = [], []
        for value, count in zip((x, y, z), shape[1:], strict=True):
            position = dr.clip(value, 0, 1) * (count - 1)
            cell = dr.minimum(mi.UInt32(position), count - 2)
            cells.append(cell)
            shares.append(position - mi.Float(cell))
        strides = (shape[2] * shape[3], shape[3], 1)
        first = sum(cell * stride for cell, stride in zip(cells, strides, strict=True))
        corners = []
        for bits in product((0, 1), repeat=3):
            share = mi.Float(1)
            for bit, part in zip(bits, shares, strict=True):
                share *= part if bit else 1 - part
            offset = sum(bit * stride for bit, stride in zip(bits, strides, strict=True))
            corners.append((first + offset, share))
        size = int(np.prod(shape[1:]))
        result = []
        for k in range(shape[0]):
            value = mi.Float(0)
            for index, share in corners:
                value = dr.fma(dr.gather(mi.Float, data, index + k * size), share, value)
            result.append(value)
        return result


@lru_cache(maxsize=64)
def _uploaded(variant: str, tables: _Held) -> Any:
    data = mi.Float(np.ascontiguousarray(tables.array, dtype=np.float32).ravel())
    dr.make_opaque(data)
    return data


class _Held:
    """An array that stays alive while its copy on the device is kept."""

    def __init__(self, array: AnyArray) -> None:
        self.array = array

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Held) and self.array is other.array

    def __hash__(self) -> int:
        return id(self.array)


def _on_device(tables: AnyArray) -> Any:
    """A table's copy on the device of the variant in use, made once."""
    return _uploaded(mi.variant(), _Held(tables))


drjit_maths = DrJitMaths()
