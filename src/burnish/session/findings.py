"""What a fit found, and what the picture can and cannot say about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from burnish.core.types import Float32, Float64, Value
from burnish.materials.curve import Curve
from burnish.transport.basis import State

DETERMINED = 0.05
"""A number is determined when its standard deviation is at most this share of its travel."""
REACHED = 0.02
"""A wish is reached when what remains, noise apart, is at most this share of the target."""
_BLOCK = 5
"""Pixels over which remains of an unreachable wish hang together, and noise does not."""


@dataclass(frozen=True)
class FittedNumber:
    """One number of a fit. deviation: standard deviation in travel, 1 for the slider's length.

    limit: "minimum" or "maximum" where the target pulls beyond the model's range, else "".
    """

    name: str
    deviation: float
    limit: str

    @property
    def determined(self) -> bool:
        """Whether the picture says what it should be."""
        return self.deviation <= DETERMINED


@dataclass(frozen=True)
class Direction:
    """Numbers that the picture sees only together, from the Jacobian's singular values.

    gain: the change of the picture per travel, as a share of the target. parts: by name, the
    direction's components (their squares add to 1), largest first. deviation: in travel.
    """

    gain: float
    deviation: float
    parts: dict[str, float]


@dataclass(frozen=True)
class Fit:
    """The material that comes closest to a target.

    state: the materials of all objects. values: what was fitted, by path. error,
    error_before: relative RMS of the gap over the mask, in the target's terms. structure: the
    share of `error` that is no noise. residual: float32 [height, width, 3], shown − target,
    0 outside the mask. numbers, directions: what the picture determines, best direction
    first. limited: why the wish was not reached, if it was not.
    """

    state: State
    values: dict[str, Value | Curve]
    error: float
    error_before: float
    structure: float
    residual: Float32
    numbers: tuple[FittedNumber, ...]
    directions: tuple[Direction, ...]
    limited: tuple[str, ...]
    steps: int
    seconds: float

    @property
    def reached(self) -> bool:
        """Whether the material gives the target but for its noise."""
        return self.structure <= REACHED

    @property
    def determined(self) -> tuple[str, ...]:
        """Names of the numbers that the picture determines."""
        return tuple(item.name for item in self.numbers if item.determined)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of those that it leaves free; they stay near where they were."""
        return tuple(item.name for item in self.numbers if not item.determined)

    def heat_map(self, largest: float | None = None) -> Float32:
        """The residual as a picture: float32 [height, width, 3], display colours in [0, 1].

        Black for none, then blue, red, yellow, white for `largest` (default: the 99th
        percentile of what is not zero).
        """
        size = np.linalg.norm(self.residual, axis=2)
        if largest is None:
            seen = size[size > 0]
            largest = float(np.percentile(seen, 99)) if len(seen) else 1.0
        share = np.clip(size / largest, 0, 1)
        stops = np.linspace(0, 1, 5)
        ramp = np.array([[0, 0, 0], [0.15, 0.1, 0.6], [0.85, 0.1, 0.2], [1, 0.8, 0.1], [1, 1, 1]])
        channels = [np.interp(share, stops, ramp[:, h]) for h in range(3)]
        return np.stack(channels, axis=2).astype(np.float32)

    def report(self) -> str:
        """A few lines for people."""
        lines = [
            f"error {self.error:.2%} of the target (before: {self.error_before:.2%}), "
            f"{self.structure:.2%} without its noise; {self.steps} steps in {self.seconds:.2f} s"
        ]
        if not self.reached:
            lines.append("the wish is out of reach; this is the closest that the material comes")
        lines += [f"limit: {reason}" for reason in self.limited]
        if self.determined:
            lines.append("determined: " + ", ".join(self.determined))
        if self.free:
            lines.append("left free: " + ", ".join(self.free))
        return "\n".join(lines)


def structure_of(residual: Float64, weight: Float64) -> float:
    """RMS of a residual [h, w, 3] without its noise: what neighbouring pixels share.

    The mean over 5 × 5 pixels keeps what hangs together; of independent noise it keeps the
    mean of the squares over the number of pixels, which is taken off.
    """
    inside = (weight > 0).astype(np.float64)
    count = box_sum(inside)
    sums = np.stack([box_sum(residual[..., h] * inside) for h in range(3)], axis=2)
    squares = np.stack([box_sum(residual[..., h] ** 2 * inside) for h in range(3)], axis=2)
    n = np.maximum(count, 1.0)[..., None]
    # An unbiased estimate of the squared mean: Σ_{i≠j} r_i r_j / n (n − 1)
    shared = (sums**2 - squares) / (n * np.maximum(n - 1, 1.0))
    use = (count > 1) & (inside > 0)
    return float(np.sqrt(max(float(shared[use].mean()), 0.0))) if use.any() else 0.0


def identify(
    information: Float64, names: tuple[str, ...], deviation: float, size: float
) -> tuple[Float64, tuple[Direction, ...]]:
    """Standard deviations of the numbers [n], and the directions that the picture sees.

    information: JᵀJ in travel. deviation: of one residual. size: the target's norm.
    """
    values, vectors = np.linalg.eigh(information)
    values, vectors = values[::-1], vectors[:, ::-1]
    # Rounding of single-precision transport hides what lies further down
    values = np.maximum(values, max(float(values[0]), 1e-30) * 1e-12)
    deviations = deviation / np.sqrt(values)
    directions = []
    for k, value in enumerate(values):
        order = np.argsort(-np.abs(vectors[:, k]))
        parts = {names[i]: float(vectors[i, k]) for i in order if abs(vectors[i, k]) > 0.05}
        directions.append(Direction(float(np.sqrt(value)) / size, float(deviations[k]), parts))
    return np.sqrt((vectors**2) @ deviations**2), tuple(directions)


def likely_deviation(residual: Float64, weight: Float64, size: float) -> float:
    """Standard deviation of one residual [h, w, 3], with what hangs together counted once.

    A model's own error of a thousandth of the target (size: its norm) is always granted.
    """
    entries = max(3 * int((weight > 0).sum()), 1)
    noise = float((residual**2).sum()) / entries
    shared = structure_of(residual, weight) ** 2
    return float(np.sqrt(noise + _BLOCK**2 * shared + 1e-6 * size**2 / entries))


def box_sum(values: Float64) -> Float64:
    """Sums over the squares of 5 × 5 pixels about each pixel of [h, w]."""
    half, k = _BLOCK // 2, _BLOCK
    padded = np.pad(values, ((half + 1, half), (half + 1, half)))
    total = padded.cumsum(axis=0).cumsum(axis=1)
    return np.asarray(total[k:, k:] - total[:-k, k:] - total[k:, :-k] + total[:-k, :-k])
