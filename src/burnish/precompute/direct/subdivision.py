"""Splitting a triangle into four, again and again, as numbers rather than as a tree.

In barycentric coordinates, with a corner A and edges E₁, E₂, a piece is

    A + x E₁ + y E₂,  its edges ± h E₁, ± h E₂,  h = 2^-level,

with its sign for the orientation: the middle one of four pieces is turned round. The pieces of
all levels stand in one list, each before its own pieces (pre-order): the next piece to look at
is the next in the list, or, where a piece is good enough, the first one after its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from burnish.core.types import AnyArray, Float64

CHILDREN = 4


@dataclass(frozen=True)
class Pieces:
    """The pieces of one triangle down to a level, in pre-order; arrays [pieces].

    x, y: float64, the corner. sign: ±1. level: from 0, the triangle itself. number: the path
    from it, two bits a level: among the pieces of its level.
    """

    x: Float64
    y: Float64
    sign: AnyArray
    level: AnyArray
    number: AnyArray

    @staticmethod
    def down_to(level: int) -> Pieces:
        """All pieces of levels 0 … level."""
        found: list[tuple[float, float, int, int, int]] = []
        stack = [(0.0, 0.0, 1, 0, 0)]
        while stack:
            x, y, sign, depth, number = stack.pop()
            found.append((x, y, sign, depth, number))
            if depth < level:
                h = sign * 0.5 ** (depth + 1)
                own = [
                    (*corner, turn, depth + 1, CHILDREN * number + child)
                    for child, (corner, turn) in enumerate(
                        (
                            ((x, y), sign),
                            ((x + h, y), sign),
                            ((x, y + h), sign),
                            ((x + h, y + h), -sign),
                        )
                    )
                ]
                stack += reversed(own)
        return Pieces(*(np.array(column) for column in zip(*found, strict=True)))

    def __len__(self) -> int:
        return len(self.x)


def size(level: int) -> int:
    """Pieces of a triangle down to a level, itself included."""
    return int((CHILDREN ** (level + 1) - 1) // (CHILDREN - 1))


def corners(number: AnyArray, level: int, triangles: Float64) -> Float64:
    """The corners of pieces of a level: float64 [n, 3, 3].

    number: which among those of all triangles, triangle · 4^level + path: int [n].
    triangles: float64 [triangles, 3, 3].
    """
    found = triangles[number >> (2 * level)]
    for depth in range(level - 1, -1, -1):
        child = (number >> (2 * depth)) & 3
        a, b, c = found[:, 0], found[:, 1], found[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        choices = np.stack(
            [
                np.stack([a, ab, ca], 1),
                np.stack([ab, b, bc], 1),
                np.stack([ca, bc, c], 1),
                np.stack([bc, ca, ab], 1),
            ]
        )
        found = choices[child, np.arange(len(child))]
    return np.asarray(found)


def solid_angles(triangles: Float64) -> Float64:
    """Solid angles of triangles [n, 3, 3] as seen from the origin (van Oosterom and Strackee
    1983): float64 [n]."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    # The edges, not the corners: the corners of a small triangle are nearly parallel
    triple = np.abs(np.einsum("ni,ni->n", a, np.cross(b - a, c - a)))
    ab, bc, ca = ((u * v).sum(axis=1) for u, v in ((a, b), (b, c), (c, a)))
    return np.asarray(2 * np.arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb))


def icosahedron() -> Float64:
    """Corners of its 20 faces on the unit sphere, turned outwards: float64 [20, 3, 3]."""
    golden = (1 + np.sqrt(5)) / 2
    points = np.array(
        [(0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
        + [(s, t * golden, 0) for s in (-1, 1) for t in (-1, 1)]
        + [(t * golden, 0, s) for s in (-1, 1) for t in (-1, 1)]
    )
    edge = 2.0
    near = np.abs(np.linalg.norm(points[:, None] - points[None], axis=2) - edge) < 1e-9
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    found = points[np.array(faces)] / np.linalg.norm(points[0])
    inwards = np.linalg.det(found) < 0
    found[inwards] = found[inwards][:, [0, 2, 1]]
    return np.asarray(found)
