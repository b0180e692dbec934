"""Solids from signed distances: blended into one another, then meshed by surface nets.

A field takes points as rows x, y, z, float32 [3, n], which NumPy goes through fastest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np

from burnish.core.types import AnyArray, Bool, Float32, Float64, Int32
from burnish.scene.examples.geometry import Mesh, Point

Field = Callable[[Float32], Float32]
"""Distances [n] of points [3, n], negative inside; steeper than 1 nowhere, about 1 near 0."""

_BLOCK = 6
_TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32)


def ball(centre: Point, radii: Point | float, turn: Float64 | None = None) -> Field:
    """An ellipsoid; turn: a rotation matrix of its axes."""
    middle, radius = _column(centre), _column(np.broadcast_to(radii, 3))

    def field(p: Float32) -> Float32:
        q = p - middle
        if turn is not None:
            q = turn.T.astype(np.float32) @ q
        q = q / radius
        length = np.sqrt(_dot(q, q))
        q = q / radius
        return np.asarray(length * (length - 1) / np.maximum(np.sqrt(_dot(q, q)), 1e-9))

    return field


def limb(points: Sequence[Sequence[float]] | Float64, radii: Sequence[float] | Float64) -> Field:
    """A chain of round cones through points [n, 3]."""
    chain, radius = np.asarray(points, np.float32), np.asarray(radii, np.float32)

    def field(p: Float32) -> Float32:
        result = np.full(p.shape[1], np.inf, np.float32)
        for a, b, ra, rb in zip(chain[:-1], chain[1:], radius[:-1], radius[1:], strict=True):
            q, h = _from_edge(p, a, b)
            np.minimum(result, np.sqrt(_dot(q, q)) - (ra + h * (rb - ra)), out=result)
        return result

    return field


def sheet(corners: Sequence[Point], thickness: float) -> Field:
    """A triangle with a round edge."""
    a, b, c = (np.asarray(corner, np.float32) for corner in corners)
    normal = np.cross(b - a, c - a)

    def field(p: Float32) -> Float32:
        within = np.full(p.shape[1], True)
        nearest = np.full(p.shape[1], np.inf, np.float32)
        for start, end in ((a, b), (b, c), (c, a)):
            within &= _dot(p - _column(start), np.cross(normal, end - start)) >= 0
            q, _ = _from_edge(p, start, end)
            np.minimum(nearest, _dot(q, q), out=nearest)
        height = _dot(p - _column(a), normal) ** 2 / (normal @ normal)
        return np.asarray(np.sqrt(np.where(within, height, nearest)) - thickness)

    return field


def mirrored(field: Field) -> Field:
    """The half y ≥ 0 of a solid, on both sides."""
    return lambda p: field(np.stack([p[0], np.abs(p[1]), p[2]]))


def placed(field: Field, offset: Point, turn: Float64) -> Field:
    """A solid turned about the origin by a rotation matrix, then shifted."""
    back = turn.T.astype(np.float32)
    return lambda p: field(back @ (p - _column(offset)))


def blended(fields: Sequence[Field], width: float) -> Field:
    """The union, with fillets about as wide as `width` (Quílez's polynomial minimum)."""

    def smooth(a: Float32, b: Float32) -> Float32:
        h = np.maximum(width - np.abs(a - b), 0.0)
        return np.asarray(np.minimum(a, b) - h * h * np.float32(0.25 / width))

    return lambda p: reduce(smooth, (field(p) for field in fields))


def carved(solid: Field, tool: Field, width: float) -> Field:
    """A solid without a tool, with round edges."""
    inverse = blended([lambda p: -solid(p), tool], width)
    return lambda p: -inverse(p)


def meshed(field: Field, low: Point, high: Point, cell: float) -> Mesh:
    """The zero set inside a box, by naive surface nets (Gibson 1998) drawn onto it by Newton.

    Closed where the solid lies inside the box. uv: x and z.
    """
    origin = _column(low)
    blocks = np.ceil((np.asarray(high) - np.asarray(low)) / (cell * _BLOCK)).astype(int)
    values = _sampled(field, origin, blocks, cell)
    inside = values < 0
    corners = np.stack(np.meshgrid(*[[0, 1]] * 3, indexing="ij"), -1).reshape(-1, 3)
    cells = tuple(n - 1 for n in values.shape)
    count = np.zeros(cells, np.int8)
    for corner in corners:
        count += inside[tuple(slice(a, a + n) for a, n in zip(corner, cells, strict=True))]
    active = (count > 0) & (count < 8)
    index = np.argwhere(active)
    # Each vertex: the mean of where its cell's edges cross the surface
    total, crossings = np.zeros((len(index), 3), np.float32), np.zeros((len(index), 1), np.float32)
    for axis in range(3):
        for start in corners[corners[:, axis] == 0]:
            a, b = index + start, index + start + np.eye(3, dtype=int)[axis]
            va, vb = values[tuple(a.T)], values[tuple(b.T)]
            cut = (va < 0) != (vb < 0)
            t = np.where(cut, va / np.where(cut, va - vb, 1.0), 0.0)[:, None]
            total += cut[:, None] * (a + t * (b - a))
            crossings += cut[:, None]
    points = origin + cell * (total / crossings).T
    for _ in range(2):
        distance, normals = _expanded(field, points, cell / 32)
        points = points - np.clip(distance, -cell, cell) * normals
    _, normals = _expanded(field, points, cell / 32)
    number = np.full(cells, -1, np.int32)
    number[active] = np.arange(len(index))
    positions = points.T.astype(np.float64)
    return Mesh(positions, normals.T.astype(np.float64), positions[:, ::2], _faces(inside, number))


def _sampled(field: Field, origin: Float32, blocks: AnyArray, cell: float) -> Float32:
    """Values on the lattice, exact only in the blocks that the surface may cross."""
    size = cell * _BLOCK
    middles = np.stack(np.meshgrid(*map(np.arange, blocks), indexing="ij")) + np.float32(0.5)
    coarse = field((origin + size * middles.reshape(3, -1)).astype(np.float32))
    values = coarse.reshape(tuple(blocks))
    near = np.argwhere(np.abs(values) < 1.2 * size)
    for axis in range(3):
        values = np.repeat(values, _BLOCK, axis)
    lattice = np.stack(np.meshgrid(*[np.arange(_BLOCK)] * 3, indexing="ij"), -1).reshape(-1, 3)
    where = (near[:, None] * _BLOCK + lattice).reshape(-1, 3)
    values[tuple(where.T)] = field((origin + cell * where.T).astype(np.float32))
    return np.asarray(values, np.float32)


def _expanded(field: Field, points: Float32, step: float) -> tuple[Float32, Float32]:
    """Distance [n] and direction of its gradient [3, n], from four points around each."""
    gradient, mean = np.zeros_like(points), np.zeros(points.shape[1], np.float32)
    for corner in _TETRAHEDRON:
        value = field(points + step * _column(corner))
        mean += value / 4
        gradient += _column(corner) * value
    gradient /= np.maximum(np.sqrt(_dot(gradient, gradient)), 1e-30)
    return mean, gradient


def _faces(inside: Bool, number: Int32) -> Int32:
    """Two triangles around every lattice edge that crosses the surface, facing outwards."""
    faces = []
    unit = np.eye(3, dtype=int)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        first = inside.take(range(inside.shape[axis] - 1), axis)
        edge = np.argwhere(first != inside.take(range(1, inside.shape[axis]), axis))
        edge = edge[np.all(edge[:, [u, v]] > 0, axis=1)]
        outward = first[tuple(edge.T)]
        around = (unit[u] + unit[v], unit[v], 0 * unit[u], unit[u])
        quad = np.stack([number[tuple((edge - shift).T)] for shift in around], -1)
        quad[~outward] = quad[~outward][:, ::-1]
        faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return np.concatenate(faces)


def _from_edge(p: Float32, a: Float32, b: Float32) -> tuple[Float32, Float32]:
    """From the nearest point of an edge to p [3, n], and where on the edge it lies, 0 to 1."""
    along = b - a
    q = p - _column(a)
    h = np.clip(_dot(q, along) / (along @ along), 0.0, 1.0)
    return np.asarray(q - _column(along) * h), np.asarray(h, np.float32)


def _column(vector: AnyArray | Sequence[float]) -> Float32:
    return np.asarray(vector, np.float32).reshape(3, 1)


def _dot(p: Float32, q: Float32) -> Float32:
    return np.asarray(p[0] * q[0] + p[1] * q[1] + p[2] * q[2])
