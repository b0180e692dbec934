"""Meshes from formulas, and the transforms that place them."""

from __future__ import annotations

from dataclasses import dataclass
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


def surface_of_revolution(profile: Float64, outward: Float64, segments: int) -> Mesh:
    """A profile turned around the z axis.

    profile: [n, 2], radius and height. outward: [n, 2], its unit normals in the same plane.
    uv: angle and position along the profile, both 0 to 1.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    around = np.stack([np.cos(angle), np.sin(angle)], -1)

    def turned(plane: Float64) -> Float64:
        ring = plane[:, None, :1] * around[None]
        height = np.broadcast_to(plane[:, None, 1:], (*ring.shape[:2], 1))
        return np.concatenate([ring, height], -1)

    steps = np.linalg.norm(np.diff(profile, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    uv = np.stack(np.broadcast_arrays(angle[None] / (2 * np.pi), along[:, None]), -1)
    return grid(turned(profile), turned(outward), uv)


def polyline_normals(profile: Float64) -> Float64:
    """Unit normals of a smooth profile [n, 2], to the right of its direction."""
    tangent = np.gradient(profile, axis=0)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], -1)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


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
