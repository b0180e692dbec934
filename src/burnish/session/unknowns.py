"""What a fit may change, as numbers: parameters in slider travel, curves as control points.

An unknown is a block of numbers of one object. Travel is 0 at the start of a slider and 1 at
its end (`Parameter.scale`), so that equal steps look alike whatever the parameter's unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Float64, Value
from burnish.materials.curve import Curve, Mode
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.names import WEIGHT, Address, resolve
from burnish.materials.parameter import Parameter

CURVE = "curve"
"""The last word of the path of a layer's curve, as in "box.specular.curve"."""


class Unknown(Protocol):
    """A block of numbers x [size] of one object's material.

    channels: the one colour channel that each number moves, -1 where it may move all three
    (some models tint by a colour's luminance). batches: which numbers can be moved together,
    because none moves another's channel, where layers are not linked by `conserve`.
    """

    @property
    def path(self) -> str: ...
    @property
    def object(self) -> str: ...
    @property
    def lower(self) -> Float64: ...
    @property
    def upper(self) -> Float64: ...
    @property
    def channels(self) -> tuple[int, ...]: ...
    @property
    def batches(self) -> tuple[tuple[int, ...], ...]: ...
    @property
    def shape(self) -> bool:
        """Whether it bends a lobe, where the way down from one start may be a dead end."""
        ...

    @property
    def amplitude(self) -> bool:
        """Whether scaling its value scales what is reflected."""
        ...

    def read(self, state: MaterialState) -> Float64: ...
    def write(self, state: MaterialState, x: Float64) -> MaterialState: ...
    def scaled(self, state: MaterialState, factor: float) -> MaterialState: ...
    def names(self) -> tuple[str, ...]: ...


@dataclass(frozen=True)
class Knob:
    """A parameter or a layer's weight, in travel; its hard limits are its bounds.

    Travel 0 to 1 spans the soft limits where there are some, else the hard ones.
    """

    path: str
    address: Address
    parameter: Parameter

    @property
    def object(self) -> str:
        return self.address.object

    @property
    def lower(self) -> Float64:
        return np.full(self._size, self.travel(self._hard[0]))

    @property
    def upper(self) -> Float64:
        return np.full(self._size, self.travel(self._hard[1]))

    @property
    def channels(self) -> tuple[int, ...]:
        return (-1,) * self._size

    @property
    def batches(self) -> tuple[tuple[int, ...], ...]:
        return tuple((i,) for i in range(self._size))

    @property
    def shape(self) -> bool:
        return self._size == 1 and self.address.parameter != "weight"

    @property
    def amplitude(self) -> bool:
        return self.address.parameter in ("color", "weight")

    def names(self) -> tuple[str, ...]:
        if self._size == 1:
            return (self.path,)
        return tuple(f"{self.path} {channel}" for channel in ("red", "green", "blue"))

    def value(self, state: MaterialState) -> Value:
        """The value as its path means it."""
        return self.address.read(state)

    def read(self, state: MaterialState) -> Float64:
        value = replace(self.address, squared=False).read(state)
        numbers = np.clip(np.array(value, np.float64).reshape(-1), *self._hard)
        return np.array([self.travel(float(number)) for number in numbers])

    def write(self, state: MaterialState, x: Float64) -> MaterialState:
        low, high = self._hard
        numbers = [min(max(self.at(float(u)), low), high) for u in x]
        return self._stored(state, numbers)

    def scaled(self, state: MaterialState, factor: float) -> MaterialState:
        return self._stored(state, [self.at(float(u)) * factor for u in self.read(state)])

    def travel(self, value: float) -> float:
        """Slider travel of a value."""
        start, stop = (self._forward(limit) for limit in self._soft)
        return (self._forward(value) - start) / (stop - start)

    def at(self, travel: float) -> float:
        """The value at some travel."""
        start, stop = (self._forward(limit) for limit in self._soft)
        y = start + travel * (stop - start)
        if self.parameter.scale == "logarithmic":
            return math.exp(y)
        return y * abs(y) if self.parameter.scale == "square" else y

    def slope(self, travel: float) -> float:
        """d value / d travel."""
        start, stop = (self._forward(limit) for limit in self._soft)
        value = self.at(travel)
        if self.parameter.scale == "logarithmic":
            return value * (stop - start)
        if self.parameter.scale == "square":
            return 2 * math.sqrt(abs(value)) * (stop - start)
        return stop - start

    @property
    def _size(self) -> int:
        return 3 if self.parameter.kind == "colour" else 1

    @property
    def _hard(self) -> tuple[float, float]:
        # Perfectly smooth is another lobe, with a jump between the two
        low = max(self.parameter.minimum, self.parameter.rough_minimum or self.parameter.minimum)
        return low, self.parameter.maximum

    @property
    def _soft(self) -> tuple[float, float]:
        item, (low, high) = self.parameter, self._hard
        soft_low = low if item.soft_minimum is None else max(item.soft_minimum, low)
        return soft_low, high if item.soft_maximum is None else item.soft_maximum

    def _forward(self, value: float) -> float:
        if self.parameter.scale == "logarithmic":
            return math.log(value)
        return math.sqrt(max(value, 0.0)) if self.parameter.scale == "square" else value

    def _stored(self, state: MaterialState, numbers: Sequence[float]) -> MaterialState:
        value: Value = (
            (numbers[0], numbers[1], numbers[2]) if len(numbers) == 3 else float(numbers[0])
        )
        layer = state.layers[self.address.layer]
        if self.address.parameter == "weight":
            layer = replace(layer, weight=float(numbers[0]))
        else:
            layer = replace(layer, values={**layer.values, self.address.parameter: value})
        return replace(state, layers={**state.layers, self.address.layer: layer})


