"""A pixel's own samples, drawn from the filter, give what Mitsuba's film gives by splatting."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from burnish.precompute.film import FilterSampler
from burnish.scene.device import activate

activate()

WIDTH, HEIGHT = 5, 4
FILTERS: dict[str, dict[str, Any]] = {
    "box": {},
    "tent": {},
    "gaussian": {},
    "mitchell": {},
    "catmullrom": {},
    "lanczos": {},
    "wide tent": {"type": "tent", "radius": 2.5},
}


def rfilter(name: str) -> Any:
    return mi.load_dict({"type": name, **FILTERS[name]})


def signal(x: Any, y: Any) -> list[Any]:
    """Functions over the film that tell positions and borders apart."""
    return [1.0 + 0.0 * x, x, y, x * x, x * y * y]


def drawn(name: str) -> np.ndarray:
    """E[weight · signal] of every pixel by midpoints in u: [height, width, 5]."""
    filter_ = FilterSampler(rfilter(name), WIDTH, HEIGHT)
    # Many: where the sign of a negative lobe flips, a midpoint rule is off by a whole weight
    n = 1 << 16
    u = mi.Float(((np.arange(n) + 0.5) / n).astype(np.float32))
    axes = []
    for axis, size in enumerate((WIDTH, HEIGHT)):
        samples = [filter_.sample_axis(mi.UInt32(p), axis, u) for p in range(size)]
        axes.append(np.array([[np.array(x), np.array(w)] for x, w in samples], np.float64))
    (x, wx), (y, wy) = axes[0].transpose(1, 0, 2), axes[1].transpose(1, 0, 2)
    # The film is separable, and so are the signals' terms
    return np.stack(
        [
            np.outer((wy * y**j).mean(axis=1), (wx * x**i).mean(axis=1))
            for i, j in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 2))
        ],
        axis=-1,
    )


def splatted(name: str) -> np.ndarray:
    """The same from Mitsuba's own image block, given a dense grid of samples."""
    per_pixel = 100
    ny, nx = HEIGHT * per_pixel, WIDTH * per_pixel
    x = (np.arange(nx) + 0.5) / per_pixel
    y = (np.arange(ny) + 0.5) / per_pixel
    X, Y = (mi.Float(v.ravel().astype(np.float32)) for v in np.meshgrid(x, y))
    block = mi.ImageBlock(
        [WIDTH, HEIGHT], [0, 0], 5, rfilter=rfilter(name), border=False, normalize=False
    )
    block.put(mi.Point2f(X, Y), [mi.Float(v) for v in signal(X, Y)])
    values = np.array(block.tensor(), np.float64).reshape(HEIGHT, WIDTH, 5)
    return values / values[..., :1]


@pytest.mark.parametrize("name", [n for n in FILTERS if "type" not in FILTERS[n]])
def test_a_pixel_is_what_mitsuba_s_film_makes_of_it(name: str) -> None:
    """Borders included: 5 × 4 pixels, and most filters reach two pixels far."""
    # 100 midpoints per pixel of a filter that jumps at its edge: half a cell, 0.5 %
    np.testing.assert_allclose(drawn(name), splatted(name), rtol=5e-3, atol=5e-3)


@pytest.mark.parametrize("name", FILTERS)
def test_a_pixel_is_the_filter_s_integral(name: str) -> None:
    """Against quadrature of the filter over the film, normalised there."""
    plugin = mi.load_dict({"type": name, **FILTERS[name]})
    n = 40_000
    result = drawn(name)
    moments = []
    for size in (WIDTH, HEIGHT):
        x = (np.arange(n) + 0.5) / n * size
        rows = []
        for pixel in range(size):
            distance = np.abs(x - pixel - 0.5).astype(np.float32)
            w = np.array(plugin.eval(mi.Float(distance)), np.float64) * (distance < plugin.radius())
            rows.append([(w * x**k).sum() / w.sum() for k in range(3)])
        moments.append(np.array(rows))
    (mx, my) = moments
    for k, (i, j) in enumerate(((0, 0), (1, 0), (0, 1), (2, 0), (1, 2))):
        np.testing.assert_allclose(result[..., k], np.outer(my[:, j], mx[:, i]), rtol=1e-3)


@pytest.mark.parametrize("name", FILTERS)
def test_samples_stay_on_the_film_and_within_the_filter(name: str) -> None:
    plugin = rfilter(name)
    filter_ = FilterSampler(plugin, WIDTH, HEIGHT)
    rng = np.random.default_rng(1)
    u = mi.Point2f(*rng.random((2, 20_000), np.float32))
    pixel = mi.Point2u(*rng.integers(0, (WIDTH, HEIGHT), (20_000, 2)).T.astype(np.uint32))
    position, weight = filter_.sample(pixel, u)
    for axis, size in enumerate((WIDTH, HEIGHT)):
        x = np.array(position[axis])
        assert x.min() >= 0
        assert x.max() <= size
        distance = np.abs(x - np.array(pixel[axis]) - 0.5)
        assert distance.max() <= plugin.radius() * (1 + 1e-5)
    negative = np.array(weight).min() < 0
    assert negative == (name in ("mitchell", "catmullrom", "lanczos"))
