"""Frames from a frozen form: a matrix–vector product per part and channel.

B = base + Σ_parts s(θo) · Σ_c Σ_n F[:, c, n] · coefficient_c · power_n (2008, eq. 28).
A frame reads F once, so memory bandwidth is what it costs. Parts whose weights have not
changed since the last frame are not read again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.parallel import core_count, parallel_map
from burnish.core.types import Float32, Float64
from burnish.transport.basis import State
from burnish.transport.frozen import Frozen, FrozenPart


@dataclass(frozen=True)
class Gradient:
    """Derivatives of a scalar loss L that depends on the image.

    columns: (object index, indirect) to dL/dcoefficient, float64 [columns, 3].
    powers: dL/dpower, float64 [powers, 3].
    albedos: through the powers, dL/dd of the targets' variables (`Powers.variables`),
      float64 [variables, 3].
    coarse: through the powers, dL/dĉ of `Basis.coarse`, float64 [coarse, 3].
    outgoing: (object index, indirect, first column of the slice) to dL/ds of the part's
      rows, float64 [r, 3], in the order of the part's pixels.
    """

    columns: Mapping[tuple[int, bool], Float64]
    powers: Float64
    albedos: Float64
    coarse: Float64
    outgoing: Mapping[tuple[int, bool, int], Float64]


_SMALL = 1 << 16
"""Entries of F below which threads cost more than they save."""


class Renderer:
    """Turns a `Frozen` into images and gradients.

    >>> renderer = Renderer(freeze(source, (0,), state))   # doctest: +SKIP
    >>> picture = renderer.image(state)                    # doctest: +SKIP
    """

    def __init__(self, frozen: Frozen) -> None:
        self.frozen = frozen
        self._base = np.ascontiguousarray(frozen.base.reshape(-1, 3).T)
        self._others = _join_others(frozen)
        self._groups = _group_by_rows(frozen)
        self._known: dict[int, tuple[Float32, Float32]] = {}

    def image(self, state: State) -> Float32:
        """The picture with the targets' materials from `state`: float32 [h, w, 3], linear RGB.

        Materials of other objects are those that were frozen.
        """
        frozen = self.frozen
        numbers = _Numbers(frozen, state)
        planes = self._base.copy()
        if self._others is not None:
            planes += self._others_light(self._others, numbers.powers.T)
        for group in self._groups:
            total = np.zeros((3, len(frozen.parts[group[0]].pixel)), np.float32)
            for k in group:
                part = frozen.parts[k]
                light = self._part_light(k, part, numbers.weights(part))
                factor = numbers.outgoing(part)
                total += light if factor is None else light * factor.T.astype(np.float32)
            pixel = frozen.parts[group[0]].pixel
            for h in range(3):
                planes[h, pixel] += total[h]
        image = np.empty((planes.shape[1], 3), np.float32)
        for h in range(3):
            image[:, h] = planes[h]
        return image.reshape(frozen.height, frozen.width, 3)

    def _part_light(self, key: int, part: FrozenPart, weights: Float64) -> Float32:
        """What a part adds to its rows: float32 [3, r], outgoing factor left out."""
        return self._remembered(key, weights, lambda narrow: _light(part, narrow))

    def _others_light(self, others: Float32, weights: Float64) -> Float32:
        """What rows that first meet no target add: float32 [3, pixels]."""
        return self._remembered(-1, weights, lambda narrow: _sums(others, narrow))

    def _remembered(
        self, key: int, weights: Float64, compute: Callable[[Float32], Float32]
    ) -> Float32:
        """The last result for a key, computed anew when its weights have changed."""
        narrow = weights.astype(np.float32)
        known = self._known.get(key)
        if known is None or not np.array_equal(known[0], narrow):
            known = self._known[key] = narrow, compute(narrow)
        return known[1]

    def gradient(self, state: State, image_gradient: Float32) -> Gradient:
        """Back from dL/dimage [h, w, 3] to the numbers that an edit changes.

        A parameter's derivative is then the chain rule over few numbers. Raises
        InvalidValue when the shape is not the image's.
        """
        frozen = self.frozen
        expected = (frozen.height, frozen.width, 3)
        if image_gradient.shape != expected:
            raise InvalidValue(
                f"image_gradient must have the image's shape {expected}; got {image_gradient.shape}"
            )
        planes = np.ascontiguousarray(image_gradient.reshape(-1, 3).T, dtype=np.float32)
        numbers = _Numbers(frozen, state)
        powers = np.zeros((len(frozen.powers.exponents), 3))
        columns: dict[tuple[int, bool], Float64] = {}
        outgoing: dict[tuple[int, bool, int], Float64] = {}
        for part in frozen.parts:
            upstream = planes[:, part.pixel]
            factor = numbers.outgoing(part)
            scaled = upstream if factor is None else upstream * factor.T.astype(np.float32)
            if part.expansion is not None:
                scaled = part.expansion.back(scaled)
            back = np.stack(parallel_map(np.matmul, scaled, part.F)).astype(np.float64)
            if part.slice is None:
                powers += back.T
                continue
            back = back.reshape(3, -1, len(powers))
            key, span = (part.object, part.indirect), slice(part.slice.start, part.slice.stop)
            coefficients = numbers.columns(*key)
            if key not in columns:
                columns[key] = np.zeros_like(coefficients)
            columns[key][span] += np.einsum("hcn,nh->ch", back, numbers.powers)
            powers += np.einsum("hcn,ch->nh", back, coefficients[span])
            if factor is not None:
                weights = numbers.weights(part).astype(np.float32)
                light = _light(part, weights)
                outgoing[(*key, part.slice.start)] = (upstream * light).T.astype(np.float64)
        albedos, coarse = _through_powers(frozen, state, powers)
        return Gradient(columns, powers, albedos, coarse, outgoing)


def _join_others(frozen: Frozen) -> Float32 | None:
    """V of all rows that first meet no target, added up: float32 [3, powers, pixels].

    The powers come before the pixels, which makes the few long sums of a frame fast.
    """
    others = [part for part in frozen.parts if part.slice is None]
    if not others:
        return None
    result = np.zeros((3, len(frozen.powers.exponents), len(frozen.base)), np.float32)
    for part in others:
        for h in range(3):
            for n in range(result.shape[1]):
                result[h, n, part.pixel] += part.F[h, :, n]
    return result


def _group_by_rows(frozen: Frozen) -> list[list[int]]:
    """Parts of the targets, those of the same rows together: their slices."""
    groups: list[list[int]] = []
    for k, part in enumerate(frozen.parts):
        if part.slice is None:
            continue
        first = frozen.parts[groups[-1][0]] if groups else None
        if first is not None and np.array_equal(first.pixel, part.pixel):
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups


class _Numbers:
    """Coefficients, powers and outgoing factors of a state, each computed once."""

    def __init__(self, frozen: Frozen, state: State) -> None:
        self.frozen, self.state = frozen, state
        self.powers = frozen.powers.evaluate(frozen.basis, state)
        self._columns: dict[tuple[int, bool], Float64] = {}

    def columns(self, index: int, indirect: bool) -> Float64:
        key = (index, indirect)
        if key not in self._columns:
            self._columns[key] = self.frozen.basis.column_coefficients(index, self.state, indirect)
        return self._columns[key]

    def weights(self, part: FrozenPart) -> Float64:
        """What F's last axis meets: float64 [3, columns · powers], or [3, powers]."""
        if part.slice is None:
            return self.powers.T
        coefficients = self.columns(part.object, part.indirect)
        own = coefficients[part.slice.start : part.slice.stop]
        return np.asarray(np.einsum("ch,nh->hcn", own, self.powers).reshape(3, -1))

    def outgoing(self, part: FrozenPart) -> Float64 | None:
        """s(θo) of a part's rows: float64 [r, 3 or 1], or None for 1."""
        if part.slice is None or part.indirect:
            return None
        cosines = part.cos_theta_o.astype(np.float64)
        return self.frozen.basis.outgoing_factor(part.object, self.state, part.slice, cosines)


