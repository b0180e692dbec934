"""Weight maps: the static texture H that multiplies a group of layers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import RGB, Float64

_SIDE = 256


@dataclass(frozen=True)
class WeightMap:
    """H(x) ≥ 0 over an object's surface, linear RGB.

    texture: mi.Texture. scene: mi.Scene. shapes: its mi.Shape objects that carry the map.
    description: the texture's dictionary, empty where it was ready-made.
    """

    texture: Any
    scene: Any
    shapes: tuple[Any, ...]
    description: Mapping[str, Any] = field(default_factory=dict)

    def evaluate(self, si: Any, active: Any = True) -> Any:
        """H at surface interactions: mi.Color3f, clamped to be non-negative."""
        return dr.maximum(mi.Color3f(self.texture.eval(si, active)), 0.0)

    def mean(self) -> RGB:
        """The mean of H over the object's surface, weighted by area.

        Taken at the centres of a grid of 256² equal areas on each shape: deterministic, and
        exact to about 1/256 of the contrast for a map that is smooth at that scale.
        """
        total, area = np.zeros(3), 0.0
        for shape in self.shapes:
            weight = float(np.asarray(shape.surface_area()).item())
            total += weight * self._mean_over(shape)
            area += weight
        mean = total / area
        return (float(mean[0]), float(mean[1]), float(mean[2]))

    def _mean_over(self, shape: Any) -> Float64:
        # Points of equal area, seen from just above by the ray tracer itself, so that the
        # texture gets the interaction that it gets in a picture
        index = dr.arange(mi.UInt32, _SIDE * _SIDE)
        grid = mi.Point2f(mi.Float(index % _SIDE) + 0.5, mi.Float(index // _SIDE) + 0.5) / _SIDE
        position = shape.sample_position(0.0, grid)
        height = 1e-4 * float(np.linalg.norm(np.asarray(shape.bbox().extents())))
        ray = mi.Ray3f(position.p + height * position.n, -position.n)
        ray.maxt = 2 * height
        si = self.scene.ray_intersect(ray)
        hit = si.is_valid() & (si.shape == mi.ShapePtr(shape))
        values = np.asarray(self.evaluate(si, hit), np.float64)
        counted = np.asarray(hit)
        if not counted.any():
            return np.ones(3)
        mean: Float64 = values[:, counted].mean(axis=1)
        return mean
