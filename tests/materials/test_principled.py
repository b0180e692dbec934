"""Mitsuba's principled BSDF, taken apart into layers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from burnish.materials.coefficients import coefficients, directional_albedo, outgoing
from burnish.materials.layer import Material, MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.models.principled import ior_of_specular, specular_of_ior
from burnish.materials.names import resolve
from burnish.materials.registry import material_from_json, material_to_json
from burnish.scene.adapters import adapt
from burnish.scene.device import activate

RGB = {"type": "rgb", "value": [0.1, 0.5, 0.9]}
CHECKER = {
    "type": "checkerboard",
    "color0": RGB,
    "color1": {"type": "rgb", "value": [0.8, 0.3, 0.2]},
}
GREY = {
    "type": "checkerboard",
    "color0": {"type": "rgb", "value": 0.25},
    "color1": {"type": "rgb", "value": 0.7},
}
FULL = {
    "type": "principled",
    "base_color": RGB,
    "metallic": 0.4,
    "roughness": 0.45,
    "specular": 0.7,
    "spec_tint": 0.3,
    "sheen": 0.6,
    "sheen_tint": 0.5,
    "clearcoat": 0.8,
    "clearcoat_gloss": 0.3,
}
CASES: dict[str, dict[str, Any]] = {
    "plain": {"type": "principled"},
    "full": FULL,
    "metal": {"type": "principled", "base_color": RGB, "metallic": 1.0, "roughness": 0.3},
    "glass-like": {"type": "principled", "eta": 1.3, "roughness": 0.6, "base_color": RGB},
    "black": {**FULL, "base_color": {"type": "rgb", "value": 0.0}},
    "textured": {**FULL, "base_color": CHECKER, "spec_tint": 0.0, "sheen_tint": 0.0},
    "metal-map": {**FULL, "metallic": GREY},
    "rough-map": {**FULL, "roughness": GREY, "metallic": GREY},
    "both-maps": {
        **FULL,
        "base_color": CHECKER,
        "metallic": GREY,
        "spec_tint": 0.0,
        "sheen_tint": 0.0,
        "clearcoat": GREY,
    },
}
each_case = pytest.mark.parametrize("description", CASES.values(), ids=CASES.keys())


@pytest.fixture(autouse=True, scope="module")
def _variant() -> None:
    activate()


def pairs(count: int = 3000, seed: int = 1) -> tuple[Vector, Vector]:
    """Half of the pairs anywhere, half near the mirror direction."""
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(0.05, 1, (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    sin = np.sqrt(1 - z * z)
    w = np.stack([sin * np.cos(phi), sin * np.sin(phi), z], axis=1)
    near = w[1] * np.array([[-1], [-1], [1]]) + 0.1 * rng.standard_normal((3, count))
    near[2] = np.maximum(near[2], 0.05)
    w[0, :, ::2] = (near / np.linalg.norm(near, axis=0))[:, ::2]
    wi, wo = w.astype(np.float32).astype(np.float64)
    return Vector(*wi), Vector(*wo)


def device(w: Vector) -> Any:
    return mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in w))


def interaction(wo: Vector) -> Any:
    si = mi.SurfaceInteraction3f()
    si.wi = device(wo)
    si.uv = mi.Point2f(0.25, 0.25)
    return si


def mitsuba_value(bsdf: Any, wi: Vector, wo: Vector) -> np.ndarray:
    value = bsdf.eval(mi.BSDFContext(), interaction(wo), device(wi))
    return np.asarray(value, np.float64) / wi.z


def weights(adapted: Any, wo: Vector) -> dict[str, np.ndarray]:
    si = interaction(wo)
    return {
        group: np.asarray(mi.Color3f(mi.load_dict(texture).eval(si)), np.float64).reshape(3, -1)
        for group, texture in adapted.maps.items()
    }


def there(material: Material, state: MaterialState) -> MaterialState:
    """The state with what its pictures of numbers show at the interaction's uv."""
    layers = dict(state.layers)
    for (name, parameter), image in state.images.items():
        if material.inherent((name, parameter)) is None:
            value = float(np.clip(image.at(np.array([0.25, 0.25]))[0], 0, 1))
            values = {**layers[name].values, parameter: value}
            layers[name] = replace(layers[name], values=values)
    return MaterialState(layers)


