"""Materials and states survive JSON unchanged, and broken JSON is refused."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from burnish.core.errors import InvalidValue, UnknownName
from burnish.materials.coefficients import coefficients
from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, LayerState, Link, Material, MaterialState
from burnish.materials.model import Model
from burnish.materials.models.cook_torrance import CookTorranceConductor, CookTorranceDielectric
from burnish.materials.models.plastic_base import PlasticBase
from burnish.materials.parameter import Parameter
from burnish.materials.registry import (
    MODELS,
    material_from_json,
    material_to_json,
    model_from_json,
    model_to_json,
    state_from_json,
    state_to_json,
)

models = st.one_of(
    st.sampled_from([kind() for kind in MODELS.values()]),
    st.builds(
        CookTorranceConductor,
        st.sampled_from(["ggx", "beckmann"]),
        st.integers(1, 3),
        st.integers(1, 4),
    ),
    st.builds(PlasticBase, st.sampled_from(["ggx", "beckmann"]), st.booleans(), st.booleans()),
)


def value_of(parameter: Parameter) -> st.SearchStrategy[Any]:
    number = st.floats(parameter.minimum, parameter.maximum)
    return st.tuples(number, number, number) if parameter.kind == "colour" else number


@st.composite
def layers_and_states(draw: Any, name: str) -> tuple[Layer, LayerState]:
    model: Model = draw(models)
    values = {p.name: draw(value_of(p)) for p in model.parameters}
    start = {p.name: p.validate(p.default) for p in model.parameters}
    layer = Layer.starting_at(
        name,
        model,
        start,
        bins=draw(st.integers(1, 256)),
        spacing=draw(st.sampled_from([1.0, 2.0, 3.0])),
        delta=model.can_be_delta and draw(st.booleans()),
        group=draw(st.sampled_from(["", "wood"])),
    )
    curve = draw(st.none() | st.just(Curve((0.0, 0.5), ((1.0, 2.0, 3.0), (0.0, 0.5, 1.0)))))
    state = LayerState(values, curve, draw(st.booleans()), draw(st.floats(0, 10)))
    return layer, state


@st.composite
def materials(draw: Any) -> Material:
    parts = [draw(layers_and_states(name)) for name in ("diffuse", "specular")]
    state = MaterialState({layer.name: s for layer, s in parts}, draw(st.booleans()))
    links = draw(st.sampled_from([(), (Link("diffuse", "ior", "specular", "ior"),)]))
    return Material(tuple(layer for layer, _ in parts), state, links)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(materials())
def test_material_round_trip(material: Material) -> None:
    again = material_from_json(json.loads(json.dumps(material_to_json(material))))
    assert again == material
    assert state_from_json(json.loads(json.dumps(state_to_json(material.initial)))) == again.initial


def test_coefficients_survive_storage() -> None:
    values = {"color": (1.0, 0.5, 0.2), "roughness": 0.123456789, "ior": 1.5}
    layer = Layer.starting_at("specular", CookTorranceDielectric("ggx"), values)
    material = Material((layer,), MaterialState({"specular": LayerState(values)}))
    again = material_from_json(json.loads(json.dumps(material_to_json(material))))
    before = coefficients(layer, material.initial.layers["specular"])
    after = coefficients(again.layers[0], again.initial.layers["specular"])
    assert (before == after).all()


def test_models_by_name() -> None:
    for kind in MODELS.values():
        assert model_from_json(model_to_json(kind())) == kind()


@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        ({"name": "cook-torrence"}, UnknownName, "cook-torrance"),
        ({}, UnknownName, "no reflectance model"),
        ({"name": "lambert", "distribution": "ggx"}, InvalidValue, "does not take"),
        ({"name": "cook-torrance", "distribution": "phong"}, InvalidValue, "distribution must be"),
        ({"name": "cook-torrance", "masking_terms": 9}, InvalidValue, "1, 2 or 3"),
    ],
)
def test_unknown_models(data: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        model_from_json(data)


@pytest.mark.parametrize("data", [{}, {"layers": 3}, {"layers": [{}], "links": [], "initial": {}}])
def test_broken_materials(data: dict[str, Any]) -> None:
    with pytest.raises(InvalidValue, match="missing or of the wrong shape"):
        material_from_json(data)
