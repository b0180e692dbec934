"""Models in plain Python: equal to the built-in ones, stored by module, refused with reasons."""

from __future__ import annotations

import json
import pickle
from typing import Any

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.materials import registry
from burnish.materials.coefficients import albedo, coefficients
from burnish.materials.coordinates import theta_difference, theta_half, theta_incident
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.model import Model
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.light_view import LightView
from burnish.materials.models.phong import Phong
from burnish.materials.parameter import Parameter
from burnish.materials.registry import material_from_json, material_to_json, model_from_json
from burnish.materials.user import user_model

COLOUR = Parameter("color", 0.5, kind="colour")
EXPONENT = Parameter("exponent", 30.0, 1.0, 500.0)


def power(xp: Any, gamma: Any, values: Any) -> Any:
    n = values["exponent"]
    lobe = xp.exp(n * xp.log(xp.maximum(xp.cos(gamma), 1e-9)))
    return [c * lobe for c in values["color"]]


def blinn(name: str, coordinate: Any) -> Model:
    def curve(xp: Any, gamma: Any, values: Any) -> Any:
        n = values["exponent"]
        scale = (n + 2) * (n + 4) / (8 * xp.pi * (xp.exp(-0.5 * np.log(2) * n) + n))
        return [c * scale for c in power(xp, gamma, values)]

    return user_model(name, curve=curve, coordinate=coordinate, parameters=(COLOUR, EXPONENT))


VALUES: dict[str, Any] = {"color": (0.2, 0.5, 1.0), "exponent": 30.0}
BLINN = blinn("test-blinn", "theta_h")


def own_angle(xp: Any, wi: Any, wo: Any, frozen: Any) -> Any:
    return theta_half(xp, wi, wo)


FREE = blinn("test-free", own_angle)


def pairs() -> tuple[Vector, Vector]:
    rng = np.random.default_rng(1)
    z, phi = rng.uniform(0.05, 1.0, (2, 2000)), rng.uniform(0, 2 * np.pi, (2, 2000))
    sin = np.sqrt(1 - z * z)
    a, b = (Vector(s * np.cos(p), s * np.sin(p), c) for s, p, c in zip(sin, phi, z, strict=True))
    return a, b


def energies_match(own: Model, built_in: Model, values: dict[str, Any], rtol: float) -> None:
    layers = [Layer.starting_at("layer", model, values) for model in (own, built_in)]
    state = LayerState(values)
    found, expected = (albedo(layer, state) for layer in layers)
    np.testing.assert_allclose(found, expected, rtol=rtol)
    assert np.isfinite(coefficients(layers[0], state)).all()
    wi, wo = pairs()
    values = {**layers[0].fixed, **values}
    np.testing.assert_allclose(
        own.evaluate(numpy_maths, wi, wo, values),
        built_in.evaluate(numpy_maths, wi, wo, {**layers[1].fixed, **values}),
        rtol=1e-6, atol=1e-9,
    )  # fmt: skip


def test_equals_a_built_in_model() -> None:
    energies_match(BLINN, BlinnPhong(), VALUES, 1e-9)


def test_any_coordinate_is_sorted_into_bins() -> None:
    energies_match(FREE, BlinnPhong(), VALUES, 2e-3)


def test_mirrored_and_incident_angles() -> None:
    def phong(xp: Any, gamma: Any, values: Any) -> Any:
        n = values["exponent"]
        return [c * (n + 2) / (2 * xp.pi) for c in power(xp, gamma, values)]

    own = user_model("test-phong", curve=phong, coordinate="theta_r", parameters=(COLOUR, EXPONENT))
    energies_match(own, Phong(), VALUES, 1e-9)

    def falloff(xp: Any, gamma: Any, values: Any) -> Any:
        p = values["light_falloff"]
        light = xp.exp(p * xp.log(xp.maximum(xp.cos(gamma), 1e-9))) * (p + 2) / (2 * xp.pi)
        return [c * light for c in values["color"]]

    def rim(xp: Any, cos: Any, values: Any) -> Any:
        return xp.power(cos, values["view_falloff"])

    own = user_model(
        "test-light-view", curve=falloff, outgoing=rim, coordinate="theta_in",
        parameters=LightView.parameters,
    )  # fmt: skip
    values = {"color": (0.2, 0.5, 1.0), "light_falloff": 1.5, "view_falloff": 0.5}
    energies_match(own, LightView(), values, 1e-9)


