"""`LayeredBSDF`: its sampler draws what it says, and its value is the model's."""

from __future__ import annotations

import json
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from burnish.materials.curve import Curve
from burnish.materials.layer import Material, MaterialState
from burnish.materials.maths import numpy_maths
from burnish.materials.models.ashikhmin_shirley import AshikhminShirleyRatio
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance import CookTorrance
from burnish.materials.models.lambert import Lambert
from burnish.materials.registry import material_to_json, state_to_json
from burnish.reference import layered_bsdf, layered_class
from burnish.reference.bsdf import reflecting_bsdf
from burnish.reference.reflectance import CoarseReflectance, FineReflectance, MatteReflectance
from tests.reference.worlds import blinn, direction, edited, lambert, material

RED = (0.6, 0.2, 0.1)
GREY = (0.4, 0.4, 0.4)
CURVE = Curve(
    (0.0, 0.1, 0.5, 1.0), ((9.0,) * 3, (0.5,) * 3, (0.4, 0.0, 0.1), (0.0,) * 3), "replace"
)


def rough(alpha: float) -> Material:
    values = {"color": GREY, "roughness": alpha}
    return material(
        ("diffuse", Lambert(), {"color": RED}), ("specular", CookTorrance(), values), delta=True
    )


def anisotropic() -> Material:
    values = {"color": GREY, "ratio": 8.0, "exponent": 30.0}
    return material(("specular", AshikhminShirleyRatio(), values))


def cases() -> dict[str, Any]:
    glossy = blinn(RED, GREY, 40.0)
    sharp = blinn(RED, GREY, 2000.0)
    curved = edited(glossy.initial, "specular", curve=CURVE)
    smooth, brushed = rough(0.0), anisotropic()
    return {
        "lambert": layered_bsdf(lambert(RED), lambert(RED).initial),
        "blinn": layered_bsdf(glossy, glossy.initial),
        "blinn, sharp": layered_bsdf(sharp, sharp.initial),
        "curve": layered_bsdf(glossy, curved),
        "ggx": layered_bsdf(rough(0.1), rough(0.1).initial),
        "anisotropic": layered_bsdf(brushed, brushed.initial),
        "two-sided": layered_bsdf(glossy, glossy.initial, two_sided=True),
        "smooth": layered_bsdf(smooth, smooth.initial),
        "fine": reflecting_bsdf(FineReflectance(glossy, curved, {}), False),
        "coarse": reflecting_bsdf(CoarseReflectance(glossy, glossy.initial, {}, 8), False),
        "matte": reflecting_bsdf(MatteReflectance(glossy, glossy.initial, {}), True),
    }


NAMES = (
    *("lambert", "blinn", "blinn, sharp", "curve", "ggx", "anisotropic"),
    *("two-sided", "smooth", "fine", "coarse", "matte"),
)


@pytest.fixture(scope="module")
def bsdfs() -> dict[str, Any]:
    return cases()


def interaction(wo: Any, lanes: int = 1) -> Any:
    si = dr.zeros(mi.SurfaceInteraction3f, lanes)
    si.wi = dr.normalize(mi.Vector3f(*map(float, wo)))
    return si


@pytest.mark.parametrize("wo", [(0.0, 0.0, 1.0), (0.5, 0.2, 0.7), (0.9, -0.3, 0.2)])
@pytest.mark.parametrize("name", NAMES)
def test_directions_have_the_density_that_pdf_says(
    bsdfs: dict[str, Any], name: str, wo: tuple[float, float, float]
) -> None:
    bsdf, context = bsdfs[name], mi.BSDFContext()
    if name == "two-sided":
        wo = (wo[0], wo[1], -wo[2])

    def sample(u: Any) -> tuple[Any, Any]:
        bs, _ = bsdf.sample(context, interaction(wo, dr.width(u)), u[0], mi.Point2f(u[1], u[2]))
        solid = ~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
        return bs.wo, dr.select(solid & (bs.pdf > 0), 1.0, 0.0)

    def pdf(wi: Any) -> Any:
        return bsdf.pdf(context, interaction(wo, dr.width(wi)), wi)

    test = mi.chi2.ChiSquareTest(
        domain=mi.chi2.SphericalDomain(),
        sample_func=sample,
        pdf_func=pdf,
        sample_dim=3,
        sample_count=400_000,
        res=71,
        ires=32,
        seed=3,
    )
    # Two hundred times this many tests would fail once by chance
    assert test.run(significance_level=0.01, test_count=len(NAMES) * 3, quiet=True), test.messages


