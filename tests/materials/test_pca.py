"""Models by principal components: the 2010 paper's formulae, its figure 5, and layers of them."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.materials.coefficients import albedo, directional_albedo
from burnish.materials.layer import Layer, LayerState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.pca.model import ComponentModel
from burnish.materials.pca.models import (
    SIX,
    AshikhminShirleyComponents,
    BlinnPhongComponents,
    CookTorranceComponents,
    LafortuneComponents,
    WardComponents,
    WardDuerComponents,
)
from burnish.materials.pca.term import TermBasis, papers_sampling, term_basis
from burnish.materials.reflectance import sample_directions
from burnish.materials.registry import model_from_json, model_to_json

COLOUR = (0.1, 0.5, 1.0)
FROZEN = {"f0": 0.2, "cxy": -0.9, "cz": 0.7}
each_model = pytest.mark.parametrize("kind", SIX, ids=lambda kind: kind.name)


def pairs(count: int, seed: int, lowest: float = 0.05) -> tuple[Vector, Vector]:
    """Half of the pairs anywhere, half near the mirror direction."""
    rng = np.random.default_rng(seed)
    z, phi = rng.uniform(lowest, 1, (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    sin = np.sqrt(1 - z * z)
    w = np.stack([sin * np.cos(phi), sin * np.sin(phi), z], axis=1)
    near = w[1] * np.array([[-1], [-1], [1]]) + 0.1 * rng.standard_normal((3, count))
    near[2] = np.maximum(near[2], lowest)
    w[0, :, ::2] = (near / np.linalg.norm(near, axis=0))[:, ::2]
    return Vector(*w[0]), Vector(*w[1])


def starting(kind: type[ComponentModel], gamma: float | None = None) -> tuple[Layer, LayerState]:
    model = kind()
    values = {"color": COLOUR, model.gamma: model.edited.default if gamma is None else gamma}
    frozen = {p.name: FROZEN[p.name] for p in model.fixed_parameters}
    return Layer.starting_at("specular", model, {**values, **frozen}), LayerState(values)


def spread(model: ComponentModel, count: int) -> np.ndarray:
    return np.geomspace(model.edited.minimum, model.edited.maximum, count)


def table_3(kind: type[ComponentModel], lamp: np.ndarray, eye: np.ndarray, gamma: float) -> float:
    """The paper's table 3 for one pair of directions, ρs = 1, in plain arithmetic."""
    n = np.array([0.0, 0.0, 1.0])
    h = (lamp + eye) / np.linalg.norm(lamp + eye)
    nl, nv, nh, vh = float(n @ lamp), float(n @ eye), float(n @ h), float(eye @ h)
    delta = math.acos(min(nh, 1.0))
    fresnel = FROZEN["f0"] + (1 - FROZEN["f0"]) * (1 - vh) ** 5
    hill = math.exp(-(math.tan(delta) ** 2) / gamma**2)
    if kind is BlinnPhongComponents:
        return (gamma + 2) / (2 * math.pi) * math.cos(delta) ** gamma
    if kind is WardComponents:
        return hill / (4 * math.pi * gamma**2) / math.sqrt(nl * nv)
    if kind is WardDuerComponents:
        return hill / (4 * math.pi * gamma**2) / (nl * nv)
    if kind is LafortuneComponents:
        c = np.array([FROZEN["cxy"], FROZEN["cxy"], FROZEN["cz"]])
        lobe = max(float((c * lamp * eye).sum()), 0.0) ** gamma
        return (gamma + 2) * lobe / (2 * math.pi * np.abs(c).max() ** gamma)
    if kind is CookTorranceComponents:
        g = min(1.0, 2 * nh * nv / vh, 2 * nh * nl / vh)
        d = hill / (gamma**2 * math.cos(delta) ** 4)
        return d * g / (math.pi * nl * nv) * fresnel
    assert kind is AshikhminShirleyComponents
    return (gamma + 1) / (8 * math.pi) * nh**gamma / (vh * max(nl, nv)) * fresnel


# -- the models ------------------------------------------------------------------------------