def _light(part: FrozenPart, weights: Float32) -> Float32:
    """F of a part times the weights [3, columns · powers], at its rows: float32 [3, r]."""
    products = _products(part.F, weights)
    return products if part.expansion is None else part.expansion.expand(products)


def _products(F: Float32, weights: Float32) -> Float32:
    """F[h] @ weights[h] of each channel: float32 [3, r], rows shared out over the cores."""
    rows = F.shape[1]
    result = np.empty((3, rows), np.float32)
    if F.size < _SMALL:
        np.matmul(F, weights[:, :, None], out=result[:, :, None])
        return result
    step = -(-rows // (4 * core_count()))
    pieces = [(h, slice(r, r + step)) for h in range(3) for r in range(0, rows, step)]
    parallel_map(lambda at: np.matmul(F[at], weights[at[0]], out=result[at]), pieces)
    return result


def _sums(V: Float32, weights: Float32) -> Float32:
    """Σ_n weights[h, n] V[h, n, pixel]: float32 [3, pixels], pixels shared out over the cores."""
    pixels = V.shape[2]
    result = np.empty((3, pixels), np.float32)
    step = -(-pixels // (2 * core_count()))
    pieces = [(h, slice(p, p + step)) for h in range(3) for p in range(0, pixels, step)]

    def work(at: tuple[int, slice]) -> None:
        h, span = at
        np.matmul(weights[h], V[h, :, span], out=result[h, span])

    parallel_map(work, pieces)
    return result


def _through_powers(frozen: Frozen, state: State, powers: Float64) -> tuple[Float64, Float64]:
    """dL/dd and dL/dĉ from dL/dpower, by the product rule without dividing by d."""
    basis, symbolic = frozen.basis, frozen.powers
    d = basis.albedos(state)[symbolic.variables]
    values = basis.coarse_values(state) if basis.coarse else np.zeros((0, 3))
    first = np.ones((len(symbolic.coarse), 3))
    used = symbolic.coarse >= 0
    first[used] = values[symbolic.coarse[used]]
    exponents = symbolic.exponents
    albedos = np.zeros_like(d)
    for v in range(len(d)):
        lowered = exponents.copy()
        lowered[:, v] = np.maximum(lowered[:, v] - 1, 0)
        term = (d[None] ** lowered[:, :, None]).prod(axis=1) * exponents[:, v : v + 1]
        albedos[v] = (powers * first * term).sum(axis=0)
    coarse = np.zeros_like(values)
    products = (d[None] ** exponents[:, :, None]).prod(axis=1)
    np.add.at(coarse, symbolic.coarse[used], (powers * products)[used])
    return albedos, coarse
