"""The Cornell box, as measured at Cornell, in metres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi

from burnish.scene.examples.geometry import camera, rectangle, rgb
from burnish.scene.examples.gloss import glossed

WIDTH, HEIGHT, DEPTH = 5.528, 5.488, 5.592
WHITE = (0.7295, 0.7355, 0.729)
RED = (0.611, 0.0555, 0.062)
GREEN = (0.117, 0.4125, 0.115)
LIGHT = (42.0, 34.0, 24.0)

FINISH = dict.fromkeys(
    ("floor", "ceiling", "back", "left", "right", "small-box", "large-box"), glossed
)


def describe(folder: Path) -> dict[str, Any]:
    """The box with its seven editable surfaces, and the lamp under the ceiling."""
    x, y, z = WIDTH / 2, HEIGHT / 2, DEPTH / 2
    upward, inward = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    walls = {
        "floor": ((x, 0, z), upward, inward, WIDTH, DEPTH, WHITE),
        "ceiling": ((x, HEIGHT, z), (0, -1, 0), inward, WIDTH, DEPTH, WHITE),
        "back": ((x, y, DEPTH), (0, 0, -1), upward, WIDTH, HEIGHT, WHITE),
        "left": ((WIDTH, y, z), (-1, 0, 0), upward, DEPTH, HEIGHT, RED),
        "right": ((0, y, z), (1, 0, 0), upward, DEPTH, HEIGHT, GREEN),
    }
    scene: dict[str, Any] = {"type": "scene"}
    for name, (centre, facing, up, width, height, colour) in walls.items():
        scene[name] = {
            "type": "rectangle",
            "to_world": rectangle(centre, facing, up, width, height),
            "bsdf": {"type": "diffuse", "reflectance": rgb(*colour)},
        }
    scene["small-box"] = _box((1.855, 0.825, 1.69), (0.825, 0.825, 0.825), -17.0)
    scene["large-box"] = _box((3.685, 1.65, 3.515), (0.825, 1.65, 0.825), 17.3)
    scene["light"] = {
        "type": "rectangle",
        "to_world": rectangle((2.78, HEIGHT - 0.01, 2.795), (0, -1, 0), inward, 1.3, 1.05),
        "bsdf": {"type": "diffuse", "reflectance": rgb(0.78)},
        "emitter": {"type": "area", "radiance": rgb(*LIGHT)},
    }
    scene["view"] = camera((2.78, 2.73, -8.0), (2.78, 2.73, 0.0), 39.3077, (450, 450), upward)
    return scene


def _box(
    centre: tuple[float, float, float], half: tuple[float, float, float], degrees: float
) -> dict[str, Any]:
    place = mi.ScalarTransform4f().translate(centre).rotate([0, 1, 0], degrees).scale(half)
    return {
        "type": "cube",
        "to_world": place,
        "bsdf": {"type": "diffuse", "reflectance": rgb(*WHITE)},
    }
