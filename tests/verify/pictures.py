"""Pictures of finished bundles in two halves, and the truth beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import burnish
from burnish.compare import metrics
from burnish.compare.metrics import Metrics
from burnish.core.types import Float32, Value
from burnish.reference import Estimate, PathTracedTruth
from burnish.scene import Scene
from burnish.session import Session
from burnish.transport.basis import State

Edits = Mapping[str, Value]
"""Path of a parameter to its value, as for `Session.set`."""


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

    def frames(self) -> tuple[Float32, Float32]:
        """Each half's picture without the emission that its own samples saw directly."""
        first, second = (
            session.frame() - next(iter(session.views.values())).emission
            for session in self.sessions
        )
        return first, second


@dataclass
class Found:
    """A comparison and its two pictures, directly seen emission left out."""

    metrics: Metrics
    image: Float32
    reference: Float32


def compare(halves: tuple[Float32, Float32], truth: Estimate) -> Found:
    """Two halves of our picture against the two of the truth."""
    first, second = (
        half - seen for half, seen in zip(truth.halves, truth.emission_halves, strict=True)
    )
    return Found(metrics(halves, (first, second)), (halves[0] + halves[1]) / 2, truth.reflected)


def against_truth(
    halves: Halves, tracer: PathTracedTruth, edits: Edits, spp: int, seed: int = 77
) -> Found:
    """The edited picture against Mitsuba's path tracer with the same materials."""
    state = halves.edit(edits)
    return compare(halves.frames(), tracer.estimate(state, spp=spp, seed=seed))
