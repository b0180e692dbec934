"""One sphere on a checkered floor between softboxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi

from burnish.scene.examples.environment import Panel, Room, envmap, write_environment
from burnish.scene.examples.geometry import camera, rectangle, rgb
from burnish.scene.examples.gloss import glossed

FINISH = {"floor": glossed}

STUDIO = Room(
    low=(-4.0, -4.0, -1.2),
    high=(4.0, 4.0, 3.6),
    panels=(
        Panel("-x", (-0.6, 1.2), (2.6, 2.6), (26.0, 27.0, 28.5), soft=0.08),
        Panel("+x", (-1.2, 0.9), (1.0, 2.8), (22.0, 18.0, 13.0), soft=0.08),
        Panel("+z", (0.0, 0.6), (3.4, 1.4), (11.0, 11.0, 11.0), soft=0.12),
    ),
    walls=(0.28, 0.29, 0.31),
    floor=(0.2, 0.2, 0.2),
    ambient=(0.25, 0.26, 0.28),
)


def describe(folder: Path) -> dict[str, Any]:
    """Objects: sphere, floor."""
    return {
        "type": "scene",
        "sphere": {
            "type": "sphere",
            "center": [0.0, 0.0, 1.0],
            "radius": 1.0,
            "bsdf": {
                "type": "roughplastic",
                "distribution": "ggx",
                "alpha": 0.04,
                "diffuse_reflectance": rgb(0.3, 0.018, 0.016),
            },
        },
        "floor": {
            "type": "rectangle",
            "to_world": rectangle((0, 0, 0), (0, 0, 1), (0, 1, 0), 40.0, 40.0),
            "bsdf": {
                "type": "diffuse",
                "reflectance": {
                    "type": "checkerboard",
                    "color0": rgb(0.45),
                    "color1": rgb(0.09),
                    "to_uv": mi.ScalarTransform4f().scale([20.0, 20.0, 1.0]),
                },
            },
        },
        "studio": envmap(write_environment(STUDIO, folder / "studio.exr")),
        "view": camera((0.0, -6.2, 2.5), (0.0, 0.0, 0.85), 33.0, (400, 300)),
    }
