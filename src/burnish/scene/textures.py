"""Textures that weight maps are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import RGB

if TYPE_CHECKING:
    from burnish.scene.reader import Description


def interreflected(texture: Description, internal: float) -> Description:
    """A texture t seen through a coat that throws `internal` back: (1 − R) t / (1 − R t).

    The nonlinear colour of Mitsuba's `plastic`, up to a factor, as the dictionary of a
    texture plugin that is registered with the current variant.
    """
    _register_interreflected()
    return {"type": _PLUGIN, "internal": internal, "nested": dict(texture)}


_PLUGIN = "burnish_interreflected"
_registered: set[tuple[str, str]] = set()


def _register_interreflected() -> None:
    if (mi.variant(), _PLUGIN) in _registered:
        return

    class Interreflected(mi.Texture):
        def __init__(self, props: Any) -> None:
            mi.Texture.__init__(self, props)
            self.nested = props["nested"]
            self.internal = float(props["internal"])

        def eval(self, si: Any, active: Any = True) -> Any:
            t = self.nested.eval(si, active)
            return (1 - self.internal) * t / (1 - self.internal * t)

        def mean(self) -> Any:
            t = self.nested.mean()
            return (1 - self.internal) * t / (1 - self.internal * t)

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"Interreflected[internal={self.internal}, nested={self.nested}]"

    mi.register_texture(_PLUGIN, Interreflected)
    _registered.add((mi.variant(), _PLUGIN))


@dataclass(frozen=True)
class Factor:
    """offset + scale · texture, of a weight map that is a product.

    single: the texture is read as one number, as Mitsuba reads a `metallic`, not as a colour.
    """

    texture: Description
    scale: float = 1.0
    offset: float = 0.0
    single: bool = False


def product(factors: Sequence[Factor]) -> Description:
    """The texture that multiplies `factors`, as a dictionary for the current variant."""
    if len(factors) == 1 and factors[0] == Factor(factors[0].texture):
        return factors[0].texture
    _register_product()
    result: dict[str, Any] = {"type": _PRODUCT}
    for number, factor in enumerate(factors):
        result[f"nested_{number}"] = dict(factor.texture)
        result[f"scale_{number}"] = factor.scale
        result[f"offset_{number}"] = factor.offset
        result[f"single_{number}"] = factor.single
    return result


_PRODUCT = "burnish_product"


def _register_product() -> None:
    if (mi.variant(), _PRODUCT) in _registered:
        return

    class Product(mi.Texture):
        def __init__(self, props: Any) -> None:
            mi.Texture.__init__(self, props)
            self.factors: list[tuple[Any, ...]] = []
            while f"nested_{len(self.factors)}" in props:
                number = len(self.factors)
                names = ("nested", "scale", "offset", "single")
                self.factors.append(tuple(props[f"{name}_{number}"] for name in names))

        def eval(self, si: Any, active: Any = True) -> Any:
            result = mi.Color3f(1)
            for nested, scale, offset, single in self.factors:
                if isinstance(nested, mi.ScalarColor3d):  # so Mitsuba hands on a constant colour
                    value = nested
                else:
                    value = nested.eval_1(si, active) if single else nested.eval(si, active)
                result *= offset + scale * mi.Color3f(value)
            return result

        def mean(self) -> Any:
            # Of the product of means: it only shapes how Mitsuba's plugins draw samples
            result = mi.Float(1)
            for nested, scale, offset, _ in self.factors:
                constant = isinstance(nested, mi.ScalarColor3d)
                result *= offset + scale * (dr.mean(nested) if constant else nested.mean())
            return result

        def is_spatially_varying(self) -> bool:
            return True

        def to_string(self) -> str:
            return f"Product[{', '.join(str(nested) for nested, *_ in self.factors)}]"

    mi.register_texture(_PRODUCT, Product)
    _registered.add((mi.variant(), _PRODUCT))


def texture_mean(texture: Description) -> RGB:
    """Mean colour over the unit square of uv, on a 128² grid."""
    side = 128
    index = np.arange(side * side)
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(
        mi.Float(((index % side + 0.5) / side).astype(np.float32)),
        mi.Float(((index // side + 0.5) / side).astype(np.float32)),
    )
    colour = np.asarray(mi.Color3f(mi.load_dict(dict(texture)).eval(si)), np.float64)
    r, g, b = np.broadcast_to(colour.reshape(3, -1), (3, side * side)).mean(axis=1)
    return (float(r), float(g), float(b))
