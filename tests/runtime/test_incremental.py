"""Incremental products: the paper's didactic session, a freehand session, and exact ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.core.types import Float64
from burnish.materials.coefficients import coefficients, energies
from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, LayerState
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.runtime.freeze import freeze
from burnish.runtime.incremental import (
    Columns,
    Incremental,
    IncrementalPart,
    IncrementalStack,
    largest,
)
from burnish.transport.basis import initial_state
from burnish.transport.contraction import contract
from burnish.transport.frozen import FoldedPart
from tests.runtime.worlds import basis_of, glossy, random_world


def test_the_didactic_session() -> None:
    # 2006, table 2: a pixel, three boxes, one multiplication per frame; a curve with geometric
    # decay is loaded, its centre amplified, and all but its left part shifted down by one
    T = np.array([0.5, 0.5, 1.0])
    frames = [np.array(curve) for curve in ([4.0, 2.0, 1.0], [4.0, 3.0, 1.0], [4.0, 2.0, 0.0])]
    product = Incremental(T.astype(np.float32)[None, None, :, None], np.ones((1, 3)))
    effective = [[4.0, 0.0, 0.0], [4.0, 3.0, 0.0], [4.0, 2.0, 0.0]]
    errors, plain_errors, reached = [], [], []
    for curve, expected in zip(frames, effective, strict=True):
        reached.append(product.closer(curve[None], budget=1))
        np.testing.assert_array_equal(product.effective[0], expected)
        assert product.value.item() == T @ expected
        errors.append(abs(product.value.item() - T @ curve))
        # The plain approximation spends its one term on the largest coefficient, ever again
        assert largest(curve, 1).tolist() == [0]
        plain_errors.append(abs(T[0] * curve[0] - T @ curve))
    assert errors == [2.0, 1.0, 0.0]
    assert plain_errors == [2.0, 2.5, 1.0]
    assert reached == [False, False, True]


LAYER = Layer("specular", BlinnPhong(), bins=256)


def freehand_session() -> list[Float64]:
    """The coefficients of a highlight whose curve someone draws on, frame by frame.

    The mouse goes along the curve from right to left and back, up and down, and takes with it
    the control points that it passes.
    """
    t = np.linspace(0.0, 1.0, 24) ** 1.5
    gain, session = np.ones((24, 3)), []
    shiny = {"color": (0.7, 0.7, 0.7), "exponent": 300.0}
    for frame in range(80):
        u = frame / 79
        near = np.exp(-(((t - abs(1 - 1.9 * u)) / 0.08) ** 2))[:, None]
        height = np.array([1.0, 0.8, 0.4]) * (1.5 + np.sin(7 * u)) * 2
        gain = gain + near * 0.5 * (height - gain)
        drawn = Curve(tuple(t.tolist()), tuple(map(tuple, gain.tolist())))
        session.append(coefficients(LAYER, LayerState(shiny, drawn))[:, 0])
    return session


def random_light(rng: np.random.Generator, pixels: int, bins: int) -> Float64:
    """Transport like that of a view: most of a pixel's light lies in the bins of some lamps, and
    a bin's light grows with the energy that it carries."""
    position = rng.random((pixels, 6)) * bins
    strength = rng.random((pixels, 6)) ** 4
    box = np.arange(bins)
    near = np.exp(-(((box - position[..., None]) / (2 + 10 * rng.random((pixels, 6, 1)))) ** 2))
    _, weight, directional = energies(LAYER)
    energy = weight @ directional[:, 0]
    return (np.einsum("pl,plb->pb", strength, near) + 0.05 * rng.random((pixels, bins))) * energy


