"""The exact derivative of a picture by its materials: no ray, and no picture of its own.

B = base + Σ_parts s(θo) · F · (coefficients ⊗ powers) (2008, eq. 28). What a parameter moves
are the few numbers s, c and d^n, cheap NumPy functions in double precision. Their central
differences, carried through the product rule, meet F in one matrix product for all unknowns.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from burnish.core.parallel import core_count, parallel_map
from burnish.core.types import Float32, Float64, Int64
from burnish.materials.layer import MaterialState
from burnish.runtime.renderer import Gradient
from burnish.session.unknowns import Unknown
from burnish.transport.basis import State
from burnish.transport.frozen import Frozen, FrozenPart

STEP = 1e-3
"""Of the differences, in travel: small beside what bends a lobe, and large beside the breaks
of models that are themselves integrals by quadrature (a coat's transmittance)."""
_SMALL = 1 << 18
"""Entries of F below which threads cost more than they save."""
_PROBES = np.linspace(0.05, 1.0, 20)


@dataclass(frozen=True)
class Numbers:
    """What of a state meets F: by (object, indirect) the columns [c, 3], and powers [n, 3]."""

    columns: Mapping[tuple[int, bool], Float64]
    powers: Float64


@dataclass(frozen=True)
class Change:
    """Derivatives of `Numbers` by one unknown number; a missing entry is 0.

    outgoing: by part number, ds/dx at its rows, float64 [r, 3].
    """

    columns: Mapping[tuple[int, bool], Float64]
    powers: Float64
    outgoing: Mapping[int, Float64]


class PictureModel:
    """Some pixels of a frozen view as a function of the unknowns x.

    pixels: int64 [p], rising, indices of the view's pixels. state: materials of all objects;
    only what the unknowns stand for is changed.
    """

    def __init__(
        self, frozen: Frozen, unknowns: Sequence[Unknown], state: State, pixels: Int64 | None = None
    ) -> None:
        self.frozen, self.unknowns, self.start = frozen, tuple(unknowns), dict(state)
        count = len(frozen.base)
        self.pixels = np.arange(count) if pixels is None else pixels
        self._shown: tuple[Float64, Float32] | None = None
        self._base = frozen.base[self.pixels].astype(np.float32)
        parts = [_restricted(part.dense(), self.pixels, count) for part in frozen.parts]
        self._parts = [part for part in _joined(parts, len(self.pixels)) if len(part.pixel)]
        self._keys = sorted(
            {(part.object, part.indirect) for part in self._parts if part.slice is not None}
        )
        sizes = [len(item.channels) for item in self.unknowns]
        self.offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.lower = np.concatenate([item.lower for item in self.unknowns])
        self.upper = np.concatenate([item.upper for item in self.unknowns])
        self.channels = np.concatenate([item.channels for item in self.unknowns]).astype(int)

    def read(self, state: State) -> Float64:
        """x of a state, moved inside the bounds."""
        return np.concatenate([item.read(state[item.object]) for item in self.unknowns])

    def state(self, x: Float64) -> dict[str, MaterialState]:
        """The materials at x."""
        return {**self.start, **{name: self._material(name, x) for name in self.fitted_objects}}

    def _material(self, name: str, x: Float64) -> MaterialState:
        material = self.start[name]
        for k, item in enumerate(self.unknowns):
            if item.object == name:
                material = item.write(material, x[self.offsets[k] : self.offsets[k + 1]])
        return material

    def image(self, x: Float64) -> Float32:
        """The pixels at x: float32 [3, p]; that of the last x is kept."""
        if self._shown is None or not np.array_equal(self._shown[0], x):
            self._shown = x.copy(), self._image(x)
        return self._shown[1]

    def _image(self, x: Float64) -> Float32:
        state = self.state(x)
        numbers = self._numbers(state)
        image = np.ascontiguousarray(self._base.T)
        for part in self._parts:
            light = _light(part, numbers)
            factor = self._factor(part, state)
            image[:, part.pixel] += light if factor is None else light * factor
        return image

    def jacobian(self, x: Float64) -> Float32:
        """d pixels / dx: float32 [3, p, len(x)]."""
        state = self.state(x)
        numbers = self._numbers(state)
        changes = self.changes(x)
        result = np.zeros((3, len(x), len(self.pixels)), np.float32).transpose(0, 2, 1)
        for k, part in enumerate(self._parts):
            factor = self._factor(part, state)
            directions = np.stack([_changed_weights(part, numbers, item) for item in changes], 1)
            moving = [np.flatnonzero(np.abs(plane).max(axis=1)) for plane in directions]
            lights = _lights(part, [plane[u] for plane, u in zip(directions, moving, strict=True)])
            for h, light in enumerate(lights):
                for at, own in zip(moving[h], light, strict=True):
                    result[h, :, at][part.pixel] += own if factor is None else own * factor[h]
            through = [u for u, item in enumerate(changes) if k in item.outgoing]
            if through:
                light = _light(part, numbers)
                for u in through:
                    result[:, part.pixel, u] += light * changes[u].outgoing[k].T
        return result

    def pull_back(self, x: Float64, gradient: Gradient, image_gradient: Float32) -> Float64:
        """dL/dx from dL/dimage [h, w, 3] and what the renderer made of it: float64 [len(x)].

        For a model of all pixels, at the materials that the renderer was given.
        """
        result = np.zeros(len(x))
        numbers = self._numbers(self.state(x))
        planes = image_gradient.reshape(-1, 3).T
        by_factor: dict[int, Float32] = {}
        for u, change in enumerate(self.changes(x)):
            result[u] = (gradient.powers * change.powers).sum()
            for key, columns in change.columns.items():
                result[u] += (gradient.columns[key] * columns).sum()
            for k, factor in change.outgoing.items():
                # The renderer leaves out factors that are 1 now and would not stay 1
                if k not in by_factor:
                    part = self._parts[k]
                    light = _light(part, numbers)
                    by_factor[k] = planes[:, part.pixel] * light
                result[u] += (by_factor[k].T * factor).sum(dtype=np.float64)
        return result

    def albedos(self, x: Float64) -> Float64:
        """Total albedo of every one of the `fitted_objects`: float64 [objects, 3]."""
        state = self.state(x)
        return np.array([self.albedo(name, state) for name in self.fitted_objects])

    def albedo_slopes(self, x: Float64) -> Float64:
        """The derivative of `albedos`: float64 [objects, 3, len(x)]."""
        slopes = np.zeros((len(self.fitted_objects), 3, len(x)))
        for low, high, width, (name, members) in self._differences(x):
            slope = (self.albedo(name, high) - self.albedo(name, low)) / width
            for u, channel in members:
                slopes[self.fitted_objects.index(name), :, u] = _only(slope, channel)
        return slopes

    def albedo(self, name: str, state: State) -> Float64:
        """Total albedo of one object: float64 [3]."""
        basis = self.frozen.basis
        index = basis.index(name)
        own = [v for v, (i, _) in enumerate(basis.variables) if i == index]
        return np.asarray(basis.albedos(state)[own].sum(axis=0))

    @property
    def fitted_objects(self) -> tuple[str, ...]:
        """The ids of the objects that have unknowns."""
        return tuple(dict.fromkeys(item.object for item in self.unknowns))

    def changes(self, x: Float64) -> list[Change]:
        """By each unknown number, how the numbers of the frozen form change."""
        result: list[Change | None] = [None] * len(x)
        for low, high, width, (name, members) in self._differences(x):
            index = self.frozen.basis.index(name)
            before, after = self._numbers(low), self._numbers(high)
            powers = (after.powers - before.powers) / width
            columns = {
                key: (after.columns[key] - before.columns[key]) / width
                for key in self._keys
                if key[0] == index
            }
            outgoing = self._factor_changes(index, low, high, width)
            for u, channel in members:
                result[u] = Change(
                    {key: _only(value, channel) for key, value in columns.items()},
                    _only(powers, channel),
                    {k: _only(value, channel) for k, value in outgoing.items()},
                )
        assert all(item is not None for item in result)
        return [item for item in result if item is not None]

    def _differences(
        self, x: Float64
    ) -> Iterator[tuple[State, State, float, tuple[str, list[tuple[int, int]]]]]:
        """States on both sides of x, how far apart, whose, and which (unknown, channel) moved.

        At a bound both lie inside, and the difference is of the middle between them: its
        error, a step's width, is no more than the tolerance of a fit.
        """
        base = self.state(x)
        for k, item in enumerate(self.unknowns):
            batches = item.batches
            if self.start[item.object].conserve:
                # The link's shared factor mixes the channels
                batches = tuple((i,) for batch in batches for i in batch)
            for batch in batches:
                at = self.offsets[k] + np.array(batch)
                linked = self.start[item.object].conserve
                width = 2 * STEP * float(np.clip(np.abs(x[at]).min() / 0.3, 0.1, 1.0))
                low, high = x.copy(), x.copy()
                low[at] = np.clip(x[at] - width / 2, self.lower[at], self.upper[at] - width)
                high[at] = low[at] + width
                members = [(int(u), -1 if linked else int(self.channels[u])) for u in at]
                below, above = (
                    {**base, item.object: self._material(item.object, side)} for side in (low, high)
                )
                yield below, above, width, (item.object, members)

    def _numbers(self, state: State) -> Numbers:
        basis = self.frozen.basis
        columns = {key: basis.column_coefficients(key[0], state, key[1]) for key in self._keys}
        return Numbers(columns, self.frozen.powers.evaluate(basis, state))

    def _factor(self, part: FrozenPart, state: State) -> Float32 | None:
        """s(θo) of a part's rows: float32 [3 or 1, r], or None for 1."""
        if part.slice is None or part.indirect:
            return None
        cosines = part.cos_theta_o.astype(np.float64)
        factor = self.frozen.basis.outgoing_factor(part.object, state, part.slice, cosines)
        if factor is None:
            return None
        return np.ascontiguousarray(np.broadcast_to(factor, (len(cosines), 3)).T, np.float32)

    def _factor_changes(
        self, index: int, low: State, high: State, width: float
    ) -> dict[int, Float64]:
        basis, result = self.frozen.basis, {}
        for k, part in enumerate(self._parts):
            if part.slice is None or part.indirect or part.object != index:
                continue
            ends = [basis.outgoing_factor(index, side, part.slice, _PROBES) for side in (low, high)]
            first, last = (np.ones(1) if end is None else end for end in ends)
            if np.array_equal(first, last):
                continue
            cosines = part.cos_theta_o.astype(np.float64)
            sides = [
                basis.outgoing_factor(index, side, part.slice, cosines) for side in (high, low)
            ]
            after, before = (1.0 if side is None else side for side in sides)
            slope = (np.asarray(after) - before) / width
            result[k] = np.array(np.broadcast_to(slope, (len(cosines), 3)))
        return result


def _restricted(part: FrozenPart, pixels: Int64, count: int) -> FrozenPart:
    """The rows of some pixels, numbered by their place among these; F is copied if it must."""
    place = np.full(count, -1, np.int32)
    place[pixels] = np.arange(len(pixels))
    inside = place[part.pixel]
    kept = np.flatnonzero(inside >= 0)
    if len(kept) == len(inside):
        return replace(part, pixel=inside)
    expansion = None if part.expansion is None else part.expansion.of_rows(kept)
    return replace(
        part,
        pixel=inside[kept],
        F=part.F[:, kept] if expansion is None else part.F,
        cos_theta_o=part.cos_theta_o[kept],
        expansion=expansion,
    )


def _joined(parts: Sequence[FrozenPart], count: int) -> list[FrozenPart]:
    """The parts of all that first meet no target as one, of every pixel that has some."""
    others = [part for part in parts if part.slice is None and len(part.pixel)]
    if len(others) < 2:
        return list(parts)
    total = np.zeros((3, count, others[0].F.shape[2]), np.float32)
    for part in others:
        total[:, part.pixel] += part.F
    pixel = np.arange(count, dtype=np.int32)
    joined = replace(others[0], pixel=pixel, F=total, cos_theta_o=np.ones(count, np.float32))
    return [*(part for part in parts if part.slice is not None), joined]


def _weights(part: FrozenPart, numbers: Numbers) -> Float64:
    """What F's last axis meets: float64 [3, columns · powers]."""
    if part.slice is None:
        return numbers.powers.T
    own = numbers.columns[part.object, part.indirect][part.slice.start : part.slice.stop]
    return _outer(own, numbers.powers)


def _changed_weights(part: FrozenPart, numbers: Numbers, change: Change) -> Float64:
    """Its derivative by the product rule: float64 [3, columns · powers]."""
    if part.slice is None:
        return change.powers.T
    key, span = (part.object, part.indirect), slice(part.slice.start, part.slice.stop)
    result = _outer(numbers.columns[key][span], change.powers)
    if key in change.columns:
        result = result + _outer(change.columns[key][span], numbers.powers)
    return result


def _outer(columns: Float64, powers: Float64) -> Float64:
    return np.asarray(np.einsum("ch,nh->hcn", columns, powers).reshape(3, -1))


def _light(part: FrozenPart, numbers: Numbers) -> Float32:
    """What a part adds to its rows, its outgoing factor apart: float32 [3, r]."""
    products = _product(part.F, _weights(part, numbers)[:, None])[:, :, 0]
    return products if part.expansion is None else part.expansion.expand(products)


def _lights(part: FrozenPart, directions: Sequence[Float64]) -> list[Float32]:
    """What directions [u, columns · powers] of each channel give the rows: float32 [u, r]."""
    lights = [
        _product(part.F[h : h + 1], own[None])[0].T if len(own) else np.zeros((0, part.F.shape[1]))
        for h, own in enumerate(directions)
    ]
    planes = np.ascontiguousarray(np.concatenate(lights), np.float32)
    if part.expansion is not None:
        planes = part.expansion.expand(planes)
    return np.split(planes, np.cumsum([len(own) for own in directions])[:-1])


def _product(F: Float32, weights: Float64) -> Float32:
    """F [h, r, m] times weights [h, u, m]: float32 [h, r, u], rows shared out over the cores."""
    narrow = np.ascontiguousarray(weights.transpose(0, 2, 1), np.float32)
    rows = F.shape[1]
    if F.size < _SMALL:
        return np.asarray(np.matmul(F, narrow))
    result = np.empty((len(F), rows, narrow.shape[2]), np.float32)
    step = max(-(-rows // (2 * core_count())), 256)
    pieces = [(h, slice(r, r + step)) for h in range(len(F)) for r in range(0, rows, step)]
    parallel_map(lambda at: np.matmul(F[at], narrow[at[0]], out=result[at]), pieces)
    return result


def _only(values: Float64, channel: int) -> Float64:
    """One channel (-1: all) of [..., 3], the others 0."""
    if channel < 0:
        return values
    result = np.zeros_like(values)
    result[..., channel] = values[..., channel]
    return result
