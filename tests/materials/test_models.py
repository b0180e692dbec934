"""Laws that every reflectance model keeps, and each against a second source."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from burnish.materials.coefficients import outgoing
from burnish.materials.layer import Layer, LayerState
from burnish.materials.maths import Vector, dot, half_vector, numpy_maths
from burnish.materials.measured.models import (
    Measured,
    MeasuredDiffuse,
    MeasuredFresnel,
    MeasuredHalf,
    MeasuredIncident,
    MeasuredSpecular,
)
from burnish.materials.measured.pairs import MeasuredHalfDifference, MeasuredHomomorphic
from burnish.materials.model import Model
from burnish.materials.models.ashikhmin_shirley import AshikhminShirleyRatio, AshikhminShirleyWidth
from burnish.materials.models.ashikhmin_shirley_curves import AshikhminShirleyCurves
from burnish.materials.models.beard_maxwell import BeardMaxwellSurface, BeardMaxwellVolume
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance import (
    CookTorrance,
    CookTorranceConductor,
    CookTorranceDielectric,
)
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.materials.models.fresnel_curve import FresnelCurve
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.light_view import LightView
from burnish.materials.models.oren_nayar import OrenNayar
from burnish.materials.models.phong import NormalisedPhong, Phong
from burnish.materials.models.plastic_base import PlasticBase
from burnish.materials.models.principled import (
    PrincipledBase,
    PrincipledCoat,
    PrincipledMetal,
    PrincipledSheen,
    PrincipledSpecular,
)
from burnish.materials.models.schlick import Schlick
from burnish.materials.models.torrance_sparrow import TorranceSparrow
from burnish.materials.models.ward import WardRatio, WardWidth
from burnish.materials.pca.models import SIX
from burnish.materials.quadrature import energy_table
from burnish.materials.registry import MODELS
from burnish.materials.two_curves import TwoCurves
from burnish.materials.user import UserModel

COLOUR = (0.1, 0.5, 1.0)
COPPER: dict[str, Any] = {"eta": (0.2, 0.924, 1.102), "k": (3.912, 2.452, 2.142)}


@dataclass(frozen=True)
class Case:
    """A model and the values that its layer starts with, frozen ones included."""

    model: Model
    values: dict[str, Any]

    @property
    def layer(self) -> Layer:
        return Layer.starting_at("layer", self.model, self.values)

    @property
    def state(self) -> LayerState:
        return LayerState({p.name: self.values[p.name] for p in self.model.parameters})


CASES = {
    "lambert": Case(Lambert(), {"color": COLOUR}),
    "blinn": Case(BlinnPhong(), {"color": COLOUR, "exponent": 80.0}),
    "schlick-ggx": Case(CookTorrance("ggx"), {"color": COLOUR, "roughness": 0.3}),
    "schlick-beckmann": Case(CookTorrance("beckmann"), {"color": COLOUR, "roughness": 0.1}),
    "dielectric-ggx": Case(
        CookTorranceDielectric("ggx", 3, 3), {"color": COLOUR, "roughness": 0.2, "ior": 1.5}
    ),
    "dielectric-beckmann": Case(
        CookTorranceDielectric("beckmann"), {"color": COLOUR, "roughness": 0.5, "ior": 1.8}
    ),
    "copper": Case(CookTorranceConductor("ggx"), {"color": COLOUR, "roughness": 0.25, **COPPER}),
    "plastic": Case(
        PlasticBase("ggx", nonlinear=True), {"color": COLOUR, "roughness": 0.1, "ior": 1.5}
    ),
    "smooth-plastic": Case(PlasticBase(), {"color": COLOUR, "roughness": 0.0, "ior": 1.5}),
    "two-curve-copper": Case(
        CookTorranceCurves("ggx", bins2=16), {"color": COLOUR, "roughness": 0.25, **COPPER}
    ),
    "two-curve-anisotropic": Case(
        AshikhminShirleyCurves(bins=64, bins2=64),
        {"color": COLOUR, "exponent_u": 200.0, "exponent_v": 30.0},
    ),
    "ratio": Case(AshikhminShirleyRatio(), {"color": COLOUR, "ratio": 4.0, "exponent": 50.0}),
    "width": Case(AshikhminShirleyWidth(), {"color": COLOUR, "exponent": 200.0, "ratio": 0.3}),
    "phong": Case(Phong(), {"color": COLOUR, "exponent": 80.0}),
    "light-view": Case(LightView(), {"color": COLOUR, "light_falloff": 0.7, "view_falloff": 0.7}),
    "oren-nayar": Case(OrenNayar(), {"color": COLOUR, "roughness": 0.45}),
    "ward-width": Case(WardWidth(), {"color": COLOUR, "roughness": 0.15, "ratio": 0.4}),
    "ward-ratio": Case(WardRatio(), {"color": COLOUR, "roughness": 0.2, "ratio": 2.0}),
    "phong-normalised": Case(NormalisedPhong(), {"color": COLOUR, "exponent": 60.0}),
    "torrance-sparrow": Case(TorranceSparrow(), {"color": COLOUR, "sigma": 0.2}),
    "schlick": Case(Schlick(), {"color": COLOUR, "roughness": 0.05}),
    "beard-maxwell": Case(
        BeardMaxwellSurface(),
        {"color": COLOUR, "bias": 0.1, "sigma": 0.15, "tau": 0.4, "omega": 0.7},
    ),
    "beard-maxwell-volume": Case(BeardMaxwellVolume(), {"color": COLOUR, "volume": COLOUR[::-1]}),
    **{
        kind.name: Case(kind(), {"color": COLOUR})
        for kind in (
            MeasuredDiffuse,
            MeasuredSpecular,
            MeasuredFresnel,
            MeasuredHalf,
            MeasuredIncident,
            MeasuredHalfDifference,
            MeasuredHomomorphic,
        )
    },
    "fresnel-curve": Case(FresnelCurve(), {"color": COLOUR, "roughness": 0.25, **COPPER}),
    "principled-base": Case(PrincipledBase(), {"color": COLOUR, "metallic": 0.2, "roughness": 0.6}),
    "principled-sheen": Case(
        PrincipledSheen(), {"color": COLOUR, "metallic": 0.2, "sheen": 0.7, "sheen_tint": 0.5}
    ),
    "principled-specular": Case(
        PrincipledSpecular(),
        {"color": COLOUR, "metallic": 0.3, "roughness": 0.5, "specular": 0.7, "spec_tint": 0.4},
    ),
    "principled-metal": Case(
        PrincipledMetal(), {"color": COLOUR, "metallic": 0.6, "roughness": 0.4}
    ),
    "principled-coat": Case(PrincipledCoat(), {"clearcoat": 1.0, "clearcoat_gloss": 0.5}),
}
each_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())


def directions(rng: np.random.Generator, count: int, lowest: float = 0.05) -> Vector:
    z = rng.uniform(lowest, 1.0, count)
    phi = rng.uniform(0, 2 * np.pi, count)
    sin = np.sqrt(1 - z * z)
    return Vector(sin * np.cos(phi), sin * np.sin(phi), z)


def evaluate(case: Case, wi: Vector, wo: Vector) -> np.ndarray:
    values = {**case.layer.fixed, **case.state.values}
    return np.stack(case.model.evaluate(numpy_maths, wi, wo, values))


def product_form(case: Case, wi: Vector, wo: Vector, state: LayerState | None = None) -> np.ndarray:
    """s(θo) Σ_k a_k q_k f(t) at the exact coordinate."""
    layer, state = case.layer, state or case.state
    model = layer.model
    q = np.stack(model.quotients(numpy_maths, wi, wo, layer.fixed))
    a = model.amplitudes(state.values, layer.fixed)
    if isinstance(model, TwoCurves):
        t, other = model.coordinates(numpy_maths, wi, wo, layer.fixed)
        f = model.second_profile(other, state.values, layer.fixed)
    else:
        t, f = model.coordinate(numpy_maths, wi, wo, layer.fixed), np.ones((1, 3))
    f = np.broadcast_to(f * model.profile(t, state.values, layer.fixed), (len(t), 3))
    factor = outgoing(layer, state, wo.z, delta=False)
    s = 1.0 if factor is None else factor.T
    return s * np.einsum("kn,kh,nh->hn", q, a, f)


def test_every_model_has_a_case() -> None:
    built_in = {name for name, kind in MODELS.items() if not issubclass(kind, UserModel)}
    # Components come close and are never exact: test_family, test_pca
    built_in -= {"principled-family", "measured-space", *(kind.name for kind in SIX)}
    assert {case.model.name for case in CASES.values()} == built_in


@each_case
def test_reciprocal_and_not_negative(case: Case) -> None:
    rng = np.random.default_rng(1)
    wi, wo = directions(rng, 20_000), directions(rng, 20_000)
    forward, backward = evaluate(case, wi, wo), evaluate(case, wo, wi)
    assert (forward >= 0).all()
    if isinstance(case.model, NormalisedPhong):
        # All but the cosine of the light, as its manual says
        forward, backward = forward * wi.z, backward * wo.z
    np.testing.assert_allclose(forward, backward, rtol=1e-9, atol=1e-12)


@each_case
def test_dark_below_the_horizon(case: Case) -> None:
    up, down = Vector(*np.array([[0.6], [0.0], [0.8]])), Vector(*np.array([[0.0], [0.6], [-0.8]]))
    assert not evaluate(case, up, down).any()
    assert not evaluate(case, down, up).any()


@each_case
def test_product_form_is_the_model_at_the_initial_values(case: Case) -> None:
    rng = np.random.default_rng(2)
    wi, wo = directions(rng, 20_000), directions(rng, 20_000)
    true = evaluate(case, wi, wo)
    # A plastic's initial transmittance is a fit; everything else is exact to rounding
    rtol = 5e-3 if isinstance(case.model, PlasticBase) else 1e-6
    np.testing.assert_allclose(product_form(case, wi, wo), true, rtol=rtol, atol=1e-9 * true.max())


@each_case
def test_reference_quotient_is_positive(case: Case) -> None:
    rng = np.random.default_rng(3)
    wi, wo = directions(rng, 20_000), directions(rng, 20_000)
    q = case.model.quotients(numpy_maths, wi, wo, case.layer.fixed)[0]
    # Phong's ends at 90° from the mirrored direction
    assert (q >= 0).all() if isinstance(case.model, Phong) else (q > 0).all()


def mixture_albedo(case: Case, count: int) -> tuple[np.ndarray, np.ndarray]:
    """d = (1/π) ∫∫ ρ cosθi cosθo by Monte Carlo, and its standard error; shares no quadrature.

    ωo from the cosine; ωi half from the cosine, half from half vectors spread over θ = (π/2)u².
    """
    rng = np.random.default_rng(4)

    def cosine(n: int) -> Vector:
        z, phi = np.sqrt(rng.random(n)), rng.random(n) * 2 * np.pi
        return Vector(np.sqrt(1 - z * z) * np.cos(phi), np.sqrt(1 - z * z) * np.sin(phi), z)

    wo = cosine(count)
    theta, phi = np.pi / 2 * rng.random(count) ** 2, rng.random(count) * 2 * np.pi
    h = Vector(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
    d = dot(wo, h)
    mirrored = Vector(*(2 * d * a - b for a, b in zip(h, wo, strict=True)))
    broad = rng.random(count) < 0.5
    wi = Vector(*(np.where(broad, a, b) for a, b in zip(cosine(count), mirrored, strict=True)))
    wi = Vector(wi.x, wi.y, np.where(wi.z > 1e-9, wi.z, -1.0))
    h = half_vector(numpy_maths, wi, wo)
    sin = np.maximum(np.hypot(h.x, h.y), 1e-12)
    u = np.sqrt(np.arctan2(sin, h.z) * 2 / np.pi)
    pdf = 0.5 / (2 * np.pi**2 * u * sin) / (4 * np.maximum(dot(wo, h), 1e-9))
    pdf += 0.5 * np.maximum(wi.z, 0) / np.pi
    value = evaluate(case, wi, wo) * np.maximum(wi.z, 0) / pdf
    return value.mean(axis=1), value.std(axis=1) / np.sqrt(count)


@each_case
def test_albedo_against_monte_carlo(case: Case) -> None:
    from burnish.materials.coefficients import albedo

    d = albedo(case.layer, case.state)
    mean, sigma = mixture_albedo(case, 400_000)
    # 4 standard errors (6e-5 by chance) and the bins' and fits' own 5e-4
    assert (np.abs(d - mean) <= 4 * sigma + 5e-4 * mean).all(), (d, mean, sigma)


def corners(model: Model) -> list[dict[str, Any]]:
    """Every parameter at its least and its greatest, the others at their defaults."""
    base = {p.name: p.validate(p.default) for p in model.parameters}
    if "color" in base:
        base["color"] = (1.0, 1.0, 1.0)
    ends = [(p, end) for p in model.parameters for end in (p.minimum, p.maximum)]
    return [base, *({**base, p.name: p.validate(end)} for p, end in ends)]


UNBOUNDED = (BeardMaxwellSurface, BeardMaxwellVolume, Measured, PrincipledBase, TorranceSparrow)
"""Models whose papers do not conserve energy, as their docstrings say."""


@each_case
def test_no_more_light_out_than_in(case: Case) -> None:
    from burnish.materials.coefficients import albedo, directional_albedo

    if isinstance(case.model, UNBOUNDED):
        return
    excess = 3e-2 if isinstance(case.model, OrenNayar) else 2e-3
    for values in corners(case.model):
        for layer in (case.layer, Layer.starting_at("layer", case.model, values, delta=False)):
            state = LayerState(values)
            assert albedo(layer, state).max() <= 1 + 1e-3, values
        # Exact where the layer starts; coarse Fresnel terms may overshoot far from there
        cos, directional = directional_albedo(layer, state)
        assert directional[cos > 0.1].max() <= 1 + excess, values


@each_case
def test_numpy_equals_drjit(case: Case) -> None:
    mi = pytest.importorskip("mitsuba")
    from burnish.scene.device import activate

    activate()
    from burnish.scene.maths import drjit_maths

    rng = np.random.default_rng(5)
    wi, wo = directions(rng, 4096), directions(rng, 4096)
    wi = Vector(*(np.float32(a).astype(float) for a in wi))
    wo = Vector(*(np.float32(a).astype(float) for a in wo))
    device = [mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in w)) for w in (wi, wo)]
    layer, state = case.layer, case.state
    # Frozen numbers arrive as per-lane arrays inside a kernel
    fixed = {k: mi.Float(np.full(4096, v, np.float32)) for k, v in layer.fixed.items()}
    values = {k: list(v) if isinstance(v, tuple) else v for k, v in state.values.items()}
    model = case.model
    # Boxes of two curves are whole numbers, which rounding tells apart at their edges
    angles = model.coordinates if isinstance(model, TwoCurves) else _alone(model.coordinate)
    pairs = [
        *zip(
            angles(numpy_maths, wi, wo, layer.fixed),
            angles(drjit_maths, *device, fixed),
            strict=True,
        ),
        *zip(
            case.model.quotients(numpy_maths, wi, wo, layer.fixed),
            case.model.quotients(drjit_maths, *device, fixed),
            strict=True,
        ),
        *zip(
            case.model.evaluate(numpy_maths, wi, wo, {**layer.fixed, **values}),
            case.model.evaluate(drjit_maths, *device, {**fixed, **values}),
            strict=True,
        ),
    ]
    for expected, found in pairs:
        expected = np.broadcast_to(expected, 4096)
        # Single precision, magnified by exponents of up to 200
        np.testing.assert_allclose(
            np.asarray(found), expected, rtol=2e-4, atol=2e-6 * np.abs(expected).max()
        )


def _alone(function: Callable[..., Any]) -> Callable[..., tuple[Any]]:
    return lambda *arguments: (function(*arguments),)


@each_case
def test_energy_table_takes_well_under_a_second(case: Case) -> None:
    table = energy_table(case.layer)
    assert table.weight.sum() == pytest.approx(1.0, abs=1e-12)
    assert (table.density[:, 0] >= 0).all()


def test_half_angle_inverts_the_coordinate() -> None:
    rng = np.random.default_rng(6)
    for case in CASES.values():
        if case.model.lobe != "half" or case.model.inverse != "half":
            continue
        # Not so near φ = 0 that cosθh = cosγ^(1/sin²φ) falls below the model's 1e-6
        t, phi = rng.uniform(0.02, 0.9, 500), rng.uniform(0.7, 1.4, 500)
        fixed = case.layer.fixed
        theta, density = case.model.half_angle(t, phi, fixed)
        h = Vector(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
        np.testing.assert_allclose(
            case.model.coordinate(numpy_maths, h, h, fixed), t, rtol=1e-6, atol=1e-7
        )
        step = 1e-6
        higher, _ = case.model.half_angle(t + step, phi, fixed)
        slope = (np.cos(theta) - np.cos(higher)) / step
        np.testing.assert_allclose(density, slope, rtol=1e-3, atol=1e-6)


# -- second sources --------------------------------------------------------------------------


def ashikhmin_shirley_2000(wi: Any, wo: Any, nu: float, nv: float, rs: float) -> np.ndarray:
    """Ashikhmin and Shirley 2000, eq. 4, written out with angles as in 2006, eq. 11."""
    result = []
    for i in range(len(wi.z)):
        a, b = np.array([wi.x[i], wi.y[i], wi.z[i]]), np.array([wo.x[i], wo.y[i], wo.z[i]])
        h = (a + b) / np.linalg.norm(a + b)
        theta_h, phi_h = math.acos(h[2]), math.atan2(h[1], h[0])
        theta_d = math.acos(min(1.0, float(a @ h)))
        exponent = nu * math.cos(phi_h) ** 2 + nv * math.sin(phi_h) ** 2
        fresnel = rs + (1 - rs) * (1 - math.cos(theta_d)) ** 5
        result.append(
            math.sqrt((nu + 1) * (nv + 1))
            / (8 * math.pi)
            * math.cos(theta_h) ** exponent
            / (math.cos(theta_d) * max(a[2], b[2]))
            * fresnel
        )
    return np.array(result)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 7.0])
def test_ashikhmin_shirley_against_the_paper(ratio: float) -> None:
    rng = np.random.default_rng(7)
    wi, wo = directions(rng, 300), directions(rng, 300)
    nu = 60.0
    by_ratio = Case(AshikhminShirleyRatio(), {"color": COLOUR, "ratio": ratio, "exponent": nu})
    by_width = Case(AshikhminShirleyWidth(), {"color": COLOUR, "ratio": ratio, "exponent": nu})
    for channel, rs in enumerate(COLOUR):
        paper = ashikhmin_shirley_2000(wi, wo, nu, ratio * nu, rs)
        for case in (by_ratio, by_width):
            np.testing.assert_allclose(
                evaluate(case, wi, wo)[channel], paper, rtol=1e-7, atol=1e-15
            )


def test_ratio_edit_from_another_start_is_exact() -> None:
    """2008, eq. 33: nothing that depends on r is in the quotient."""
    rng = np.random.default_rng(8)
    wi, wo = directions(rng, 2000), directions(rng, 2000)
    start = Case(AshikhminShirleyRatio(), {"color": COLOUR, "ratio": 1.0, "exponent": 60.0})
    edited = Case(AshikhminShirleyRatio(), {"color": COLOUR, "ratio": 5.0, "exponent": 60.0})
    np.testing.assert_allclose(
        product_form(start, wi, wo, edited.state), evaluate(edited, wi, wo), rtol=1e-7, atol=1e-14
    )


def test_blinn_phong_against_the_formula() -> None:
    rng = np.random.default_rng(9)
    wi, wo = directions(rng, 500), directions(rng, 500)
    n = 80.0
    h = np.stack(wi) + np.stack(wo)
    cos = h[2] / np.linalg.norm(h, axis=0)
    giesen = (n + 2) * (n + 4) / (8 * math.pi * (2 ** (-n / 2) + n))
    expected = np.array(COLOUR)[:, None] * giesen * cos**n
    np.testing.assert_allclose(evaluate(CASES["blinn"], wi, wo), expected, rtol=1e-9, atol=1e-14)


def test_schlick_split_equals_the_product() -> None:
    """2008, eq. 31–32: two single-curve layers add up to F times the lobe, for every F0."""
    rng = np.random.default_rng(10)
    wi, wo = directions(rng, 2000), directions(rng, 2000)
    start = CASES["schlick-ggx"]
    for colour in ((0.0, 0.02, 0.04), (0.9, 0.5, 1.0)):
        edited = Case(start.model, {**start.values, "color": colour})
        cos_d = dot(wi, half_vector(numpy_maths, wi, wo))
        lobe = evaluate(Case(start.model, {**start.values, "color": (1.0, 1.0, 1.0)}), wi, wo)
        f0 = np.array(colour)[:, None]
        product = lobe * (f0 + (1 - f0) * (1 - cos_d) ** 5)
        np.testing.assert_allclose(
            product_form(start, wi, wo, edited.state), product, rtol=1e-9, atol=1e-12
        )
