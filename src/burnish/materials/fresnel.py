"""Reflectance at normal incidence: from an index of refraction, from a metal's name, and back.

    F(0) = ((n − 1)² + k²) / ((n + 1)² + k²)

(Fresnel's equations at θ = 0; Born and Wolf, Principles of Optics, §14.2.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from burnish.core.types import RGB, Value
from burnish.materials.model import Model

WAVELENGTHS = (611.4, 549.1, 464.2)
"""Nanometres that stand for red, green and blue: the dominant wavelengths of sRGB's primaries."""


NORMAL = "reflectance at normal incidence"
"""How models describe such a colour."""


@dataclass(frozen=True)
class Metal:
    """A metal's complex index of refraction n + i k at `WAVELENGTHS`."""

    name: str
    n: RGB
    k: RGB

    @property
    def reflectance(self) -> RGB:
        """F(0), linear RGB."""
        return complex_reflectance(self.n, self.k)


METALS = (
    Metal("silver", (0.058, 0.060, 0.046), (4.106, 3.590, 2.795)),
    Metal("aluminium", (1.322, 1.011, 0.683), (7.311, 6.617, 5.625)),
    Metal("gold", (0.222, 0.428, 1.335), (3.208, 2.461, 1.872)),
    Metal("copper", (0.362, 1.015, 1.246), (3.127, 2.579, 2.453)),
    Metal("chromium", (3.178, 3.180, 2.449), (3.300, 3.330, 3.206)),
    Metal("nickel", (1.985, 1.920, 1.763), (3.985, 3.611, 3.042)),
    Metal("titanium", (2.659, 2.540, 2.303), (3.698, 3.430, 3.080)),
    Metal("iron", (2.890, 2.950, 2.643), (3.040, 2.930, 2.803)),
)
"""Interpolated between measurements: silver, gold and copper by Johnson and Christy (1972,
Phys. Rev. B 6, 4370), chromium, nickel, titanium and iron by the same (1974, Phys. Rev. B 9,
5056), aluminium by Rakić (1995, Appl. Opt. 34, 4755)."""


def ior_of(reflectance: float) -> float:
    """The real index n >= 1 that reflects so much at normal incidence; at most 1e4."""
    root = math.sqrt(min(max(reflectance, 0.0), 1.0))
    return min((1 + root) / max(1 - root, 1e-9), 1e4)


def complex_reflectance(n: RGB, k: RGB) -> RGB:
    """F(0) of an index n + i k per channel."""
    a, b = np.asarray(n, np.float64), np.asarray(k, np.float64)
    r, g, blue = (((a - 1) ** 2 + b**2) / ((a + 1) ** 2 + b**2)).tolist()
    return r, g, blue


def takes_normal_reflectance(model: Model) -> bool:
    """Whether `color` is the reflectance at normal incidence, F0 of Schlick's approximation.

    Such models freeze the F0 of their reference quotient.
    """
    frozen = {item.name for item in model.fixed_parameters}
    return "f0" in frozen and any(item.description == NORMAL for item in model.parameters)


def normal_reflectance(model: Model, values: Mapping[str, Value]) -> RGB | None:
    """F(0) of a model with a Fresnel term, linear RGB; None for a model without one."""
    names = {item.name for item in model.parameters}
    tint = cast(RGB, values.get("color", (1.0, 1.0, 1.0)))
    if {"eta", "k"} <= names:
        first = complex_reflectance(cast(RGB, values["eta"]), cast(RGB, values["k"]))
    elif model.name == "cook-torrance-dielectric":
        n = float(values["ior"])  # type: ignore[arg-type]
        first = complex_reflectance((n, n, n), (0.0, 0.0, 0.0))
    elif takes_normal_reflectance(model):
        return tint
    else:
        return None
    r, g, b = (c * f for c, f in zip(tint, first, strict=True))
    return r, g, b