@dataclass(frozen=True)
class CurveOptions:
    """How a curve is fitted.

    points: how many control points, 2 to 256, placed like the layer's bins. mode: "replace"
    the profile or "gain" on it. monotone: the curve never rises with t, as lobes do about
    their centre. smoothness: how much bends cost, 0 for nothing.
    Values never fall below 0. Raises InvalidValue.
    """

    points: int = 12
    mode: Mode = "replace"
    monotone: bool = False
    smoothness: float = 0.002

    def __post_init__(self) -> None:
        if not 2 <= self.points <= 256:
            raise InvalidValue(f"points of a fitted curve must lie in [2, 256]; got {self.points}")
        if self.mode not in ("replace", "gain"):
            raise InvalidValue(f"mode must be 'replace' or 'gain'; got {self.mode!r}")
        if not 0 <= self.smoothness < math.inf:
            raise InvalidValue(f"smoothness must be at least 0; got {self.smoothness!r}")


@dataclass(frozen=True)
class CurveKnob:
    """The control points of a layer's curve: values = mixing @ x, with x >= 0 [points, 3].

    With `monotone`, x are the falls from point to point; either way every curve that the
    options allow has such an x, and no other has one.
    """

    path: str
    object: str
    layer: Layer
    options: CurveOptions
    t: Float64
    scale: Float64
    """What x is measured in at each point: the size of the curve there at the start."""

    shape = False
    amplitude = True

    @staticmethod
    def of(path: str, object_id: str, layer: Layer, state: LayerState, options: CurveOptions,
           ) -> CurveKnob:  # fmt: skip
        """For a layer in a state, with no more points than bins."""
        count = min(options.points, layer.bins)
        if count < 2:
            raise InvalidValue(
                f"{path}: the {layer.model.name} model has no curve; fit its color instead"
            )
        t = np.linspace(0.0, 1.0, count) ** layer.spacing
        values = _curve_values(layer, state, options.mode, t).mean(axis=1)
        largest = float(values.max()) or 1.0
        scale = np.maximum(values, 0.01 * largest) if options.mode == "replace" else np.ones(count)
        return CurveKnob(path, object_id, layer, options, t, scale)

    @property
    def mixing(self) -> Float64:
        """float64 [points, points], no entry below 0."""
        count = len(self.t)
        falls = np.triu(np.ones((count, count))) if self.options.monotone else np.eye(count)
        return np.asarray(falls * self.scale[None, :])

    @property
    def bends(self) -> Float64:
        """Rows that are 0 for a curve of the same shape as at the start: [points - 2, points]."""
        relative = self.mixing / self.scale[:, None]
        return self.options.smoothness * np.diff(relative, n=2, axis=0)

    @property
    def lower(self) -> Float64:
        return np.zeros(3 * len(self.t))

    @property
    def upper(self) -> Float64:
        return np.full(3 * len(self.t), np.inf)

    @property
    def channels(self) -> tuple[int, ...]:
        return (0, 1, 2) * len(self.t)

    @property
    def batches(self) -> tuple[tuple[int, ...], ...]:
        return tuple((3 * k, 3 * k + 1, 3 * k + 2) for k in range(len(self.t)))

    def names(self) -> tuple[str, ...]:
        channels = ("red", "green", "blue")
        return tuple(f"{self.path} at t={t:.3f} {name}" for t in self.t for name in channels)

    def read(self, state: MaterialState) -> Float64:
        own = state.layers[self.layer.name]
        values = _curve_values(self.layer, own, self.options.mode, self.t)
        x = np.linalg.solve(self.mixing, values)
        return np.asarray(np.maximum(x, 0.0).ravel())

    def write(self, state: MaterialState, x: Float64) -> MaterialState:
        return self._stored(state, self.mixing @ np.maximum(x, 0.0).reshape(-1, 3))

    def scaled(self, state: MaterialState, factor: float) -> MaterialState:
        curve = state.layers[self.layer.name].curve
        assert curve is not None
        return self._stored(state, np.asarray(curve.values) * factor)

    def _stored(self, state: MaterialState, values: Float64) -> MaterialState:
        curve = Curve(
            points=tuple(float(t) for t in self.t),
            values=tuple((float(r), float(g), float(b)) for r, g, b in values),
            mode=self.options.mode,
            interpolation="linear",
        )
        layer = replace(state.layers[self.layer.name], curve=curve)
        return replace(state, layers={**state.layers, self.layer.name: layer})


