"""A material whose parameters vary over the surface: what it is made of, row by row.

Parameters vary by strokes and by pictures (`materials.images`), whose points in a row each
count for themselves: a row's coefficients are the mean of theirs. Each varying parameter has
nodes, values between which a lobe changes little. A row's material is a mixture of the nodes
about its own values, by cubic interpolation, and its light is the same mixture of the light of
uniform materials: light is linear in the coefficients, so this renders interpolated coefficients
through the basis, for any model (2015 looks up pre-rendered images). Values that whole areas
have, what the material itself has and what strokes set, are nodes of their own: there a row is
that uniform material, exactly.

A colour that multiplies is a factor, as a weight is. Other colours whose channels do not mix are
one axis with a value of its own per channel, exact where coefficients are affine in them; the
rest are three axes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from burnish.core.types import AnyArray, Float32, Float64, Int32, Int64, Value
from burnish.materials.coefficients import albedo, coarse_coefficients, coefficients, outgoing
from burnish.materials.images.image import ImageMap, Place
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.painting.canvas import MAXIMUM_WEIGHT, Canvas, PaintedMap
from burnish.materials.painting.nodes import (
    Axis,
    Node,
    distinct,
    even,
    joint,
    node_of,
    shared_out,
)
from burnish.materials.painting.stroke import WEIGHT
from burnish.materials.parameter import Parameter
from burnish.materials.travel import Travel

NODES = 65
"""Of a scalar; about 11 % apart for a roughness, 14 % for an exponent."""
COLOUR_NODES = 33
_DARKEST = 1e-3
"""Of a weight map: what is darker is not told apart when another picture takes its place."""


@dataclass(frozen=True, eq=False)
class Mixture(MaterialState):
    """A material that varies, as light sees it after the first encounter: its mean.

    albedos: float64 [groups, 3], d of each group; coarse: from a number of bins to float64
    [Σ coarse bins, 3]. Both are means of the rows' coefficients, weighted by visible area,
    not the coefficients of a mean parameter (2008, section 5.3).
    """

    albedos: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    coarse: Callable[[int], Float64] = lambda count: np.zeros((count, 3))


class VariedTable:
    """A layer's numbers at the nodes, remembered as long as the rest of it stays."""

    def __init__(self, material: Material, layer: Layer) -> None:
        self.material, self.layer = material, layer
        self.version = 0
        """Grows when what is remembered is for another state."""
        self._state: MaterialState | None = None
        self._own: LayerState | None = None
        self._albedos: dict[Node, Float64] = {}
        self._coarse: dict[tuple[int, Node], Float64] = {}

    def begin(self, state: MaterialState, painted: Iterable[Place]) -> None:
        """Forget what was computed for a state that differs in more than painted values."""
        layers = dict(state.layers)
        for name, parameter in painted:
            layers[name] = replace(layers[name], values={**layers[name].values, parameter: 0.0})
        own = self.material.linked(MaterialState(layers)).layers[self.layer.name]
        if self._own != own:
            self._albedos, self._coarse = {}, {}
            self.version += 1
        self._own, self._state = own, state

    def hold(self, place: Place, value: Value) -> None:
        """Take a value for a painted parameter that is no part of the nodes."""
        assert self._state is not None
        layer = self._state.layers[place[0]]
        layer = replace(layer, values={**layer.values, place[1]: value})
        self._state = MaterialState({**self._state.layers, place[0]: layer})

    def layer_state(self, node: Node) -> LayerState:
        """The layer's state with the painted values of a node, links followed."""
        assert self._state is not None
        layers = dict(self._state.layers)
        for (name, parameter), value in node:
            layers[name] = replace(layers[name], values={**layers[name].values, parameter: value})
        return self.material.linked(MaterialState(layers)).layers[self.layer.name]

    def coefficients(self, node: Node) -> Float64:
        """float64 [columns, 3]."""
        return coefficients(self.layer, self.layer_state(node))

    def outgoing(self, node: Node, cos_theta_o: Float64, delta: bool) -> Float64 | None:
        """s(θo): float64 [rows, 3 or 1], or None for 1."""
        return outgoing(self.layer, self.layer_state(node), cos_theta_o, delta)

    def albedos(self, nodes: Sequence[Node]) -> Float64:
        """float64 [nodes, 3]."""
        for node in nodes:
            if node not in self._albedos:
                self._albedos[node] = albedo(self.layer, self.layer_state(node))
        return np.stack([self._albedos[node] for node in nodes])

    def coarse(self, nodes: Sequence[Node], count: int) -> Float64:
        """float64 [nodes, count, 3]."""
        for node in nodes:
            if (count, node) not in self._coarse:
                found = coarse_coefficients(self.layer, self.layer_state(node), count)
                self._coarse[count, node] = found
        return np.stack([self._coarse[count, node] for node in nodes])