def test_thirty_terms_follow_a_freehand_session_and_plain_ones_do_not() -> None:
    rng = np.random.default_rng(5)
    T = random_light(rng, 300, 256)
    columns = Columns(1, 256)
    terms = columns.of_transport(T.T.astype(np.float32))
    product = Incremental(terms[None, None])
    session = freehand_session()
    first = columns.of_curve(session[0])
    product.settle(first[None], (T @ session[0])[None].astype(np.float32))
    errors, plain_errors = [], []
    for curve in session:
        exact, perfect = T @ curve, columns.of_curve(curve)
        product.closer(perfect[None], budget=30)
        errors.append(_distance(product.value.ravel(), exact))
        chosen = largest(perfect * product.importance[0], 30)
        plain_errors.append(_distance(terms[chosen].T @ perfect[chosen], exact))
    assert np.median(errors) <= 1e-3
    # Figure 5: most of the plain budget goes to the peak, which no one touches
    assert np.median(plain_errors) > 5 * np.median(errors)
    # The last edit is exact within ten frames
    for _ in range(10):
        if product.closer(columns.of_curve(session[-1])[None], budget=30):
            break
    else:
        pytest.fail("not exact ten frames after the last edit")
    # Sums of 256 products in single precision, and as many small updates
    assert _distance(product.value.ravel(), T @ session[-1]) < 1e-5


def test_whatever_changes_is_exact_after_as_many_frames_as_the_terms_need() -> None:
    rng = np.random.default_rng(2)
    T = rng.normal(size=(3, 2, 100, 7)).astype(np.float32)
    product = Incremental(T)
    perfect = rng.normal(size=(3, 100))
    reached = [product.closer(perfect, budget=30) for _ in range(4)]
    assert reached == [False, False, False, True]
    expected = np.einsum("hcte,ht->hce", T.astype(np.float64), perfect)
    np.testing.assert_allclose(product.value, expected, atol=1e-4)
    assert product.closer(perfect, budget=0)


def test_a_budget_goes_to_the_largest_changes() -> None:
    change = np.array([0.1, -5.0, 3.0, 0.0, -4.0])
    np.testing.assert_array_equal(largest(change, 2), [1, 4])
    np.testing.assert_array_equal(largest(change, 9), [0, 1, 2, 4])
    np.testing.assert_array_equal(largest(change, 9, negligible=1.0), [1, 2, 4])
    assert len(largest(change, 0)) == 0


def _distance(image: Float64, exact: Float64) -> float:
    return float(np.linalg.norm(image - exact) / np.linalg.norm(exact))


@pytest.mark.parametrize("bins", [6, 16, 40])
def test_stacks_and_dense_parts_reach_the_plain_product(bins: int) -> None:
    basis = replace(basis_of((6, 1, 1)), objects=(glossy("box", bins), glossy("lid", 4)))
    source, _ = random_world(basis)
    state = initial_state(basis.objects)
    frozen = freeze(source, (0,), state)
    powers = frozen.powers.evaluate(basis, state)
    parts = [p for p in frozen.parts if isinstance(p, FoldedPart) and not p.indirect]
    assert parts
    for part in parts:
        weights = basis.column_coefficients(0, state)[part.slice.start : part.slice.stop]
        own = Columns(1, len(weights))
        stack = IncrementalStack(part.stack, own)
        stack.settle(weights * 0.5)
        for _ in range(own.terms):
            (cells, peak), reached = stack.contracted(weights, budget=1)
        assert reached
        ((expected, factor),) = contract([part.stack], [weights])
        for h in range(3):
            found = cells[h][: len(expected[h])] * peak[h]
            np.testing.assert_allclose(found, expected[h] * factor[h], rtol=1e-4, atol=1e-5)

        dense = part.dense()
        assert dense.F.shape[2] == len(weights) * len(powers)
        numbers = np.einsum("ch,nh->hcn", weights, powers).reshape(3, -1)
        drawn = IncrementalPart(dense, Columns(1, len(weights), len(powers)))
        light, reached = drawn.light(numbers, budget=dense.F.shape[2] * 2)
        assert reached
        latent = np.einsum("hrc,hc->hr", dense.F.astype(np.float64), numbers)
        assert dense.expansion is not None
        exact = dense.expansion.expand(latent.astype(np.float32))
        np.testing.assert_allclose(light, exact, rtol=1e-3, atol=1e-4 * np.abs(exact).max())
