"""The papers' scenes: unedited and with every knob of some objects moved, against Mitsuba."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.verify.report import Figures
from tests.verify.sweeps import Case, sweep

pytestmark = pytest.mark.verify

CASES = (
    Case("vase", "vase", series=(64, 16), spp=32768, limit=0.05),
    *(Case("vase", name, limit=0.05) for name in ("flowers", "stems")),
    *(Case("room", name, limit=0.05, bake=65536) for name in ("couch", "floor", "stairs")),
    Case("earrings", "pearls", limit=0.05, bake=65536),
    Case("earrings", "posts", limit=0.05, bake=262144),
    Case("earrings", "cloth", limit=0.05),
    *(Case("still-life", name, limit=0.05) for name in ("bottle", "bowl", "floor")),
    *(Case("interior", name, limit=0.05) for name in ("floor", "curtain", "armchair")),
    *(Case("tableau", name, limit=0.05) for name in ("bunny", "dragon", "floor")),
)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_every_knob_of_an_object(figures: Figures, tmp_path: Path, case: Case) -> None:
    """Unedited within 0.05 of Mitsuba's picture, since these objects see themselves; every
    parameter at its slider's ends and middle within 0.05, and FLIP within 0.05."""
    sweep(figures, case, Path(), tmp_path)
