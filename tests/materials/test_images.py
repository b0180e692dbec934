"""Pictures in place of parameters: how they lie, are read and kept, and what rows make of them."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from burnish.core.colour import srgb_from_linear
from burnish.core.errors import InvalidValue, MissingFile
from burnish.core.types import Float32, Float64
from burnish.materials.coefficients import albedo, coefficients
from burnish.materials.images import ImageMap, Texels
from burnish.materials.images.files import read_texels
from burnish.materials.images.image import Placement, placed
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.cook_torrance import CookTorrance
from burnish.materials.models.lambert import Lambert
from burnish.materials.painting.canvas import Canvas
from burnish.materials.painting.varied import VariedMaterial, VariedObject
from burnish.materials.registry import state_from_json, state_to_json

RNG = np.random.default_rng(5)


def picture(height: int = 3, width: int = 4, channels: int = 1) -> Texels:
    return Texels(RNG.random((height, width, channels)).astype(np.float32))


def test_texel_centres_have_their_texels_values() -> None:
    texels = picture()
    v, u = np.meshgrid((np.arange(3) + 0.5) / 3, (np.arange(4) + 0.5) / 4, indexing="ij")
    found = ImageMap(texels).raw(np.stack([u, v], axis=-1))
    np.testing.assert_allclose(found, texels.values, atol=1e-6)


@pytest.mark.parametrize("smooth", [True, False])
def test_repeating_and_mirroring_continue_a_picture(smooth: bool) -> None:
    texels = picture()
    uv, far = RNG.random((64, 2)), np.array([2, -3])
    inside = ImageMap(texels, smooth=smooth).raw(uv)
    np.testing.assert_allclose(ImageMap(texels, smooth=smooth).raw(uv + far), inside, atol=2e-6)
    mirror = ImageMap(texels, wrap="mirror", smooth=smooth)
    np.testing.assert_allclose(mirror.raw(uv + far * [1, 0]), mirror.raw(uv), atol=2e-6)
    np.testing.assert_allclose(mirror.raw(uv * [-1, 1]), mirror.raw(uv), atol=2e-6)
    clamp = ImageMap(texels, wrap="clamp", smooth=smooth)
    np.testing.assert_allclose(clamp.raw(np.array([[9.0, 9.0]]))[0], texels.values[-1, -1])


def test_a_quarter_turn_about_the_middle_moves_corners_to_corners() -> None:
    texels = picture(4, 4)
    turned = ImageMap(texels, transform=placed(rotate=90.0), smooth=False)
    corner = np.array([[0.1, 0.1]])
    ours = turned.raw(corner)
    corners = [texels.values[y, x] for y, x in ((0, -1), (-1, 0))]
    assert any(np.array_equal(ours[0], value) for value in corners)
    back = ImageMap(texels, transform=placed(rotate=360.0), smooth=False)
    np.testing.assert_array_equal(back.raw(corner)[0], texels.values[0, 0])


@pytest.mark.parametrize("repeat", [(1.0, 1.0), (4.0, 0.5), (2.0, -1.0)])
@pytest.mark.parametrize("rotate", [0.0, 30.0, -135.0])
def test_a_placement_is_found_again(repeat: tuple[float, float], rotate: float) -> None:
    found = Placement.of(placed(repeat, rotate, (0.3, -0.2)))
    np.testing.assert_allclose(found.repeat, repeat)
    np.testing.assert_allclose(found.rotate, rotate, atol=1e-9)
    np.testing.assert_allclose(found.shift, (0.3, -0.2), atol=1e-9)


def test_a_repeated_picture_is_smaller() -> None:
    texels = picture()
    uv = RNG.random((32, 2)) / 2
    repeated = ImageMap(texels, transform=placed(repeat=(2.0, 2.0)))
    np.testing.assert_allclose(repeated.raw(uv + 0.5), repeated.raw(uv), atol=2e-6)


@pytest.mark.parametrize("kind", ["linear8", "srgb8", "float"])
def test_texels_survive_a_file(kind: str) -> None:
    codes = RNG.integers(0, 256, (5, 7, 3))
    values = codes / 255 if kind == "linear8" else RNG.random((5, 7, 3)) * 3
    if kind == "srgb8":
        from burnish.core.colour import linear_from_srgb

        values = linear_from_srgb(codes / 255)
    texels = Texels(values.astype(np.float32))
    data = texels.to_json()
    assert (data["code"] == "float32") == (kind == "float")
    np.testing.assert_allclose(Texels.from_json(data).values, texels.values, rtol=1e-3, atol=1e-6)
    with pytest.raises(InvalidValue, match="damaged"):
        Texels.from_json({**data, "data": data["data"][:-8]})


def test_large_pictures_are_averaged_down() -> None:
    values = np.zeros((2, 4098, 1), np.float32)
    values[:, ::2] = 1.0
    assert Texels(values).values.shape[1] <= 2048
    assert abs(Texels(values).mean[0] - 0.5) < 1e-3


@pytest.mark.parametrize(
    "bad", [np.zeros((2, 2, 2)), np.zeros((0, 2, 1)), np.full((2, 2, 1), np.nan)]
)
def test_what_is_no_picture_is_refused(bad: Float64) -> None:
    with pytest.raises(InvalidValue, match="map"):
        Texels(bad)


def test_files_are_read_by_what_they_are_for(tmp_path: Path) -> None:
    pixels = RNG.integers(0, 256, (4, 6, 4), np.uint8)
    path = tmp_path / "picture.png"
    Image.fromarray(pixels).save(path)
    colour = read_texels(path, colour=True)
    codes = np.round(255 * srgb_from_linear(colour.values))
    np.testing.assert_array_equal(codes, pixels[..., :3])
    green = read_texels(path, colour=False, channel="green")
    np.testing.assert_allclose(green.values[..., 0], pixels[..., 1] / 255, atol=1e-6)
    alpha = read_texels(path, colour=False, channel="alpha")
    np.testing.assert_allclose(alpha.values[..., 0], pixels[..., 3] / 255, atol=1e-6)
    grey = tmp_path / "grey.png"
    Image.fromarray(pixels[..., 0]).save(grey)
    np.testing.assert_allclose(
        read_texels(grey, colour=False).values[..., 0], pixels[..., 0] / 255, atol=1e-6
    )


def test_what_cannot_be_read_says_so(tmp_path: Path) -> None:
    with pytest.raises(MissingFile, match="nowhere"):
        read_texels(tmp_path / "nowhere.png", colour=True)
    for name in ("text.png", "text.exr"):
        (tmp_path / name).write_text("no picture")
        with pytest.raises(InvalidValue, match=name):
            read_texels(tmp_path / name, colour=True)
    Image.fromarray(np.zeros((2, 2), np.uint8)).save(tmp_path / "grey.png")
    with pytest.raises(InvalidValue, match="no channel alpha"):
        read_texels(tmp_path / "grey.png", colour=False, channel="alpha")


def test_the_size_of_an_exr_is_checked_before_its_pixels_are_read(tmp_path: Path) -> None:
    path, field = tmp_path / "large.exr", b"dataWindow\0box2i\0" + struct.pack("<i", 16)
    OpenEXR.File({}, {"RGB": np.zeros((3, 5, 3), np.float32)}).write(str(path))
    assert read_texels(path, colour=True).values.shape == (3, 5, 3)
    before, after = path.read_bytes().split(field)
    path.write_bytes(before + field + struct.pack("<4i", 0, 0, 29999, 29999) + after[16:])
    with pytest.raises(InvalidValue, match="30000 × 30000 pixels"):
        read_texels(path, colour=True)


def test_a_file_is_a_picture_by_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "page.png"
    path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 4 4\n%%EndComments\n")
    with pytest.raises(InvalidValue, match="not a picture that can be read"):
        read_texels(path, colour=True)
    Image.new("RGB", (4, 3)).save(tmp_path / "a.gif")
    with pytest.raises(InvalidValue, match="PNG, JPEG or EXR"):
        read_texels(tmp_path / "a.gif", colour=True)
    for kind in ("png", "jpg", "tiff", "bmp", "webp", "tga"):
        Image.new("RGB", (4, 3)).save(tmp_path / f"a.{kind}")
        assert read_texels(tmp_path / f"a.{kind}", colour=True).values.shape == (3, 4, 3)


# -- rows -------------------------------------------------------------------------------------


def glossy() -> Material:
    values = {"diffuse": {"color": (1.0, 1.0, 1.0)}}
    gloss = {"color": (0.5, 0.6, 0.7), "roughness": 0.3}
    layers = (
        Layer.starting_at("diffuse", Lambert(), values["diffuse"]),
        Layer.starting_at("specular", CookTorrance("ggx"), gloss, bins=16),
    )
    state = MaterialState({"diffuse": LayerState(values["diffuse"]), "specular": LayerState(gloss)})
    return Material(layers, state)


def varied(
    material: Material, state: MaterialState, uv: Float32, area: Float64 | None = None
) -> VariedMaterial:
    nothing = np.zeros((len(uv), 3), np.float32)
    area = np.ones(len(uv)) if area is None else area
    return VariedObject(material, Canvas(nothing, nothing), area, uv).at(state)


def row_coefficients(found: VariedMaterial, layer: int, row: int) -> Float64:
    """Σ_nodes share · coefficients · factor of one row: float64 [columns, 3]."""
    item = found.layers[layer]
    c = np.stack([item.table.coefficients(node) for node in item.nodes])
    total = np.zeros(c.shape[1:])
    for k in range(item.index.shape[1]):
        for h in range(3):
            own = min(h, item.index.shape[2] - 1)
            total[:, h] += item.share[row, k, own] * c[item.index[row, k, own], :, h]
    return np.asarray(total * item.factor[row])


def uniform(material: Material, state: MaterialState, layer: str, **values: object) -> Float64:
    own = state.layers[layer]
    changed = replace(own, values={**own.values, **values})  # type: ignore[dict-item]
    return coefficients(material.layer(layer), changed)


def test_a_row_is_the_mean_of_its_points_coefficients_not_of_their_values() -> None:
    material = glossy()
    texels = Texels(np.array([[[0.1], [0.5]]], np.float32))
    image = ImageMap(texels, smooth=False)
    state = replace(material.initial, images={("specular", "roughness"): image})
    uv = np.array([[[0.25, 0.5], [0.75, 0.5]], [[0.25, 0.5], [0.25, 0.5]]], np.float32)
    found = varied(material, state, uv)
    one, other = (uniform(material, state, "specular", roughness=r) for r in (0.1, 0.5))
    size = np.abs(one).max()
    # Cubic interpolation between nodes, in single precision
    np.testing.assert_allclose(row_coefficients(found, 1, 0), (one + other) / 2, atol=2e-3 * size)
    np.testing.assert_allclose(row_coefficients(found, 1, 1), one, atol=2e-3 * size)
    d = [
        albedo(material.layer("specular"), replace(state.layers["specular"], values={
            **state.layers["specular"].values, "roughness": r,
        }))
        for r in (0.1, 0.5)
    ]  # fmt: skip
    mean = 0.75 * d[0] + 0.25 * d[1]
    before = albedo(material.layer("diffuse"), state.layers["diffuse"])
    np.testing.assert_allclose(found.mean.albedos[0], mean + before, rtol=1e-3)


@pytest.mark.parametrize("layer", ["diffuse", "specular"])
def test_a_picture_of_one_colour_is_that_colour(layer: str) -> None:
    material = glossy()
    white = replace(
        material.initial.layers[layer],
        values={**material.initial.layers[layer].values, "color": (1.0, 1.0, 1.0)},
    )
    initial = replace(material.initial, layers={**material.initial.layers, layer: white})
    colour = (0.2, 0.4, 0.9)
    image = ImageMap(Texels(np.full((2, 2, 3), colour, np.float32)))
    state = replace(initial, images={(layer, "color"): image})
    found = varied(material, state, RNG.random((3, 4, 2)).astype(np.float32))
    wanted = uniform(material, state, layer, color=colour)
    number = ("diffuse", "specular").index(layer)
    for row in range(3):
        np.testing.assert_allclose(row_coefficients(found, number, row), wanted, rtol=1e-6)


def test_scale_offset_and_limits() -> None:
    material = glossy()
    image = ImageMap(Texels(np.full((1, 1, 1), 0.5, np.float32)), scale=3.0, offset=-0.2)
    state = replace(material.initial, images={("specular", "roughness"): image})
    found = varied(material, state, np.zeros((1, 1, 2), np.float32))
    wanted = uniform(material, state, "specular", roughness=1.0)
    np.testing.assert_allclose(row_coefficients(found, 1, 0), wanted, rtol=1e-4)


def test_another_picture_in_place_of_a_weight_map_is_their_ratio_row_by_row() -> None:
    own = ImageMap(Texels(np.array([[[0.2] * 3, [0.8] * 3]], np.float32)), smooth=False)
    material = glossy()
    layers = (replace(material.layers[0], group="diffuse"), material.layers[1])
    initial = replace(material.initial, images={("diffuse", "color"): own})
    material = Material(layers, initial)
    assert not material.varies(initial)
    other = ImageMap(Texels(np.array([[[0.9, 0.3, 0.1], [0.4] * 3]], np.float32)), smooth=False)
    state = replace(initial, images={("diffuse", "color"): other})
    assert material.varies(state)
    uv = np.array([[[0.25, 0.5]], [[0.75, 0.5]]], np.float32)
    found = varied(material, state, uv, np.array([3.0, 1.0]))
    white = uniform(material, state, "diffuse")
    np.testing.assert_allclose(
        row_coefficients(found, 0, 0), white * (np.array([0.9, 0.3, 0.1]) / 0.2), rtol=1e-6
    )
    np.testing.assert_allclose(row_coefficients(found, 0, 1), white * 0.5, rtol=1e-6)
    # Later encounters see the old picture: d makes its mean that of the new one
    new, old = (3 * np.array([0.9, 0.3, 0.1]) + 0.4) / 4, (3 * 0.2 + 0.8) / 4
    np.testing.assert_allclose(found.mean.albedos[0], new / old, rtol=1e-6)


def test_dark_points_do_not_lend_a_layer_their_roughness() -> None:
    own = ImageMap(Texels(np.array([[[1.0] * 3, [0.0] * 3]], np.float32)), smooth=False)
    rough = ImageMap(Texels(np.array([[[0.1], [0.6]]], np.float32)), smooth=False)
    material = glossy()
    layers = (material.layers[0], replace(material.layers[1], group="specular"))
    initial = replace(
        material.initial, images={("specular", "color"): own, ("specular", "roughness"): rough}
    )
    found = varied(
        Material(layers, initial), initial, np.array([[[0.25, 0.5], [0.75, 0.5]]], np.float32)
    )
    bright = uniform(material, initial, "specular", roughness=0.1)
    size = np.abs(bright).max()
    np.testing.assert_allclose(row_coefficients(found, 1, 0), bright, atol=4e-3 * size)


def test_states_with_maps_survive_a_file() -> None:
    image = ImageMap(picture(), "/a.png", "green", 0.5, 0.1, placed(rotate=30.0), "mirror", False)
    state = replace(glossy().initial, images={("specular", "roughness"): image})
    assert state_from_json(state_to_json(state)) == state
