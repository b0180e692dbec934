"""From single paths to a picture with its own error bars.

Every path belongs to one pixel: its film position is drawn from the reconstruction filter
about that pixel, not splatted over several. The expectation is Mitsuba's picture, pixels
are independent, and the variance of each is known from its own samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Crop, Float32, Float64, Progress
from burnish.scene.views import View

LANES = 1 << 20
"""Most paths traced at once; what bounds the memory."""
CELLS_PER_PIXEL = 256

Radiance = Callable[[Any, Any], tuple[Any, Any]]
"""(sampler, ray) to the light along a ray and the part of it that is directly seen emission."""


@dataclass(frozen=True)
class Estimate:
    """A path-traced picture; all pictures float32 [height, width, 3], linear RGB.

    halves: two independent estimates whose mean is `image`. emission, emission_halves: the
    directly seen emission in each, by the same samples, so that leaving it out takes the
    noise of a lamp's edge along. variance: of `reflected`, which is `image` without it.
    samples: per pixel.
    """

    image: Float32
    halves: tuple[Float32, Float32]
    emission: Float32
    emission_halves: tuple[Float32, Float32]
    variance: Float32
    samples: int

    @property
    def reflected(self) -> Float32:
        """The picture without directly seen emission; what `variance` is the variance of."""
        return self.image - self.emission


def trace(
    radiance: Radiance,
    view: View,
    spp: int,
    seed: int = 0,
    progress: Progress | None = None,
    crop: Crop | None = None,
) -> Estimate:
    """Estimate a view's picture with `spp` paths per pixel, rounded up to an even number.

    progress: called after each pass; may raise to cancel. crop: only these pixels; what falls
    on them is the same light. Raises InvalidValue.
    """
    if spp < 2:
        raise InvalidValue(f"spp must be at least 2, one for each half; got {spp}")
    camera = Camera(view, crop)
    _, _, width, height = camera.crop
    pixels_all = width * height
    per_half = -(-spp // 2)
    bands = _bands(pixels_all, LANES)
    sums = [_Sums.zeros(pixels_all) for _ in range(2)]
    streams = np.random.SeedSequence(seed)
    total, done = 2 * per_half * pixels_all, 0
    for half in sums:
        for first, pixels in bands:
            left = per_half
            while left:
                count = min(left, max(1, LANES // pixels))
                stream = int(streams.spawn(1)[0].generate_state(1)[0])
                half.add(first, camera.trace(radiance, first, pixels, count, stream))
                left -= count
                done += count * pixels
                if progress is not None:
                    progress(done / total, "path tracing")
    shape = (height, width, 3)
    return _estimate(sums[0], sums[1], shape, 2 * per_half)


class Camera:
    """Draws camera rays of a view's pixels through its filter and sums what they see.

    crop: the pixels that are counted, row by row; all of the view's without it. Raises
    InvalidValue when it does not lie in the view.
    """

    def __init__(self, view: View, crop: Crop | None = None) -> None:
        self.view = view
        self.crop = (0, 0, view.width, view.height) if crop is None else crop
        left, top, width, height = self.crop
        if not (0 <= left < left + width <= view.width and 0 <= top < top + height <= view.height):
            raise InvalidValue(
                f"a crop must lie inside the view of {view.width} × {view.height} pixels; got "
                f"{width} × {height} at ({left}, {top})"
            )
        self.filter = _FilterSampler(view.filter)
        self.sampler = mi.load_dict({"type": "independent"})

    def trace(
        self, radiance: Radiance, first: int, pixels: int, count: int, seed: int
    ) -> list[Float64]:
        """Sums over `count` paths for each of `pixels` pixels from number `first` on.

        Gives Σw [n, 1], Σw² [n, 1], ΣwR, Σw²R, Σw²R² and ΣwE [n, 3], w the filter's weight,
        E the directly seen emission and R the rest of the light.
        """
        lanes = pixels * count
        self.sampler.seed(seed, lanes)
        index = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, count)
        index += dr.opaque(mi.UInt32, first)
        left, top, width, _ = self.crop
        across = dr.opaque(mi.UInt32, width)
        corner = mi.Point2f(mi.Float(index % across), mi.Float(index // across))
        corner += mi.Point2f(dr.opaque(mi.Float, left), dr.opaque(mi.Float, top))
        ray, weight, colour = self._ray(corner)
        light, emission = radiance(self.sampler, ray)
        light, emission = (light - emission) * colour, emission * colour
        square = dr.square(weight)
        sums = [
            [weight],
            [square],
            [weight * light[c] for c in range(3)],
            [square * light[c] for c in range(3)],
            [dr.square(weight * light[c]) for c in range(3)],
            [weight * emission[c] for c in range(3)],
        ]
        dr.eval(sums)
        return [
            np.stack([np.asarray(dr.block_sum(item, count), np.float64) for item in group], axis=1)
            for group in sums
        ]

    def _ray(self, corner: Any) -> tuple[Any, Any, Any]:
        """A camera ray, its filter weight (0 off the film) and its colour."""
        sensor, sampler, view = self.view.sensor, self.sampler, self.view
        offset, weight = self.filter.sample(sampler.next_2d())
        position = (corner + 0.5 + offset) / mi.ScalarPoint2f(view.width, view.height)
        inside = dr.all((position >= 0) & (position <= 1))
        time = sensor.shutter_open() + sampler.next_1d() * sensor.shutter_open_time()
        aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
        ray, colour = sensor.sample_ray_differential(
            time, sampler.next_1d(), dr.clip(position, 0, 1), aperture
        )
        ray.scale_differential(dr.rsqrt(mi.Float(self.view.pixels)))
        return ray, dr.select(inside, weight, 0), mi.Color3f(colour)


class _FilterSampler:
    """Offsets from a pixel's centre, drawn from the filter; negative lobes by their sign."""

    def __init__(self, filter_: Any) -> None:
        self.filter = filter_
        self.radius = float(filter_.radius())
        self.cells = max(4, int(np.ceil(2 * self.radius * CELLS_PER_PIXEL)))
        centre = (np.arange(self.cells) + 0.5) * (2 * self.radius / self.cells) - self.radius
        value = np.abs(np.asarray(filter_.eval(mi.Float(centre.astype(np.float32))), np.float64))
        # A floor keeps cells that the filter crosses zero in reachable
        mass = np.maximum(value, 1e-3 * value.max())
        self.table = mi.DiscreteDistribution(mi.Float((mass / mass.sum()).astype(np.float32)))

    def sample(self, u: Any) -> tuple[Any, Any]:
        x, weight_x = self._axis(u.x)
        y, weight_y = self._axis(u.y)
        return mi.Vector2f(x, y), weight_x * weight_y

    def _axis(self, u: Any) -> tuple[Any, Any]:
        cell, within, mass = self.table.sample_reuse_pmf(u)
        size = 2 * self.radius / self.cells
        x = (mi.Float(cell) + within) * size - self.radius
        return x, self.filter.eval(x) * size / mass


