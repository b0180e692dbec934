"""Pearl earrings on a velvet cloth over a pedestal, after figure 2 of the 2006 paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from burnish.core.types import Float64
from burnish.materials.models.cook_torrance import CookTorrance
from burnish.materials.models.light_view import LightView
from burnish.scene.examples.environment import Panel, Room, envmap, write_environment
from burnish.scene.examples.geometry import Mesh, camera, joined, lofted
from burnish.scene.examples.gloss import layered
from burnish.scene.examples.shapes import ellipsoid, revolved, spline, towards, tube
from burnish.scene.examples.surfaces import both_faces, glossy, metal, solid, upholstery
from burnish.scene.objects import SceneObject

TOP, BEND, LENGTH = 2.1, 0.22, 5.2
CREAM = (0.47, 0.4, 0.33)

CANDLES = tuple((x, -3.0 - 0.4 * np.sin(5.0 * x)) for x in np.arange(-4.4, 4.5, 0.72))

# A nave by night: lamps, a rose window, and a choir that glows
NAVE = Room(
    low=(-7.0, -9.0, -7.0),
    high=(7.0, 12.0, 8.0),
    panels=(
        Panel("-x", (-3.0, 3.0), (1.6, 4.0), (62.0, 64.0, 70.0), (1, 3), sky=0.3),
        Panel("-x", (0.6, 3.0), (1.6, 4.0), (62.0, 64.0, 70.0), (1, 3), sky=0.3),
        Panel("-x", (4.2, 3.0), (1.6, 4.0), (62.0, 64.0, 70.0), (1, 3), sky=0.3),
        Panel("+x", (-1.0, 1.0), (1.0, 1.4), (60.0, 38.0, 17.0), soft=0.3),
        Panel("+x", (3.0, 1.0), (1.0, 1.4), (60.0, 38.0, 17.0), soft=0.3),
        Panel("-y", (1.5, 4.5), (4.0, 3.0), (5.0, 4.4, 4.0), (4, 3), sky=0.2),
        Panel("+y", (0.0, 1.5), (5.0, 4.0), (7.0, 4.6, 2.4), soft=0.45),
        *(Panel("+y", place, (0.45, 0.45), (14.0, 7.6, 2.8), soft=0.5) for place in CANDLES),
        Panel("+z", (0.0, 0.0), (1.5, 1.5), (22.0, 18.0, 13.0), soft=0.3),
    ),
    walls=(0.34, 0.29, 0.23),
    floor=(0.12, 0.09, 0.07),
    ambient=(0.2, 0.165, 0.13),
)


def describe(folder: Path) -> dict[str, Any]:
    """Objects: pearls, posts, cloth, pedestal."""
    pearls, posts = _earrings()
    return {
        "type": "scene",
        "pearls": solid(pearls, folder / "pearls.ply", glossy(0.12, CREAM)),
        "posts": solid(posts, folder / "posts.ply", metal("Au", 0.12)),
        "cloth": solid(
            cloth(),
            folder / "cloth.ply",
            both_faces(upholstery((0.16, 0.006, 0.014), 0.55, 1.0)),
        ),
        "pedestal": solid(_pedestal(), folder / "pedestal.ply", glossy(0.1, (0.35, 0.33, 0.3))),
        "nave": envmap(write_environment(NAVE, folder / "nave.exr", 512), 0.7),
        "view": camera((0.6, -8.4, 3.5), (0.0, -0.3, -0.35), 34.0, (512, 512)),
    }


def cloth() -> Mesh:
    """A round cloth: nearly flat on top, over the edge in folds that widen as they fall."""
    angle = np.linspace(0.0, 2 * np.pi, 481)[None, :]
    s = np.concatenate(
        [np.linspace(0.0, TOP, 60), TOP + (LENGTH - TOP) * np.linspace(0, 1, 91)[1:] ** 1.2]
    )[:, None]
    # The section without folds: flat, a quarter circle, straight down
    turn = np.clip((s - TOP) / BEND, 0.0, np.pi / 2)
    radius = np.minimum(s, TOP) + BEND * np.sin(turn)
    fall = BEND * (1 - np.cos(turn)) + np.maximum(s - TOP - BEND * np.pi / 2, 0.0)
    folds, depth = _folds(angle)
    below = np.clip((s - TOP) / (LENGTH - TOP), 0.0, 1.0)
    swing = 1.05 * below**0.6 * depth * folds + 0.1 * below
    pull = 0.05 * np.clip(s / TOP - 0.45, 0, None) ** 2 * (folds - 0.5)
    radius = radius + swing
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    z = np.where(s <= TOP, surface(x, y), surface(TOP * np.cos(angle), TOP * np.sin(angle)) - fall)
    z = z + np.where(s <= TOP, pull, 0.0) + 0.0 * x
    mesh = lofted(np.stack([x, y, z], -1))
    flat = np.stack(np.broadcast_arrays(s * np.cos(angle), s * np.sin(angle)), -1)
    return mesh.mapped(flat.reshape(-1, 2))


def surface(x: Any, y: Any) -> Any:
    """Height of the cloth on top of the pedestal: long, low ripples."""
    far = np.clip((x * x + y * y) / TOP**2, 0.0, 1.0)
    ripple = 0.03 * np.sin(2.3 * x + 1.1 * np.sin(1.4 * y)) + 0.022 * np.sin(
        3.4 * y - 1.7 * x + 0.6
    )
    return ripple * (1.0 - 0.5 * far)


def _folds(angle: Float64) -> tuple[Float64, Float64]:
    """Fold profile in [0, 1] and the depth of each fold, around the edge."""
    phase = 10 * angle + 1.1 * np.sin(2 * angle + 0.4) + 0.7 * np.sin(3 * angle + 2.0)
    depth = 0.8 + 0.2 * np.sin(2 * angle + 1.0) + 0.14 * np.sin(5 * angle)
    return (0.5 + 0.5 * np.sin(phase)) ** 1.25, depth


def _earrings() -> tuple[Mesh, Mesh]:
    """Two studs, one on its pearl and one on its side, and a pair of drops."""
    pearls, posts = [], []
    studs = (((-0.72, -0.5), (0.25, -0.2, 0.95), 0.5), ((0.42, -1.0), (0.82, -0.42, -0.2), 0.5))
    for (x, y), axis, radius in studs:
        centre = np.array([x, y, surface(x, y) + radius])
        pearls.append(ellipsoid((0, 0, 0), (radius, radius, 0.97 * radius)).moved(centre))
        posts.append(_post(radius).moved(centre, towards(axis)))
    for (x, y), axis in (((0.85, 0.25), (-0.55, 0.8, 0.15)), ((-0.1, 0.75), (-0.8, 0.55, 0.15))):
        centre = np.array([x, y, surface(x, y) + 0.36])
        turn = towards(axis)
        pearls.append(_drop().moved(centre, turn))
        posts.append(_hook().moved(centre, turn))
    return joined(*pearls), joined(*posts)


def _post(radius: float) -> Mesh:
    """A cup that holds a pearl, and the pin that goes through the ear, along z."""
    angle = np.radians(np.linspace(0, 46, 16))
    outer = (radius + 0.045) * np.stack([np.sin(angle), np.cos(angle)], -1)[::-1]
    inner = (radius - 0.02) * np.stack([np.sin(angle), np.cos(angle)], -1)
    rim = spline([inner[-1], (inner[-1] + outer[0]) / 2 + (0.02, -0.02), outer[0]], 4)
    cup = revolved(np.concatenate([inner, rim[1:], outer[1:]]), 64)
    top = radius + 0.03
    pin = [
        (0.09, 0.0),
        (0.05, 0.05),
        (0.034, 0.12),
        (0.034, 0.62),
        (0.022, 0.66),
        (0.022, 0.7),
        (0.034, 0.74),
        (0.034, 0.9),
        (0.02, 0.96),
        (0.0, 0.975),
    ]
    profile = spline(pin, 6) + np.array([0.0, top])
    return joined(cup, revolved(np.concatenate([[(0.0, top - 0.01)], profile]), 32))


def _drop() -> Mesh:
    """A pearl that narrows towards z."""
    t = np.linspace(0.0, np.pi, 49)
    radius = (
        0.36
        * np.sin(t)
        * (1 - 0.17 * np.cos(np.pi - t) ** 3 - 0.12 * np.clip(np.cos(np.pi - t), 0, 1))
    )
    return revolved(
        np.stack([radius, -0.36 * np.cos(t) * np.where(t > np.pi / 2, 1.35, 1.0)], -1), 64
    )


def _hook() -> Mesh:
    """A cap, a link and a bent wire above a drop, along z."""
    cap = revolved(
        spline([(0.0, 0.41), (0.14, 0.4), (0.15, 0.43), (0.11, 0.5), (0.05, 0.54), (0.0, 0.55)], 6),
        48,
    )
    t = np.linspace(0, 2 * np.pi, 33)
    link = tube(np.stack([0.075 * np.cos(t), 0 * t, 0.6 + 0.075 * np.sin(t)], -1)[:-1], 0.02, 12)
    wire = spline(
        [
            (0.0, 0.0, 0.69),
            (0.02, 0.02, 0.85),
            (0.12, 0.02, 1.12),
            (0.3, 0.0, 1.26),
            (0.47, -0.02, 1.12),
            (0.5, -0.04, 0.8),
            (0.58, -0.05, 0.5),
        ],
        10,
    )
    return joined(cap, link, tube(wire, 0.024, 14))


def _pedestal() -> Mesh:
    """A column with a round top under the cloth and a stepped foot."""
    profile = [
        (0.0, -7.0),
        (2.9, -7.0),
        (2.9, -6.6),
        (2.5, -6.4),
        (1.95, -6.2),
        (1.85, -5.5),
        (1.85, -1.0),
        (TOP, -0.6),
        (TOP, -0.16),
        (TOP - 0.06, -0.1),
        (0.0, -0.1),
    ]
    return revolved(profile, 128)


def _pearly(item: SceneObject) -> SceneObject:
    """A creamy ground, a sharp reflection, and the haze that comes from under the surface."""
    return layered(
        item,
        {
            "diffuse": (LightView(), {"color": CREAM}),
            "specular": (
                CookTorrance("beckmann"),
                {"color": (0.09, 0.088, 0.085), "roughness": 0.05},
            ),
            "haze": (CookTorrance("beckmann"), {"color": (0.12, 0.085, 0.1), "roughness": 0.28}),
        },
    )


FINISH = {"pearls": _pearly}
