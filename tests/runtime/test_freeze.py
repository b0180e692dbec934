"""Frozen and rendered equals the plain polynomial, for every set of targets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import chain, combinations

import numpy as np
import pytest

from burnish.core.errors import InvalidValue, TooLarge
from burnish.materials.layer import LayerState, MaterialState
from burnish.runtime.freeze import BakedTransport, freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import EditableObject, initial_state
from tests.runtime.worlds import basis_of, edited, glossy, plain_image, random_world, shaded

SERIES = [(6,), (6, 1), (6, 1, 1, 1), (6, 3), (6, 3, 1), (6, 2, 1, 1)]


@pytest.mark.parametrize("lid", [glossy, shaded])
@pytest.mark.parametrize("series", SERIES)
def test_every_set_of_targets_gives_the_polynomial(
    series: tuple[int, ...], lid: Callable[[str], EditableObject]
) -> None:
    basis = basis_of(series, lid("lid"))
    source, tiles = random_world(basis)
    start = edited(initial_state(basis.objects), "floor", color=(0.7, 0.0, 0.3))
    ids = [item.id for item in basis.objects]
    for targets in chain.from_iterable(combinations(range(3), n) for n in range(4)):
        renderer = Renderer(freeze(source, targets, start))
        for change in ({}, {"color": (0.0, 0.9, 0.2), "exponent": 300.0}):
            state = edited(start, *(ids[t] for t in targets), **change)
            expected = plain_image(basis, tiles, state, source.width, source.height)
            image = renderer.image(state)
            assert image.dtype == np.float32
            # single precision sums of some thousand positive terms
            np.testing.assert_allclose(image, expected, rtol=2e-5)


def test_albedo_zero_in_a_frozen_object_is_an_ordinary_value() -> None:
    basis = basis_of((6, 1, 1, 1))
    source, tiles = random_world(basis)
    state = edited(initial_state(basis.objects), "floor", "lid", color=(0.0, 0.5, 0.0))
    image = Renderer(freeze(source, (0,), state)).image(state)
    expected = plain_image(basis, tiles, state, source.width, source.height)
    np.testing.assert_allclose(image, expected, rtol=2e-5)


def test_powers_are_few_for_one_target_and_all_tails_for_all() -> None:
    basis = basis_of((6, 1, 1, 1))
    source, _ = random_world(basis)
    state = initial_state(basis.objects)
    assert len(freeze(source, (1,), state).powers.exponents) == 4
    assert len(freeze(source, (0, 1, 2), state).powers.exponents) == basis.tails


def test_a_repeated_frame_is_the_same_and_a_new_state_is_not() -> None:
    basis = basis_of((6, 1))
    source, _ = random_world(basis)
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    first = renderer.image(start)
    changed = renderer.image(edited(start, "box", exponent=3.0))
    np.testing.assert_array_equal(renderer.image(start), first)
    assert not np.array_equal(changed, first)


def test_the_transport_freezes_as_the_function_does() -> None:
    basis = basis_of((6, 1))
    source, _ = random_world(basis)
    state = initial_state(basis.objects)
    transport = BakedTransport(source)
    frozen = transport.freeze((2,), state)
    assert (frozen.width, frozen.height, frozen.targets) == (source.width, source.height, (2,))
    assert frozen.revision == transport.revision == 0


def test_what_cannot_be_frozen_says_why() -> None:
    basis = basis_of((6, 1))
    source, _ = random_world(basis)
    state = initial_state(basis.objects)
    with pytest.raises(InvalidValue, match=r"targets must lie in \[0, 2\]"):
        freeze(source, (3,), state)
    with pytest.raises(TooLarge, match="select fewer objects"):
        freeze(source, (0, 1), state, memory=1000)
    # With nothing left to contract, nothing is made
    freeze(source, (0, 1, 2), state, memory=1000)


def test_layers_switched_off_and_weighted() -> None:
    # A layer that is switched off reflects nothing, now and later along the path
    basis = basis_of((6, 1, 1))
    source, tiles = random_world(basis)
    start = initial_state(basis.objects)
    layers = dict(start["box"].layers)
    layers["specular"] = replace(layers["specular"], enabled=False)
    layers["diffuse"] = LayerState(layers["diffuse"].values, weight=0.5)
    state = {**start, "box": MaterialState(layers)}
    for targets in ((), (0,), (2,)):
        image = Renderer(freeze(source, targets, state)).image(state)
        expected = plain_image(basis, tiles, state, source.width, source.height)
        np.testing.assert_allclose(image, expected, rtol=2e-5)
