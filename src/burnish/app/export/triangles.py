"""Shapes of a built Mitsuba scene as triangles in world space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.types import AnyArray, Float64

RINGS, SECTORS = 48, 96
"""Steps from pole to pole and around, of round shapes."""


@dataclass(frozen=True)
class Triangles:
    """positions float64 [v, 3]; normals [v, 3] or None for flat faces; uv [v, 2] or None;
    faces int64 [f, 3]."""

    positions: Float64
    normals: Float64 | None
    uv: Float64 | None
    faces: AnyArray


def triangles(shape: Any, plugin: str) -> Triangles | None:
    """The triangles of a shape; None for one of a kind that has none (curves, grids, …).

    plugin: Mitsuba's name of the shape. Round shapes are taken as 48 × 96 quads.
    """
    if isinstance(shape, mi.Mesh):
        return _mesh(shape)
    grids = {"rectangle": _rectangle, "sphere": _sphere, "disk": _disk, "cylinder": _cylinder}
    if plugin not in grids:
        return None
    matrix = np.array(mi.traverse(shape)["to_world"].matrix, np.float64).reshape(4, 4, -1)[..., 0]
    u_steps, v_steps = (1, 1) if plugin == "rectangle" else (SECTORS, RINGS)
    u, v = (a.ravel() for a in np.meshgrid(*(np.linspace(0, 1, n + 1) for n in (u_steps, v_steps))))
    positions, normals = grids[plugin](u, v)
    uv = np.stack([v, u] if plugin == "disk" else [u, v], axis=1)
    faces = _quads(u_steps, v_steps)
    positions = positions @ matrix[:3, :3].T + matrix[:3, 3]
    normals = normals @ np.linalg.inv(matrix[:3, :3])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    a, b, c = (positions[faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    keep = np.linalg.norm(across, axis=1) > 1e-12 * np.abs(across).max()
    turned = np.sum(across * normals[faces].mean(axis=1), axis=1) < 0
    faces = np.where(turned[:, None], faces[:, ::-1], faces)
    return Triangles(positions, normals, uv, faces[keep])


def _mesh(shape: Any) -> Triangles:
    positions = np.array(shape.vertex_positions_buffer(), np.float64).reshape(-1, 3)
    faces = np.array(shape.faces_buffer(), np.int64).reshape(-1, 3)
    flat = shape.has_face_normals() or not shape.has_vertex_normals()
    normals = None if flat else np.array(shape.vertex_normals_buffer(), np.float64).reshape(-1, 3)
    uv = None
    if shape.has_vertex_texcoords():
        uv = np.array(shape.vertex_texcoords_buffer(), np.float64).reshape(-1, 2)
    return Triangles(positions, normals, uv, faces)


def _quads(u_steps: int, v_steps: int) -> AnyArray:
    first = (np.arange(v_steps)[:, None] * (u_steps + 1) + np.arange(u_steps)[None]).ravel()
    low = np.stack([first, first + 1, first + u_steps + 2], axis=1)
    high = np.stack([first, first + u_steps + 2, first + u_steps + 1], axis=1)
    return np.concatenate([low, high])


Grid = tuple[Float64, Float64]


def _rectangle(u: Float64, v: Float64) -> Grid:
    return np.stack([2 * u - 1, 2 * v - 1, 0 * u], 1), np.stack([0 * u, 0 * u, 1 + 0 * u], 1)


def _sphere(u: Float64, v: Float64) -> Grid:
    phi, theta = 2 * np.pi * u, np.pi * v
    sin = np.sin(theta)
    n = np.stack([sin * np.cos(phi), sin * np.sin(phi), np.cos(theta)], 1)
    return n, n.copy()


def _disk(u: Float64, v: Float64) -> Grid:
    phi = 2 * np.pi * u
    p = np.stack([v * np.cos(phi), v * np.sin(phi), 0 * u], 1)
    return p, np.stack([0 * u, 0 * u, 1 + 0 * u], 1)


def _cylinder(u: Float64, v: Float64) -> Grid:
    phi = 2 * np.pi * u
    x, y = np.cos(phi), np.sin(phi)
    return np.stack([x, y, v], 1), np.stack([x, y, 0 * u], 1)
