"""Freehand curves: exact at their points, never overshooting, and round trips."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from burnish.core.errors import InvalidValue
from burnish.materials.curve import Curve

channel = st.floats(0, 1e6, allow_nan=False)


@st.composite
def curves(draw: Any) -> Curve:
    points = sorted(draw(st.sets(st.integers(0, 1000), min_size=1, max_size=12)))
    values = [tuple(draw(channel) for _ in range(3)) for _ in points]
    return Curve(
        tuple(t / 1000 for t in points),
        tuple(values),
        draw(st.sampled_from(["replace", "gain"])),
        draw(st.sampled_from(["cubic", "linear"])),
    )


@given(curves())
def test_json_round_trip(curve: Curve) -> None:
    assert Curve.from_json(json.loads(json.dumps(curve.to_json()))) == curve


@given(curves())
def test_passes_through_its_points(curve: Curve) -> None:
    found = curve.evaluate(np.array(curve.points))
    np.testing.assert_allclose(found, curve.values, rtol=1e-12, atol=1e-9)


@given(curves())
def test_stays_between_neighbouring_points(curve: Curve) -> None:
    values = np.array(curve.values)
    t = np.linspace(0, 1, 501)
    found = curve.evaluate(t)
    i = np.clip(np.searchsorted(curve.points, t, side="right") - 1, 0, len(values) - 1)
    j = np.where(t < curve.points[0], i, np.minimum(i + 1, len(values) - 1))
    low, high = np.minimum(values[i], values[j]), np.maximum(values[i], values[j])
    room = 1e-9 * (1 + values.max())
    assert (found >= low - room).all()
    assert (found <= high + room).all()


def test_gain_and_replace() -> None:
    t, profile = np.array([0.0, 0.5, 1.0]), np.array([[4.0], [2.0], [1.0]])
    line = ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    gain = Curve((0.0, 1.0), line, "gain", "linear")
    np.testing.assert_allclose(gain.apply(t, profile), [[0, 0, 0], [1, 2, 3], [1, 2, 3]])
    replaced = Curve((0.0, 1.0), line, "replace", "linear")
    np.testing.assert_allclose(replaced.apply(t, profile), [[0, 0, 0], [0.5, 1, 1.5], [1, 2, 3]])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mode": "add"}, "mode must be"),
        ({"interpolation": "quintic"}, "interpolation must be"),
        ({"points": (0.5, 0.5)}, "must rise"),
        ({"points": (0.5, 1.5)}, r"lie in \[0, 1\]"),
        ({"points": (0.5,)}, "1 points and 2 colours"),
        ({"values": ((1.0, 1.0, 1.0), (1.0, -1.0, 1.0))}, ">= 0"),
        ({"values": ((1.0, 1.0, 1.0), (1.0, float("nan"), 1.0))}, ">= 0"),
        ({"values": ((1.0, 1.0, 1.0), (1.0, float("inf"), 1.0))}, "finite"),
    ],
)
def test_bad_curves_say_why(fields: dict[str, Any], message: str) -> None:
    good: dict[str, Any] = {"points": (0.0, 1.0), "values": ((1.0, 1.0, 1.0),) * 2}
    with pytest.raises(InvalidValue, match=message):
        Curve(**{**good, **fields})


@pytest.mark.parametrize("data", [{}, {"t": 3}, {"mode": "gain", "t": [0], "values": [[1]]}])
def test_bad_json_says_why(data: dict[str, Any]) -> None:
    with pytest.raises(InvalidValue, match="a curve needs"):
        Curve.from_json(data)
