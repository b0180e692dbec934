"""What a fit makes small: the weighted gap to the target, and what it should cost to stray.

    ½ Σ_pixels w² ρ(T(B(x)) − target) + ½ prior² |x − x_start|² + ½ bends² + ½ excess energy²

T is the tone map, or nothing; ρ the square, or Huber's loss, which outliers (fireflies of a
traced target) cannot pull far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from burnish.core.types import Float32, Float64, Int64
from burnish.runtime.tonemap import ToneMap
from burnish.session.jacobian import PictureModel
from burnish.session.unknowns import CurveKnob

_ENERGY = 30.0
"""Cost of an albedo of 2 over that of a black picture, as residuals."""
_NEAR = 0.5
"""Albedos below this stay below 1 in a step, or come back in the next."""


@dataclass(frozen=True)
class Wish:
    """The picture that is asked for, of a whole view.

    target: float32 [pixels, 3], linear radiance or, with a tone map, encoded display colours
    in [0, 1]. weight: float32 [pixels], 0 where nothing is asked.
    """

    target: Float32
    weight: Float32
    tone: ToneMap | None

    @property
    def pixels(self) -> Int64:
        """Those that count, rising."""
        return np.flatnonzero(self.weight > 0)

    def shown(self, image: Float32) -> Float32:
        """Radiance [..., 3] in the target's terms."""
        return image if self.tone is None else self.tone.display(image)

    def slopes(self, image: Float32) -> Float32 | None:
        """d shown / d radiance: float32 [p, 3, 3] of [p, 3], shown first, or None for 1."""
        if self.tone is None:
            return None
        result = np.empty((*image.shape, 3), np.float32)
        for h in range(3):
            step = np.zeros_like(image)
            step[..., h] = 1e-3 * (np.abs(image[..., h]) + 1e-2)
            rise = self.tone.display(image + step) - self.tone.display(image - step)
            result[..., h] = rise / (2 * step[..., h : h + 1])
        return result


class Objective:
    """The sum above, for `leastsquares.descend`.

    prior: what moving by a whole travel costs, as a share of the target. physical: albedos
    above 1 cost much. huber: the residual beyond which a pixel pulls no harder, 0 for never.
    """

    def __init__(
        self,
        model: PictureModel,
        wish: Wish,
        start: Float64,
        prior: float,
        physical: bool,
        huber: float = 0.0,
    ) -> None:
        self.model, self.wish, self.huber, self.physical = model, wish, huber, physical
        self.lower, self.upper = model.lower, model.upper
        self._start = start
        self._target = wish.target[model.pixels]
        self._weight = wish.weight[model.pixels].astype(np.float32)
        self.size = float(np.sqrt(np.sum((self._weight[:, None] * self._target) ** 2))) or 1.0
        self._prior = np.full(len(start), (prior * self.size) ** 2)
        self._bends = _bends(model, self.size)

    def residual(self, x: Float64) -> Float32:
        """w (T(B) − target): float32 [p, 3]."""
        shown = self.wish.shown(self.model.image(x).T)
        return np.asarray(self._weight[:, None] * (shown - self._target))

    def cost(self, x: Float64) -> float:
        """The sum at x."""
        r = self.residual(x).astype(np.float64)
        if self.huber > 0:
            size, k = np.abs(r), self.huber
            total = float(np.where(size <= k, 0.5 * r * r, k * (size - 0.5 * k)).sum())
        else:
            total = 0.5 * float((r * r).sum())
        total += 0.5 * float(self._prior @ (x - self._start) ** 2)
        total += 0.5 * float(np.sum((self._bends @ x) ** 2))
        if self.physical:
            excess = np.maximum(self.model.albedos(x) - 1, 0.0)
            total += 0.5 * (_ENERGY * self.size) ** 2 * float((excess**2).sum())
        return total

    def normal(self, x: Float64) -> tuple[Float64, Float64]:
        """JᵀJ and Jᵀ residual; Huber's loss as weights on the squares."""
        H, g = self._picture_terms(x, self.residual(x))
        H = H + np.diag(self._prior) + self._bends.T @ self._bends
        g = g + self._prior * (x - self._start) + self._bends.T @ (self._bends @ x)
        return H, g

    def hinges(self, x: Float64) -> tuple[Float64, Float64]:
        """Albedos above 1, as residuals: those that a step may lift there, and derivatives."""
        totals = self.model.albedos(x).ravel()
        near = totals > _NEAR
        if not (self.physical and near.any()):
            return np.zeros(0), np.zeros((0, len(x)))
        scale = _ENERGY * self.size
        slopes = self.model.albedo_slopes(x).reshape(-1, len(x))
        return scale * (totals[near] - 1), scale * slopes[near]

    def information(self, x: Float64) -> Float64:
        """JᵀJ of the picture alone: float64 [n, n]."""
        return self._picture_terms(x, np.zeros_like(self._target), plain=True)[0]

    def _picture_terms(
        self, x: Float64, residual: Float32, plain: bool = False
    ) -> tuple[Float64, Float64]:
        J = self.model.jacobian(x)
        slopes = self.wish.slopes(np.ascontiguousarray(self.model.image(x).T))
        weight = np.repeat(self._weight[:, None], 3, axis=1)
        if self.huber > 0 and not plain:
            pull = np.minimum(1.0, self.huber / np.maximum(np.abs(residual), 1e-30))
            root = np.sqrt(pull).astype(np.float32)
            weight, residual = weight * root, residual * root
        H, g = np.zeros((len(x), len(x))), np.zeros(len(x))
        for h in range(3):
            rows = J[h] if slopes is None else np.einsum("pc,cpu->pu", slopes[:, h], J)
            moving = np.flatnonzero(np.abs(rows).max(axis=0, initial=0.0))
            rows = (rows[:, moving] * weight[:, h : h + 1]).astype(np.float64)
            H[np.ix_(moving, moving)] += rows.T @ rows
            g[moving] += rows.T @ residual[:, h]
        return H, g


def _bends(model: PictureModel, size: float) -> Float64:
    """Rows whose squares are what the bends of curves cost: float64 [k, n]."""
    rows: list[Float64] = []
    for k, item in enumerate(model.unknowns):
        if not isinstance(item, CurveKnob):
            continue
        bends = item.bends * size
        for h in range(3):
            block = np.zeros((len(bends), int(model.offsets[-1])))
            block[:, model.offsets[k] + h : model.offsets[k + 1] : 3] = bends
            rows.append(block)
    return np.concatenate(rows) if rows else np.zeros((0, int(model.offsets[-1])))


def starts(model: PictureModel, start: Float64, count: int) -> Sequence[Float64]:
    """Where to begin: `start`, and `count` points spread over the shapes of the lobes.

    Far from its true width a lobe's derivative points nowhere; colours follow by themselves.
    """
    shape = [
        int(u)
        for k, item in enumerate(model.unknowns)
        if item.shape
        for u in range(model.offsets[k], model.offsets[k + 1])
    ]
    if not shape:
        return [start]
    result = [start]
    for n in range(count):
        point = start.copy()
        for axis, u in enumerate(shape):
            # A lattice with the steps of a generalised golden ratio fills a box evenly
            place = (n + 0.5) / count if axis == 0 else (0.5 + n * _ratio(axis)) % 1.0
            point[u] = np.clip(0.05 + 0.9 * place, model.lower[u], model.upper[u])
        result.append(point)
    return result


def _ratio(axis: int) -> float:
    return float(1.3247179572447460 ** -(axis + 0.5))
