"""What a bake asks for before it starts is enough for what comes of it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from burnish.core.errors import TooLarge
from burnish.precompute import plan
from burnish.precompute.bake import plan_views, trace_tile
from burnish.precompute.plan import basis_for, check_memory, editing_bytes, most_powers
from burnish.runtime.freeze import freeze
from burnish.transport.basis import Basis, initial_state
from burnish.transport.frozen import FoldedPart
from burnish.transport.pack import TiledBlocks
from tests.precompute import worlds


@pytest.mark.parametrize("series", [(64, 1, 1), (32, 4)])
def test_editing_takes_no_more_than_was_said(series: tuple[int, ...]) -> None:
    scene = worlds.metals(32)
    basis = basis_for(scene, series=series)
    view = plan_views(scene, basis, seed=0)[0]
    tiles = [trace_tile(view, number, 64, 0, 0.01) for number in range(len(view.tiles))]
    source = TiledBlocks.of(basis, 32, 32, tiles)
    taken = source.base.nbytes + source.emission.nbytes
    for stack in source.stacks():
        taken += stack.core.nbytes + stack.S.nbytes + stack.expansion.nbytes
    made = 0
    for target in range(len(basis.objects)):
        frozen = freeze(source, (target,), initial_state(basis.objects))
        parts = [part for part in frozen.parts if not isinstance(part, FoldedPart)]
        # V by pixel and by power
        made = max(made, sum(2 * part.F.nbytes for part in parts))
    assert taken + made <= editing_bytes(basis, view.rows, 32, 32)


@pytest.mark.parametrize("series", [(64,), (64, 1, 1, 1), (128, 8, 1), (64, 16)])
def test_powers_are_counted_as_a_freeze_makes_them(series: tuple[int, ...]) -> None:
    objects = basis_for(worlds.glossy(8), series=series).objects
    # A layer with a weight map of its own is a variable of its own
    first = objects[0].material
    apart = tuple(replace(layer, group=layer.name) for layer in first.layers)
    basis = Basis(
        (replace(objects[0], material=replace(first, layers=apart)), *objects[1:]), series
    )
    source = TiledBlocks.of(basis, 8, 8, [])
    state = initial_state(basis.objects)
    found = [
        len(freeze(source, (target,), state).powers.exponents)
        for target in range(len(basis.objects))
    ]
    assert most_powers(basis) == max(found)


def test_a_bake_that_cannot_be_edited_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = worlds.metals(16)
    basis = basis_for(scene, series=(64, 1))
    rows = plan_views(scene, basis, seed=0)[0].rows
    check_memory(basis, rows, 16, 16)
    monkeypatch.setattr(plan, "MEMORY_BYTES", editing_bytes(basis, rows, 16, 16) - 1)
    with pytest.raises(TooLarge, match="fewer editable objects"):
        check_memory(basis, rows, 16, 16)
