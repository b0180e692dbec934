"""A room with a couch and stairs, lit through its windows, after figure 1 of the 2008 paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from burnish.scene.examples.geometry import Mesh, camera, joined, rectangle, rgb
from burnish.scene.examples.gloss import glossed
from burnish.scene.examples.shapes import (
    cushion,
    pierced,
    revolved,
    rotation,
    rounded_box,
    spline,
    tube,
)
from burnish.scene.examples.surfaces import both_faces, glossy, matte, picture, solid, upholstery
from burnish.scene.examples.texture import clouds, texels, write_picture, write_wood
from burnish.scene.examples.windows import casement, sky_panel, unedited

LEFT, RIGHT, FRONT, BACK, HEIGHT = -3.6, 3.6, -4.6, 3.2, 3.3
WINDOWS = ((-3.3, -1.9), (-1.1, 0.3), (1.1, 2.5))
SILL, LINTEL = 0.45, 2.85
STEPS = 13

FINISH = dict.fromkeys(("walls", "ceiling"), glossed) | dict.fromkeys(("sky",), unedited)


def describe(folder: Path) -> dict[str, Any]:
    """Objects: floor, walls, ceiling, sills, couch, stairs; fixed: table, legs, railing, glass."""
    brushed = {
        "type": "roughconductor",
        "distribution": "ggx",
        "material": "Cr",
        "alpha_u": 0.25,
        "alpha_v": 0.1,
    }
    deep, wide = BACK - FRONT, RIGHT - LEFT
    return {
        "type": "scene",
        "floor": {
            "type": "rectangle",
            "to_world": rectangle((0, (FRONT + BACK) / 2, 0), (0, 0, 1), (0, 1, 0), wide, deep),
            "bsdf": glossy(
                0.1,
                picture(write_wood(folder / "parquet.png", 8), 2.0, 5.0),
            ),
        },
        "walls": solid(_walls(), folder / "walls.ply", both_faces(matte((0.66, 0.64, 0.6)))),
        "ceiling": {
            "type": "rectangle",
            "to_world": rectangle(
                (0, (FRONT + BACK) / 2, HEIGHT), (0, 0, -1), (0, 1, 0), wide, deep
            ),
            "bsdf": both_faces(matte((0.78, 0.77, 0.75))),
        },
        "sills": solid(_sills(), folder / "sills.ply", glossy(0.12, (0.6, 0.58, 0.55))),
        "couch": solid(
            couch().moved((0.75, 0.55, 0.0), rotation((0, 0, 1), -14)),
            folder / "couch.ply",
            upholstery((0.34, 0.018, 0.014), 0.55, 0.7),
        ),
        "stairs": solid(_stairs(), folder / "stairs.ply", glossy(0.15, (0.6, 0.52, 0.42))),
        "railing": solid(_railing(), folder / "railing.ply", brushed),
        "table": solid(
            rounded_box((-0.95, -1.15, 0.42), (0.62, 0.42, 0.012), 0.008),
            folder / "table.ply",
            {"type": "dielectric"},
        ),
        "legs": solid(_legs(), folder / "legs.ply", brushed),
        "rug": solid(
            _rug(),
            folder / "rug.ply",
            matte(picture(write_rug(folder / "rug.png"))),
        ),
        "picture": solid(
            _flat(rounded_box((0, 0, 0), (0.62, 0.02, 0.45), 0.012), 2).moved(
                (2.15, BACK - 0.02, 1.85)
            ),
            folder / "picture.ply",
            matte(picture(write_painting(folder / "art.png"))),
        ),
        "glass": solid(_glass(), folder / "glass.ply", {"type": "dielectric"}),
        "sky": sky_panel(folder / "sky.exr", (LEFT - 1.6, -0.4, 1.0), (1, 0, 0), 12.0, 4.8, 17.0),
        "sun": {
            "type": "rectangle",
            "to_world": rectangle((-14.0, -4.6, 14.2), (10.5, 3.9, -13.2), (0, 0, 1), 0.9, 0.9),
            "emitter": {"type": "area", "radiance": rgb(13000.0, 10800.0, 7800.0)},
        },
        "view": camera((1.9, -4.3, 1.62), (-0.25, 0.9, 0.98), 62.0, (640, 480)),
    }


def couch() -> Mesh:
    """Three seats wide, facing −y, with two loose pillows."""
    parts = [
        rounded_box((0, 0, 0.22), (1.12, 0.46, 0.11), 0.05),
        rounded_box((0, 0.42, 0.48), (1.12, 0.09, 0.36), 0.08),
    ]
    for x in (-0.66, 0.0, 0.66):
        parts.append(cushion((x, -0.06, 0.41), (0.328, 0.42, 0.11), 0.45, 0.22))
        parts.append(
            cushion((0, 0, 0), (0.325, 0.12, 0.26), 0.45, 0.35).moved(
                (x, 0.29, 0.72), rotation((1, 0, 0), -12)
            )
        )
    for side in (-1.0, 1.0):
        parts.append(cushion((1.1 * side, 0.0, 0.4), (0.13, 0.5, 0.28), 0.4, 0.25))
        turn = rotation((0, 0, 1), -28 * side) @ rotation((1, 0, 0), -20)
        parts.append(
            cushion((0, 0, 0), (0.23, 0.09, 0.23), 0.6, 0.6).moved((0.78 * side, 0.08, 0.7), turn)
        )
        for y in (-0.36, 0.4):
            leg = np.array([[0.98 * side, y, 0.14], [1.0 * side, y, 0.03]])
            parts.append(tube(spline(leg, 4), 0.032, 12))
    return joined(*parts)


def _walls() -> Mesh:
    """The wall with the windows on the left, and the three others."""
    lines = [FRONT, *(edge for window in WINDOWS for edge in window), BACK]
    windows = pierced(lines, (0, SILL, LINTEL, HEIGHT), 0.3, [(1, 1), (3, 1), (5, 1)])
    across = pierced((LEFT, RIGHT), (0, HEIGHT), 0.1, [])
    right = pierced((-BACK, -FRONT), (0, HEIGHT), 0.1, [])
    skirting = rounded_box((0, BACK - 0.01, 0.06), (RIGHT, 0.01, 0.06), 0.006)
    return joined(
        windows.moved((LEFT, 0, 0), rotation((0, 0, 1), 90)),
        across.moved((0, BACK, 0)),
        across.moved((0, FRONT, 0), rotation((0, 0, 1), 180)),
        right.moved((RIGHT, 0, 0), rotation((0, 0, 1), -90)),
        skirting,
    )


def _sills() -> Mesh:
    """A board below each window, and its casement."""
    parts = []
    for start, end in WINDOWS:
        frame = casement(start, end, SILL, LINTEL).moved(turn=rotation((0, 0, 1), 90))
        board = (
            (LEFT + 0.02, (start + end) / 2, SILL - 0.02),
            (0.2, (end - start) / 2 + 0.12, 0.025),
        )
        parts += [frame.moved((LEFT - 0.18, 0, 0)), rounded_box(*board, 0.015)]
    return joined(*parts)


def _step(k: int) -> tuple[float, float]:
    """x and z of the middle of a tread."""
    return -2.7 + 0.29 * k, 0.19 * (k + 1)


def _stairs() -> Mesh:
    """Treads that stand out of the back wall, on a stringer."""
    parts = []
    for k in range(STEPS):
        x, z = _step(k)
        parts.append(rounded_box((x, BACK - 0.55, z - 0.03), (0.17, 0.54, 0.03), 0.012))
    (x0, z0), (x1, z1) = _step(0), _step(STEPS - 1)
    length = np.hypot(x1 - x0, z1 - z0) / 2 + 0.2
    beam = rounded_box((0, 0, 0), (length, 0.03, 0.09), 0.012)
    slope = np.degrees(np.arctan2(z1 - z0, x1 - x0))
    middle = ((x0 + x1) / 2, BACK - 0.55, (z0 + z1) / 2 - 0.13)
    return joined(*parts, beam.moved(middle, rotation((0, 1, 0), -slope)))


def _railing() -> Mesh:
    """A hand rail on a post for every other tread."""
    y = BACK - 1.04
    parts = []
    for k in range(0, STEPS, 2):
        x, z = _step(k)
        parts.append(tube(spline([(x, y, z), (x, y, z + 0.88)], 8), 0.012, 12))
    ends = [np.array([x, y, z + 0.9]) for x, z in (_step(0), _step(STEPS - 1))]
    parts.append(tube(spline(ends, 12), 0.024, 16))
    return joined(*parts)


def _rug() -> Mesh:
    rug = _flat(rounded_box((0, 0, 0), (1.25, 0.85, 0.012), 0.01), 1)
    return rug.moved((-0.85, -1.15, 0.0125), rotation((0, 0, 1), -4))


def _flat(mesh: Mesh, axis: int) -> Mesh:
    """The mesh with one picture over x and another axis."""
    p = mesh.positions[:, [0, axis]]
    return mesh.mapped((p - p.min(axis=0)) / np.ptp(p, axis=0))


def _legs() -> Mesh:
    parts = []
    for x in (-1.45, -0.45):
        bow = [
            (x, -1.5, 0.4),
            (x, -1.5, 0.06),
            (x, -1.44, 0.02),
            (x, -0.86, 0.02),
            (x, -0.8, 0.06),
            (x, -0.8, 0.4),
        ]
        parts.append(tube(spline(bow, 10), 0.016, 16))
    return joined(*parts)


def _glass() -> Mesh:
    """A bowl of glass on the table."""
    outside = [(0.0, 0.0), (0.08, 0.0), (0.1, 0.012), (0.16, 0.06), (0.2, 0.13), (0.205, 0.16)]
    inside = [(0.2, 0.168), (0.193, 0.16), (0.185, 0.13), (0.145, 0.07), (0.08, 0.03), (0.0, 0.025)]
    return revolved(spline(outside + inside, 8), 96).moved((-1.0, -1.1, 0.4321))


def write_rug(path: Path) -> str:
    """Rows of diamonds between bands, woven."""
    u, v = texels(600, 400)
    x, y = 9 * u, 6 * v
    diamond = np.abs((x % 1) - 0.5) + np.abs((y % 1) - 0.5)
    inks = np.array([(0.035, 0.05, 0.11), (0.42, 0.33, 0.21), (0.3, 0.06, 0.035)])
    ring = np.clip((diamond * 6).astype(int), 0, 5)
    colour = inks[(ring + (x.astype(int) + y.astype(int)) % 2) % 3]
    edge = np.minimum(np.minimum(x, 9 - x), np.minimum(y, 6 - y))
    colour = np.where((edge < 0.5)[..., None], inks[0], colour)
    colour = np.where((np.abs(edge - 0.3) < 0.06)[..., None], inks[1], colour)
    weave = 0.7 + 0.35 * clouds(u * 200, v * 300, 1, 2) + 0.2 * clouds(u * 6, v * 4, 2)
    return write_picture(path, colour * weave[..., None])


def write_painting(path: Path) -> str:
    """Fields of colour with soft edges, in a white margin."""
    u, v = texels(400, 290)
    wobble = 0.03 * (clouds(u * 12, v * 12, 3) - 0.5)
    colour = np.broadcast_to(np.array([0.55, 0.5, 0.42]), (*u.shape, 3))
    fields = (
        ((0.08, 0.92), (0.54, 0.92), (0.62, 0.2, 0.03)),
        ((0.08, 0.92), (0.3, 0.5), (0.45, 0.035, 0.03)),
    )
    for (left, right), (low, high), ink in (
        *fields,
        ((0.08, 0.92), (0.08, 0.26), (0.03, 0.06, 0.16)),
    ):
        inside = np.minimum(np.minimum(u - left, right - u), np.minimum(v - low, high - v)) + wobble
        share = (
            np.clip(inside / 0.025, 0, 1)[..., None]
            * (0.8 + 0.2 * clouds(u * 40, v * 8, 5))[..., None]
        )
        colour = colour + share * (np.asarray(ink) - colour)
    return write_picture(path, colour)
