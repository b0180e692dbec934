"""glTF and GLB files open, or say what is wrong with them."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from burnish.core.errors import BurnishError, MissingFile, SceneError
from burnish.scene import gltf_materials, load

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
FACES = np.array([0, 1, 2, 0, 2, 3], np.uint16)

# file: (objects, editable ones)
FILES = {
    "AnisotropyStrengthTest": (51, 8),
    "ClearCoatTest": (28, 27),
    "DamagedHelmet": (2, 1),
    "boombox": (2, 1),
}


def png(pixels: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


class File:
    """A GLB of one square, to be bent for each test."""

    def __init__(self, material: dict[str, Any] | None = None) -> None:
        self.blob = b""
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "name": "square"}],
            "meshes": [{"primitives": [{"attributes": {}, "indices": 2}]}],
            "accessors": [],
            "bufferViews": [],
            "materials": [material or {}],
        }
        for values, kind in ((SQUARE, "VEC3"), (UV, "VEC2"), (FACES, "SCALAR")):
            self.accessor(values, kind)
        primitive = self.json["meshes"][0]["primitives"][0]
        primitive["attributes"] = {"POSITION": 0, "TEXCOORD_0": 1}
        primitive["material"] = 0

    def view(self, data: bytes) -> int:
        self.json["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.blob), "byteLength": len(data)}
        )
        self.blob += data + b"\0" * (-len(data) % 4)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, kind: str) -> int:
        code = {"f": 5126, "u": 5123}[values.dtype.kind]
        view = self.view(values.tobytes())
        entry = {"bufferView": view, "componentType": code, "count": len(values), "type": kind}
        self.json["accessors"].append(entry)
        return len(self.json["accessors"]) - 1

    def texture(self, pixels: np.ndarray) -> dict[str, int]:
        image = {"bufferView": self.view(png(pixels)), "mimeType": "image/png"}
        self.json.setdefault("images", []).append(image)
        number = len(self.json["images"]) - 1
        self.json.setdefault("textures", []).append({"source": number})
        return {"index": number}

    def write(self, path: Path) -> Path:
        self.json["buffers"] = [{"byteLength": len(self.blob)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(self.blob), b"BIN\0") + self.blob
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        return path


@pytest.mark.parametrize("name", FILES)
def test_an_asset_opens(assets: Path, name: str) -> None:
    scene = load(assets / "gltf" / f"{name}.glb", resolution=(48, 32))
    assert (len(scene.objects), sum(item.editable for item in scene.objects)) == FILES[name]
    assert all(item.editable or item.reason for item in scene.objects)
    ray, _ = scene.view().sensor.sample_ray(
        0.0, 0.5, mi.Point2f(*np.random.default_rng(1).random((2, 4096), np.float32)), 0.5
    )
    assert 0.02 < np.asarray(scene.mi_scene.ray_intersect(ray).is_valid()).mean() < 0.9


def test_factors_become_principled(tmp_path: Path) -> None:
    file = File(
        {
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.8, 0.4, 0.2, 1],
                "metallicFactor": 0.25,
                "roughnessFactor": 0.3,
            },
            "extensions": {
                "KHR_materials_clearcoat": {"clearcoatFactor": 0.5},
                "KHR_materials_ior": {"ior": 1.4},
                "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.3, 0.2]},
            },
        }
    )
    item = load(file.write(tmp_path / "a.glb")).object("square")
    assert item.plugin == "principled"
    assert item.two_sided
    assert item.material is not None
    layers = item.material.initial.layers
    assert layers["diffuse"].values["color"] == pytest.approx((0.8, 0.4, 0.2), abs=1e-6)
    found = {**layers["specular"].values, **layers["sheen"].values, **layers["coat"].values}
    for name, value in {
        "metallic": 0.25,
        "roughness": 0.3,
        "sheen": 0.3,
        "clearcoat": 0.5,
        "clearcoat_gloss": 1.0,
        "specular": (0.4 / 2.4) ** 2 / 0.08,
    }.items():
        assert found[name] == pytest.approx(value, abs=1e-6), name


def test_textures_are_upright_and_channels_go_apart(tmp_path: Path) -> None:
    colour = np.zeros((2, 2, 3), np.uint8)
    colour[0] = (255, 0, 0)  # the upper row
    colour[1] = (0, 0, 255)
    packed = np.zeros((2, 2, 3), np.uint8)
    packed[..., 1] = 102
    packed[:, 0, 2] = 255
    file = File()
    file.json["materials"][0] = {
        "pbrMetallicRoughness": {
            "baseColorTexture": file.texture(colour),
            "metallicRoughnessTexture": file.texture(packed),
        }
    }
    scene = load(file.write(tmp_path / "a.glb"))
    item = scene.object("square")
    assert item.material is not None, item.reason
    assert item.material.initial.layers["specular"].values["roughness"] == pytest.approx(0.4)
    si = scene.mi_scene.ray_intersect(mi.Ray3f(mi.Point3f(0.5, 0.5, 2), mi.Vector3f(0, 0, -1)))
    # Above: red; to the right: no metal
    group = item.material.layer("diffuse").group
    value = np.asarray(item.maps[group].evaluate(si)).ravel()
    np.testing.assert_allclose(value, [1, 0, 0], atol=1e-3)


def test_transforms_cameras_and_lights(tmp_path: Path) -> None:
    file = File()
    file.json["nodes"] = [
        {"name": "top", "translation": [0, 0, -3], "scale": [2, 1, 1], "children": [1, 2, 3]},
        {"name": "square", "mesh": 0, "rotation": [0, 0, 0.5**0.5, 0.5**0.5]},
        {"name": "eye", "camera": 0, "translation": [0, 0, 3]},
        {
            "name": "lamp",
            "translation": [0, 1, 2],
            "extensions": {"KHR_lights_punctual": {"light": 0}},
        },
    ]
    file.json["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 0.8, "aspectRatio": 2.0}}
    ]
    file.json["extensions"] = {
        "KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 5.0, "color": [1, 0, 0]}]}
    }
    scene = load(file.write(tmp_path / "a.glb"))
    assert [view.name for view in scene.views] == ["eye"]
    assert (scene.views[0].width, scene.views[0].height) == (960, 480)
    shape = scene.mi_scene.shapes()[0]
    box = shape.bbox()
    np.testing.assert_allclose(np.asarray(box.min), [-2, -1, -3], atol=1e-5)
    np.testing.assert_allclose(np.asarray(box.max), [2, 1, -3], atol=1e-5)
    assert len(scene.mi_scene.emitters()) == 1
    # The camera at the origin looks along −z, x to its right
    ray, _ = scene.view().sensor.sample_ray(0.0, 0.5, mi.Point2f(0.75, 0.5), mi.Point2f(0.5))
    direction = np.asarray(ray.d).ravel()
    assert direction[2] < 0 < direction[0]


def broken(change: Any) -> File:
    file = File()
    change(file)
    return file


def _no_texture_file(file: File) -> None:
    file.json["images"] = [{"uri": "away.png"}]
    file.json["textures"] = [{"source": 0}]
    file.json["materials"][0] = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}


def _not_a_picture(file: File) -> None:
    file.json["images"] = [{"bufferView": 0}]
    file.json["textures"] = [{"source": 0}]
    file.json["materials"][0] = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}


def _nan(file: File) -> None:
    file.blob = struct.pack("<f", float("nan")) + file.blob[4:]


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        (lambda f: f.json["bufferViews"][0].update(byteLength=10**6), SceneError, "cut short"),
        (lambda f: f.json["bufferViews"][0].update(buffer=3), SceneError, r"no buffers\[3\]"),
        (lambda f: f.json["accessors"][0].update(count=400), SceneError, "beyond its buffer"),
        (lambda f: f.json["accessors"][0].update(sparse={}), SceneError, "sparse"),
        (
            lambda f: f.json.update(extensionsRequired=["KHR_draco_mesh_compression"]),
            SceneError,
            "requires KHR_draco",
        ),
        (lambda f: f.json["nodes"][0].update(children=[0]), SceneError, "below itself"),
        (lambda f: f.json["asset"].update(version="1.0"), SceneError, "reads 2.0"),
        (lambda f: f.json.update(nodes=[{}]), SceneError, "no triangles"),
        (_no_texture_file, MissingFile, "away.png"),
        (_not_a_picture, SceneError, "not a picture"),
        (_nan, SceneError, "'square' has NaN"),
    ],
)
def test_bad_files_are_named(
    tmp_path: Path, change: Any, kind: type[BurnishError], message: str
) -> None:
    with pytest.raises(kind, match=message):
        load(broken(change).write(tmp_path / "a.glb"))


def test_missing_buffers_and_half_files(tmp_path: Path) -> None:
    whole = File().write(tmp_path / "a.glb").read_bytes()
    (tmp_path / "b.glb").write_bytes(whole[: len(whole) - 40])
    with pytest.raises(SceneError, match="cut short"):
        load(tmp_path / "b.glb")
    file = File()
    file.json["buffers"] = [{"byteLength": 10, "uri": "gone.bin"}]
    (tmp_path / "c.gltf").write_text(json.dumps(file.json))
    with pytest.raises(MissingFile, match=r"gone\.bin"):
        load(tmp_path / "c.gltf")
    (tmp_path / "d.gltf").write_text("{}")
    with pytest.raises(SceneError, match="not a glTF file"):
        load(tmp_path / "d.gltf")
    with pytest.raises(MissingFile, match="check the path"):
        load(tmp_path / "e.glb")


def test_degenerate_triangles_are_left_out_with_a_warning(tmp_path: Path) -> None:
    file = File()
    file.json["meshes"][0]["primitives"][0]["indices"] = file.accessor(
        np.array([0, 1, 2, 1, 1, 2], np.uint16), "SCALAR"
    )
    scene = load(file.write(tmp_path / "a.glb"))
    assert scene.mi_scene.shapes()[0].face_count() == 1
    assert scene.warnings == ("1 triangles of 'square' without an area are left out",)


def test_a_large_texture_is_scaled_down_and_a_huge_one_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = File()
    strip = np.zeros((4, 16384, 3), np.uint8)
    file.json["materials"][0] = {"pbrMetallicRoughness": {"baseColorTexture": file.texture(strip)}}
    place = file.write(tmp_path / "a.glb")
    # Pillow takes large pictures for an attack
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    scene = load(place)
    assert scene.warnings == ("images[0] of 16384 × 4 pixels is scaled down to 8192",)
    assert Image.MAX_IMAGE_PIXELS == 1000
    monkeypatch.setattr(gltf_materials, "MOST_PIXELS", 16384)
    with pytest.raises(SceneError, match=r"16384 × 4 pixels, more than can be read.*scale it down"):
        load(place)


def test_what_glows_in_places_is_edited_like_any_other(tmp_path: Path) -> None:
    """An emissive texture is light that a surface sends besides what it reflects."""
    glow = np.zeros((4, 4, 3), np.uint8)
    glow[0, 0] = 255
    file = File({"emissiveFactor": [1.0, 1.0, 1.0]})
    file.json["materials"][0]["emissiveTexture"] = file.texture(glow)
    item = load(file.write(tmp_path / "a.glb")).object("square")
    assert item.editable, item.reason
    plain = load(File({"emissiveFactor": [1.0, 1.0, 1.0]}).write(tmp_path / "b.glb"))
    assert plain.object("square").reason == "it is a light"
