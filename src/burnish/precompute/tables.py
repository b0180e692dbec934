"""The numbers that a kernel reads about objects and layers, as plain arrays.

o runs over the scene's objects, s over layer slots: the s-th layer of any object shares
slot s. What is not there has a harmless default, since lanes read before they are masked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from burnish.core.types import AnyArray
from burnish.materials.layer import Layer
from burnish.materials.model import Model
from burnish.precompute.arrangement import Arrangement
from burnish.transport.basis import Basis, coarse_count

NONE = 0xFFFFFFFF
COSINE_SHARE = 0.5
SECOND_COSINE_SHARE = 0.25
"""Of a glossy layer at a second encounter, whose other lobe covers every bin evenly."""
DELTA_SHARE = 0.25


class LayerTables:
    """Tables of the layers of every object, uint32 [o, s] unless said otherwise.

    model: index into `models`, or NONE. bins. spacing: float32. column, delta_column,
    indirect_column: first column of the bins, the delta lobe (or NONE), the indirect rows'
    coarse bins. place, step, delta_place: see `Arrangement`. indirect_bins, coarse_bins: how
    many. coarse_first: first coarse column of a second encounter. half: float32, 1 where the
    half-angle lobe suits the model. variable: of the polynomial. group_slot: the first slot of
    the object's g-th group. map: index of the weight map, or NONE. fixed: float32 by parameter
    name. By object: layers, groups: how many; half_share, delta_share: float32, the default
    mixture for sampling an open material.
    """

    def __init__(
        self,
        layered: Sequence[tuple[Layer, ...]],
        symbolic: Sequence[int],
        models: Sequence[Model],
        maps: Mapping[tuple[int, str], int],
        basis: Basis,
        slots: int,
    ) -> None:
        """layered: each object's layers; symbolic: its index in `basis`, negative for none;
        maps: (object, group) to the index of its weight map."""
        shape = len(layered), slots
        self.model = np.full(shape, NONE, np.uint32)
        self.bins = np.ones(shape, np.uint32)
        self.spacing = np.ones(shape, np.float32)
        self.column = np.zeros(shape, np.uint32)
        self.delta_column = np.full(shape, NONE, np.uint32)
        self.place = np.zeros(shape, np.uint32)
        self.step = np.ones(shape, np.uint32)
        self.delta_place = np.zeros(shape, np.uint32)
        self.indirect_column = np.zeros(shape, np.uint32)
        self.indirect_bins = np.ones(shape, np.uint32)
        self.coarse_first = np.zeros(shape, np.uint32)
        self.coarse_bins = np.ones(shape, np.uint32)
        self.half = np.zeros(shape, np.float32)
        self.variable = np.zeros(shape, np.uint32)
        self.group_slot = np.zeros(shape, np.uint32)
        self.map = np.full(shape, NONE, np.uint32)
        self.fixed: dict[str, AnyArray] = {
            parameter.name: np.full(shape, parameter.default, np.float32)
            for model in models
            for parameter in model.fixed_parameters
        }
        self.layers = np.array([len(layers) for layers in layered], np.uint32)
        self.groups = np.zeros(len(layered), np.uint32)
        self.half_share = np.zeros(len(layered), np.float32)
        self.delta_share = np.zeros(len(layered), np.float32)
        self._models, self._basis = list(models), basis
        for o, layers in enumerate(layered):
            self._lay_out(o, layers)
            self._group(o, layers, symbolic[o], maps)
            self._mix(o, layers)

    def _lay_out(self, o: int, layers: Sequence[Layer]) -> None:
        """Where each layer's columns are, in the order of `Basis.slices`."""
        column = indirect = 0
        own = Arrangement.of(layers, self._basis.tails)
        for s, layer in enumerate(layers):
            self.place[o, s], self.step[o, s] = own.first[s], own.step[s]
            self.delta_place[o, s] = own.delta[s] or 0
            self.model[o, s] = self._models.index(layer.model)
            self.bins[o, s], self.spacing[o, s] = layer.bins, layer.spacing
            self.column[o, s] = column
            column += layer.model.rank * layer.bins
            if layer.delta:
                self.delta_column[o, s] = column
                column += 1
            self.indirect_column[o, s] = indirect
            self.indirect_bins[o, s] = coarse_count(layer, self._basis.indirect_bins)
            indirect += int(self.indirect_bins[o, s])
            self.coarse_bins[o, s] = coarse_count(layer, self._basis.coarse_bins)
            self.half[o, s] = layer.model.lobe == "half"
            for parameter in layer.model.fixed_parameters:
                number = layer.fixed.get(parameter.name, parameter.default)
                self.fixed[parameter.name][o, s] = number

    def _group(
        self, o: int, layers: Sequence[Layer], index: int, maps: Mapping[tuple[int, str], int]
    ) -> None:
        """Groups, their maps and, of a symbolic object, their variables and coarse columns."""
        groups = [layer.group for layer in layers]
        distinct = list(dict.fromkeys(groups))
        self.groups[o] = len(distinct)
        self.group_slot[o, : len(distinct)] = [groups.index(group) for group in distinct]
        for s, group in enumerate(groups):
            self.map[o, s] = maps.get((o, group), NONE)
            if index >= 0:
                self.variable[o, s] = self._basis.variables.index((index, group))
                if self._basis.coarse:
                    self.coarse_first[o, s] = self._basis.coarse.index((index, s, 0))

    def _mix(self, o: int, layers: Sequence[Layer]) -> None:
        """Shares of the lobes when nothing is known of what a material will be."""
        if any(layer.delta for layer in layers):
            self.delta_share[o] = DELTA_SHARE
        if any(layer.model.lobe == "half" for layer in layers):
            self.half_share[o] = (1 - COSINE_SHARE) * (1 - self.delta_share[o])
