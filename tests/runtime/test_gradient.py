"""Gradients against central differences of the plain polynomial, in double precision."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import Basis, initial_state
from tests.runtime.worlds import basis_of, plain_image, random_world, shaded

# Sums of single-precision products against differences of a polynomial of degree 4
CLOSE = {"rtol": 1e-3, "atol": 1e-2}


def moved(basis: Basis, name: str, number: int, channel: int, by: float) -> object:
    """Patch one of the basis's numbers: `name` of the methods that give them."""
    original = getattr(Basis, name)

    def changed(self: Basis, *arguments: object) -> np.ndarray:
        values = original(self, *arguments).copy()
        values[number, channel] += by
        return values

    return patch.object(Basis, name, changed)


@pytest.mark.parametrize("series", [(6, 1, 1), (6, 3, 1)])
def test_gradient_of_albedos_and_coarse_coefficients(series: tuple[int, ...]) -> None:
    basis = basis_of(series, shaded("lid"))
    source, tiles = random_world(basis)
    state = initial_state(basis.objects)
    weight = np.random.default_rng(0).random((source.height, source.width, 3))
    renderer = Renderer(freeze(source, (0, 2), state))
    gradient = renderer.gradient(state, weight.astype(np.float32))

    def loss() -> float:
        return float((plain_image(basis, tiles, state, source.width, source.height) * weight).sum())

    def difference(name: str, number: int, channel: int, step: float = 1e-4) -> float:
        values = []
        for sign in (1, -1):
            with moved(basis, name, number, channel, sign * step):  # type: ignore[attr-defined]
                values.append(loss())
        return (values[0] - values[1]) / (2 * step)

    for own, variable in enumerate(renderer.frozen.powers.variables):
        expected = difference("albedos", int(variable), 1)
        np.testing.assert_allclose(gradient.albedos[own, 1], expected, **CLOSE)
    if basis.coarse:
        for w, (index, _, _) in enumerate(basis.coarse):
            if index != 1:
                expected = difference("coarse_values", w, 2)
                np.testing.assert_allclose(gradient.coarse[w, 2], expected, **CLOSE)


@pytest.mark.parametrize("indirect", [False, True])
def test_gradient_of_column_coefficients(indirect: bool) -> None:
    basis = basis_of((6, 1, 1), shaded("lid"))
    source, tiles = random_world(basis)
    state = initial_state(basis.objects)
    weight = np.random.default_rng(1).random((source.height, source.width, 3))
    renderer = Renderer(freeze(source, (2,), state))
    gradient = renderer.gradient(state, weight.astype(np.float32)).columns[2, indirect]
    original = Basis.column_coefficients
    for column in range(basis.columns(2, indirect)):
        values = []
        for by in (1.0, -1.0):

            def changed(
                self: Basis,
                index: int,
                state: object,
                kind: bool = False,
                by: float = by,
                column: int = column,
            ) -> np.ndarray:
                result = original(self, index, state, kind).copy()  # type: ignore[arg-type]
                if (index, kind) == (2, indirect):
                    result[column, 0] += by
                return result

            with patch.object(Basis, "column_coefficients", changed):
                image = plain_image(basis, tiles, state, source.width, source.height)
                values.append((image * weight).sum())
        np.testing.assert_allclose(gradient[column, 0], (values[0] - values[1]) / 2, **CLOSE)


def test_gradient_of_outgoing_factors_adds_up_to_the_light_they_carry() -> None:
    # The light of a slice is linear in its factor: s · dL/ds sums to what the slice adds
    basis = basis_of((6, 1, 1), shaded("lid"))
    source, _ = random_world(basis)
    state = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (2,), state))
    ones = np.ones((source.height, source.width, 3), np.float32)
    gradient = renderer.gradient(state, ones)
    for part in renderer.frozen.parts:
        if part.slice is None or part.indirect or part.slice.start == 0:
            continue
        factors = basis.outgoing_factors(2, state, part.cos_theta_o.astype(np.float64))
        factor = factors[basis.slices(2).index(part.slice)]
        assert factor is not None
        span = slice(part.slice.start, part.slice.stop)
        coefficients = basis.column_coefficients(2, state)[span]
        through_columns = (gradient.columns[2, False][span] * coefficients).sum()
        through_factors = (gradient.outgoing[2, False, part.slice.start] * factor).sum()
        assert through_factors == pytest.approx(through_columns, rel=1e-4)


def test_the_gradient_must_have_the_image_s_shape() -> None:
    basis = basis_of((6, 1))
    source, _ = random_world(basis)
    state = initial_state(basis.objects)
    with pytest.raises(InvalidValue, match=r"shape \(12, 20, 3\)"):
        Renderer(freeze(source, (0,), state)).gradient(state, np.zeros((3, 3), np.float32))
