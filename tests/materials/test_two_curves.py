"""Models with two curves: boxes, outer products, and what an edit of either side is worth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.core.types import Float64
from burnish.materials.coefficients import albedo, coefficients, energies, sides
from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, LayerState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.measured import edited_table, measured_material
from burnish.materials.models.ashikhmin_shirley_curves import AshikhminShirleyCurves
from burnish.materials.models.cook_torrance import CookTorranceConductor
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.materials.reflectance import layer_reflectance
from burnish.materials.registry import (
    layer_from_json,
    layer_state_from_json,
    layer_state_to_json,
    layer_to_json,
)
from burnish.materials.two_curves import TwoCurves
from tests.materials.test_measured import analytic
from tests.materials.test_models import Case, ashikhmin_shirley_2000, directions, product_form

COLOUR = (0.1, 0.5, 1.0)
COPPER: dict[str, Any] = {"eta": (0.2, 0.924, 1.102), "k": (3.912, 2.452, 2.142)}
GOLD: dict[str, Any] = {"eta": (0.143, 0.375, 1.442), "k": (3.983, 2.386, 1.603)}
METAL = Case(CookTorranceCurves(), {"color": COLOUR, "roughness": 0.2, **COPPER})
BRUSHED = Case(AshikhminShirleyCurves(), {"color": COLOUR, "exponent_u": 300.0, "exponent_v": 20.0})
each_case = pytest.mark.parametrize("case", [METAL, BRUSHED], ids=["metal", "brushed"])


def test_a_metal_edited_into_any_other_is_exact() -> None:
    rng = np.random.default_rng(1)
    wi, wo = directions(rng, 5000), directions(rng, 5000)
    for other in (GOLD, {"eta": (1.5, 1.3, 2.4), "k": (0.0, 0.0, 0.0)}):
        edited = Case(METAL.model, {**METAL.values, **other})
        exact = np.stack(edited.model.evaluate(numpy_maths, wi, wo, edited.values))
        np.testing.assert_allclose(product_form(METAL, wi, wo, edited.state), exact, rtol=1e-9)


def test_the_same_metal_as_with_one_curve_and_as_in_mitsuba() -> None:
    mi = pytest.importorskip("mitsuba")
    from burnish.scene.device import activate

    activate()
    rng = np.random.default_rng(2)
    wi, wo = (
        Vector(*(a.astype(np.float32).astype(np.float64) for a in directions(rng, 2000)))
        for _ in range(2)
    )
    values = {**METAL.values, "color": (1.0, 1.0, 1.0)}
    found = np.stack(METAL.model.evaluate(numpy_maths, wi, wo, values))
    other = np.stack(CookTorranceConductor().evaluate(numpy_maths, wi, wo, values))
    np.testing.assert_allclose(found, other, rtol=1e-12)
    channels = {name: {"type": "rgb", "value": list(COPPER[name])} for name in ("eta", "k")}
    bsdf = mi.load_dict({"type": "roughconductor", "alpha": 0.2, "distribution": "ggx", **channels})
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*(a.astype(np.float32) for a in wo))
    light = mi.Vector3f(*(a.astype(np.float32) for a in wi))
    theirs = np.array(bsdf.eval(mi.BSDFContext(), si, light)) / wi.z
    np.testing.assert_allclose(found, theirs, rtol=2e-5, atol=1e-7)


def test_both_exponents_edited_are_the_papers_formula() -> None:
    rng = np.random.default_rng(3)
    wi, wo = directions(rng, 300), directions(rng, 300)
    for nu, nv in ((10.0, 1000.0), (500.0, 500.0), (4000.0, 2.0)):
        edited = LayerState({"color": COLOUR, "exponent_u": nu, "exponent_v": nv})
        found = product_form(BRUSHED, wi, wo, edited)
        for channel, f0 in enumerate(COLOUR):
            paper = ashikhmin_shirley_2000(wi, wo, nu, nv, f0)
            np.testing.assert_allclose(found[channel], paper, rtol=1e-6, atol=1e-12)


@each_case
def test_the_coordinate_is_the_number_of_the_box(case: Case) -> None:
    rng = np.random.default_rng(4)
    wi, wo = directions(rng, 5000), directions(rng, 5000)
    model = case.model
    assert isinstance(model, TwoCurves)
    t = model.coordinates(numpy_maths, wi, wo, case.layer.fixed)
    j, k = (
        np.clip(np.searchsorted(axis.edges, x, side="right") - 1, 0, axis.bins - 1)
        for axis, x in zip(model.axes, t, strict=True)
    )
    box = model.coordinate(numpy_maths, wi, wo, case.layer.fixed) * model.boxes
    np.testing.assert_allclose(box, j * model.bins2 + k + 0.5)


@each_case
def test_coefficients_are_outer_products_with_the_weight_once(case: Case) -> None:
    state = replace(case.state, weight=0.25)
    first, second = sides(case.layer, state)
    expected = np.einsum("kjh,klh->kjlh", first, second).reshape(-1, 3)
    np.testing.assert_array_equal(coefficients(case.layer, state), expected)
    np.testing.assert_allclose(coefficients(case.layer, case.state), 4 * expected, atol=1e-99)
    off = replace(state, enabled=False)
    assert not coefficients(case.layer, off).any()
    assert not albedo(case.layer, off).any()


def test_boxes_hold_the_energy_of_the_bins() -> None:
    # With F = 1 the quotients of one curve over θh are those of two curves
    values = {**METAL.values, "eta": (0.0, 0.0, 0.0), "k": (1.0, 1.0, 1.0)}
    one = Layer.starting_at("one", CookTorranceConductor(fresnel_terms=1), values, bins=128)
    _, _, bins = energies(one)
    _, weight, boxes = energies(METAL.layer)
    by_bin = boxes.reshape(*boxes.shape[:2], 128, -1).sum(axis=3)
    np.testing.assert_allclose(
        np.tensordot(weight, by_bin, axes=1), np.tensordot(weight, bins, axes=1), rtol=2e-3
    )


@each_case
def test_the_binned_form_approaches_the_model(case: Case) -> None:
    rng = np.random.default_rng(5)
    wi, wo = directions(rng, 20_000, 0.2), directions(rng, 20_000, 0.2)
    errors = []
    for bins in (16, 32, 64):
        model = case.model.with_bins(bins, bins)  # type: ignore[attr-defined]
        layer = Layer.starting_at("layer", model, case.values)
        errors.append(_binned_error(layer, case.state, wi, wo))
    # Piecewise constants: halving the bins halves the error
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2.0, rtol=0.15)
    assert errors[-1] < 0.1


def _binned_error(layer: Layer, state: LayerState, wi: Vector, wo: Vector) -> float:
    model = layer.model
    true = np.stack(model.evaluate(numpy_maths, wi, wo, {**layer.fixed, **state.values}))
    box = (model.coordinate(numpy_maths, wi, wo, layer.fixed) * layer.bins).astype(int)
    c = coefficients(layer, state).reshape(model.rank, layer.bins, 3)[:, box]
    q = np.stack(model.quotients(numpy_maths, wi, wo, layer.fixed))
    binned = np.einsum("kn,knh->hn", q, c)
    return float(np.linalg.norm(binned - true) / np.linalg.norm(true))


@each_case
def test_freehand_curves_of_either_side_multiply(case: Case) -> None:
    rng = np.random.default_rng(6)
    wi, wo = directions(rng, 1000), directions(rng, 1000)
    ramp = Curve((0.0, 1.0), ((0.5, 1.0, 2.0), (1.5, 1.0, 0.0)), interpolation="linear")
    plain = layer_reflectance(case.layer, case.state, wi, wo)
    t = case.model.coordinates(numpy_maths, wi, wo, case.layer.fixed)  # type: ignore[attr-defined]
    gains: list[Float64] = [ramp.evaluate(np.asarray(x)).T for x in t]
    for drawn, gain in (
        (replace(case.state, curve=ramp), gains[0]),
        (replace(case.state, second_curve=ramp), gains[1]),
        (replace(case.state, curve=ramp, second_curve=ramp), gains[0] * gains[1]),
    ):
        found = layer_reflectance(case.layer, drawn, wi, wo)
        np.testing.assert_allclose(found, plain * gain, rtol=1e-6, atol=1e-12)
    # A constant drawn in the second curve's place makes its parameters idle
    flat = Curve((0.0,), ((0.5, 0.5, 0.5),), "replace")
    state = replace(case.state, second_curve=flat)
    np.testing.assert_allclose(sides(case.layer, state)[1], 0.5)


@each_case
def test_layers_and_states_as_json(case: Case) -> None:
    layer = case.layer.with_bins(16)
    assert layer.bins == 16 * layer.model.bins2  # type: ignore[attr-defined]
    assert layer_from_json(layer_to_json(layer)) == layer
    drawn = replace(case.state, second_curve=Curve((0.5,), ((1.0, 2.0, 3.0),)))
    assert layer_state_from_json(layer_state_to_json(drawn)) == drawn


def test_coarser_layers_halve_the_longer_side() -> None:
    layer = Layer.starting_at("metal", CookTorranceCurves(bins=16, bins2=32), METAL.values)
    halved = layer.coarser()
    assert (halved.model.bins, halved.model.bins2) == (16, 16)  # type: ignore[attr-defined]
    quartered = halved.coarser()
    assert (quartered.model.bins, quartered.model.bins2) == (8, 16)  # type: ignore[attr-defined]
    assert quartered.bins == 128


def test_many_bins_leave_room_for_the_other_curve() -> None:
    metal, brushed = METAL.layer.with_bins(256), BRUSHED.layer.with_bins(256)
    assert (metal.model.bins, metal.model.bins2) == (256, 32)  # type: ignore[attr-defined]
    assert (brushed.model.bins, brushed.model.bins2) == (128, 128)  # type: ignore[attr-defined]


def test_bins_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InvalidValue, match="65536 boxes together; got 512 × 256"):
        CookTorranceCurves(bins=512, bins2=256)
    with pytest.raises(InvalidValue, match="those of both curves, 4096"):
        Layer("metal", CookTorranceCurves(), bins=64)


@pytest.mark.parametrize("form", ["half-difference", "homomorphic"])
def test_measured_data_with_both_factors_as_curves(form: Any) -> None:
    table = analytic()
    material = measured_material(table, form, "both", bins=32)
    layer = material.layers[-1]
    model = layer.model
    assert isinstance(model, TwoCurves)
    assert (model.bins, model.bins2) == (32, 24)
    # Unedited the measured table, to the bit
    assert np.array_equal(edited_table(material, material.initial).raw, table.raw)
    # Both curves doubled: the term four times, the rest of the material as it was
    double = Curve((0.0,), ((2.0, 2.0, 2.0),))
    state = replace(material.initial.layers[layer.name], curve=double, second_curve=double)
    edited = replace(material.initial, layers={**material.initial.layers, layer.name: state})
    wi, wo = (
        Vector(*(np.broadcast_to(a, table.valid.shape) for a in w)) for w in table.directions()
    )
    lit = (wi.z > 0) & (wo.z > 0)
    up = [Vector(*(a[lit] for a in w)) for w in (wi, wo)]
    share = np.stack(model.share(numpy_maths, *up))  # type: ignore[attr-defined]
    found = edited_table(material, edited).raw[:, lit]
    np.testing.assert_allclose(found, table.raw[:, lit] * (1 + 3 * share), rtol=1e-9)
