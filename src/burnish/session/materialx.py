"""OpenPBR values of a MaterialX file on the objects of a session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from burnish.core.errors import InvalidValue, MissingFile, UnknownName
from burnish.core.types import Value
from burnish.materials.openpbr import apply

if TYPE_CHECKING:
    from burnish.session.session import Session

SURFACE = "open_pbr_surface"


@dataclass(frozen=True)
class Look:
    """The OpenPBR surface of one material.

    values: its inputs; a colour that multiplies an image counts, as the tint of an object's own
    texture. images: the inputs that an image or another node gives, which are not read.
    """

    values: Mapping[str, Value]
    images: tuple[str, ...] = ()


@dataclass(frozen=True)
class Looks:
    """A file's materials by name, and which object each was written for."""

    materials: Mapping[str, Look]
    objects: Mapping[str, str] = field(default_factory=dict)


def read_materialx(path: str | Path) -> Looks:
    """The OpenPBR materials of a MaterialX file. Raises MissingFile, InvalidValue."""
    path = Path(path)
    if not path.is_file():
        raise MissingFile(f"no MaterialX file {str(path)!r}; check the path")
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise InvalidValue(f"{path}: not XML ({error}); write the file again") from None
    if root.tag != "materialx":
        raise InvalidValue(f"{path}: not a MaterialX file; its outermost element is {root.tag!r}")
    nodes = {node.get("name", ""): node for node in root}
    materials: dict[str, Look] = {}
    for node in root:
        if node.tag == "surfacematerial":
            shader = _connected(node, "surfaceshader", nodes)
            if shader is not None and shader.tag == SURFACE:
                materials[node.get("name", "")] = _look(path, shader, nodes)
    named = {_connected_name(m, "surfaceshader") for m in root if m.tag == "surfacematerial"}
    for node in root:
        if node.tag == SURFACE and node.get("name") not in named:
            materials[node.get("name", "")] = _look(path, node, nodes)
    if not materials:
        raise InvalidValue(f"{path}: it has no {SURFACE}; export one with OpenPBR materials")
    objects = {
        assign.get("geom", "").lstrip("/"): assign.get("material", "")
        for assign in root.iter("materialassign")
    }
    return Looks(materials, {name: m for name, m in objects.items() if m in materials})


def load_materialx(
    session: Session, path: str | Path, object_id: str | None = None, material: str | None = None
) -> list[str]:
    """Give an object the OpenPBR values of a MaterialX file, as one undo step.

    object_id: without it, every object for which the file's look names a material. material:
    which of the file's, where it has several and its look names none for the object. Returns
    what could not be held, one line each. Raises MissingFile, InvalidValue, UnknownName.
    """
    looks = read_materialx(path)
    pairs: dict[str, str] = {}
    if object_id is not None:
        if session.material(object_id) is None:
            known = [item.id for item in session.objects if item.editable]
            raise UnknownName("editable object", object_id, known)
        if material is None:
            material = looks.objects.get(object_id) or _only(path, looks)
        if material not in looks.materials:
            raise UnknownName(f"material in {path}", material, looks.materials)
        pairs[object_id] = material
    else:
        pairs = {
            name: chosen
            for name, chosen in looks.objects.items()
            if session.material(name) is not None
        }
        if not pairs:
            raise InvalidValue(
                f"{path}: its look names no object of this scene; say which object gets it"
            )
    state, remarks = dict(session.state), []
    for name, chosen in pairs.items():
        look, own = looks.materials[chosen], session.material(name)
        assert own is not None
        state[name], lost = apply(name, own, state[name], look.values)
        remarks += [f"{name}: {remark}" for remark in lost]
        remarks += [
            f"{name}: {image} comes from an image or a graph, which is not read"
            for image in look.images
        ]
    session.restore(state)
    return remarks


def _only(path: str | Path, looks: Looks) -> str:
    if len(looks.materials) > 1:
        names = ", ".join(looks.materials)
        raise InvalidValue(f"{path}: it has several materials ({names}); say which")
    return next(iter(looks.materials))


def _look(path: Path, shader: ElementTree.Element, nodes: Mapping[str, Element]) -> Look:
    values: dict[str, Value] = {}
    images = []
    for item in shader.findall("input"):
        name, text = item.get("name", ""), item.get("value")
        if text is None:
            node = nodes.get(item.get("nodename", ""))
            tint = _tint(path, node, nodes)
            if tint is not None and name in ("base_color", "specular_color"):
                values[name] = tint
            else:
                images.append(name)
            continue
        parsed = _parsed(path, name, item.get("type", ""), text)
        if parsed is not None:
            values[name] = parsed
    return Look(values, tuple(images))


Element = ElementTree.Element


def _tint(path: Path, node: Element | None, nodes: Mapping[str, Element]) -> Value | None:
    """The constant colour that a node multiplies an image by."""
    if node is None:
        return None
    if node.tag in ("image", "tiledimage"):
        return (1.0, 1.0, 1.0)
    if node.tag != "multiply":
        return None
    constants = [item for item in node.findall("input") if item.get("value") is not None]
    others = [nodes.get(item.get("nodename", "")) for item in node.findall("input")]
    pictures = [other for other in others if other is not None and other.tag.endswith("image")]
    if len(constants) != 1 or len(pictures) != 1:
        return None
    return _parsed(path, "in2", constants[0].get("type", ""), constants[0].get("value", ""))


def _parsed(path: Path, name: str, kind: str, text: str) -> Value | None:
    """A float, a colour or None for another type. Raises InvalidValue."""
    if kind not in ("float", "color3"):
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
        if len(numbers) != (3 if kind == "color3" else 1):
            raise ValueError
    except ValueError:
        raise InvalidValue(f"{path}: {name} is no {kind}: {text!r}; correct it") from None
    return numbers[0] if kind == "float" else (numbers[0], numbers[1], numbers[2])


def _connected(node: Element, name: str, nodes: Mapping[str, Element]) -> Element | None:
    return nodes.get(_connected_name(node, name))


def _connected_name(node: Element, name: str) -> str:
    for item in node.findall("input"):
        if item.get("name") == name:
            return item.get("nodename", "")
    return ""
