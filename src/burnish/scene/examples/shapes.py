"""Shapes that the scenes are put together from: turned, bent, stuffed and rounded ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from burnish.core.types import Float64
from burnish.scene.examples.geometry import Mesh, Point, grid, lofted


def spline(points: Sequence[Sequence[float] | Float64] | Float64, per: int = 12) -> Float64:
    """A smooth curve [per · (n − 1) + 1, k] through points [n, k] (Catmull and Rom)."""
    p = np.asarray(points, np.float64)
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    t = (np.arange(per) / per)[:, None]
    pieces = [
        b + t / 2 * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
        for a, b, c, d in zip(p[:-3], p[1:-2], p[2:-1], p[3:], strict=True)
    ]
    return np.concatenate([*pieces, p[-2:-1]])


def rotation(axis: Point, degrees: float) -> Float64:
    """The matrix [3, 3] that turns about an axis (Rodrigues)."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    turn: Float64 = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turn


def towards(direction: Sequence[float] | Float64) -> Float64:
    """A rotation that takes the z axis to a direction."""
    z = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], -1)


def revolved(profile: Sequence[Sequence[float]] | Float64, around: int = 96) -> Mesh:
    """A profile of (radius, height) [n, 2] turned about z; upwards is outwards.

    u runs around, v along the profile.
    """
    r, z = np.asarray(profile, np.float64).T[:, :, None]
    angle = np.linspace(0.0, 2 * np.pi, around + 1)
    return lofted(np.stack(np.broadcast_arrays(r * np.cos(angle), r * np.sin(angle), z), -1))


def tube(path: Float64, radius: float | Float64, around: int = 20) -> Mesh:
    """A round tube [n, 3] whose ends are rounded; radius: one, or one per point [n]."""
    radii = np.broadcast_to(np.asarray(radius, np.float64), len(path))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # Carry the first side along without twist
    side = np.empty_like(path)
    side[0] = towards(tangent[0])[:, 0]
    for k in range(1, len(path)):
        side[k] = side[k - 1] - tangent[k] * (side[k - 1] @ tangent[k])
        side[k] /= np.linalg.norm(side[k])
    turn = np.linspace(0.0, np.pi / 2, 8)[:, None]
    head = path[0] - tangent[0] * radii[0] * np.cos(turn)
    tail = path[-1] + tangent[-1] * radii[-1] * np.sin(turn)
    centre = np.concatenate([head[:-1], path, tail[1:]])
    radii = np.concatenate(
        [radii[0] * np.sin(turn[:-1, 0]), radii, radii[-1] * np.cos(turn[1:, 0])]
    )
    radii[-1] = 0.0
    frame = [
        np.concatenate([np.repeat(x[:1], 7, 0), x, np.repeat(x[-1:], 7, 0)])
        for x in (side, np.cross(tangent, side))
    ]
    angle = np.linspace(0.0, 2 * np.pi, around + 1)[None, :, None]
    ring = np.cos(angle) * frame[0][:, None] + np.sin(angle) * frame[1][:, None]
    return lofted(centre[:, None] + radii[:, None, None] * ring)


def ellipsoid(centre: Point, radii: Point, around: int = 64) -> Mesh:
    """An ellipsoid with axes along x, y and z."""
    return cushion(centre, radii, 1.0, 1.0, around)


