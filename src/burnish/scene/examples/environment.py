"""Environments made by code: the inside of a room with windows and lamps, as an HDR map."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from burnish.core.types import RGB, Float64

_ROWS = 4
"""Rows of a map that are made at a time, so that they stay in the cache."""


@dataclass(frozen=True)
class Panel:
    """A glowing rectangle on a wall: a window or a softbox.

    wall: "+x", "-x", "+y", "-y" or "+z" (the ceiling). centre, size: metres along the wall's
    two axes (y z, x z, or x y). radiance: linear RGB at its middle. panes: how many columns
    and rows of glass its bars divide. sky: how much darker the lower edge is than the upper.
    soft: width of the fall-off towards the edge, as a fraction of the size.
    """

    wall: str
    centre: tuple[float, float]
    size: tuple[float, float]
    radiance: RGB
    panes: tuple[int, int] = (1, 1)
    sky: float = 0.0
    soft: float = 0.02

    @property
    def axis(self) -> int:
        return "xyz".index(self.wall[1])

    @property
    def side(self) -> float:
        return 1.0 if self.wall[0] == "+" else -1.0

    def emission(self, u: Float64, v: Float64) -> Float64:
        """Radiance [..., 3] at wall coordinates; zero outside and on the bars."""
        s = (u - self.centre[0]) / self.size[0] + 0.5
        t = (v - self.centre[1]) / self.size[1] + 0.5
        inside = _plateau(s, self.soft) * _plateau(t, self.soft)
        for x, count, length in zip((s, t), self.panes, self.size, strict=True):
            if count > 1:
                distance = np.abs(x * count - np.round(x * count)) / count * length
                inside *= np.clip((distance - 0.03) / 0.02, 0.0, 1.0)
        gradient = 1.0 - self.sky * (1.0 - np.clip(t, 0.0, 1.0))
        return (inside * gradient)[..., None] * np.asarray(self.radiance)


@dataclass(frozen=True)
class Room:
    """A box-shaped room seen from a point inside.

    low, high: its corners relative to the viewpoint, in metres, z up. walls, floor: albedo of
    the side walls and ceiling, and of the floor. ambient: light that comes back from
    everywhere, beside the direct light of the panels.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    panels: tuple[Panel, ...]
    walls: RGB
    floor: RGB
    ambient: RGB

    def radiance(self, direction: Float64) -> Float64:
        """Radiance [n, 3], linear RGB, from unit directions [n, 3]."""
        axis, side, point = self._hit(direction)
        result = np.empty(direction.shape)
        for k in range(3):
            for sign in (-1.0, 1.0):
                here = (axis == k) & (side == sign)
                result[here] = self._wall(k, sign, point[here])
        return result

    def _wall(self, k: int, sign: float, point: Float64) -> Float64:
        """What leaves one wall at points [n, 3] on it: its panels, and the light they throw."""
        u, v = (axis for axis in range(3) if axis != k)
        emitted = np.zeros(point.shape)
        for panel in self.panels:
            if (panel.axis, panel.side) == (k, sign):
                emitted += panel.emission(point[:, u], point[:, v])
        albedo = np.asarray(self.floor if (k, sign) == (2, -1.0) else self.walls)
        light = _interpolated(
            self._lightmaps[k, sign],
            (point[:, u] - self.low[u]) / (self.high[u] - self.low[u]),
            (point[:, v] - self.low[v]) / (self.high[v] - self.low[v]),
        )
        result: Float64 = emitted + albedo / np.pi * light
        return result

    def _hit(self, direction: Float64) -> tuple[NDArray[np.int64], Float64, Float64]:
        """Which wall a ray from the viewpoint meets (axis, side) and where."""
        with np.errstate(divide="ignore", invalid="ignore"):
            bounds = np.where(direction > 0, np.asarray(self.high), np.asarray(self.low))
            distance = np.where(direction == 0, np.inf, bounds / direction)
        axis = distance.argmin(axis=-1)
        nearest = np.take_along_axis(distance, axis[:, None], -1)
        component = np.take_along_axis(direction, axis[:, None], -1)[:, 0]
        return axis, np.sign(component), direction * nearest

    @cached_property
    def _lightmaps(self) -> dict[tuple[int, float], Float64]:
        """Irradiance on a 33 × 33 lattice over each wall: [33, 33, 3] by axis and side."""
        t = np.linspace(0.0, 1.0, 33)
        maps = {}
        for k in range(3):
            u, v = (axis for axis in range(3) if axis != k)
            for sign in (-1.0, 1.0):
                point = np.empty((33, 33, 3))
                point[..., k] = (self.low, self.high)[sign > 0][k]
                point[..., u] = (self.low[u] + t * (self.high[u] - self.low[u]))[:, None]
                point[..., v] = (self.low[v] + t * (self.high[v] - self.low[v]))[None, :]
                light = np.broadcast_to(np.asarray(self.ambient), point.shape)
                maps[k, sign] = light + sum(
                    self._irradiance(panel, point, -sign * np.eye(3)[k]) for panel in self.panels
                )
        return maps

    def _irradiance(self, panel: Panel, point: Float64, normal: Float64) -> Float64:
        """Light [..., 3] that a panel throws on points of a wall, from 6 × 6 of its points."""
        u, v = (axis for axis in range(3) if axis != panel.axis)
        steps = (np.arange(6) + 0.5) / 6 - 0.5
        area = panel.size[0] * panel.size[1] / 36
        total = np.zeros(point.shape)
        for a in panel.centre[0] + panel.size[0] * steps:
            for b in panel.centre[1] + panel.size[1] * steps:
                source = np.empty(3)
                source[panel.axis] = (self.low, self.high)[panel.side > 0][panel.axis]
                source[u], source[v] = a, b
                to_source = source - point
                squared = np.maximum((to_source**2).sum(-1), 0.05)
                cosines = np.maximum(to_source @ normal, 0.0)
                cosines = cosines * np.maximum(panel.side * to_source[..., panel.axis], 0.0)
                glow = panel.emission(np.asarray(a), np.asarray(b))
                total += (area * cosines / squared**2)[..., None] * glow
        return total


