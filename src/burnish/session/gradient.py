"""The derivative of one's own loss by the parameters, for an optimiser of one's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from burnish.core.types import Float32, Float64
from burnish.session.fitting import chosen_unknowns
from burnish.session.jacobian import PictureModel
from burnish.session.unknowns import CurveKnob, CurveOptions, Knob, Unknown

if TYPE_CHECKING:
    from burnish.session.session import Session

Loss = Callable[[Float32], tuple[float, Float32]]
"""From a picture [height, width, 3] to the loss and its derivative by the picture."""


def gradient(
    session: Session,
    loss: Loss,
    objects: Sequence[str] | None,
    parameters: Sequence[str] | None,
    view: str | None,
) -> tuple[float, dict[str, Float64]]:
    """What `Session.gradient` gives."""
    state = session.state
    unknowns = chosen_unknowns(session, objects, parameters, CurveOptions())
    renderer = session.renderer(view)
    value, slope = loss(renderer.image(state))
    image_gradient = np.asarray(slope, np.float32)
    back = renderer.gradient(state, image_gradient)
    model = PictureModel(renderer.frozen, unknowns, state)
    x = model.read(state)
    slopes = model.pull_back(x, back, image_gradient)
    result = {}
    for k, item in enumerate(unknowns):
        own = slice(int(model.offsets[k]), int(model.offsets[k + 1]))
        result[item.path] = _by_value(item, x[own], slopes[own])
    return float(value), result


def _by_value(item: Unknown, x: Float64, slopes: Float64) -> Float64:
    """dL/dvalue from dL/dx: float64 [], [3], or of a curve [points, 3]."""
    if isinstance(item, CurveKnob):
        return np.asarray(np.linalg.solve(item.mixing.T, slopes.reshape(-1, 3)), np.float64)
    assert isinstance(item, Knob)
    by_value = slopes / np.array([item.slope(float(u)) for u in x])
    return np.asarray(by_value if len(x) == 3 else by_value[0])