def unknowns_of(
    materials: Mapping[str, Material],
    state: Mapping[str, MaterialState],
    objects: Sequence[str],
    parameters: Sequence[str] | None,
    curve: CurveOptions,
) -> tuple[Unknown, ...]:
    """The unknowns that names ask for.

    parameters: full paths ("box.specular.roughness", "box.specular.curve") or what stands
    after an object's id ("specular.roughness"), then of each of the objects that has it;
    None for every parameter of their layers that reflect something, weights left out.
    Raises UnknownName, InvalidValue.
    """
    if parameters is None:
        paths = [path for object_id in objects for path in _usual(object_id, materials, state)]
    else:
        paths = [path for name in parameters for path in _expand(name, materials, objects)]
    result = [_unknown(path, materials, state, curve) for path in dict.fromkeys(paths)]
    if not result:
        raise InvalidValue("there is nothing to fit: name parameters, or objects that have some")
    places = [item.address for item in result if isinstance(item, Knob)]
    seen = {(place.object, place.layer, place.parameter) for place in places}
    if len(seen) < len(places):
        raise InvalidValue("two of the parameters are names for the same one: name it once")
    return tuple(result)


def _usual(
    object_id: str, materials: Mapping[str, Material], state: Mapping[str, MaterialState]
) -> list[str]:
    material = materials[object_id]
    return [
        f"{object_id}.{layer.name}.{item.name}"
        for layer in material.layers
        for item in material.parameters(layer.name)
        if item.kind != "choice"
        and state[object_id].layers[layer.name].enabled
        and state[object_id].layers[layer.name].weight > 0
    ]


def _expand(name: str, materials: Mapping[str, Material], objects: Sequence[str]) -> list[str]:
    """Full paths of a name. Raises UnknownName when no object has it."""
    if any(name.startswith(f"{object_id}.") for object_id in materials):
        return [name]
    found = []
    for object_id in objects:
        path = f"{object_id}.{name}"
        if name.endswith(f".{CURVE}"):
            layers = {layer.name for layer in materials[object_id].layers}
            if name.removesuffix(f".{CURVE}") in layers:
                found.append(path)
            continue
        try:
            resolve({object_id: materials[object_id]}, path)
        except UnknownName:
            continue
        found.append(path)
    if not found and objects:
        resolve({objects[0]: materials[objects[0]]}, f"{objects[0]}.{name}")
    return found


def _unknown(
    path: str,
    materials: Mapping[str, Material],
    state: Mapping[str, MaterialState],
    curve: CurveOptions,
) -> Unknown:
    if path.endswith(f".{CURVE}"):
        for object_id, material in materials.items():
            for layer in material.layers:
                if path == f"{object_id}.{layer.name}.{CURVE}":
                    own = state[object_id].layers[layer.name]
                    return CurveKnob.of(path, object_id, layer, own, curve)
    address = resolve(materials, path)
    if address.parameter == "weight":
        return Knob(path, address, WEIGHT)
    parameter = materials[address.object].layer(address.layer).parameter(address.parameter)
    if parameter.kind == "choice":
        raise InvalidValue(f"{path} is a choice and cannot be fitted: set it and fit the others")
    return Knob(path, address, parameter)


def _curve_values(layer: Layer, state: LayerState, mode: Mode, t: Float64) -> Float64:
    """What the curve of a state has at t, were it in this mode: float64 [len(t), 3]."""
    if state.curve is not None and state.curve.mode == mode:
        return state.curve.evaluate(t)
    if mode == "gain":
        return np.ones((len(t), 3))
    profile = layer.model.profile(t, state.values, layer.fixed)
    edited = profile if state.curve is None else state.curve.apply(t, profile)
    return np.array(np.broadcast_to(edited, (len(t), 3)))
