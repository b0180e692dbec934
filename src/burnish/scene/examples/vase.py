"""Tulips in a glazed vase on a wooden table, after figure 9 of the 2008 paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.models.ashikhmin_shirley import AshikhminShirleyRatio
from burnish.materials.models.fresnel_curve import FresnelCurve
from burnish.materials.models.lambert import Lambert
from burnish.scene.examples.environment import Panel, Room, envmap, write_environment
from burnish.scene.examples.geometry import Mesh, camera, joined, lofted, rectangle
from burnish.scene.examples.gloss import layered
from burnish.scene.examples.plants import blade
from burnish.scene.examples.shapes import revolved, rotation, rounded_box, spline, towards, tube
from burnish.scene.examples.surfaces import both_faces, glossy, matte, picture, solid
from burnish.scene.examples.texture import clouds, texels, write_picture, write_wood
from burnish.scene.objects import SceneObject

GLAZE = (0.006, 0.03, 0.1)

ROOM = Room(
    low=(-5.0, -6.0, -1.2),
    high=(6.0, 5.0, 3.4),
    panels=(
        Panel("-x", (-1.2, 1.2), (2.6, 2.6), (84.0, 84.0, 84.0), (2, 3), sky=0.3),
        Panel("-y", (3.4, 0.9), (1.3, 2.2), (9.0, 7.6, 6.0), (2, 2), sky=0.3),
        Panel("+z", (0.5, -0.5), (1.6, 1.6), (5.0, 4.6, 4.0), soft=0.4),
    ),
    walls=(0.52, 0.49, 0.45),
    floor=(0.2, 0.15, 0.11),
    ambient=(0.42, 0.41, 0.42),
)

# Where each tulip sits, how far it is open, and which of the four colours it has
TULIPS = (
    ((-0.2, -0.15, 5.5), 0.06, 0),
    ((0.8, 0.1, 5.25), 0.1, 1),
    ((-1.15, 0.15, 5.15), 0.12, 2),
    ((0.45, -0.95, 4.85), 0.2, 3),
    ((-0.75, -0.9, 4.55), 0.16, 1),
    ((1.65, -0.4, 4.45), 0.22, 0),
    ((-1.95, -0.3, 4.2), 0.2, 3),
    ((0.15, 0.85, 5.2), 0.1, 3),
    ((1.2, 0.9, 4.7), 0.14, 2),
)
# Where leaves point, in degrees, how far they reach and how high they rise
LEAVES = (
    (200, 1.7, 4.5),
    (330, 1.9, 4.2),
    (95, 1.4, 4.9),
    (255, 1.25, 3.9),
    (25, 1.7, 4.6),
    (150, 1.9, 4.1),
)
COLOURS = (
    ((0.62, 0.42, 0.12), (0.72, 0.1, 0.1)),
    ((0.62, 0.6, 0.3), (0.8, 0.72, 0.6)),
    ((0.5, 0.2, 0.2), (0.4, 0.015, 0.07)),
    ((0.7, 0.55, 0.2), (0.82, 0.33, 0.2)),
)


def describe(folder: Path) -> dict[str, Any]:
    """Objects: vase, flowers, stems, table, wall."""
    heads = [_place(base, opening, colour) for base, opening, colour in TULIPS]
    flowers = joined(*(mesh for mesh, _, _ in heads), _fallen())
    stems = joined(*(_stem(foot, axis) for _, foot, axis in heads), *_leaves())
    return {
        "type": "scene",
        "vase": solid(vase(), folder / "vase.ply", glossy(0.09, GLAZE)),
        "flowers": solid(
            flowers,
            folder / "flowers.ply",
            both_faces(matte(picture(_write_petals(folder / "petals.png")))),
        ),
        "stems": solid(stems, folder / "stems.ply", both_faces(glossy(0.22, (0.1, 0.21, 0.045)))),
        "table": solid(
            _table(),
            folder / "table.ply",
            glossy(0.12, picture(write_wood(folder / "wood.png", 4, 1024, 512))),
        ),
        "wall": {
            "type": "rectangle",
            "to_world": rectangle((0, 4.6, 0), (0, -1, 0), (0, 0, 1), 60.0, 40.0),
            "bsdf": matte((0.13, 0.18, 0.18)),
        },
        "room": envmap(write_environment(ROOM, folder / "room.exr", 512)),
        "view": camera((0.7, -13.4, 4.9), (-0.05, 0.0, 2.98), 33.0, (512, 512)),
    }


def vase() -> Mesh:
    """A foot, a belly, a neck with a lip; closed, with a wall inside."""
    belly = ((0.62, 0.04), (0.6, 0.2), (0.78, 0.6), (1.02, 1.2), (0.98, 1.75), (0.66, 2.3))
    outside = spline([*belly, (0.47, 2.65), (0.5, 2.95), (0.68, 3.16)], 10)
    lip = spline([(0.68, 3.16), (0.705, 3.195), (0.68, 3.215), (0.645, 3.19)], 4)
    inside = spline([(0.645, 3.19), (0.45, 2.95), (0.41, 2.65), (0.6, 2.25), (0.7, 1.6)], 8)
    foot = spline([(0.0, 0.0), (0.3, 0.0), (0.56, 0.0), (0.62, 0.04)], 4)
    rest = [(0.5, 1.2), (0.0, 1.1)]
    return revolved(np.concatenate([foot, outside[1:], lip[1:], inside[1:], rest]), 128)


def _glazed(item: SceneObject) -> SceneObject:
    """Diffuse, anisotropic and Fresnel layers, which no BSDF of Mitsuba's has together."""
    return layered(
        item,
        {
            "diffuse": (Lambert(), {"color": GLAZE}),
            "anisotropic": (AshikhminShirleyRatio(), {"color": (0.04, 0.04, 0.04)}),
            "fresnel": (FresnelCurve(), {"eta": (1.5, 1.5, 1.5), "roughness": 0.05}),
        },
        {"anisotropic": 256},
    )