@dataclass(frozen=True)
class VariedLayer:
    """A layer at each row: a mixture of uniform ones.

    version: the table's, when this was made. nodes: the table's entries that occur. index,
    share: int32 and float32 [r, k, 1 or 3], entries and their shares, one set of them per row
    or per channel; the shares add to 1. factor: float32 [r, 1 or 3], H, colours that multiply,
    and what linking the layers' weights takes off.
    """

    table: VariedTable
    version: int
    nodes: tuple[Node, ...]
    index: Int32
    share: Float32
    factor: Float32

    @property
    def layer(self) -> Layer:
        return self.table.layer

    def histogram(self, area: Float64) -> Float64:
        """What share of Σ area · factor each node has: float64 [nodes, 3 or 1].

        area: float64 [r] or [r, 3].
        """
        weighted = area.reshape(len(area), -1) * self.factor
        channels = max(self.index.shape[2], weighted.shape[1])
        result = np.zeros((len(self.nodes), channels))
        for k in range(self.index.shape[1]):
            for h in range(channels):
                own, mine = (min(h, a - 1) for a in (self.index.shape[2], weighted.shape[1]))
                amount = weighted[:, mine] * self.share[:, k, own]
                result[:, h] += np.bincount(self.index[:, k, own], amount, len(self.nodes))
        return result


@dataclass(frozen=True)
class VariedMaterial:
    """All layers of a painted material, at each row of a view."""

    layers: tuple[VariedLayer, ...]
    mean: Mixture


