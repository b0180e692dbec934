"""Painting in a live session, through the real worker process."""

from __future__ import annotations

import numpy as np

import burnish
from burnish.core.types import Float32
from tests.app.test_live import until, view_of


def around(image: Float32, x: int, y: int) -> Float32:
    return np.asarray(image[y - 1 : y + 2, x - 1 : x + 2].mean(axis=(0, 1)))


def is_green(image: Float32, x: int, y: int) -> bool:
    red, green, blue = around(image, x, y)
    return bool(green > 5 * max(red, blue))


def test_paint_keeps_every_sample_and_stays_when_another_object_is_selected() -> None:
    with burnish.edit("cornell-box", resolution=(48, 48)) as live:
        live.select("back")
        live.frame()
        until(lambda: view_of(live).samples >= 13)
        samples = view_of(live).samples
        place = live.object_map() == next(
            i for i, item in enumerate(view_of(live).basis.objects) if item.id == "back"
        )
        y, x = (int(np.median(axis)) for axis in np.nonzero(place))
        assert place[y, x]
        assert place.sum() > 250
        live.paint_whole("diffuse-color", color=(0.0, 0.0, 0.0))
        live.paint("diffuse-color", [(x + 0.5, y + 0.5)], size=4, falloff=0, color=(0, 0.9, 0))
        image = live.frame()
        # Samples are kept: the selection is what is painted
        assert view_of(live).samples >= samples
        assert is_green(image, x, y)
        # A disc of radius 4 is 50 of the wall's some 400 pixels; the rest is black
        assert around(image, x, y)[1] > 3 * image[place].mean(axis=0)[1]
        # Of another selection too, of which painted objects are a part
        live.select("floor")
        until(live.ready)
        assert is_green(live.frame(), x, y)
        # The path tracer shows the same: the wall is one shape with uv coordinates
        assert is_green(live.path_trace(spp=16), x, y)
        live.undo()
        live.undo()
        assert not live.state["back"].strokes
