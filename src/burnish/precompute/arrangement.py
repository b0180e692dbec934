"""Where the values of a row lie in a tile's tensor.

What light adds to a bin of a layer it adds to each of the layer's quotients, under one tail.
Column after column, as the basis counts them, those would be as many places far apart. So the
quotients of a (bin, tail) lie side by side: four of them fill a line of the cache, and two are
added to in one step, for which they begin at an even place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from burnish.core.types import Int64
from burnish.materials.layer import Layer
from burnish.transport.basis import Basis

_LINE = 4
"""Values of a line of the cache, a value being RGB and a float of nothing."""


@dataclass(frozen=True)
class Arrangement:
    """The places of a row's values, one for each.

    first: of each layer; step: from one of its (bin, tail) pairs, tails fastest, to the next.
    delta: of its delta column, None without. places: of a row in all. keys: int64 [places],
    the column · tails + tail that each belongs to, -1 for none; None where they are in order.
    """

    first: tuple[int, ...]
    step: tuple[int, ...]
    delta: tuple[int | None, ...]
    places: int
    keys: Int64 | None

    @cached_property
    def order(self) -> Int64 | None:
        """The place of each (column, tail), tails fastest: int64 [columns · tails]; None where
        they are in order."""
        if self.keys is None:
            return None
        return np.argsort(self.keys)[np.count_nonzero(self.keys < 0) :]

    @staticmethod
    def of(layers: Sequence[Layer], tails: int) -> Arrangement:
        """The arrangement of fine rows, in whose columns each layer is k-major."""
        first, step, delta = [], [], []
        keys: list[Int64] = []
        place = column = 0
        apart = any(layer.model.rank > 1 for layer in layers)
        for layer in layers:
            rank, bins = layer.model.rank, layer.bins
            width = _width(rank)
            before = -place % (min(width & -width, _LINE) if width > 1 else 1)
            keys.append(np.full(before, -1))
            own = np.full((bins, tails, width), -1)
            numbers = column * tails + np.arange(rank * bins * tails).reshape(rank, bins, tails)
            own[..., :rank] = numbers.transpose(1, 2, 0)
            keys.append(own.ravel())
            first.append(place + before)
            step.append(width)
            place += before + own.size
            column += rank * bins
            delta.append(place if layer.delta else None)
            if layer.delta:
                keys.append(column * tails + np.arange(tails))
                place, column = place + tails, column + 1
        if not apart:
            return Arrangement(tuple(first), tuple(step), tuple(delta), place, None)
        keys.append(np.full(-place % _LINE, -1))
        every = np.concatenate(keys).astype(np.int64)
        return Arrangement(tuple(first), tuple(step), tuple(delta), len(every), every)


def arranged(basis: Basis, index: int, indirect: bool) -> Arrangement:
    """How the rows of an object and kind lie; coarse columns have one quotient each."""
    if not indirect:
        return Arrangement.of(basis.objects[index].material.layers, basis.tails)
    return plain(basis, index, indirect)


def plain(basis: Basis, index: int, indirect: bool) -> Arrangement:
    """Column after column, as the basis counts them."""
    return Arrangement((), (), (), basis.columns(index, indirect) * basis.tails, None)


def _width(rank: int) -> int:
    """Places of a layer's quotients."""
    return rank + rank % 2 if rank > 1 else 1
