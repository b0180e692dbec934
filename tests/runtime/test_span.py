"""What a drag's frames are mixed from equals what is read from F."""

from __future__ import annotations

import numpy as np
import pytest

from burnish.core.types import Float32, Float64
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.runtime.span import CLOSE, DRAG_SECONDS, Span
from burnish.transport.basis import ColumnSlice, initial_state
from burnish.transport.frozen import FrozenPart
from tests.runtime.test_expansion import expanded
from tests.runtime.worlds import basis_of, edited, random_world, shaded

PIXELS = 2000


class Clock:
    """Seconds that pass with every look."""

    def __init__(self, step: float = 0.01) -> None:
        self.now, self.step = 0.0, step

    def __call__(self) -> float:
        self.now += self.step
        return self.now


def part(rng: np.random.Generator, rows: int, columns: int, spread: float = 6.0) -> FrozenPart:
    """Random rows whose columns differ by powers of ten, as narrow bins do from wide ones."""
    size = 10.0 ** rng.uniform(-spread, 0.0, columns)
    return FrozenPart(
        object=0,
        indirect=False,
        pixel=np.sort(rng.choice(PIXELS, rows, replace=False)).astype(np.int32),
        F=(rng.random((3, rows, columns)) * size).astype(np.float32),
        cos_theta_o=np.ones(rows, np.float32),
        slice=ColumnSlice(0, 0, columns, False),
    )


def drag(rng: np.random.Generator, parts: list[FrozenPart], count: int) -> list[Float64]:
    """Weights of a smooth family: lobes of rising exponents over the columns, in three colours."""
    columns = sum(item.F.shape[2] for item in parts)
    angle = np.linspace(0.0, 1.5, columns)
    size = np.concatenate([item.F.mean(axis=(0, 1)) for item in parts])
    colour = rng.uniform(0.1, 1.0, 3)[:, None]
    lobes = [np.cos(angle) ** n for n in np.geomspace(2.0, 200.0, count)]
    return [colour * lobe / size for lobe in lobes]


def plainly(parts: list[FrozenPart], weights: Float64) -> Float64:
    """Σ_c F · weight of every pixel, in double precision: [3, pixels]."""
    result, start = np.zeros((3, PIXELS)), 0
    for item in parts:
        own = weights[:, start : start + item.F.shape[2]]
        result[:, item.pixel] += np.einsum("hrc,hc->hr", item.F.astype(np.float64), own)
        start += item.F.shape[2]
    return result


def close(light: Float32, exact: Float64) -> None:
    """Equal but for what is left out of weights: `CLOSE` of the mean square, at every pixel."""
    size = np.sqrt((exact**2).mean(axis=1, keepdims=True))
    assert np.abs(light - exact).max() < 10 * CLOSE * size.max()
    assert np.sqrt(((light - exact) ** 2).mean()) < CLOSE * size.max()


@pytest.mark.parametrize("alone", [True, False])
def test_a_drag_is_what_F_says(alone: bool) -> None:
    rng = np.random.default_rng(1)
    parts = [part(rng, 900, 96)] if alone else [part(rng, 900, 96), part(rng, 1600, 24)]
    span = Span(parts, PIXELS, Clock())
    seen = drag(rng, parts, 60)
    for weights in [*seen, *seen[::-3]]:
        exact = plainly(parts, weights)
        close(span.light(weights), exact[:, parts[0].pixel] if alone else exact)


def test_a_drag_reads_F_a_few_times(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    parts = [part(rng, 900, 96), part(rng, 1600, 24)]
    span = Span(parts, PIXELS, Clock())
    seen = drag(rng, parts, 200)
    products = 0
    contract = Span._contract

    def counted(self: Span, weights: Float32, *others: object) -> None:
        nonlocal products
        products += 1
        contract(self, weights, *others)  # type: ignore[arg-type]

    monkeypatch.setattr(Span, "_contract", counted)
    for weights in seen:
        span.light(weights)
    first = products
    for weights in seen[::-1]:
        span.light(weights)
    assert first < len(seen) / 4
    # The way back is in the span of the way there
    assert products == first


def test_random_weights_find_no_span_and_are_right() -> None:
    rng = np.random.default_rng(3)
    parts = [part(rng, 900, 96)]
    span = Span(parts, PIXELS, Clock())
    for _ in range(120):
        weights = rng.random((3, 96)) / parts[0].F.mean(axis=(0, 1))
        close(span.light(weights), plainly(parts, weights)[:, parts[0].pixel])


def test_frames_apart_are_read_from_F() -> None:
    rng = np.random.default_rng(4)
    parts = [part(rng, 900, 96)]
    span = Span(parts, PIXELS, Clock(2 * DRAG_SECONDS))
    for weights in drag(rng, parts, 5):
        np.testing.assert_array_equal(span.light(weights), span.plain(weights))


def test_newer_numbers_arrive_with_the_frames_of_a_drag() -> None:
    rng = np.random.default_rng(5)
    parts = [part(rng, 900, 96), part(rng, 1600, 24)]
    span = Span(parts, PIXELS, Clock())
    seen = drag(rng, parts, 60)
    for weights in seen[:30]:
        span.light(weights)
    for item in parts:
        item.F *= rng.uniform(0.5, 1.5, item.F.shape).astype(np.float32)
    assert span.continues(parts)
    span.renew(parts)
    for weights in seen[30:]:
        light = span.light(weights)
    close(light, plainly(parts, seen[-1]))


def test_a_picture_at_rest_is_of_the_newest_numbers() -> None:
    rng = np.random.default_rng(6)
    parts = [part(rng, 900, 96)]
    span = Span(parts, PIXELS, Clock())
    seen = drag(rng, parts, 20)
    for weights in seen:
        span.light(weights)
    parts[0].F *= 2.0
    span.renew(parts)
    np.testing.assert_array_equal(span.light(seen[-1]), span.plain(seen[-1]))


def test_columns_that_were_empty_and_fill_up_count() -> None:
    rng = np.random.default_rng(7)
    parts = [part(rng, 900, 96, spread=1.0)]
    seen = drag(rng, parts, 80)
    later = parts[0].F[:, :, 40:].copy()
    parts[0].F[:, :, 40:] = 0.0
    span = Span(parts, PIXELS, Clock())
    for weights in seen[:20]:
        span.light(weights)
    parts[0].F[:, :, 40:] = later
    span.renew(parts)
    for weights in seen[20:]:
        light = span.light(weights)
    close(light, plainly(parts, seen[-1])[:, parts[0].pixel])


def test_spans_go_on_where_F_lies_in_the_same_memory() -> None:
    rng = np.random.default_rng(8)
    first, other = part(rng, 900, 96), part(rng, 900, 96)
    span = Span([first], PIXELS)
    assert span.continues([first])
    assert not span.continues([other])
    assert not span.continues([first, other])


def test_a_renderer_drags_as_one_that_begins_with_every_frame() -> None:
    basis = basis_of((6, 3, 1), shaded("lid"))
    start = initial_state(basis.objects)
    frozen = expanded(freeze(random_world(basis)[0], (0, 2), start))
    frozen.in_place = True
    before = None
    for turn in range(2):
        renderer = Renderer(frozen, before)
        for exponent in np.linspace(2.0, 60.0, 25):
            state = edited(start, "box", "lid", exponent=float(exponent) + turn)
            image = renderer.image(state)
            np.testing.assert_allclose(image, Renderer(frozen).image(state), CLOSE, CLOSE)
        before = renderer.spans
    assert before
