"""Frames from a frozen form: a matrix–vector product per part and channel.

B = base + Σ_parts s(θo) · Σ_c Σ_n F[:, c, n] · coefficient_c · power_n (2008, eq. 28).
A frame reads F, or the blocks of a folded part, once, so memory bandwidth is what it costs.
What has not changed since the last frame is not read again, and frames of a drag read much less
of F than all (`span`). Of a layer with two curves the one
that is not edited is contracted beforehand (`switching`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.parallel import core_count, parallel_map, plain_blas
from burnish.core.types import Float32, Float64, Int32
from burnish.materials.two_curves import TwoCurves
from burnish.runtime.span import SMALL, Span
from burnish.runtime.switching import Switch
from burnish.transport.basis import State
from burnish.transport.contraction import Contracted, back, collect, contract, fold, unfold
from burnish.transport.expansion import blank, flattened
from burnish.transport.frozen import FoldedPart, Frozen, FrozenPart
from burnish.transport.stack import Stack


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


Spans = Mapping[tuple[int, ...], Span]
"""By the parts, as indices into those of a frozen form, that are added up together."""

Contraction = Callable[[Sequence[Stack], Sequence[Float64]], list[Contracted]]
"""Stacks and what their columns meet, to cells: `contract` is one."""


class Renderer:
    """Turns a `Frozen` into images and gradients.

    >>> renderer = Renderer(freeze(source, (0,), state))   # doctest: +SKIP
    >>> picture = renderer.image(state)                    # doctest: +SKIP
    """

    def __init__(self, frozen: Frozen, spans: Spans | None = None) -> None:
        """spans: of a renderer before, where the form's numbers lie in the same memory."""
        self.frozen = frozen
        self._base = np.ascontiguousarray(frozen.base.reshape(-1, 3).T)
        self._others = _join_others(frozen)
        self.contraction: Contraction = contract
        """How images contract folded parts."""
        self._before: Spans = spans or {}
        self._spans: dict[tuple[int, ...], Span] = {}
        self.switches = {
            k: Switch(part, model)
            for k, part in enumerate(frozen.parts)
            if (model := _two_curves(frozen, part)) is not None
        }

    @property
    def spans(self) -> Spans:
        """What the next renderer may go on with; nothing of a form that will be made anew."""
        return dict(self._spans) if self.frozen.in_place else {}

    def image(self, state: State) -> Float32:
        """The picture with the targets' materials from `state`: float32 [h, w, 3], linear RGB.

        Materials of other objects are those that were frozen.
        """
        numbers = _Numbers(self.frozen, state)
        folded: list[FoldedPart] = []
        weights: list[Float64] = []
        dense: list[tuple[int, FrozenPart, Float64]] = []
        for k, (part, own) in self._present(numbers).items():
            if isinstance(part, FoldedPart):
                folded.append(part)
                weights.append(own)
            else:
                dense.append((k, part, own))
        with plain_blas():
            squares = self._folded_light(folded, weights, numbers)
            return self._over(self._lit(dense, numbers), squares, numbers.powers)

    def _lit(self, dense: list[tuple[int, FrozenPart, Float64]], numbers: _Numbers) -> Float32:
        """The base with what dense parts of targets add: float32 [3, pixels]."""
        if not dense:
            return self._base
        planes = self._base.copy()
        factors = {k: numbers.outgoing(part) for k, part, _ in dense}
        # What is scaled row by row stands by itself, everything else is added up by pixel
        plain = [k for k, _, _ in dense if factors[k] is None and k in self._in_order]
        groups = [[one for one in dense if one[0] in plain]] if plain else []
        for group in [*groups, *([one] for one in dense if one[0] not in plain)]:
            light, pixel = self._light_of(group, numbers)
            factor = factors[group[0][0]]
            if factor is not None:
                light = light * _narrow(factor).T
            if pixel is None:
                planes += light
                continue
            for h in range(3):
                planes[h, pixel] += light[h]
        return planes

    @cached_property
    def _in_order(self) -> frozenset[int]:
        """The dense parts whose rows are those of rising pixels."""
        return frozenset(
            k
            for k, part in enumerate(self.frozen.parts)
            if isinstance(part, FrozenPart)
            and part.expansion is None
            and bool((np.diff(part.pixel) > 0).all())
        )

    def _light_of(
        self, group: list[tuple[int, FrozenPart, Float64]], numbers: _Numbers
    ) -> tuple[Float32, Int32 | None]:
        """What parts add up to, outgoing factors left out: float32 [3, n], and its pixels."""
        keys, parts = tuple(k for k, _, _ in group), [part for _, part, _ in group]
        weights = np.concatenate([numbers.weights(own) for _, _, own in group], axis=1)
        if parts[0].expansion is not None:
            return _light(parts[0], weights.astype(np.float32)), parts[0].pixel
        span = self._spans.get(keys)
        if span is None or any(a is not b for a, b in zip(span.parts, parts, strict=True)):
            span = self._before.get(keys) if span is None else None
            if span is not None and span.continues(parts):
                span.renew(parts)
            else:
                span = Span(parts, len(self.frozen.base))
            self._spans[keys] = span
        return span.light(weights), span.pixel

    def present(self, state: State) -> list[tuple[FrozenPart | FoldedPart, Float64]]:
        """The targets' parts as frames of a state read them, and what their columns meet:
        float64 [c, 3]."""
        return list(self._present(_Numbers(self.frozen, state)).values())

    def _present(self, numbers: _Numbers) -> dict[int, tuple[FrozenPart | FoldedPart, Float64]]:
        result: dict[int, tuple[FrozenPart | FoldedPart, Float64]] = {}
        for k, part in enumerate(self.frozen.parts):
            if part.slice is None:
                continue
            switch = self.switches.get(k)
            if switch is None:
                result[k] = part, numbers.own(part)
                continue
            sides = self.frozen.basis.sides(part.object, numbers.state, part.slice)
            assert sides is not None
            result[k] = switch.under(sides)
        return result

    def _folded_light(
        self,
        folded: list[FoldedPart],
        weights: list[Float64],
        numbers: _Numbers,
    ) -> Float32 | None:
        """What folded parts add, in squares (see `blank`); None where there are none."""
        if not folded:
            return None
        picture = blank(self.frozen.width, self.frozen.height, 3)
        cells = self.contraction([part.stack for part in folded], weights)
        latents = parallel_map(
            lambda part, found: _latent(part, found, numbers.powers), folded, cells
        )
        for part, latent in zip(folded, latents, strict=True):
            factor = numbers.outgoing(part)
            narrow = None if factor is None else _narrow(factor)
            part.stack.expansion.add(latent, picture, narrow)
        return picture

    def _over(self, planes: Float32, squares: Float32 | None, powers: Float64) -> Float32:
        """Light by channel [3, pixels], what rows that first meet no target add, and what is in
        squares: float32 [h, w, 3]."""
        width, height = self.frozen.width, self.frozen.height
        base, others = planes.reshape(3, height, width), self._others
        over = None if squares is None else flattened(squares)[:, :width]
        weights = powers.T.astype(np.float32)
        image = np.empty((height, width, 3), np.float32)
        step = -(-height // (2 * core_count()))

        def work(start: int) -> None:
            lines = slice(start, min(start + step, height))
            for h in range(3):
                light = base[h, lines]
                if others is not None:
                    own = others[h, :, start * width : lines.stop * width]
                    light = light + (weights[h] @ own).reshape(light.shape)
                if over is None:
                    image[lines, :, h] = light
                else:
                    np.add(light, over[lines, :, h], out=image[lines, :, h])

        parallel_map(work, range(0, height, step))
        return image

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
            if isinstance(part, FoldedPart):
                own, through, light = _back(part, numbers, scaled)
                key = part.object, part.indirect
                if key not in columns:
                    columns[key] = np.zeros_like(numbers.columns(*key))
                columns[key][part.slice.start : part.slice.stop] += own
                powers += through
                if factor is not None:
                    outgoing[(*key, part.slice.start)] = (upstream * light).T.astype(np.float64)
                continue
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
                weights = numbers.weights(coefficients[span]).astype(np.float32)
                light = _light(part, weights)
                outgoing[(*key, part.slice.start)] = (upstream * light).T.astype(np.float64)
        albedos, coarse = _through_powers(frozen, state, powers)
        return Gradient(columns, powers, albedos, coarse, outgoing)


def _join_others(frozen: Frozen) -> Float32 | None:
    """V of all rows that first meet no target, added up: float32 [3, powers, pixels].

    The powers come before the pixels, which makes the few long sums of a frame fast.
    """
    others = [
        part for part in frozen.parts if not isinstance(part, FoldedPart) and part.slice is None
    ]
    if not others:
        return None
    if len(others) == 1 and others[0].object < 0:
        # Of every pixel, and a freeze lays it out like this
        return np.ascontiguousarray(others[0].F.transpose(0, 2, 1))
    result = np.zeros((3, len(frozen.powers.exponents), len(frozen.base)), np.float32)
    for part in others:
        for h in range(3):
            for n in range(result.shape[1]):
                result[h, n, part.pixel] += part.F[h, :, n]
    return result


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

    def own(self, part: FrozenPart | FoldedPart) -> Float64:
        """Coefficients of the columns of a target's part: float64 [c, 3]."""
        assert part.slice is not None
        coefficients = self.columns(part.object, part.indirect)
        return coefficients[part.slice.start : part.slice.stop]

    def weights(self, own: Float64) -> Float64:
        """What F's last axis meets, of coefficients [c, 3]: float64 [3, columns · powers]."""
        return np.asarray(np.einsum("ch,nh->hcn", own, self.powers).reshape(3, -1))

    def outgoing(self, part: FrozenPart | FoldedPart) -> Float64 | None:
        """s(θo) of a part's rows: float64 [r, 3 or 1], or None for 1."""
        if part.slice is None or part.indirect:
            return None
        cosines = part.cos_theta_o.astype(np.float64)
        return self.frozen.basis.outgoing_factor(part.object, self.state, part.slice, cosines)


def _latent(part: FoldedPart, found: Contracted, powers: Float64) -> Float32:
    """A folded part's light in its row directions: float32 [3, directions]."""
    cells, peak = found
    tails = part.tails_under(powers) * peak[:, None]
    return fold(part.stack, cells, tails[:, None])[:, 0]


def _back(
    part: FoldedPart, numbers: _Numbers, upstream: Float32
) -> tuple[Float64, Float64, Float32]:
    """A folded part's dL/dcoefficient [c, 3] and dL/dpower [powers, 3], and its light [3, r].

    upstream: dL/dlight of its rows, outgoing factor left out: float32 [3, r].
    """
    stack = part.stack
    received = stack.expansion.back(upstream)
    (found,) = contract([stack], [numbers.own(part)])
    cells, peak = found
    own = back(stack, unfold(stack, received, part.tails_under(numbers.powers)))
    tails = (collect(stack, cells, received) * peak[:, None]) @ stack.S
    through = np.einsum("hz,znh->nh", tails.astype(np.float64), part.factors)
    return own, through, stack.expansion.expand(_latent(part, found, numbers.powers))


def _two_curves(frozen: Frozen, part: FrozenPart | FoldedPart) -> TwoCurves | None:
    """The model of a part's layer, where it has two curves and all its bins."""
    if part.slice is None or part.indirect or part.slice.delta:
        return None
    model = frozen.basis.objects[part.object].material.layers[part.slice.layer].model
    return model if isinstance(model, TwoCurves) else None


def _narrow(factor: Float64) -> Float32:
    """s(θo) in single precision: float32 [r, 3]."""
    return np.broadcast_to(factor, (len(factor), 3)).astype(np.float32)


def _light(part: FrozenPart, weights: Float32) -> Float32:
    """F of a part times the weights [3, columns · powers], at its rows: float32 [3, r]."""
    products = _products(part.F, weights)
    return products if part.expansion is None else part.expansion.expand(products)


def _products(F: Float32, weights: Float32) -> Float32:
    """F[h] @ weights[h] of each channel: float32 [3, r], rows shared out over the cores."""
    rows = F.shape[1]
    result = np.empty((3, rows), np.float32)
    if F.size < SMALL:
        np.matmul(F, weights[:, :, None], out=result[:, :, None])
        return result
    step = -(-rows // (4 * core_count()))
    pieces = [(h, slice(r, r + step)) for h in range(3) for r in range(0, rows, step)]
    parallel_map(lambda at: np.matmul(F[at], weights[at[0]], out=result[at]), pieces)
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
