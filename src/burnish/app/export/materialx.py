"""Materials as MaterialX documents with OpenPBR surfaces.

Each object's stock Mitsuba material becomes a graph: `open_pbr_surface` for a plugin, `mix` of
two for a blend, `geometry_opacity` for a mask, `geometry_normal` for a normal map. What
differs is said: Mitsuba's conductors have Fresnel curves of their own, `principled` a coat and
a retro-reflection that OpenPBR shapes otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from burnish.app.export.closest import closest
from burnish.app.export.files import Folder, Textures
from burnish.app.export.report import Exported
from burnish.core.colour import LUMINANCE
from burnish.core.types import Float64
from burnish.materials.layer import MaterialState
from burnish.materials.maths import numpy_maths
from burnish.materials.models.optics import fresnel_conductor
from burnish.materials.models.principled import ior_of_specular
from burnish.materials.openpbr import COAT_SHARE, coat_roughness, normal_reflectance
from burnish.scene import SceneObject
from burnish.scene.tree import UniqueNames

Element = ElementTree.Element
EDGE = np.cos(np.radians(82.0))
"""Where OpenPBR's specular_color sets a metal's Fresnel curve."""


def write_materialx(objects: Sequence[tuple[SceneObject, MaterialState]], path: Path) -> Exported:
    """Write one surface material for each object, and a look that assigns them."""
    result, folder = Exported(), Folder(path)
    root = ElementTree.Element("materialx", {"version": "1.39", "colorspace": "lin_rec709"})
    look = ElementTree.Element("look", name="burnish")
    names = UniqueNames()
    for item, state in objects:
        name = names("m_" + re.sub(r"\W", "_", item.id))
        maps = {group: dict(found.description) for group, found in item.maps.items()}
        textures = Textures(folder, item.id, maps)
        stock = closest(item, state, textures)
        graph = _Graph(root, name, folder, textures)
        shader = graph.surface(stock.description, {})
        material = ElementTree.SubElement(root, "surfacematerial", name=name, type="material")
        _connect(material, "surfaceshader", "surfaceshader", shader)
        assigned = {"name": f"{name}_to", "geom": f"/{item.id}", "material": name}
        ElementTree.SubElement(look, "materialassign", assigned)
        remarks = [stock.remark] if stock.remark else []
        result.remarks += [f"{item.id}: {remark}" for remark in [*remarks, *graph.remarks]]
    root.append(look)
    ElementTree.indent(root, "  ")
    path.write_text('<?xml version="1.0"?>\n' + ElementTree.tostring(root, "unicode") + "\n")
    result.files += [path, *folder.written]
    return result


class _Graph:
    """The nodes of one material."""

    def __init__(self, root: Element, name: str, folder: Folder, textures: Textures) -> None:
        self.root, self.name, self.folder, self.textures = root, name, folder, textures
        self.remarks: list[str] = []
        self._count = 0

    def node(self, tag: str, kind: str) -> Element:
        """A new node of the document."""
        self._count += 1
        name = f"{self.name}_{tag}_{self._count}"
        return ElementTree.SubElement(self.root, tag, {"name": name, "type": kind})

    # -- surfaces ---------------------------------------------------------------------------

    def surface(self, value: Mapping[str, Any], geometry: Mapping[str, Any]) -> Element:
        """The shader node of a BSDF's description. geometry: inputs from what is round it."""
        kind = value["type"]
        inner = [part for part in value.values() if isinstance(part, Mapping)]
        if kind == "twosided":
            return self.surface(inner[0], geometry)
        if kind == "mask":
            opacity = value.get("opacity", 0.5)
            inside = next(part for name, part in value.items() if name == "bsdf")
            return self.surface(inside, {**geometry, "geometry_opacity": opacity})
        if kind == "normalmap":
            return self.surface(value["bsdf"], {**geometry, "geometry_normal": value["normalmap"]})
        if kind == "bumpmap":
            self.remarks.append("its bump map is left out: OpenPBR takes normals")
            return self.surface(value["bsdf"], geometry)
        if kind == "blendbsdf":
            nested = [part for name, part in value.items() if name not in ("type", "weight")]
            first, second = (self.surface(part, geometry) for part in nested)
            mixed = self.node("mix", "surfaceshader")
            _connect(mixed, "fg", "surfaceshader", second)
            _connect(mixed, "bg", "surfaceshader", first)
            self.scalar(mixed, "mix", value.get("weight", 0.5))
            return mixed
        shader = self.node("open_pbr_surface", "surfaceshader")
        _INPUTS[kind](self, shader, value)
        for name, given in geometry.items():
            if name == "geometry_normal":
                normal = self.node("normalmap", "vector3")
                _connect(normal, "in", "vector3", self.image(given, "vector3"))
                _connect(shader, name, "vector3", normal)
            else:
                self.scalar(shader, name, given)
        return shader

    def diffuse(self, shader: Element, value: Mapping[str, Any]) -> None:
        """Lambert's."""
        self.colour(shader, "base_color", value["reflectance"])
        self.scalar(shader, "specular_weight", 0.0)

    def plastic(self, shader: Element, value: Mapping[str, Any]) -> None:
        """A coat over a matte base."""
        self.colour(shader, "base_color", value["diffuse_reflectance"])
        self.colour(shader, "specular_color", value["specular_reflectance"])
        self.scalar(shader, "specular_roughness", float(value.get("alpha", 0.0)) ** 0.5)
        self.scalar(shader, "specular_ior", value["int_ior"])

    def conductor(self, shader: Element, value: Mapping[str, Any]) -> None:
        """A metal: its Fresnel curve by F0 and F at 82°."""
        eta, k = (_rgb(value[name]) for name in ("eta", "k"))
        f0 = normal_reflectance(eta, k)
        self.scalar(shader, "base_metalness", 1.0)
        self.colour(shader, "base_color", value["specular_reflectance"], f0)
        edge = fresnel_conductor(numpy_maths, EDGE, eta, k)
        schlick = f0 + (1 - f0) * (1 - EDGE) ** 5
        self.colour(shader, "specular_color", _constant(np.minimum(edge / schlick, 1.0)))
        self.scalar(shader, "specular_roughness", float(value.get("alpha", 0.0)) ** 0.5)

    def principled(self, shader: Element, value: Mapping[str, Any]) -> None:
        """Mitsuba's `principled`, parameter by parameter."""
        self.colour(shader, "base_color", value["base_color"])
        self.scalar(shader, "base_metalness", value["metallic"])
        self.scalar(shader, "specular_roughness", value["roughness"])
        self.scalar(shader, "specular_ior", float(ior_of_specular(value["specular"])))
        base = value["base_color"]
        if value["spec_tint"] and isinstance(base, Mapping) and base["type"] == "rgb":
            hue = _rgb(base) / max(float(_rgb(base) @ LUMINANCE), 1e-6)
            tint = 1 + value["spec_tint"] * (hue - 1)
            self.colour(shader, "specular_color", _constant(np.clip(tint, 0.0, 1.0)))
        for name, own, share in (
            ("coat_weight", "clearcoat", COAT_SHARE),
            ("fuzz_weight", "sheen", 1),
        ):
            if isinstance(value[own], Mapping):
                self.remarks.append(f"the texture of its {own} is left out")
            elif value[own]:
                self.scalar(shader, name, share * value[own])
        if value["clearcoat"]:
            self.scalar(shader, "coat_ior", 1.5)
            self.scalar(shader, "coat_darkening", 0.0)
        self.scalar(shader, "coat_roughness", coat_roughness(value["clearcoat_gloss"]))
        self.remarks.append(
            "OpenPBR shapes the coat, the sheen and light towards its source otherwise than "
            "Mitsuba's principled; the numbers are the same"
        )

    # -- inputs -----------------------------------------------------------------------------

    def scalar(self, node: Element, name: str, value: Any) -> None:
        """An input of one number, or of an image's red channel."""
        if isinstance(value, Mapping) and value["type"] in ("rgb", "uniform"):
            value = float(np.ravel(value["value"])[0])
        if isinstance(value, Mapping):
            _connect(node, name, "float", self.image(value, "float"))
            return
        _value(node, name, "float", f"{float(value):.9g}")

    def colour(self, node: Element, name: str, value: Any, tint: Float64 | None = None) -> None:
        """A colour input: a constant, an image, or an image times a colour."""
        factor = np.ones(3) if tint is None else np.asarray(tint)
        while isinstance(value, Mapping) and value["type"] == "burnish_product":
            parts = _constant_product(value)
            if parts is None:
                break
            value, factor = parts[0], factor * parts[1]
        if not isinstance(value, Mapping) or value["type"] in ("rgb", "uniform"):
            _value(node, name, "color3", _numbers(_rgb(value) * factor))
            return
        picture = self.image(value, "color3")
        if (factor != 1).any():
            product = self.node("multiply", "color3")
            _connect(product, "in1", "color3", picture)
            _value(product, "in2", "color3", _numbers(factor))
            picture = product
        _connect(node, name, "color3", picture)

    def image(self, value: Mapping[str, Any], kind: str) -> Element:
        """An image node of a texture; textures that are no bitmap are evaluated."""
        texture = self.textures.stock(value)
        if texture["type"] != "bitmap" or "filename" not in texture:
            texture = self.textures.baked(texture)
        file = str(texture["filename"])
        inside = Path(file).parent == self.folder.path
        relative = self.folder.relative(Path(file)) if inside else self.folder.copy(file)
        node = self.node("tiledimage", kind)
        linear = bool(texture.get("raw", False)) or Path(file).suffix.lower() in (".exr", ".hdr")
        space = {} if linear or kind != "color3" else {"colorspace": "srgb_texture"}
        attributes = {"name": "file", "type": "filename", "value": relative, **space}
        ElementTree.SubElement(node, "input", attributes)
        if "to_uv" in texture:
            matrix = np.array(texture["to_uv"].matrix, np.float64)
            tiling = np.array([matrix[0, 0], matrix[1, 1]])
            if np.abs(matrix[:2] - np.eye(4)[:2] * [[tiling[0]], [tiling[1]]]).max() > 1e-6:
                self.remarks.append("its textures are shifted or turned, which is left out")
            _value(node, "uvtiling", "vector2", _numbers(tiling))
        return node


