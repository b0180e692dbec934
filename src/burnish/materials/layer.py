"""Layers and materials: what is baked (structure) and what is edited (state)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Float64, Value
from burnish.materials.curve import Curve
from burnish.materials.images.image import ImageMap, Place
from burnish.materials.model import Model, Values
from burnish.materials.painting.stroke import Stroke
from burnish.materials.parameter import Parameter
from burnish.materials.two_curves import USUAL_BOXES, TwoCurves


@dataclass(frozen=True)
class Layer:
    """One summand of a material: a model, its bins, and the numbers that a bake freezes.

    bins: how many boxes divide t in [0, 1]; 1 for models with no coordinate. Of a model with two
      curves, all boxes of its grid, evenly spaced (see `two_curves`).
    spacing: bin edges lie at t = (j / bins) ** spacing. 2 gives narrow bins near the
      highlight's centre, 1 gives equal ones.
    fixed: the model's frozen numbers.
    delta: whether a column for a perfectly smooth lobe follows the bins.
    group: layers with the same (static) weight map H share a group and so one variable of
      the polynomial; "" is the group without a map.
    """

    name: str
    model: Model
    bins: int = 64
    spacing: float = 2.0
    fixed: Mapping[str, float] = field(default_factory=dict)
    delta: bool = False
    group: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.model, TwoCurves):
            if (self.bins, self.spacing) != (self.model.boxes, 1.0):
                raise InvalidValue(
                    f"layer {self.name}: bins must be those of both curves, {self.model.boxes}, "
                    f"with spacing 1; got {self.bins} with {self.spacing:g}"
                )
        elif not 1 <= self.bins <= 4096:
            raise InvalidValue(f"layer {self.name}: bins must lie in [1, 4096]; got {self.bins}")

    @property
    def edges(self) -> Float64:
        """Bin edges in t: float64 [bins + 1], from 0 to 1."""
        return np.linspace(0.0, 1.0, self.bins + 1) ** self.spacing

    @staticmethod
    def starting_at(
        name: str,
        model: Model,
        values: Values,
        *,
        bins: int = 64,
        spacing: float = 2.0,
        delta: bool = False,
        group: str = "",
    ) -> Layer:
        """A layer whose frozen numbers make it exact at `values`.

        A model without a coordinate gets one bin; of a model with two curves, bins and spacing
        are its own.
        """
        if model.coordinate_name == "none":
            bins, spacing = 1, 1.0
        if isinstance(model, TwoCurves):
            bins, spacing = model.boxes, 1.0
        return Layer(name, model, bins, spacing, model.freeze(values), delta, group)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The model's parameters with the ranges that this layer can show.

        Without a delta column a roughness cannot fall to perfectly smooth.
        """
        if self.delta:
            return self.model.parameters
        return tuple(
            replace(item, minimum=item.rough_minimum) if item.rough_minimum is not None else item
            for item in self.model.parameters
        )

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name. Raises UnknownName."""
        for item in self.parameters:
            if item.name == name:
                return item
        raise UnknownName("parameter", f"{self.name}.{name}", [p.name for p in self.parameters])

    @property
    def columns(self) -> int:
        """How many coefficients the layer has: rank · bins, and one for a delta lobe."""
        return self.model.rank * self.bins + int(self.delta)

    def with_bins(self, bins: int) -> Layer:
        """The same layer with another number of bins (a model without a coordinate keeps 1).

        Of a model with two curves they are the first one's, or fewer where the boxes would be
        more than `USUAL_BOXES`.
        """
        if isinstance(self.model, TwoCurves):
            model = self.model.with_bins(min(bins, max(USUAL_BOXES // self.model.bins2, 1)))
            return replace(self, model=model, bins=model.boxes)
        return self if self.model.coordinate_name == "none" else replace(self, bins=bins)

    def coarser(self) -> Layer:
        """The same layer with half as many bins; of two curves, of that which has more."""
        if isinstance(self.model, TwoCurves) and self.model.bins2 > self.model.bins:
            model = self.model.with_bins(self.model.bins, self.model.bins2 // 2)
            return replace(self, model=model, bins=model.boxes)
        now = self.model.bins if isinstance(self.model, TwoCurves) else self.bins
        return self.with_bins(max(now // 2, 1))


@dataclass(frozen=True)
class Replacement:
    """A layer that stands in the place of a material's own.

    values: what it started with. kept: parameters of the layer before it that are no more, but
    that links of other layers still ask for.
    """

    layer: Layer
    values: Mapping[str, Value]
    kept: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class LayerState:
    """What a user has set on one layer.

    values: parameter name to value. curve: a freehand edit that rides on the profile.
    enabled: switched off, a layer reflects nothing. weight: scales the whole layer.
    outgoing_curve: a freehand factor on the outgoing angle, at t = θo / 90°: it multiplies the
      model's s(θo) or, in mode "replace", takes its place (2006, table 1: any model can have
      one).
    replacement: another model in this layer's place (see `replacement`); `values` are its own.
    second_curve: a freehand edit of a model's second curve (see `two_curves`).
    """

    values: Mapping[str, Value]
    curve: Curve | None = None
    enabled: bool = True
    weight: float = 1.0
    outgoing_curve: Curve | None = None
    replacement: Replacement | None = None
    second_curve: Curve | None = None


def freehand(state: LayerState) -> bool:
    """Whether a curve was drawn on a layer, so that its model's own formula does not hold."""
    drawn = state.curve, state.second_curve, state.outgoing_curve
    return any(item is not None for item in drawn)


