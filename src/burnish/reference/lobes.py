"""Where a layered material sends light: the distribution that its directions are drawn from.

A mixture of a cosine lobe, half vectors drawn from the material's own curves, and the
mirror direction. The half vectors are tabulated: constant density in each cell of a polar
grid that is finest about the normal, so that one sampler with an exact density serves any
model and any freehand curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float64
from burnish.materials.layer import Layer
from burnish.materials.maths import Vector, numpy_maths

POLAR_CELLS = 1024
AZIMUTH_CELLS = 64
COSINE_SHARE = 0.25
"""Least share of the cosine lobe, so that what the curves do not show is still reached."""


@dataclass(frozen=True)
class Lobe:
    """A layer's part of the mixture: its share of the reflected light and its profile f(t)."""

    layer: Layer
    share: float
    profile: Callable[[Float64], Float64]


class Lobes:
    """The mixture, ready to be drawn from inside a kernel.

    lobes: the layers that are not perfectly smooth. mirror: the share of the smooth ones.
    Directions are in the local frame; both lie above the surface.
    """

    def __init__(self, lobes: Sequence[Lobe], mirror: float = 0.0) -> None:
        half = [lobe for lobe in lobes if lobe.layer.model.lobe == "half" and lobe.share > 0]
        matte = sum(lobe.share for lobe in lobes if lobe.layer.model.lobe == "cosine")
        glossy = sum(lobe.share for lobe in half)
        total = matte + glossy
        cosine = max(COSINE_SHARE, matte / total) if glossy > 0 else 1.0
        p_mirror = mirror / (mirror + total) if mirror > 0 else 0.0
        if total > 0:
            p_mirror = min(p_mirror, 1 - COSINE_SHARE)
        self.p_mirror = dr.opaque(mi.Float, p_mirror)
        self.p_cosine = dr.opaque(mi.Float, (1 - p_mirror) * cosine)
        self.p_half = dr.opaque(mi.Float, (1 - p_mirror) * (1 - cosine))
        self.has_mirror, self.has_half = p_mirror > 0, glossy > 0
        if self.has_half:
            self._tabulate(half)

    def _tabulate(self, half: Sequence[Lobe]) -> None:
        anisotropic = any(lobe.layer.model.anisotropic for lobe in half)
        self.azimuths = AZIMUTH_CELLS if anisotropic else 1
        # Edges in s = sin²(θ/2), in which equal steps are equal solid angles
        theta = _theta_of(np.arange(POLAR_CELLS + 1) / POLAR_CELLS)
        edge = np.sin(theta / 2) ** 2
        middle = _theta_of((np.arange(POLAR_CELLS) + 0.5) / POLAR_CELLS)[:, None]
        phi = 2 * np.pi * (np.arange(self.azimuths) + 0.5)[None, :] / self.azimuths
        h = Vector(
            np.sin(middle) * np.cos(phi),
            np.sin(middle) * np.sin(phi),
            np.cos(middle) + 0 * phi,
        )
        solid_angle = 4 * np.pi * np.diff(edge)[:, None] / self.azimuths
        mass = np.zeros((POLAR_CELLS, self.azimuths))
        for lobe in half:
            # The BRDF where both directions are h, with the cosines of a projected facet
            model, fixed = lobe.layer.model, lobe.layer.fixed
            t = np.asarray(model.coordinate(numpy_maths, h, h, fixed))
            value = np.abs(lobe.profile(t.ravel())).mean(axis=1).reshape(mass.shape)
            quotient = np.abs(model.quotients(numpy_maths, h, h, fixed)[0])
            part = value * quotient * np.cos(middle) ** 2 * solid_angle
            mass += lobe.share * part / max(part.sum(), 1e-300)
        mass /= mass.sum()
        polar = mass.sum(axis=1, keepdims=True)
        within = np.divide(mass, polar, out=np.full_like(mass, 1 / self.azimuths), where=polar > 0)
        self.edge = mi.Float(edge.astype(np.float32))
        self.polar = mi.Float(np.cumsum(polar).astype(np.float32))
        self.azimuth = mi.Float(np.cumsum(within, axis=1).ravel().astype(np.float32))
        self.density = mi.Float((mass / solid_angle).ravel().astype(np.float32))

    def sample(self, wo: Any, u1: Any, u2: Any, active: Any) -> tuple[Any, Any]:
        """A direction wi for light and whether it is the mirror's: Vector3f, Bool.

        wo: towards the viewer. The direction may lie below the surface: no light then.
        """
        wi = mi.warp.square_to_cosine_hemisphere(u2)
        if self.has_half:
            h = self._sample_half(u2, active)
            wi = dr.select(u1 < self.p_cosine, wi, 2 * dr.dot(wo, h) * h - wo)
        is_mirror = mi.Bool(False)
        if self.has_mirror:
            is_mirror = active & (u1 >= self.p_cosine + self.p_half)
            wi = dr.select(is_mirror, mi.Vector3f(-wo.x, -wo.y, wo.z), wi)
        return wi, is_mirror

    def pdf(self, wi: Any, wo: Any, active: Any) -> Any:
        """Density of `sample` per steradian, the mirror direction's mass apart."""
        result = self.p_cosine * wi.z * dr.inv_pi
        if self.has_half:
            h = dr.normalize(wi + wo)
            result += self.p_half * self._pdf_half(h, active) / (4 * dr.abs(dr.dot(wo, h)))
        return dr.select(active & (wi.z > 0) & (wo.z > 0), result, 0)

    def _sample_half(self, u: Any, active: Any) -> Any:
        cell = dr.binary_search(
            0, POLAR_CELLS - 1, lambda i: dr.gather(mi.Float, self.polar, i, active) <= u.x
        )
        below = dr.gather(mi.Float, self.polar, cell - 1, active & (cell > 0))
        above = dr.gather(mi.Float, self.polar, cell, active)
        low = dr.gather(mi.Float, self.edge, cell, active)
        high = dr.gather(mi.Float, self.edge, cell + 1, active)
        s = dr.lerp(low, high, dr.clip((u.x - below) / dr.maximum(above - below, 1e-12), 0, 1))
        sector, within = mi.UInt32(0), u.y
        if self.azimuths > 1:
            row = cell * self.azimuths
            sector = dr.binary_search(
                0,
                self.azimuths - 1,
                lambda i: dr.gather(mi.Float, self.azimuth, row + i, active) <= u.y,
            )
            first = dr.gather(mi.Float, self.azimuth, row + sector - 1, active & (sector > 0))
            last = dr.gather(mi.Float, self.azimuth, row + sector, active)
            within = dr.clip((u.y - first) / dr.maximum(last - first, 1e-12), 0, 1)
        phi = 2 * dr.pi / self.azimuths * (mi.Float(sector) + within)
        sine = 2 * dr.sqrt(s * (1 - s))
        return mi.Vector3f(sine * dr.cos(phi), sine * dr.sin(phi), 1 - 2 * s)

    def _pdf_half(self, h: Any, active: Any) -> Any:
        sine = dr.sqrt(dr.square(h.x) + dr.square(h.y))
        u = dr.sqrt(dr.atan2(sine, h.z) * (2 / dr.pi))
        cell = dr.minimum(mi.UInt32(u * POLAR_CELLS), POLAR_CELLS - 1)
        if self.azimuths > 1:
            turn = dr.atan2(h.y, h.x) * dr.inv_two_pi
            turn = dr.select(turn < 0, turn + 1, turn)
            sector = dr.minimum(mi.UInt32(turn * self.azimuths), self.azimuths - 1)
            cell = cell * self.azimuths + sector
        return dr.gather(mi.Float, self.density, cell, active & (h.z > 0))


def _theta_of(u: Float64) -> Float64:
    """Polar angle of the grid's coordinate u in [0, 1]: narrow cells about the normal."""
    return np.asarray(math.pi / 2 * u**2)