def write_environment(room: Room, path: Path, width: int = 768) -> str:
    """Write a room as a latitude-longitude map; returns its path as text."""
    height = width // 2
    # Three by three directions per texel soften the edges of the windows
    fine = 3
    theta = (np.arange(height * fine) + 0.5) / (height * fine) * np.pi
    phi = (np.arange(width * fine) + 0.5) / (width * fine) * 2 * np.pi
    image = np.empty((height, width, 3), np.float32)
    for row in range(0, height, _ROWS):
        t = theta[row * fine : (row + _ROWS) * fine, None]
        x, y, z = np.sin(t) * np.sin(phi), np.sin(t) * np.cos(phi), np.cos(t) + 0 * phi
        colour = room.radiance(np.stack([x, y, z], -1).reshape(-1, 3))
        image[row : row + _ROWS] = colour.reshape(-1, fine, width, fine, 3).mean(axis=(1, 3))
    mi.Bitmap(image).write(str(path))
    return str(path)


def envmap(filename: str, scale: float = 1.0) -> dict[str, Any]:
    """The emitter for such a map in a scene whose z axis points up."""
    return {
        "type": "envmap",
        "filename": filename,
        "scale": scale,
        "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], 90),
    }


def _interpolated(table: Float64, x: Float64, y: Float64) -> Float64:
    """Bilinear values [n, 3] of a lattice [m, m, 3] at x, y in [0, 1]."""
    last = len(table) - 1
    i = np.clip((x * last).astype(int), 0, last - 1)
    j = np.clip((y * last).astype(int), 0, last - 1)
    a, b = (x * last - i)[:, None], (y * last - j)[:, None]
    low = table[i, j] * (1 - a) + table[i + 1, j] * a
    high = table[i, j + 1] * (1 - a) + table[i + 1, j + 1] * a
    result: Float64 = low * (1 - b) + high * b
    return result


def _plateau(x: Float64, soft: float) -> Float64:
    """1 well inside [0, 1], 0 outside, smooth between."""
    edge = np.clip(np.minimum(x, 1.0 - x) / soft, 0.0, 1.0)
    result: Float64 = edge * edge * (3.0 - 2.0 * edge)
    return result
