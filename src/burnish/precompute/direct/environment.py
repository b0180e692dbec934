"""The environment as triangles: large where it is dim, small where light comes from.

The faces of an icosahedron are split into four, and again, by the metric of structured
importance sampling (Agarwal et al. 2003, eq. 5; chosen by Ben-Artzi et al. 2006, section 5.2):
next is always the triangle with the largest

    Γ = E · min(Ω, Ω₀)^¼,

E its energy (radiance · solid angle) and Ω its solid angle. The quarter power is what the
variance of visibility over a small light grows with.

Triangles are flat inside a face, so their edges are great circles and pieces of any level tile
them. Below the triangles the radiance of their pieces is kept for a few levels more: where
narrow bins split a triangle, its pieces show what the map has there.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.errors import SceneError
from burnish.core.types import Float32, Float64, Int64
from burnish.precompute.direct.subdivision import (
    CHILDREN,
    corners,
    icosahedron,
    size,
    solid_angles,
)

REFERENCE_ANGLE = 0.01
"""Ω₀ in steradians, beyond which a larger triangle is no more important."""

DEEPEST = 8
"""Levels of the icosahedron's faces: pieces of a quarter of a degree, a texel of 1,440."""

POINTS_PER_PIECE = 16
MOST_RADIANCES = 2_000_000
PASS = 1 << 22


@dataclass(frozen=True)
class Triangles:
    """Triangle lights at infinity; m of them.

    corners: float64 [m, 3, 3], directions in world space, not of unit length. radiance: float32
    [m, pieces, 3], linear RGB, of each and of its pieces level by level, `levels` of them; the
    energies of four pieces sum to that of the one they are of. energy: float64 [3], of the map.
    repairs: what was changed of the map, for people.
    """

    corners: Float64
    radiance: Float32
    levels: int
    energy: Float64
    repairs: tuple[str, ...] = ()


def environment_triangles(emitter: Any, count: int) -> Triangles:
    """An environment emitter (`envmap` or `constant`) as about `count` triangles.

    Raises SceneError where the map has texels that are no numbers or infinite.
    """
    depth, points, repairs = 0, (64, 128), []
    data = _texels(emitter)
    if data is None:
        # An even environment: the triangles differ by their size alone
        while len(icosahedron()) * CHILDREN**depth < 4 * count:
            depth += 1
    else:
        _check(emitter, data)
        if (data < 0).any():
            repairs.append(
                f"environment: {int((data < 0).any(axis=2).sum())} texels of "
                f"{data.shape[0] * data.shape[1]} are negative (least {data.min():.3g}) and count "
                "as black"
            )
        # Texels lie on both poles
        height, width = data.shape[0] - 1, data.shape[1]
        texel = 2 * np.pi / width
        depth = min(DEEPEST, max(5, int(np.ceil(np.log2(1.1 / texel)))))
        pieces = len(icosahedron()) * CHILDREN**depth
        factor = int(np.ceil(np.sqrt(POINTS_PER_PIECE * pieces / (height * width))))
        points = (max(factor, 2) * height, max(factor, 2) * width)
    sums = _gather(emitter, depth, points) if data is not None else _even(emitter, depth)
    pyramid = [sums]
    while len(pyramid[0]) > len(icosahedron()):
        pyramid.insert(0, pyramid[0].reshape(-1, CHILDREN, 4).sum(axis=1))
    chosen = _choose(pyramid, count)
    return _triangles(pyramid, chosen, tuple(repairs))


def _texels(emitter: Any) -> Float32 | None:
    """The texels of an envmap: float32 [height, width, 3]; None for a constant environment."""
    parameters = mi.traverse(emitter)
    if "data" not in parameters:
        return None
    # Mitsuba keeps a column more at either side
    return np.asarray(np.array(parameters["data"])[:, 1:-1, :3], np.float32)


def _check(emitter: Any, data: Float32) -> None:
    wrong = ~np.isfinite(data).all(axis=2)
    if wrong.any():
        y, x = (int(k) for k in np.argwhere(wrong)[0])
        raise SceneError(
            f"emitter {emitter.id()!r}: {int(wrong.sum())} texels of its map are not finite "
            f"(the first at x {x}, y {y} is {data[y, x].tolist()}); an environment needs finite "
            "radiance: paint them over and load the scene again"
        )


