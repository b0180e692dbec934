"""A material whose parameters vary over the surface: its coefficients, row by row.

Each painted parameter has nodes, values between which a lobe changes little. The coefficients
at the nodes that occur make a table, computed when first needed; a row's coefficients are the
table's, interpolated at the row's own values, and so the picture is rendered through the
basis, for any model (what 2015 looks up in pre-rendered images). Values that whole areas have,
what the material itself has and what strokes set, are nodes of their own: there the
coefficients are those of the uniform material, exactly.

Colours whose channels do not mix are one axis with a value of its own per channel, exact where
coefficients are linear in them; other colours are three axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from burnish.core.types import AnyArray, Float32, Float64, Int32, Int64, Value
from burnish.materials.coefficients import albedo, coarse_coefficients, coefficients, outgoing
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.painting.canvas import MAXIMUM_WEIGHT, Canvas, PaintedMap, Place
from burnish.materials.painting.stroke import WEIGHT, Stroke
from burnish.materials.parameter import Parameter
from burnish.materials.travel import Travel

NODES = 257
"""Values of a scalar that are tabulated; about 2 % apart for a roughness or an exponent."""
COLOUR_NODES = 33


Node = tuple[tuple[Place, Value], ...]
"""The painted parameters' values at an entry of a table."""


@dataclass(frozen=True, eq=False)
class Mixture(MaterialState):
    """A material that varies, as light sees it after the first encounter: its mean.

    albedos: float64 [groups, 3], d of each group; coarse: by number of bins float64
    [Σ coarse bins, 3]. Both are means of the rows' coefficients, weighted by visible area,
    not the coefficients of a mean parameter (2008, section 5.3).
    """

    albedos: Float64 = field(default_factory=lambda: np.zeros((0, 3)))
    coarse: Mapping[int, Float64] = field(default_factory=dict)


class VariedTable:
    """The coefficients of a layer at the nodes, remembered as long as the rest stays."""

    def __init__(self, material: Material, layer: Layer) -> None:
        self.material, self.layer = material, layer
        self.version = 0
        """Grows when what is remembered is for another state."""
        self._state: MaterialState | None = None
        self._coefficients: dict[Node, Float64] = {}
        self._albedos: dict[Node, Float64] = {}
        self._coarse: dict[tuple[int, Node], Float64] = {}

    def begin(self, state: MaterialState) -> None:
        """Forget what was computed for another state."""
        if self._state is not state and self._state != state:
            self._coefficients, self._albedos, self._coarse = {}, {}, {}
            self.version += 1
        self._state = state

    def layer_state(self, node: Node) -> LayerState:
        """The layer's state with the painted values of a node, links followed."""
        assert self._state is not None
        layers = dict(self._state.layers)
        for (name, parameter), value in node:
            layers[name] = replace(layers[name], values={**layers[name].values, parameter: value})
        return self.material.linked(MaterialState(layers)).layers[self.layer.name]

    def coefficients(self, nodes: Sequence[Node]) -> Float64:
        """float64 [nodes, columns, 3]."""
        for node in nodes:
            if node not in self._coefficients:
                self._coefficients[node] = coefficients(self.layer, self.layer_state(node))
        return np.stack([self._coefficients[node] for node in nodes])

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
    """A layer's numbers at each row.

    version: the table's, when this was made. nodes: the table's entries that occur. index,
    share: int32 and float32 [r, k, 1 or 3], entries and their shares, one set of them per row
    or per channel. factor: float32 [r, 1], H and what linking the layers' weights takes off it.
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

    @cached_property
    def columns(self) -> Float32:
        """The nodes' coefficients: float32 [nodes, columns, 3]."""
        return self.table.coefficients(self.nodes).astype(np.float32)

    def coefficients(self, rows: AnyArray, columns: slice) -> Float32:
        """The coefficients of some columns at some rows, H left out: float32 [r, columns, 3]."""
        table, index, share = self.columns[:, columns], self.index[rows], self.share[rows]
        result = np.zeros((len(index), table.shape[1], 3), np.float32)
        for k in range(index.shape[1]):
            for h in range(3):
                own = min(h, index.shape[2] - 1)
                result[:, :, h] += share[:, k, own, None] * table[index[:, k, own], :, h]
        return result

    def outgoing(self, rows: AnyArray, cos_theta_o: Float64, delta: bool) -> Float32 | None:
        """s(θo) at some rows: float32 [r, 3], or None for 1 everywhere."""
        index, share = self.index[rows], self.share[rows]
        result = np.zeros((len(index), 3), np.float32)
        plain = True
        for n, node in enumerate(self.nodes):
            weight = np.where(index == n, share, np.float32(0)).sum(axis=1)
            used = np.flatnonzero(weight.any(axis=1))
            if not len(used):
                continue
            found = outgoing(self.layer, self.table.layer_state(node), cos_theta_o[used], delta)
            plain = plain and found is None
            result[used] += weight[used] * (1.0 if found is None else found.astype(np.float32))
        return None if plain else result

    def histogram(self, area: Float64) -> Float64:
        """What share of Σ area · H has each node: float64 [nodes, 3]."""
        weighted = area[:, None] * self.factor
        result = np.zeros((len(self.nodes), 3))
        for k in range(self.index.shape[1]):
            for h in range(3):
                own = min(h, self.index.shape[2] - 1)
                amount = weighted[:, 0] * self.share[:, k, own]
                result[:, h] += np.bincount(self.index[:, k, own], amount, len(self.nodes))
        return result


