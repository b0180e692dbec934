"""A teapot on a wooden tray with metal handles, in a room with a window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.types import Float64
from burnish.scene.examples.environment import Panel, Room, envmap, write_environment
from burnish.scene.examples.geometry import (
    Mesh,
    camera,
    grid,
    joined,
    refined,
    rgb,
    rounded_rectangle,
    swept,
)
from burnish.scene.examples.gloss import glossed
from burnish.scene.examples.teapot import teapot
from burnish.scene.examples.texture import write_wood

LENGTH, WIDTH, CORNER = 11.0, 7.4, 1.3

FINISH = {"table": glossed}

ROOM = Room(
    low=(-5.0, -4.0, -1.5),
    high=(5.0, 4.5, 2.6),
    panels=(
        Panel("-x", (0.6, 0.75), (3.4, 2.4), (26.0, 28.5, 32.0), (3, 2), sky=0.45),
        Panel("+y", (1.6, 0.7), (1.5, 2.2), (9.0, 10.0, 11.5), (2, 2), sky=0.5),
        Panel("+z", (1.2, -0.8), (2.0, 1.2), (11.0, 9.4, 7.4), soft=0.25),
    ),
    walls=(0.55, 0.5, 0.44),
    floor=(0.25, 0.17, 0.11),
    ambient=(0.9, 0.88, 0.85),
)


def describe(folder: Path) -> dict[str, Any]:
    """Objects: teapot, tray, handles, table."""
    place = mi.ScalarTransform4f().translate([0.0, 0.0, 0.26]).rotate([0, 0, 1], -28.0)
    return {
        "type": "scene",
        "teapot": {
            "type": "ply",
            "filename": teapot().write(folder / "teapot.ply"),
            "to_world": place,
            "bsdf": {
                "type": "twosided",
                "inner": {
                    "type": "roughplastic",
                    "distribution": "ggx",
                    "alpha": 0.04,
                    "diffuse_reflectance": rgb(0.02, 0.12, 0.19),
                },
            },
        },
        "tray": {
            "type": "ply",
            "filename": tray().write(folder / "tray.ply"),
            "bsdf": {
                "type": "roughplastic",
                "distribution": "ggx",
                "alpha": 0.05,
                "diffuse_reflectance": {
                    "type": "bitmap",
                    "filename": write_wood(folder / "wood.png"),
                },
            },
        },
        "handles": {
            "type": "ply",
            "filename": handles().write(folder / "handles.ply"),
            "bsdf": {
                "type": "roughconductor",
                "distribution": "ggx",
                "material": "Cu",
                "alpha": 0.12,
            },
        },
        "table": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().scale([60.0, 60.0, 1.0]),
            "bsdf": {"type": "diffuse", "reflectance": rgb(0.44, 0.42, 0.4)},
        },
        "room": envmap(write_environment(ROOM, folder / "room.exr")),
        "view": camera((3.4, -15.6, 7.4), (0.1, -0.1, 0.9), 43.0, (512, 384)),
    }


def tray() -> Mesh:
    """A rounded rectangle with a raised rim; u runs along its length, v across."""
    # The rim's section, from the inner floor over the top to the table: (offset, height)
    turn = np.linspace(0.0, np.pi, 13)
    fillet = np.linspace(0.0, np.pi / 2, 7)
    section = np.concatenate(
        [
            np.stack([-0.62 + 0.3 * np.sin(fillet), 0.56 - 0.3 * np.cos(fillet)], -1),
            np.stack([-0.16 - 0.16 * np.cos(turn), 0.85 + 0.16 * np.sin(turn)], -1),
            np.stack([-0.12 + 0.12 * np.cos(fillet), 0.12 - 0.12 * np.sin(fillet)], -1),
        ]
    )
    outline = rounded_rectangle(LENGTH, WIDTH, CORNER, 24)
    tangent = np.gradient(outline, axis=0)
    tangent[0] = tangent[-1] = outline[1] - outline[-2]
    outward = np.stack([tangent[:, 1], -tangent[:, 0]], -1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    path, sides = (np.pad(item, ((0, 0), (0, 1))) for item in (outline, outward))
    ups = np.broadcast_to(np.array([0.0, 0.0, 1.0]), path.shape)
    rim = swept(path, sides, ups, refined(section, 0.15))
    # The floor: the inner outline shrunk to a point
    inner = path + section[0, 0] * sides
    rings = np.linspace(1.0, 0.0, 5)[:, None, None] * inner[None]
    rings[..., 2] = section[0, 1]
    floor = grid(rings, np.broadcast_to([0.0, 0.0, 1.0], rings.shape), rings[..., :2])
    return _planar(joined(rim, floor))


def handles() -> Mesh:
    """Two arched tubes at the short ends of the tray."""
    parts = []
    for side in (1.0, -1.0):
        t = np.linspace(0.0, np.pi, 49)
        lean = np.array([np.sin(0.6), 0.0, np.cos(0.6)]) * np.array([side, 1.0, 1.0])
        rise = 1.15 * np.sin(t) ** 0.8
        path = np.stack([np.full_like(t, side * (LENGTH / 2 - 0.16)), -1.5 * np.cos(t), 0 * t], -1)
        path += rise[:, None] * lean + np.array([0.0, 0.0, 0.9])
        parts.append(_tube(path, 0.15, np.cross(lean, [0.0, 1.0, 0.0])))
    return joined(*parts)


def _tube(path: Float64, radius: float, normal: Float64) -> Mesh:
    """A round tube along a path that lies in a plane with the given normal."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    ups = np.broadcast_to(normal / np.linalg.norm(normal), path.shape)
    angle = np.linspace(0.0, 2 * np.pi, 25)
    circle = radius * np.stack([np.cos(angle), np.sin(angle)], -1)
    return swept(path, np.cross(ups, tangent), ups, circle)


def _planar(mesh: Mesh) -> Mesh:
    """The mesh with texture coordinates that look down on the tray."""
    uv = mesh.positions[:, :2] / np.array([LENGTH, WIDTH]) + 0.5
    return Mesh(mesh.positions, mesh.normals, uv, mesh.faces)