def _even(emitter: Any, depth: int) -> Float64:
    """Energies of the pieces under a constant radiance: float64 [pieces, 4]."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0, 1)
    radiance = np.ravel(np.array(mi.Color3f(emitter.eval(si)), np.float64))[:3]
    faces = icosahedron()
    angle = solid_angles(corners(np.arange(len(faces) * CHILDREN**depth), depth, faces))
    return np.concatenate([angle[:, None] * radiance, angle[:, None]], axis=1)


def _gather(emitter: Any, depth: int, points: tuple[int, int]) -> Float64:
    """Energy and solid angle that fall into each piece of the finest level: float64 [pieces, 4].

    points: how many along θ and φ of the map; multiples of its texels, for which the sum over a
    bilinear map is its integral.
    """
    faces = icosahedron()
    total = len(faces) * CHILDREN**depth
    sums = dr.zeros(mi.Float, 4 * total)
    inverse = mi.Float(np.linalg.inv(faces.transpose(0, 2, 1)).astype(np.float32).ravel())
    to_world = mi.traverse(emitter)["to_world"]
    height, width = points
    for first in range(0, height * width, PASS):
        index = dr.arange(mi.UInt32, min(PASS, height * width - first)) + first
        row = index // width
        column = index - row * width
        phi = (mi.Float(column) + 0.5) * (2 * np.pi / width)
        theta = (mi.Float(row) + 0.5) * (np.pi / height)
        sin_theta, cos_theta = dr.sincos(theta)
        sin_phi, cos_phi = dr.sincos(phi)
        local = mi.Vector3f(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi)
        d = dr.normalize(mi.Vector3f(to_world @ local))
        # cos θ₀ - cos θ₁ of the row, exact also near the poles
        weight = sin_theta * (2 * np.sin(np.pi / (2 * height)) * 2 * np.pi / width)
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(index))
        si.wi = -d
        light = dr.maximum(mi.Color3f(emitter.eval(si)), 0) * weight
        cell = _piece_of(d, faces, inverse, depth)
        for k, value in enumerate((light.x, light.y, light.z, weight)):
            dr.scatter_add(sums, value, cell * 4 + k)
        dr.eval(sums)
    return np.array(sums).astype(np.float64).reshape(total, 4)


def _piece_of(d: Any, faces: Float64, inverse: Any, depth: int) -> Any:
    """The finest piece that a direction lies in."""
    centres = faces.mean(axis=1)
    face, best = mi.UInt32(0), mi.Float(-2)
    for number, centre in enumerate(centres):
        near = dr.dot(d, mi.Vector3f(*centre.tolist()))
        face = dr.select(near > best, mi.UInt32(number), face)
        best = dr.maximum(best, near)
    row = [dr.gather(mi.Vector3f, inverse, face * 3 + k) for k in range(3)]
    share = [dr.dot(item, d) for item in row]
    total = share[0] + share[1] + share[2]
    x, y = dr.maximum(share[1] / total, 0), dr.maximum(share[2] / total, 0)
    cell = face
    for _ in range(depth):
        x, y = 2 * x, 2 * y
        b, c = x >= 1, y >= 1
        middle = ~b & ~c & (x + y >= 1)
        child = dr.select(b, 1, dr.select(c, 2, dr.select(middle, 3, mi.UInt32(0))))
        x, y = dr.select(b, x - 1, x), dr.select(c & ~b, y - 1, y)
        x, y = dr.select(middle, 1 - x, x), dr.select(middle, 1 - y, y)
        cell = cell * 4 + child
    return cell


def _choose(pyramid: list[Float64], count: int) -> list[Int64]:
    """Which pieces of each level become lights: int64 arrays, one a level."""
    faces = icosahedron()
    importance: list[Float64] = []
    for level, sums in enumerate(pyramid):
        angle = solid_angles(corners(np.arange(len(sums)), level, faces)) if level < 3 else None
        size_of = sums[:, 3] if angle is None else angle
        energy = sums[:, :3].mean(axis=1)
        # A little for the dark, so that black parts are not left as whole faces
        energy = energy + 1e-3 * pyramid[0][:, :3].sum() / 3 * size_of / (4 * np.pi)
        importance.append(energy * np.minimum(size_of, REFERENCE_ANGLE) ** 0.25)
    heap = [(-float(value), 0, number) for number, value in enumerate(importance[0])]
    heapq.heapify(heap)
    done: list[tuple[int, int]] = []
    while heap and len(heap) + len(done) + CHILDREN - 1 <= count:
        _, level, number = heapq.heappop(heap)
        if level + 1 >= len(pyramid):
            done.append((level, number))
            continue
        for child in range(CHILDREN * number, CHILDREN * (number + 1)):
            heapq.heappush(heap, (-float(importance[level + 1][child]), level + 1, child))
    done += [(level, number) for _, level, number in heap]
    return [
        np.sort(np.array([number for at, number in done if at == level], np.int64))
        for level in range(len(pyramid))
    ]


def _triangles(pyramid: list[Float64], chosen: list[Int64], repairs: tuple[str, ...]) -> Triangles:
    """Corners and radiances of the chosen pieces."""
    faces = icosahedron()
    count = sum(map(len, chosen))
    levels = 0
    while levels < 6 and count * size(levels + 1) <= MOST_RADIANCES:
        levels += 1
    found, radiances = [], []
    for level, numbers in enumerate(chosen):
        if not len(numbers):
            continue
        shape = corners(numbers, level, faces)
        value = pyramid[level][numbers, :3] / solid_angles(shape)[:, None]
        parts = [value[:, None]]
        above = value
        for depth in range(1, levels + 1):
            ids = (numbers[:, None] * CHILDREN**depth + np.arange(CHILDREN**depth)).ravel()
            above = np.repeat(above, CHILDREN, axis=0)
            if level + depth < len(pyramid):
                above = _pieces_below(pyramid[level + depth][ids], above, ids, level + depth)
            parts.append(above.reshape(len(numbers), -1, 3))
        found.append(shape)
        radiances.append(np.concatenate(parts, axis=1).astype(np.float32))
    energy = pyramid[0][:, :3].sum(axis=0)
    return Triangles(np.concatenate(found), np.concatenate(radiances), levels, energy, repairs)


def _pieces_below(sums: Float64, above: Float64, ids: Int64, level: int) -> Float64:
    """Radiances of pieces, scaled so that four together have the energy of the one above.

    sums: [n, 4], of the pieces; above: [n, 3], the radiance of the one that each is of.
    """
    angle = solid_angles(corners(ids, level, icosahedron()))[:, None]
    value = np.where(sums[:, 3:] > 0, sums[:, :3] / np.maximum(sums[:, 3:], 1e-30), above)
    family = (-1, CHILDREN, 3)
    own = (value * angle).reshape(family).sum(axis=1)
    wanted = (above * angle).reshape(family).sum(axis=1)
    scale = np.divide(wanted, own, out=np.zeros_like(own), where=own > 0)
    scaled = (value.reshape(family) * scale[:, None]).reshape(-1, 3)
    lost = np.repeat((own <= 0) & (wanted > 0), CHILDREN, axis=0)
    return np.asarray(np.where(lost, above, scaled))
