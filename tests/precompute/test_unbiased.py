"""No error but noise: the tracer's polynomial against other path tracers, by Z-tests.

The same questions at full size are under `tests/verify`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from burnish.precompute.plan import basis_for
from burnish.precompute.symbolic import NUMERIC_BINS
from burnish.reference import PathTracedTruth
from burnish.scene import Scene, load
from burnish.transport.basis import initial_state
from tests.precompute import worlds
from tests.precompute.machinery import projected, verdict, with_materials
from tests.precompute.pictures import Look, mistaken, pictures, same
from tests.reference.worlds import blinn, edited, initial, lambert


def test_an_all_diffuse_box_is_mitsuba_s() -> None:
    """And one albedo off by 2 % is seen: the test has the power to fail."""
    scene = load("cornell-box", resolution=(24, 24))
    truth = PathTracedTruth(scene, bounces=4).estimate(initial(scene), spp=8192, seed=5)
    basis = basis_for(scene, None, (1, 1, 1, 1))
    state = initial_state(basis.objects)
    wrong = mistaken(basis, state, basis.index("back"), 0)
    right, tampered = pictures(scene, basis, [Look(state), wrong], spp=8192, per_pass=64)
    result = same(right, truth)
    assert result.relative_sigma < 0.02
    assert result.passed, str(result)
    assert not same(tampered, truth).passed, str(same(tampered, truth))


CASES: list[tuple[Callable[[], Scene], tuple[int, ...]]] = [
    (worlds.glossy, (32, 8, 1)),
    (worlds.behind_glass, (32, 1, 1, 1)),
    (worlds.in_a_mirror, (32, 1, 1)),
    (worlds.beside_rough_things, (32, 1, 1)),
    (worlds.textured, (32, 8)),
    (worlds.three_layers, (16, 16)),
    (worlds.by_components, (32, 8, 1)),
    (worlds.metals, (32, 1, 1)),
    (worlds.under_small_lights, (32, 1)),
    (worlds.under_an_environment, (32, 1)),
    (worlds.under_sun_and_sky, (32, 1)),
    (worlds.seen_from_both_sides, (32, 1, 1)),
]


@pytest.mark.parametrize(("scene", "series"), CASES, ids=[case.__name__ for case, _ in CASES])
def test_the_series_is_traced_without_bias(
    scene: Callable[[], Scene], series: tuple[int, ...]
) -> None:
    result, ours = verdict(scene(), series, spp=2048)
    assert result.passed, str(result)
    assert ours.lost == 0


def test_every_edit_is_traced_without_bias_by_the_same_samples() -> None:
    """Other colours, other sharpness, a channel of nothing, a layer switched off."""
    scene = worlds.glossy()
    basis = basis_for(scene, None, (32, 8, 1))
    start = initial_state(basis.objects)
    floor, wall = start["floor"], start["wall"]
    states = [
        {
            "floor": edited(floor, "specular", exponent=4.0),
            "wall": edited(wall, "specular", exponent=120.0),
        },
        {
            "floor": edited(floor, "diffuse", color=(0.0, 0.8, 0.3)),
            "wall": edited(wall, "diffuse", enabled=False),
        },
        {
            "floor": edited(floor, "specular", weight=0.0),
            "wall": edited(wall, "specular", color=(0.9, 0.0, 0.1)),
        },
    ]
    for ours, state in zip(
        pictures(scene, basis, [Look(state) for state in states], spp=2048), states, strict=True
    ):
        result = same(ours, projected(scene, basis, state, spp=2048))
        assert result.passed, str(result)


def test_settled_materials_that_mitsuba_does_not_have() -> None:
    """A Blinn-Phong wall that is not edited is traced from its table, at every bounce."""
    item = blinn(worlds.RED, worlds.GREY, 80.0, bins=NUMERIC_BINS)
    scene = worlds.corner({"floor": lambert(worlds.GREY), "wall": item})
    theirs = with_materials(scene, {"floor": lambert(worlds.GREY), "wall": item}, 3, 2048)
    basis = basis_for(scene, ["floor"], (1, 1, 1))
    result = same(pictures(scene, basis, spp=2048)[0], theirs)
    assert result.passed, str(result)


def test_following_the_look_changes_the_noise_and_not_the_picture() -> None:
    scene = worlds.glossy(exponent=300.0)
    basis = basis_for(scene, None, (64, 1))
    state = initial_state(basis.objects)
    plain = pictures(scene, basis, spp=1024)[0]
    follows = pictures(scene, basis, spp=1024, seed=1, follow=state)[0]
    truth = projected(scene, basis, spp=4096)
    for picture in (plain, follows):
        assert same(picture, truth).passed, str(same(picture, truth))
    assert follows.variance.mean() < plain.variance.mean()


def test_the_error_falls_as_one_over_the_root_of_the_samples() -> None:
    scene = worlds.glossy()
    basis = basis_for(scene, None, (32, 1, 1))
    truth = projected(scene, basis, spp=16384)
    passes = pictures(scene, basis, spp=2048)[0].passes.astype(np.float64)
    noise = truth.variance.astype(np.float64).sum()
    # Σ error² of means of n passes, the reference's own noise taken out, times n
    products = []
    for n in (1, 4, 16, 64):
        means = passes.reshape(-1, n, *passes.shape[1:]).mean(axis=1)
        squares = ((means - truth.reflected) ** 2).sum(axis=(1, 2, 3)) - noise
        products.append(n * squares.mean())
    np.testing.assert_allclose(products, products[0], rtol=0.15)


def test_the_same_seed_is_the_same_picture() -> None:
    scene = worlds.glossy(side=12)
    basis = basis_for(scene, None, (16, 1))
    first, again, other = (pictures(scene, basis, spp=64, seed=seed)[0].mean for seed in (3, 3, 4))
    # Parallel sums differ in their last digits
    np.testing.assert_allclose(first, again, rtol=1e-4, atol=1e-6)
    assert np.abs(first - other).max() > 1e-3