@dataclass(frozen=True)
class MaterialState:
    """The state of every layer of one object, by layer name.

    conserve: link the layers' weights so that together they reflect no more than they
    receive (2006, footnote 2). strokes: what was painted on it, in order; `painting` makes of
    them what each point of the surface has. images: pictures in place of parameters' values,
    by (layer, parameter).
    """

    layers: Mapping[str, LayerState]
    conserve: bool = False
    strokes: tuple[Stroke, ...] = ()
    images: Mapping[Place, ImageMap] = field(default_factory=dict)

    @property
    def replacements(self) -> dict[str, Replacement]:
        """The layers that have another model, by name: states of one structure have the same."""
        found = {name: layer.replacement for name, layer in self.layers.items()}
        return {name: item for name, item in found.items() if item is not None}


def unpainted(state: Mapping[str, MaterialState]) -> dict[str, MaterialState]:
    """The same materials by name without strokes and pictures, which tracing needs nothing of."""
    return {
        name: replace(item, strokes=(), images={}) if item.strokes or item.images else item
        for name, item in state.items()
    }


@dataclass(frozen=True)
class Link:
    """A parameter that always has the value of another layer's: a coat's base knows its ior.

    A link of a parameter to itself keeps the value that the material started with.
    """

    layer: str
    parameter: str
    source_layer: str
    source_parameter: str


@dataclass(frozen=True)
class Material:
    """A sum of layers, and the state that the scene gave it.

    A colour that has a picture from the beginning has it as the weight map H of its layer's
    group, which light knows at every bounce; other pictures are looked up row by row.
    links: parameters that are no knobs of their own. States leave them out; `linked` puts
      them in.
    """

    layers: tuple[Layer, ...]
    initial: MaterialState
    links: tuple[Link, ...] = ()

    def parameters(self, layer_name: str) -> tuple[Parameter, ...]:
        """The knobs of a layer: its parameters without the linked ones. Raises UnknownName."""
        taken = {link.parameter for link in self.links if link.layer == layer_name}
        return tuple(p for p in self.layer(layer_name).parameters if p.name not in taken)

    def linked(self, state: MaterialState) -> MaterialState:
        """`state` with the value of every linked parameter filled in."""
        if not self.links:
            return state
        layers = dict(state.layers)
        for link in self.links:
            source = state.layers[link.source_layer]
            value = source.values.get(link.source_parameter)
            if value is None:
                assert source.replacement is not None
                value = source.replacement.kept[link.source_parameter]
            layer = layers[link.layer]
            layers[link.layer] = replace(layer, values={**layer.values, link.parameter: value})
        return replace(state, layers=layers)

    def as_in(self, state: MaterialState) -> Material:
        """The material with the layers that a state has put in the place of its own.

        Pictures of those layers' numbers, which another model may mean otherwise, are gone.
        """
        found = state.replacements
        if not found:
            return self
        layers = tuple(
            found[layer.name].layer if layer.name in found else layer for layer in self.layers
        )
        started = {
            name: replace(
                self.initial.layers[name], values=item.values, curve=None, replacement=item
            )
            for name, item in found.items()
        }
        links = tuple(link for link in self.links if link.layer not in found)
        initial = {**self.initial.layers, **started}
        images = {
            place: image
            for place, image in self.initial.images.items()
            if place[0] not in found or self._kind(place) == "colour"
        }
        return Material(layers, replace(self.initial, layers=initial, images=images), links)

    def inherent(self, place: Place) -> ImageMap | None:
        """The picture of a colour that is part of its group's weight map, or None."""
        found = self.initial.images.get(place)
        return found if found is not None and self._kind(place) == "colour" else None

    def _kind(self, place: Place) -> str:
        """Of a parameter; "" where there is none: its layer may have got another model."""
        for layer in self.layers:
            for item in layer.parameters if layer.name == place[0] else ():
                if item.name == place[1]:
                    return item.kind
        return ""

    def varies(self, state: MaterialState) -> bool:
        """Whether a state differs from row to row, weight maps apart."""
        if state.strokes:
            return True
        now = self.as_in(state)
        inherent = {
            place: found
            for place in now.initial.images
            if (found := now.inherent(place)) is not None
        }
        shown = {place: image for place, image in state.images.items() if now._kind(place)}
        return shown != inherent

    def layer(self, name: str) -> Layer:
        """The layer of that name. Raises UnknownName."""
        for layer in self.layers:
            if layer.name == name:
                return layer
        raise UnknownName("layer", name, [layer.name for layer in self.layers])

    @property
    def groups(self) -> tuple[str, ...]:
        """The distinct groups, in order: one variable of the polynomial each."""
        return tuple(dict.fromkeys(layer.group for layer in self.layers))
