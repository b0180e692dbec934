"""A scene with edited materials as Mitsuba 3 XML."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mitsuba as mi
import numpy as np

from burnish.app.export.closest import closest
from burnish.app.export.files import Folder, Textures
from burnish.app.export.report import Exported
from burnish.core.errors import InvalidValue
from burnish.materials.layer import MaterialState
from burnish.materials.lights import factors, placements, without_lights
from burnish.materials.registry import material_to_json, state_to_json
from burnish.reference.bsdf import MATERIAL_FORMAT, MATERIAL_VERSION, PLUGIN
from burnish.reference.truth import is_initial
from burnish.scene import Scene, SceneObject
from burnish.scene.tree import Reference, Tree, UniqueNames, names_file
from burnish.transport.basis import State

_TAGS = {
    mi.ObjectType.Scene: "scene",
    mi.ObjectType.Sensor: "sensor",
    mi.ObjectType.Film: "film",
    mi.ObjectType.Emitter: "emitter",
    mi.ObjectType.Sampler: "sampler",
    mi.ObjectType.Shape: "shape",
    mi.ObjectType.Texture: "texture",
    mi.ObjectType.Volume: "volume",
    mi.ObjectType.Medium: "medium",
    mi.ObjectType.BSDF: "bsdf",
    mi.ObjectType.Integrator: "integrator",
    mi.ObjectType.PhaseFunction: "phase",
    mi.ObjectType.ReconstructionFilter: "rfilter",
}
_BSDFS = ("diffuse", "conductor", "roughconductor", "plastic", "roughplastic", "principled")
_WRAPPERS = ("twosided", "mask", "bumpmap", "normalmap", "blendbsdf", PLUGIN)


def write_xml(scene: Scene, state: State, path: Path, plugin: bool = False) -> Exported:
    """Write a scene that stock Mitsuba renders, and the files that it names beside it.

    plugin: let materials that no stock plugin holds name burnish's own instead of the closest
    stock one. Raises InvalidValue for a scene with ready-made Mitsuba objects.
    """
    result, folder = Exported(), Folder(path)
    edited: dict[int, tuple[str, Mapping[str, Any]]] = {}
    for object_id, own in without_lights(state).items():
        item = scene.object(object_id)
        if is_initial(item, own):
            continue
        described = _material(item, own, folder, plugin, result)
        for node in scene.drafts[scene.objects.index(item)].shapes:
            edited[node] = (object_id, described)
    with tempfile.TemporaryDirectory(prefix="burnish-") as pictures:
        # What the mix of the lights makes of their images is copied with all other files
        mixed, placed = factors(scene.lights, state), placements(scene.lights, state)
        tree = scene.with_lights(mixed, Path(pictures), placed)
        document = _Writer(tree, folder, edited).scene()
    path.write_text(ElementTree.tostring(document, encoding="unicode") + "\n", "utf-8")
    result.files += [path, *folder.written]
    return result


def _material(
    item: SceneObject, state: MaterialState, folder: Folder, plugin: bool, result: Exported
) -> Mapping[str, Any]:
    """The description of an edited material; what it loses goes into the report."""
    assert item.material is not None
    maps = {group: dict(found.description) for group, found in item.maps.items()}
    textures = Textures(folder, item.id, maps)
    stock = closest(item, state, textures)
    if stock.difference is None:
        return dict(textures.stock(stock.description))
    place = folder.place(f"{item.id}.json")
    material = item.material.as_in(state)
    place.write_text(
        json.dumps(
            {
                "format": MATERIAL_FORMAT,
                "version": MATERIAL_VERSION,
                "material": material_to_json(material),
                "state": state_to_json(state),
            },
            indent=1,
        ),
        "utf-8",
    )
    exact = f"the exact material is in {folder.relative(place)}"
    if not plugin:
        result.remarks.append(f"{item.id}: {stock.remark}; {exact}")
        return dict(textures.stock(stock.description))
    result.remarks.append(
        f"{item.id}: written for burnish's own plugin; {exact}; without the plugin the closest "
        f"stock material is {stock.remark}"
    )
    both = item.two_sided and not item.wrapping.two_sided
    inner = {"type": PLUGIN, "filename": str(place), "two_sided": both}
    own = {f"map_{group}": textures.stock(texture) for group, texture in maps.items()}
    return dict(textures.stock(item.wrapping.around({**inner, **own})))


class _Writer:
    """Nodes and descriptions as XML elements; what is used twice is written once."""

    def __init__(
        self, tree: Tree, folder: Folder, edited: Mapping[int, tuple[str, Mapping[str, Any]]]
    ) -> None:
        self.tree, self.folder, self.edited = tree, folder, edited
        self._unique = UniqueNames()
        self._root = {index for _, index in tree.children(0)}
        # Objects keep their names, whatever else wants them
        shapes = [i for i in range(len(tree)) if tree.node(i).type == mi.ObjectType.Shape]
        self._ids = {index: self._unique(tree.id(index)) for index in shapes if tree.id(index)}
        self._elements: dict[int, ElementTree.Element] = {}
        self._materials: dict[str, ElementTree.Element] = {}

    def scene(self) -> ElementTree.Element:
        """The whole document."""
        root = ElementTree.Element("scene", version=mi.__version__)
        ElementTree.SubElement(root, "integrator", type="path")
        needed = self._referenced()
        for name, value in self._properties(0):
            if isinstance(value, Reference):
                kind = self.tree.node(value.index()).type
                if kind == mi.ObjectType.BSDF and value.index() not in needed:
                    continue
            self._property(root, name, value)
        ElementTree.indent(root, "    ")
        return root

    def _referenced(self) -> set[int]:
        """Nodes below the scene's own children that are still used."""
        found: set[int] = set()
        waiting = [index for _, index in self.tree.children(0)]
        first = set(waiting)
        seen: set[int] = set()
        while waiting:
            index = waiting.pop()
            if index in seen or (
                index in first
                and self.tree.node(index).type == mi.ObjectType.BSDF
                and index not in found
            ):
                continue
            seen.add(index)
            children = self.tree.children(index)
            if index in self.edited:
                bsdfs = {i for _, i in self.tree.children(index, mi.ObjectType.BSDF)}
                children = [(name, child) for name, child in children if child not in bsdfs]
            found.update(child for _, child in children)
            waiting += [child for _, child in children]
        return found

    def _properties(self, index: int) -> list[tuple[str, Any]]:
        props = self.tree.node(index).props
        return [(name, props[name]) for name in props]

    def _node(self, parent: ElementTree.Element, name: str, index: int) -> None:
        named = {} if name.startswith("_arg_") or index in self._root else {"name": name}
        if index in self._elements:
            element = self._elements[index]
            if "id" not in element.attrib:
                element.set("id", self._unique(self.tree.plugin(index)))
            ElementTree.SubElement(parent, "ref", {"id": element.attrib["id"], **named})
            return
        tag, plugin = _TAGS[self.tree.node(index).type], self.tree.plugin(index)
        element = ElementTree.SubElement(parent, tag, {"type": plugin, **named})
        own = self._ids.get(index) or self.tree.id(index) or (name if index in self._root else "")
        if own and not own.startswith("_"):
            element.set("id", own if index in self._ids else self._unique(own))
        self._elements[index] = element
        material = self.edited.get(index)
        for key, value in self._properties(index):
            is_bsdf = isinstance(value, Reference) and (
                self.tree.node(value.index()).type == mi.ObjectType.BSDF
            )
            if material is None or not (is_bsdf or isinstance(value, mi.BSDF)):
                self._property(element, key, value)
        if material is not None:
            self._material(element, *material)

    def _material(
        self, parent: ElementTree.Element, object_id: str, described: Mapping[str, Any]
    ) -> None:
        if object_id in self._materials:
            ElementTree.SubElement(parent, "ref", id=self._materials[object_id].attrib["id"])
            return
        self._property(parent, "_arg_0", described)
        element = parent[-1]
        element.set("id", self._unique(f"{object_id}-material"))
        self._materials[object_id] = element

    def _property(self, parent: ElementTree.Element, name: str, value: Any) -> None:
        if isinstance(value, Reference):
            self._node(parent, name, value.index())
        elif isinstance(value, Mapping):
            self._described(parent, name, value)
        elif isinstance(value, mi.Object):
            raise InvalidValue(
                f"{self.tree.label}: {name!r} is a ready-made Mitsuba object, which no file can "
                "hold; describe it by a dictionary"
            )
        else:
            self._value(parent, name, value)

    def _described(self, parent: ElementTree.Element, name: str, value: Mapping[str, Any]) -> None:
        kind = value["type"]
        if kind == "rgb":
            numbers = np.broadcast_to(np.ravel(value["value"]), 3)
            text = " ".join(_number(c) for c in numbers)
            ElementTree.SubElement(parent, "rgb", name=name, value=text)
            return
        if kind == "spectrum":
            _spectrum(parent, name, value["value"])
            return
        tag = "bsdf" if kind in _BSDFS or kind in _WRAPPERS else "texture"
        attributes = {} if name.startswith("_arg_") or tag == "bsdf" else {"name": name}
        element = ElementTree.SubElement(parent, tag, {"type": kind, **attributes})
        for key, part in value.items():
            if key != "type":
                self._property(element, key, part)

    def _value(self, parent: ElementTree.Element, name: str, value: Any) -> None:
        if isinstance(value, bool):
            tag, text = "boolean", str(value).lower()
        elif isinstance(value, int):
            tag, text = "integer", str(value)
        elif isinstance(value, float):
            tag, text = "float", _number(value)
        elif isinstance(value, str):
            tag, text = "string", value
            if names_file(name, value):
                inside = Path(value).parent == self.folder.path
                text = self.folder.relative(Path(value)) if inside else self.folder.copy(value)
        elif isinstance(value, mi.ScalarColor3d):
            tag, text = "rgb", " ".join(_number(c) for c in value)
        elif isinstance(value, mi.Spectrum):
            pairs = list(zip(map(float, value.wavelengths), map(float, value.values), strict=True))
            _spectrum(parent, name, pairs or float(value.values[0]))
            return
        elif np.shape(value) == (3,):
            x, y, z = (_number(c) for c in np.ravel(value))
            ElementTree.SubElement(parent, "vector", name=name, x=x, y=y, z=z)
            return
        elif hasattr(value, "matrix"):
            matrix = np.array(value.matrix, np.float64)
            if matrix.shape == (3, 3):
                wide = np.eye(4)
                wide[:2, :2], wide[:2, 3] = matrix[:2, :2], matrix[:2, 2]
                matrix = wide
            text = " ".join(_number(c) for c in matrix.ravel())
            element = ElementTree.SubElement(parent, "transform", name=name)
            ElementTree.SubElement(element, "matrix", value=text)
            return
        else:
            raise InvalidValue(f"{self.tree.label}: {name!r} cannot be written to XML: {value!r}")
        ElementTree.SubElement(parent, tag, name=name, value=text)


def _spectrum(parent: ElementTree.Element, name: str, value: Any) -> None:
    pairs = value if isinstance(value, (list, tuple)) else None
    text = (
        _number(value)
        if pairs is None
        else ", ".join(f"{_number(wavelength)}:{_number(sample)}" for wavelength, sample in pairs)
    )
    ElementTree.SubElement(parent, "spectrum", name=name, value=text)


def _number(value: Any) -> str:
    """A number that reads back as the same one."""
    return repr(float(value))
