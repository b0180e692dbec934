"""glTF 2.0 and GLB files as Mitsuba dictionaries.

Metallic-roughness materials become `principled`; meshes and textures are written beside each
other into a working folder, transforms applied. A file without a camera is looked at from the
front, and one with neither lights nor a mesh that emits one colour gets a soft light from above
and a grey surround.

Approximate, because `principled` has its own form: KHR_materials_clearcoat (its lobe is
Burley's, and reflects a quarter), KHR_materials_sheen (its strongest channel), specularFactor (as a
smaller F0). Left out, with a warning: vertex colours, second texture coordinates, occlusion.
"""

from __future__ import annotations

import json
import struct
from base64 import b64decode
from binascii import Error as Base64Error
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import mitsuba as mi
import numpy as np

from burnish.core.errors import MissingFile, SceneError
from burnish.core.types import AnyArray, Float64
from burnish.scene.gltf_materials import Materials
from burnish.scene.tree import UniqueNames

KNOWN = {
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_texture_transform",
    "KHR_mesh_quantization",
}
"""Extensions that a file may require."""

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass
class Document:
    """A parsed file: its JSON, and its buffers as they are asked for."""

    path: Path
    json: Mapping[str, Any]
    blob: bytes | None
    _buffers: dict[int, bytes] = field(default_factory=dict)

    @staticmethod
    def read(path: Path) -> Document:
        """Read .gltf or .glb. Raises MissingFile, SceneError."""
        if not path.is_file():
            raise MissingFile(f"no scene file {str(path)!r}; check the path")
        data, blob = path.read_bytes(), None
        if data[:4] == b"glTF":
            data, blob = _chunks(path, data)
        try:
            content = json.loads(data)
            version = str(content["asset"]["version"])
        except (ValueError, KeyError, TypeError):
            raise SceneError(f"{path}: not a glTF file; export it anew") from None
        if not version.startswith("2"):
            raise SceneError(f"{path}: glTF {version}; burnish reads 2.0, so export it anew")
        for name in content.get("extensionsRequired", ()):
            if name not in KNOWN:
                raise SceneError(f"{path}: it requires {name}; export it without that extension")
        return Document(path, content, blob)

    def items(self, kind: str) -> list[Any]:
        """A top-level array, such as "meshes"."""
        return list(self.json.get(kind, ()))

    def item(self, kind: str, index: int) -> Any:
        """One entry of a top-level array. Raises SceneError."""
        items = self.json.get(kind, ())
        if not 0 <= index < len(items):
            raise SceneError(f"{self.path}: there is no {kind}[{index}]; export the file anew")
        return items[index]

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view. Raises MissingFile, SceneError."""
        view = self.item("bufferViews", index)
        data = self._buffer(int(view["buffer"]))
        start = int(view.get("byteOffset", 0))
        stop = start + int(view["byteLength"])
        if stop > len(data):
            raise SceneError(
                f"{self.path}: bufferViews[{index}] ends at byte {stop} of a buffer of "
                f"{len(data)}; the file is cut short, so export it anew"
            )
        return data[start:stop]

    def uri(self, uri: str, what: str) -> bytes:
        """What a data URI holds, or the file that it names. Raises MissingFile, SceneError."""
        if uri.startswith("data:"):
            try:
                return b64decode(uri.partition(",")[2], validate=True)
            except Base64Error:
                raise SceneError(f"{self.path}: {what} is broken base64; export it anew") from None
        file = self.path.parent / unquote(uri)
        if not file.is_file():
            raise MissingFile(f"{self.path}, {what}: no file {uri!r}; put it beside the scene")
        return file.read_bytes()

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self.item("buffers", index).get("uri")
            if uri is None and (self.blob is None or index != 0):
                raise SceneError(
                    f"{self.path}: buffers[{index}] is missing: it has no uri and the file holds "
                    "no binary chunk; export the file anew"
                )
            self._buffers[index] = (
                self.uri(uri, f"buffers[{index}]") if uri is not None else self.blob or b""
            )
        return self._buffers[index]

    def accessor(self, index: int) -> AnyArray:
        """An accessor's numbers: [count, width], normalised integers as floats."""
        accessor = self.item("accessors", index)
        if "sparse" in accessor:
            raise SceneError(f"{self.path}: accessors[{index}] is sparse; export without sparse")
        try:
            kind = np.dtype(_TYPES[accessor["componentType"]])
            width, count = _WIDTHS[accessor["type"]], int(accessor["count"])
        except KeyError:
            raise SceneError(f"{self.path}: accessors[{index}] has an unknown type") from None
        if "bufferView" not in accessor:
            return np.zeros((count, width))
        data = self.view(int(accessor["bufferView"]))
        size = kind.itemsize * width
        stride = int(self.item("bufferViews", accessor["bufferView"]).get("byteStride", size))
        start = int(accessor.get("byteOffset", 0))
        if count and start + (count - 1) * stride + size > len(data):
            raise SceneError(
                f"{self.path}: accessors[{index}] reaches beyond its buffer; export the file anew"
            )
        values = np.ndarray((count, width), kind, data, start, (stride, kind.itemsize)).copy()
        if accessor.get("normalized") and kind.kind in "iu":
            return np.maximum(values / np.iinfo(kind).max, -1.0)
        return values