class VariedObject:
    """From an object's canvas and state to the numbers of its rows.

    area: float64 [n], the visible area of each row. uv: [n, points, 2], where pictures are
    looked up; needed where there are any.
    """

    def __init__(
        self,
        material: Material,
        canvas: Canvas,
        area: Float64,
        uv: AnyArray | None = None,
    ) -> None:
        self.material, self.canvas = material, canvas
        self.uv = np.zeros((len(area), 1, 2), np.float32) if uv is None else uv
        total = float(area.sum())
        self.area = area / total if total > 0 else np.full(len(area), 1 / max(len(area), 1))
        self._tables = {layer.name: VariedTable(material, layer) for layer in material.layers}
        self._multipliers: dict[tuple[str, int, Place], bool] = {}
        self._known: tuple[MaterialState, VariedMaterial] | None = None
        self._pictures: dict[Place, tuple[ImageMap, Float32]] = {}

    def at(self, state: MaterialState) -> VariedMaterial:
        """The numbers for a state, strokes included; kept while the state stays the same."""
        if self._known is None or (self._known[0] is not state and self._known[0] != state):
            self.canvas.show(state.strokes)
            self._known = state, self._varied(state)
        return self._known[1]

    def _varied(self, state: MaterialState) -> VariedMaterial:
        values, ratios = self._values(state)
        plain = replace(state, strokes=(), images={}, conserve=False)
        layers = []
        for layer in self.material.layers:
            table = self._tables[layer.name]
            table.begin(plain, values)
            factor = np.ones((len(self.area), 1), np.float32)
            for place, ratio in ratios.items():
                if layer.group and self._concerns(layer, place):
                    factor = factor * ratio
            axes: list[Axis] = []
            for place in values:
                if not self._concerns(layer, place):
                    continue
                unit = self._unit(table, place)
                if unit is None:
                    axes += self._axes(table, place, values[place], state)
                else:
                    mean = values[place].mean(axis=1) / unit
                    factor = factor * mean.astype(np.float32)
                    table.hold(place, (unit, unit, unit))
            layers.append(self._layer(table, axes, factor, self._importance(layer, state)))
        if state.conserve:
            layers = _conserved(layers)
        return VariedMaterial(tuple(layers), self._mean(state, layers))

    def _values(self, state: MaterialState) -> tuple[dict[Place, Float64], dict[Place, Float32]]:
        """What varies: values [n, points, 1 or 3] by place; and of pictures that are part of
        weight maps, by what the present one differs from it, a factor [n, 3]."""
        places = {place for place in self.canvas.maps if place[1] != WEIGHT}
        shown = {place: found for place, found in state.images.items() if self._has(place)}
        values: dict[Place, Float64] = {}
        ratios: dict[Place, Float32] = {}
        for place in self.material.initial.images:
            own = self.material.inherent(place)
            if own is None or shown.get(place) == own:
                shown.pop(place, None) if own is not None else None
                continue
            before = np.maximum(self._picture(place, own).mean(axis=1), _DARKEST)
            now = shown.pop(place, None)
            after = np.ones(1) if now is None else self._picture(place, now, now.scale, now.offset)
            after = np.maximum(after, 0).mean(axis=1) if now is not None else after
            ratios[place] = np.asarray(after / before, np.float32)
        for place in sorted({*places, *shown}):
            if not self._has(place):
                continue
            image, item = shown.get(place), self.canvas.maps.get(place)
            if image is None:
                assert item is not None
                values[place] = painted_values(self.material, state, place, item)[:-1, None]
                continue
            seen = self._picture(place, image, image.scale, image.offset).astype(np.float64)
            base = pictured(self.material, state, place, seen)
            values[place] = base if item is None else painted_over(self.material, place, item, base)
        return values, ratios

    def _picture(
        self, place: Place, image: ImageMap, scale: float = 1.0, offset: float = 0.0
    ) -> Float32:
        """scale · picture + offset at the rows' points: float32 [n, points, 1 or 3]."""
        key, raw = replace(image, scale=1.0, offset=0.0), None
        known = self._pictures.get(place)
        if known is not None and known[0] == key:
            raw = known[1]
        if raw is None:
            raw = image.raw(self.uv)
            if image != self.material.inherent(place):
                self._pictures[place] = key, raw
        return np.asarray(raw * np.float32(scale) + np.float32(offset))

    def _has(self, place: Place) -> bool:
        """Whether the material has a painted parameter: it may have got another model since."""
        return any(
            layer.name == place[0] and place[1] in {item.name for item in layer.parameters}
            for layer in self.material.layers
        )

    def _concerns(self, layer: Layer, place: Place) -> bool:
        """Whether a layer's coefficients depend on a painted parameter, its own or linked."""
        links = self.material.links
        return place[0] == layer.name or any(
            link.layer == layer.name and (link.source_layer, link.source_parameter) == place
            for link in links
        )

    def _unit(self, table: VariedTable, place: Place) -> float | None:
        """The grey to which a colour that multiplies is in proportion, None for other values."""
        parameter = self.material.layer(place[0]).parameter(place[1])
        if parameter.kind != "colour":
            return None
        key = table.layer.name, table.version, place
        if key not in self._multipliers:
            self._multipliers[key] = _multiplies(table, place, parameter)
        return parameter.maximum if self._multipliers[key] else None

    def _axes(
        self,
        table: VariedTable,
        place: Place,
        own: Float64,
        state: MaterialState,
    ) -> list[Axis]:
        """own: float64 [n, points, 1 or 3]."""
        parameter = self.material.layer(place[0]).parameter(place[1])
        item = self.canvas.maps.get(place)
        exact = _exact_values(self.material, state, place, item)
        if parameter.kind != "colour":
            travel = Travel(parameter)
            position = travel.position(NODES)
            nodes = travel.nodes(NODES)
            linear = _is_linear(table, place, parameter, alone=True)
            if linear:
                nodes, position = even(parameter.minimum, parameter.maximum, 2)
            special = np.zeros(0) if linear else exact[:, 0]
            return [Axis(place, None, nodes, special, own, position, not linear)]
        low, high = parameter.minimum, parameter.maximum
        if _channels_apart(table, place, parameter):
            linear = _is_linear(table, place, parameter)
            count = 2 if linear else COLOUR_NODES
            nodes, position = even(low, high, count)
            special = np.zeros(0) if linear else np.unique(exact)
            return [Axis(place, None, nodes, special, own, position, not linear)]
        nodes, position = even(low, high, COLOUR_NODES)
        return [
            Axis(place, h, nodes, exact[:, h], own[..., h : h + 1], position, False)
            for h in range(3)
        ]

    def _importance(self, layer: Layer, state: MaterialState) -> Float32 | None:
        """How much the points of a row count in a layer: its weight map, where that is known.

        float32 [n, points], 1 in the mean of each row. So dark parts of a row, in whose light
        a layer has no part, do not lend it their roughness.
        """
        for place in self.material.initial.images:
            own = self.material.inherent(place)
            if own is None or layer.group != self.material.layer(place[0]).group:
                continue
            shown = state.images.get(place)
            if shown is None:
                return None
            seen = self._picture(place, shown, shown.scale, shown.offset).mean(axis=2)
            seen = np.maximum(seen, _DARKEST)
            return np.asarray(seen / seen.mean(axis=1, keepdims=True), np.float32)
        return None

    def _layer(
        self,
        table: VariedTable,
        axes: list[Axis],
        factor: Float32,
        importance: Float32 | None,
    ) -> VariedLayer:
        count = len(self.area)
        painted = self.canvas.maps.get((table.layer.name, WEIGHT))
        if painted is not None:
            factor = factor * painted_weights(painted)[:-1, None]
        if any(axis.values.shape[1] > 1 for axis in axes):
            keys, places, share = shared_out(axes, count, importance)
        else:
            index, share = joint(axes, slice(None), count)
            keys, places = distinct(index[:, 0], int(np.prod([axis.size for axis in axes])))
            share = share[:, 0]
        nodes = tuple(node_of(axes, int(key)) for key in keys)
        return VariedLayer(table, table.version, nodes, places, share, factor)

    def _mean(self, state: MaterialState, layers: list[VariedLayer]) -> Mixture:
        groups = self.material.groups
        seen = self._areas(groups)
        parts = [item.histogram(seen[item.layer.group]) for item in layers]
        albedos = np.zeros((len(groups), 3))
        for item, part in zip(layers, parts, strict=True):
            d = item.table.albedos(item.nodes)
            albedos[groups.index(item.layer.group)] += (part * d).sum(axis=0)

        @cache
        def coarse(count: int) -> Float64:
            return np.concatenate(
                [
                    (
                        part[:, None] * item.table.coarse(item.nodes, min(count, item.layer.bins))
                    ).sum(axis=0)
                    for item, part in zip(layers, parts, strict=True)
                ]
            )

        return Mixture(state.layers, state.conserve, state.strokes, state.images, albedos, coarse)

    def _areas(self, groups: Iterable[str]) -> dict[str, Float64]:
        """By group the rows' shares of what is seen, times H over its mean: float64 [n, 1 or 3].

        Later encounters see H itself, and d is to be what it leaves.
        """
        result = dict.fromkeys(groups, self.area[:, None])
        for place in self.material.initial.images:
            own = self.material.inherent(place)
            if own is None:
                continue
            h = np.maximum(self._picture(place, own).mean(axis=1, dtype=np.float64), _DARKEST)
            weighted = self.area[:, None] * h
            result[self.material.layer(place[0]).group] = weighted / weighted.sum(axis=0)
        return result


