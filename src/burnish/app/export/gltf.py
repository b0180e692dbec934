"""A scene with edited materials as glTF 2.0.

Meshes, perspective cameras, point, spot and directional lights, area lights as emissive
materials. Materials are metallic-roughness with the extensions that burnish reads again
(specular, ior, clearcoat, sheen, emissive strength, texture transform): a `principled` in
numbers, others as the closest `principled`, whose error is measured and said.
"""

from __future__ import annotations

import io
import json
import struct
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
from PIL import Image

from burnish.app.export.files import Folder, Textures, linear_texels
from burnish.app.export.metallic import Surface, closest_surface, surface_of, tinted
from burnish.app.export.report import Exported
from burnish.app.export.triangles import triangles
from burnish.core.colour import srgb_from_linear
from burnish.core.types import AnyArray, Float64
from burnish.materials.coefficients import conserved
from burnish.materials.layer import MaterialState
from burnish.materials.lights import factors, placements
from burnish.materials.models.principled import ior_of_specular
from burnish.materials.openpbr import coat_roughness
from burnish.scene import Scene, SceneObject
from burnish.scene.reader import Fixed
from burnish.scene.tree import Tree
from burnish.scene.wrapping import Wrapping, unwrap
from burnish.transport.basis import State

Json = dict[str, Any]
_FLOAT, _INDEX = 5126, 5125


def write_gltf(scene: Scene, state: State, path: Path, binary: bool) -> Exported:
    """Write .glb, or .gltf with its buffer inside."""
    with tempfile.TemporaryDirectory(prefix="burnish-") as name:
        # Textures are embedded; the folder only holds what is evaluated on the way
        folder = Folder(Path(name) / "scene")
        mixed, placed = factors(scene.lights, state), placements(scene.lights, state)
        tree = scene.with_lights(mixed, Path(name), placed)
        if placed:
            scene = replace(scene, mi_scene=tree.build())
        writer = _Writer(scene, tree, folder)
        document = writer.document(state)
    content, blob = json.dumps(document), bytes(writer.blob)
    if binary:
        text = content.encode() + b" " * (-len(content.encode()) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(blob), b"BIN\0") + blob
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        return Exported([path], writer.remarks)
    beside = path.with_suffix(".bin")
    beside.write_bytes(blob)
    document["buffers"][0]["uri"] = beside.name
    path.write_text(json.dumps(document, indent=1), "utf-8")
    return Exported([path, beside], writer.remarks)