def true_value(adapted: Any, state: MaterialState, wi: Vector, wo: Vector) -> np.ndarray:
    material: Material = adapted.material
    state = there(material, state)
    settled, total, H = material.linked(state), np.zeros((3, len(wi.z))), weights(adapted, wo)
    for layer in material.layers:
        values = {**layer.fixed, **settled.layers[layer.name].values}
        rho = np.stack(layer.model.evaluate(numpy_maths, wi, wo, values))
        total += rho * H.get(layer.group, 1.0)
    return total


def product_value(adapted: Any, state: MaterialState, wi: Vector, wo: Vector) -> np.ndarray:
    """s(θo) Σ_k a_k q_k f(t): what the bins approximate."""
    material: Material = adapted.material
    state = there(material, state)
    settled, total, H = material.linked(state), np.zeros((3, len(wi.z))), weights(adapted, wo)
    for layer in material.layers:
        s, model = settled.layers[layer.name], layer.model
        t = model.coordinate(numpy_maths, wi, wo, layer.fixed)
        f = np.broadcast_to(model.profile(t, s.values, layer.fixed), (len(t), 3))
        q = np.stack(model.quotients(numpy_maths, wi, wo, layer.fixed))
        factor = outgoing(layer, s, wo.z, delta=False)
        share = np.einsum("kn,kh,nh->hn", q, model.amplitudes(s.values, layer.fixed), f)
        total += share * (1 if factor is None else factor.T) * H.get(layer.group, 1.0)
    return total


def changed(material: Material, values: dict[str, Any]) -> MaterialState:
    layers = dict(material.initial.layers)
    for path, value in values.items():
        layer, name = path.split(".")
        layers[layer] = replace(layers[layer], values={**layers[layer].values, name: value})
    return replace(material.initial, layers=layers)


@each_case
def test_unedited_is_mitsubas(description: dict[str, Any]) -> None:
    adapted = adapt(description)
    assert adapted.material is not None, adapted.reason
    wi, wo = pairs()
    expected = mitsuba_value(mi.load_dict(description), wi, wo)
    # Away from the picture's mean a roughness's masking is expanded, as after an edit
    rough = ("specular", "roughness") in adapted.material.initial.images
    for value in (true_value,) if rough else (true_value, product_value):
        found = value(adapted, adapted.material.initial, wi, wo)
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5 * expected.max())


@each_case
def test_every_parameter_is_mitsubas(description: dict[str, Any]) -> None:
    """The true formula, to single precision, at every minimum, middle and maximum."""
    adapted = adapt(description)
    material = adapted.material
    assert material is not None
    assert adapted.edited_bsdf is not None
    wi, wo = pairs(seed=2)
    for layer in material.layers:
        for parameter in material.parameters(layer.name):
            for x in (parameter.minimum, 0.5 * (parameter.minimum + parameter.maximum), 1.0):
                value = (x, x, x) if parameter.kind == "colour" else x
                path = f"object.{layer.name}.{parameter.name}"
                state = resolve({"object": material}, path).write(material, material.initial, value)
                bsdf = adapted.edited_bsdf(state)
                if bsdf is None:  # a scaled map of sheen or coat
                    assert adapted.maps
                    continue
                expected = mitsuba_value(bsdf, wi, wo)
                found = true_value(adapted, state, wi, wo)
                where = f"{layer.name}.{parameter.name} = {x}"
                # At full gloss Mitsuba's GTR1 loses digits to 1 + (α² − 1) cos²θ
                rtol = 0.03 if parameter.name == "clearcoat_gloss" and x == 1 else 3e-4
                np.testing.assert_allclose(
                    found, expected, rtol=rtol, atol=2e-5 * expected.max(), err_msg=where
                )


