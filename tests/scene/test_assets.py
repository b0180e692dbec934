"""Scenes by others load whole, fast, and say what can be edited."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from burnish.scene import load

# file: (objects, editable ones)
SCENES = {
    "cbox/cbox.xml": (8, 7),
    "cbox/cbox-rgb.xml": (8, 7),
    "cbox/cbox-spectral.xml": (8, 7),
    "matpreview/matpreview.xml": (3, 3),
    "teapot_simple/scene.xml": (1, 1),
    "veach-mis/scene.xml": (9, 6),
    "veach-bidir/scene.xml": (14, 11),
    "staircase2/scene.xml": (32, 18),
    "living-room/scene.xml": (65, 62),
    "dining-room/scene.xml": (53, 53),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_loads(assets: Path, name: str) -> None:
    import drjit as dr
    import mitsuba as mi

    start = time.perf_counter()
    scene = load(assets / "scenes" / name, resolution=(32, 24))
    assert time.perf_counter() - start < 20
    assert (len(scene.objects), len(scene.editable())) == SCENES[name]
    assert all(item.editable or item.reason for item in scene.objects)
    assert len({item.id for item in scene.objects}) == len(scene.objects)
    # Every ray that hits something finds an object whose BSDF is the one that was hit
    sensor = scene.view().sensor
    grid = np.random.default_rng(1).random((2, 4096), np.float32)
    ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(*grid), mi.Point2f(0.5))
    si = scene.mi_scene.ray_intersect(ray)
    valid = np.asarray(si.is_valid())
    assert valid.any()
    numbers = np.asarray(dr.reinterpret_array(mi.UInt32, si.shape))[valid]
    hit = np.asarray(dr.reinterpret_array(mi.UInt32, si.bsdf()))[valid]
    own = [int(dr.reinterpret_array(mi.UInt32, mi.BSDFPtr(item.bsdf))[0]) for item in scene.objects]
    np.testing.assert_array_equal(np.array(own)[scene.object_table[numbers]], hit)
