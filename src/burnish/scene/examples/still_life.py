"""A ball, a bottle, a box and a bowl of fruits, after figure 8 of the 2010 paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.types import Float64
from burnish.scene.examples.environment import Panel, Room, envmap, write_environment
from burnish.scene.examples.geometry import Mesh, Point, camera, joined, rectangle
from burnish.scene.examples.gloss import glossed
from burnish.scene.examples.shapes import revolved, rotation, rounded_box, spline, tube
from burnish.scene.examples.surfaces import glossy, matte, metal, picture, solid
from burnish.scene.examples.texture import clouds, texels, write_picture, write_wood

FINISH = {"wall": glossed}

ROOM = Room(
    low=(-6.0, -7.0, -1.4),
    high=(6.0, 6.0, 4.2),
    panels=(
        Panel("-x", (-1.4, 1.6), (3.0, 2.8), (58.0, 57.0, 54.0), (2, 2), sky=0.35),
        Panel("+x", (-2.0, 1.0), (1.0, 2.4), (8.0, 8.8, 10.0), soft=0.2),
        Panel("+z", (0.0, -1.0), (2.0, 1.6), (6.0, 5.4, 4.6), soft=0.4),
    ),
    walls=(0.32, 0.28, 0.24),
    floor=(0.16, 0.12, 0.09),
    ambient=(0.32, 0.3, 0.28),
)

SKINS = ("apple", "orange", "pear", "banana", "plum", "stem")


def describe(folder: Path) -> dict[str, Any]:
    """Objects: ball, bottle, box, bowl, fruits, floor, wall."""
    return {
        "type": "scene",
        "ball": {
            "type": "sphere",
            "to_world": mi.ScalarTransform4f().translate([-1.75, -1.25, 0.62]).scale(0.62),
            "bsdf": glossy(0.03, (0.36, 0.012, 0.01)),
        },
        "bottle": solid(bottle(), folder / "bottle.ply", glossy(0.06, (0.006, 0.045, 0.022))),
        "box": solid(_box(), folder / "box.ply", glossy(0.16, (0.025, 0.07, 0.22))),
        "bowl": solid(bowl().moved(BOWL), folder / "bowl.ply", metal("Cu", 0.13)),
        "fruits": solid(
            fruits(),
            folder / "fruits.ply",
            glossy(0.2, picture(_write_skins(folder / "skins.png"))),
        ),
        "floor": {
            "type": "rectangle",
            "to_world": rectangle((0, 0, 0), (0, 0, 1), (0, 1, 0), 24.0, 24.0),
            "bsdf": glossy(0.07, picture(write_wood(folder / "wood.png"), 2.0, 3.0)),
        },
        "wall": {
            "type": "rectangle",
            "to_world": rectangle((0, 5.0, 0), (0, -1, 0), (0, 0, 1), 60.0, 40.0),
            "bsdf": matte((0.16, 0.15, 0.13)),
        },
        "room": envmap(write_environment(ROOM, folder / "room.exr", 512)),
        "view": camera((0.5, -11.5, 4.4), (0.0, 0.0, 1.22), 32.0, (640, 480)),
    }


BOWL: Point = (1.35, -0.1, 0.0)


def bottle() -> Mesh:
    """A flask with shoulders and a ring below its mouth."""
    body = ((0.0, 0.0), (0.4, 0.0), (0.58, 0.03), (0.66, 0.14), (0.67, 0.6), (0.67, 1.3))
    neck = ((0.66, 1.75), (0.55, 2.15), (0.32, 2.5), (0.225, 2.85), (0.21, 3.2), (0.215, 3.3))
    ring = ((0.27, 3.34), (0.27, 3.44), (0.215, 3.48), (0.21, 3.58), (0.2, 3.63))
    profile = spline([*body, *neck, *ring, (0.15, 3.62), (0.14, 3.5), (0.0, 3.4)], 8)
    return revolved(profile, 96).moved((-0.75, 0.85, 0.0))


def bowl() -> Mesh:
    """A footed bowl with a turned-out rim, standing on z = 0."""
    outside = [(0.0, 0.02), (0.5, 0.02), (0.62, 0.0), (0.66, 0.06), (0.55, 0.18), (0.62, 0.28)]
    outside += [(1.05, 0.52), (1.32, 0.88), (1.42, 1.2), (1.5, 1.3)]
    inside = [
        (1.52, 1.335),
        (1.48, 1.345),
        (1.37, 1.22),
        (1.25, 0.9),
        (0.98, 0.6),
        (0.5, 0.42),
        (0.0, 0.38),
    ]
    return revolved(spline(outside + inside, 8), 144)


def _box() -> Mesh:
    """A lacquered box with a lid, turned."""
    parts = (
        rounded_box((0, 0, 0.42), (0.72, 0.52, 0.42), 0.05),
        rounded_box((0, 0, 0.98), (0.75, 0.55, 0.12), 0.05),
    )
    return joined(*parts).moved((-2.35, 0.95, 0.0), rotation((0, 0, 1), 24.0))


def fruits() -> Mesh:
    """What lies in the bowl, and two that do not."""
    x, y, _ = BOWL
    parts = [
        _apple(0.52).moved((x - 0.55, y - 0.3, 1.12), rotation((1, 0.4, 0), 24)),
        _orange(0.5).moved((x + 0.42, y - 0.48, 1.08)),
        _apple(0.5).moved((x + 0.55, y + 0.5, 1.15), rotation((0.3, 1, 0), -30)),
        _orange(0.5).moved((x - 0.4, y + 0.6, 1.12)),
        _pear(0.46).moved((x + 0.02, y + 0.02, 1.62), rotation((0.3, 1, 0), -16)),
        _banana().moved((x + 0.05, y + 0.15, 1.5)),
        _plum(0.33).moved((-0.25, -1.55, 0.32), rotation((1, 0, 0), 40)),
        _plum(0.31).moved((0.35, -1.95, 0.3), rotation((0.2, 1, 0), 70)),
    ]
    return joined(*parts)


def _apple(size: float) -> Mesh:
    t = np.linspace(0.0, np.pi, 61)
    r = np.sin(t) * (1.03 + 0.1 * np.cos(t) * -1)
    z = -np.cos(t) * (0.92 - 0.05 * np.sin(t)) - 0.28 * np.exp(-((r / 0.3) ** 2)) * np.sign(
        -np.cos(t)
    ) * np.where(t > np.pi / 2, 1.0, 0.5)
    body = revolved(size * np.stack([r, z], -1), 72)
    stem = spline([(0, 0, 0.5), (0.02, 0.0, 0.8), (0.1, 0.03, 1.06)], 6) * size
    return joined(_skin(body, "apple"), _skin(tube(stem, 0.035 * size, 10), "stem"))


def _orange(size: float) -> Mesh:
    t = np.linspace(0.0, np.pi, 49)
    r, z = np.sin(t), -0.95 * np.cos(t)
    z = z - 0.05 * np.exp(-((r / 0.12) ** 2)) * np.sign(z)
    return _skin(revolved(size * np.stack([r, z], -1), 72), "orange")


def _pear(size: float) -> Mesh:
    profile = [
        (0.0, -0.86),
        (0.35, -0.92),
        (0.8, -0.68),
        (1.02, -0.15),
        (0.9, 0.4),
        (0.62, 0.85),
        (0.47, 1.25),
        (0.36, 1.6),
        (0.15, 1.76),
        (0.0, 1.74),
    ]
    body = revolved(size * spline(profile, 7), 72)
    stem = spline([(0, 0, 1.7), (0.03, 0.0, 1.9), (0.13, 0.04, 2.15)], 6) * size
    return joined(_skin(body, "pear"), _skin(tube(stem, 0.045 * size, 10), "stem"))


def _plum(size: float) -> Mesh:
    t = np.linspace(0.0, np.pi, 49)
    return _skin(revolved(size * np.stack([0.93 * np.sin(t), -np.cos(t)], -1), 64), "plum")


def _banana() -> Mesh:
    """Two bananas side by side, hanging over the rim."""
    parts = []
    for shift in (0.0, 0.27):
        t = np.linspace(-0.95, 1.1, 40)
        path = np.stack(
            [1.15 * np.sin(t), -0.75 + shift - 0.12 * t, 0.1 + 0.95 * (np.cos(t) - 1) + 0.42], -1
        )
        girth = 0.2 * np.interp(
            t, [-0.95, -0.88, -0.7, 0.0, 0.8, 1.0, 1.1], [0.3, 0.4, 0.8, 1.0, 0.8, 0.38, 0.34]
        )
        parts.append(_skin(tube(path, girth, 24), "banana"))
    return joined(*parts)


def _skin(mesh: Mesh, name: str) -> Mesh:
    """The mesh with its column of the skins' picture."""
    u, v = mesh.uv.T
    return mesh.mapped(np.stack([(SKINS.index(name) + 0.02 + 0.96 * u) / len(SKINS), v], -1))


