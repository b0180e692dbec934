"""Objects: what a user selects and edits, and how they get their names."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mitsuba as mi

from burnish.materials.layer import Material, MaterialState
from burnish.scene.maps import WeightMap
from burnish.scene.tree import Tree, UniqueNames
from burnish.scene.wrapping import Bend, Wrapping


@dataclass(frozen=True)
class SceneObject:
    """A shape, or the shapes of one group, with one material.

    shapes: positions in `mi_scene.shapes()`; empty inside a `shapegroup`.
    reason: why the object is fixed, "" when it is editable.
    material: None for a fixed object. maps: the static H of each layer group that has one.
    two_sided: whether its BSDF reflects on both faces.
    plugin: Mitsuba's name of its BSDF, inside `twosided`. bsdf: the scene's own mi.BSDF.
    factory: the dictionary of Mitsuba's own plugin in a state, None where none holds it; None
    itself where the material is not the scene's.
    wrapping: what the scene puts round the material; of it, opacity: mi.Texture of a mask, and
    bend: how it bends normals.
    """

    id: str
    shapes: tuple[int, ...]
    plugin: str
    bsdf: Any
    reason: str = ""
    material: Material | None = None
    two_sided: bool = False
    maps: Mapping[str, WeightMap] = field(default_factory=dict)
    factory: Callable[[MaterialState], Mapping[str, Any] | None] | None = None
    wrapping: Wrapping = field(default_factory=Wrapping)
    opacity: Any = None
    bend: Bend | None = None

    @property
    def editable(self) -> bool:
        return self.material is not None and not self.reason

    def edited_bsdf(self, state: MaterialState) -> Any | None:
        """Mitsuba's own plugin with the edited parameters (mi.BSDF).

        None when no plugin of Mitsuba's can hold that state.
        """
        described = self.described(state)
        return None if described is None else mi.load_dict(dict(described))

    def described(self, state: MaterialState) -> Mapping[str, Any] | None:
        """The dictionary of Mitsuba's own plugin in a state; None where none can hold it."""
        return self.factory(state) if self.factory is not None else None


@dataclass(frozen=True)
class Draft:
    """An object before the scene is built.

    shapes: node numbers of its shapes. instanced: whether they lie in a shapegroup.
    ready: the shape itself, where a dictionary held a ready-made one.
    """

    id: str
    shapes: tuple[int, ...]
    instanced: bool = False
    ready: Any = None

    @property
    def shape_ids(self) -> tuple[str, ...]:
        """The ids that its shape nodes, and so its built shapes, have."""
        return tuple(
            self.id if number == 0 else f"{self.id}#{number + 1}"
            for number in range(len(self.shapes))
        )


def draft_objects(tree: Tree, by_bsdf: bool) -> list[Draft]:
    """The objects of a scene, in its order, each with a name of its own.

    Each shape is an object; the shapes of a `merge` group that share a BSDF are one object;
    with `by_bsdf`, so are all shapes that share a BSDF. The shape nodes get their object's
    id, by which the built shapes are found again.
    """
    merged = {shape: group for group, shapes in tree.flatten_merged().items() for shape in shapes}
    names: dict[object, str] = {}
    shapes: dict[object, list[int]] = {}
    instanced: set[object] = set()
    for name, index in _shape_nodes(tree):
        bsdf, light = bsdf_of(tree, index), is_light(tree, index)
        key: object = index
        if by_bsdf and bsdf is not None and not light:
            key = ("bsdf", bsdf)
            names.setdefault(key, tree.id(bsdf) or _name(tree, name, index))
        elif index in merged:
            key = (merged[index], bsdf, light)
            names.setdefault(key, _group_name(tree, merged, index))
        else:
            names[key] = _name(tree, name, index)
        shapes.setdefault(key, []).append(index)
        if not any(index == child for _, child in tree.children(0)):
            instanced.add(key)
    unique = UniqueNames()
    drafts = [
        Draft(unique(names[key]), tuple(nodes), key in instanced) for key, nodes in shapes.items()
    ]
    for draft in drafts:
        for index, shape_id in zip(draft.shapes, draft.shape_ids, strict=True):
            tree.node(index).props.set_id(shape_id)
    drafts += [
        Draft(unique(name), (), ready=value)
        for name, value in tree.embedded(0)
        if isinstance(value, mi.Shape)
    ]
    return drafts


def bsdf_of(tree: Tree, index: int) -> int | None:
    """The BSDF node of a shape node."""
    found = tree.children(index, mi.ObjectType.BSDF)
    return found[0][1] if found else None


def is_light(tree: Tree, index: int) -> bool:
    """Whether a shape node emits."""
    return bool(tree.children(index, mi.ObjectType.Emitter)) or any(
        isinstance(value, mi.Emitter) for _, value in tree.embedded(index)
    )


def is_lamp(tree: Tree, index: int) -> bool:
    """Whether a shape node is there to light: it emits, and not by a texture over its surface.

    What glows in places, such as a helmet's lights, is a surface to edit like any other.
    """
    emitters = tree.children(index, mi.ObjectType.Emitter)
    glows = [tree.children(node, mi.ObjectType.Texture) for _, node in emitters]
    varies = any(tree.plugin(texture) == "bitmap" for textures in glows for _, texture in textures)
    return is_light(tree, index) and not (varies and len(emitters) == 1)


def _shape_nodes(tree: Tree) -> Iterator[tuple[str, int]]:
    """(property name, node number) of every shape with a surface, those in groups too."""
    for name, index in tree.children(0, mi.ObjectType.Shape):
        if tree.plugin(index) == "shapegroup":
            yield from tree.children(index, mi.ObjectType.Shape)
        elif tree.plugin(index) != "instance":
            yield name, index


def _name(tree: Tree, name: str, index: int) -> str:
    """XML id, else name, else the BSDF's id, else the mesh's file name, else the plugin."""
    if tree.id(index):
        return tree.id(index)
    if not name.startswith("_arg_"):
        return name
    bsdf = bsdf_of(tree, index)
    if bsdf is not None and tree.id(bsdf):
        return tree.id(bsdf)
    props = tree.node(index).props
    return Path(str(props["filename"])).stem if "filename" in props else tree.plugin(index)


def _group_name(tree: Tree, merged: Mapping[int, int], index: int) -> str:
    """The group's own name; with the BSDF's behind it where the group has several."""
    group, bsdf = merged[index], bsdf_of(tree, index)
    name = tree.id(group) or "group"
    materials = {bsdf_of(tree, shape) for shape in merged if merged[shape] == group}
    if len(materials) == 1 or bsdf is None:
        return name
    return f"{name}-{tree.id(bsdf) or tree.plugin(bsdf)}"
