"""Scenes whose picture is known on paper, for the truth and for the series alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from burnish.compare import ztest
from burnish.reference import Estimate, PathTracedTruth, series_image
from burnish.reference import truth as truth_module
from burnish.scene import Scene
from tests.reference.worlds import (
    SKY,
    blinn,
    camera,
    directional_albedo,
    initial,
    lambert,
    plane,
    world,
)

Render = Callable[[Scene, int, int], Estimate]


@pytest.fixture(autouse=True)
def _own_bsdf_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """An unedited object would keep the scene's BSDF; here burnish's is on trial."""
    monkeypatch.setattr(truth_module, "is_initial", lambda item, state: False)


def truth(scene: Scene, bounces: int, spp: int) -> Estimate:
    return PathTracedTruth(scene, bounces).estimate(initial(scene), spp=spp, seed=1)


def series(scene: Scene, bounces: int, spp: int) -> Estimate:
    return series_image(scene, initial(scene), (64,) + (1,) * (bounces - 1), spp=spp, seed=1)


both = pytest.mark.parametrize("render", [truth, series])


def equals(estimate: Estimate, answer: np.ndarray | float) -> None:
    expected = np.broadcast_to(answer, estimate.image.shape)
    nothing = np.zeros_like(estimate.variance)
    result = ztest(estimate.reflected, estimate.variance, expected, nothing)
    assert result.passed, str(result)
    assert result.relative_sigma < 0.02


@both
def test_a_white_sphere_in_a_white_sky_cannot_be_seen(render: Render) -> None:
    scene = world(
        {
            "ball": {"type": "sphere", "bsdf": {"type": "diffuse"}},
            "sky": SKY,
            # Near enough for the sphere to fill the picture
            "view": camera((0, -6, 0), (0, 0, 0), fov=10),
        },
        {"ball": lambert((1.0, 1.0, 1.0))},
    )
    estimate = render(scene, 1, 256)
    np.testing.assert_allclose(estimate.image.mean(), 1.0, rtol=2e-3)
    equals(estimate, 1.0)


@both
def test_inside_a_closed_glowing_box_the_light_is_one(render: Render) -> None:
    """Emission 1 − ρ and reflectance ρ: after N bounces 1 − ρ^(N+1), in the limit 1."""
    rho, bounces = np.array([0.5, 0.3, 0.8]), 4
    scene = world(
        {
            "shell": {
                "type": "cube",
                "flip_normals": True,
                "bsdf": {"type": "diffuse"},
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": list(1 - rho)}},
            },
            "view": camera((0.1, 0.2, 0.0), (1, 0, 0), fov=60),
        },
        {"shell": lambert((0.5, 0.3, 0.8))},
    )
    estimate = render(scene, bounces, 1024)
    np.testing.assert_allclose(estimate.emission, np.broadcast_to(1 - rho, (16, 16, 3)), rtol=1e-5)
    equals(estimate, 1 - rho ** (bounces + 1) - (1 - rho))


@both
def test_a_diffuse_plane_under_a_constant_sky_shows_its_albedo(render: Render) -> None:
    scene = world(
        {"floor": plane(size=50.0), "sky": SKY, "view": camera((0, -3, 2), (0, 0, 0))},
        {"floor": lambert((0.8, 0.5, 0.0))},
    )
    estimate = render(scene, 2, 256)
    equals(estimate, np.array([0.8, 0.5, 0.0]))
    assert not estimate.image[..., 2].any()


@both
def test_a_glossy_plane_under_a_constant_sky_shows_its_directional_albedo(render: Render) -> None:
    item = blinn((0.3, 0.2, 0.1), (0.5, 0.5, 0.6), 60.0)
    theta = 0.7
    far = (-200 * np.sin(theta), 0.0, 200 * np.cos(theta))
    scene = world(
        # Far away and narrow: all pixels see the same angle, to 1e-4
        {"floor": plane(size=50.0), "sky": SKY, "view": camera(far, (0, 0, 0), fov=0.02)},
        {"floor": item},
        resolution=(8, 8),
    )
    expected = directional_albedo(item, item.initial, theta)
    equals(render(scene, 1, 4096), expected)


@both
@pytest.mark.parametrize("bounces", [1, 2, 4])
def test_two_facing_planes_add_up_the_powers_of_their_albedos(render: Render, bounces: int) -> None:
    """A glowing plane (fixed, reflectance a) over an edited one (b), both endless:
    the edited one shows b + b·ab + b·(ab)² + …, one more factor of a or b per bounce."""
    a, b = 0.5, np.array([0.8, 0.6, 0.2])
    lamp = {
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [a] * 3}},
        "emitter": {"type": "area", "radiance": 1.0},
    }
    scene = world(
        {
            "floor": plane(size=300.0),
            "lamp": plane(z=1.0, size=300.0, down=True, **lamp),
            "view": camera((0, 0, 0.5), (0.2, 0, 0), up=(0, 1, 0)),
        },
        {"floor": lambert((0.8, 0.6, 0.2))},
        resolution=(8, 8),
    )
    answer = sum(b * (a * b) ** k for k in range((bounces + 1) // 2))
    estimate = render(scene, bounces, 4096)
    assert not estimate.emission.any()
    equals(estimate, answer)
