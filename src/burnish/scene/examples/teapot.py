"""The Utah teapot, from Martin Newell's numbers (1975), tessellated from its Bézier patches.

Its rim, body, lid and bottom are surfaces of revolution: profiles of (radius, height), turned
by quarter circles that Newell drew as cubic curves with 0.56 for the tangent length. Handle
and spout are half tubes, mirrored; their sections run from the inner to the outer edge.
"""

from __future__ import annotations

import numpy as np

from burnish.core.types import Float64
from burnish.scene.examples.geometry import Mesh, grid, joined

QUARTER = 0.56

PROFILES = (
    ((1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4)),  # rim
    ((1.5, 2.4), (1.75, 1.875), (2.0, 1.35), (2.0, 0.9)),  # body
    ((2.0, 0.9), (2.0, 0.45), (1.5, 0.225), (1.5, 0.15)),
    ((0.0, 3.15), (0.8, 3.15), (0.0, 2.85), (0.2, 2.7)),  # lid
    ((0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4)),
    ((1.5, 0.15), (1.5, 0.075), (1.425, 0.0), (0.0, 0.0)),  # bottom
)

# (inner x, inner z), (outer x, outer z), half width
TUBES = (
    (  # handle
        ((-1.6, 2.025), (-1.5, 2.25), 0.3),
        ((-2.3, 2.025), (-2.5, 2.25), 0.3),
        ((-2.7, 2.025), (-3.0, 2.25), 0.3),
        ((-2.7, 1.8), (-3.0, 1.8), 0.3),
    ),
    (
        ((-2.7, 1.8), (-3.0, 1.8), 0.3),
        ((-2.7, 1.575), (-3.0, 1.35), 0.3),
        ((-2.5, 1.125), (-2.65, 0.9375), 0.3),
        ((-2.0, 0.9), (-1.9, 0.6), 0.3),
    ),
    (  # spout
        ((1.7, 1.425), (1.7, 0.6), 0.66),
        ((2.6, 1.425), (3.1, 0.825), 0.66),
        ((2.3, 2.1), (2.4, 2.025), 0.25),
        ((2.7, 2.4), (3.3, 2.4), 0.25),
    ),
    (
        ((2.7, 2.4), (3.3, 2.4), 0.25),
        ((2.8, 2.475), (3.525, 2.49375), 0.25),
        ((2.9, 2.475), (3.45, 2.5125), 0.15),
        ((2.8, 2.4), (3.2, 2.4), 0.15),
    ),
)


def patches() -> list[Float64]:
    """The 32 patches: control points float64 [4, 4, 3], z up, normals pointing outwards."""
    result = []
    for profile in PROFILES:
        for quarter in range(4):
            a, b = (
                np.array([np.cos(angle), np.sin(angle), 0.0])
                for angle in (quarter * np.pi / 2, (quarter + 1) * np.pi / 2)
            )
            around = np.stack([a, a + QUARTER * b, QUARTER * a + b, b])
            rows = [
                radius * around + np.array([0.0, 0.0, height])
                for radius, height in reversed(profile)
            ]
            result.append(np.stack(rows))
    for tube in TUBES:
        for side in (1.0, -1.0):
            rows = []
            for (xi, zi), (xo, zo), half in tube:
                y = side * half
                rows.append(np.array([(xi, 0, zi), (xi, y, zi), (xo, y, zo), (xo, 0, zo)]))
            control = np.stack(rows)
            # Mirroring turns a patch inside out
            result.append(control[:, ::-1] if side > 0 else control)
    return result


def teapot(divisions: int = 24) -> Mesh:
    """The teapot standing on z = 0, each patch divided into `divisions`² quads."""
    t = np.linspace(0.0, 1.0, divisions + 1)
    meshes = []
    for control in patches():
        positions = np.einsum("ia,jb,abk->ijk", _bernstein(t), _bernstein(t), control)
        # At a pole the derivatives vanish: take the normal just beside it
        inner = np.clip(t, 1e-3, 1.0 - 1e-3)
        du = np.einsum("ia,jb,abk->ijk", _derivative(inner), _bernstein(inner), control)
        dv = np.einsum("ia,jb,abk->ijk", _bernstein(inner), _derivative(inner), control)
        normals = np.cross(dv, du)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        uv = np.stack(np.meshgrid(t, t, indexing="ij"), -1)
        meshes.append(grid(positions, normals, uv))
    return joined(*meshes)


def _bernstein(t: Float64) -> Float64:
    s = 1.0 - t
    return np.stack([s**3, 3 * s * s * t, 3 * s * t * t, t**3], -1)


def _derivative(t: Float64) -> Float64:
    s = 1.0 - t
    return 3.0 * np.stack([-s * s, s * s - 2 * s * t, 2 * s * t - t * t, t * t], -1)
