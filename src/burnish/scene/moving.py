"""Moving the lights of a built scene, as `placing` says: no file is read and nothing compiled.

What was traced before a move is of the lights as they stood. Whoever else traces the same
mi.Scene has to put them back first.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.errors import SceneError
from burnish.core.types import AnyArray, Float64
from burnish.scene.lights import SceneLight
from burnish.scene.placing import Placement, cone, surrounds, turned, world_change

if TYPE_CHECKING:
    from burnish.scene.loading import Scene


class LightMover:
    """Puts the lights of a scene elsewhere, in place, and back."""

    def __init__(self, scene: Scene) -> None:
        self._parameters = mi.traverse(scene.mi_scene)
        self._scene = scene.mi_scene
        self._lights = {light.name: light for light in scene.lights if light.parameters}
        keys = _keys(self._parameters)
        self._shapes = {
            light.name: [keys["shape", scene.tree.id(node)] for node in light.shapes]
            for light in self._lights.values()
        }
        self._emitters = {
            name: keys["emitter", name] for name in self._lights if ("emitter", name) in keys
        }
        self._own: dict[str, AnyArray] = {}
        self._placed: dict[str, Placement] = {}
        # The first move, too, is to find its kernels made
        for shape in (shape for shapes in self._shapes.values() for shape in shapes):
            if f"{shape}.to_world" in self._parameters:
                self._transform(shape, self._matrix(shape))
        self._parameters.update()

    def place(self, placed: Mapping[str, Placement]) -> bool:
        """Put the named lights as in `placed`, and the others as the scene has them.

        Gives whether any light stands otherwise than before. Raises SceneError for a file
        that is no picture; the lights stand then as before.
        """
        wanted: dict[str, Placement] = {
            name: dict(placement) for name, placement in placed.items() if placement
        }
        if wanted == self._placed:
            return False
        files = {
            name: _picture(placement["file"])
            for name, placement in wanted.items()
            if placement.get("file") and placement["file"] != self._file(name)
        }
        for name in {**self._placed, **wanted}:
            light, placement = self._lights[name], wanted.get(name, {})
            if self._shapes[name]:
                self._place_shapes(light, placement)
            else:
                self._place_emitter(light, placement, files.get(name))
        self._parameters.update()
        for emitter in self._scene.emitters():
            # Those that shine from afar know how far the scene reaches
            emitter.set_scene(self._scene)
        self._placed = wanted
        return True

    def _file(self, name: str) -> object:
        return self._placed.get(name, {}).get("file", "")

    def _place_shapes(self, light: SceneLight, placement: Placement) -> None:
        change = world_change(_values(light), placement)
        for shape in self._shapes[light.name]:
            if f"{shape}.vertex_positions" not in self._parameters:
                self._transform(shape, change @ self._matrix(shape))
                continue
            points = self._original(f"{shape}.vertex_positions").reshape(-1, 3)
            moved = points @ change[:3, :3].T + change[:3, 3]
            normals = self._original(f"{shape}.vertex_normals").reshape(-1, 3)
            self._parameters[f"{shape}.vertex_positions"] = mi.Float(np.ravel(moved))
            self._parameters.update()
            if len(normals):
                # Mitsuba makes smooth ones of its own when a mesh changes
                turned_normals = normals @ np.linalg.inv(change[:3, :3])
                length = np.linalg.norm(turned_normals, axis=1, keepdims=True)
                turned_normals = turned_normals / np.maximum(length, 1e-12)
                self._parameters[f"{shape}.vertex_normals"] = mi.Float(np.ravel(turned_normals))

    def _place_emitter(self, light: SceneLight, placement: Placement, picture: Any) -> None:
        name, values = self._emitters[light.name], _values(light)
        if light.kind == "point":
            position = placement.get("position", values["position"])
            self._parameters[f"{name}.position"] = mi.Point3f(*map(float, position))
            return
        if surrounds(light.kind):
            self._transform(name, turned(light.kind, self._matrix(name), placement))
            if light.kind == "envmap":
                own = self._original(f"{name}.data")
                if picture is not None:
                    self._parameters[f"{name}.data"] = picture
                elif not placement.get("file") and self._file(light.name):
                    self._parameters[f"{name}.data"] = mi.TensorXf(own)
            return
        self._transform(name, world_change(values, placement) @ self._matrix(name))
        for angle in ("cutoff_angle", "beam_width"):
            if angle in values:
                number = cone(values, placement).get(angle, values[angle])
                self._parameters[f"{name}.{angle}"] = mi.Float(number)

    def _original(self, key: str) -> AnyArray:
        """A parameter as the scene has it."""
        if key not in self._own:
            self._own[key] = np.array(self._parameters[key])
        return self._own[key]

    def _matrix(self, name: str) -> Float64:
        key = f"{name}.to_world"
        if key not in self._own:
            matrix = np.array(self._parameters[key].matrix, np.float64)
            self._own[key] = matrix.reshape(4, 4)
        return np.asarray(self._own[key], np.float64)

    def _transform(self, name: str, matrix: Float64) -> None:
        key = f"{name}.to_world"
        kind = type(self._parameters[key])
        value = kind(mi.ScalarTransform4f(matrix).matrix)
        # A number that is known when a kernel is made would make another kernel
        dr.make_opaque(value)
        self._parameters[key] = value


def _keys(parameters: Any) -> dict[tuple[str, str], str]:
    """What the keys of shapes and of emitters begin with, by their ids. A shape may be named as
    its material is, and its keys then otherwise."""
    found = {}
    for key, (_, _, node, _) in parameters.properties.items():
        start, _, name = key.rpartition(".")
        if name in ("position", "to_world", "vertex_positions"):
            for kind, of in (("shape", mi.Shape), ("emitter", mi.Emitter)):
                if isinstance(node, of):
                    found[kind, node.id()] = start
    return found


def _values(light: SceneLight) -> dict[str, Any]:
    return {item.name: item.default for item in light.parameters}


def _picture(file: object) -> Any:
    """The data of an environment map (mi.TensorXf). Raises SceneError."""
    try:
        fresh = mi.load_dict({"type": "envmap", "filename": str(file)})
    except Exception as error:
        words = " ".join(str(error).split())
        raise SceneError(
            f"{file}: cannot be read as an environment map ({words}); give a picture by latitude "
            "and longitude"
        ) from error
    return mi.traverse(fresh)["data"]
