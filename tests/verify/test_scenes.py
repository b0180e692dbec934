"""Scenes by others: as they are, and with one roughness edited, against Mitsuba.

Not the dining room and veach-bidir: single paths of theirs are so bright that no figure
counts. Bake and reference together had 15 % of noise at 16,384 samples in the one, at two
bounces and 48 × 36 pixels, and 13 % at 1,024 in the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from burnish.reference import PathTracedTruth
from burnish.scene import load
from tests.verify.pictures import Halves, against_truth
from tests.verify.report import Figures

pytestmark = pytest.mark.verify

ROUGHNESS = (0.05, 0.1, 0.2, 0.35, 0.6)


@dataclass(frozen=True)
class Case:
    """The one object that is editable in a scene.

    layer: the one whose roughness is edited, "" for a matte object. limit: of the unedited
    picture; 0.05 where the object sees itself. spp: keeps the noise below that.
    """

    file: str
    object: str
    layer: str
    series: tuple[int, ...]
    limit: float
    spp: int
    resolution: tuple[int, int] = (64, 48)


TINY, SMALL = (32, 24), (48, 36)
"""Where bright paths are rare the budget goes into samples, not into pixels."""

PLASTIC, TEAPOT, PLATE = "shape-matpreview-exterior", "teapot", "SuperRough"
CASES = (
    Case("cbox/cbox.xml", "box_2", "", (64, 1, 1, 1), 0.02, 4096),
    Case("teapot_simple/scene.xml", TEAPOT, "", (64, 1, 1), 0.05, 2048),
    Case("matpreview/matpreview.xml", PLASTIC, "specular", (64, 1, 1), 0.05, 4096),
    Case("veach-mis/scene.xml", PLATE, "specular", (64, 1, 1), 0.02, 98304, TINY),
    Case("staircase2/scene.xml", "Wood_0003", "specular", (64, 1, 1), 0.02, 16384, SMALL),
    Case("living-room/scene.xml", "Floor", "specular", (64, 1), 0.02, 65536, SMALL),
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: Path(case.file).parent.name)
def test_a_scene_as_it_is_and_edited(
    figures: Figures, assets: Path, tmp_path: Path, case: Case
) -> None:
    """One object editable, the others fixed: unedited it is Mitsuba's picture, and with its
    roughness edited that of Mitsuba with that roughness, within 0.05."""
    scene = load(assets / "scenes" / case.file, resolution=case.resolution)
    tracer = PathTracedTruth(scene, bounces=len(case.series))
    halves = Halves.bake(scene, tmp_path, series=case.series, spp=case.spp, editable=[case.object])
    found = against_truth(halves, tracer, {}, case.spp)
    figures.close("as it is", found.metrics, case.limit, found.image, found.reference)
    for roughness in ROUGHNESS if case.layer else ():
        path = f"{case.object}.{case.layer}.roughness"
        # Only as clean as its own limit asks
        spp = case.spp if case.limit >= 0.05 else case.spp // 4
        found = against_truth(halves, tracer, {path: roughness}, spp)
        name = f"roughness {roughness:g}"
        figures.close(name, found.metrics, 0.05, found.image, found.reference)
    figures.settle()