def interpolation(parameter: Parameter, values: Float64) -> tuple[Int64, Float32, Float64]:
    """How values of a scalar lie between nodes: which four, their shares, and all nodes.

    values: float64 [m]; gives int [m, 4], float32 [m, 4] and float64 [nodes].
    """
    travel = Travel(parameter)
    own = np.asarray(values, np.float64)[:, None, None]
    axis = Axis(("", ""), None, travel.nodes(NODES), np.zeros(0), own, travel.position(NODES), True)
    index, share = axis.corners(slice(None))
    return index[:, 0, :, 0], share[:, 0, :, 0], axis.all_nodes


def painted_values(
    material: Material, state: MaterialState, place: Place, item: PaintedMap
) -> Float64:
    """A parameter's values at a map's entries: float64 [n + 1, 1 or 3], inside its limits.

    Where nothing was painted the very value that the material has.
    """
    parameter = material.layer(place[0]).parameter(place[1])
    base = np.atleast_1d(np.asarray(state.layers[place[0]].values[place[1]], np.float64))
    scale = item.scale.astype(np.float64)[:, None]
    shift = item.shift.astype(np.float64)
    if parameter.kind == "colour":
        values = np.clip(scale * base + shift, parameter.minimum, parameter.maximum)
    else:
        travel = Travel(parameter)
        values = travel.at(scale * travel.of(base) + shift)
    untouched = (scale[:, 0] == 1) & (shift == 0).all(axis=1)
    return np.asarray(np.where(untouched[:, None], base, values))


def pictured(material: Material, state: MaterialState, place: Place, seen: Float64) -> Float64:
    """A parameter's values where a picture shows [..., 1 or 3], inside its limits.

    A colour is tinted by the parameter's own value.
    """
    parameter = material.layer(place[0]).parameter(place[1])
    if parameter.kind == "colour":
        tint = np.asarray(state.layers[place[0]].values[place[1]], np.float64)
        return np.clip(seen * tint, parameter.minimum, parameter.maximum)
    travel = Travel(parameter)
    return np.asarray(np.clip(seen.mean(axis=-1, keepdims=True), travel.low, travel.high))


def painted_over(material: Material, place: Place, item: PaintedMap, base: Float64) -> Float64:
    """Strokes over a picture's values [n, points, 1 or 3]."""
    parameter = material.layer(place[0]).parameter(place[1])
    scale = item.scale[:-1].astype(np.float64)[:, None, None]
    shift = item.shift[:-1].astype(np.float64)[:, None]
    if parameter.kind == "colour":
        return np.clip(scale * base + shift, parameter.minimum, parameter.maximum)
    travel = Travel(parameter)
    return np.asarray(travel.at(scale * travel.of(base) + shift))


