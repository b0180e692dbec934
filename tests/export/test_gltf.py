"""glTF files: sound, readable by others, and the way back loses nothing that they hold."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import burnish
from burnish.app.export import Exported
from burnish.app.export.triangles import triangles
from burnish.app.opening import edits_for
from burnish.core.types import AnyArray
from burnish.materials.coefficients import conserved
from burnish.materials.reflectance import difference, reflectance, sample_directions
from burnish.scene import Scene, load
from tests.export.conftest import checks

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed to open files with")


def content(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the buffer of a GLB."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    document = json.loads(data[20 : 20 + size])
    return document, data[28 + size :]


@pytest.fixture(scope="module")
def exported(room: Scene, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return burnish.export(room, tmp_path_factory.mktemp("glb") / "room.glb")


def test_a_file_is_sound_and_opens_elsewhere(
    room: Scene, exported: Exported, tmp_path: Path
) -> None:
    written, place = exported, exported.files[0]
    document, blob = content(place)
    assert document["buffers"][0]["byteLength"] == len(blob)
    used: set[str] = set()
    for material in document["materials"]:
        used |= set(material.get("extensions", {}))
        pbr = material["pbrMetallicRoughness"]
        assert all(0 <= c <= 1 for c in pbr["baseColorFactor"])
        for name in ("metallicFactor", "roughnessFactor"):
            assert 0 <= pbr[name] <= 1
    assert used <= set(document["extensionsUsed"])
    for entry in document["accessors"]:
        view = document["bufferViews"][entry["bufferView"]]
        assert view["byteOffset"] % 4 == 0
        if "min" in entry:
            start = view["byteOffset"]
            values = np.frombuffer(blob[start : start + view["byteLength"]], "<f4").reshape(-1, 3)
            np.testing.assert_array_equal(entry["min"], values.min(axis=0))
            np.testing.assert_array_equal(entry["max"], values.max(axis=0))
    # And in a library by others: the same bounds as Mitsuba's scene
    opened = trimesh.load(str(place))
    assert set(opened.geometry) >= {"floor", "metal", "lamp"}
    bounds = room.mi_scene.bbox()
    np.testing.assert_allclose(opened.bounds, [list(bounds.min), list(bounds.max)], atol=1e-3)
    assert any("'constant'" in remark for remark in written.remarks)
    # With its buffer beside it
    beside = tmp_path / "room.gltf"
    burnish.export(room, beside)
    assert len(trimesh.load(str(beside)).geometry) == len(opened.geometry)


def test_what_the_format_holds_comes_back(room: Scene, tmp_path: Path) -> None:
    session = edits_for(room)
    edits = {
        "burley.specular.roughness": 0.2,
        "burley.specular.metallic": 0.7,
        "burley.specular.specular": 0.3,
        "burley.coat.clearcoat": 0.6,
        "burley.coat.clearcoat_gloss": 0.7,
        "burley.sheen.sheen": 0.25,
    }
    for path, value in edits.items():
        session.set(path, value)
    place = tmp_path / "room.glb"
    burnish.export(room, place, session.materials)
    scene = load(place)
    assert [item.id for item in scene.objects] == [item.id for item in room.objects]
    assert [view.name for view in scene.views] == [view.name for view in room.views]
    again = edits_for(scene)
    for path, value in edits.items():
        assert again.get(path) == pytest.approx(value, abs=1e-5), path
    assert not scene.warnings
    # Texels to 8 bits, in the same place of the surface
    si = mi.SurfaceInteraction3f()
    rng = np.random.default_rng(0)
    si.uv = mi.Point2f(*(mi.Float(c) for c in rng.random((2, 500), np.float32)))
    colours = [
        np.asarray(next(iter(s.object("burley").maps.values())).evaluate(si)) for s in (room, scene)
    ]
    np.testing.assert_allclose(colours[0], colours[1], atol=0.01)


def test_the_stated_error_is_that_of_what_comes_back(room: Scene, exported: Exported) -> None:
    again = load(exported.files[0])
    wi, wo, weight = sample_directions()
    for name in ("metal", "leaf"):
        (said,) = (remark for remark in exported.remarks if remark.startswith(f"{name}:"))
        found, true = again.object(name).material, room.object(name).material
        assert found is not None
        assert true is not None
        values = [
            reflectance(material, conserved(material, material.initial), wi, wo)
            for material in (true, found)
        ]
        stated = float(said.split("differs by ")[1].split(" %")[0])
        # Two digits are stated
        assert stated == pytest.approx(100 * difference(*values, weight).rms, rel=0.06)


T = mi.ScalarTransform4f
TURNED = T().rotate([0.6, 0, 0.8], 40)


@pytest.mark.parametrize(
    "shape",
    [
        {"type": "rectangle", "to_world": TURNED},
        {"type": "disk", "to_world": TURNED},
        {"type": "cylinder", "to_world": TURNED},
        {"type": "sphere", "center": [1, 2, 3], "radius": 0.5},
        {"type": "cube", "to_world": TURNED},
    ],
    ids=lambda shape: shape["type"],
)
def test_shapes_become_their_triangles(shape: dict[str, Any]) -> None:
    """Points, normals and texture coordinates are those that Mitsuba's rays find there."""
    scene = mi.load_dict({"type": "scene", "shape": shape})
    built = scene.shapes()[0]
    found = triangles(built, shape["type"])
    assert found is not None
    assert found.normals is not None or shape["type"] == "cube"
    corners = found.positions[found.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1).sum() / 2
    assert area == pytest.approx(float(np.ravel(built.surface_area())[0]), rel=2e-3)
    # Rays onto the middles of the triangles
    middle, outward = corners.mean(axis=1), across / np.linalg.norm(across, axis=1)[:, None]
    ray = mi.Ray3f(vector(middle + 0.05 * outward), vector(-outward))
    si = scene.ray_intersect(ray)
    assert np.asarray(si.is_valid()).all()
    np.testing.assert_allclose(np.asarray(si.p).T, middle, atol=2e-3)
    np.testing.assert_allclose(np.asarray(si.n).T, outward, atol=0.05)
    if found.uv is not None:
        uv = found.uv[found.faces].mean(axis=1)
        # Not across the pole, where one corner's azimuth is as good as another
        inner = (uv[:, 0] > 0.05) & (uv[:, 0] < 0.95) & (uv[:, 1] > 0.05) & (uv[:, 1] < 0.95)
        np.testing.assert_allclose(np.asarray(si.uv).T[inner], uv[inner], atol=0.01)


