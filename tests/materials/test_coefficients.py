"""Bins, coarse bins and expansions: what stands for a material keeps its energy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.materials.coefficients import (
    albedo,
    coarse_coefficients,
    coarse_energies,
    coefficients,
    conserved,
    directional_albedo,
    energies,
    outgoing,
)
from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, LayerState, Link, Material, MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance import (
    CookTorrance,
    CookTorranceConductor,
    CookTorranceDielectric,
)
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.plastic_base import PlasticBase

WHITE = (1.0, 1.0, 1.0)
GLOSS: dict[str, Any] = {"color": WHITE, "roughness": 0.15, "ior": 1.5}


def gloss(alpha: float = 0.15, **options: Any) -> tuple[Layer, LayerState]:
    values = {**GLOSS, "roughness": alpha}
    layer = Layer.starting_at("specular", CookTorranceDielectric("ggx"), values, **options)
    return layer, LayerState(values)


def test_lambert_is_exact() -> None:
    colour = (0.2, 0.0, 1.0)
    layer = Layer.starting_at("diffuse", Lambert(), {"color": colour})
    state = LayerState({"color": colour})
    np.testing.assert_allclose(albedo(layer, state), colour, rtol=1e-13, atol=0)
    np.testing.assert_allclose(coarse_energies(layer, 1), [np.pi], rtol=1e-13)
    np.testing.assert_allclose(coefficients(layer, state), [colour], rtol=1e-13)


@pytest.mark.parametrize("count", [1, 2, 7, 8, 64])
@pytest.mark.parametrize("alpha", [0.0, 0.02, 0.4])
def test_albedo_is_the_same_from_all_numbers_of_bins(alpha: float, count: int) -> None:
    layer, _ = gloss(0.3, delta=True)
    state = LayerState({**GLOSS, "roughness": alpha}, weight=0.7)
    coarse = coarse_coefficients(layer, state, count)
    d = coarse_energies(layer, count) @ coarse / np.pi
    np.testing.assert_allclose(d, albedo(layer, state), rtol=1e-12)


@pytest.mark.parametrize("alpha", [0.002, 0.02, 0.2])
def test_albedo_hardly_depends_on_the_bins(alpha: float) -> None:
    """Energy-weighted averages: eight equal bins keep the energy of a very narrow lobe."""
    reference = albedo(*gloss(alpha, bins=512))
    for bins, spacing in ((8, 1.0), (16, 2.0), (64, 2.0)):
        np.testing.assert_allclose(
            albedo(*gloss(alpha, bins=bins, spacing=spacing)), reference, rtol=2e-3
        )


def test_coarse_bins_hold_nothing_when_disabled() -> None:
    layer, state = gloss()
    off = replace(state, enabled=False)
    assert not coefficients(layer, off).any()
    assert not coarse_coefficients(layer, off, 8).any()
    assert not albedo(layer, off).any()


def test_too_many_coarse_bins_are_refused() -> None:
    layer, state = gloss(bins=8)
    with pytest.raises(InvalidValue, match=r"coarse bins must lie in \[1, 8\]; got 9"):
        coarse_coefficients(layer, state, 9)


def test_binned_form_approaches_the_model() -> None:
    rng = np.random.default_rng(1)
    z = rng.uniform(0.2, 1, (2, 20_000))
    phi = rng.uniform(0, 2 * np.pi, (2, 20_000))
    wi, wo = (
        Vector(np.sqrt(1 - a * a) * np.cos(p), np.sqrt(1 - a * a) * np.sin(p), a)
        for a, p in zip(z, phi, strict=True)
    )
    errors = []
    for bins in (16, 32, 64, 128):
        layer, state = gloss(0.3, bins=bins)
        model = layer.model
        true = model.evaluate(numpy_maths, wi, wo, {**layer.fixed, **state.values})[0]
        t = model.coordinate(numpy_maths, wi, wo, layer.fixed)
        j = np.clip(np.searchsorted(layer.edges, t, side="right") - 1, 0, bins - 1)
        c = coefficients(layer, state).reshape(model.rank, bins, 3)[:, j, 0]
        q = np.stack(model.quotients(numpy_maths, wi, wo, layer.fixed))
        errors.append(np.sqrt(np.mean(((q * c).sum(0) - true) ** 2) / np.mean(true**2)))
    # Piecewise constants: halving the bins halves the error
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2.0, rtol=0.1)
    assert errors[-1] < 0.02


METAL: dict[str, Any] = {
    "color": WHITE,
    "eta": (1.657, 0.88, 0.521),
    "k": (9.224, 6.27, 4.837),
}


@pytest.mark.parametrize("distribution", ["ggx", "beckmann"])
@pytest.mark.parametrize("first", [0.0, 0.05, 0.1, 0.3, 0.6])
def test_masking_expansion(distribution: Any, first: float) -> None:
    """Worst error of the directional albedo, up to 80°, when α is edited over [0.05, 0.6]."""
    errors = {}
    for terms in (1, 2, 3):
        model = CookTorranceConductor(distribution, terms)
        values = {**METAL, "roughness": first}
        layer = Layer.starting_at("specular", model, values, delta=first == 0)
        worst = 0.0
        for alpha in (0.05, 0.1, 0.2, 0.3, 0.45, 0.6):
            state = LayerState({**values, "roughness": alpha})
            exact = Layer.starting_at("specular", model, state.values)
            cos, found = directional_albedo(layer, state)
            _, true = directional_albedo(exact, state)
            worst = max(worst, np.abs(found / true - 1)[cos > np.cos(np.radians(80))].max())
        errors[terms] = worst
    assert errors[2] <= 0.025
    assert errors[3] <= 0.009
    assert errors[1] > errors[2] > errors[3]


@pytest.mark.parametrize("ior", [1.33, 1.8, 2.2])
def test_dielectric_expansion(ior: float) -> None:
    """An ior edited away from 1.5: the albedo with two Fresnel terms, and with three."""
    for terms, limit in ((2, 0.06), (3, 0.01)):
        model = CookTorranceDielectric("ggx", 2, terms)
        layer = Layer.starting_at("specular", model, GLOSS)
        state = LayerState({**GLOSS, "ior": ior})
        exact = Layer.starting_at("specular", model, state.values)
        np.testing.assert_allclose(albedo(layer, state), albedo(exact, state), rtol=limit)


def test_conductor_expansion() -> None:
    """Aluminium edited into gold, per channel."""
    gold = {"color": WHITE, "eta": (0.143, 0.375, 1.442), "k": (3.983, 2.386, 1.603)}
    model = CookTorranceConductor("ggx")
    layer = Layer.starting_at("specular", model, {**METAL, "roughness": 0.2})
    state = LayerState({**gold, "roughness": 0.2})
    exact = Layer.starting_at("specular", model, state.values)
    np.testing.assert_allclose(albedo(layer, state), albedo(exact, state), rtol=0.02)


@pytest.mark.parametrize(("alpha", "ior"), [(0.0, 1.5), (0.3, 1.5), (0.6, 1.3), (0.1, 2.0)])
def test_plastic_base_expansion(alpha: float, ior: float) -> None:
    start = {"color": (0.5, 0.5, 0.5), "roughness": 0.1, "ior": 1.5}
    layer = Layer.starting_at("diffuse", PlasticBase("ggx"), start)
    state = LayerState({**start, "roughness": alpha, "ior": ior})
    exact = Layer.starting_at("diffuse", PlasticBase("ggx"), state.values)
    np.testing.assert_allclose(albedo(layer, state), albedo(exact, state), rtol=1e-3)
    cos, found = directional_albedo(layer, state)
    _, true = directional_albedo(exact, state)
    # T(θo) is exact at run time, so only the energy that enters matters here
    np.testing.assert_allclose(found[cos > 0.1], true[cos > 0.1], rtol=3e-3)


def test_delta_column_carries_a_smooth_lobe() -> None:
    layer, _ = gloss(0.0, delta=True)
    smooth = LayerState({**GLOSS, "roughness": 0.0}, weight=0.5)
    c = coefficients(layer, smooth)
    assert not c[:-1].any()
    np.testing.assert_allclose(c[-1], 0.5)
    fresnel = outgoing(layer, smooth, np.array([1.0]), delta=True)
    np.testing.assert_allclose(fresnel, 0.04, rtol=1e-12)
    rough = LayerState({**GLOSS, "roughness": 0.05})
    assert not coefficients(layer, rough)[-1].any()
    # A hardly rough lobe reflects what the mirror did
    faint = LayerState({**GLOSS, "roughness": 0.002})
    np.testing.assert_allclose(albedo(layer, faint), 2 * albedo(layer, smooth), rtol=2e-3)


def test_roughness_stops_short_of_smooth_without_a_delta_column() -> None:
    assert gloss()[0].parameter("roughness").minimum == pytest.approx(1e-3)
    assert gloss(0.0, delta=True)[0].parameter("roughness").minimum == 0.0


def test_energies_add_up() -> None:
    layer, state = gloss()
    _, weight, directional = energies(layer)
    assert weight.sum() == pytest.approx(1, abs=1e-12)
    e = np.pi * np.tensordot(weight, directional, axes=1)
    np.testing.assert_allclose(e[0], coarse_energies(layer, layer.bins), rtol=1e-12)
    c = coefficients(layer, state).reshape(layer.model.rank, layer.bins, 3)
    np.testing.assert_allclose(np.einsum("kj,kjh->h", e, c) / np.pi, albedo(layer, state))


def two_layers() -> Material:
    values = {"color": (0.9, 0.5, 0.1)}
    gloss_values = {"color": WHITE, "exponent": 20.0}
    return Material(
        (
            Layer.starting_at("diffuse", Lambert(), values),
            Layer.starting_at("specular", BlinnPhong(), gloss_values),
        ),
        MaterialState({"diffuse": LayerState(values), "specular": LayerState(gloss_values)}),
    )


def total(material: Material, state: MaterialState) -> np.ndarray:
    settled = conserved(material, state)
    return sum(albedo(layer, settled.layers[layer.name]) for layer in material.layers)


def test_conserve_keeps_the_sum_at_one() -> None:
    material = two_layers()
    free = material.initial
    assert total(material, free).max() > 1
    linked = replace(free, conserve=True)
    assert total(material, linked).max() == pytest.approx(1.0, rel=1e-12)
    # Raising one layer takes from the other
    diffuse = conserved(material, linked).layers["diffuse"].weight
    more = replace(free.layers["specular"], weight=3.0)
    raised = replace(linked, layers={**linked.layers, "specular": more})
    assert conserved(material, raised).layers["diffuse"].weight < diffuse
    assert total(material, raised).max() == pytest.approx(1.0, rel=1e-12)


def test_conserve_leaves_what_already_conserves() -> None:
    material = two_layers()
    dim = {n: replace(layer, weight=0.2) for n, layer in material.initial.layers.items()}
    state = MaterialState(dim, conserve=True)
    assert conserved(material, state) == state


def test_linked_parameters_follow_their_source() -> None:
    base = Layer.starting_at("diffuse", PlasticBase(), {"color": WHITE, **GLOSS})
    coat = Layer.starting_at("specular", CookTorranceDielectric(), GLOSS)
    links = tuple(Link("diffuse", name, "specular", name) for name in ("roughness", "ior"))
    state = MaterialState(
        {"diffuse": LayerState({"color": WHITE}), "specular": LayerState({**GLOSS, "ior": 1.7})}
    )
    material = Material((base, coat), state, links)
    assert [p.name for p in material.parameters("diffuse")] == ["color"]
    settled = conserved(material, state).layers["diffuse"].values
    assert settled == {"color": WHITE, "roughness": 0.15, "ior": 1.7}


def test_curve_shapes_the_coefficients() -> None:
    layer, state = gloss()
    plain = coefficients(layer, state)
    doubled = replace(state, curve=Curve((0.0, 1.0), ((2.0, 0.0, 1.0),) * 2))
    np.testing.assert_allclose(coefficients(layer, doubled), plain * [2.0, 0.0, 1.0])
    flat = replace(state, curve=Curve((0.5,), ((3.0, 3.0, 3.0),), mode="replace"))
    amplitudes = layer.model.amplitudes(state.values, layer.fixed)
    expected = np.repeat(3.0 * amplitudes, layer.bins, axis=0)
    np.testing.assert_allclose(coefficients(layer, flat), expected)


def test_directional_albedo_of_blinn_phong_is_its_colour_at_normal_incidence() -> None:
    values = {"color": (0.3, 0.6, 1.0), "exponent": 40.0}
    layer = Layer.starting_at("specular", BlinnPhong(), values, bins=256)
    cos, directional = directional_albedo(layer, LayerState(values))
    # The last node lies at 0.998; the albedo there is within its slope of the colour
    assert cos[-1] > 0.99
    np.testing.assert_allclose(directional[-1], values["color"], rtol=1e-2)


def test_reference_quotient_alone_conserves_energy() -> None:
    """A furnace for the second encounter: white F0 = 1 keeps what the true lobe keeps."""
    values = {"color": WHITE, "roughness": 0.4}
    layer = Layer.starting_at("specular", CookTorrance("ggx"), values)
    state = LayerState(values)
    coarse = coarse_coefficients(layer, state, 8)
    assert (coarse >= 0).all()
    d = coarse_energies(layer, 8) @ coarse / np.pi
    np.testing.assert_allclose(d, albedo(layer, state), rtol=1e-12)
