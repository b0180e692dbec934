"""Light groups, stored and frozen: the plain sum over groups, whatever is symbolic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.materials.lights import LightGroup, LightState
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import Basis, State, initial_state
from tests.runtime.worlds import basis_of, edited, plain_image, random_world, shaded

GROUPS = (LightGroup("key", ("lamp", "spot")), LightGroup("sky", ("sky",)))
SERIES = ((6, 1, 1), (6, 2, 1))


def lit_basis(series: tuple[int, ...]) -> Basis:
    return replace(basis_of(series, shaded("lid")), lights=GROUPS)


def under(state: State, **lights: LightState) -> State:
    return {**state, **{f"light:{name}": light for name, light in lights.items()}}


MIXES = {
    "as it is": {},
    "tinted": {
        "key": LightState(intensity=2.5, tint=(1.0, 0.4, 0.1)),
        "sky": LightState(intensity=0.25),
    },
    "muted": {"key": LightState(on=False)},
    "solo": {"key": LightState(solo=True, intensity=3.0)},
    "dark": {"key": LightState(on=False), "sky": LightState(intensity=0.0)},
}


@pytest.mark.parametrize("name", MIXES)
@pytest.mark.parametrize("series", SERIES)
@pytest.mark.parametrize("targets", [(), (0,), (1, 2)])
def test_every_set_of_targets_gives_the_mixed_polynomial(
    name: str, series: tuple[int, ...], targets: tuple[int, ...]
) -> None:
    basis = lit_basis(series)
    source, tiles = random_world(basis)
    state = under(initial_state(basis.objects), **MIXES[name])
    renderer = Renderer(freeze(source, targets, state))
    ids = [basis.objects[i].id for i in targets]
    for now in (state, edited(state, *ids, color=(0.0, 0.7, 0.2), exponent=60.0)):
        now = {**now, **{key: light for key, light in state.items() if key.startswith("light:")}}
        expected = plain_image(basis, tiles, now, source.width, source.height)
        np.testing.assert_allclose(renderer.image(now), expected, rtol=3e-5, atol=1e-12)


@pytest.mark.parametrize("series", SERIES)
def test_with_nothing_else_symbolic_the_mix_is_mixed_per_frame(series: tuple[int, ...]) -> None:
    basis = lit_basis(series)
    source, tiles = random_world(basis)
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (), start))
    total = np.zeros((source.height, source.width, 3))
    for name in ("key", "sky"):
        total += renderer.image(under(start, **{name: LightState(solo=True)}))
    np.testing.assert_allclose(total, renderer.image(start), rtol=1e-5)
    for lights in MIXES.values():
        state = under(start, **lights)
        expected = plain_image(basis, tiles, state, source.width, source.height)
        np.testing.assert_allclose(renderer.image(state), expected, rtol=3e-5, atol=1e-12)
    assert not renderer.image(under(start, **MIXES["dark"])).any()


def test_what_is_frozen_for_an_object_is_no_larger_for_the_groups() -> None:
    plain = basis_of((6, 1, 1))
    grouped = replace(plain, lights=GROUPS)
    sizes = []
    for basis in (plain, grouped):
        source, _ = random_world(basis)
        frozen = freeze(source, (0,), initial_state(basis.objects))
        sizes.append(len(frozen.powers.coarse))
    assert sizes[0] == sizes[1]
