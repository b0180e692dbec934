"""From a scene file, a dictionary or an example's name to a `Scene`."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from burnish.core.errors import BurnishError, InvalidValue, SceneError, UnknownName
from burnish.core.types import RGB
from burnish.materials.layer import Material
from burnish.scene import examples, gltf
from burnish.scene.adapters import Adapted, adapt
from burnish.scene.assign import assigned
from burnish.scene.device import activate
from burnish.scene.lights import SceneLight, changed, draft_lights, find_lights
from burnish.scene.maps import WeightMap
from burnish.scene.objects import Draft, SceneObject, bsdf_of, draft_objects, is_lamp
from burnish.scene.placing import Placement
from burnish.scene.remodel import remodelled
from burnish.scene.tree import Tree
from burnish.scene.views import View, prepare_sensors, views_of
from burnish.scene.wrapping import BENDS


@dataclass(frozen=True)
class Request:
    """What `load` was asked for, so that another process can load the same scene."""

    scene: str | Path | Mapping[str, Any]
    options: Mapping[str, Any]


@dataclass(frozen=True)
class Scene:
    """A scene that Mitsuba can trace, its objects and its views.

    source: the scene file, None for a dictionary or an example.
    mi_scene: mi.Scene with nothing merged. hash: SHA-256 over all of its inputs.
    object_table: uint32 [largest shape number + 1], from a shape's number in Mitsuba
      (`dr.reinterpret_array(mi.UInt32, si.shape)`) to an index into `objects`.
    lights: what sends light; light_table: uint32, from an emitter's number in Mitsuba
      (`dr.reinterpret_array(mi.UInt32, si.emitter(mi_scene))`) to an index into `lights`.
    tree, drafts: what `with_bsdfs` builds anew. warnings: what was left out, one line each.
    """

    name: str
    source: Path | None
    mi_scene: Any
    objects: tuple[SceneObject, ...]
    views: tuple[View, ...]
    hash: str
    object_table: NDArray[np.uint32]
    tree: Tree
    drafts: tuple[Draft, ...]
    lights: tuple[SceneLight, ...]
    light_table: NDArray[np.uint32]
    warnings: tuple[str, ...] = ()
    request: Request = Request("", {})

    def object(self, object_id: str) -> SceneObject:
        """The object of that id. Raises UnknownName."""
        for item in self.objects:
            if item.id == object_id:
                return item
        raise UnknownName("object", object_id, [item.id for item in self.objects])

    def view(self, name: str | None = None) -> View:
        """The view of that name; the first without one. Raises UnknownName."""
        if name is None:
            return self.views[0]
        for view in self.views:
            if view.name == name:
                return view
        raise UnknownName("view", name, [view.name for view in self.views])

    def editable(self, ids: Iterable[str] | None = None) -> tuple[SceneObject, ...]:
        """The objects to edit, in the scene's order: those named, or all that can be.

        Raises UnknownName for an id that does not exist, InvalidValue for one that is fixed,
        SceneError when nothing can be edited.
        """
        if ids is None:
            found = tuple(item for item in self.objects if item.editable)
            if not found:
                reasons = "; ".join(f"{item.id}: {item.reason}" for item in self.objects[:4])
                raise SceneError(
                    f"{self.name}: no object can be edited ({reasons}); give at least one shape a "
                    "diffuse, conductor, roughconductor, plastic, roughplastic or principled BSDF"
                )
            return found
        wanted = set(ids)
        for item in (self.object(object_id) for object_id in wanted):
            if not item.editable:
                raise InvalidValue(
                    f"object {item.id!r} cannot be edited: {item.reason}; leave it out"
                )
        return tuple(item for item in self.objects if item.id in wanted)

    def with_lights(
        self,
        factors: Mapping[str, RGB],
        folder: Path | None = None,
        placed: Mapping[str, Placement] | None = None,
    ) -> Tree:
        """The scene's description with the named lights sending `factors` as much.

        factors: linear RGB. folder: where images of lights that get another colour are
        written, and must stay; a temporary one, gone with the tree, without it. placed: by
        light, where it stands instead (`materials.lights.placements`). Raises UnknownName,
        InvalidValue for a light that Mitsuba cannot scale.
        """
        if not (factors or placed):
            return self.tree
        place = folder or Path(tempfile.mkdtemp(prefix="burnish-"))
        tree = changed(self.tree, self.lights, factors, place, placed or {})
        if folder is None:
            weakref.finalize(tree, shutil.rmtree, place, ignore_errors=True)
        return tree

    def with_bsdfs(
        self,
        bsdfs: Mapping[str, Any],
        factors: Mapping[str, RGB] | None = None,
        placed: Mapping[str, Placement] | None = None,
    ) -> Any:
        """A fresh mi.Scene in which the named objects have the given mi.BSDF.

        factors, placed: as for `with_lights`. Its sensors stand in the order of
        `mi_scene.sensors()`. Raises UnknownName, InvalidValue.
        """
        shapes: dict[int, Any] = {}
        for object_id, bsdf in bsdfs.items():
            draft = self.drafts[self.objects.index(self.object(object_id))]
            if draft.ready is not None:
                raise InvalidValue(
                    f"object {object_id!r} is a ready-made Mitsuba shape and keeps its BSDF"
                )
            shapes.update(dict.fromkeys(draft.shapes, bsdf))
        # Its images must last until the scene has read them
        tree = self.with_lights(factors or {}, placed=placed)
        return tree.replaced(shapes).build()


def load(
    scene: str | Path | Mapping[str, Any],
    editable: Sequence[str] | None = None,
    variant: str | None = None,
    *,
    resolution: tuple[int, int] | None = None,
    by_bsdf: bool = False,
    materials: Mapping[str, Material] | None = None,
    models: Mapping[str, str] | None = None,
    **parameters: object,
) -> Scene:
    """Load a scene.

    scene: a Mitsuba 3 XML file, a glTF or GLB file, a Mitsuba dictionary, or an example's name.
    editable: ids of the objects to keep editable; all that can be by default.
    variant: Mitsuba variant; see `device.activate`.
    resolution: width and height in pixels for every film, instead of the scene's own.
    by_bsdf: make one object of all shapes that share a BSDF.
    materials: by object id, materials of ours in place of the scene's (see `assign`).
    models: by "object.layer", reflectance models in place of the scene's (see `remodel`).
    parameters: values for `$name` in the file, like Mitsuba's -D.
    Raises MissingFile, SceneError, InvalidValue, UnknownName or DeviceError, in one line
    with the remedy.
    """
    activate(variant)
    finish: Mapping[str, examples.Finish] = {}
    source: Path | None = None
    warnings: tuple[str, ...] = ()
    if isinstance(scene, Mapping):
        name, tree = "scene", Tree.from_dict(scene, "the scene dictionary")
    elif Path(scene).name == str(scene) and not Path(scene).suffix:
        example = examples.find(str(scene))
        name = example.name
        if parameters:
            raise InvalidValue(
                f"example {name!r} has no parameter {', '.join(sorted(parameters))}; leave it out"
            )
        folder = Path(tempfile.mkdtemp(prefix="burnish-"))
        tree = _with_folder(example.describe(folder), f"example {name!r}", folder)
        finish = example.finish
    else:
        source = Path(scene)
        name, suffix = source.stem, source.suffix.lower()
        if suffix in (".gltf", ".glb"):
            if parameters:
                raise InvalidValue(
                    f"{scene} has no parameter {', '.join(sorted(parameters))}; leave it out"
                )
            tree, warnings = _from_gltf(source)
        elif suffix == ".xml":
            tree = Tree.from_file(source, parameters)
        else:
            raise SceneError(
                f"{scene}: not a Mitsuba 3 scene or a glTF file; give an .xml, .gltf or .glb file "
                "or an example"
            )
    loaded = _assemble(name, source, tree, resolution, by_bsdf, finish)
    loaded = replace(loaded, warnings=warnings + loaded.warnings)
    options: dict[str, Any] = {
        "editable": editable,
        "resolution": resolution,
        "by_bsdf": by_bsdf,
    }
    if materials:
        loaded = assigned(loaded, materials)
        options["materials"] = dict(materials)
    if models:
        loaded = remodelled(loaded, models)
        options["models"] = dict(models)
    if editable is not None:
        loaded = _restricted(loaded, editable)
    return replace(loaded, request=Request(scene, options | parameters))


def _with_folder(description: Mapping[str, Any], label: str, folder: Path) -> Tree:
    """A tree over files in a working folder, which go when the tree does."""
    tree = Tree.from_dict(description, label)
    # `with_bsdfs` reads them again
    weakref.finalize(tree, shutil.rmtree, folder, ignore_errors=True)
    return tree


def _from_gltf(path: Path) -> tuple[Tree, tuple[str, ...]]:
    """The tree of a glTF or GLB file, and warnings."""
    folder = Path(tempfile.mkdtemp(prefix="burnish-"))
    try:
        description, warnings = gltf.describe(path, folder)
        return _with_folder(description, str(path), folder), warnings
    except BurnishError:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _assemble(
    name: str,
    source: Path | None,
    tree: Tree,
    resolution: tuple[int, int] | None,
    by_bsdf: bool,
    finish: Mapping[str, examples.Finish],
) -> Scene:
    warnings = _without_media(tree)
    tree.remove_children(0, mi.ObjectType.Integrator)
    sensors = prepare_sensors(tree, resolution)
    drafts = tuple(draft_objects(tree, by_bsdf))
    if not drafts:
        raise SceneError(f"{tree.label}: the scene has no shapes; add at least one <shape>")
    digest = tree.digest()
    drafted = draft_lights(tree, drafts)
    mi_scene = tree.build()
    if not mi_scene.emitters():
        raise SceneError(
            f"{tree.label}: the scene has no light; add an <emitter>, such as "
            '<emitter type="constant"/>'
        )
    shapes = mi_scene.shapes()
    positions = {shape.id(): number for number, shape in enumerate(shapes)}
    found = {shape.id(): shape for shape in _all_shapes(mi_scene)}
    adapted: dict[int | None, Adapted] = {}
    objects, shapes_of = [], []
    table: dict[int, int] = {}
    for number, draft in enumerate(drafts):
        own = [found[i] for i in draft.shape_ids] if draft.shapes else [draft.ready]
        _check_vertices(tree, draft, own)
        shapes_of.append(own)
        for shape in own:
            table[_registry_number(shape)] = number
        where = tuple(positions[shape.id()] for shape in own if shape.id() in positions)
        item = SceneObject(draft.id, where, "unknown", own[0].bsdf())
        item = _describe(item, draft, tree, mi_scene, own, adapted)
        objects.append(finish[item.id](item) if item.id in finish else item)
    object_table = np.zeros(max(table) + 1, np.uint32)
    object_table[list(table)] = list(table.values())
    lights, light_table = find_lights(drafted, drafts, shapes_of, mi_scene)
    return Scene(
        name=name,
        source=source,
        mi_scene=mi_scene,
        objects=tuple(objects),
        views=views_of(mi_scene, sensors),
        hash=digest,
        object_table=object_table,
        tree=tree,
        drafts=drafts,
        lights=lights,
        light_table=light_table,
        warnings=warnings,
    )


def _describe(
    item: SceneObject,
    draft: Draft,
    tree: Tree,
    mi_scene: Any,
    shapes: list[Any],
    adapted: dict[int | None, Adapted],
) -> SceneObject:
    """What can be edited on an object, or why nothing can."""
    if draft.ready is not None:
        return replace(item, reason="it is a ready-made Mitsuba shape, whose BSDF cannot be read")
    node = draft.shapes[0]
    bsdf = bsdf_of(tree, node)
    if bsdf not in adapted:
        description = {"type": "diffuse"} if bsdf is None else tree.as_dict(bsdf)
        adapted[bsdf] = adapt(description)
    read = adapted[bsdf]
    item = replace(item, plugin=_plugin_inside(tree, bsdf), two_sided=read.two_sided)
    if is_lamp(tree, node):
        return replace(item, reason="it is a light")
    if draft.instanced:
        return replace(item, reason="it lies in a shapegroup, whose instances share it")
    if any(isinstance(value, mi.BSDF) for _, value in tree.embedded(node)):
        return replace(item, reason="its BSDF is a ready-made Mitsuba object")
    if read.material is None:
        return replace(item, reason=read.reason)
    maps = {
        group: WeightMap(mi.load_dict(dict(texture)), mi_scene, tuple(shapes), texture)
        for group, texture in read.maps.items()
    }
    return replace(
        item,
        material=read.material,
        maps=maps,
        factory=read.describe,
        wrapping=read.wrapping,
        opacity=read.wrapping.opacity(),
        bend=read.wrapping.bend(read.two_sided),
    )


def _restricted(scene: Scene, editable: Sequence[str]) -> Scene:
    """The same scene with every object fixed but the chosen ones."""
    chosen = {item.id for item in scene.editable(editable)}
    objects = tuple(
        item
        if item.id in chosen or not item.editable
        else replace(item, material=None, reason="it was not chosen to be editable")
        for item in scene.objects
    )
    return replace(scene, objects=objects)


def _without_media(tree: Tree) -> tuple[str, ...]:
    """Take participating media out, as Mitsuba's `path` leaves them out; returns warnings."""
    warnings = []
    for index in range(len(tree)):
        if tree.children(index, mi.ObjectType.Medium):
            tree.remove_children(index, mi.ObjectType.Medium)
            name = tree.id(index) or tree.plugin(index)
            warnings.append(
                f"{tree.place(index)}: the medium of {name!r} is left out; only surfaces are traced"
            )
    return tuple(warnings)