@each_model
def test_the_paper_s_formulae(kind: type[ComponentModel]) -> None:
    wi, wo = pairs(300, 1)
    for gamma in spread(kind(), 3):
        layer, state = starting(kind, gamma)
        found = np.stack(layer.model.evaluate(numpy_maths, wi, wo, {**layer.fixed, **state.values}))
        both = np.stack([np.stack(wi, 1), np.stack(wo, 1)], axis=1)
        expected = np.array([table_3(kind, a, b, float(gamma)) for a, b in both])
        expected = np.array(COLOUR)[:, None] * expected
        # A power is cut at a cosine of 1e-6, where it is below 1e-18
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15 * expected.max())


@each_model
def test_reciprocal_not_negative_and_dark_below(kind: type[ComponentModel]) -> None:
    wi, wo = pairs(5000, 2)
    below = Vector(wi.x, wi.y, -wi.z)
    for gamma in spread(kind(), 4):
        layer, state = starting(kind, gamma)
        values = {**layer.fixed, **state.values}
        there, back, dark = (
            np.stack(layer.model.evaluate(numpy_maths, *pair, values))
            for pair in ((wi, wo), (wo, wi), (below, wo))
        )
        assert (there >= 0).all()
        assert not dark.any()
        np.testing.assert_allclose(there, back, rtol=1e-9, atol=1e-15)


MOST = {
    BlinnPhongComponents: 4.0,
    WardComponents: 1.0,
    WardDuerComponents: 1.0,
    LafortuneComponents: 1.0,
    CookTorranceComponents: 4.0,
    AshikhminShirleyComponents: 1.0,
}
"""What the models reflect of uniform light at most, in terms of ρs, as their manuals say."""


@each_model
def test_reflects_no_more_than_its_manual_says(kind: type[ComponentModel]) -> None:
    for gamma in spread(kind(), 9):
        layer, state = starting(kind, gamma)
        assert (albedo(layer, state) <= MOST[kind] * np.array(COLOUR) + 1e-3).all()


