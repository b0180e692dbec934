"""Models of the 2006 paper against their formulae, and edits far from where a layer starts."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from burnish.materials.coefficients import albedo, coefficients, directional_albedo, outgoing
from burnish.materials.coordinates import around_axis, normalised
from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, LayerState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.model import Model
from burnish.materials.models.beard_maxwell import BeardMaxwellSurface, BeardMaxwellVolume
from burnish.materials.models.fresnel_curve import FresnelCurve
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.light_view import LightView
from burnish.materials.models.oren_nayar import OrenNayar
from burnish.materials.models.phong import NormalisedPhong, Phong
from burnish.materials.models.schlick import Schlick
from burnish.materials.models.torrance_sparrow import TorranceSparrow
from burnish.materials.models.ward import WardRatio, WardWidth
from burnish.materials.quadrature import gauss_legendre
from burnish.materials.registry import layer_state_from_json, layer_state_to_json

COLOUR = (0.2, 0.6, 1.0)


def pairs(seed: int, count: int = 400) -> tuple[Vector, Vector]:
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(0.1, 1.0, (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    sin = np.sqrt(1 - z * z)
    both = [Vector(s * np.cos(p), s * np.sin(p), c) for s, p, c in zip(sin, phi, z, strict=True)]
    return both[0], both[1]


def true(model: Model, wi: Vector, wo: Vector, values: dict[str, Any]) -> np.ndarray:
    return np.stack(model.evaluate(numpy_maths, wi, wo, values))


def product(layer: Layer, wi: Vector, wo: Vector, state: LayerState) -> np.ndarray:
    """s(θo) Σ_k a_k q_k f(t) of a state, on a layer that started elsewhere."""
    model, fixed = layer.model, layer.fixed
    t = model.coordinate(numpy_maths, wi, wo, fixed)
    q = np.stack(model.quotients(numpy_maths, wi, wo, fixed))
    f = np.broadcast_to(model.profile(t, state.values, fixed), (len(t), 3))
    s = outgoing(layer, state, wo.z, delta=False)
    value = np.einsum("kn,kh,nh->hn", q, model.amplitudes(state.values, fixed), f)
    return value if s is None else value * s.T


def angles(wi: Vector, wo: Vector, n: int) -> dict[str, float]:
    """θh, θd, φh, θi, θo, φ between them and θr of pair n, by elementary trigonometry."""
    a, b = np.array([w[n] for w in wi]), np.array([w[n] for w in wo])
    h = (a + b) / np.linalg.norm(a + b)
    mirrored = np.array([-b[0], -b[1], b[2]])
    between = math.atan2(a[1], a[0]) - math.atan2(b[1], b[0])
    return {
        "h": math.acos(h[2]),
        "d": math.acos(float(a @ h)),
        "phi_h": math.atan2(h[1], h[0]),
        "i": math.acos(a[2]),
        "o": math.acos(b[2]),
        "cos_phi": math.cos(between),
        "r": math.acos(max(-1.0, min(1.0, float(a @ mirrored)))),
    }


def ward(g: dict[str, float], ax: float, ay: float) -> float:
    e = math.tan(g["h"]) ** 2 * (
        (math.cos(g["phi_h"]) / ax) ** 2 + (math.sin(g["phi_h"]) / ay) ** 2
    )
    return math.exp(-e) / (4 * math.pi * ax * ay * math.sqrt(math.cos(g["i"]) * math.cos(g["o"])))


def oren_nayar(g: dict[str, float], sigma: float, rho: float) -> float:
    alpha, beta, s2 = max(g["i"], g["o"]), min(g["i"], g["o"]), sigma**2
    c1 = 1 - 0.5 * s2 / (s2 + 0.33)
    c2 = 0.45 * s2 / (s2 + 0.09)
    c2 *= math.sin(alpha) - (0 if g["cos_phi"] >= 0 else (2 * beta / math.pi) ** 3)
    c3 = 0.125 * s2 / (s2 + 0.09) * (4 * alpha * beta / math.pi**2) ** 2
    first = c1 + g["cos_phi"] * c2 * math.tan(beta)
    first += (1 - abs(g["cos_phi"])) * c3 * math.tan((alpha + beta) / 2)
    second = 0.17 * s2 / (s2 + 0.13) * (1 - g["cos_phi"] * (2 * beta / math.pi) ** 2)
    return (rho * first + rho**2 * second) / math.pi


def schlick(g: dict[str, float], r: float, f0: float) -> float:
    t, v, w = math.cos(g["h"]), math.cos(g["i"]), math.cos(g["o"])
    zenith = r / (1 + r * t * t - t * t) ** 2
    masking = v / (r - r * v + v) * w / (r - r * w + w)
    spectral = f0 + (1 - f0) * (1 - math.cos(g["d"])) ** 5
    return spectral * masking * zenith / (4 * math.pi * v * w)


def beard_maxwell(g: dict[str, float], numbers: dict[str, float], f0: float) -> float:
    fresnel = f0 + (1 - f0) * (1 - math.cos(g["d"])) ** 5
    scan = numbers["bias"] * math.cos(g["h"]) / (numbers["sigma"] ** 2 + math.tan(g["h"]) ** 2)
    tilt = g["h"] / numbers["omega"]
    shadow = (1 + tilt * math.exp(-2 * g["d"] / numbers["tau"])) / (1 + tilt)
    return fresnel * scan * shadow / (4 * math.cos(g["i"]) * math.cos(g["o"]))


def test_papers_formulae() -> None:
    wi, wo = pairs(1)
    surface = {"bias": 0.2, "sigma": 0.3, "tau": 0.4, "omega": 0.7}
    gauss = {"roughness": 0.3, "ratio": 0.5}
    found = {
        "phong": true(Phong(), wi, wo, {"color": COLOUR, "exponent": 20.0}),
        "ward": true(WardWidth(), wi, wo, {"color": COLOUR, **gauss}),
        "ward too": true(WardRatio(), wi, wo, {"color": COLOUR, **gauss}),
        "oren-nayar": true(OrenNayar(), wi, wo, {"color": COLOUR, "roughness": 0.5}),
        "schlick": true(Schlick(), wi, wo, {"color": COLOUR, "roughness": 0.1}),
        "report": true(NormalisedPhong(), wi, wo, {"color": COLOUR, "exponent": 20.0}),
        "torrance": true(TorranceSparrow(), wi, wo, {"color": COLOUR, "sigma": 0.3}),
        "beard": true(BeardMaxwellSurface(), wi, wo, {"color": COLOUR, **surface}),
    }
    for n in range(len(wi.z)):
        g = angles(wi, wo, n)
        for channel, c in enumerate(COLOUR):
            phong = c * 22 / (2 * math.pi) * max(math.cos(g["r"]), 0.0) ** 20
            expected = {
                "phong": phong,
                "ward": c * ward(g, 0.3, 0.15),
                "ward too": c * ward(g, 0.3, 0.15),
                "oren-nayar": oren_nayar(g, 0.5, c),
                "schlick": schlick(g, 0.1, c),
                "report": phong * 21 / 22 / math.cos(g["i"]),
                "torrance": c
                * math.exp(-((g["h"] / 0.3) ** 2))
                / (math.pi * 0.3**2 * 4 * math.cos(g["i"]) * math.cos(g["o"])),
                "beard": beard_maxwell(g, surface, c),
            }
            for name, value in expected.items():
                assert found[name][channel, n] == pytest.approx(value, rel=1e-7, abs=1e-12), name


@pytest.mark.parametrize(
    ("model", "start", "edited"),
    [
        (Phong(), {"exponent": 10.0}, {"exponent": 300.0}),
        (
            LightView(),
            {"light_falloff": 0.0, "view_falloff": 0.0},
            {"light_falloff": 2.0, "view_falloff": 0.3},
        ),
        (NormalisedPhong(), {"exponent": 10.0}, {"exponent": 300.0}),
        (TorranceSparrow(), {"sigma": 0.02}, {"sigma": 0.4}),
        (OrenNayar(), {"roughness": 0.0}, {"roughness": 0.6}),
        (WardWidth(), {"roughness": 0.1, "ratio": 3.0}, {"roughness": 0.4}),
        (WardRatio(), {"roughness": 0.2, "ratio": 1.0}, {"ratio": 4.0}),
        (BeardMaxwellSurface(), {"bias": 0.1, "sigma": 0.1}, {"bias": 1.0, "sigma": 0.5}),
        (BeardMaxwellVolume(), {"volume": (0.1,) * 3}, {"volume": (0.5, 0.2, 0.0)}),
        (FresnelCurve(), {"eta": (1.5,) * 3, "k": (0.0,) * 3, "roughness": 0.3},
         {"eta": (0.2, 0.9, 1.1), "k": (3.9, 2.4, 2.1)}),
    ],
    ids=lambda item: item.name if isinstance(item, Model) else "",
)  # fmt: skip
def test_edits_far_from_the_start_are_exact(
    model: Model, start: dict[str, Any], edited: dict[str, Any]
) -> None:
    """Nothing that can be edited is in the quotients of these models."""
    wi, wo = pairs(2, 4000)
    layer = Layer.starting_at("layer", model, {"color": (0.5, 0.5, 0.5), **start})
    own = {p.name for p in model.parameters}
    values = {k: v for k, v in {"color": COLOUR, **start, **edited}.items() if k in own}
    expected = true(model, wi, wo, {**layer.fixed, **values})
    found = product(layer, wi, wo, LayerState(values))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12 * expected.max())


@pytest.mark.parametrize("first", [1e-4, 0.01, 0.1, 1.0])
def test_schlick_expansion(first: float) -> None:
    """Worst error of the directional albedo, up to 80°, when r is edited over [0.0025, 0.36]."""
    layer = Layer.starting_at("layer", Schlick(), {"color": COLOUR, "roughness": first})
    for r in (0.0025, 0.01, 0.04, 0.16, 0.36):
        state = LayerState({"color": COLOUR, "roughness": r})
        exact = Layer.starting_at("layer", Schlick(), state.values)
        cos, found = directional_albedo(layer, state)
        error = np.abs(found / directional_albedo(exact, state)[1] - 1)
        assert error[cos > np.cos(np.radians(80))].max() <= 0.02


def test_light_view_goes_both_ways_only_with_equal_falloffs() -> None:
    wi, wo = pairs(3)
    values = {"color": COLOUR, "light_falloff": 1.0, "view_falloff": 1.0}
    model = LightView()
    np.testing.assert_allclose(true(model, wi, wo, values), true(model, wo, wi, values))
    minnaert = np.array(COLOUR)[:, None] * 3 / (2 * math.pi) * wi.z * wo.z
    np.testing.assert_allclose(true(model, wi, wo, values), minnaert, rtol=1e-12)


def test_volume_keeps_its_promise() -> None:
    layer = Layer.starting_at("layer", BeardMaxwellVolume(), {})
    state = LayerState({"color": (0.0, 0.4, 0.9), "volume": (1.0, 0.6, 0.1)})
    assert directional_albedo(layer, state)[1].max() <= 1 + 1e-9


@pytest.mark.parametrize("name", ["theta_in", "theta_r", "theta_d"])
def test_rings_invert_the_coordinate_and_cover_the_hemisphere(name: str) -> None:
    t, t_weight = gauss_legendre(0.0, 1.0, 200)
    u, weight = gauss_legendre(0.0, 1.0, 40)
    for cos_o in (0.05, 0.4, 0.999):
        wo = Vector(math.sqrt(1 - cos_o**2), 0.0, cos_o)
        ring = around_axis(name, t, u, weight, cos_o)
        lit = ring.solid_angle > 0
        found = normalised(numpy_maths, name, ring.wi, wo)
        expected = np.broadcast_to(t[:, None], lit.shape)
        np.testing.assert_allclose(found[lit], expected[lit], atol=1e-7)
        projected = float((ring.wi.z * ring.solid_angle).sum(axis=1) @ t_weight)
        # θr stops at 90°: what is left out is the part beyond it
        beyond = (1 - cos_o) / 2 if name == "theta_r" else 0.0
        assert projected == pytest.approx(math.pi * (1 - beyond), rel=2e-3)


def test_outgoing_curve_is_a_factor_of_every_model() -> None:
    fade = Curve((0.0, 1.0), ((1.0, 1.0, 1.0), (0.0, 0.5, 1.0)), "gain", "linear")
    cos = np.cos(np.array([0.0, 0.25, 0.5, 1.0]) * np.pi / 2)
    gain = fade.evaluate(np.array([0.0, 0.25, 0.5, 1.0]))
    matte = Layer.starting_at("diffuse", Lambert(), {"color": COLOUR})
    state = LayerState({"color": COLOUR}, outgoing_curve=fade)
    np.testing.assert_allclose(outgoing(matte, state, cos, False), gain, atol=1e-9)
    assert np.array_equal(
        coefficients(matte, state), coefficients(matte, replace(state, outgoing_curve=None))
    )
    # Red falls from 1 to 0 linearly in θo: ∫ 2 cos sin (1 − 2θ/π) dθ = 1/2
    np.testing.assert_allclose(
        albedo(matte, state)[[0, 2]] / np.array(COLOUR)[[0, 2]], [0.5, 1.0], rtol=1e-4
    )
    values = {"color": COLOUR, "light_falloff": 1.0, "view_falloff": 2.0}
    layer = Layer.starting_at("diffuse", LightView(), values)
    ridden = outgoing(layer, LayerState(values, outgoing_curve=fade), cos, False)
    np.testing.assert_allclose(ridden, gain * cos[:, None] ** 2, atol=1e-9)
    over = outgoing(
        layer, LayerState(values, outgoing_curve=replace(fade, mode="replace")), cos, False
    )
    np.testing.assert_allclose(over, gain, atol=1e-9)
    stored = json.loads(json.dumps(layer_state_to_json(state)))
    assert layer_state_from_json(stored) == state
    del stored["outgoing_curve"]
    assert layer_state_from_json(stored) == replace(state, outgoing_curve=None)