_REFLECTED, _EMISSION = 2, 5
"""Places of ΣwR and ΣwE among the sums."""


@dataclass
class _Sums:
    """Sums over samples, float64 [pixels, 1 or 3]; see `Camera.trace`."""

    parts: list[Float64]

    @staticmethod
    def zeros(pixels: int) -> _Sums:
        return _Sums([np.zeros((pixels, n)) for n in (1, 1, 3, 3, 3, 3)])

    def add(self, first: int, parts: list[Float64]) -> None:
        for total, part in zip(self.parts, parts, strict=True):
            total[first : first + len(part)] += part

    def mean(self, part: int = _REFLECTED) -> Float64:
        return _ratio(self.parts[part], self.parts[0])


def _estimate(a: _Sums, b: _Sums, shape: tuple[int, int, int], samples: int) -> Estimate:
    both = _Sums([x + y for x, y in zip(a.parts, b.parts, strict=True)])
    weight, square, _, light, light_squared, _ = both.parts
    mean = both.mean()
    # Σ w² (R − μ)² / (Σ w)²: the variance of a weighted mean with random weights
    spread = light_squared - 2 * mean * light + mean**2 * square
    variance = _ratio(np.maximum(spread, 0), weight**2) * (samples / (samples - 1))

    def picture(values: Float64) -> Float32:
        return values.reshape(shape).astype(np.float32)

    return Estimate(
        image=picture(mean + both.mean(_EMISSION)),
        halves=(
            picture(a.mean() + a.mean(_EMISSION)),
            picture(b.mean() + b.mean(_EMISSION)),
        ),
        emission=picture(both.mean(_EMISSION)),
        emission_halves=(picture(a.mean(_EMISSION)), picture(b.mean(_EMISSION))),
        variance=picture(variance),
        samples=samples,
    )


def _ratio(value: Float64, weight: Float64) -> Float64:
    return np.divide(value, weight, out=np.zeros_like(value), where=weight > 0)


def _bands(pixels: int, most: int) -> list[tuple[int, int]]:
    """(first pixel, number of pixels) of stretches of at most `most` pixels."""
    return [(first, min(most, pixels - first)) for first in range(0, pixels, most)]
