"""Adapted materials against Mitsuba's own BSDFs."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.materials.coefficients import outgoing
from burnish.materials.layer import Material, MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.scene.adapters import adapt, with_gloss
from burnish.scene.device import activate
from burnish.scene.textures import interreflected

RGB = {"type": "rgb", "value": [0.1, 0.5, 0.9]}
CHECKER = {"type": "checkerboard", "color0": RGB, "color1": {"type": "rgb", "value": 0.8}}


@pytest.fixture(autouse=True, scope="module")
def _variant() -> None:
    activate()


# Single precision; and tables of a coat's transmittance, see `transmittance`
EXACT, TABLE = 2e-5, 7e-3
BSDFS: dict[str, tuple[dict[str, Any], float]] = {
    "diffuse": ({"type": "diffuse", "reflectance": RGB}, EXACT),
    "copper": (
        {"type": "roughconductor", "material": "Cu", "alpha": 0.2, "distribution": "ggx"},
        EXACT,
    ),
    "aluminium": ({"type": "roughconductor", "material": "Al", "alpha": 0.1}, EXACT),
    "tinted": (
        {"type": "roughconductor", "eta": RGB, "k": 3.0, "alpha": 0.4, "specular_reflectance": RGB},
        EXACT,
    ),
    "mirrorlike": ({"type": "roughconductor", "alpha_u": 0.3, "alpha_v": 0.3}, EXACT),
    "ggx-plastic": (
        {"type": "roughplastic", "alpha": 0.1, "distribution": "ggx", "diffuse_reflectance": RGB},
        TABLE,
    ),
    "nonlinear": (
        {
            "type": "roughplastic",
            "alpha": 0.3,
            "distribution": "ggx",
            "nonlinear": True,
            "diffuse_reflectance": RGB,
            "specular_reflectance": 0.5,
        },
        TABLE,
    ),
    "beckmann-plastic": ({"type": "roughplastic", "alpha": 0.3, "int_ior": "water"}, TABLE),
    "plastic": ({"type": "plastic", "int_ior": 1.9, "diffuse_reflectance": RGB}, EXACT),
}
each_bsdf = pytest.mark.parametrize(("description", "rtol"), BSDFS.values(), ids=BSDFS.keys())


def directions(rng: np.random.Generator, count: int) -> Vector:
    z, phi = rng.uniform(0.05, 1, count), rng.uniform(0, 2 * np.pi, count)
    sin = np.sqrt(1 - z * z)
    parts = (sin * np.cos(phi), sin * np.sin(phi), z)
    return Vector(*(a.astype(np.float32).astype(np.float64) for a in parts))


def near_mirror(rng: np.random.Generator, wo: Vector, spread: float) -> Vector:
    w = np.stack([-wo.x, -wo.y, wo.z]) + spread * rng.standard_normal((3, len(wo.z)))
    w[2] = np.maximum(w[2], 0.05)
    w /= np.linalg.norm(w, axis=0)
    return Vector(*(a.astype(np.float32).astype(np.float64) for a in w))


def device(w: Vector) -> Any:
    return mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in w))


def mitsuba_value(bsdf: Any, wi: Vector, wo: Vector) -> np.ndarray:
    si = mi.SurfaceInteraction3f()
    si.wi = device(wo)
    si.uv = mi.Point2f(0.25, 0.25)
    value = bsdf.eval(mi.BSDFContext(), si, device(wi))
    return np.asarray(value, np.float64) / wi.z


def own_value(material: Material, state: MaterialState, wi: Vector, wo: Vector) -> np.ndarray:
    settled = material.linked(state)
    total = np.zeros((3, len(wi.z)))
    for layer in material.layers:
        s = settled.layers[layer.name]
        values = {**layer.fixed, **s.values}
        total += s.weight * np.stack(layer.model.evaluate(numpy_maths, wi, wo, values))
    return total


def product_value(material: Material, wi: Vector, wo: Vector) -> np.ndarray:
    """s(θo) Σ_k a_k q_k f(t): what the bins approximate."""
    settled = material.linked(material.initial)
    total = np.zeros((3, len(wi.z)))
    for layer in material.layers:
        s, model = settled.layers[layer.name], layer.model
        t = model.coordinate(numpy_maths, wi, wo, layer.fixed)
        f = np.broadcast_to(model.profile(t, s.values, layer.fixed), (len(t), 3))
        q = np.stack(model.quotients(numpy_maths, wi, wo, layer.fixed))
        factor = outgoing(layer, s, wo.z, delta=False)
        share = np.einsum("kn,kh,nh->hn", q, model.amplitudes(s.values, layer.fixed), f)
        total += share * (1 if factor is None else factor.T)
    return total


@each_bsdf
def test_evaluate_is_mitsubas(description: dict[str, Any], rtol: float) -> None:
    rng = np.random.default_rng(1)
    adapted = adapt(description)
    assert adapted.material is not None
    wo = directions(rng, 4000)
    for wi in (directions(rng, 4000), near_mirror(rng, wo, 0.1)):
        expected = mitsuba_value(mi.load_dict(description), wi, wo)
        found = own_value(adapted.material, adapted.material.initial, wi, wo)
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=1e-6 * expected.max())


@each_bsdf
def test_unedited_product_form_is_mitsubas(description: dict[str, Any], rtol: float) -> None:
    """Exact but for three colour channels of a metal, which share three functions."""
    rng = np.random.default_rng(2)
    material = adapt(description).material
    assert material is not None
    wo = directions(rng, 4000)
    wi = near_mirror(rng, wo, 0.2)
    expected = mitsuba_value(mi.load_dict(description), wi, wo)
    limit = 0.02 if description["type"] == "roughconductor" else max(rtol, 1e-3)
    found = product_value(material, wi, wo)
    error = np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2))
    assert error <= limit / 4
    np.testing.assert_allclose(found, expected, rtol=limit, atol=1e-6 * expected.max())


@each_bsdf
@pytest.mark.parametrize("alpha", [0.05, 0.35, 1.0])
def test_edited_bsdf_is_the_edited_model(
    description: dict[str, Any], rtol: float, alpha: float
) -> None:
    adapted = adapt(description)
    material = adapted.material
    assert material is not None
    assert adapted.edited_bsdf is not None
    layers = dict(material.initial.layers)
    if "specular" in layers:
        values = {**layers["specular"].values, "roughness": alpha, "color": (0.2, 0.4, 0.8)}
        layers["specular"] = replace(layers["specular"], values=values)
    if "diffuse" in layers:
        values = {**layers["diffuse"].values, "color": (0.7, 0.1, 0.0)}
        layers["diffuse"] = replace(layers["diffuse"], values=values)
    state = MaterialState(layers)
    rng = np.random.default_rng(3)
    wo = directions(rng, 4000)
    wi = near_mirror(rng, wo, alpha)
    expected = mitsuba_value(adapted.edited_bsdf(state), wi, wo)
    found = own_value(material, state, wi, wo)
    tolerance = max(rtol, TABLE) if "plastic" in description["type"] else rtol
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=2e-6 * expected.max())


@pytest.mark.parametrize(
    "description",
    [
        {"type": "conductor", "material": "Au", "specular_reflectance": RGB},
        {"type": "conductor"},
        {"type": "plastic", "int_ior": 1.7, "specular_reflectance": RGB},
    ],
)
def test_delta_column_is_mitsubas_mirror(description: dict[str, Any]) -> None:
    material = adapt(description).material
    assert material is not None
    layer, state = material.layer("specular"), material.initial.layers["specular"]
    cos = np.linspace(0.05, 1, 40)
    factor = outgoing(layer, state, cos, delta=True)
    assert factor is not None
    found = layer.model.delta(state.values, layer.fixed) * factor
    si = mi.SurfaceInteraction3f()
    si.wi = device(Vector(np.sqrt(1 - cos * cos), 0 * cos, cos))
    context = mi.BSDFContext()
    context.type_mask = mi.BSDFFlags.DeltaReflection
    sample, weight = mi.load_dict(description).sample(context, si, mi.Float(0.5), mi.Point2f(0.5))
    expected = np.asarray(weight * sample.pdf).T
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert layer.delta
    assert layer.parameter("roughness").minimum == 0


def test_smooth_becomes_rough_in_mitsubas_own_plugin() -> None:
    adapted = adapt({"type": "conductor", "material": "Au"})
    assert adapted.material is not None
    assert adapted.edited_bsdf is not None
    state = adapted.material.initial
    layer = state.layers["specular"]
    rough = replace(layer, values={**layer.values, "roughness": 0.3})
    assert "SmoothConductor" in str(adapted.edited_bsdf(state))
    assert "RoughConductor" in str(adapted.edited_bsdf(MaterialState({"specular": rough})))


@pytest.mark.parametrize(
    ("description", "reason"),
    [
        ({"type": "dielectric"}, "its BSDF is 'dielectric'; editable are conductor, diffuse"),
        (
            {"type": "twosided", "a": {"type": "mask", "opacity": 0.5, "b": {"type": "diffuse"}}},
            "'mask' lies inside",
        ),
        ({"type": "roughconductor", "alpha_u": 0.1, "alpha_v": 0.2}, "differs along u and v"),
        ({"type": "conductor", "eta": CHECKER, "k": 1.0}, "its eta is textured"),
        ({"type": "plastic", "int_ior": 5.0}, r"outside \(1, 3\]"),
        (
            {"type": "twosided", "a": {"type": "diffuse"}, "b": {"type": "plastic"}},
            "two faces have different",
        ),
    ],
)
def test_what_stays_fixed_says_why(description: dict[str, Any], reason: str) -> None:
    adapted = adapt(description)
    assert adapted.material is None
    assert re.search(reason, adapted.reason)


def test_two_sided() -> None:
    adapted = adapt({"type": "twosided", "inner": {"type": "diffuse", "reflectance": RGB}})
    assert adapted.two_sided
    assert adapted.material is not None
    assert adapted.edited_bsdf is not None
    assert "TwoSided" in str(adapted.edited_bsdf(adapted.material.initial))
    assert not adapt({"type": "diffuse"}).two_sided


@pytest.mark.parametrize("nonlinear", [False, True])
def test_textured_plastic_times_its_map_is_mitsubas(nonlinear: bool) -> None:
    description = {
        "type": "roughplastic",
        "alpha": 0.2,
        "distribution": "ggx",
        "nonlinear": nonlinear,
        "diffuse_reflectance": CHECKER,
        "specular_reflectance": 0.0,
    }
    adapted = adapt(description)
    assert adapted.material is not None
    assert [layer.group for layer in adapted.material.layers] == ["diffuse", ""]
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(0.25, 0.25)
    H = np.asarray(mi.Color3f(mi.load_dict(dict(adapted.maps["diffuse"])).eval(si)), np.float64)
    rng = np.random.default_rng(4)
    wi, wo = directions(rng, 2000), directions(rng, 2000)
    expected = mitsuba_value(mi.load_dict(description), wi, wo)
    found = own_value(adapted.material, adapted.material.initial, wi, wo) * H.reshape(3, 1)
    np.testing.assert_allclose(found, expected, rtol=TABLE)


def test_interreflected_map_keeps_white_white() -> None:
    texture = interreflected({"type": "checkerboard", "color0": 1.0, "color1": 0.5}, 0.6)
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(mi.Float([0.25, 0.75]), mi.Float([0.25, 0.25]))
    values = np.sort(np.asarray(mi.Color3f(mi.load_dict(dict(texture)).eval(si)))[0])
    np.testing.assert_allclose(values, [0.4 * 0.5 / (1 - 0.6 * 0.5), 1.0], rtol=1e-6)


def test_tinted_bitmap() -> None:
    texels = np.linspace(0, 1, 4 * 4 * 3, dtype=np.float32).reshape(4, 4, 3)
    bitmap = {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": True}
    adapted = adapt({"type": "diffuse", "reflectance": bitmap})
    assert adapted.material is not None
    assert adapted.edited_bsdf is not None
    tint = replace(adapted.material.initial.layers["diffuse"], values={"color": (0.5, 1.0, 0.0)})
    rng = np.random.default_rng(5)
    wi, wo = directions(rng, 10), directions(rng, 10)
    plain = mitsuba_value(adapted.edited_bsdf(adapted.material.initial), wi, wo)
    state = replace(adapted.material.initial, layers={"diffuse": tint})
    tinted = mitsuba_value(adapted.edited_bsdf(state), wi, wo)
    np.testing.assert_allclose(tinted, plain * np.array([[0.5], [1.0], [0.0]]), rtol=1e-5)


def test_states_that_no_plugin_holds() -> None:
    adapted = adapt({"type": "diffuse", "reflectance": RGB})
    assert adapted.material is not None
    assert adapted.edited_bsdf is not None
    glossy = with_gloss(adapted.material)
    assert adapted.edited_bsdf(glossy.initial) is not None
    shown = {**glossy.initial.layers}
    shown["specular"] = replace(shown["specular"], weight=1.0)
    assert adapted.edited_bsdf(MaterialState(shown)) is None
    assert adapted.edited_bsdf(replace(adapted.material.initial, conserve=True)) is None


def test_gloss_is_added_once_and_of_any_model() -> None:
    material = adapt({"type": "diffuse"}).material
    assert material is not None
    glossy = with_gloss(material, BlinnPhong())
    assert glossy.initial.layers["specular"].weight == 0
    assert glossy.layer("specular").model == BlinnPhong()
    with pytest.raises(InvalidValue, match="has a layer 'specular' already"):
        with_gloss(glossy)