@each_model
def test_albedo_against_monte_carlo(kind: type[ComponentModel]) -> None:
    """∫ ρ cosθi dωi at an outgoing direction, half vectors drawn over θ = (π/2) u²."""
    rng = np.random.default_rng(3)
    count = 400_000
    layer, state = starting(kind)
    cos, found = directional_albedo(layer, state)
    for at in (6, 15):
        mu = float(cos[at])
        wo = Vector(math.sqrt(1 - mu * mu), 0.0, mu)
        u, phi = rng.random(count), rng.random(count) * 2 * np.pi
        theta = np.pi / 2 * u * u
        h = Vector(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
        d = wo.x * h.x + wo.z * h.z
        wi = Vector(2 * d * h.x - wo.x, 2 * d * h.y, 2 * d * h.z - wo.z)
        pdf = 1 / (2 * np.pi**2 * u * np.sin(theta)) / (4 * np.maximum(d, 1e-9))
        lit = (wi.z > 0) & (d > 0)
        up = Vector(wi.x, wi.y, np.where(lit, wi.z, 0.0))
        value = layer.model.evaluate(numpy_maths, up, wo, {**layer.fixed, **state.values})[2]
        value = np.where(lit, value * wi.z / pdf, 0.0)
        sigma = value.std() / math.sqrt(count)
        # 4 standard errors, and the components' worst error of one member
        assert abs(found[at, 2] - value.mean()) <= 4 * sigma + 3e-3 * value.mean()


# -- the components --------------------------------------------------------------------------


def figure_5() -> tuple[TermBasis, float]:
    """Blinn-Phong for γ in [3, 300], as in the paper; and the RMS of all members."""
    model = BlinnPhongComponents(error=1e-6)
    x = np.sqrt(np.linspace(0.0, 1.0, 512))
    sampling = papers_sampling(3.0, 300.0, x, 298)
    members = sampling.members(model.term)
    basis = term_basis(members, sampling.weight, 1e-6, alike=False)
    return basis, float(np.sqrt((members**2).mean()))


def test_figure_5() -> None:
    """RMS 2.4e-3, relative 4.3e-4, mean square 5.8e-6 with six; 1.3e-5 RMS with twelve."""
    basis, rms = figure_5()
    assert basis.errors[6] == pytest.approx(4.3e-4, abs=0.05e-4)
    assert basis.errors[6] * rms == pytest.approx(2.4e-3, abs=0.05e-3)
    assert (basis.errors[6] * rms) ** 2 == pytest.approx(5.8e-6, abs=0.05e-6)
    assert basis.errors[12] * rms == pytest.approx(1.3e-5, abs=0.05e-5)


def test_components_are_the_singular_vectors_and_the_projection_is_least_squares() -> None:
    """By NumPy's own decompositions (2010, eq. 11–15)."""
    model = WardComponents()
    x = np.sqrt(np.linspace(0.0, 1.0, 200))
    sampling = papers_sampling(0.05, 2.0, x, 100)
    members = sampling.members(model.term)
    basis = term_basis(members, sampling.weight, 2e-3, alike=False)
    k = len(basis.components)
    rest = members - members.mean(axis=0)
    _, s, vectors = np.linalg.svd(rest, full_matrices=False)
    overlap = basis.components @ vectors[:k].T / np.linalg.norm(basis.components, axis=1)[:, None]
    np.testing.assert_allclose(np.abs(overlap), np.eye(k), atol=1e-5)
    left = np.sqrt((s[k:] ** 2).sum() / (members**2).sum())
    assert basis.errors[k] == pytest.approx(left, rel=1e-4)
    assert basis.errors[k] <= 2e-3 < basis.errors[k - 1]
    p = model.term(0.3, x)
    c, *_ = np.linalg.lstsq(basis.components.T, p - basis.mean, rcond=None)
    np.testing.assert_allclose(basis.project(p), [1.0, *c], rtol=1e-6, atol=1e-9)


@each_model
def test_an_edit_is_as_exact_as_was_asked(kind: type[ComponentModel]) -> None:
    """The relative RMS of the BRDF over parameters and pairs of directions between the nodes."""
    wi, wo, weight = sample_directions()
    squares = {1e-2: [], 1e-3: []}
    for error, found in squares.items():
        model = kind(error=error)
        layer = Layer.starting_at("specular", model, {})
        gammas = np.geomspace(model.edited.minimum, model.edited.maximum, 34)
        for gamma in np.sqrt(gammas[1:] * gammas[:-1]):
            values = {"color": (1.0, 1.0, 1.0), model.gamma: gamma}
            true = model.evaluate(numpy_maths, wi, wo, {**layer.fixed, **values})[0]
            q = np.stack(model.quotients(numpy_maths, wi, wo, layer.fixed))
            gap = model.amplitudes(values, layer.fixed)[:, 0] @ q - true
            found.append(np.sum(weight * gap**2) / np.sum(weight * true**2))
        # The members at both ends count half here
        assert np.sqrt(np.mean(found)) <= 1.1 * error
        assert model.basis.errors[model.rank - 1] <= error < model.basis.errors[model.rank - 2]
    assert kind(error=1e-2).rank < kind(error=1e-3).rank <= 13


@each_model
def test_the_reference_quotient_is_the_mean_and_positive(kind: type[ComponentModel]) -> None:
    wi, wo = pairs(2000, 5)
    layer, _ = starting(kind)
    assert (layer.bins, layer.columns) == (1, layer.model.rank)
    assert layer.with_bins(64).columns == layer.model.rank
    assert (layer.model.quotients(numpy_maths, wi, wo, layer.fixed)[0] >= 0).all()


@each_model
def test_numpy_equals_drjit(kind: type[ComponentModel]) -> None:
    mi = pytest.importorskip("mitsuba")
    from burnish.scene.device import activate

    activate()
    from burnish.scene.maths import drjit_maths

    wi, wo = (Vector(*(np.float32(a).astype(float) for a in w)) for w in pairs(4096, 6))
    device = [mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in w)) for w in (wi, wo)]
    layer, state = starting(kind)
    fixed = {k: mi.Float(np.full(4096, v, np.float32)) for k, v in layer.fixed.items()}
    values = {k: list(v) if isinstance(v, tuple) else v for k, v in state.values.items()}
    model = layer.model
    expected = [
        *model.quotients(numpy_maths, wi, wo, layer.fixed),
        *model.evaluate(numpy_maths, wi, wo, {**layer.fixed, **values}),
    ]
    found = [
        *model.quotients(drjit_maths, *device, fixed),
        *model.evaluate(drjit_maths, *device, {**fixed, **values}),
    ]
    for own, theirs in zip(expected, found, strict=True):
        # Single precision, magnified by the steepest components between nodes
        np.testing.assert_allclose(
            np.asarray(theirs), own, rtol=1e-3, atol=1e-4 * np.abs(own).max()
        )


