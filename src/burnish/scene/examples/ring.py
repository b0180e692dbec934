"""A gold ring on a plane, and the caustic that its inside throws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from burnish.scene.examples.environment import Panel, Room, envmap, write_environment
from burnish.scene.examples.geometry import (
    Mesh,
    camera,
    rectangle,
    refined,
    rgb,
    rounded_rectangle,
    swept,
)
from burnish.scene.examples.gloss import glossed

RADIUS, THICKNESS, HEIGHT = 1.0, 0.12, 0.5

FINISH = {"plane": glossed}

STUDIO = Room(
    low=(-4.0, -4.0, -1.0),
    high=(4.0, 4.0, 4.0),
    panels=(
        Panel("+y", (-0.5, 1.6), (4.5, 1.6), (2.6, 2.8, 3.0), soft=0.2),
        Panel("-x", (0.0, 1.5), (3.0, 2.0), (2.2, 2.0, 1.8), soft=0.2),
    ),
    walls=(0.3, 0.3, 0.3),
    floor=(0.2, 0.2, 0.2),
    ambient=(0.35, 0.36, 0.38),
)


def describe(folder: Path) -> dict[str, Any]:
    """Objects: ring, plane; a fixed lamp and a dim studio around them."""
    return {
        "type": "scene",
        "ring": {
            "type": "ply",
            "filename": band().write(folder / "ring.ply"),
            "bsdf": {
                "type": "roughconductor",
                "distribution": "ggx",
                "material": "Au",
                "alpha": 0.1,
            },
        },
        "plane": {
            "type": "rectangle",
            "to_world": rectangle((0, 0, 0), (0, 0, 1), (0, 1, 0), 60.0, 60.0),
            "bsdf": {"type": "diffuse", "reflectance": rgb(0.5, 0.49, 0.47)},
        },
        "lamp": {
            "type": "rectangle",
            "to_world": rectangle((4.4, -3.0, 4.0), (-4.4, 3.0, -4.0), (0, 0, 1), 1.3, 1.3),
            "bsdf": {"type": "diffuse", "reflectance": rgb(0.0)},
            "emitter": {"type": "area", "radiance": rgb(90.0, 84.0, 74.0)},
        },
        "studio": envmap(write_environment(STUDIO, folder / "studio.exr", 512)),
        "view": camera((-0.5, -3.7, 4.5), (-0.12, 0.05, 0.1), 32.0, (400, 400)),
    }


def band() -> Mesh:
    """A ring lying on z = 0, its section a rectangle with round edges."""
    angle = np.linspace(0.0, 2 * np.pi, 193)
    sides = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    ups = np.broadcast_to(np.array([0.0, 0.0, 1.0]), sides.shape)
    section = rounded_rectangle(THICKNESS, HEIGHT, 0.06, 10)[::-1]
    return swept(RADIUS * sides + HEIGHT / 2 * ups, sides, ups, refined(section, 0.05))