def test_anisotropic_coordinate_against_monte_carlo() -> None:
    def across(xp: Any, wi: Any, wo: Any, frozen: Any) -> Any:
        x, z = wi.x + wo.x, wi.z + wo.z
        return xp.atan2(xp.abs(x) * frozen["stretch"], z)

    stretch = Parameter("stretch", 2.0, 0.1, 10.0)
    own = user_model(
        "test-brushed", curve=power, coordinate=across, anisotropic=True,
        parameters=(COLOUR, EXPONENT), frozen=(stretch,),
    )  # fmt: skip
    layer = Layer.starting_at("layer", own, {**VALUES, "stretch": 3.0})
    assert layer.fixed == {"stretch": 3.0}
    rng = np.random.default_rng(2)
    z, phi = np.sqrt(rng.random((2, 300_000))), rng.uniform(0, 2 * np.pi, (2, 300_000))
    sin = np.sqrt(1 - z * z)
    wi, wo = (Vector(s * np.cos(p), s * np.sin(p), c) for s, p, c in zip(sin, phi, z, strict=True))
    value = np.pi * np.stack(own.evaluate(numpy_maths, wi, wo, {**layer.fixed, **VALUES}))
    sigma = value.std(axis=1) / np.sqrt(value.shape[1])
    error = np.abs(albedo(layer, LayerState(VALUES)) - value.mean(axis=1))
    assert (error <= 4 * sigma + 2e-3 * value.mean(axis=1)).all()


def test_none_is_all_quotient() -> None:
    own = user_model(
        "test-matte",
        curve=lambda xp, gamma, values: values["color"],
        quotient=lambda xp, wi, wo, frozen: 1 / xp.pi,
        coordinate="none",
        parameters=(COLOUR,),
    )
    layer = Layer.starting_at("layer", own, {"color": (0.1, 0.2, 0.3)})
    assert layer.bins == 1
    np.testing.assert_allclose(
        albedo(layer, LayerState({"color": (0.1, 0.2, 0.3)})), (0.1, 0.2, 0.3), rtol=1e-12
    )


def material() -> Material:
    layer = Layer.starting_at("gloss", BLINN, VALUES)
    return Material((layer,), MaterialState({"gloss": LayerState(VALUES)}))


def test_json_and_pickle() -> None:
    stored = json.loads(json.dumps(material_to_json(material())))
    assert stored["layers"][0]["model"] == {"name": "test-blinn", "module": __name__}
    assert material_from_json(stored) == material()
    assert pickle.loads(pickle.dumps(material())) == material()


def test_a_missing_module_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    stored = {"name": "test-velvet", "module": "burnish_test_velvet"}
    with pytest.raises(InvalidValue, match=r"defined in 'burnish_test_velvet': import that module"):
        model_from_json(stored)
    monkeypatch.setenv(registry.USER_MODELS, "burnish_test_velvet")
    with pytest.raises(InvalidValue, match=r"cannot be imported .* PYTHONPATH"):
        model_from_json(stored)
    (tmp_path / "burnish_test_velvet.py").write_text(
        "from burnish.materials.user import user_model\n"
        "user_model('test-velvet', curve=lambda xp, gamma, values: xp.sin(gamma))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert model_from_json(stored).name == "test-velvet"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"curve": lambda xp, g, v: -xp.cos(g)}, "curve must not be negative"),
        ({"curve": lambda xp, g, v: max(g, 0.1)}, "fail on arrays .*xp.select"),
        ({"curve": lambda xp, g, v: v["colour"]}, "fail on arrays .*declared"),
        ({"curve": lambda xp, g, v: xp.log(g * 0)}, "finite"),
        ({"curve": lambda xp, g, v: [g, g]}, "list of 2"),
        ({"curve": power, "coordinate": "theta_x"}, "coordinate must be one of theta_h"),
    ],
)
def test_mistakes_show_where_they_are_made(options: dict[str, Any], message: str) -> None:
    options.setdefault("parameters", ())
    with np.errstate(divide="ignore"), pytest.raises(InvalidValue, match=message):
        user_model("test-broken", **options)


def test_built_in_names_are_taken() -> None:
    with pytest.raises(InvalidValue, match="taken"):
        user_model("lambert", curve=power)


def test_coordinates_at_known_directions() -> None:
    up, side = Vector(0.0, 0.0, 1.0), Vector(0.6, 0.0, 0.8)
    tilt = np.arctan2(0.6, 0.8)
    assert theta_half(numpy_maths, up, side) == pytest.approx(tilt / 2)
    assert theta_difference(numpy_maths, up, side) == pytest.approx(tilt / 2)
    assert theta_incident(numpy_maths, side, up) == pytest.approx(tilt)