def test_round_trip_and_bad_choices() -> None:
    model = LafortuneComponents(error=5e-3)
    assert model_from_json(json.loads(json.dumps(model_to_json(model)))) == model
    with pytest.raises(InvalidValue, match=r"error must lie in \[1e-6, 0.5\]; got 0"):
        WardComponents(error=0.0)
    layer, _ = starting(LafortuneComponents)
    with pytest.raises(InvalidValue, match=r"cz must lie in \[0.05, 1\]"):
        Layer.starting_at("specular", layer.model, {"cz": 0.0})


def test_values_of_another_model_carry_over() -> None:
    from burnish.materials.layer import Material, MaterialState
    from burnish.materials.models.ward import WardWidth
    from burnish.materials.replacement import choices, replaced

    assert {kind.name for kind in SIX} <= choices().keys()
    values: dict[str, Any] = {"color": COLOUR, "roughness": 0.2}
    layer = Layer.starting_at("specular", WardWidth(), values)
    material = Material((layer,), MaterialState({"specular": LayerState(values)}))
    state = replaced(material, material.initial, "specular", "ward-pca", 64)
    assert state.layers["specular"].values == values
    now = material.as_in(state).layer("specular")
    assert now.bins == 1
    np.testing.assert_allclose(
        albedo(now, state.layers["specular"]),
        albedo(layer, material.initial.layers["specular"]),
        rtol=5e-3,
    )
    state = replaced(material, state, "specular", "blinn-phong-pca", 64)
    assert state.layers["specular"].values["exponent"] == pytest.approx(48.0)


# -- layers in a bake ------------------------------------------------------------------------


@each_model
def test_columns_count_by_what_multiplies_them(kind: type[ComponentModel]) -> None:
    """Their RMS over the members, each scaled to a size of one, by another way round."""
    model = kind()
    sampling = model.sampling()
    squares = np.zeros(model.rank)
    for gamma in sampling.gammas:
        member = model.term(gamma, sampling.x)
        c = model.amplitudes({"color": (1.0, 1.0, 1.0), model.gamma: gamma}, {})[:, 0]
        squares += c**2 / np.sum(sampling.weight * member**2)
    expected = np.sqrt(squares / len(sampling.gammas))
    np.testing.assert_allclose(model.amplitude_sizes(), expected, rtol=1e-9)


def test_a_baked_sphere_against_the_path_tracer() -> None:
    pytest.importorskip("mitsuba")
    import burnish
    from burnish.materials.layer import Material, MaterialState

    layer, state = starting(BlinnPhongComponents, 30.0)
    state = LayerState({**state.values, "color": (0.2, 0.2, 0.2)})
    material = Material((layer,), MaterialState({"specular": state}))
    scene = burnish.load("sphere", materials={"sphere": material}, resolution=(16, 16))
    session = burnish.edit(burnish.bake(scene, editable=["sphere"], series=(64, 1), spp=1024))
    for exponent in (3.0, 30.0, 100.0):
        session.set("sphere.specular.exponent", exponent)
        image = session.frame()
        truth = burnish.path_trace(scene, session.materials, spp=4096, bounces=2)
        # Two seeds of the truth are 3 % apart, and the bake has a quarter of its samples
        assert np.linalg.norm(image - truth) <= 0.06 * np.linalg.norm(truth)
        assert image.min() >= 0
