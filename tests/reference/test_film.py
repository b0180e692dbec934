"""The film: Mitsuba's own picture in expectation, with error bars that hold."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from burnish.compare import ztest
from burnish.core.errors import InvalidValue
from burnish.reference import PathTracedTruth
from burnish.reference import film as film_module
from burnish.reference.film import trace
from burnish.scene import Scene
from tests.reference.worlds import SKY, camera, initial, lambert, plane, world


def checkered(rfilter: str) -> Scene:
    """Edges, a lamp in view and a border that cuts the picture."""
    return world(
        {
            "floor": plane(size=2.0),
            "card": plane(z=0.4, size=0.5),
            "lamp": plane(z=1.5, size=0.3, down=True, emitter={"type": "area", "radiance": 5.0}),
            "sky": SKY,
            "view": camera((0, -4, 2), (0, 0, 0.4), fov=40, rfilter=rfilter),
        },
        {"floor": lambert((0.8, 0.4, 0.2)), "card": lambert((0.1, 0.3, 0.9))},
        resolution=(20, 14),
    )


@pytest.mark.parametrize("rfilter", ["box", "gaussian", "mitchell"])
def test_the_picture_is_mitsuba_s_with_the_film_s_own_filter(rfilter: str) -> None:
    scene = checkered(rfilter)
    truth = PathTracedTruth(scene, 2)
    ours = truth.estimate(initial(scene), spp=2048, seed=3)
    integrator = mi.load_dict({"type": "path", "max_depth": 3})
    theirs = np.stack(
        [
            np.asarray(
                mi.render(truth.mi_scene(initial(scene)), integrator=integrator, spp=256, seed=k)
            )
            for k in range(8)
        ]
    )
    mean, variance = theirs.mean(0), theirs.var(0, ddof=1) / len(theirs)
    # Splatting correlates neighbours, so pixels are judged together: the squared error is
    # the sum of both variances, give or take
    z2 = (ours.image - mean) ** 2 / (ours.variance + variance + 1e-6)
    lit = ours.emission.max(-1) == 0
    assert 0.5 < z2[lit].mean() < 2.0
    assert abs(float((ours.reflected - (mean - ours.emission))[lit].mean())) < 2e-3


def test_the_variance_is_that_of_repeated_pictures() -> None:
    scene = checkered("gaussian")
    runs = [PathTracedTruth(scene, 2).estimate(initial(scene), spp=64, seed=k) for k in range(24)]
    observed = np.var([run.reflected for run in runs], axis=0, ddof=1)
    stated = np.mean([run.variance for run in runs], axis=0)
    assert observed.mean() == pytest.approx(stated.mean(), rel=0.1)
    middle = np.median(observed[stated > 0] / stated[stated > 0])
    # The median of χ²₂₃ / 23 is 0.97
    assert 0.85 < middle < 1.1


def test_two_seeds_agree_and_are_not_the_same() -> None:
    scene = checkered("gaussian")
    a, b, again = (
        PathTracedTruth(scene).estimate(initial(scene), spp=64, seed=k) for k in (1, 2, 1)
    )
    result = ztest(a.reflected, a.variance, b.reflected, b.variance)
    assert result.passed, str(result)
    assert not np.array_equal(a.image, b.image)
    np.testing.assert_allclose(a.image, again.image, rtol=1e-4, atol=1e-6)


def test_halves_are_independent_and_average_to_the_picture() -> None:
    scene = checkered("box")
    run = PathTracedTruth(scene, 1).estimate(initial(scene), spp=33)
    assert run.samples == 34
    first, second = run.halves
    np.testing.assert_allclose((first + second) / 2, run.image, rtol=1e-5, atol=1e-6)
    assert not np.array_equal(first, second)
    np.testing.assert_allclose(
        (run.emission_halves[0] + run.emission_halves[1]) / 2, run.emission, rtol=1e-5, atol=1e-6
    )


def test_passes_bound_the_memory_and_leave_the_expectation(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = checkered("box")
    whole = PathTracedTruth(scene, 1).estimate(initial(scene), spp=128, seed=1)
    widths: list[int] = []
    monkeypatch.setattr(film_module, "LANES", 200)  # less than the 280 pixels
    steps: list[float] = []

    def radiance(sampler: Any, ray: Any) -> tuple[Any, Any]:
        widths.append(dr.width(ray))
        si = scene.mi_scene.ray_intersect(ray)
        return dr.select(si.is_valid(), mi.Color3f(si.p), 0), mi.Color3f(0)

    run = trace(radiance, scene.view(), 4, progress=lambda done, _: steps.append(done))
    assert max(widths) <= 200
    assert steps == sorted(steps)
    assert steps[-1] == 1.0
    assert run.image.shape == whole.image.shape
    assert np.abs(run.image).sum(-1)[10].min() > 0


def test_progress_can_cancel() -> None:
    class Cancelled(Exception):
        pass

    def stop(done: float, what: str) -> None:
        raise Cancelled

    scene = checkered("box")
    with pytest.raises(Cancelled):
        PathTracedTruth(scene).render(initial(scene), scene.view().name, 4, progress=stop)


def test_too_few_samples_are_refused() -> None:
    scene = checkered("box")
    with pytest.raises(InvalidValue, match="spp"):
        PathTracedTruth(scene).estimate(initial(scene), spp=1)
    with pytest.raises(InvalidValue, match="bounces"):
        PathTracedTruth(scene, bounces=0)