def _chunks(path: Path, data: bytes) -> tuple[bytes, bytes | None]:
    """The JSON and binary chunks of a GLB file."""
    position, found = 12, {}
    while position + 8 <= len(data):
        length, kind = struct.unpack_from("<I4s", data, position)
        if position + 8 + length > len(data):
            raise SceneError(f"{path}: the file is cut short; export it anew")
        found[kind] = data[position + 8 : position + 8 + length]
        position += 8 + length
    if b"JSON" not in found:
        raise SceneError(f"{path}: the GLB holds no JSON; export it anew")
    return found[b"JSON"], found.get(b"BIN\0")


def describe(path: Path, folder: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The Mitsuba dictionary of a file, and warnings, one line each.

    folder: where meshes and textures are written; they are read whenever the scene is built.
    Raises MissingFile, SceneError.
    """
    return _Builder(Document.read(path), folder).build()


class _Builder:
    def __init__(self, document: Document, folder: Path) -> None:
        self.document = document
        self.folder = folder
        self.warnings: list[str] = []
        self.materials = Materials(document, folder, self.warnings)
        self.unique = UniqueNames()
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)

    def build(self) -> tuple[dict[str, Any], tuple[str, ...]]:
        scene: dict[str, Any] = {"type": "scene"}
        lit = False
        for node, matrix in self._nodes():
            if "mesh" in node:
                shapes = dict(self._shapes(node, matrix))
                lit |= any(_is_lamp(shape) for shape in shapes.values())
                scene |= shapes
            if "camera" in node:
                camera = self._camera(self.document.item("cameras", node["camera"]), matrix)
                scene[self._name(node.get("name"), "camera")] = camera
            light = node.get("extensions", {}).get("KHR_lights_punctual")
            if light is not None:
                scene[self._name(node.get("name"), "light")] = self._light(light["light"], matrix)
                lit = True
        if not np.isfinite(self.low).all():
            raise SceneError(f"{self.document.path}: the scene has no triangles")
        if not any(value.get("type") == "perspective" for value in _plugins(scene)):
            scene["camera"] = self._default_camera()
        if not lit:
            scene |= self._default_light()
        return scene, tuple(dict.fromkeys(self.warnings))

    # -- nodes ----------------------------------------------------------------------------

    def _nodes(self) -> Iterator[tuple[Mapping[str, Any], Float64]]:
        """Every node of the scene with its transform to the world."""
        document = self.document
        scenes = document.items("scenes")
        if scenes:
            roots = document.item("scenes", int(document.json.get("scene", 0))).get("nodes", ())
        else:
            roots = range(len(document.items("nodes")))
        waiting = [(int(index), np.eye(4), 0) for index in reversed(list(roots))]
        while waiting:
            index, parent, depth = waiting.pop()
            if depth > 200:
                raise SceneError(f"{document.path}: nodes[{index}] lies below itself")
            node = document.item("nodes", index)
            matrix = parent @ _matrix(node)
            yield node, matrix
            children = reversed(node.get("children", ()))
            waiting += [(int(child), matrix, depth + 1) for child in children]

    def _name(self, *candidates: str | None) -> str:
        given = next(name for name in candidates if name)
        return self.unique("".join("_" if c in "./\\ " else c for c in given))

    # -- meshes ---------------------------------------------------------------------------

    def _shapes(
        self, node: Mapping[str, Any], matrix: Float64
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        mesh = self.document.item("meshes", node["mesh"])
        for primitive in mesh["primitives"]:
            name = self._name(node.get("name"), mesh.get("name"), f"mesh_{node['mesh']}")
            if primitive.get("mode", 4) != 4:
                self.warnings.append(f"{name!r} is made of points, lines or strips and is left out")
                continue
            file = self._write(name, primitive, matrix)
            if file is None:
                self.warnings.append(f"{name!r} has no triangle with an area and is left out")
                continue
            bsdf, emission = self.materials.describe(primitive.get("material"))
            shape: dict[str, Any] = {"type": "ply", "filename": str(file), "bsdf": bsdf}
            if "NORMAL" not in primitive["attributes"]:
                shape["face_normals"] = True
            if emission is not None:
                shape["emitter"] = {"type": "area", "radiance": emission}
            yield name, shape

    def _write(self, name: str, primitive: Mapping[str, Any], matrix: Float64) -> Path | None:
        """A primitive as a PLY file in world space."""
        attributes = primitive["attributes"]
        if "POSITION" not in attributes:
            return None
        local = self.document.accessor(attributes["POSITION"]).astype(np.float64)
        if not np.isfinite(local).all():
            raise SceneError(
                f"{self.document.path}: mesh {name!r} has NaN or infinite vertices; repair it"
            )
        if "COLOR_0" in attributes:
            self.warnings.append(f"the vertex colours of {name!r} are left out")
        columns = [local @ matrix[:3, :3].T + matrix[:3, 3]]
        names = ["x", "y", "z"]
        if "NORMAL" in attributes:
            normal = self.document.accessor(attributes["NORMAL"]) @ np.linalg.pinv(matrix[:3, :3])
            length = np.linalg.norm(normal, axis=1, keepdims=True)
            columns.append(normal / np.maximum(length, 1e-20))
            names += ["nx", "ny", "nz"]
        if "TEXCOORD_0" in attributes:
            columns.append(self.document.accessor(attributes["TEXCOORD_0"]))
            names += ["u", "v"]
        if "indices" in primitive:
            corner = self.document.accessor(primitive["indices"]).astype(np.int64).ravel()
        else:
            corner = np.arange(len(local))
        faces = corner[: len(corner) // 3 * 3].reshape(-1, 3)
        if faces.size and (faces.max() >= len(local) or faces.min() < 0):
            raise SceneError(f"{self.document.path}: mesh {name!r} has indices beyond its vertices")
        corners = columns[0][faces]
        area = np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        )
        if (area == 0).any():
            self.warnings.append(
                f"{int((area == 0).sum())} triangles of {name!r} without an area are left out"
            )
            faces = faces[area > 0]
        if not len(faces):
            return None
        if np.linalg.det(matrix[:3, :3]) < 0:
            faces = faces[:, ::-1]
        used = columns[0][np.unique(faces)]
        self.low, self.high = (
            np.minimum(self.low, used.min(axis=0)),
            np.maximum(self.high, used.max(axis=0)),
        )
        path = self.folder / f"{len(list(self.folder.glob('*.ply')))}.ply"
        write_ply(path, names, np.concatenate(columns, axis=1), faces)
        return path

    # -- cameras and lights ---------------------------------------------------------------

    def _camera(self, camera: Mapping[str, Any], matrix: Float64) -> dict[str, Any]:
        if camera["type"] != "perspective":
            self.warnings.append("an orthographic camera is taken for one of 45 degrees")
        lens = camera.get("perspective", {})
        # glTF's camera looks along −z with x to the right, Mitsuba's along +z with x to the left
        rotation = matrix.copy()
        rotation[:3, :3] /= np.maximum(np.linalg.norm(rotation[:3, :3], axis=0), 1e-20)
        turned = rotation @ np.diag([-1.0, 1.0, -1.0, 1.0])
        aspect = float(lens.get("aspectRatio", 1.5))
        return _perspective(turned, np.degrees(lens.get("yfov", np.pi / 4)), aspect)

    def _default_camera(self) -> dict[str, Any]:
        centre, radius = (self.low + self.high) / 2, self._radius()
        eye = centre + radius * 2.5 * _unit([0.35, 0.3, 1.0])
        matrix = mi.ScalarTransform4f().look_at(list(eye), list(centre), [0, 1, 0]).matrix
        return _perspective(np.array(matrix, np.float64), 40.0, 1.5)

    def _default_light(self) -> dict[str, Any]:
        centre, radius = (self.low + self.high) / 2, self._radius()
        place = centre + radius * 4 * _unit([-0.6, 1.0, 0.7])
        frame = mi.ScalarTransform4f().look_at(list(place), list(centre), [0, 0, 1])
        return {
            "key_light": {
                "type": "rectangle",
                "to_world": frame @ mi.ScalarTransform4f().scale(1.2 * radius),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 8.0}},
            },
            "surround": {"type": "constant", "radiance": {"type": "rgb", "value": 0.5}},
        }

    def _radius(self) -> float:
        return max(float(np.linalg.norm(self.high - self.low)) / 2, 1e-6)

    def _light(self, index: int, matrix: Float64) -> dict[str, Any]:
        lights = self.document.json.get("extensions", {}).get("KHR_lights_punctual", {})
        try:
            light = lights["lights"][index]
        except (KeyError, IndexError):
            raise SceneError(f"{self.document.path}: there is no light {index}") from None
        strength = np.asarray(light.get("color", (1, 1, 1))) * light.get("intensity", 1.0)
        colour = {"type": "rgb", "value": [float(c) for c in strength]}
        direction = -matrix[:3, 2] / max(float(np.linalg.norm(matrix[:3, 2])), 1e-20)
        place = [float(x) for x in matrix[:3, 3]]
        if light["type"] == "directional":
            return {"type": "directional", "direction": list(direction), "irradiance": colour}
        if light["type"] == "point":
            return {"type": "point", "position": place, "intensity": colour}
        spot = light.get("spot", {})
        outer, inner = spot.get("outerConeAngle", np.pi / 4), spot.get("innerConeAngle", 0.0)
        up = [1, 0, 0] if abs(direction[1]) > 0.9 else [0, 1, 0]
        target = [float(x) for x in matrix[:3, 3] + direction]
        return {
            "type": "spot",
            "to_world": mi.ScalarTransform4f().look_at(place, target, up),
            "intensity": colour,
            "cutoff_angle": float(np.degrees(outer)),
            "beam_width": float(np.degrees(min(inner, 0.99 * outer))),
        }


def write_ply(path: Path, names: list[str], vertices: Float64, faces: AnyArray) -> None:
    """A binary PLY file of triangles; vertices float64 [n, names], faces [m, 3]."""
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    body = np.ascontiguousarray(vertices, "<f4").tobytes() + rows.tobytes()
    path.write_bytes("\n".join([*header, ""]).encode() + body)


def _plugins(scene: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [value for value in scene.values() if isinstance(value, Mapping)]


def _is_lamp(shape: Mapping[str, Any]) -> bool:
    """Whether a shape lights its surroundings: it emits one colour, not a texture of details."""
    radiance = shape.get("emitter", {}).get("radiance", {})
    return radiance.get("type") == "rgb"


def _perspective(matrix: Float64, vertical: float, aspect: float) -> dict[str, Any]:
    height = 480
    return {
        "type": "perspective",
        "fov": float(vertical),
        "fov_axis": "y",
        "to_world": mi.ScalarTransform4f(matrix),
        "film": {"type": "hdrfilm", "width": max(1, round(height * aspect)), "height": height},
    }


def _unit(vector: list[float]) -> Float64:
    return np.asarray(vector) / float(np.linalg.norm(vector))


def _matrix(node: Mapping[str, Any]) -> Float64:
    """A node's transform, from its matrix or from translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, :3] *= np.asarray(node.get("scale", (1.0, 1.0, 1.0)), np.float64)
    result[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return result
