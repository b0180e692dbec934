"""One triangle of light over a plane, gathered for many view directions at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float64
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import Maths, Vector, numpy_maths
from burnish.materials.model import Fixed, Model, Values
from burnish.precompute.direct.gather import Mirror, ObjectLight
from burnish.precompute.direct.lights import Lights, LightTables
from burnish.precompute.direct.subdivision import corners, solid_angles
from burnish.precompute.symbolic import SymbolicMaterials
from burnish.precompute.tracer import CELL, Tracer
from burnish.transport.basis import Basis, EditableObject
from tests.reference.worlds import SKY, camera, plane, world


@dataclass(frozen=True)
class Counting(Model):
    """A model's coordinate with the quotient 1 / cosθi: gathered light is solid angle."""

    inner: Model
    parameters = ()
    name = "counting"

    @property
    def fixed_parameters(self) -> Any:  # type: ignore[override]
        return self.inner.fixed_parameters

    @property
    def coordinate_name(self) -> str:  # type: ignore[override]
        return self.inner.coordinate_name

    @property
    def coordinate_maximum(self) -> float:  # type: ignore[override]
        return self.inner.coordinate_maximum

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return self.inner.coordinate(xp, wi, wo, fixed)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return [1 / wi.z]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return np.ones((1, 3))

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Any) -> list[Any]:
        raise NotImplementedError


class Plane:
    """A horizontal plane of one layer, and what reaches it."""

    def __init__(self, model: Model, bins: int, fixed: Fixed | None = None) -> None:
        self.layer = Layer("layer", Counting(model), bins, fixed=dict(fixed or {}))
        material = Material((self.layer,), MaterialState({"layer": LayerState({})}))
        scene = world(
            {"floor": plane(size=2.0), "sky": SKY, "view": camera((0, -2, 2), (0, 0, 0))},
            {"floor": material},
            resolution=(4, 4),
        )
        basis = Basis((EditableObject("floor", material),), (bins,))
        self.tracer = Tracer(scene, scene.view(), SymbolicMaterials(scene, basis))
        self.bins = bins

    def shares(self, triangle: Float64, wo: Float64, smallest: float) -> Float64:
        """Of a triangle of directions [3, 3], the share in each bin for view directions
        [n, 3]: [n, bins]."""
        light = ObjectLight(self.tracer, 0, LightTables(one_light(triangle)))
        n = len(wo)
        target = dr.zeros(mi.Float, n * self.bins * CELL)
        dr.make_opaque(target)
        ones = mi.Float(np.ones(n, np.float32))
        mirror = Mirror(
            mi.Vector3f(np.tile([[0.0], [0.0], [1.0]], (1, n))),
            -ones,
            ones,
            ones,
            smallest * ones,
        )
        eye = mi.Point3f(np.ascontiguousarray(wo.T))
        way = mi.Vector3f(np.ascontiguousarray(-wo.T))
        offsets = mi.UInt32(np.arange(n, dtype=np.uint32) * self.bins)
        light.add(target, offsets, eye, way, mirror, 0, 1)
        found = np.array(target).reshape(n, self.bins, CELL)[..., 0]
        return found / solid_angles(triangle[None])[0]


def one_light(triangle: Float64) -> Lights:
    """An even triangle at infinity, of radiance 1."""
    return Lights(
        triangle[None],
        np.zeros(1, np.bool_),
        np.zeros(1, np.int64),
        np.ones((1, 3), np.float32),
        0,
        np.zeros(1, np.int64),
        (),
        (),
    )


def dense_shares(layer: Layer, triangle: Float64, wo: Float64, level: int) -> Float64:
    """The same for one view direction, from 4^level pieces that lie in one bin each: [bins]."""
    pieces = corners(np.arange(4**level), level, triangle[None])
    centre = pieces.mean(axis=1)
    centre /= np.linalg.norm(centre, axis=1, keepdims=True)
    fixed = {p.name: layer.fixed.get(p.name, p.default) for p in layer.model.fixed_parameters}
    t = layer.model.coordinate(numpy_maths, Vector(*centre.T), Vector(*wo), fixed)
    which = np.searchsorted(layer.edges, np.clip(t, 0, 1), side="right") - 1
    angle = solid_angles(pieces)
    counted = np.bincount(np.clip(which, 0, layer.bins - 1), angle, layer.bins)
    return np.asarray(counted / angle.sum())


def around(centre: Float64, radius: float, turn: float = 0.3) -> Float64:
    """A triangle of directions around a centre, with corners at an angle from it: [3, 3]."""
    centre = centre / np.linalg.norm(centre)
    side = np.cross(centre, [0.31, 0.95, 0.05])
    side /= np.linalg.norm(side)
    up = np.cross(centre, side)
    angles = turn + np.array([0.0, 2.1, 4.2])
    return np.stack(
        [
            np.cos(radius) * centre + np.sin(radius) * (np.cos(a) * side + np.sin(a) * up)
            for a in angles
        ]
    )
