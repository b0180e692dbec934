"""The lights of a scene for direct light: triangles where they have an area, strata elsewhere.

- `envmap` and `constant` become spherical triangles (`environment`);
- lamps with an even radiance that are meshes or rectangles become their own triangles, split;
- everything else (points, spots, other shapes, textured lamps, sun and sky) is sampled by
  Mitsuba in strata of its own square of random numbers, one direction each; one stratum for a
  point, a spot or a directional light.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import AnyArray, Float32, Float64
from burnish.precompute.direct.environment import Triangles, environment_triangles
from burnish.precompute.direct.subdivision import CHILDREN, Pieces, corners, size
from burnish.precompute.lights import EmitterGroups
from burnish.scene import Scene
from burnish.transport.basis import Basis

FEWEST, MOST = 100, 100_000
LAMP_SHARE = 16
"""A lamp gets one triangle for so many of the environment's, or one for each of its faces."""

DEEPEST = 8
"""Levels that a triangle can be split in at a row."""


@dataclass(frozen=True)
class Lights:
    """All lights of a scene, on the host.

    corners: float64 [m, 3, 3]; directions where `local` (bool [m]) is false, else places in
    world space whose right-handed normal is the lit side. start: int64 [m], first of a light's
    entries of radiance, float32 [n, 3]; levels: down to which pieces have entries of their own,
    0 for a local light. group: int64 [m], light group. strata: of the sampled emitters.
    repairs: what was changed, for people.
    """

    corners: Float64
    local: AnyArray
    start: AnyArray
    radiance: Float32
    levels: int
    group: AnyArray
    strata: tuple[Stratum, ...]
    repairs: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.corners) + len(self.strata)


@dataclass(frozen=True)
class Stratum:
    """A part of an emitter's square of random numbers. emitter: its place in the scene."""

    emitter: int
    u: float
    v: float
    side: float
    share: float
    group: int


