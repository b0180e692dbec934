"""Another model in a layer's place: what is seen carries over, and every step goes back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from burnish.core.errors import UnknownName
from burnish.materials.coefficients import albedo, coefficients, conserved
from burnish.materials.curve import Curve
from burnish.materials.fresnel import METALS, complex_reflectance, ior_of, normal_reflectance
from burnish.materials.images import ImageMap, Texels
from burnish.materials.layer import Layer, LayerState, Link, Material, MaterialState
from burnish.materials.maths import numpy_maths
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance import CookTorranceConductor, CookTorranceDielectric
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.optics import fresnel_conductor
from burnish.materials.models.plastic_base import PlasticBase
from burnish.materials.registry import MODELS
from burnish.materials.replacement import choices, replaced

BINS = 16


def glossy() -> Material:
    layers = (Layer("diffuse", Lambert(), bins=1), Layer("specular", BlinnPhong(), bins=BINS))
    state = {
        "diffuse": LayerState({"color": (0.5, 0.4, 0.3)}),
        "specular": LayerState({"color": (0.1, 0.2, 0.3), "exponent": 80.0}, weight=0.5),
    }
    return Material(layers, MaterialState(state))


def coated() -> Material:
    """A base whose ior and roughness are its coat's, as Mitsuba's `roughplastic` has it."""
    coat, base = CookTorranceDielectric(), PlasticBase()
    values = {"color": (1.0, 1.0, 1.0), "roughness": 0.2, "ior": 1.7}
    layers = (
        Layer.starting_at("diffuse", base, {**values, "color": (0.5, 0.5, 0.5)}),
        Layer.starting_at("specular", coat, values, bins=BINS),
    )
    state = {
        "diffuse": LayerState({"color": (0.5, 0.5, 0.5)}),
        "specular": LayerState(values),
    }
    links = tuple(Link("diffuse", name, "specular", name) for name in ("roughness", "ior"))
    return Material(layers, MaterialState(state), links)


def test_every_choice_can_take_the_place_of_every_other() -> None:
    material = glossy()
    state = material.initial
    for name in choices():
        state = replaced(material, state, "specular", name, BINS)
        now = material.as_in(state)
        layer = now.layer("specular")
        assert layer.model.name == name
        assert layer.name == "specular"
        assert state.layers["specular"].weight == 0.5
        assert {item.name for item in layer.parameters} == state.layers["specular"].values.keys()
        for item in layer.parameters:
            item.validate(state.layers["specular"].values[item.name])
        numbers = coefficients(layer, conserved(now, state).layers["specular"])
        assert np.isfinite(numbers).all()
        assert np.isfinite(albedo(layer, state.layers["specular"])).all()
        assert now.initial.layers["specular"].values == state.layers["specular"].values


def test_the_scenes_own_model_comes_back_as_it_was() -> None:
    material = glossy()
    there = replaced(material, material.initial, "specular", "ward-width", BINS)
    assert there != material.initial
    assert replaced(material, there, "specular", "blinn-phong", BINS) == material.initial
    assert replaced(material, there, "specular", "ward-width", BINS) is there
    assert material.as_in(material.initial) is material


def test_the_width_of_the_lobe_carries_over() -> None:
    material = glossy()
    alpha = math.sqrt(2 / 82)
    state = replaced(material, material.initial, "specular", "cook-torrance", BINS)
    assert state.layers["specular"].values["roughness"] == pytest.approx(alpha)
    state = replaced(material, state, "specular", "schlick", BINS)
    assert state.layers["specular"].values["roughness"] == pytest.approx(alpha**2)
    state = replaced(material, state, "specular", "ashikhmin-shirley-width", BINS)
    assert state.layers["specular"].values["exponent"] == pytest.approx(80.0)
    # Frozen where the model edits something else
    state = replaced(material, state, "specular", "ward-ratio", BINS)
    layer = material.as_in(state).layer("specular")
    assert layer.fixed["roughness"] == pytest.approx(alpha)
    state = replaced(material, state, "specular", "ward-width", BINS)
    assert state.layers["specular"].values["roughness"] == pytest.approx(alpha)


def test_the_reflectance_at_normal_incidence_carries_over() -> None:
    material = coated()
    state = replaced(material, material.initial, "specular", "cook-torrance", BINS)
    expected = (0.7 / 2.7) ** 2
    assert state.layers["specular"].values["color"] == pytest.approx((expected,) * 3)
    state = replaced(material, state, "specular", "cook-torrance-conductor", BINS)
    model, values = CookTorranceConductor(), state.layers["specular"].values
    assert normal_reflectance(model, values) == pytest.approx((expected,) * 3)
    assert ior_of(expected) == pytest.approx(1.7)


def test_a_linked_layer_keeps_what_the_old_model_told_it() -> None:
    material = coated()
    state = replaced(material, material.initial, "specular", "ward-width", BINS)
    now = material.as_in(state)
    assert now.linked(state).layers["diffuse"].values["ior"] == 1.7
    # The new model has a roughness too, and the link follows it
    assert now.linked(state).layers["diffuse"].values["roughness"] == pytest.approx(0.2)
    state = replaced(material, state, "specular", "lambert", BINS)
    assert now.linked(state).layers["diffuse"].values["ior"] == 1.7
    assert [p.name for p in material.as_in(state).parameters("diffuse")] == ["color"]


def test_a_curve_stays_where_its_coordinate_does() -> None:
    material = glossy()
    curve = Curve((0.0, 1.0), ((1.0, 1.0, 1.0), (2.0, 2.0, 2.0)))
    layers = dict(material.initial.layers)
    layers["specular"] = LayerState(layers["specular"].values, curve)
    state = MaterialState(layers)
    half = replaced(material, state, "specular", "cook-torrance", BINS)
    assert half.layers["specular"].curve == curve
    assert replaced(material, state, "specular", "phong", BINS).layers["specular"].curve is None


def test_pictures_of_colours_carry_over_and_those_of_numbers_do_not() -> None:
    wood = ImageMap(Texels(np.full((1, 2, 3), 0.4, np.float32)))
    own = ImageMap(Texels(np.full((1, 2, 1), 30.0, np.float32)))
    rough = ImageMap(Texels(np.full((1, 2, 1), 0.3, np.float32)))
    place = "specular", "exponent"
    glossy_one = glossy()
    initial = replace(glossy_one.initial, images={place: own, ("diffuse", "color"): wood})
    material = replace(glossy_one, initial=initial)

    state = replace(initial, images={**initial.images, ("specular", "color"): wood})
    state = replaced(material, state, "specular", "cook-torrance", BINS)
    assert state.images == {("diffuse", "color"): wood, ("specular", "color"): wood}
    assert material.as_in(state).initial.images == {("diffuse", "color"): wood}
    # A roughness is α for the one, and its square for the other
    state = replace(state, images={**state.images, ("specular", "roughness"): rough})
    state = replaced(material, state, "specular", "schlick", BINS)
    assert ("specular", "roughness") not in state.images
    back = replaced(material, state, "specular", "blinn-phong", BINS)
    assert back.images == initial.images


def test_a_picture_that_only_the_new_model_has_a_place_for_makes_it_vary() -> None:
    material = glossy()
    state = replaced(material, material.initial, "specular", "cook-torrance", BINS)
    assert not material.varies(state)
    rough = ImageMap(Texels(np.full((1, 2, 1), 0.3, np.float32)))
    assert material.varies(replace(state, images={("specular", "roughness"): rough}))


def test_unknown_models_are_refused() -> None:
    material = glossy()
    with pytest.raises(UnknownName, match="cook-torrance"):
        replaced(material, material.initial, "specular", "cook-torance", BINS)
    assert "measured-half" in MODELS
    with pytest.raises(UnknownName):
        replaced(material, material.initial, "specular", "measured-half", BINS)


def test_metals_reflect_what_their_index_says() -> None:
    for metal in METALS:
        for n, k, first in zip(metal.n, metal.k, metal.reflectance, strict=True):
            assert fresnel_conductor(numpy_maths, 1.0, n, k) == pytest.approx(first, rel=1e-12)
    by_name = {metal.name: metal.reflectance for metal in METALS}
    assert min(by_name["silver"]) > 0.95
    r, g, b = by_name["gold"]
    assert r > g > b
    assert complex_reflectance((1.5,) * 3, (0.0,) * 3) == pytest.approx((0.04,) * 3)
