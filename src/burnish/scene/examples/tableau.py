"""A rabbit of porcelain and a dragon of jade on a polished floor, after figure 7 of 2010."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from burnish.core.types import Value
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.ward import WardWidth
from burnish.scene.examples.environment import Panel, Room, envmap, write_environment
from burnish.scene.examples.geometry import Mesh, camera, rectangle
from burnish.scene.examples.gloss import layered
from burnish.scene.examples.implicit import (
    ball,
    blended,
    carved,
    limb,
    meshed,
    mirrored,
    placed,
    sheet,
)
from burnish.scene.examples.shapes import rotation, spline
from burnish.scene.examples.surfaces import glossy, picture, solid
from burnish.scene.examples.texture import write_marble
from burnish.scene.objects import SceneObject

WHITE = (0.66, 0.63, 0.57)
JADE = (0.025, 0.15, 0.075)

STUDIO = Room(
    low=(-5.0, -6.0, -1.4),
    high=(5.0, 6.0, 4.5),
    panels=(
        Panel("-x", (-1.5, 1.8), (3.0, 2.6), (36.0, 33.0, 28.0), soft=0.1),
        Panel("+x", (1.5, 1.2), (1.2, 3.2), (13.0, 16.0, 20.0), soft=0.1),
        Panel("+z", (0.0, 0.5), (4.0, 2.4), (5.0, 5.2, 5.6), soft=0.2),
        Panel("+y", (0.0, 1.6), (7.0, 2.2), (0.9, 1.0, 1.2), soft=0.45),
    ),
    walls=(0.12, 0.125, 0.135),
    floor=(0.1, 0.1, 0.1),
    ambient=(0.14, 0.15, 0.17),
)


def describe(folder: Path) -> dict[str, Any]:
    """Objects: bunny, dragon, floor."""
    return {
        "type": "scene",
        "bunny": solid(bunny(), folder / "bunny.ply", glossy(0.15, WHITE)),
        "dragon": solid(dragon(), folder / "dragon.ply", glossy(0.15, JADE)),
        "floor": {
            "type": "rectangle",
            "to_world": rectangle((0, 0, 0), (0, 0, 1), (0, 1, 0), 240.0, 240.0),
            "bsdf": glossy(
                0.03, picture(write_marble(folder / "marble.png"), 54.0, 54.0, turn=32.0)
            ),
        },
        "studio": envmap(write_environment(STUDIO, folder / "studio.exr", 512)),
        "view": camera((0.3, -12.0, 5.3), (0.12, 0.0, 1.2), 26.5, (400, 400)),
    }


def bunny() -> Mesh:
    """A rabbit that sits up and looks aside."""
    half = [
        ball((-0.22, 0.44, 0.56), (0.56, 0.34, 0.52)),
        limb([(-0.15, 0.5, 0.15), (0.5, 0.5, 0.11), (0.62, 0.5, 0.1)], (0.17, 0.12, 0.1)),
        limb(
            [(0.42, 0.2, 0.9), (0.6, 0.2, 0.3), (0.66, 0.2, 0.1), (0.8, 0.2, 0.09)],
            (0.22, 0.13, 0.1, 0.09),
        ),
        ball((-0.25, 0.2, 0.75), (0.75, 0.55, 0.68), rotation((0, 1, 0), -18)),
        limb([(0.2, 0.05, 0.85), (0.36, 0.0, 1.4)], (0.5, 0.34)),
        ball((-0.98, 0.0, 0.5), 0.23),
    ]
    body = blended([mirrored(field) for field in half], 0.16)
    ear = ball(
        (-0.22, 0.19, 0.78), (0.12, 0.19, 0.58), rotation((0, 1, 0), -20) @ rotation((1, 0, 0), -10)
    )
    hollow = ball(
        (-0.08, 0.2, 0.8), (0.1, 0.12, 0.46), rotation((0, 1, 0), -20) @ rotation((1, 0, 0), -10)
    )
    head = blended(
        [
            mirrored(carved(ear, hollow, 0.06)),
            ball((0.0, 0.0, 0.0), (0.46, 0.38, 0.4)),
            mirrored(ball((0.16, 0.14, -0.14), (0.26, 0.22, 0.2))),
            ball((0.36, 0.0, -0.09), (0.17, 0.17, 0.15)),
        ],
        0.1,
    )
    # Sockets with eyes in them, and a line between nose and mouth
    sockets = mirrored(ball((0.29, 0.29, 0.1), (0.11, 0.07, 0.1)))
    head = carved(head, sockets, 0.04)
    eyes = mirrored(ball((0.27, 0.245, 0.1), (0.08, 0.06, 0.08)))
    head = blended([head, eyes], 0.015)
    cleft = limb([(0.56, 0, -0.06), (0.54, 0, -0.2), (0.4, 0, -0.3)], (0.02, 0.018, 0.012))
    head = carved(head, cleft, 0.03)
    looking = placed(head, (0.46, 0.0, 1.66), rotation((0, 0, 1), -38))
    solid = blended([body, looking], 0.14)
    mesh = meshed(solid, (-1.4, -1.1, -0.1), (1.3, 1.1, 3.3), 0.036)
    return mesh.moved((-1.25, 0.1, 0.0), rotation((0, 0, 1), -28))


def dragon() -> Mesh:
    """A young dragon that sits with its tail around it."""
    half = [
        ball((-0.28, 0.4, 0.52), (0.52, 0.27, 0.5)),
        limb([(-0.1, 0.48, 0.14), (0.42, 0.5, 0.1), (0.56, 0.5, 0.08)], (0.17, 0.12, 0.08)),
        limb(
            [(0.32, 0.24, 1.15), (0.42, 0.36, 0.7), (0.5, 0.34, 0.14), (0.7, 0.36, 0.09)],
            (0.18, 0.13, 0.1, 0.08),
        ),
        limb([(-0.05, 0.2, 1.35), (-0.5, 0.6, 2.0), (-0.42, 0.72, 2.55)], (0.13, 0.08, 0.05)),
        limb([(-0.5, 0.6, 2.0), (-1.15, 1.0, 2.35)], (0.07, 0.035)),
        limb([(-0.5, 0.6, 2.0), (-1.3, 0.95, 1.75)], (0.07, 0.035)),
        sheet(((-0.5, 0.6, 2.0), (-0.42, 0.72, 2.55), (-1.15, 1.0, 2.35)), 0.032),
        sheet(((-0.5, 0.6, 2.0), (-1.15, 1.0, 2.35), (-1.3, 0.95, 1.75)), 0.032),
        sheet(((-0.5, 0.6, 2.0), (-1.3, 0.95, 1.75), (-0.1, 0.2, 1.3)), 0.032),
    ]
    spine = spline(
        [
            (-0.35, 0, 0.55),
            (0.02, 0, 1.0),
            (0.22, 0, 1.45),
            (0.12, 0, 1.9),
            (0.22, 0, 2.3),
            (0.5, 0, 2.5),
        ],
        4,
    )
    girth = np.interp(np.arange(len(spine)), np.arange(0, 21, 4), [0.5, 0.46, 0.3, 0.2, 0.17, 0.17])
    tail = spline(
        [
            (-0.5, 0, 0.42),
            (-1.0, -0.2, 0.24),
            (-1.1, -0.8, 0.16),
            (-0.5, -1.1, 0.13),
            (0.35, -1.05, 0.11),
            (0.85, -0.75, 0.16),
            (1.0, -0.45, 0.36),
        ],
        4,
    )
    thin = np.linspace(0.36, 0.035, len(tail))
    head = [
        ball((0.62, 0, 2.56), (0.27, 0.21, 0.19)),
        limb([(0.68, 0, 2.52), (1.06, 0, 2.42)], (0.17, 0.095)),
        mirrored(ball((1.08, 0.06, 2.47), (0.07, 0.05, 0.06))),
        mirrored(ball((0.72, 0.15, 2.68), (0.09, 0.06, 0.08))),
        mirrored(
            limb([(0.5, 0.12, 2.7), (0.3, 0.2, 2.95), (0.2, 0.22, 3.16)], (0.08, 0.05, 0.015))
        ),
        mirrored(limb([(0.48, 0.17, 2.5), (0.25, 0.36, 2.52)], (0.08, 0.015))),
    ]
    ridge = []
    for chain, radius in ((spine, girth), (tail[::-1], thin[::-1])):
        along = np.gradient(chain, axis=0)
        for k in range(2, len(chain) - 1, 2):
            out = (
                np.array([-along[k, 2], 0.0, along[k, 0]])
                if chain is spine
                else np.array([0, 0, 1.0])
            )
            out /= np.linalg.norm(out)
            foot = chain[k] + 0.85 * radius[k] * out
            ridge.append(
                limb([foot, foot + (0.1 + 0.35 * radius[k]) * out], (0.35 * radius[k], 0.012))
            )
    body = blended([*map(mirrored, half), limb(spine, girth), limb(tail, thin), *head], 0.12)
    mesh = meshed(blended([body, *ridge], 0.05), (-1.75, -1.35, -0.1), (1.4, 1.3, 3.35), 0.038)
    return mesh.moved((1.3, 0.25, 0.0), rotation((0, 0, 1), 205))


def _ward(item: SceneObject) -> SceneObject:
    """Diffuse and Ward layers, as in the paper; Mitsuba has no BSDF of Ward's."""
    colour = WHITE if item.id == "bunny" else JADE
    gloss: dict[str, Value] = {"color": (0.05, 0.05, 0.05), "roughness": 0.09}
    return layered(
        item, {"diffuse": (Lambert(), {"color": colour}), "specular": (WardWidth(), gloss)}
    )


FINISH = {"bunny": _ward, "dragon": _ward}