EDITS: list[tuple[dict[str, Any], float]] = [
    ({"diffuse.color": (0.9, 0.2, 0.0)}, 1e-5),
    ({"specular.metallic": 0.0}, 3e-3),
    ({"specular.metallic": 1.0}, 3e-3),
    ({"specular.spec_tint": 1.0}, 1e-5),
    ({"sheen.sheen": 1.0, "sheen.sheen_tint": 1.0}, 1e-5),
    ({"coat.clearcoat": 1.0}, 1e-5),
    ({"specular.specular": 0.0}, 0.02),
    ({"specular.specular": 0.5}, 0.02),
    ({"specular.specular": 1.0}, 0.02),
    ({"specular.roughness": 0.2}, 0.02),
    ({"specular.roughness": 0.7}, 0.02),
    ({"specular.roughness": 1.0}, 0.03),
]


@pytest.mark.parametrize("start", ["plain", "full", "metal"])
@pytest.mark.parametrize(("edit", "limit"), EDITS, ids=[str(edit) for edit, _ in EDITS])
def test_edited_energy_follows(start: str, edit: dict[str, Any], limit: float) -> None:
    """Directional albedo of the product form against a layer that starts at the edit."""
    material = adapt(CASES[start]).material
    assert material is not None
    state = material.linked(changed(material, edit))
    found = exact = np.zeros(1)
    for layer in material.layers:
        s = state.layers[layer.name]
        fresh = replace(layer, fixed=layer.model.freeze(s.values))
        cos, own = directional_albedo(layer, s)
        found = found + own
        exact = exact + directional_albedo(fresh, s)[1]
    usual = cos > 0.17
    np.testing.assert_allclose(found[usual], exact[usual], rtol=limit)


def test_specular_and_ior_are_inverse() -> None:
    for specular in (1e-6, 0.1, 0.5, 1.0):
        assert specular_of_ior(ior_of_specular(specular)) == pytest.approx(specular)
    assert ior_of_specular(0.5) == pytest.approx(1.5)


def test_knobs_of_maps_are_hidden_and_colours_shared() -> None:
    material = adapt(CASES["both-maps"]).material
    assert material is not None
    knobs = {
        f"{layer.name}.{item.name}"
        for layer in material.layers
        for item in material.parameters(layer.name)
    }
    assert knobs == {
        "diffuse.color",
        "sheen.sheen",
        "specular.metallic",
        "specular.roughness",
        "specular.specular",
        "coat.clearcoat",
        "coat.clearcoat_gloss",
    }
    again = material_from_json(material_to_json(material))
    assert again == material
    groups = {layer.name: layer.group for layer in material.layers}
    assert groups["diffuse"] == groups["metal"] != ""
    assert groups["sheen"] == groups["specular"] == ""


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"spec_trans": 0.5}, "transmits"),
        ({"anisotropic": 0.5}, "anisotropic"),
        ({"flatness": 0.5}, "flatness"),
        ({"clearcoat_gloss": GREY}, "clearcoat_gloss is textured"),
        ({"eta": 2.5}, "specular"),
        ({"base_color": CHECKER, "spec_tint": 0.5}, "spec_tint"),
        ({"metallic": 0.5, "specular": 0.0}, "index of refraction is 1"),
    ],
)
def test_what_cannot_be_edited_says_why(change: dict[str, Any], reason: str) -> None:
    adapted = adapt({"type": "principled", **change})
    assert adapted.material is None
    assert reason in adapted.reason


def test_coefficients_are_finite_at_the_ends() -> None:
    material = adapt(FULL).material
    assert material is not None
    for layer in material.layers:
        for parameter in layer.parameters:
            for x in (parameter.minimum, parameter.maximum):
                value = (x, x, x) if parameter.kind == "colour" else x
                state = changed(material, {f"{layer.name}.{parameter.name}": value})
                assert np.isfinite(coefficients(layer, state.layers[layer.name])).all()
