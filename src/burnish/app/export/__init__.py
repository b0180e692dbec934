"""Edited materials in the formats that renderers read: see `export`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from burnish.app.export.report import Exported
from burnish.core.errors import CannotWrite, InvalidValue, MissingFile, UnknownName
from burnish.materials.layer import MaterialState
from burnish.materials.lights import lights_in, without_lights

if TYPE_CHECKING:
    from burnish.scene import Scene, SceneObject

FORMATS: Mapping[str, str] = {
    ".xml": "mitsuba",
    ".mtlx": "materialx",
    ".glb": "glb",
    ".gltf": "gltf",
    ".binary": "merl",
}
"""Format by suffix."""


def format_of(path: str | Path, asked: str | None = None) -> str:
    """The format asked for, or that of a file's suffix. Raises InvalidValue."""
    if asked is not None:
        if asked not in FORMATS.values():
            raise InvalidValue(
                f"--format must be one of {', '.join(FORMATS.values())}; got {asked!r}"
            )
        return asked
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise InvalidValue(
            f"{path}: the format follows from the suffix, one of {', '.join(FORMATS)}; use one "
            "of them or say --format"
        )
    return FORMATS[suffix]


def export(
    scene: Scene,
    path: str | Path,
    state: Mapping[str, MaterialState] | None = None,
    *,
    format: str | None = None,
    objects: Sequence[str] | None = None,
    plugin: bool = False,
) -> Exported:
    """Write a scene, or its materials, as they are in a state.

    state: a session's `materials`; the scene's own without it. format: "mitsuba", "materialx",
    "glb", "gltf" or "merl"; by the suffix without it. objects: whose materials are written, all
    that are editable without it; Mitsuba XML and glTF hold the whole scene in any case. plugin:
    let Mitsuba XML name burnish's own BSDF where no stock one holds a material.
    Raises InvalidValue, UnknownName, MissingFile, CannotWrite.
    """
    place, kind = Path(path), format_of(path, format)
    if not place.parent.is_dir():
        raise MissingFile(
            f"output folder {str(place.parent)!r} does not exist; make it first: "
            f"mkdir -p {place.parent}"
        )
    if scene.source is not None and place.exists() and place.samefile(scene.source):
        raise InvalidValue(f"{path} is the scene itself; export to another name")
    if plugin and kind != "mitsuba":
        raise InvalidValue("--plugin is for Mitsuba XML alone; leave it out")
    chosen = _chosen(scene, state or {}, objects)
    if not chosen and kind in ("materialx", "merl"):
        raise InvalidValue(f"{scene.name} has no editable material to write; see burnish info")
    lights = lights_in(state or {})
    try:
        result = _write(scene, chosen, {**chosen, **lights}, place, kind, plugin)
    except OSError as error:
        raise CannotWrite(
            f"{error.filename or path}: cannot be written ({error.strerror or error})"
        ) from error
    for object_id, own in chosen.items():
        if own.strokes:
            result.remarks.append(f"{object_id}: what was painted on it is left out")
    if lights and kind in ("materialx", "merl"):
        result.remarks.append("the lights are left out: the format holds materials alone")
    return result


def _chosen(
    scene: Scene, state: Mapping[str, MaterialState], objects: Sequence[str] | None
) -> dict[str, MaterialState]:
    """The states to write, by object, in the scene's order."""
    found = {}
    items = [item for item in scene.objects if item.editable]
    for item in items if objects is None else scene.editable(objects):
        assert item.material is not None
        found[item.id] = state.get(item.id, item.material.initial)
    for object_id in without_lights(state):
        if object_id not in {item.id for item in scene.objects}:
            raise UnknownName("object", object_id, [item.id for item in scene.objects])
    return found


def _write(
    scene: Scene,
    chosen: Mapping[str, MaterialState],
    state: Mapping[str, MaterialState],
    place: Path,
    kind: str,
    plugin: bool,
) -> Exported:
    pairs: list[tuple[SceneObject, MaterialState]] = [
        (scene.object(object_id), own) for object_id, own in chosen.items()
    ]
    if kind == "mitsuba":
        from burnish.app.export.mitsuba_xml import write_xml

        return write_xml(scene, state, place, plugin)
    if kind == "materialx":
        from burnish.app.export.materialx import write_materialx

        return write_materialx(pairs, place)
    if kind == "merl":
        from burnish.app.export.merl import write_tables

        return write_tables(pairs, place)
    from burnish.app.export.gltf import write_gltf

    return write_gltf(scene, state, place, binary=kind == "glb")


__all__ = ["FORMATS", "Exported", "export", "format_of"]
