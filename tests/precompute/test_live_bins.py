"""Live estimates that would not fit: fewer bins, and a basis that says so."""

from __future__ import annotations

import pytest

from burnish.precompute import live
from burnish.precompute.plan import basis_for
from burnish.scene import load
from burnish.transport.basis import initial_state


@pytest.mark.parametrize(("stored_bytes", "bins"), [(live.STORED_BYTES, 64), (300_000, 16)])
def test_columns_are_counted_in_the_basis_that_is_published(
    monkeypatch: pytest.MonkeyPatch, stored_bytes: int, bins: int
) -> None:
    monkeypatch.setattr(live, "STORED_BYTES", stored_bytes)
    scene = load("cornell-box", resolution=(32, 32))
    basis = basis_for(scene)
    state = initial_state(basis.objects)
    estimate = live.LiveEstimate(scene, scene.view(), basis, ["large-box"], state)
    own = estimate.frozen_basis.objects[basis.index("large-box")].material
    assert [layer.bins for layer in own.layers] == [1, bins]
    kinds = {(part.object, part.indirect) for part in estimate.parts()}
    assert {indirect for _, indirect in kinds} == {False, True}
    for index, indirect in kinds:
        slices = [
            part.slice
            for part in estimate.parts()
            if (part.object, part.indirect) == (index, indirect)
        ]
        assert slices[-1].stop == estimate.frozen_basis.columns(index, indirect)