def _check_vertices(tree: Tree, draft: Draft, shapes: list[Any]) -> None:
    for shape in shapes:
        numbers = (
            np.asarray(shape.vertex_positions_buffer())
            if isinstance(shape, mi.Mesh)
            else np.array([shape.bbox().min, shape.bbox().max], np.float64)
        )
        if not np.isfinite(numbers).all():
            place = tree.place(draft.shapes[0]) if draft.shapes else tree.label
            raise SceneError(
                f"{place}: object {draft.id!r} has NaN or infinite vertices; repair its mesh or "
                "its transform"
            )


def _plugin_inside(tree: Tree, bsdf: int | None) -> str:
    """The BSDF's plugin, inside `twosided`, masks and bent normals."""
    if bsdf is None:
        return "diffuse"
    inner = tree.children(bsdf, mi.ObjectType.BSDF)
    if tree.plugin(bsdf) in ("mask", "twosided", *BENDS) and inner:
        return _plugin_inside(tree, inner[0][1])
    return tree.plugin(bsdf)


def _registry_number(shape: Any) -> int:
    return int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0])


def _all_shapes(mi_scene: Any) -> list[Any]:
    """Every shape of a scene, those inside shape groups too."""
    found: list[Any] = []

    class Collect(mi.TraversalCallback):
        def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
            if isinstance(value, mi.Shape):
                found.append(value)
                value.traverse(Collect())

    mi_scene.traverse(Collect())
    return found
