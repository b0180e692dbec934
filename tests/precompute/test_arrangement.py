"""Where a row's values lie: every one at one place, those of a bin side by side."""

from __future__ import annotations

import numpy as np
import pytest

from burnish.materials.layer import Layer
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance import CookTorranceConductor
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.principled import PrincipledBase
from burnish.precompute.arrangement import Arrangement
from burnish.transport.cells import Cells
from tests.transport.test_cells import sparse

LAYERS = {
    "one quotient": (Layer("d", Lambert(), bins=1), Layer("s", BlinnPhong(), bins=5)),
    "many": (
        Layer("d", Lambert(), bins=1),
        Layer("s", CookTorranceConductor(), bins=5, delta=True),
        Layer("b", PrincipledBase(), bins=1),
        Layer("g", BlinnPhong(), bins=3),
    ),
}


@pytest.mark.parametrize("layers", LAYERS.values(), ids=LAYERS)
@pytest.mark.parametrize("tails", [1, 3, 8])
def test_every_column_and_tail_has_one_place(layers: tuple[Layer, ...], tails: int) -> None:
    own = Arrangement.of(layers, tails)
    columns = sum(layer.columns for layer in layers)
    if own.keys is None or own.order is None:
        assert all(layer.model.rank == 1 for layer in layers)
        assert own.places == columns * tails
        return
    assert len(own.keys) == own.places
    np.testing.assert_array_equal(np.sort(own.keys[own.keys >= 0]), np.arange(columns * tails))
    np.testing.assert_array_equal(own.keys[own.order], np.arange(columns * tails))


@pytest.mark.parametrize("tails", [1, 3, 8])
def test_quotients_of_a_bin_lie_side_by_side(tails: int) -> None:
    layers = LAYERS["many"]
    own = Arrangement.of(layers, tails)
    assert own.keys is not None
    assert own.places % 2 == 0
    column = 0
    for s, layer in enumerate(layers):
        rank, bins = layer.model.rank, layer.bins
        if rank > 1:
            assert own.first[s] % 2 == 0
            assert own.step[s] % 2 == 0
        for j in range(bins):
            for z in range(tails):
                at = own.first[s] + (j * tails + z) * own.step[s] + np.arange(rank)
                wanted = (column + np.arange(rank) * bins + j) * tails + z
                np.testing.assert_array_equal(own.keys[at], wanted)
        column += rank * bins
        delta = own.delta[s]
        assert (delta is not None) == layer.delta
        if delta is not None:
            wanted = column * tails + np.arange(tails)
            np.testing.assert_array_equal(own.keys[delta : delta + tails], wanted)
            column += 1


def test_cells_are_the_same_in_any_order() -> None:
    T = sparse()
    rows = np.array([0, 1, 2, 7, 12, 13])
    plain = Cells.of(T, rows)
    keys = np.concatenate([np.random.default_rng(4).permutation(9 * 11), [-1, -1, -1]])
    flat = np.where(keys[:, None] >= 0, T.reshape(len(T), -1, 3)[:, keys], 0)
    mixed = Cells.among(flat.astype(np.float32), rows, 9, 11, keys)
    np.testing.assert_array_equal(mixed.cells, plain.cells)
    np.testing.assert_array_equal(mixed.values, plain.values)
