"""What bins, series and equivalent albedos cost, against the true materials."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from burnish.core.types import Value
from burnish.reference import Estimate, PathTracedTruth, series_image
from burnish.scene import Scene, load
from tests.verify.pictures import Found, Halves, certainty, compare
from tests.verify.report import Figures

pytestmark = pytest.mark.verify


FIGURE_6: dict[str, Value] = {
    "back.diffuse.color": (0.1, 0.1, 0.1),
    "back.specular.exponent": 400.0,
    "back.specular.color": (0.8, 0.8, 0.8),
    "large-box.diffuse.color": (0.75, 0.6, 0.05),
}


def test_figure_6_of_2008(figures: Figures, tmp_path: Path) -> None:
    """A glossy back wall and a recoloured box in the Cornell box, series (64, 1, 1, 1):
    at most a third of the error of direct light with diffuse indirect light (figure 7a)."""
    scene = load("cornell-box", resolution=(48, 48))
    series = (64, 1, 1, 1)
    halves = Halves.bake(scene, tmp_path, series=series, spp=32768)
    for session in halves.sessions:
        session.set_weight("back.specular", 1.0)
    state = halves.edit(FIGURE_6, reset=False)
    truth = PathTracedTruth(scene, bounces=4).estimate(state, spp=32768, seed=7)
    ours = compare(halves.frames(), truth)
    figures.close("series (64, 1, 1, 1)", ours.metrics, 0.05, ours.image, ours.reference)
    simple = series_image(
        scene, state, series, spp=32768, seed=8, direct_plus_diffuse_indirect=True
    )
    first, second = (
        half - seen for half, seen in zip(simple.halves, simple.emission_halves, strict=True)
    )
    theirs = compare((first, second), truth)
    ratio(figures, ours, theirs, 1 / 3)
    figures.settle()


CERTAIN = 2.33
"""Standard errors: the normal distribution's 1 %."""


def ratio(figures: Figures, ours: Found, theirs: Found, limit: float) -> None:
    """Our error over theirs: below the limit by more than the noise of both, in pictures whose
    noise is below what the limit allows our error (DESIGN, section 4)."""
    a, b = (found.metrics["rel_rmse_beyond_noise"] for found in (ours, theirs))
    figures.note("ours", f"{a:.4f} ± {ours.metrics['rel_rmse_beyond_noise_error']:.4f}")
    figures.note("plainer", f"{b:.4f} ± {theirs.metrics['rel_rmse_beyond_noise_error']:.4f}")
    figures.at_most("noise of ours", ours.metrics["noise"], limit * b)
    figures.at_most("noise of the plainer one", theirs.metrics["noise"], b)
    good = figures.at_most("error over that of the plainer one", a / b, limit)
    sure = certainty(ours.halves, theirs.halves, ours.reference_halves, limit)
    if not (figures.at_least("standard errors below the limit", sure, CERTAIN) and good):
        figures.keep("ours", ours.metrics, ours.image, ours.reference)
        figures.keep("plainer", theirs.metrics, theirs.image, theirs.reference)


def with_and_without(
    figures: Figures,
    scene: Scene,
    folder: Path,
    series: tuple[int, ...],
    edits: Mapping[str, Value],
    spp: int,
) -> None:
    """The error at a slower series is under half of that at (J, 1, …)."""
    tracer = PathTracedTruth(scene, bounces=len(series))
    plain = (series[0], *(1,) * (len(series) - 1))
    found: list[Found] = []
    truth: Estimate | None = None
    for chosen in (series, plain):
        halves = Halves.bake(scene, folder, series=chosen, spp=spp)
        state = halves.edit(edits)
        truth = tracer.estimate(state, spp=2 * spp, seed=77) if truth is None else truth
        found.append(compare(halves.frames(), truth))
    ratio(figures, found[0], found[1], 0.5)
    figures.settle()


@pytest.mark.parametrize(
    "edits", [{}, {"ring.specular.roughness": 0.2}], ids=["as loaded", "edited"]
)
def test_the_caustic_of_the_ring(
    figures: Figures, tmp_path: Path, edits: Mapping[str, Value]
) -> None:
    """The ring at (64, 16) against (64, 1)."""
    scene = load("ring", resolution=(64, 64))
    with_and_without(figures, scene, tmp_path, (64, 16), edits, 8192)


def test_the_teatray(figures: Figures, tmp_path: Path) -> None:
    """The teatray at (128, 8, 1) against (128, 1, 1)."""
    scene = load("teatray", resolution=(24, 18))
    with_and_without(figures, scene, tmp_path, (128, 8, 1), {}, 131072)
