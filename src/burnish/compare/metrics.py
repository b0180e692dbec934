"""The figures that say how far a picture is from a path-traced truth.

The truth is noisy, so its error is estimated from two independent halves and taken out in
quadrature. With R = (R₁ + R₂) / 2, each half unbiased and of the same budget,

    E‖R − E R‖² = E‖R₁ − R₂‖² / 4,

whatever the distribution, and the same holds for a picture that is itself an estimate.
"""

from __future__ import annotations

import math
from typing import TypedDict

import numpy as np

from burnish.compare.flip import flip
from burnish.compare.tone import auto_exposure, display
from burnish.core.errors import InvalidValue
from burnish.core.types import Float32, Float64

Halves = tuple[Float32, Float32]
"""Two independent estimates of the same picture, of the same budget."""

PSNR_CEILING = 120.0
"""dB; what equal pictures score, since JSON has no infinity."""


class Metrics(TypedDict):
    """The figures of `metrics`; see there."""

    rmse: float
    rel_rmse: float
    rel_rmse_beyond_noise: float
    rel_rmse_beyond_noise_error: float
    noise: float
    noise_error: float
    psnr: float
    flip: float
    mean_image: float
    mean_reference: float
    exposure: float


def without_emission(image: Float32, emission: Float32 | None) -> Float64:
    """A picture without directly seen emission: float64 [height, width, 3]."""
    picture = np.asarray(image, np.float64)
    return picture if emission is None else picture - np.asarray(emission, np.float64)


def metrics(
    image: Float32 | Halves,
    reference: Halves,
    *,
    emission: Float32 | Halves | None = None,
    reference_emission: Float32 | Halves | None = None,
    exposure: float | None = None,
) -> Metrics:
    """Compare a picture with a path-traced truth.

    image: [height, width, 3], linear RGB, or two independent halves of it. reference: two
      independent halves of the truth.
    emission: directly seen emission, left out of the image, and of the truth too unless
      reference_emission gives the truth's own. Either may be two halves: what the samples of
      each half saw. The edge of a lamp is then left out exactly, noise and all.
    exposure: factor for the displayed pictures; set from the truth when None.

    Returns, with R the mean of the halves and I the image, emission left out of both:
      rmse: root mean square of I − R over pixels and channels, linear.
      rel_rmse: ‖I − R‖₂ / ‖R‖₂.
      noise: √(‖R₁ − R₂‖² + ‖I₁ − I₂‖²) / (2 ‖R‖₂), the part of rel_rmse that is noise.
      rel_rmse_beyond_noise: √max(rel_rmse² − noise², 0).
      noise_error, rel_rmse_beyond_noise_error: their standard errors, from the spread over
        pixels. Where the excess is zero the second is the excess that would not be seen.
      psnr: dB, of the whole pictures as displayed, at most 120. flip: their mean LDR-FLIP.
      mean_image, mean_reference: means of I and R. exposure: the factor that was used.

    Raises InvalidValue when shapes differ or a value is not finite.
    """
    if reference_emission is None:
        reference_emission = emission
    image_first, image_second = _reflected_halves(image, emission)
    first, second = _reflected_halves(reference, reference_emission)
    for name, picture in (("image", image_first), ("image", image_second), ("reference", second)):
        if picture.shape != first.shape:
            raise InvalidValue(
                f"{name} must have the reference's shape {first.shape}; got {picture.shape}"
            )
    truth, ours = (first + second) / 2, (image_first + image_second) / 2
    if not (np.isfinite(truth).all() and np.isfinite(ours).all()):
        raise InvalidValue("image and reference must be finite; got NaN or infinity")

    # Squared error and squared noise of every pixel, channels summed: these correlate
    error = _squared(ours - truth)
    noise = (_squared(first - second) + _squared(image_first - image_second)) / 4
    energy = float((truth**2).sum())
    scale = 1 / energy if energy > 0 else 1.0
    excess = max(float((error - noise).sum()) * scale, 0.0)
    noise_squared = float(noise.sum()) * scale

    if exposure is None:
        exposure = auto_exposure(truth.astype(np.float32))
    shown_ours, shown_truth = (display(_mean(picture), exposure) for picture in (image, reference))
    mean_square = float(((shown_ours.astype(np.float64) - shown_truth) ** 2).mean())
    floor = 10 ** (-PSNR_CEILING / 10)
    return Metrics(
        rmse=math.sqrt(float(error.mean()) / 3),
        rel_rmse=math.sqrt(float(error.sum()) * scale),
        rel_rmse_beyond_noise=math.sqrt(excess),
        rel_rmse_beyond_noise_error=_root_error(excess, error - noise, scale),
        noise=math.sqrt(noise_squared),
        noise_error=_root_error(noise_squared, noise, scale),
        psnr=-10 * math.log10(max(mean_square, floor)),
        flip=flip(shown_ours, shown_truth).mean,
        mean_image=float(ours.mean()),
        mean_reference=float(truth.mean()),
        exposure=exposure,
    )


def _reflected_halves(
    picture: Float32 | Halves, emission: Float32 | Halves | None
) -> tuple[Float64, Float64]:
    """Both halves of a picture, twice the same one where it has none, emission left out."""
    first, second = picture if isinstance(picture, tuple) else (picture, picture)
    seen = emission if isinstance(emission, tuple) else (emission, emission)
    return without_emission(first, seen[0]), without_emission(second, seen[1])


def _mean(picture: Float32 | Halves) -> Float32:
    return np.mean(picture, axis=0) if isinstance(picture, tuple) else picture


def _squared(difference: Float64) -> Float64:
    return (difference**2).sum(axis=-1)  # type: ignore[no-any-return]


def _root_error(square: float, terms: Float64, scale: float) -> float:
    """How far √square moves when square = scale · Σ terms grows by one standard error.

    Independent terms. Well away from zero it is error / (2 √square); at zero, √error.
    """
    error = scale * math.sqrt(terms.size) * float(terms.std())
    return math.sqrt(square + error) - math.sqrt(square)
