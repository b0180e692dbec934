"""Where the lights of a scene stand, and putting them elsewhere.

A placement is what differs from the scene, by parameter (`materials.placement`). It moves a
light by one change of the world: about a lamp's or a spot's own place p, with R the least
rotation that takes its direction to the new one and s its size,

    A = T(p') R s T(-p),        to_world' = A · to_world.

Surroundings turn about their own up axis u, that of the picture's poles: to_world' =
to_world · R_u(θ). The same transform goes into a scene's description, of which a fresh scene
is built, or into a built one, where no kernel is compiled anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.types import Float64, Value
from burnish.scene.tree import Tree

Placement = Mapping[str, Value]

_UP = {"envmap": 1, "sunsky": 2, "timed_sunsky": 2}
"""The up axis of what surrounds the scene, in its own coordinates."""

_FACING = 0.5
"""How much of a mesh must face one way for it to have a direction: ‖Σ a n‖ / Σ a."""


def emitter_values(emitter: Any, kind: str) -> dict[str, Value]:
    """Where a light without a surface stands and aims (mi.Emitter), by parameter."""
    known = mi.traverse(emitter)
    if kind == "point":
        return {"position": _triple(known["position"])}
    if "to_world" not in known:
        return {}
    matrix = _matrix(known["to_world"])
    found: dict[str, Value] = {
        "position": _triple(matrix[:3, 3]),
        "direction": _unit(matrix[:3, 2]),
    }
    for name in ("cutoff_angle", "beam_width"):
        if name in known:
            found[name] = float(np.ravel(known[name])[0])
    return found


def can_move(shape: Any) -> bool:
    """Whether a built shape (mi.Shape) can be put elsewhere."""
    return isinstance(shape, mi.Mesh) or "to_world" in mi.traverse(shape)


def lamp_values(shapes: Sequence[Any]) -> dict[str, Value]:
    """The middle of the shapes of a lamp (mi.Shape), and the way that they face, if one."""
    low = np.min([np.ravel(shape.bbox().min) for shape in shapes], axis=0)
    high = np.max([np.ravel(shape.bbox().max) for shape in shapes], axis=0)
    found: dict[str, Value] = {"position": _triple((low + high) / 2)}
    areas, total = np.zeros(3), 0.0
    for shape in shapes:
        normals = _area_normals(shape)
        areas += normals.sum(axis=0)
        total += np.linalg.norm(normals, axis=1).sum()
    if np.linalg.norm(areas) > _FACING * total:
        found["direction"] = _unit(areas)
    return found


def _area_normals(shape: Any) -> Float64:
    """Outward normals by area, [n, 3]: of every triangle, or of the whole of a flat shape."""
    if isinstance(shape, mi.Mesh):
        points = np.reshape(shape.vertex_positions_buffer(), (-1, 3)).astype(np.float64)
        faces = np.reshape(shape.faces_buffer(), (-1, 3))
        a, b, c = (points[faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        if shape.has_vertex_normals():
            # Light leaves on the side of the shading normals, whatever the winding says
            given = np.reshape(shape.vertex_normals_buffer(), (-1, 3))[faces].sum(axis=1)
            normals *= np.where((normals * given).sum(axis=1) < 0, -1.0, 1.0)[:, None]
        elif shape.has_flipped_normals():
            normals = -normals
        return normals
    known = mi.traverse(shape)
    flat = [int(kind) for kind in (mi.ShapeType.Rectangle, mi.ShapeType.Disk)]
    if int(shape.shape_type()) not in flat:
        # Round ones send light to all sides
        return np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    linear = _matrix(known["to_world"])[:3, :3]
    normal = np.linalg.inv(linear).T[:, 2] * abs(np.linalg.det(linear))
    return (-normal if shape.has_flipped_normals() else normal)[None]


def world_change(values: Placement, changed: Placement) -> Float64:
    """The A of a light that stands at `values` and is to stand at `changed`: [4, 4]."""
    start = np.array(values.get("position", (0.0, 0.0, 0.0)), np.float64)
    end = np.array(changed.get("position", start), np.float64)
    result = np.eye(4)
    if "direction" in changed:
        result[:3, :3] = least_rotation(
            np.array(values["direction"], np.float64), np.array(changed["direction"], np.float64)
        )
    result[:3, :3] *= float(changed.get("size", 1.0))  # type: ignore[arg-type]
    result[:3, 3] = end - result[:3, :3] @ start
    return result


def least_rotation(a: Float64, b: Float64) -> Float64:
    """The rotation by the least angle that takes unit vector a to b: [3, 3]."""
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine > -1 + 1e-9:
        skew = np.cross(np.eye(3), axis)
        return np.asarray(np.eye(3) + skew + skew @ skew / (1 + cosine))
    # Straight back: half a turn about any axis that is square to it
    side = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    side /= np.linalg.norm(side)
    return np.asarray(2 * np.outer(side, side) - np.eye(3))


def turned(kind: str, matrix: Float64, changed: Placement) -> Float64:
    """The to_world of surroundings that are turned about their up axis: [4, 4]."""
    angle = np.radians(float(changed.get("rotation", 0.0)))  # type: ignore[arg-type]
    up = _UP[kind]
    # The two axes that the turn takes into each other, so that it is a right-handed one
    i, j = (up + 1) % 3, (up + 2) % 3
    turn = np.eye(4)
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[j, i], turn[i, j] = np.sin(angle), -np.sin(angle)
    return np.asarray(matrix @ turn)


def surrounds(kind: str) -> bool:
    """Whether a light of a kind is turned, and not moved."""
    return kind in _UP


def place_emitter(tree: Tree, node: int, values: Placement, changed: Placement) -> None:
    """Put a light that is no object elsewhere in a scene's description.

    node: the emitter's. values: where the scene has it.
    """
    kind, props = tree.plugin(node), tree.node(node).props
    before = _matrix(props["to_world"]) if "to_world" in props else np.eye(4)
    if kind in _UP:
        after = turned(kind, before, changed)
        if "sun_direction" in props:
            # It is given in the world
            sun = (after @ np.linalg.inv(before))[:3, :3] @ np.ravel(props["sun_direction"])
            props["sun_direction"] = mi.ScalarVector3f(sun.tolist())
        if changed.get("file"):
            if "bitmap" in props:
                del props["bitmap"]
            props["filename"] = str(changed["file"])
    elif kind == "point":
        # Its place has two names
        if "position" in props:
            del props["position"]
        after = np.eye(4)
        after[:3, 3] = changed["position"]
    else:
        if "direction" in props:
            del props["direction"]
            before[:3, :3] = least_rotation(
                np.array([0.0, 0.0, 1.0]), np.array(values["direction"], np.float64)
            )
        after = world_change(values, changed) @ before
        for name, value in cone(values, changed).items():
            props[name] = value
    props["to_world"] = mi.ScalarTransform4f(after)


def place_shape(tree: Tree, node: int, values: Placement, changed: Placement) -> None:
    """Put a shape of a lamp elsewhere in a scene's description."""
    props = tree.node(node).props
    before = _matrix(props["to_world"]) if "to_world" in props else np.eye(4)
    props["to_world"] = mi.ScalarTransform4f(world_change(values, changed) @ before)


def cone(values: Placement, changed: Placement) -> dict[str, float]:
    """The angles of a spot's cone, if they change: the beam is never wider than all of it."""
    if not {"cutoff_angle", "beam_width"} & set(changed):
        return {}
    both = {**values, **changed}
    cutoff, beam = float(both["cutoff_angle"]), float(both["beam_width"])  # type: ignore[arg-type]
    return {"cutoff_angle": cutoff, "beam_width": min(beam, cutoff)}


def _matrix(transform: Any) -> Float64:
    """A transform of either kind as float64 [4, 4]."""
    return np.array(transform.matrix, np.float64).reshape(4, 4)


def _triple(point: Any) -> Value:
    # Single precision, which 7 digits tell: 2.78, not 2.7799999713897705
    x, y, z = (float(f"{float(number):.7g}") for number in np.ravel(point))
    return x, y, z


def _unit(vector: Any) -> Value:
    flat = np.ravel(vector).astype(np.float64)
    return _triple(flat / np.linalg.norm(flat))
