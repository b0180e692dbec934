"""Pictures of finished bundles in two halves, and the truth beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import burnish
from burnish.compare import metrics
from burnish.compare.metrics import Metrics
from burnish.core.types import Float32, Float64, Value
from burnish.reference import Estimate, PathTracedTruth
from burnish.scene import Scene
from burnish.session import Session
from burnish.transport.basis import State

Edits = Mapping[str, Value]
"""Path of a parameter to its value, as for `Session.set`."""

Pair = tuple[Float32, Float32]
"""Two independent estimates of one picture, directly seen emission left out."""


@dataclass
class Halves:
    """Two bakes of one scene by different samples: they tell the noise of the bundle."""

    sessions: tuple[Session, Session]

    @staticmethod
    def bake(
        scene: Scene,
        folder: Path,
        *,
        series: Sequence[int],
        spp: int,
        editable: Sequence[str] | None = None,
    ) -> Halves:
        """Half of `spp` samples per pixel each, stored and opened again."""
        bundles = [
            burnish.bake(
                scene,
                folder / f"half-{seed}-{'-'.join(map(str, series))}.burnish",
                editable=editable,
                series=series,
                spp=spp // 2,
                seed=seed,
            )
            for seed in (1, 2)
        ]
        first, second = (burnish.edit(bundle) for bundle in bundles)
        return Halves((first, second))

    def edit(self, edits: Edits, *, reset: bool = True) -> State:
        """The materials after these edits; without `reset`, on top of earlier ones."""
        for session in self.sessions:
            if reset:
                session.reset()
            for path, value in edits.items():
                session.set(path, value)
        return self.sessions[0].state

    def frames(self) -> Pair:
        """Each half's picture without the emission that its own samples saw directly."""
        first, second = (
            session.frame() - next(iter(session.views.values())).emission
            for session in self.sessions
        )
        return first, second


@dataclass
class Found:
    """A comparison, its two pictures and their halves, directly seen emission left out."""

    metrics: Metrics
    image: Float32
    reference: Float32
    halves: Pair
    reference_halves: Pair


def compare(halves: Pair, truth: Estimate) -> Found:
    """Two halves of our picture against the two of the truth."""
    first, second = (
        half - seen for half, seen in zip(truth.halves, truth.emission_halves, strict=True)
    )
    return Found(
        metrics(halves, (first, second)),
        (halves[0] + halves[1]) / 2,
        truth.reflected,
        halves,
        (first, second),
    )


def certainty(ours: Pair, plainer: Pair, truth: Pair, limit: float) -> float:
    """By how many standard errors our error is below `limit` times that of a plainer picture.

    Both against the same truth. With I, P, R the means of the halves and i, p, r half of what
    the halves differ by, (I − R)² − i² − r² estimates our squared error E without bias, and so
    does the plainer one's E'. To first order in the noise, and for the part that is noise
    alone, i, p and r move limit² E' − E by

        2 [limit² (P − R) · (p − r) − (I − R) · (i − r)]

    in each pixel, whose squares sum to the variance. The noise is all that it holds: pictures
    of the same scene do not vary otherwise.
    """
    (I, i), (P, p), (R, r) = (
        ((a.astype(np.float64) + b) / 2, (a.astype(np.float64) - b) / 2)
        for a, b in (ours, plainer, truth)
    )
    square = limit**2
    mine, other = _dot(I - R, I - R) - _dot(i, i), _dot(P - R, P - R) - _dot(p, p)
    margin = square * (other - _dot(r, r)) - (mine - _dot(r, r))
    moved = (
        _dot(I - R, i) ** 2
        + (square * _dot(P - R, p)) ** 2
        + _dot(I - R - square * (P - R), r) ** 2
    )
    return float(margin.sum() / (2 * np.sqrt(moved.sum())))


def against_quiet_truth(
    halves: Halves, tracer: PathTracedTruth, edits: Edits, spp: int, limit: float, most: int = 16
) -> Found:
    """The same, with up to `most` times the samples of the reference where its part of the noise
    is more than half of a limit: a mirror shows lamps that few paths find."""
    state = halves.edit(edits)
    frames = halves.frames()
    truth = tracer.estimate(state, spp=spp, seed=77)
    found, seed = compare(frames, truth), 78
    while _noise_of(found.reference_halves) > limit / 2 and truth.samples < most * spp:
        truth = pooled(truth, tracer.estimate(state, spp=truth.samples, seed=seed))
        found, seed = compare(frames, truth), seed + 1
    return found


def _noise_of(pair: Pair) -> float:
    """The part of the noise that is one picture's."""
    first, second = (half.astype(np.float64) for half in pair)
    return float(np.linalg.norm(first - second) / np.linalg.norm(first + second))


def pooled(a: Estimate, b: Estimate) -> Estimate:
    """Two estimates by different seeds as one, weighted by their samples."""
    share = a.samples / (a.samples + b.samples)

    def mix(x: Float32, y: Float32) -> Float32:
        return np.asarray(share * x + (1 - share) * y, np.float32)

    first, second = (mix(x, y) for x, y in zip(a.halves, b.halves, strict=True))
    seen = [mix(x, y) for x, y in zip(a.emission_halves, b.emission_halves, strict=True)]
    return Estimate(
        mix(a.image, b.image),
        (first, second),
        mix(a.emission, b.emission),
        (seen[0], seen[1]),
        np.asarray(share**2 * a.variance + (1 - share) ** 2 * b.variance, np.float32),
        a.samples + b.samples,
    )


def _dot(a: Float64, b: Float64) -> Float64:
    """Of the colours of each pixel: [height, width]."""
    return np.asarray((a * b).sum(axis=-1))


def against_truth(
    halves: Halves, tracer: PathTracedTruth, edits: Edits, spp: int, seed: int = 77
) -> Found:
    """The edited picture against Mitsuba's path tracer with the same materials."""
    state = halves.edit(edits)
    return compare(halves.frames(), tracer.estimate(state, spp=spp, seed=seed))
