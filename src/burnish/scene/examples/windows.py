"""Windows: their casements, and a bright panel outside with a sky and blurred trees on it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.scene.examples.geometry import Mesh, Point, joined, rectangle
from burnish.scene.examples.shapes import rounded_box
from burnish.scene.examples.texture import clouds, texels
from burnish.scene.objects import SceneObject


def casement(left: float, right: float, low: float, high: float) -> Mesh:
    """A frame in x and z at y = 0, with a bar up its middle and one across."""
    middle, half, tall = (left + right) / 2, (right - left) / 2, (high - low) / 2
    upright = [
        rounded_box((x, 0, low + tall), (0.035, 0.03, tall), 0.01)
        for x in (left + 0.035, middle, right - 0.035)
    ]
    across = [
        rounded_box((middle, 0, z), (half, 0.025, 0.03), 0.01)
        for z in (low + 0.035, low + 1.38 * tall, high - 0.035)
    ]
    return joined(*upright, *across)


def unedited(item: SceneObject) -> SceneObject:
    """A panel as a light alone: there is nothing to edit on black."""
    return replace(item, material=None, factory=None, maps={}, reason="it is a light")


def sky_panel(
    path: Path, centre: Point, facing: Point, width: float, height: float, radiance: float
) -> dict[str, Any]:
    """An emitter outside a window. radiance: of its brightest part.

    Path tracers find it at once, where an environment behind a window is found by chance.
    """
    u, v = texels(128, 96)
    haze = np.array([0.9, 0.95, 1.0]) - np.clip(v - 0.4, 0, 1)[..., None] * (0.55, 0.4, 0.12)
    crowns = 0.56 + 0.3 * (clouds(u * 7, 0 * v, 3) - 0.5) + 0.1 * (clouds(u * 24, v * 14, 4) - 0.5)
    trees = np.clip((crowns - v) / 0.05, 0, 1)[..., None]
    leaf = np.array([0.025, 0.045, 0.012]) * (0.5 + 1.1 * clouds(u * 22, v * 18, 5))[..., None]
    picture = radiance * (haze + trees * (leaf - haze))
    mi.Bitmap(picture.astype(np.float32)).write(str(path))
    return {
        "type": "rectangle",
        "to_world": rectangle(centre, facing, (0, 0, 1), width, height),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        "emitter": {
            "type": "area",
            "radiance": {"type": "bitmap", "filename": str(path), "raw": True},
        },
    }
