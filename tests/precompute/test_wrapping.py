"""Masks and bent normals round editable materials: Mitsuba's own plugins, and no bias."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from burnish.core.types import AnyArray
from burnish.precompute.orientation import Orientation
from burnish.scene import Scene
from burnish.scene.adapters import adapt
from tests.precompute import worlds
from tests.precompute.machinery import verdict
from tests.reference.worlds import blinn

SIDE = 64
GREY, RED = worlds.GREY, worlds.RED
MATTE = {"type": "diffuse"}


def waves() -> tuple[AnyArray, AnyArray]:
    """A height over the unit square, and the tangent-space normals of another."""
    x, y = np.meshgrid(*2 * [2 * np.pi * 2 * np.arange(SIDE) / SIDE])
    normals = np.stack([-0.6 * np.cos(x), 0.4 * np.sin(y), np.ones_like(x)], axis=-1)
    return 0.5 + 0.5 * np.sin(x) * np.sin(y), normals / np.linalg.norm(
        normals, axis=-1, keepdims=True
    )


@pytest.fixture(scope="module")
def textures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    folder: Path = tmp_path_factory.mktemp("bends")
    height, normals = waves()
    pictures = {
        "height": height,
        "normals": normals * 0.5 + 0.5,
        "holes": (height > 0.5) * 0.75 + 0.25,
    }
    for name, values in pictures.items():
        Image.fromarray(np.round(255 * values).astype(np.uint8)).save(folder / f"{name}.png")
    return {
        name: {"type": "bitmap", "filename": str(folder / f"{name}.png"), "raw": True}
        for name in pictures
    }


def bends(t: dict[str, Any]) -> dict[str, dict[str, Any]]:
    normal = {"type": "normalmap", "normalmap": t["normals"], "bsdf": MATTE}
    bump = {"type": "bumpmap", "arbitrary": t["height"], "scale": 0.2, "bsdf": MATTE}
    return {
        "normal map": normal,
        "bump map": bump,
        "two faces outside": {"type": "twosided", "bsdf": normal},
        "two faces inside": {**normal, "bsdf": {"type": "twosided", "bsdf": MATTE}},
        "two faces inside a bump": {**bump, "bsdf": {"type": "twosided", "bsdf": MATTE}},
        "no shadows": {**normal, "use_shadowing_function": False},
        "normals as they are": {**bump, "flip_invalid_normals": False},
    }


@pytest.mark.parametrize("name", bends({"normals": {}, "height": {}}))
def test_a_bent_frame_is_the_plugins(textures: dict[str, Any], name: str) -> None:
    """The plugin's own value of a matte surface, ρ cosθ, at random points and directions."""
    description = bends(textures)[name]
    adapted = adapt(description)
    assert adapted.material is not None, adapted.reason
    bend = adapted.wrapping.bend(adapted.two_sided)
    assert bend is not None
    count, rng = 4096, np.random.default_rng(3)
    w = rng.normal(size=(2, 3, count))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    to_view, to_light = (mi.Vector3f(*(mi.Float(c.astype(np.float32)) for c in v)) for v in w)
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(*(mi.Float(c) for c in rng.random((2, count), np.float32)))
    si.n, si.sh_frame = mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Normal3f(0, 0, 1))
    si.dp_du, si.dp_dv = mi.Vector3f(2, 0, 0), mi.Vector3f(0, 2, 0)
    si.wi = to_view
    expected = np.asarray(mi.load_dict(description).eval(mi.BSDFContext(), si, to_light))[0]

    wo = mi.Vector3f(to_view)
    outside = mi.Bool(adapted.two_sided and not bend.two_sided_inside)
    flip = outside & (wo.z < 0)
    wo.z = mi.Float(np.where(np.asarray(flip), -np.asarray(wo.z), np.asarray(wo.z)))
    normal = bend.normal(si, wo, mi.Bool(True))
    frame = Orientation.of(wo, flip, normal, mi.Bool(bend.two_sided_inside), mi.Bool(bend.shadows))
    wi, factor = frame.to_local(to_light)
    lit = (np.asarray(wi.z) > 0) & (np.asarray(frame.wo.z) > 0)
    found = np.where(lit, 0.5 / np.pi * np.asarray(wi.z) * np.asarray(factor), 0.0)
    np.testing.assert_allclose(found, expected, atol=2e-6)
    assert (expected > 0).mean() > 0.2
    # And back again
    back, again = frame.to_shading(wi)
    np.testing.assert_allclose(np.asarray(back), w[1], atol=2e-6)
    np.testing.assert_allclose(np.asarray(again), np.asarray(factor), rtol=1e-3, atol=1e-4)


def glossy(floor: Any, wall: Any) -> Scene:
    """The floor and the wall see themselves in each other, each inside a wrapping."""
    return worlds.corner(
        {"floor": blinn(GREY, GREY, 30.0), "wall": blinn(RED, GREY, 30.0)},
        {"behind": worlds.ball(0.3, 3.0, 0.9, {"type": "diffuse"})},
        floor={"bsdf": floor},
        wall_fields={"bsdf": wall},
    )


def test_wrappings_are_traced_without_bias(textures: dict[str, Any]) -> None:
    """Bent normals; holes that the sky shines through, and a part that passes everywhere."""
    kinds = bends(textures)
    scene = glossy(
        {"type": "mask", "opacity": 0.7, "bsdf": kinds["two faces outside"]},
        {"type": "mask", "opacity": textures["holes"], "bsdf": kinds["bump map"]},
    )
    result, ours = verdict(scene, (32, 8, 1), spp=1024)
    assert result.passed, str(result)
    assert ours.lost == 0
