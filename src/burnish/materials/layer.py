"""Layers and materials: what is baked (structure) and what is edited (state)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64, Value
from burnish.materials.curve import Curve
from burnish.materials.model import Model


@dataclass(frozen=True)
class Layer:
    """One summand of a material: a model, its bins, and the numbers that a bake freezes.

    bins: how many boxes divide t in [0, 1]; 1 for models with no coordinate.
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
        if not 1 <= self.bins <= 4096:
            raise InvalidValue(f"layer {self.name}: bins must lie in [1, 4096]; got {self.bins}")

    @property
    def edges(self) -> Float64:
        """Bin edges in t: float64 [bins + 1], from 0 to 1."""
        return np.linspace(0.0, 1.0, self.bins + 1) ** self.spacing

    @property
    def columns(self) -> int:
        """How many coefficients the layer has: rank · bins, and one for a delta lobe."""
        return self.model.rank * self.bins + int(self.delta)

    def with_bins(self, bins: int) -> Layer:
        """The same layer with another number of bins (a model without a coordinate keeps 1)."""
        return self if self.model.coordinate_name == "none" else replace(self, bins=bins)


@dataclass(frozen=True)
class LayerState:
    """What a user has set on one layer.

    values: parameter name to value. curve: a freehand edit that rides on the profile.
    enabled: switched off, a layer reflects nothing. weight: scales the whole layer.
    """

    values: Mapping[str, Value]
    curve: Curve | None = None
    enabled: bool = True
    weight: float = 1.0


@dataclass(frozen=True)
class MaterialState:
    """The state of every layer of one object, by layer name.

    conserve: link the layers' weights so that together they reflect no more than they
    receive (2006, footnote 2).
    """

    layers: Mapping[str, LayerState]
    conserve: bool = False


@dataclass(frozen=True)
class Material:
    """A sum of layers, and the state that the scene gave it."""

    layers: tuple[Layer, ...]
    initial: MaterialState

    def layer(self, name: str) -> Layer:
        """The layer of that name. Raises UnknownName."""
        for layer in self.layers:
            if layer.name == name:
                return layer
        from burnish.core.errors import UnknownName

        raise UnknownName("layer", name, [layer.name for layer in self.layers])

    @property
    def groups(self) -> tuple[str, ...]:
        """The distinct groups, in order: one variable of the polynomial each."""
        return tuple(dict.fromkeys(layer.group for layer in self.layers))
