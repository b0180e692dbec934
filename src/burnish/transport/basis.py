"""The polynomial's variables, columns and tails: the one place that orders coefficients.

B(pixel) = E + Σ_rows Σ_c Σ_z s_c(row) · coefficient_c · tail_z · T[row, c, z]

- *columns* c: the coefficients of the object that a path meets first (2008, eq. 26's c_j),
  layer by layer, each layer's terms k-major (k · bins + j), a delta column last;
- *tails* z: everything after the first encounter, a product of equivalent albedos d^z
  (z a multiset of variables), times one coarse coefficient ĉ_w of the second encounter
  when the series asks for it (2008, eq. 29), times the factor of the light group that the
  light is from, where a bake tells light groups apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.coefficients import (
    albedo,
    coarse_coefficients,
    coefficients,
    conserved,
    outgoing,
    sides,
)
from burnish.materials.layer import Layer, Material, MaterialState
from burnish.materials.lights import LightGroup, mix
from burnish.materials.painting.varied import Mixture
from burnish.materials.two_curves import TwoCurves
from burnish.transport.monomials import Monomials

State = Mapping[str, MaterialState]
"""Object id to the state of its material, and "light:NAME" to that of a light that is mixed."""


@dataclass(frozen=True)
class EditableObject:
    """An object whose material is symbolic."""

    id: str
    material: Material


@dataclass(frozen=True)
class ColumnSlice:
    """A run of columns that shares one outgoing factor."""

    layer: int
    start: int
    stop: int
    delta: bool


@dataclass(frozen=True)
class Basis:
    """What is symbolic in a bake, and in which order its coefficients stand.

    series: bins per bounce from the eye, such as (64, 1, 1, 1), (128, 8, 1), (64, 16). Its
      length is the number of bounces. The first number is a default: layers carry their own
      number of bins. A second number above 1 asks for that many coarse bins per layer at
      the second encounter. Numbers after that are 1.
    indirect_bins: coarse bins per layer of a first encounter that comes after rough fixed
      vertices.
    lights: the light groups that are told apart; none, and all light is one.
    """

    objects: tuple[EditableObject, ...]
    series: tuple[int, ...]
    indirect_bins: int = 8
    lights: tuple[LightGroup, ...] = ()

    def __post_init__(self) -> None:
        s = self.series
        if not s or any(n < 1 for n in s) or any(a < b for a, b in pairwise(s)):
            raise InvalidValue(
                f"series must be one to eight falling numbers >= 1, like 64,1,1,1; got {s}"
            )
        if any(n > 1 for n in s[2:]):
            raise InvalidValue(
                f"series may have more than one bin at its first two places only; got {s}: "
                "write 1 from the third on"
            )

    @property
    def bounces(self) -> int:
        return len(self.series)

    @property
    def coarse_bins(self) -> int:
        """Bins per layer at the second encounter; 1 means equivalent albedo."""
        return self.series[1] if len(self.series) > 1 else 1

    @cached_property
    def variables(self) -> tuple[tuple[int, str], ...]:
        """(object index, layer group) of each variable of the polynomial."""
        return tuple(
            (i, group) for i, item in enumerate(self.objects) for group in item.material.groups
        )

    @cached_property
    def monomials(self) -> Monomials:
        """Products of equivalent albedos met after the first (or second, coarse) encounter."""
        used = 1 if self.coarse_bins == 1 else 2
        return Monomials(len(self.variables), max(self.bounces - used, 0))

    @cached_property
    def coarse(self) -> tuple[tuple[int, int, int], ...]:
        """(object, layer, first tail's coarse offset) … flattened: one entry per coarse column.

        Each entry is (object index, layer index, coarse bin); empty for series (J, 1, …).
        """
        if self.coarse_bins == 1:
            return ()
        return tuple(
            (i, k, w)
            for i, item in enumerate(self.objects)
            for k, layer in enumerate(item.material.layers)
            for w in range(coarse_count(layer, self.coarse_bins))
        )

    @property
    def light_tails(self) -> int:
        """Number of tails of one light group. Without coarse columns tail z is monomial z; with
        them tail 0 is "no second encounter" and tail 1 + w · len(monomials) + z is coarse
        column w followed by monomial z."""
        if not self.coarse:
            return len(self.monomials)
        return 1 + len(self.coarse) * len(self.monomials)

    @property
    def tails(self) -> int:
        """Number of tails: tail g · light_tails + z is tail z of light group g."""
        return max(len(self.lights), 1) * self.light_tails

    def slices(self, index: int) -> tuple[ColumnSlice, ...]:
        """Columns of one object's fine rows, in runs that share an outgoing factor."""
        result, start = [], 0
        for k, layer in enumerate(self.objects[index].material.layers):
            stop = start + layer.model.rank * layer.bins
            result.append(ColumnSlice(k, start, stop, delta=False))
            start = stop
            if layer.delta:
                result.append(ColumnSlice(k, start, start + 1, delta=True))
                start += 1
        return tuple(result)

    def indirect_slices(self, index: int) -> tuple[ColumnSlice, ...]:
        """Columns of one object's indirect rows: coarse bins per layer, no outgoing factor."""
        result, start = [], 0
        for k, layer in enumerate(self.objects[index].material.layers):
            stop = start + coarse_count(layer, self.indirect_bins)
            result.append(ColumnSlice(k, start, stop, delta=False))
            start = stop
        return tuple(result)

    def columns(self, index: int, indirect: bool = False) -> int:
        """Number of columns of one object's rows."""
        return (self.indirect_slices if indirect else self.slices)(index)[-1].stop

    def index(self, object_id: str) -> int:
        """Position of an object. Raises UnknownName."""
        for i, item in enumerate(self.objects):
            if item.id == object_id:
                return i
        from burnish.core.errors import UnknownName

        raise UnknownName("editable object", object_id, [item.id for item in self.objects])

    # -- from a state to numbers ----------------------------------------------------------

    def column_coefficients(self, index: int, state: State, indirect: bool = False) -> Float64:
        """Coefficients of one object's columns: float64 [columns, 3], linear RGB.

        A painted material has coefficients of its own in every fine row (`runtime.painted`).
        """
        item = self.objects[index]
        own = state[item.id]
        if isinstance(own, Mixture) and indirect:
            return own.coarse(self.indirect_bins)
        settled = conserved(item.material, state[item.id])
        parts = [
            coarse_coefficients(
                layer, settled.layers[layer.name], coarse_count(layer, self.indirect_bins)
            )
            if indirect
            else coefficients(layer, settled.layers[layer.name])
            for layer in item.material.layers
        ]
        return np.concatenate(parts)

    def sides(self, index: int, state: State, part: ColumnSlice) -> tuple[Float64, Float64] | None:
        """Coefficients of each curve of a slice whose layer has two, A [k, j, 3] and
        B [k, l, 3]; None for one curve. Those of the columns are their outer products."""
        item = self.objects[index]
        layer = item.material.layers[part.layer]
        if not isinstance(layer.model, TwoCurves) or part.delta:
            return None
        return sides(layer, conserved(item.material, state[item.id]).layers[layer.name])

    def outgoing_factors(
        self, index: int, state: State, cos_theta_o: Float64
    ) -> list[Float64 | None]:
        """s(θo) of each slice of an object's fine rows: [rows, 3 or 1], or None for 1."""
        return [
            self.outgoing_factor(index, state, part, cos_theta_o) for part in self.slices(index)
        ]

    def outgoing_factor(
        self, index: int, state: State, part: ColumnSlice, cos_theta_o: Float64
    ) -> Float64 | None:
        """s(θo) of one slice: float64 [rows, 3 or 1], or None for 1."""
        item = self.objects[index]
        layer = item.material.layers[part.layer]
        settled = conserved(item.material, state[item.id])
        return outgoing(layer, settled.layers[layer.name], cos_theta_o, part.delta)

    def albedos(self, state: State) -> Float64:
        """Equivalent albedo d of each variable: float64 [variables, 3] (2008, eq. 36–37)."""
        parts = [
            self._remembered("albedos", i, state[item.id], self._object_albedos)
            for i, item in enumerate(self.objects)
        ]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    def coarse_values(self, state: State) -> Float64:
        """ĉ_w of each coarse column: float64 [coarse, 3]."""
        parts = [
            self._remembered("coarse", i, state[item.id], self._object_coarse_values)
            for i, item in enumerate(self.objects)
        ]
        return np.concatenate(parts) if parts else np.zeros((0, 3))

    def _object_albedos(self, index: int, state: MaterialState) -> Float64:
        """d of one object's groups: float64 [groups, 3]."""
        if isinstance(state, Mixture):
            return state.albedos
        material = self.objects[index].material
        settled = conserved(material, state)
        result = np.zeros((len(material.groups), 3))
        for layer in material.layers:
            result[material.groups.index(layer.group)] += albedo(layer, settled.layers[layer.name])
        return result

    def _object_coarse_values(self, index: int, state: MaterialState) -> Float64:
        """ĉ_w of one object's layers: float64 [coarse columns, 3]."""
        if isinstance(state, Mixture):
            return state.coarse(self.coarse_bins)
        material = self.objects[index].material
        settled = conserved(material, state)
        return np.concatenate(
            [
                coarse_coefficients(
                    layer, settled.layers[layer.name], coarse_count(layer, self.coarse_bins)
                )
                for layer in material.layers
            ]
        )

    def _remembered(
        self,
        kind: str,
        index: int,
        state: MaterialState,
        compute: Callable[[int, MaterialState], Float64],
    ) -> Float64:
        """What was computed last for one object, if its state is still the same.

        A frame changes one object's state and asks for the numbers of all.
        """
        known = self._memory.get((kind, index))
        if known is None or known[0] is not state:
            known = state, compute(index, state)
            self._memory[kind, index] = known
        return known[1]

    @cached_property
    def _memory(self) -> dict[tuple[str, int], tuple[MaterialState, Float64]]:
        return {}

    def tail_values(self, state: State) -> Float64:
        """The factor of every tail: float64 [tails, 3]."""
        values = self.monomials.evaluate(self.albedos(state))
        if self.coarse:
            products = self.coarse_values(state)[:, None, :] * values[None]
            values = np.concatenate([np.ones((1, 3)), products.reshape(-1, 3)])
        if self.lights:
            values = (mix(self.lights, state)[:, None, :] * values[None]).reshape(-1, 3)
        return values


def coarse_count(layer: Layer, bins: int) -> int:
    """Coarse bins of a layer: no more than the fine ones, one without a coordinate."""
    return min(layer.bins, bins)


def initial_state(objects: Sequence[EditableObject]) -> dict[str, MaterialState]:
    """The state in which the scene was loaded."""
    return {item.id: item.material.initial for item in objects}
