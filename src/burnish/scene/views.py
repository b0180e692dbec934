"""Views: the cameras of a scene, one picture each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.errors import InvalidValue, SceneError
from burnish.scene.tree import Reference, Tree, UniqueNames


@dataclass(frozen=True)
class View:
    """A camera and its film.

    name: the sensor's id or name in the scene, else "view", "view_2", ….
    sensor: mi.Sensor. width, height: pixels of the film's crop window, which is the picture.
    """

    name: str
    sensor: Any
    width: int
    height: int

    @property
    def filter(self) -> Any:
        """The film's reconstruction filter: mi.ReconstructionFilter."""
        return self.sensor.film().rfilter()

    @property
    def pixels(self) -> int:
        return self.width * self.height


def prepare_sensors(tree: Tree, resolution: tuple[int, int] | None) -> list[str]:
    """Name the cameras and settle what does not change the picture.

    Films store linear RGB in float32 whatever the file asks for, and the sampler is Mitsuba's
    independent one, which takes any number of samples.
    resolution: width and height in pixels, to replace the films' own, crop window included.
    Returns the views' names, which become the sensors' ids. Raises SceneError without a camera.
    """
    names: list[str] = []
    unique = UniqueNames()
    for name, index in tree.children(0, mi.ObjectType.Sensor):
        wanted = tree.id(index) or ("view" if name.startswith("_arg_") else name)
        names.append(unique(wanted))
        tree.node(index).props.set_id(names[-1])
        _prepare(tree, index, resolution)
    if not names:
        raise SceneError(f"{tree.label}: the scene has no camera; add a <sensor>")
    return names


def _prepare(tree: Tree, index: int, resolution: tuple[int, int] | None) -> None:
    tree.remove_children(index, mi.ObjectType.Sampler)
    films = tree.children(index, mi.ObjectType.Film)
    if films:
        film = films[0][1]
    else:
        film = tree.add(mi.ObjectType.Film, "hdrfilm")
        tree.node(index).props["film"] = Reference(film)
    props = tree.node(film).props
    props["pixel_format"] = "rgb"
    props["component_format"] = "float32"
    if resolution is not None:
        for name in ("crop_width", "crop_height", "crop_offset_x", "crop_offset_y"):
            if name in props:
                del props[name]
        props["width"], props["height"] = checked_resolution(resolution)


def checked_resolution(resolution: tuple[int, int]) -> tuple[int, int]:
    """Width and height as two whole numbers from 1 to 65536. Raises InvalidValue."""
    try:
        width, height = (int(number) for number in resolution)
    except (TypeError, ValueError):
        raise InvalidValue(
            f"resolution must be two whole numbers, width and height; got {resolution!r}"
        ) from None
    if not (1 <= width <= 65536 and 1 <= height <= 65536):
        raise InvalidValue(f"resolution must lie in [1, 65536] pixels; got {width} x {height}")
    return width, height


def views_of(mi_scene: Any, names: list[str]) -> tuple[View, ...]:
    """The views of a built scene, in the order of their names."""
    sensors = {sensor.id(): sensor for sensor in mi_scene.sensors()}
    views = []
    for name in names:
        width, height = sensors[name].film().crop_size()
        views.append(View(name, sensors[name], int(width), int(height)))
    return tuple(views)


def projection(view: View) -> tuple[float, ...]:
    """The matrix [3, 4], row by row, from places of the world (x, y, z, 1) to
    (d · column, d · row, d): pixels from the upper left corner, and the depth d.

    Empty for a camera whose rays do not all leave from one place through a plane.
    """
    known = mi.traverse(view.sensor)
    if "to_world" not in known:
        return ()
    to_world = np.array(known["to_world"].matrix, np.float64).reshape(4, 4)
    eye, forward = to_world[:3, 3], to_world[:3, 2]
    corners = []
    for position in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)):
        ray, _ = view.sensor.sample_ray(
            mi.Float(0.0), mi.Float(0.5), mi.Point2f(position), mi.Point2f(0.5)
        )
        origin, direction = (np.ravel(item).astype(np.float64) for item in (ray.o, ray.d))
        if np.linalg.norm(np.cross(origin - eye, direction)) > 1e-4 * np.linalg.norm(origin - eye):
            return ()
        corners.append(direction / (direction @ forward))
    first, right, down = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    plane = np.stack([right, down, first], axis=1)
    flat = np.allclose(corners[3], first + right + down, atol=1e-4)
    if not flat or abs(np.linalg.det(plane)) < 1e-9:
        return ()
    inverse = np.diag([view.width, view.height, 1.0]) @ np.linalg.inv(plane)
    matrix = np.concatenate([inverse, -(inverse @ eye)[:, None]], axis=1)
    return tuple(float(number) for number in matrix.ravel())
