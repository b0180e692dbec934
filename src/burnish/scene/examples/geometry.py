"""Meshes from formulas, and the transforms that place them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from burnish.core.types import RGB, Float64

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Mesh:
    """Triangles. positions, normals: float64 [v, 3]; uv: float64 [v, 2]; faces: int32 [f, 3]."""

    positions: Float64
    normals: Float64
    uv: Float64
    faces: NDArray[np.int32]

    def moved(self, offset: Point | Float64 = (0.0, 0.0, 0.0), turn: Float64 | None = None) -> Mesh:
        """The mesh turned by a rotation matrix [3, 3] about the origin, then shifted."""
        turn = np.eye(3) if turn is None else turn
        return replace(
            self, positions=self.positions @ turn.T + offset, normals=self.normals @ turn.T
        )

    def mapped(self, uv: Float64) -> Mesh:
        """The mesh with other texture coordinates: [v, 2]."""
        return replace(self, uv=np.ascontiguousarray(uv, np.float64))

    def write(self, path: Path) -> str:
        """Write a binary PLY file; returns its path as text."""
        vertices = np.concatenate([self.positions, self.normals, self.uv], axis=1)
        names = ("x", "y", "z", "nx", "ny", "nz", "u", "v")
        header = "\n".join(
            [
                "ply",
                "format binary_little_endian 1.0",
                f"element vertex {len(vertices)}",
                *(f"property float {name}" for name in names),
                f"element face {len(self.faces)}",
                "property list uchar int vertex_indices",
                "end_header\n",
            ]
        )
        faces = np.empty(len(self.faces), [("count", "u1"), ("index", "<i4", 3)])
        faces["count"], faces["index"] = 3, self.faces
        path.write_bytes(header.encode() + vertices.astype("<f4").tobytes() + faces.tobytes())
        return str(path)


def joined(*meshes: Mesh) -> Mesh:
    """Several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.uv for mesh in meshes]),
        np.concatenate(
            [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
        ).astype(np.int32),
    )


def grid(positions: Float64, normals: Float64, uv: Float64) -> Mesh:
    """A mesh over a grid of points: [rows, columns, 3], [rows, columns, 3], [rows, columns, 2].

    Triangles that shrink to a line, as at a pole, are left out.
    """
    rows, columns = positions.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)
    flat = positions.reshape(-1, 3)
    corners = flat[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    faces = faces[area > 1e-12 * area.max()]
    return Mesh(flat, normals.reshape(-1, 3), uv.reshape(-1, 2), faces.astype(np.int32))


def swept(path: Float64, sides: Float64, ups: Float64, section: Float64) -> Mesh:
    """A section moved along a path.

    path: [n, 3]. sides, ups: [n, 3], the unit axes of the section's plane at each point.
    section: [m, 2], coordinates along side and up. It must turn clockwise (side to the right,
    up upwards) for outward normals where side × up points back along the path, else
    anticlockwise.
    uv: along the section and along the path, 0 to 1.
    """
    ring = section[None, :, :1] * sides[:, None] + section[None, :, 1:] * ups[:, None]
    return lofted(path[:, None] + ring)


def lofted(positions: Float64) -> Mesh:
    """A smooth mesh over a grid of points [rows, columns, 3].

    Its outside is where columns × rows points, the normals those of the grid; a first or last
    row that shrinks to a point, as at a pole, gets one normal. uv: along the columns and the
    rows, 0 to 1.
    """
    normals = np.cross(_tangents(positions, 1), _tangents(positions, 0))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
    for end, beside in ((0, 1), (-1, -2)):
        if np.ptp(positions[end], axis=0).max() < 1e-9:
            pole = normals[beside, :-1].sum(axis=0)
            normals[end] = pole / np.linalg.norm(pole)
    u, v = (np.linspace(0, 1, count) for count in positions.shape[1::-1])
    return grid(positions, normals, np.stack(np.broadcast_arrays(u[None], v[:, None]), -1))


def _tangents(positions: Float64, axis: int) -> Float64:
    """Directions along one axis of a grid: the mean of the unit steps before and after.

    Where the axis returns to its start, the step across the seam counts as its neighbour.
    """
    p = np.moveaxis(positions, axis, 0)
    steps = np.diff(p, axis=0)
    steps /= np.maximum(np.linalg.norm(steps, axis=-1, keepdims=True), 1e-30)
    closed = np.allclose(p[0], p[-1])
    first, last = (steps[-1:], steps[:1]) if closed else (steps[:1], steps[-1:])
    mean = np.concatenate([first, steps]) + np.concatenate([steps, last])
    return np.moveaxis(mean, 0, axis)


def refined(outline: Float64, longest: float) -> Float64:
    """An outline [n, 2] with its long edges divided, so that flat parts keep flat normals."""
    points = [outline[:1]]
    for a, b in pairwise(outline):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / longest)))
        points.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(points)


def rounded_rectangle(width: float, height: float, radius: float, per_corner: int) -> Float64:
    """A closed outline [4 · per_corner + 1, 2], anticlockwise, around the origin."""
    corners = []
    for quarter, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        angle = (quarter + np.linspace(0.0, 1.0, per_corner)) * np.pi / 2
        centre = np.array([sx * (width / 2 - radius), sy * (height / 2 - radius)])
        corners.append(centre + radius * np.stack([np.cos(angle), np.sin(angle)], -1))
    return np.concatenate([*corners, corners[0][:1]])


def rectangle(centre: Point, facing: Point, up: Point, width: float, height: float) -> Any:
    """The to_world of Mitsuba's `rectangle`: its centre, what it faces, its upward side."""
    target = tuple(c + f for c, f in zip(centre, facing, strict=True))
    return mi.ScalarTransform4f().look_at(origin=centre, target=target, up=up) @ (
        mi.ScalarTransform4f().scale([width / 2, height / 2, 1.0])
    )


def rgb(*colour: float) -> dict[str, Any]:
    """A linear RGB colour, or a grey, as a Mitsuba dictionary."""
    value: RGB = (colour * 3)[:3] if len(colour) == 1 else colour  # type: ignore[assignment]
    return {"type": "rgb", "value": list(value)}


def camera(
    origin: Point,
    target: Point,
    fov: float,
    size: tuple[int, int],
    up: Point = (0.0, 0.0, 1.0),
) -> dict[str, Any]:
    """A perspective camera; fov is horizontal, in degrees; size in pixels."""
    return {
        "type": "perspective",
        "fov": fov,
        "fov_axis": "x",
        "to_world": mi.ScalarTransform4f().look_at(origin=origin, target=target, up=up),
        "film": {
            "type": "hdrfilm",
            "width": size[0],
            "height": size[1],
            "rfilter": {"type": "gaussian"},
        },
    }