FINISH = {"vase": _glazed}


def _petal(start: float, radius: float, opening: float, edge: float) -> Float64:
    """A grid [rows, columns, 3] over one petal of a cup of height 1 around z."""
    s = np.linspace(0.0, 1.0, 25)[:, None]
    t = np.linspace(-1.0, 1.0, 17)[None, :]
    width = (
        0.86 * np.sqrt(1 - 0.985 * s**5) * (0.4 + 0.6 * np.sin(np.pi / 2 * np.minimum(s / 0.55, 1)))
    )
    bulge = np.sin(np.pi * (0.08 + 0.66 * s)) ** 0.8
    r = radius * bulge + opening * s**3 + edge * t * t * (0.3 + s) - 0.02 * (1 - t * t) * s
    angle = start + t * width
    z = 1.12 * s - 0.1 * t * t * s
    return np.stack(np.broadcast_arrays(r * np.cos(angle), r * np.sin(angle), z), -1)


def _place(
    base: tuple[float, float, float], opening: float, colour: int
) -> tuple[Mesh, Float64, Float64]:
    """A tulip's head, its foot and its axis."""
    foot = np.asarray(base)
    axis = foot - np.array([0.0, 0.0, 1.6])
    axis = axis / np.linalg.norm(axis) + np.array([0.0, 0.0, 0.35])
    axis /= np.linalg.norm(axis)
    spin = 7.0 * base[0] + 3.0 * base[1]
    petals = []
    for k in range(6):
        outer = k % 2
        grid = _petal(
            spin + k * np.pi / 3,
            0.36 + 0.045 * outer,
            opening * (1 + 0.3 * outer),
            0.03 * outer - 0.03 * (1 - outer),
        )
        petals.append(_coloured(lofted(grid), colour))
    head = joined(*petals).moved(base, towards(axis))
    return head, foot, axis


def _coloured(petal: Mesh, colour: int) -> Mesh:
    u, v = petal.uv.T
    return petal.mapped(np.stack([(colour + 0.03 + 0.94 * u) / len(COLOURS), v], -1))


def _fallen() -> Mesh:
    """A petal that lies on the table."""
    petal = lofted(_petal(0.0, 0.4, 0.25, 0.02))
    turn = rotation((0, 0, 1), -35.0) @ rotation((0, 1, 0), 76.0)
    petal = petal.moved(turn=turn)
    low = petal.positions[:, 2].min()
    return _coloured(petal.moved((-2.0, -1.6, 0.012 - low)), 0)


def _stem(foot: Float64, axis: Float64) -> Mesh:
    inward = np.array([0.16, 0.16, 1.0])
    points = [
        foot * inward * (1, 1, 0) + (0, 0, 1.7),
        foot * inward * (1, 1, 0) * 1.15 + (0, 0, 3.1),
        foot - 0.75 * axis,
        foot + 0.06 * axis,
    ]
    return tube(spline(points, 10), np.concatenate([np.full(28, 0.062), [0.075, 0.1, 0.1]]), 14)


def _leaves() -> list[Mesh]:
    """Long blades that rise out of the neck and bend over."""
    leaves = []
    up = np.array([0.0, 0.0, 1.0])
    for degrees, reach, height in LEAVES:
        out = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
        knots = [
            0.2 * out + 2.0 * up,
            0.3 * out + 3.2 * up,
            0.62 * reach * out + (height - 0.15) * up,
        ]
        middle = spline([*knots, reach * out + (height - 0.3) * up], 12)
        s = np.linspace(0.0, 1.0, len(middle))
        width = 0.3 * np.sin(np.pi * (0.12 + 0.88 * s)) ** 0.7 * np.minimum(1.0, 0.35 + 1.6 * s)
        leaves.append(blade(middle, out, width, 0.9))
    return leaves


def _table() -> Mesh:
    slab = rounded_box((0.0, 0.6, -0.25), (9.0, 3.9, 0.25), 0.08)
    return slab.mapped(slab.positions[:, :2] / np.array([9.0, 7.8]) + 0.5)


def _write_petals(path: Path) -> str:
    """One column for each colour: from its foot upwards, with veins along it."""
    u, v = texels(1024, 256)
    kind = np.minimum((u * len(COLOURS)).astype(int), len(COLOURS) - 1)
    low, high = (np.array([pair[end] for pair in COLOURS])[kind] for end in (0, 1))
    rise = np.clip((v - 0.05) / 0.5, 0, 1)[..., None]
    colour = low + (rise * rise * (3 - 2 * rise)) * (high - low)
    veins = clouds(u * 120, v * 2.5, 3, 3)[..., None]
    within = np.abs((u * len(COLOURS)) % 1 - 0.5)[..., None]
    return write_picture(path, colour * (0.72 + 0.5 * veins) * (1.05 - 0.35 * within))
