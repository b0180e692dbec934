"""The environment as triangles: its energy, where they are small, and maps with bad texels."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from burnish.core.errors import InvalidValue, SceneError
from burnish.core.types import Float32
from burnish.precompute.direct.environment import _check, environment_triangles
from burnish.precompute.direct.lights import find_lights
from burnish.precompute.direct.subdivision import CHILDREN, Pieces, corners, size, solid_angles
from burnish.scene.device import activate
from burnish.transport.basis import Basis
from tests.reference.worlds import SKY, camera, lambert, plane, world

activate()


def sky_with_sun() -> Float32:
    """A smooth sky and a sun of one texel that has half of the energy: [32, 64, 3]."""
    y, x = np.mgrid[0:32, 0:64]
    smooth = 0.3 + 0.2 * np.sin(x / 64 * 2 * np.pi)[..., None] * np.array([1.0, 0.5, 0.2])
    smooth = smooth * (1 + 0.5 * np.cos(y / 31 * np.pi))[..., None]
    smooth[9, 41] = 450.0
    return np.asarray(smooth, np.float32)


def envmap(texels: Float32) -> Any:
    turn = mi.ScalarTransform4f().rotate([0.6, 0.0, 0.8], 63.0)
    return mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(texels), "to_world": turn})


def energy_of(emitter: Any) -> Float32:
    """∫ L dω by a fine even grid of the map's own texels."""
    height, width = 31 * 20, 64 * 20
    theta = (np.arange(height) + 0.5) / height * np.pi
    phi = (np.arange(width) + 0.5) / width * 2 * np.pi
    T, P = (grid.ravel() for grid in np.meshgrid(theta, phi, indexing="ij"))
    local = np.stack([np.sin(T) * np.sin(P), np.cos(T), -np.sin(T) * np.cos(P)])
    si = mi.SurfaceInteraction3f()
    si.wi = -(mi.traverse(emitter)["to_world"] @ mi.Vector3f(local.astype(np.float32)))
    light = np.array(emitter.eval(si)).reshape(3, -1).astype(np.float64)
    weight = np.sin(T) * (np.pi / height) * (2 * np.pi / width)
    return np.asarray((light * weight).sum(axis=1))


@pytest.mark.parametrize("count", [400, 4000])
def test_triangles_have_the_energy_of_the_map(count: int) -> None:
    emitter = envmap(sky_with_sun())
    found = environment_triangles(emitter, count)
    angle = solid_angles(found.corners)
    assert count - CHILDREN < len(angle) <= count
    assert angle.sum() == pytest.approx(4 * np.pi, rel=1e-9)
    energy = (found.radiance[:, 0] * angle[:, None]).sum(axis=0)
    np.testing.assert_allclose(energy, energy_of(emitter), rtol=1e-4)
    np.testing.assert_allclose(energy, found.energy, rtol=1e-5)
    # Any cut through the pieces below has the same energy
    numbers = np.arange(len(angle) * CHILDREN**2)
    small = solid_angles(corners(numbers, 2, found.corners)).reshape(len(angle), -1)
    below = found.radiance[:, size(1) : size(2)]
    np.testing.assert_allclose((below * small[..., None]).sum(axis=(0, 1)), energy, rtol=1e-5)


def test_triangles_are_small_where_light_comes_from() -> None:
    """The sun, a texel with half of the energy, lies in triangles that are smaller than it; the
    sky in larger ones. No triangle has more than its share."""
    found = environment_triangles(envmap(sky_with_sun()), 1000)
    angle = solid_angles(found.corners)
    energy = found.radiance[:, 0].mean(axis=1) * angle
    texel = np.pi / 31 * 2 * np.pi / 64 * np.sin(9 / 31 * np.pi)
    sunny = found.radiance[:, 0].mean(axis=1) > 100
    assert angle[sunny].max() < texel / 4
    assert np.median(angle) > texel
    assert energy.max() < 0.05 * energy.sum()


def test_an_even_environment_has_even_triangles() -> None:
    found = environment_triangles(mi.load_dict({"type": "constant", "radiance": 2.0}), 1280)
    angle = solid_angles(found.corners)
    np.testing.assert_allclose(found.radiance, 2.0, rtol=1e-6)
    assert angle.max() / angle.min() < 5


def test_pieces_tile_a_triangle() -> None:
    """In pre-order, each level with the whole area, none outside."""
    pieces = Pieces.down_to(4)
    assert len(pieces) == size(4)
    triangle = np.array([[[1.0, 0.2, 0.1], [0.1, 1.0, 0.3], [0.2, 0.1, 1.0]]])
    whole = solid_angles(triangle)[0]
    for level in range(5):
        own = pieces.level == level
        h = (pieces.sign * 0.5**level)[own, None]
        first, second = triangle[0, 1] - triangle[0, 0], triangle[0, 2] - triangle[0, 0]
        a = triangle[0, 0] + pieces.x[own, None] * first + pieces.y[own, None] * second
        placed = np.stack([a, a + h * first, a + h * second], axis=1)
        assert solid_angles(placed).sum() == pytest.approx(whole, rel=1e-12)
        expected = corners(pieces.number[own], level, triangle)
        np.testing.assert_allclose(placed, expected, atol=1e-12)
    # The pieces of a piece follow it
    assert (np.diff(pieces.level) <= 1).all()


def test_negative_texels_count_as_black() -> None:
    texels = sky_with_sun()
    texels[20, 10:14] = -0.5
    found = environment_triangles(envmap(texels), 400)
    assert (found.radiance >= 0).all()
    assert found.repairs[0].startswith("environment: 4 texels of 2048 are negative (least -0.5)")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_texels_that_are_no_numbers_are_refused(bad: float) -> None:
    """Named with the first of them; Mitsuba itself takes such maps, and then samples nothing."""
    texels = sky_with_sun()
    texels[7, 3, 1] = bad
    emitter = mi.load_dict(SKY)
    with pytest.raises(SceneError, match="x 3, y 7"):
        _check(emitter, texels)


def test_the_number_of_triangles_is_checked() -> None:
    scene = world(
        {"floor": plane(), "sky": SKY, "view": camera((0, -3, 1), (0, 0, 0))},
        {"floor": lambert((0.5, 0.5, 0.5))},
    )
    for count in (99, 100_001):
        with pytest.raises(InvalidValue, match="triangles"):
            find_lights(scene, Basis((), (1,)), count)
