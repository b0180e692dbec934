"""A comparison on one page: ours, the truth, where they visibly differ, and by how much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from burnish.compare.flip import flip
from burnish.compare.tone import auto_exposure, display
from burnish.core.types import AnyArray, Float32

BACKGROUND = (24, 25, 28)
FRAME = (58, 60, 66)
TEXT = (232, 233, 236)
FAINT = (150, 153, 161)
MARGIN, GAP = 28, 18
TITLE_SIZE, HEADING_SIZE, TEXT_SIZE = 24, 17, 15
SMALLEST_PANEL = 360
"""Panels narrower than this are shown at a whole multiple of their size."""

LABELS = {
    "rel_rmse_beyond_noise": "rel. RMSE beyond noise",
    "rel_rmse": "rel. RMSE",
    "noise": "of which noise",
    "rmse": "RMSE",
    "psnr": "PSNR",
    "flip": "FLIP",
    "mean_image": "mean, ours",
    "mean_reference": "mean, truth",
    "seconds_edit": "edit",
    "seconds_reference": "path tracing",
}
UNITS = {"psnr": " dB", "seconds_edit": " s", "seconds_reference": " s"}
ERRORS = {"noise": "noise_error", "rel_rmse_beyond_noise": "rel_rmse_beyond_noise_error"}


def sheet(
    image: Float32,
    reference: Float32,
    numbers: Mapping[str, float],
    *,
    title: str = "",
    subtitle: str = "",
    headings: Sequence[str] = ("burnish", "path traced", "FLIP"),
    exposure: float | None = None,
) -> Image.Image:
    """Draw the sheet.

    image, reference: linear RGB [height, width, 3]. numbers: what `metrics` returns, or any
    part of it, with seconds_edit and seconds_reference when known; names without a label are
    left out. exposure: factor for both pictures; set from the reference when None.
    Returns an RGB picture to `save`.
    """
    if exposure is None:
        exposure = numbers.get("exposure") or auto_exposure(reference)
    ours, truth = display(image, exposure), display(reference, exposure)
    difference = flip(ours, truth)
    panels = [_panel(picture) for picture in (ours, truth, difference.heat)]
    width, height = panels[0].size

    top = MARGIN + (TITLE_SIZE + 10 if title else 0) + (TEXT_SIZE + 20 if subtitle else 0)
    picture_top = top + HEADING_SIZE + 10
    facts = _facts({"flip": difference.mean, **numbers})
    columns = 3
    lines = -(-len(facts) // columns)
    facts_top = picture_top + height + 26
    page = Image.new(
        "RGB",
        (2 * MARGIN + 3 * width + 2 * GAP, facts_top + lines * (TEXT_SIZE + 9) + MARGIN - 9),
        BACKGROUND,
    )
    draw = ImageDraw.Draw(page)

    # Say what is compared
    if title:
        _text(draw, (MARGIN, MARGIN - 6), title, TITLE_SIZE, TEXT)
    if subtitle:
        _text(draw, (MARGIN, top - TEXT_SIZE - 22), subtitle, TEXT_SIZE, FAINT)

    # Show the three pictures
    for k, (panel, heading) in enumerate(zip(panels, headings, strict=True)):
        left = MARGIN + k * (width + GAP)
        _text(draw, (left, top), heading, HEADING_SIZE, TEXT)
        page.paste(panel, (left, picture_top))
        draw.rectangle(
            (left - 1, picture_top - 1, left + width, picture_top + height), outline=FRAME
        )

    # Give the numbers, column by column
    for k, (label, value) in enumerate(facts):
        left = MARGIN + (k // lines) * (width + GAP)
        line = facts_top + (k % lines) * (TEXT_SIZE + 9)
        _text(draw, (left, line), label, TEXT_SIZE, FAINT)
        _text(draw, (left + width, line), value, TEXT_SIZE, TEXT, anchor="ra")
    return page


def _facts(numbers: Mapping[str, float]) -> list[tuple[str, str]]:
    """Label and formatted value of each known number, in the order of `LABELS`."""
    facts = []
    for name, label in LABELS.items():
        if name in numbers:
            value = _digits(numbers[name])
            if ERRORS.get(name) in numbers:
                value += f" ± {_digits(numbers[ERRORS[name]], 2)}"
            facts.append((label, value + UNITS.get(name, "")))
    return facts


def _digits(value: float, digits: int = 4) -> str:
    """Plain decimals where they are short, powers of ten where they are not."""
    text = f"{value:.{digits}g}"
    return f"{value:.1e}" if "e" in text else text


def _panel(shown: AnyArray) -> Image.Image:
    pixels = np.clip(shown * 255 + 0.5, 0, 255).astype(np.uint8)
    picture = Image.fromarray(pixels)
    factor = max(1, -(-SMALLEST_PANEL // picture.width))
    return picture.resize(
        (picture.width * factor, picture.height * factor), Image.Resampling.NEAREST
    )


def _text(
    draw: ImageDraw.ImageDraw,
    at: tuple[int, int],
    text: str,
    size: int,
    fill: tuple[int, int, int],
    anchor: str = "la",
) -> None:
    draw.text(at, text, fill=fill, font=ImageFont.load_default(size), anchor=anchor)
