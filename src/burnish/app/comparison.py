"""An edited picture held against a path tracer that is given the same materials."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from burnish.compare import metrics, sheet
from burnish.core.types import Float32, Progress

if TYPE_CHECKING:
    from PIL.Image import Image

    from burnish.reference.truth import PathTracedTruth
    from burnish.session import Session


@dataclass(frozen=True)
class Comparison:
    """Both pictures, float32 [height, width, 3] in linear RGB, and the figures of
    `burnish.compare.metrics` with seconds_edit and seconds_reference added."""

    image: Float32
    reference: Float32
    numbers: dict[str, float]
    title: str
    subtitle: str

    def sheet(self) -> Image:
        """Ours, the truth, where they visibly differ, and by how much, on one page."""
        return sheet(
            self.image, self.reference, self.numbers, title=self.title, subtitle=self.subtitle
        )


def compare_with_truth(
    session: Session,
    tracer: PathTracedTruth,
    *,
    view: str | None = None,
    spp: int = 256,
    seed: int = 1,
    progress: Progress | None = None,
) -> Comparison:
    """Compare a session's picture, as edited, with the path-traced truth.

    spp: of the truth, split into two halves that tell its noise. seconds_edit is the time
    from all materials to the picture, freezing included.
    """
    from burnish.session import Session

    name = view or next(iter(session.views))
    # A session of its own, which has frozen nothing yet
    fresh = Session(
        session.views,
        session.objects,
        name=session.name,
        lights=session.lights,
        light_pictures=session.light_mix.tracer,
    )
    if not session.light_mix.groups:
        # Its views are lit as the state says, and nothing is mixed after them
        fresh.light_mix = session.light_mix
    start = time.perf_counter()
    fresh.restore(session.state)
    image = fresh.frame(name)
    seconds_edit = time.perf_counter() - start

    start = time.perf_counter()
    truth = tracer.estimate(session.state, name, spp, seed, progress)
    seconds_reference = time.perf_counter() - start

    figures = metrics(
        image,
        truth.halves,
        emission=fresh.emission(name),
        reference_emission=truth.emission_halves,
    )
    numbers: dict[str, float] = {
        **figures,  # type: ignore[dict-item]
        "seconds_edit": seconds_edit,
        "seconds_reference": seconds_reference,
    }
    bounces = "all bounces" if tracer.bounces is None else f"{tracer.bounces} bounces"
    return Comparison(
        image,
        truth.image,
        numbers,
        f"{session.name}, {name}",
        f"the truth: Mitsuba's path tracer, {truth.samples} samples per pixel, {bounces}",
    )