_INPUTS: dict[str, Any] = {
    "diffuse": _Graph.diffuse,
    "plastic": _Graph.plastic,
    "roughplastic": _Graph.plastic,
    "conductor": _Graph.conductor,
    "roughconductor": _Graph.conductor,
    "principled": _Graph.principled,
}


def _constant_product(value: Mapping[str, Any]) -> tuple[Mapping[str, Any], Float64] | None:
    """The one texture of a product, and the colour that multiplies it."""
    textures, factor, number = [], np.ones(3), 0
    while f"nested_{number}" in value:
        nested = value[f"nested_{number}"]
        if value[f"offset_{number}"] or value[f"single_{number}"]:
            return None
        factor = factor * value[f"scale_{number}"]
        if nested["type"] == "rgb":
            factor = factor * np.asarray(nested["value"])
        else:
            textures.append(nested)
        number += 1
    return (textures[0], factor) if len(textures) == 1 else None


def _rgb(value: Any) -> Float64:
    numbers = value["value"] if isinstance(value, Mapping) else value
    return np.asarray(np.broadcast_to(np.ravel(numbers), 3), np.float64)


def _constant(colour: Float64) -> dict[str, Any]:
    return {"type": "rgb", "value": colour}


def _numbers(values: Float64) -> str:
    return ", ".join(f"{float(number):.9g}" for number in values)


def _value(node: Element, name: str, kind: str, text: str) -> None:
    ElementTree.SubElement(node, "input", {"name": name, "type": kind, "value": text})


def _connect(node: Element, name: str, kind: str, source: Element) -> None:
    attributes = {"name": name, "type": kind, "nodename": source.attrib["name"]}
    ElementTree.SubElement(node, "input", attributes)