@pytest.mark.parametrize("name", NAMES)
def test_a_sample_s_weight_is_value_over_density(bsdfs: dict[str, Any], name: str) -> None:
    bsdf, context, lanes = bsdfs[name], mi.BSDFContext(), 4096
    rng = mi.PCG32(lanes)
    si = interaction((0.4, 0.3, 0.6), lanes)
    u = [rng.next_float32() for _ in range(3)]
    bs, weight = bsdf.sample(context, si, u[0], mi.Point2f(u[1], u[2]))
    value, pdf = bsdf.eval_pdf(context, si, bs.wo)
    solid = np.asarray(~mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta) & (bs.pdf > 0))
    expected = np.asarray(value / pdf)[:, solid]
    # The reflected direction is recomputed from float32 vectors
    np.testing.assert_allclose(np.asarray(weight)[:, solid], expected, rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(
        np.asarray(bs.pdf)[solid], np.asarray(pdf)[solid], rtol=2e-2, atol=1e-6
    )
    apart = bsdf.eval(context, si, bs.wo), bsdf.pdf(context, si, bs.wo)
    np.testing.assert_array_equal(np.asarray(apart[0]), np.asarray(value))
    np.testing.assert_array_equal(np.asarray(apart[1]), np.asarray(pdf))


def reflectance(item: Material, state: MaterialState, wi: Any, wo: Any) -> np.ndarray:
    result = np.zeros(3)
    for layer in item.layers:
        values = {**state.layers[layer.name].values, **layer.fixed}
        result += np.array(layer.model.evaluate(numpy_maths, wi, wo, values))
    return result


def evaluate(bsdf: Any, wi: Any, wo: Any) -> np.ndarray:
    si = interaction((wo.x, wo.y, wo.z))
    return np.asarray(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*map(float, wi)))).ravel()


@pytest.mark.parametrize(
    "item", [blinn(RED, GREY, 40.0), rough(0.2), anisotropic()], ids=["blinn", "ggx", "brushed"]
)
def test_the_value_is_the_model_s_own_formula(item: Material) -> None:
    bsdf = layered_bsdf(item, item.initial)
    for theta_i, theta_o, phi in ((0.1, 0.2, 2.0), (0.9, 0.8, 3.1), (1.4, 0.3, 0.5)):
        wi, wo = direction(theta_i, phi), direction(theta_o, 0.0)
        expected = reflectance(item, item.initial, wi, wo) * wi.z
        np.testing.assert_allclose(evaluate(bsdf, wi, wo), expected, rtol=2e-5)


def test_a_curve_of_the_profile_s_own_shape_changes_nothing() -> None:
    """Gain 1 everywhere: quotient × profile must be the formula again (Blinn splits exactly)."""
    item = blinn(RED, GREY, 40.0)
    unity = Curve((0.0, 1.0), ((1.0,) * 3, (1.0,) * 3), "gain")
    bsdf = layered_bsdf(item, edited(item.initial, "specular", curve=unity))
    for theta_i, theta_o, phi in ((0.1, 0.2, 2.0), (0.9, 0.8, 3.1)):
        wi, wo = direction(theta_i, phi), direction(theta_o, 0.0)
        expected = reflectance(item, item.initial, wi, wo) * wi.z
        np.testing.assert_allclose(evaluate(bsdf, wi, wo), expected, rtol=1e-4)