@dataclass(frozen=True)
class VariedMaterial:
    """All layers of a painted material, at each row of a view."""

    layers: tuple[VariedLayer, ...]
    mean: Mixture


class VariedObject:
    """From an object's canvas and state to the numbers of its rows.

    area: float64 [n], the visible area of each row. coarse: the numbers of coarse bins that
    are asked of the mean.
    """

    def __init__(
        self, material: Material, canvas: Canvas, area: Float64, coarse: Iterable[int]
    ) -> None:
        self.material, self.canvas = material, canvas
        total = float(area.sum())
        self.area = area / total if total > 0 else np.full(len(area), 1 / max(len(area), 1))
        self.counts = tuple(coarse)
        self._tables = {layer.name: VariedTable(material, layer) for layer in material.layers}
        self._known: tuple[MaterialState, VariedMaterial] | None = None

    def at(self, state: MaterialState) -> VariedMaterial:
        """The numbers for a state, strokes included; kept while the state stays the same."""
        if self._known is None or (self._known[0] is not state and self._known[0] != state):
            self.canvas.show(state.strokes)
            self._known = state, self._varied(state)
        return self._known[1]

    def _varied(self, state: MaterialState) -> VariedMaterial:
        values = {
            place: painted_values(self.material, state, place, item)
            for place, item in self.canvas.maps.items()
            if place[1] != WEIGHT and self._has(place)
        }
        plain = replace(state, strokes=(), conserve=False)
        layers = []
        for layer in self.material.layers:
            table = self._tables[layer.name]
            table.begin(plain)
            own = [place for place in values if self._concerns(layer, place)]
            axes = [
                axis
                for place in own
                for axis in self._axes(table, layer, place, values, plain, state.strokes)
            ]
            layers.append(self._layer(table, axes))
        if state.conserve:
            layers = _conserved(layers)
        return VariedMaterial(tuple(layers), self._mean(state, layers))

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

    def _axes(
        self,
        table: VariedTable,
        layer: Layer,
        place: Place,
        values: Mapping[Place, Float64],
        state: MaterialState,
        strokes: Iterable[Stroke],
    ) -> list[_Axis]:
        parameter = self.material.layer(place[0]).parameter(place[1])
        own = values[place]
        exact = _exact_values(self.material, state, place, own, strokes)
        if parameter.kind != "colour":
            return [_Axis(place, None, Travel(parameter).nodes(NODES), exact[:, 0], own[:-1])]
        low, high = parameter.minimum, parameter.maximum
        if _channels_apart(table, place, parameter):
            linear = _is_linear(table, place, parameter)
            nodes = np.linspace(low, high, 2 if linear else NODES)
            special = np.zeros(0) if linear else np.unique(exact)
            return [_Axis(place, None, nodes, special, own[:-1])]
        nodes = np.linspace(low, high, COLOUR_NODES)
        return [_Axis(place, h, nodes, exact[:, h], own[:-1, h : h + 1]) for h in range(3)]

    def _layer(self, table: VariedTable, axes: list[_Axis]) -> VariedLayer:
        count = len(self.area)
        factor = np.ones((count, 1), np.float32)
        painted = self.canvas.maps.get((table.layer.name, WEIGHT))
        if painted is not None:
            factor = painted_weights(painted)[:-1, None]
        index = np.zeros((count, 1, 1), np.int64)
        share = np.ones((count, 1, 1), np.float32)
        for axis in axes:
            # Corners of the axes so far, times the two ends of this one's cell
            low, fraction = axis.cells()
            size = len(axis.all_nodes)
            ends = np.stack([low, np.where(fraction > 0, low + 1, low)], axis=1)
            parts = np.stack([1 - fraction, fraction], axis=1)
            corners = index[:, :, None] * size + ends[:, None]
            index = corners.reshape(count, -1, corners.shape[3])
            share = (share[:, :, None] * parts[:, None]).reshape(index.shape)
        keys, flat = np.unique(index, return_inverse=True)
        nodes = tuple(_node(axes, int(key)) for key in keys)
        return VariedLayer(
            table, table.version, nodes, flat.reshape(index.shape).astype(np.int32), share, factor
        )

    def _mean(self, state: MaterialState, layers: list[VariedLayer]) -> Mixture:
        groups = self.material.groups
        albedos = np.zeros((len(groups), 3))
        coarse: dict[int, list[Float64]] = {count: [] for count in self.counts}
        for item in layers:
            part = item.histogram(self.area)
            d = item.table.albedos(item.nodes)
            albedos[groups.index(item.layer.group)] += (part * d).sum(axis=0)
            for count, found in coarse.items():
                values = item.table.coarse(item.nodes, min(count, item.layer.bins))
                found.append((part[:, None] * values).sum(axis=0))
        return Mixture(
            state.layers,
            state.conserve,
            state.strokes,
            albedos,
            {count: np.concatenate(found) for count, found in coarse.items()},
        )


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


