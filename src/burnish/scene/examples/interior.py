"""A window with curtains over a tiled floor, after figure 9 of the 2010 paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from burnish.scene.examples.geometry import Mesh, camera, joined, lofted, rectangle, rgb
from burnish.scene.examples.gloss import glossed
from burnish.scene.examples.plants import tuft
from burnish.scene.examples.shapes import (
    cushion,
    pierced,
    revolved,
    rotation,
    rounded_box,
    spline,
    tube,
)
from burnish.scene.examples.surfaces import (
    both_faces,
    glossy,
    matte,
    metal,
    picture,
    solid,
    upholstery,
)
from burnish.scene.examples.texture import clouds, texels, write_picture, write_tiles
from burnish.scene.examples.windows import casement, sky_panel, unedited

WIDTH, FRONT, BACK, HEIGHT = 2.3, -4.2, 1.9, 2.75
LEFT, RIGHT, SILL, LINTEL = -0.75, 0.95, 0.75, 2.35
LIT = (0.9, 2.9)
"""Where a second window, out of sight, begins and ends along the left wall."""

FINISH = dict.fromkeys(("walls", "ceiling"), glossed) | dict.fromkeys(("sky", "side-sky"), unedited)


def describe(folder: Path) -> dict[str, Any]:
    """Objects: floor, walls, ceiling, frame, curtain, rod, armchair, pot, plant."""
    return {
        "type": "scene",
        "floor": {
            "type": "rectangle",
            "to_world": rectangle((0, -1.15, 0), (0, 0, 1), (0, 1, 0), 4.6, 6.1),
            "bsdf": glossy(
                0.08,
                picture(write_tiles(folder / "tiles.png"), 4.6 / 1.6, 6.1 / 1.6),
            ),
        },
        "walls": solid(_walls(), folder / "walls.ply", both_faces(matte((0.62, 0.57, 0.48)))),
        "ceiling": {
            "type": "rectangle",
            "to_world": rectangle((0, -1.15, HEIGHT), (0, 0, -1), (0, 1, 0), 4.6, 6.1),
            "bsdf": both_faces(matte((0.75, 0.74, 0.71))),
        },
        "frame": solid(_frame(), folder / "frame.ply", glossy(0.15, (0.7, 0.69, 0.66))),
        "curtain": solid(
            _curtains(),
            folder / "curtain.ply",
            both_faces(matte(picture(_write_fabric(folder / "fabric.png")))),
        ),
        "rod": solid(
            _rod(),
            folder / "rod.ply",
            metal("Cu", 0.15),
        ),
        "armchair": solid(
            armchair().moved((-1.3, 0.55, 0.0), rotation((0, 0, 1), -32)),
            folder / "armchair.ply",
            upholstery((0.045, 0.16, 0.17), 0.6, 0.8),
        ),
        "pot": solid(
            _pot().moved((1.5, 1.05, 0.0)), folder / "pot.ply", glossy(0.05, (0.42, 0.1, 0.035))
        ),
        "plant": solid(
            tuft(19, 1.1, 11).moved((1.5, 1.05, 0.42)),
            folder / "plant.ply",
            both_faces(glossy(0.2, (0.06, 0.16, 0.04))),
        ),
        "sky": sky_panel(folder / "sky.exr", (0.1, BACK + 1.3, 0.8), (0, -1, 0), 7.0, 3.9, 14.0),
        "side-sky": sky_panel(
            folder / "side-sky.exr",
            (-WIDTH - 1.3, FRONT + sum(LIT) / 2, 1.4),
            (1, 0, 0),
            5.0,
            4.0,
            14.0,
        ),
        "sun": {
            "type": "rectangle",
            "to_world": rectangle((4.2, 12.0, 14.0), (-3.7, -9.8, -12.8), (0, 0, 1), 0.8, 0.8),
            "emitter": {"type": "area", "radiance": rgb(14000.0, 11500.0, 8200.0)},
        },
        "view": camera((0.75, -3.85, 1.5), (-0.18, 1.0, 1.08), 52.0, (400, 400)),
    }


def armchair() -> Mesh:
    """A deep chair with stuffed cushions, facing −y."""
    parts = [
        rounded_box((0, 0, 0.23), (0.42, 0.42, 0.1), 0.05),
        cushion((0, -0.05, 0.4), (0.34, 0.38, 0.11), 0.5, 0.3),
        cushion((0, 0.31, 0.62), (0.36, 0.13, 0.34), 0.45, 0.4),
        rounded_box((0, 0.43, 0.5), (0.42, 0.07, 0.4), 0.065),
    ]
    for side in (-1.0, 1.0):
        parts.append(cushion((0.44 * side, 0.02, 0.42), (0.11, 0.44, 0.27), 0.45, 0.3))
        for y in (-0.32, 0.38):
            leg = np.array([[0.34 * side, y, 0.16], [0.37 * side, y, 0.03]])
            parts.append(tube(spline(leg, 4), 0.03, 12))
    return joined(*parts)


def _walls() -> Mesh:
    """The wall with the window, one on each side, and one behind the viewer."""
    window = pierced((-WIDTH, LEFT, RIGHT, WIDTH), (0, SILL, LINTEL, HEIGHT), 0.28, [(1, 1)])
    depth = BACK - FRONT
    left = pierced((0, *LIT, depth), (0, SILL, LINTEL, HEIGHT), 0.28, [(1, 1)])
    right = pierced((0, depth), (0, HEIGHT), 0.1, [])
    front = pierced((-WIDTH, WIDTH), (0, HEIGHT), 0.1, [])
    return joined(
        window.moved((0, BACK, 0)),
        left.moved((-WIDTH, FRONT, 0), rotation((0, 0, 1), 90)),
        right.moved((WIDTH, BACK, 0), rotation((0, 0, 1), -90)),
        front.moved((0, FRONT, 0), rotation((0, 0, 1), 180)),
        rounded_box((0, BACK - 0.012, 0.05), (WIDTH, 0.012, 0.05), 0.006),
    )


def _frame() -> Mesh:
    """The casement and its sill."""
    board = (
        ((LEFT + RIGHT) / 2, BACK + 0.03, SILL - 0.02),
        ((RIGHT - LEFT) / 2 + 0.1, 0.17, 0.025),
    )
    return joined(
        casement(LEFT, RIGHT, SILL, LINTEL).moved((0, BACK + 0.17, 0)), rounded_box(*board, 0.015)
    )


def _curtains() -> Mesh:
    """Two lengths of cloth, gathered by a band."""
    parts = []
    for side in (-1.0, 1.0):
        u = np.linspace(0.0, 1.0, 241)[None, :]
        v = np.linspace(0.0, 1.0, 61)[:, None]
        z = 0.03 + 2.47 * v
        waist = np.exp(-(((v - 0.42) / 0.17) ** 2))
        inner, outer = 0.55 + 0.13 * waist, 1.22 - 0.14 * waist
        x = inner + (outer - inner) * (u + 0.012 * np.sin(6 * np.pi * u) * (1 - v))
        phase = 2 * np.pi * (6.5 * u + 0.25 * np.sin(3.0 * u + 2 * side)) + 0.35 * (1 - v) * np.sin(
            7 * u
        )
        depth = (0.035 + 0.035 * (1 - v)) * (1 - 0.45 * waist) * (1 + 0.25 * np.sin(9 * u + side))
        y = BACK - 0.14 + depth * np.sin(phase)
        grid = np.stack(np.broadcast_arrays(0.1 + side * x, y, z), -1)
        cloth = lofted(grid if side > 0 else grid[:, ::-1])
        parts.append(cloth.mapped(cloth.uv * (1.6, 2.47)))
    return joined(*parts)


def _rod() -> Mesh:
    """A rod on which rings hang."""
    y, z = BACK - 0.14, 2.54
    bar = tube(np.stack([np.linspace(-1.35, 1.55, 9), np.full(9, y), np.full(9, z)], -1), 0.016, 16)
    knobs = [cushion((x, y, z), (0.035, 0.035, 0.035), 1.0, 1.0, 32) for x in (-1.38, 1.58)]
    return joined(bar, *knobs)


def _pot() -> Mesh:
    profile = [(0.0, 0.0), (0.15, 0.0), (0.17, 0.02), (0.23, 0.28), (0.25, 0.44), (0.265, 0.47)]
    inside = [(0.265, 0.5), (0.24, 0.5), (0.225, 0.46), (0.2, 0.42), (0.0, 0.42)]
    return revolved(spline(profile + inside, 6), 72)


def _write_fabric(path: Path) -> str:
    """Woven stripes."""
    u, v = texels(512, 512)
    stripe = np.clip(6 * np.abs(((5 * u) % 1) - 0.5) - 1.0, 0, 1)[..., None]
    colour = np.array([0.56, 0.3, 0.1]) + stripe * (
        np.array([0.68, 0.56, 0.38]) - np.array([0.56, 0.3, 0.1])
    )
    weave = 0.86 + 0.1 * clouds(u * 256, v * 24, 1, 2) + 0.1 * clouds(u * 24, v * 256, 2, 2)
    return write_picture(path, colour * weave[..., None])