def painted_weights(item: PaintedMap) -> Float32:
    """H at a map's entries: float32 [n + 1]."""
    weights = np.clip(item.scale + item.shift[:, 0], 0, np.float32(MAXIMUM_WEIGHT))
    return np.asarray(weights)


def _exact_values(
    material: Material, state: MaterialState, place: Place, item: PaintedMap | None
) -> Float64:
    """Values that whole areas have: the untouched one, what fills made of it, what was set."""
    targets = {
        edit.value
        for stroke in state.strokes
        for edit in stroke.edits
        if edit.kind == "set" and (edit.layer, edit.parameter) == place
    }
    base = np.atleast_1d(np.asarray(state.layers[place[0]].values[place[1]], np.float64))
    found = []
    if item is not None:
        found.append(painted_values(material, state, place, item)[-1])
    if place not in state.images:
        found.append(np.broadcast_to(base, (3,) if len(base) == 3 else (1,)))
    if targets:
        shift = np.array(sorted(targets), np.float32)
        flat = PaintedMap(np.zeros(len(shift), np.float32), shift)
        found += list(painted_values(material, state, place, flat))
    width = 3 if material.layer(place[0]).parameter(place[1]).kind == "colour" else 1
    return np.stack(found) if found else np.zeros((0, width))


def _multiplies(table: VariedTable, place: Place, parameter: Parameter) -> bool:
    """Whether each channel's coefficients are in proportion to that channel of a colour."""
    high = parameter.maximum
    unit = table.coefficients(((place, (high, high, high)),))
    size = float(np.abs(unit).max())
    return parameter.minimum == 0 and all(
        np.allclose(
            table.coefficients(((place, (r, g, b)),)),
            unit * (np.array((r, g, b)) / high),
            rtol=1e-9,
            atol=1e-12 * size,
        )
        for r, g, b in ((0.2 * high, 0.5 * high, 0.9 * high), (0.7 * high, 0.0, 0.1 * high))
    )


def _channels_apart(table: VariedTable, place: Place, parameter: Parameter) -> bool:
    """Whether a channel's coefficients depend on that channel of a colour alone."""
    low, high = parameter.minimum, parameter.maximum
    a, b, c = (low + share * (high - low) for share in (0.2, 0.5, 0.9))
    together = table.coefficients(((place, (a, b, c)),))
    alone = [table.coefficients(((place, (x, x, x)),)) for x in (a, b, c)]
    own = np.stack([alone[h][:, h] for h in range(3)], axis=1)
    return bool(np.allclose(together, own, rtol=1e-9, atol=1e-12))


def _is_linear(table: VariedTable, place: Place, parameter: Parameter, alone: bool = False) -> bool:
    """Whether coefficients are an affine function of a parameter.

    alone: and s(θo) does not know it.
    """
    low, high = parameter.minimum, parameter.maximum
    at = [low + share * (high - low) for share in (0.0, 0.3, 0.5, 1.0)]
    nodes: list[Node] = [((place, (x, x, x) if parameter.kind == "colour" else x),) for x in at]
    c = np.stack([table.coefficients(node) for node in nodes])
    size = float(np.abs(c).max())
    if alone:
        cosines = np.linspace(0.05, 1.0, 9)
        found = [table.outgoing(node, cosines, False) for node in nodes]
        factors = [np.ones((1, 1)) if f is None else f for f in found]
        if not all(np.allclose(f, factors[0], rtol=1e-9) for f in factors):
            return False
    return all(
        np.allclose(c[k], c[0] + share * (c[3] - c[0]), rtol=1e-9, atol=1e-12 * size)
        for k, share in ((1, 0.3), (2, 0.5))
    )


def _conserved(layers: list[VariedLayer]) -> list[VariedLayer]:
    """The layers with one factor per row that keeps its albedo at 1 or below."""
    total = np.zeros((len(layers[0].factor), 3))
    for item in layers:
        d = item.table.albedos(item.nodes)
        for k in range(item.index.shape[1]):
            for h in range(3):
                own, mine = (min(h, a.shape[-1] - 1) for a in (item.index, item.factor))
                share = item.factor[:, mine] * item.share[:, k, own]
                total[:, h] += share * d[item.index[:, k, own], h]
    factor = (1 / np.maximum(total.max(axis=1), 1.0)).astype(np.float32)
    return [replace(item, factor=item.factor * factor[:, None]) for item in layers]