def vector(values: AnyArray) -> Any:
    return mi.Point3f(*(mi.Float(c) for c in values.T.astype(np.float32)))


def test_maps_of_roughness_masks_and_lights(tmp_path: Path) -> None:
    """What a scene has besides: each read again as it was."""
    raw = {**checks(tmp_path / "raw.png"), "raw": True}
    material = {"type": "principled", "base_color": raw | {"raw": False}, "metallic": raw}
    description: dict[str, Any] = {
        "type": "scene",
        "leaf": {"type": "sphere", "bsdf": {"type": "mask", "opacity": 0.4, "b": material}},
        "bulb": {"type": "point", "position": [1, 2, 3], "intensity": {"type": "rgb", "value": 2}},
        "beam": {
            "type": "spot",
            "to_world": T().look_at([0, 4, 1], [0, 0, 0], [0, 0, 1]),
            "intensity": 3.0,
            "cutoff_angle": 30.0,
        },
        "view": {
            "type": "perspective",
            "fov": 50,
            "to_world": T().look_at([3, 1, 4], [0, 0, 0], [0, 1, 0]),
        },
    }
    scene = load(description, resolution=(24, 16))
    place = tmp_path / "things.glb"
    assert burnish.export(scene, place).remarks == []
    again = load(place, resolution=(24, 16))
    item = again.object("leaf")
    assert item.editable
    assert item.wrapping.plugins[0]["opacity"] == pytest.approx(0.4)
    pictures = [
        np.array(mi.render(s.mi_scene, spp=64, seed=1, integrator=mi.load_dict({"type": "path"})))
        for s in (scene, again)
    ]
    assert np.linalg.norm(pictures[0] - pictures[1]) < 0.15 * np.linalg.norm(pictures[0])
    assert pictures[1].mean() == pytest.approx(pictures[0].mean(), rel=0.02)
