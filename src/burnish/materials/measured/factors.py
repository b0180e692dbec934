"""Non-negative factors of a measured BRDF, as curves over one angle each.

- *half-difference* (2006, eq. 18): ρ ≈ A(θin) A(θout) + C(θd) E(θh), by multiplicative updates,
  which keep every factor at zero or above (Lee and Seung 2001; Lawrence et al. 2004);
- *homomorphic* (McCool et al. 2001; 2006, eq. 17): ρ ≈ P(θin) Q(θh) P(θout), by least squares on
  logarithms.

The factors of both directions are the same function, as reciprocity asks. How well they fit
does not limit how well the material is reproduced: the quotient makes up for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from burnish.core.types import Float64
from burnish.materials.coordinates import normalised
from burnish.materials.maths import Maths, numpy_maths
from burnish.materials.measured.register import find
from burnish.materials.measured.table import ReflectanceTable

Form = Literal["half-difference", "homomorphic"]

NODES = {"theta_h": 64, "theta_d": 24, "theta_in": 24}
"""Samples of a factor: equally spaced in t, for theta_h in √t."""
STEPS = 120
FLOOR = 1e-4
"""The least value of a factor, as a share of its mean: so that quotients stay finite."""
STEEPEST = 3.0
"""The largest ratio of neighbouring samples of a factor: so that a factor is about constant
within a bin, and the quotient with it."""


@dataclass(frozen=True, eq=False)
class Factors:
    """The factors of one table: float64 [3, nodes] by angle.

    half-difference: direction is A, difference C, half E. homomorphic: direction is P, half Q,
    difference all 1.
    """

    direction: Float64
    difference: Float64
    half: Float64

    def of(self, angle: str) -> Float64:
        """The samples of the factor over a named angle."""
        return {"theta_in": self.direction, "theta_d": self.difference, "theta_h": self.half}[angle]

    def evaluate(self, xp: Maths, angle: str, t: Any) -> list[Any]:
        """The factor over a named angle at t in [0, 1], per channel."""
        position = xp.sqrt(t) if angle == "theta_h" else t
        return [xp.lookup(channel, position) for channel in self.of(angle)]


@lru_cache(maxsize=32)
def factors(key: str, path: str, form: Form) -> Factors:
    """The factors of the table of a key, computed once."""
    return factorise(find(key, path), form)


def factorise(table: ReflectanceTable, form: Form) -> Factors:
    """Fit the factors to the valid cells above the horizon, a regular subset of them."""
    cells = _Cells(table)
    fit = _half_difference if form == "half-difference" else _homomorphic
    channels = [fit(cells, channel) for channel in range(3)]
    direction, difference, half = (np.stack(group) for group in zip(*channels, strict=True))
    return Factors(direction, difference, half)


class _Cells:
    """What the fits read: reflectances [3, n], weights, and where each angle falls."""

    def __init__(self, table: ReflectanceTable) -> None:
        step = tuple(slice(None, None, max(1, n // 18)) for n in table.raw.shape[1:])
        step = (slice(None, None, max(1, table.raw.shape[1] // 90)), *step[1:])
        wi, wo = table.directions()
        wi, wo = (
            type(w)(*(np.broadcast_to(a, table.valid.shape)[step] for a in w)) for w in (wi, wo)
        )
        lit = table.valid[step] & (wi.z > 0.02) & (wo.z > 0.02)
        if not lit.any():
            lit = (wi.z > 0) & (wo.z > 0)
        wi, wo = (type(w)(*(a[lit] for a in w)) for w in (wi, wo))
        self.values = np.asarray(table.filled[(slice(None), *step)][:, lit], np.float64)
        self.half = _Hats(np.sqrt(normalised(numpy_maths, "theta_h", wi, wo)), NODES["theta_h"])
        self.difference = _Hats(normalised(numpy_maths, "theta_d", wi, wo), NODES["theta_d"])
        self.light = _Hats(normalised(numpy_maths, "theta_in", wi, wo), NODES["theta_in"])
        self.view = _Hats(normalised(numpy_maths, "theta_in", wo, wi), NODES["theta_in"])


class _Hats:
    """Linear interpolation of samples on [0, 1] at n points, and its transpose."""

    def __init__(self, x: Float64, nodes: int) -> None:
        position = np.clip(x, 0.0, 1.0) * (nodes - 1)
        self.cell = np.minimum(position.astype(np.int64), nodes - 2)
        self.share, self.nodes = position - self.cell, nodes

    def at(self, samples: Float64) -> Float64:
        low = samples[self.cell]
        return np.asarray(low + self.share * (samples[self.cell + 1] - low))

    def gather(self, values: Float64) -> Float64:
        below = np.bincount(self.cell, values * (1 - self.share), self.nodes)
        return np.asarray(below + np.bincount(self.cell + 1, values * self.share, self.nodes))

    def rows(self) -> Float64:
        """The interpolation as a matrix: float64 [n, nodes]."""
        result = np.zeros((len(self.cell), self.nodes))
        index = np.arange(len(self.cell))
        result[index, self.cell] = 1 - self.share
        result[index, self.cell + 1] += self.share
        return result


def _half_difference(cells: _Cells, channel: int) -> tuple[Float64, Float64, Float64]:
    rho = cells.values[channel]
    mean = max(float(rho.mean()), 1e-12)
    # Relative errors count, but not those of nearly black cells
    weight = 1 / (rho + 0.3 * float(np.median(rho)) + 1e-3 * mean) ** 2
    matte = float(np.percentile(rho, 20)) + 1e-3 * mean
    a = np.full(NODES["theta_in"], np.sqrt(matte))
    c = np.ones(NODES["theta_d"])
    count = cells.half.gather(np.ones_like(rho))
    e = cells.half.gather(rho) / np.maximum(count, 1e-12) + 1e-3 * mean
    target = weight * rho
    for _ in range(STEPS):
        light, view = cells.light.at(a), cells.view.at(a)
        specular = cells.difference.at(c) * cells.half.at(e)
        now = weight * (light * view + specular)
        up = cells.light.gather(target * view) + cells.view.gather(target * light)
        down = cells.light.gather(now * view) + cells.view.gather(now * light)
        a = a * np.sqrt(_ratio(up, down))
        matte_part = cells.light.at(a) * cells.view.at(a)
        for hats, other, which in (
            (cells.half, cells.difference.at(c), "half"),
            (cells.difference, None, "difference"),
        ):
            rest = cells.half.at(e) if other is None else other
            now = weight * (matte_part + cells.difference.at(c) * cells.half.at(e))
            ratio = _ratio(hats.gather(target * rest), hats.gather(now * rest))
            if which == "half":
                e = e * ratio
            else:
                c = c * ratio
    scale = max(float(c.mean()), 1e-12)
    return _tamed(a, np.sqrt(mean)), _tamed(c / scale, 1.0), _tamed(e * scale, mean)


def _homomorphic(cells: _Cells, channel: int) -> tuple[Float64, Float64, Float64]:
    rho = cells.values[channel]
    target = np.log(np.maximum(rho, 1e-3 * max(float(rho.mean()), 1e-12)))
    matrix = np.concatenate([cells.light.rows() + cells.view.rows(), cells.half.rows()], axis=1)
    normal = matrix.T @ matrix
    # Slight smoothness settles samples that no cell reaches, and the scale between factors
    size = NODES["theta_in"]
    smooth = np.zeros_like(normal)
    for start, stop in ((0, size), (size, len(normal))):
        bend = np.diff(np.eye(stop - start), n=2, axis=0)
        smooth[start:stop, start:stop] = bend.T @ bend
    ridge = 1e-4 * np.trace(normal) / len(normal)
    normal = normal + ridge * smooth + 1e-6 * ridge * np.eye(len(normal))
    solution = np.linalg.solve(normal, matrix.T @ target)
    p, q = np.exp(solution[:size]), np.exp(solution[size:])
    scale = float(p.mean())
    half = q * scale**2
    return _tamed(p / scale, 1.0), np.ones(NODES["theta_d"]), _tamed(half, float(half.mean()))


def _ratio(up: Float64, down: Float64) -> Float64:
    """What a multiplicative update multiplies by; 1 for samples that no cell reaches."""
    return np.divide(up, down, out=np.ones_like(up), where=down > 1e-300)


def _tamed(samples: Float64, mean: float) -> Float64:
    """A factor with a floor and no cliffs; ends that few cells reach follow their neighbours."""
    result = np.maximum(samples, FLOOR * mean)
    for i in range(1, len(result)):
        result[i] = np.clip(result[i], result[i - 1] / STEEPEST, result[i - 1] * STEEPEST)
    return result