def _write_skins(path: Path) -> str:
    """One column for each kind: around it across, from its foot to its stem upwards."""
    side = 256
    u, v = texels(side, side)
    around = np.abs(2 * u - 1)
    speckle = clouds(around * 26, v * 26, 4, 2)
    broad = clouds(around * 3, v * 3, 5, 3)
    streaks = clouds(around * 30, v * 2.2, 6, 3)
    ends = np.clip(np.abs(2 * v - 1) * 6 - 5, 0, 1)

    def mixed(low: tuple[float, ...], high: tuple[float, ...], share: Float64) -> Float64:
        return np.asarray(low) + np.clip(share, 0, 1)[..., None] * (
            np.asarray(high) - np.asarray(low)
        )

    columns = [
        mixed(
            (0.33, 0.012, 0.014),
            (0.55, 0.36, 0.05),
            1.9 * streaks - 0.75 + 0.5 * broad - 0.2 + ends,
        ),
        mixed((0.62, 0.2, 0.012), (0.7, 0.3, 0.03), speckle),
        mixed((0.34, 0.36, 0.05), (0.5, 0.3, 0.05), 1.6 * broad - 0.5 + 0.5 * (speckle > 0.78)),
        mixed(
            (0.66, 0.43, 0.03),
            (0.1, 0.05, 0.015),
            2.2 * (streaks * broad > 0.42) * speckle + 1.2 * np.clip(ends * 2 - 0.6, 0, 1),
        ),
        mixed((0.055, 0.012, 0.04), (0.13, 0.05, 0.12), 1.3 * broad - 0.3),
        mixed((0.09, 0.055, 0.02), (0.16, 0.1, 0.04), streaks),
    ]
    return write_picture(path, np.concatenate(columns, axis=1))