def cushion(centre: Point, half: Point, upright: float, plan: float, around: int = 96) -> Mesh:
    """A superellipsoid: 1 is round, towards 0 it fills its box.

    half: half of its width, depth and height. upright, plan: exponents seen from the side and
    from above. The angles crowd where it bends, and the normals are exact.
    """
    u = _crowded(np.linspace(-np.pi, np.pi, around + 1), plan)[None, :]
    v = _crowded(np.linspace(-np.pi / 2, np.pi / 2, around // 2 + 1), upright)[:, None]
    across, up = np.cos(v), np.sin(v)
    across[[0, -1]] = 0.0
    directions = (np.cos(u), np.sin(u))
    p = [_power(across, upright) * _power(x, plan) for x in directions]
    n = [_power(across, 2 - upright) * _power(x, 2 - plan) for x in directions]
    positions = np.stack(np.broadcast_arrays(*p, _power(up, upright)), -1) * np.asarray(half)
    normals = np.stack(np.broadcast_arrays(*n, _power(up, 2 - upright)), -1) / np.asarray(half)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    uv = np.stack(
        np.broadcast_arrays(
            np.linspace(0, 1, around + 1)[None], np.linspace(0, 1, around // 2 + 1)[:, None]
        ),
        -1,
    )
    return grid(positions + np.asarray(centre), normals, uv)


def rounded_box(centre: Point, half: Point, radius: float, per_corner: int = 6) -> Mesh:
    """A box with round edges and flat faces."""
    quarter = np.linspace(0.0, np.pi / 2, per_corner)
    u = np.concatenate([quarter + k * np.pi / 2 for k in range(4)])
    sx, sy = (np.repeat(s, per_corner) for s in ((1, -1, -1, 1), (1, 1, -1, -1)))
    u, sx, sy = (np.append(x, x[0]) for x in (u, sx, sy))
    v = np.concatenate([quarter - np.pi / 2, quarter])[:, None]
    sz = np.repeat((-1, 1), per_corner)[:, None]
    normals = np.stack(
        np.broadcast_arrays(np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)), -1
    )
    inner = np.asarray(half) - radius
    positions = radius * normals + inner * np.stack(np.broadcast_arrays(sx, sy, sz), -1)
    # The faces below and above close at their middle
    ends = [np.full_like(positions[:1], (0, 0, sign * half[2])) for sign in (-1, 1)]
    caps = [np.full_like(normals[:1], (0, 0, sign)) for sign in (-1, 1)]
    positions = np.concatenate([ends[0], positions, ends[1]])
    normals = np.concatenate([caps[0], normals, caps[1]])
    uv = _box_uv(positions, normals)
    return grid(positions + np.asarray(centre), normals, uv)


def pierced(
    width: Sequence[float], height: Sequence[float], thick: float, holes: Sequence[tuple[int, int]]
) -> Mesh:
    """A flat wall in x and z, its face at y = 0 and its back at y = thick, with openings.

    width, height: the lines that divide it; holes: which (column, row) between them is open.
    uv: x and z.
    """
    solid = np.ones((len(width) - 1, len(height) - 1), bool)
    for hole in holes:
        solid[hole] = False
    beside = np.pad(solid, 1)
    quads: list[list[tuple[float, float, float]]] = []
    for i, k in np.argwhere(solid):
        x0, x1, z0, z1 = width[i], width[i + 1], height[k], height[k + 1]
        quads.append([(x0, 0, z0), (x1, 0, z0), (x1, 0, z1), (x0, 0, z1)])
        quads.append([(x1, thick, z0), (x0, thick, z0), (x0, thick, z1), (x1, thick, z1)])
        for (di, dk), (a, b) in {
            (-1, 0): ((x0, z1), (x0, z0)),
            (1, 0): ((x1, z0), (x1, z1)),
            (0, -1): ((x0, z0), (x1, z0)),
            (0, 1): ((x1, z1), (x0, z1)),
        }.items():
            if not beside[i + 1 + di, k + 1 + dk]:
                (ax, az), (bx, bz) = a, b
                quads.append([(ax, 0, az), (ax, thick, az), (bx, thick, bz), (bx, 0, bz)])
    corners = np.asarray(quads, np.float64)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    index = np.arange(4 * len(corners), dtype=np.int32).reshape(-1, 4)
    faces = np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]])
    points = corners.reshape(-1, 3)
    return Mesh(points, np.repeat(flat, 4, 0), points[:, ::2], faces)


def _box_uv(positions: Float64, normals: Float64) -> Float64:
    """Coordinates of the side that a point faces: lengths, not fractions."""
    axis = np.abs(normals).argmax(axis=-1)
    u = np.where(axis == 0, positions[..., 1], positions[..., 0])
    v = np.where(axis == 2, positions[..., 1], positions[..., 2])
    return np.stack([u, v], -1)


def _power(x: Float64, exponent: float) -> Float64:
    # A small power would make much of the rounding of cos 90°
    size = np.where(np.abs(x) < 1e-12, 0.0, np.abs(x))
    return np.asarray(np.sign(x) * size**exponent)


def _crowded(angle: Float64, exponent: float) -> Float64:
    """Angles drawn towards the multiples of 90°, so that a superellipse's points lie evenly."""
    quarter = np.round(angle / (np.pi / 2)) * (np.pi / 2)
    within = (angle - quarter) / (np.pi / 4)
    return np.asarray(quarter + np.pi / 4 * _power(within, 1.0 / exponent))
