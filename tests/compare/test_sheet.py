"""The sheet holds the three pictures, unchanged, and stays within its page."""

from __future__ import annotations

import numpy as np

from burnish.compare import display, metrics, sheet
from burnish.compare.sheet import GAP, MARGIN


def test_the_sheet_shows_both_pictures_and_the_map() -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(0, 1, (40, 400, 3)).astype(np.float32)
    image = (truth * np.float32(1.2)).astype(np.float32)
    figures = metrics(image, (truth, truth), exposure=1.0)
    page = np.asarray(sheet(image, truth, {**figures, "seconds_edit": 0.01}, title="a title"))
    heading = np.flatnonzero((page[:, MARGIN + 5] != page[0, 0]).any(-1))
    for k, picture in enumerate((image, truth)):
        left = MARGIN + k * (400 + GAP)
        shown = (display(picture) * 255 + 0.5).astype(np.uint8)
        tops = [t for t in heading if np.array_equal(page[t, left : left + 400], shown[0])]
        assert len(tops) == 1
        assert np.array_equal(page[tops[0] : tops[0] + 40, left : left + 400], shown)
    assert page.shape[1] == 2 * MARGIN + 3 * 400 + 2 * GAP


def test_small_pictures_are_enlarged_by_whole_pixels() -> None:
    picture = np.full((10, 30, 3), 0.5, np.float32)
    assert sheet(picture, picture, {}).width == 2 * MARGIN + 3 * 360 + 2 * GAP