def test_weights_and_switches_scale_layers() -> None:
    item = blinn(RED, GREY, 40.0)
    wi, wo = direction(0.4, 3.0), direction(0.5, 0.0)
    full = evaluate(layered_bsdf(item, item.initial), wi, wo)
    off = edited(item.initial, "specular", enabled=False)
    half = edited(item.initial, "specular", weight=0.5)
    matte = np.array(RED) / np.pi * wi.z
    np.testing.assert_allclose(evaluate(layered_bsdf(item, off), wi, wo), matte, rtol=1e-5)
    np.testing.assert_allclose(
        evaluate(layered_bsdf(item, half), wi, wo), (full + matte) / 2, rtol=1e-5
    )


def test_the_back_is_black_unless_two_sided() -> None:
    item = blinn(RED, GREY, 40.0)
    below = [direction(np.pi - theta, 0.3) for theta in (0.3, 0.6)]
    above = [direction(theta, 0.3) for theta in (0.3, 0.6)]
    one, two = (layered_bsdf(item, item.initial, two_sided=both) for both in (False, True))
    assert not evaluate(one, *below).any()
    np.testing.assert_allclose(evaluate(two, *below), evaluate(two, *above), rtol=1e-6)
    assert not evaluate(two, below[0], above[0]).any()


def test_a_smooth_layer_is_a_mirror() -> None:
    item = rough(0.0)
    bsdf, lanes = layered_bsdf(item, item.initial), 100_000
    rng = mi.PCG32(lanes)
    u = [rng.next_float32() for _ in range(3)]
    si = interaction((0.6, 0.0, 0.8), lanes)
    bs, weight = bsdf.sample(mi.BSDFContext(), si, u[0], mi.Point2f(u[1], u[2]))
    smooth = np.asarray(mi.has_flag(bs.sampled_type, mi.BSDFFlags.DeltaReflection))
    np.testing.assert_allclose(
        np.asarray(bs.wo)[:, smooth],
        np.array([[-0.6], [0.0], [0.8]]) * np.ones(smooth.sum()),
        atol=1e-6,
    )
    # Schlick's reflectance, spread over the share of samples that go there
    fresnel = 0.4 + 0.6 * (1 - 0.8) ** 5
    share = np.asarray(bs.pdf)[smooth]
    np.testing.assert_allclose(np.asarray(weight)[0, smooth] * share, fresnel, rtol=1e-4)
    assert abs(smooth.mean() - share[0]) < 5 * np.sqrt(share[0] / lanes)


def test_the_plugin_is_registered_and_reads_json() -> None:
    layered_class()
    item = blinn(RED, GREY, 40.0)
    state = edited(item.initial, "specular", exponent=90.0)
    bsdf = mi.load_dict(
        {
            "type": "burnish",
            "material": json.dumps(material_to_json(item)),
            "state": json.dumps(state_to_json(state)),
            "two_sided": True,
        }
    )
    wi, wo = direction(0.4, 3.0), direction(0.5, 0.0)
    expected = reflectance(item, state, wi, wo) * wi.z
    np.testing.assert_allclose(evaluate(bsdf, wi, wo), expected, rtol=2e-5)
    assert "specular" in str(bsdf)


def test_projection_is_exact_where_the_curve_is_constant_in_each_bin() -> None:
    """With a curve constant per bin, the fine form and the material are the same BRDF."""
    item = material(("specular", BlinnPhong(), {"color": GREY, "exponent": 5.0}), bins=4)
    layer = item.layers[0]
    edges, levels, points, values = layer.edges, (3.0, 1.0, 0.4, 0.1), [], []
    for j, level in enumerate(levels):
        points += [float(edges[j]) + 1e-6, float(edges[j + 1]) - 1e-6]
        values += [(level,) * 3] * 2
    curve = Curve(tuple(points), tuple(values), "replace", "linear")
    state = edited(item.initial, "specular", curve=curve)
    true, fine = layered_bsdf(item, state), reflecting_bsdf(FineReflectance(item, state, {}), False)
    for theta_i, phi in ((0.1, 2.0), (0.9, 3.1), (1.2, 0.4), (1.4, 1.7)):
        wi, wo = direction(theta_i, phi), direction(0.3, 0.0)
        np.testing.assert_allclose(evaluate(fine, wi, wo), evaluate(true, wi, wo), rtol=1e-3)
