"""blendbsdf over editable materials."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from burnish.materials.layer import MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.scene.adapters import adapt
from burnish.scene.device import activate

GREY = {
    "type": "checkerboard",
    "color0": {"type": "rgb", "value": 0.25},
    "color1": {"type": "rgb", "value": 0.7},
}
METAL = {"type": "roughconductor", "alpha": 0.3, "distribution": "ggx", "eta": 0.0, "k": 1.0}
MATTE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.4, 0.1]}}
TILES = {"type": "diffuse", "reflectance": GREY}


@pytest.fixture(autouse=True, scope="module")
def _variant() -> None:
    activate()


def values(adapted: Any, bsdf: Any, state: MaterialState) -> tuple[np.ndarray, np.ndarray]:
    """Of the layers under their maps, and of Mitsuba's plugin, at one uv."""
    rng = np.random.default_rng(1)
    z, phi = rng.uniform(0.1, 1, (2, 2000)), rng.uniform(0, 2 * np.pi, (2, 2000))
    sin = np.sqrt(1 - z * z)
    w = np.stack([sin * np.cos(phi), sin * np.sin(phi), z], axis=1).astype(np.float32)
    wi, wo = (Vector(*part.astype(np.float64)) for part in w)
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*(mi.Float(part) for part in w[1]))
    si.uv = mi.Point2f(0.25, 0.25)
    expected = np.asarray(
        bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*(mi.Float(part) for part in w[0])))
    )
    settled, total = adapted.material.linked(state), np.zeros((3, 2000))
    for layer in adapted.material.layers:
        H = np.asarray(mi.Color3f(mi.load_dict(adapted.maps[layer.group]).eval(si)))
        own = {**layer.fixed, **settled.layers[layer.name].values}
        total += np.stack(layer.model.evaluate(numpy_maths, wi, wo, own)) * H.reshape(3, -1)
    return total, expected / wi.z


@pytest.mark.parametrize("weight", [0.3, GREY], ids=["number", "texture"])
@pytest.mark.parametrize("two_sided", [False, True])
def test_a_blend_is_mitsubas(weight: Any, two_sided: bool) -> None:
    description: dict[str, Any] = {"type": "blendbsdf", "weight": weight, "a": TILES, "b": METAL}
    if two_sided:
        description = {"type": "twosided", "bsdf": description}
    adapted = adapt(description)
    assert adapted.material is not None, adapted.reason
    assert adapted.edited_bsdf is not None
    assert adapted.two_sided == two_sided
    assert [layer.name for layer in adapted.material.layers] == ["first_diffuse", "second_specular"]
    initial = adapted.material.initial
    found, expected = values(adapted, mi.load_dict(description), initial)
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=1e-6 * expected.max())
    layers = dict(initial.layers)
    metal = layers["second_specular"]
    layers["second_specular"] = replace(metal, values={**metal.values, "roughness": 0.6})
    state = replace(initial, layers=layers)
    found, expected = values(adapted, adapted.edited_bsdf(state), state)
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=1e-6 * expected.max())


@pytest.mark.parametrize(
    ("description", "reason"),
    [
        ({"type": "blendbsdf", "a": MATTE, "b": {"type": "dielectric"}}, "second part.*dielectric"),
        (
            {"type": "blendbsdf", "a": MATTE, "b": {"type": "twosided", "bsdf": MATTE}},
            "only one part",
        ),
        (
            {"type": "blendbsdf", "a": MATTE, "b": {"type": "mask", "bsdf": METAL}},
            "second part.*mask or bent normals of its own",
        ),
        (
            {"type": "bumpmap", "arbitrary": GREY, "bsdf": {"type": "mask", "bsdf": MATTE}},
            "'mask' lies inside",
        ),
    ],
)
def test_what_stays_fixed_says_why(description: dict[str, Any], reason: str) -> None:
    import re

    adapted = adapt(description)
    assert adapted.material is None
    assert re.search(reason, adapted.reason)


def test_a_tint_scales_what_a_texture_shows(tmp_path: Any) -> None:
    """Not its texels: those of a nearest-filtered JPEG are sRGB-encoded."""
    from PIL import Image

    Image.fromarray(np.full((4, 4, 3), 188, np.uint8)).save(tmp_path / "a.png")
    for texture in (
        GREY,
        {"type": "bitmap", "filename": str(tmp_path / "a.png"), "filter_type": "nearest"},
        {"type": "bitmap", "filename": str(tmp_path / "a.png")},
    ):
        description = {"type": "diffuse", "reflectance": texture}
        adapted = adapt(description)
        assert adapted.material is not None
        assert adapted.edited_bsdf is not None
        initial = adapted.material.initial
        matte = initial.layers["diffuse"]
        tint = replace(matte, values={"color": (0.5, 1.0, 0.25)})
        si = mi.SurfaceInteraction3f()
        si.wi, si.uv = mi.Vector3f(0, 0, 1), mi.Point2f(0.25, 0.25)
        plain, tinted = (
            np.asarray(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, 1))).ravel()
            for bsdf in (
                mi.load_dict(description),
                adapted.edited_bsdf(replace(initial, layers={"diffuse": tint})),
            )
        )
        np.testing.assert_allclose(tinted, plain * [0.5, 1.0, 0.25], rtol=1e-4)