class _Writer:
    def __init__(self, scene: Scene, tree: Tree, folder: Folder) -> None:
        self.scene, self.tree, self.folder = scene, tree, folder
        self.blob = bytearray()
        self.remarks: list[str] = []
        self.lists: dict[str, list[Json]] = {}
        self.extensions: set[str] = set()
        self._pictures: dict[bytes, int] = {}

    def document(self, state: State) -> Json:
        """The JSON of the whole scene; `blob` is its buffer."""
        for item, draft in zip(self.scene.objects, self.scene.drafts, strict=True):
            self._object(item, draft.shapes, state.get(item.id))
        self._cameras()
        lights = self._lights()
        document: Json = {
            "asset": {"version": "2.0", "generator": "burnish"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self.lists.get("nodes", []))))}],
            **self.lists,
            "buffers": [{"byteLength": len(self.blob)}],
        }
        if lights:
            document["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
        if self.extensions:
            document["extensionsUsed"] = sorted(self.extensions)
        return document

    def add(self, kind: str, entry: Json) -> int:
        """Append to a top-level array; its index."""
        items = self.lists.setdefault(kind, [])
        items.append(entry)
        return len(items) - 1

    # -- meshes -----------------------------------------------------------------------------

    def _object(
        self, item: SceneObject, nodes: tuple[int, ...], state: MaterialState | None
    ) -> None:
        shapes = [self.scene.mi_scene.shapes()[i] for i in item.shapes]
        if not shapes:
            self.remarks.append(f"{item.id}: it lies in a shapegroup and is left out")
            return
        material: int | None = None
        primitives = []
        for shape, node in zip(shapes, nodes, strict=False):
            found = triangles(shape, self.tree.plugin(node))
            if found is None:
                kind = self.tree.plugin(node)
                self.remarks.append(f"{item.id}: a '{kind}' has no triangles and is left out")
                continue
            if material is None:
                material = self.add("materials", self._material(item, state, node))
            attributes = {"POSITION": self._accessor(found.positions, "VEC3", bounds=True)}
            if found.normals is not None:
                attributes["NORMAL"] = self._accessor(found.normals, "VEC3")
            if found.uv is not None:
                attributes["TEXCOORD_0"] = self._accessor(found.uv, "VEC2")
            indices = self._accessor(found.faces.reshape(-1, 1), "SCALAR")
            primitives.append({"attributes": attributes, "indices": indices, "material": material})
        if primitives:
            mesh = self.add("meshes", {"name": item.id, "primitives": primitives})
            self.add("nodes", {"name": item.id, "mesh": mesh})

    def _accessor(self, values: AnyArray, kind: str, bounds: bool = False) -> int:
        is_index = kind == "SCALAR"
        data = np.ascontiguousarray(values, "<u4" if is_index else "<f4")
        view = self._view(data.tobytes(), 34963 if is_index else 34962)
        entry: Json = {
            "bufferView": view,
            "componentType": _INDEX if is_index else _FLOAT,
            "count": len(data),
            "type": kind,
        }
        if bounds:
            entry |= {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        return self.add("accessors", entry)

    def _view(self, data: bytes, target: int | None = None) -> int:
        entry: Json = {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)}
        if target is not None:
            entry["target"] = target
        self.blob += data + b"\0" * (-len(data) % 4)
        return self.add("bufferViews", entry)

    # -- materials --------------------------------------------------------------------------

    def _material(self, item: SceneObject, state: MaterialState | None, node: int) -> Json:
        surface, wrapping = self._surface(item, state)
        result: Json = {"name": item.id, "doubleSided": item.two_sided}
        pbr: Json = {}
        colour, texture = self._colour(item, surface.base_color)
        pbr["baseColorFactor"] = [*colour, 1.0]
        extensions = self._extensions(item, surface)
        alpha = self._alpha(item, wrapping, texture)
        if isinstance(alpha, float):
            pbr["baseColorFactor"][3] = alpha
            if alpha < 1:
                result["alphaMode"] = "BLEND"
            if texture is not None:
                pbr["baseColorTexture"] = self._texture(item, texture, *_srgb(texture))
        else:
            result["alphaMode"] = "BLEND"
            pbr["baseColorTexture"] = self._texture(item, texture or alpha[0], alpha[1], "PNG")
        pbr |= self._metallic_roughness(item, surface)
        result["pbrMetallicRoughness"] = pbr
        for plugin in wrapping.plugins:
            if plugin["type"] == "normalmap":
                normal = plugin["normalmap"]
                result["normalTexture"] = self._texture(item, normal, _bytes(normal), "PNG")
            if plugin["type"] == "bumpmap":
                self.remarks.append(f"{item.id}: its bump map is left out: glTF takes normals")
        self._emission(item, node, result, extensions)
        if extensions:
            result["extensions"] = extensions
            self.extensions |= set(extensions)
        return result

    def _surface(self, item: SceneObject, state: MaterialState | None) -> tuple[Surface, Wrapping]:
        maps = {group: dict(found.description) for group, found in item.maps.items()}
        textures = Textures(self.folder, item.id, maps)
        if item.material is None:
            if "light" not in item.reason:
                self.remarks.append(f"{item.id}: {item.reason}; it is written as a grey surface")
            return Surface((0.5,) * 3, 0.0, 1.0), Wrapping()
        state = item.material.initial if state is None else state
        described = None if state.replacements else item.described(state)
        if described is not None:
            try:
                _, inner = unwrap(described)
            except Fixed:
                inner = described
            if inner["type"] == "principled":
                surface, lost = surface_of(inner)
                self.remarks += [f"{item.id}: {remark}" for remark in lost]
                base = textures.stock(surface.base_color)
                return tinted(surface, base), item.wrapping
        material = item.material.as_in(state)
        surface, off, more = closest_surface(material, conserved(material, state))
        said = f"{item.id}: the closest metallic-roughness surface differs by {off.words()}"
        self.remarks.append(f"{said}; {more}" if more else said)
        if surface.group in maps:
            surface = tinted(surface, textures([(surface.group, surface.base_color)]))
        return surface, item.wrapping

    def _colour(self, item: SceneObject, value: Any) -> tuple[list[float], Any]:
        """A factor and a texture's description, or None."""
        if not isinstance(value, Mapping):
            return [float(c) for c in value], None
        if value["type"] in ("rgb", "uniform"):
            numbers = np.broadcast_to(np.ravel(value["value"]), 3)
            return [float(c) for c in numbers], None
        if value["type"] != "bitmap":
            value = Textures(self.folder, item.id, {}).baked(value)
        return [1.0, 1.0, 1.0], value

    def _extensions(self, item: SceneObject, surface: Surface) -> Json:
        result: Json = {"KHR_materials_ior": {"ior": float(ior_of_specular(surface.specular))}}
        coat = surface.clearcoat
        if isinstance(coat, Mapping):
            self.remarks.append(f"{item.id}: the texture of its clearcoat is left out")
            coat = 0.0
        if coat > 0:
            result["KHR_materials_clearcoat"] = {
                "clearcoatFactor": float(coat),
                "clearcoatRoughnessFactor": coat_roughness(surface.clearcoat_gloss),
            }
        if surface.sheen > 0:
            result["KHR_materials_sheen"] = {"sheenColorFactor": [surface.sheen] * 3}
        return result

    def _alpha(
        self, item: SceneObject, wrapping: Wrapping, texture: Any
    ) -> float | tuple[Any, AnyArray]:
        """The mask's opacity: a number, or with its texture RGBA texels of the base colour."""
        for plugin in wrapping.plugins:
            if plugin["type"] != "mask":
                continue
            opacity = plugin.get("opacity", 0.5)
            if not isinstance(opacity, Mapping):
                return float(opacity)
            if opacity["type"] in ("rgb", "uniform"):
                return float(np.ravel(opacity["value"])[0])
            alpha = _numbers(opacity)
            if texture is None:
                colour = np.full((*alpha.shape, 3), 255, np.uint8)
            else:
                colour = _srgb(texture)[0]
                rows, columns = (
                    np.arange(n) * m // n
                    for n, m in zip(colour.shape[:2], alpha.shape, strict=True)
                )
                alpha = alpha[rows[:, None], columns[None]]
            return opacity, np.concatenate([colour, alpha[..., None]], axis=2)
        return 1.0

    def _metallic_roughness(self, item: SceneObject, surface: Surface) -> Json:
        parts = {"metallicFactor": surface.metallic, "roughnessFactor": surface.roughness}
        varying = {name: value for name, value in parts.items() if isinstance(value, Mapping)}
        result: Json = {
            name: 1.0 if name in varying else float(value) for name, value in parts.items()
        }
        if not varying:
            return result
        read = {name: _numbers(value) for name, value in varying.items()}
        height, width = max(values.shape for values in read.values())
        packed = np.full((height, width, 3), 255, np.uint8)
        for name, values in read.items():
            rows = np.arange(height) * values.shape[0] // height
            columns = np.arange(width) * values.shape[1] // width
            channel = 1 if name == "roughnessFactor" else 2
            packed[..., channel] = values[rows[:, None], columns[None]]
        first = next(iter(varying.values()))
        result["metallicRoughnessTexture"] = self._texture(item, first, packed, "PNG")
        return result

    def _emission(self, item: SceneObject, node: int, result: Json, extensions: Json) -> None:
        for _, emitter in self.tree.children(node, mi.ObjectType.Emitter):
            described = self.tree.as_dict(emitter)
            radiance = described.get("radiance", 1.0)
            if isinstance(radiance, Mapping) and radiance["type"] == "bitmap":
                result["emissiveFactor"] = [1.0, 1.0, 1.0]
                texels = _srgb(radiance)
                result["emissiveTexture"] = self._texture(item, radiance, *texels)
                continue
            colour = _constant(radiance)
            if colour is None:
                self.remarks.append(f"{item.id}: what it emits is left out: no colour holds it")
                continue
            strength = max(float(colour.max()), 1e-9)
            result["emissiveFactor"] = [float(c) for c in colour / strength]
            extensions["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}

    # -- pictures ---------------------------------------------------------------------------

    def _texture(self, item: SceneObject, described: Any, texels: AnyArray, kind: str) -> Json:
        file = io.BytesIO()
        Image.fromarray(texels).save(file, kind)
        data = file.getvalue()
        if data not in self._pictures:
            image = self.add(
                "images", {"bufferView": self._view(data), "mimeType": f"image/{kind.lower()}"}
            )
            self._pictures[data] = self.add("textures", {"source": image})
        result: Json = {"index": self._pictures[data]}
        if isinstance(described, Mapping) and "to_uv" in described:
            matrix = np.array(described["to_uv"].matrix, np.float64)
            if np.abs(matrix[[0, 1], [1, 0]]).max() > 1e-6:
                self.remarks.append(f"{item.id}: a turned texture is written unturned")
            transform = {
                "offset": [float(number) for number in matrix[:2, -1]],
                "scale": [float(matrix[0, 0]), float(matrix[1, 1])],
            }
            result["extensions"] = {"KHR_texture_transform": transform}
            self.extensions.add("KHR_texture_transform")
        return result

    # -- cameras and lights -----------------------------------------------------------------

    def _cameras(self) -> None:
        for view in self.scene.views:
            values = mi.traverse(view.sensor)
            if "x_fov" not in values:
                self.remarks.append(f"{view.name}: a camera that is not perspective is left out")
                continue
            width, height = (int(n) for n in view.sensor.film().size())
            across = np.tan(np.radians(float(np.ravel(values["x_fov"])[0])) / 2)
            lens = {
                "aspectRatio": width / height,
                "yfov": float(2 * np.arctan(across * height / width)),
                "znear": 0.01,
            }
            camera = self.add("cameras", {"type": "perspective", "perspective": lens})
            matrix = np.array(view.sensor.world_transform().matrix, np.float64)
            matrix = matrix.reshape(4, 4, -1)[..., 0] @ np.diag([-1.0, 1.0, -1.0, 1.0])
            self.add("nodes", {"name": view.name, "camera": camera, "matrix": _flat(matrix)})

    def _lights(self) -> list[Json]:
        lights: list[Json] = []
        for _, node in self.tree.children(0, mi.ObjectType.Emitter):
            described, name = self.tree.as_dict(node), self.tree.id(node)
            kind = described["type"]
            sent = described.get("irradiance" if kind == "directional" else "intensity", 1.0)
            colour = _constant(sent)
            if kind not in ("point", "spot", "directional") or colour is None:
                self.remarks.append(f"{name}: glTF has no light like '{kind}', which is left out")
                continue
            strength = max(float(colour.max()), 1e-9)
            light: Json = {"name": name, "type": kind, "intensity": strength}
            light["color"] = [float(c) for c in colour / strength]
            matrix = np.eye(4)
            if "to_world" in described:
                matrix = np.array(described["to_world"].matrix, np.float64)
            if "direction" in described:
                matrix = _looking(np.zeros(3), np.ravel(described["direction"]))
            if "position" in described:
                matrix[:3, 3] = np.ravel(described["position"])
            if kind == "spot":
                outer = np.radians(float(described.get("cutoff_angle", 20.0)))
                inner = described.get("beam_width", 0.75 * float(np.degrees(outer)))
                light["spot"] = {
                    "outerConeAngle": float(outer),
                    "innerConeAngle": float(np.radians(inner)),
                }
            if kind != "point" and "direction" not in described:
                # Mitsuba's light shines along +z, glTF's along −z
                matrix = matrix @ np.diag([-1.0, 1.0, -1.0, 1.0])
            lights.append(light)
            self.extensions.add("KHR_lights_punctual")
            extension = {"KHR_lights_punctual": {"light": len(lights) - 1}}
            self.add("nodes", {"name": name, "matrix": _flat(matrix), "extensions": extension})
        return lights


def _srgb(described: Mapping[str, Any]) -> tuple[AnyArray, str]:
    """A bitmap's colours as 8-bit sRGB texels, and the format to write them in."""
    linear = np.clip(linear_texels(described), 0.0, 1.0)
    return np.asarray(np.round(255 * srgb_from_linear(linear)), np.uint8), "PNG"


def _bytes(described: Mapping[str, Any]) -> AnyArray:
    """A raw bitmap's texels, linear in 8 bits: uint8 [height, width, 3]."""
    linear = np.clip(linear_texels({**described, "raw": True}), 0.0, 1.0)
    return np.asarray(np.round(255 * linear), np.uint8)


def _numbers(described: Mapping[str, Any]) -> AnyArray:
    """A texture's texels as the one number that Mitsuba reads of them: uint8 [height, width]."""
    plain = {name: value for name, value in described.items() if name != "to_uv"}
    width, height = mi.Bitmap(str(described["filename"])).size()
    x, y = np.meshgrid(*((np.arange(n, dtype=np.float32) + 0.5) / n for n in (width, height)))
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(mi.Float(x.ravel()), mi.Float(y.ravel()))
    values = np.clip(np.array(mi.load_dict(plain).eval_1(si)).reshape(height, width), 0.0, 1.0)
    return np.asarray(np.round(255 * values), np.uint8)


def _constant(value: Any) -> Float64 | None:
    """A constant colour, linear RGB, or None."""
    if isinstance(value, (int, float)):
        return np.full(3, float(value))
    if isinstance(value, Mapping) and value["type"] in ("rgb", "uniform"):
        return np.asarray(np.broadcast_to(np.ravel(value["value"]), 3), np.float64)
    return None


def _looking(place: Float64, direction: Float64) -> Float64:
    """A node's matrix whose −z is a direction."""
    z = -direction / max(float(np.linalg.norm(direction)), 1e-20)
    side = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = side, np.cross(z, side), z, place
    return matrix


def _flat(matrix: Float64) -> list[float]:
    """Column-major, as glTF has it."""
    return [float(number) for number in matrix.T.ravel()]
