"""Two curves: frames of the switched form are those of the whole matrix, whichever is edited."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.ashikhmin_shirley_curves import AshikhminShirleyCurves
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.materials.models.lambert import Lambert
from burnish.materials.two_curves import TwoCurves
from burnish.runtime import switching
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import Basis, EditableObject, initial_state
from burnish.transport.frozen import FoldedPart
from tests.runtime.worlds import edited, matte, plain_image, random_world

COPPER: dict[str, Any] = {"eta": (0.2, 0.924, 1.102), "k": (3.912, 2.452, 2.142)}
MODELS: dict[str, tuple[TwoCurves, dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    # What the layer starts with, and an edit of its first and of its second curve
    "metal": (
        CookTorranceCurves(bins=6, bins2=4),
        {"color": (1.0, 0.5, 0.3), "roughness": 0.4, **COPPER},
        {"roughness": 0.7},
        {"eta": (1.4, 1.2, 0.7)},
    ),
    "brushed": (
        AshikhminShirleyCurves(bins=5, bins2=7),
        {"color": (1.0, 0.5, 0.3), "exponent_u": 20.0, "exponent_v": 4.0},
        {"exponent_u": 2.0},
        {"exponent_v": 50.0},
    ),
}
each_model = pytest.mark.parametrize("name", MODELS)


def world(name: str, series: tuple[int, ...]) -> Basis:
    model, values, _, _ = MODELS[name]
    layers = (
        Layer.starting_at("diffuse", Lambert(), {"color": (0.5, 0.4, 0.2)}),
        Layer.starting_at("specular", model, values),
    )
    states = {
        "diffuse": LayerState({"color": (0.5, 0.4, 0.2)}),
        "specular": LayerState(values),
    }
    item = EditableObject("pot", Material(layers, MaterialState(states)))
    return Basis((item, matte("floor")), series, indirect_bins=2)


@each_model
@pytest.mark.parametrize("series", [(6,), (6, 1, 1), (6, 2, 1)])
def test_frames_are_those_of_the_whole_matrix(name: str, series: tuple[int, ...]) -> None:
    basis = world(name, series)
    source, tiles = random_world(basis)
    _, _, first, second = MODELS[name]
    start = initial_state(basis.objects)
    frozen = freeze(source, (0,), start)
    dense = replace(frozen, parts=[part.dense() for part in frozen.parts])
    drag = [
        start,
        edited(start, "pot", **first),
        edited(start, "pot", **second),
        edited(start, "pot", **first, **second),
        drawn(start, second_curve=Curve((0.0, 1.0), ((2.0, 1.0, 0.0), (0.5, 0.5, 3.0)))),
        start,
    ]
    for renderer in (Renderer(frozen), Renderer(dense)):
        for state in drag:
            expected = plain_image(basis, tiles, state, source.width, source.height)
            # single precision sums of some thousand positive terms
            np.testing.assert_allclose(renderer.image(state), expected, rtol=5e-5)


def drawn(state: dict[str, MaterialState], **changes: Any) -> dict[str, MaterialState]:
    pot = state["pot"]
    layers = {**pot.layers, "specular": replace(pot.layers["specular"], **changes)}
    return {**state, "pot": MaterialState(layers)}


@each_model
def test_a_drag_of_one_curve_switches_once(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = 0
    contracted = switching.contracted

    def counting(*arguments: Any) -> Any:
        nonlocal counted
        counted += 1
        return contracted(*arguments)

    monkeypatch.setattr(switching, "contracted", counting)
    basis = world(name, (6,))
    source, _ = random_world(basis)
    _, _, first, second = MODELS[name]
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    (switch,) = renderer.switches.values()
    renderer.image(start)
    assert (counted, switch.live) == (1, 0)
    # The first curve, and whatever scales the layer: no contraction
    renderer.image(edited(start, "pot", **first))
    renderer.image(edited(start, "pot", **first, color=(0.1, 0.2, 0.3)))
    renderer.image(drawn(start, weight=0.3))
    renderer.image(drawn(start, curve=Curve((0.5,), ((2.0, 2.0, 2.0),))))
    renderer.image(start)
    assert (counted, switch.live) == (1, 0)
    # The second curve: once, and then it drags for nothing
    for scale in (1.0, 0.9, 0.8):
        curve = Curve((0.5,), ((scale, scale, scale),))
        renderer.image(drawn(edited(start, "pot", **second), second_curve=curve))
    assert (counted, switch.live) == (2, 1)
    # And back
    renderer.image(drawn(start, weight=0.3, second_curve=Curve((0.5,), ((2.0, 1.0, 1.0),))))
    assert counted == 3


@each_model
def test_the_switched_form_has_a_vector_per_row(name: str) -> None:
    basis = world(name, (6,))
    source, _ = random_world(basis)
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    model, _, _, second = MODELS[name]
    ((key, switch),) = renderer.switches.items()
    whole = renderer.frozen.parts[key]
    assert isinstance(whole, FoldedPart)
    assert whole.stack.columns == model.rank * model.bins * model.bins2
    for state, columns in ((start, model.bins), (edited(start, "pot", **second), model.bins2)):
        renderer.image(state)
        assert switch._form is not None
        part = switch._form.part
        assert isinstance(part, FoldedPart)
        assert part.stack.columns == model.rank * columns


def test_a_layer_that_is_switched_off_is_dark_and_comes_back() -> None:
    basis = world("metal", (6, 1))
    source, tiles = random_world(basis)
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    for state in (drawn(start, enabled=False), start):
        expected = plain_image(basis, tiles, state, source.width, source.height)
        np.testing.assert_allclose(renderer.image(state), expected, rtol=5e-5)


def test_gradients_of_a_layer_with_two_curves_are_differences() -> None:
    basis = world("metal", (6, 1))
    source, _ = random_world(basis)
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    rng = np.random.default_rng(3)
    upstream = rng.normal(size=(source.height, source.width, 3)).astype(np.float32)
    gradient = renderer.gradient(start, upstream)
    found = (gradient.columns[0, False] * basis.column_coefficients(0, start)).sum(axis=0)
    # Columns are linear: all of them doubled add what they are times their derivatives; the
    # powers, which the albedos make, are left as they were
    frozen = renderer.frozen
    powers = frozen.powers.evaluate(basis, start)
    light = np.zeros((source.height * source.width, 3))
    c = basis.column_coefficients(0, start)
    for part in frozen.parts:
        if part.slice is None or part.indirect:
            continue
        dense = part.dense()
        span = slice(part.slice.start, part.slice.stop)
        weights = np.einsum("ch,nh->hcn", c[span], powers).reshape(3, -1)
        latent = np.einsum("hrc,hc->hr", dense.F, weights).astype(np.float32)
        assert dense.expansion is not None
        rows = dense.expansion.expand(latent).T
        factor = basis.outgoing_factor(0, start, part.slice, part.cos_theta_o.astype(float))
        np.add.at(light, part.pixel, rows if factor is None else rows * factor)
    products = light * upstream.reshape(-1, 3)
    # Single precision, of sums whose terms cancel
    size = np.abs(products).sum(axis=0)
    np.testing.assert_allclose(found / size, products.sum(axis=0) / size, atol=2e-5)