def find_lights(scene: Scene, basis: Basis, count: int) -> Lights:
    """The lights of a scene, `count` triangles for its environment.

    Raises InvalidValue for a count outside 100 to 100,000, SceneError for an environment whose
    texels are no numbers.
    """
    if not FEWEST <= count <= MOST:
        raise InvalidValue(
            f"triangles must lie in [{FEWEST}, {MOST:,}]: 400 for a preview, 4,000 as a rule; "
            f"got {count}"
        )
    group_of = EmitterGroups(scene, basis)
    emitters = scene.mi_scene.emitters()
    shapes: list[Float64] = []
    radiances: list[Float32] = []
    groups: list[AnyArray] = []
    strata: list[Stratum] = []
    local: list[AnyArray] = []
    background: Triangles | None = None
    for number, emitter in enumerate(emitters):
        group = int(group_of.of(mi.EmitterPtr(emitter), True)[0])
        if emitter.is_environment() and _is_map(emitter):
            background = environment_triangles(emitter, count)
            found, lit = background.corners, background.radiance
            local.append(np.zeros(len(found), np.bool_))
        else:
            faces = _faces(scene, emitter, max(count // LAMP_SHARE, 16))
            if faces is None:
                strata += _strata(emitter, number, max(count // LAMP_SHARE, 16), group)
                continue
            found = faces
            lit = np.broadcast_to(_even_radiance(emitter), (len(found), 1, 3))
            local.append(np.ones(len(found), np.bool_))
        shapes.append(found)
        radiances.append(lit)
        groups.append(np.full(len(found), group))
    entries = [part.shape[1] for part in radiances for _ in range(len(part))]
    return Lights(
        np.concatenate(shapes) if shapes else np.zeros((0, 3, 3)),
        np.concatenate(local) if local else np.zeros(0, np.bool_),
        np.cumsum([0, *entries], dtype=np.int64)[:-1],
        np.concatenate([part.reshape(-1, 3) for part in radiances]).astype(np.float32)
        if radiances
        else np.zeros((0, 3), np.float32),
        background.levels if background else 0,
        np.concatenate(groups) if groups else np.zeros(0, np.int64),
        tuple(strata),
        background.repairs if background else (),
    )


def _is_map(emitter: Any) -> bool:
    """Whether an environment is a map or even, not a model of the sky."""
    return "data" in mi.traverse(emitter) or emitter.class_name() == "ConstantBackgroundEmitter"


def _even_radiance(emitter: Any) -> Float32:
    """Of a lamp that shines alike everywhere: float32 [3]."""
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0, 1)
    return np.asarray(np.ravel(np.array(mi.Color3f(emitter.eval(si))))[:3], np.float32)


def _faces(scene: Scene, emitter: Any, count: int) -> Float64 | None:
    """A lamp as triangles, lit on the side of their right-handed normal: float64 [n, 3, 3].

    None for what is no mesh or rectangle of even radiance, or has more faces than `count`.
    """
    shape = emitter.get_shape()
    uneven = mi.has_flag(emitter.flags(), mi.EmitterFlags.SpatiallyVarying)
    if shape is None or uneven or emitter.class_name() != "AreaLight":
        return None
    if shape.class_name() == "Rectangle":
        plane = mi.Point3f([-1, 1, 1, -1], [-1, -1, 1, 1], 0)
        places = np.array(mi.traverse(shape)["to_world"] @ plane, np.float64).T
        found = places[np.array([[0, 1, 2], [0, 2, 3]])]
    elif shape.is_mesh():
        parameters = mi.traverse(shape)
        points = np.array(parameters["vertex_positions"], np.float64).reshape(-1, 3)
        found = points[np.array(parameters["faces"]).reshape(-1, 3)]
    else:
        return None
    if len(found) > count:
        return None
    # Faces of no area shine on nothing
    found = found[np.linalg.norm(_normals(found), axis=1) > 0]
    if not len(found):
        return found
    turned = ~_lit_side(scene, found)
    found[turned] = found[turned][:, [0, 2, 1]]
    # Split the largest until there are enough
    level = 0
    while len(found) * CHILDREN ** (level + 1) <= count:
        level += 1
    return corners(np.arange(len(found) * CHILDREN**level), level, found)


def _lit_side(scene: Scene, faces: Float64) -> AnyArray:
    """Whether faces shine towards their right-handed normals: bool [n]."""
    normal = _normals(faces)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= length
    start = mi.Point3f((faces.mean(axis=1) + 1e-3 * np.sqrt(length) * normal).T.astype(np.float32))
    ray = mi.Ray3f(start, mi.Vector3f(-normal.T))
    si = scene.mi_scene.ray_intersect(ray)
    emitter = si.emitter(scene.mi_scene)
    light = dr.select(emitter != None, mi.Color3f(emitter.eval(si)), 0)  # noqa: E711 (per lane)
    return np.asarray(np.array(dr.max(light)) > 0)


def _normals(faces: Float64) -> Float64:
    """Right-handed normals, as long as twice the faces' areas: float64 [n, 3]."""
    return np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])


def _strata(emitter: Any, number: int, count: int, group: int) -> list[Stratum]:
    flags = emitter.flags()
    delta = mi.has_flag(flags, mi.EmitterFlags.DeltaPosition)
    delta |= mi.has_flag(flags, mi.EmitterFlags.DeltaDirection)
    if emitter.is_environment():
        count *= LAMP_SHARE
    side = 1 if delta else int(np.sqrt(count))
    return [
        Stratum(number, i / side, j / side, 1 / side, 1 / side**2, group)
        for i in range(side)
        for j in range(side)
    ]


class LightTables:
    """The lights as arrays of the device, opaque, so that their number is data, not code."""

    def __init__(self, lights: Lights) -> None:
        m = len(lights.corners)
        a, b, c = lights.corners[:, 0], lights.corners[:, 1], lights.corners[:, 2]
        packed = np.concatenate(
            [
                *(a, lights.start[:, None]),
                *(b - a, lights.local[:, None]),
                *(c - a, lights.group[:, None]),
            ],
            axis=1,
        )
        pieces = Pieces.down_to(DEEPEST)
        # A piece that goes deeper than the radiances has that of the last one above it
        depth = np.minimum(pieces.level, lights.levels)
        first = np.array([0, *(size(level) for level in range(DEEPEST))])
        entry = first[depth] + (pieces.number >> (2 * (pieces.level - depth)))
        below = np.array([size(DEEPEST - level) for level in range(DEEPEST + 1)])
        tree = np.stack(
            [pieces.x, pieces.y, pieces.sign * 0.5**pieces.level, below[pieces.level]], axis=1
        )
        self.count = dr.opaque(mi.UInt32, m)
        self.pieces = dr.opaque(mi.UInt32, len(pieces))
        self.triangles = _floats(packed)
        self.tree = _floats(tree)
        self.entry = _whole(entry)
        self.radiance = _floats(lights.radiance)
        self.caps = _floats(_caps(lights))
        s = lights.strata
        self.strata = dr.opaque(mi.UInt32, len(s))
        self.strata_emitter = _whole(np.array([item.emitter for item in s] or [0]))
        self.strata_group = _whole(np.array([item.group for item in s] or [0]))
        self.strata_square = _floats(
            np.array([[item.u, item.v, item.side, item.share] for item in s] or [[0.0] * 4])
        )
        self.any_triangles, self.any_strata = m > 0, len(s) > 0


def _caps(lights: Lights) -> Float64:
    """Around each triangle at infinity the centre of a cap that holds it and the cosine of its
    radius, -1 for what is at hand: float64 [m, 4]."""
    # A place can be the origin
    length = np.linalg.norm(lights.corners, axis=2, keepdims=True)
    unit = lights.corners / np.maximum(length, 1e-30)
    centre = unit.mean(axis=1)
    centre /= np.maximum(np.linalg.norm(centre, axis=1, keepdims=True), 1e-30)
    # A little more, for rounding
    cosine = np.einsum("mci,mi->mc", unit, centre).min(axis=1, initial=1.0) - 1e-6
    return np.concatenate([centre, np.where(lights.local, -1.0, cosine)[:, None]], axis=1)


def _floats(values: AnyArray) -> Any:
    array = mi.Float(np.ascontiguousarray(values, np.float32).ravel())
    dr.make_opaque(array)
    return array


def _whole(values: AnyArray) -> Any:
    array = mi.UInt32(np.ascontiguousarray(values).astype(np.uint32).ravel())
    dr.make_opaque(array)
    return array
