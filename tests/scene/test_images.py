"""Mitsuba's textures as pictures that can be edited, and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from burnish.materials.images import ImageMap, Texels
from burnish.scene.adapters import adapt
from burnish.scene.device import activate
from burnish.scene.images import described, image_of


@pytest.fixture(autouse=True, scope="module")
def _variant() -> None:
    activate()


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("images") / "a.png"
    pixels = np.random.default_rng(1).integers(0, 256, (5, 7, 3), np.uint8)
    Image.fromarray(pixels).save(path)
    return str(path)


def evaluated(texture: dict[str, Any], uv: np.ndarray, colour: bool) -> np.ndarray:
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(*uv.T.astype(np.float32))
    plugin = mi.load_dict(texture)
    value = mi.Color3f(plugin.eval(si)) if colour else plugin.eval_1(si)
    return np.asarray(value, np.float64).reshape(3 if colour else 1, -1).T


@pytest.mark.parametrize("colour", [True, False])
@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
@pytest.mark.parametrize("raw", [True, False])
def test_a_bitmap_shows_what_mitsuba_s_shows(
    picture: str, colour: bool, wrap: str, raw: bool
) -> None:
    turned = mi.ScalarTransform4f().rotate([0, 0, 1], 30).scale([2, 0.7, 1])
    texture = {
        "type": "bitmap", "filename": picture, "raw": raw, "wrap_mode": wrap, "to_uv": turned,
    }  # fmt: skip
    uv = np.random.default_rng(2).uniform(-1.5, 2.5, (200, 2))
    image = image_of(texture, colour)
    assert image.texels.values.shape[:2] == (5, 7)
    # Half precision of Mitsuba's texels, single of the coordinates
    expected = evaluated(texture, uv, colour)
    np.testing.assert_allclose(image.raw(uv), expected, atol=2e-3)
    np.testing.assert_allclose(evaluated(described(image), uv, colour), expected, atol=2e-3)
    edited = replace(image, scale=0.5, offset=0.2)
    np.testing.assert_allclose(
        evaluated(described(edited), uv, colour), 0.5 * expected + 0.2, atol=2e-3
    )


def test_other_textures_become_pictures() -> None:
    texture = {
        "type": "checkerboard",
        "color0": {"type": "rgb", "value": [0.1, 0.5, 0.9]},
        "color1": {"type": "rgb", "value": 0.8},
    }
    image = image_of(texture, colour=True)
    uv = np.random.default_rng(2).random((200, 2))
    # Away from the edges between its squares, which a picture blurs
    inner = (np.abs((uv * 4) % 1 - 0.5) < 0.45).all(axis=1)
    np.testing.assert_allclose(image.raw(uv[inner]), evaluated(texture, uv[inner], True), atol=1e-5)


def test_a_textured_alpha_is_edited(picture: str) -> None:
    texture = {"type": "bitmap", "filename": picture, "raw": True}
    adapted = adapt({"type": "roughconductor", "alpha": texture})
    assert adapted.material is not None, adapted.reason
    initial = adapted.material.initial
    image = initial.images["specular", "roughness"]
    assert adapted.material.varies(initial)
    assert initial.layers["specular"].values["roughness"] == pytest.approx(image.mean[0])
    assert adapted.describe is not None
    plain = adapted.describe(initial)
    assert plain is not None
    assert plain["alpha"]["filename"] == picture
    other = replace(initial, images={("specular", "roughness"): replace(image, scale=0.5)})
    found = adapted.describe(other)
    assert found is not None
    assert Path(found["alpha"]["filename"]).suffix == ".exr"
    flat = adapted.describe(replace(initial, images={}))
    assert flat is not None
    assert flat["alpha"] == pytest.approx(image.mean[0])


@pytest.mark.parametrize("shape", [(2, 6, 1), (6, 2, 1), (2, 2, 3), (4, 1, 3)])
def test_pictures_of_the_same_numbers_are_told_apart_by_their_shape(
    shape: tuple[int, int, int],
) -> None:
    values = np.linspace(0.0, 1.0, 12, dtype=np.float32).reshape(shape)
    name = described(ImageMap(Texels(values)))["filename"]
    bitmap = np.asarray(mi.Bitmap(name)).reshape(*np.asarray(mi.Bitmap(name)).shape[:2], -1)
    np.testing.assert_array_equal(bitmap, values)