def painted_weights(item: PaintedMap) -> Float32:
    """H at a map's entries: float32 [n + 1]."""
    weights = np.clip(item.scale + item.shift[:, 0], 0, np.float32(MAXIMUM_WEIGHT))
    return np.asarray(weights)


@dataclass(frozen=True)
class _Axis:
    """A painted number: regular nodes, values that are nodes of their own, and each row's.

    channel: the channel of a colour whose channels mix, else None. values: float64 [r, 1 or 3].
    """

    place: Place
    channel: int | None
    nodes: Float64
    special: Float64
    values: Float64

    @cached_property
    def all_nodes(self) -> Float64:
        return np.concatenate([self.nodes, np.unique(self.special)])

    def cells(self) -> tuple[Int64, Float32]:
        """The node below each value and the fraction towards the next: [r, 1 or 3] each."""
        nodes, values = self.nodes, self.values
        low = np.clip(np.searchsorted(nodes, values, side="right") - 1, 0, len(nodes) - 2)
        width = nodes[low + 1] - nodes[low]
        fraction = np.clip((values - nodes[low]) / width, 0.0, 1.0).astype(np.float32)
        # A fraction of 1 is the next node itself
        low, fraction = np.where(fraction == 1, low + 1, low), np.where(fraction == 1, 0, fraction)
        exact = np.unique(self.special)
        if len(exact):
            at = np.minimum(np.searchsorted(exact, values), len(exact) - 1)
            same = exact[at] == values
            low = np.where(same, len(nodes) + at, low)
            fraction = np.where(same, np.float32(0), fraction)
        return low.astype(np.int64), fraction.astype(np.float32)


def _node(axes: list[_Axis], key: int) -> Node:
    """The painted values of a combination of nodes."""
    values: dict[Place, Value] = {}
    mixed: dict[Place, dict[int, float]] = {}
    for axis in reversed(axes):
        key, position = divmod(key, len(axis.all_nodes))
        number = float(axis.all_nodes[position])
        if axis.channel is not None:
            mixed.setdefault(axis.place, {})[axis.channel] = number
        else:
            wide = axis.values.shape[1] == 3
            values[axis.place] = (number,) * 3 if wide else number
    for place, channels in mixed.items():
        values[place] = (channels[0], channels[1], channels[2])
    return tuple(sorted(values.items()))


def _exact_values(
    material: Material,
    state: MaterialState,
    place: Place,
    values: Float64,
    strokes: Iterable[Stroke],
) -> Float64:
    """Values that whole areas have: the untouched one, what fills made of it, what was set."""
    targets = {
        edit.value
        for stroke in strokes
        for edit in stroke.edits
        if edit.kind == "set" and (edit.layer, edit.parameter) == place
    }
    base = np.atleast_1d(np.asarray(state.layers[place[0]].values[place[1]], np.float64))
    found = [np.broadcast_to(base, values[-1].shape), values[-1]]
    if targets:
        shift = np.array(sorted(targets), np.float32)
        item = PaintedMap(np.zeros(len(shift), np.float32), shift)
        found += list(painted_values(material, state, place, item))
    return np.stack(found)


def _channels_apart(table: VariedTable, place: Place, parameter: Parameter) -> bool:
    """Whether a channel's coefficients depend on that channel of a colour alone."""
    low, high = parameter.minimum, parameter.maximum
    a, b, c = (low + share * (high - low) for share in (0.2, 0.5, 0.9))
    together = table.coefficients([((place, (a, b, c)),)])[0]
    alone = table.coefficients([((place, (x, x, x)),) for x in (a, b, c)])
    own = np.stack([alone[h, :, h] for h in range(3)], axis=1)
    return bool(np.allclose(together, own, rtol=1e-9, atol=1e-12))


def _is_linear(table: VariedTable, place: Place, parameter: Parameter) -> bool:
    """Whether coefficients are an affine function of a colour."""
    low, high = parameter.minimum, parameter.maximum
    at = [low + share * (high - low) for share in (0.0, 0.3, 0.5, 1.0)]
    c = table.coefficients([((place, (x, x, x)),) for x in at])
    size = float(np.abs(c).max())
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
                own = min(h, item.index.shape[2] - 1)
                total[:, h] += (
                    item.factor[:, 0] * item.share[:, k, own] * d[item.index[:, k, own], h]
                )
    factor = (1 / np.maximum(total.max(axis=1), 1.0)).astype(np.float32)
    return [replace(item, factor=item.factor * factor[:, None]) for item in layers]
