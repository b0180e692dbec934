"""The mathematics that model functions use, so that one text runs in NumPy and Dr.Jit.

`Maths` names the functions; `NumpyMaths` is the array version used for tables and
tests. The Dr.Jit version lives in `burnish.scene`, which may import Dr.Jit.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from burnish.core.types import AnyArray


class Vector(NamedTuple):
    """A direction with components that broadcast; anything with .x .y .z will do."""

    x: Any
    y: Any
    z: Any


class Maths(Protocol):
    """The namespace handed to model functions as `xp`."""

    pi: float

    def sqrt(self, x: Any) -> Any: ...
    def exp(self, x: Any) -> Any: ...
    def log(self, x: Any) -> Any: ...
    def sin(self, x: Any) -> Any: ...
    def cos(self, x: Any) -> Any: ...
    def tan(self, x: Any) -> Any: ...
    def acos(self, x: Any) -> Any: ...
    def atan(self, x: Any) -> Any: ...
    def atan2(self, y: Any, x: Any) -> Any: ...
    def power(self, x: Any, y: Any) -> Any: ...
    def abs(self, x: Any) -> Any: ...
    def floor(self, x: Any) -> Any: ...
    def minimum(self, x: Any, y: Any) -> Any: ...
    def maximum(self, x: Any, y: Any) -> Any: ...
    def select(self, condition: Any, x: Any, y: Any) -> Any: ...
    def lookup(self, table: AnyArray, x: Any) -> Any:
        """Linear interpolation of a 1D table whose samples lie at x = 0 … 1, ends included."""
        ...

    def lookup3(self, tables: AnyArray, x: Any, y: Any, z: Any) -> list[Any]:
        """Trilinear interpolation of k tables [k, a, b, c] at points in [0, 1]³, ends included.

        The tables must not change afterwards: a device keeps a copy.
        """
        ...


class NumpyMaths:
    """`Maths` over NumPy arrays and floats."""

    pi = float(np.pi)
    sqrt = staticmethod(np.sqrt)
    exp = staticmethod(np.exp)
    log = staticmethod(np.log)
    sin = staticmethod(np.sin)
    cos = staticmethod(np.cos)
    tan = staticmethod(np.tan)
    acos = staticmethod(np.arccos)
    atan = staticmethod(np.arctan)
    atan2 = staticmethod(np.arctan2)
    power = staticmethod(np.power)
    abs = staticmethod(np.abs)
    floor = staticmethod(np.floor)
    minimum = staticmethod(np.minimum)
    maximum = staticmethod(np.maximum)
    select = staticmethod(np.where)

    @staticmethod
    def lookup(table: AnyArray, x: Any) -> Any:
        return np.interp(x, np.linspace(0.0, 1.0, len(table)), table)

    @staticmethod
    def lookup3(tables: AnyArray, x: Any, y: Any, z: Any) -> list[Any]:
        cells, shares = [], []
        for value, count in zip(np.broadcast_arrays(x, y, z), tables.shape[1:], strict=True):
            position = np.clip(value, 0.0, 1.0) * (count - 1)
            cell = np.minimum(position.astype(np.int64), count - 2)
            cells.append(cell)
            shares.append(position - cell)
        result: list[Any] = [0.0] * len(tables)
        for corner in np.ndindex(2, 2, 2):
            share = 1.0
            for bit, part in zip(corner, shares, strict=True):
                share = share * (part if bit else 1 - part)
            at = tuple(cell + bit for bit, cell in zip(corner, cells, strict=True))
            for k, table in enumerate(tables):
                result[k] = result[k] + share * table[at]
        return result


numpy_maths = NumpyMaths()


def half_vector(xp: Maths, wi: Any, wo: Any) -> Vector:
    """The unit vector between two unit directions."""
    x, y, z = wi.x + wo.x, wi.y + wo.y, wi.z + wo.z
    length = xp.sqrt(xp.maximum(x * x + y * y + z * z, 1e-20))
    return Vector(x / length, y / length, z / length)


def dot(a: Any, b: Any) -> Any:
    """Inner product of two directions."""
    return a.x * b.x + a.y * b.y + a.z * b.z


def theta_half(xp: Maths, wi: Any, wo: Any) -> Any:
    """Angle between the half vector and the normal, exact also where its cosine is near 1."""
    h = half_vector(xp, wi, wo)
    return xp.atan2(xp.sqrt(h.x * h.x + h.y * h.y), h.z)


def log_one_plus(xp: Maths, x: Any) -> Any:
    """log(1 + x) for x >= 0, to about single precision, relative, also where x is small."""
    series = x * (1 - x * (1 / 2 - x * (1 / 3 - x * (1 / 4 - x / 5))))
    return xp.select(x < 0.03, series, xp.log(1 + x))


def one_minus_exp(xp: Maths, x: Any) -> Any:
    """1 − exp(−x) for x >= 0, to about single precision, relative, also where x is small."""
    series = x * (1 - x * (1 / 2 - x * (1 / 6 - x * (1 / 24 - x / 120))))
    return xp.select(x < 0.06, series, 1 - xp.exp(-x))
