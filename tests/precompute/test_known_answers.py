"""The path tracer where the answer is known without one."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from burnish.core.types import Float64
from burnish.materials.coefficients import coefficients, directional_albedo, energies
from burnish.materials.layer import Material, MaterialState
from burnish.materials.models.cook_torrance import CookTorranceConductor
from burnish.precompute.plan import basis_for
from burnish.scene import Scene
from burnish.transport.basis import initial_state
from tests.precompute.pictures import accumulator, against, clear, pictures, polynomial
from tests.reference.worlds import SKY, blinn, camera, edited, lambert, material, plane, world

GREY, RED = (0.5, 0.5, 0.5), (0.6, 0.2, 0.1)
WHITE = (1.0, 1.0, 1.0)


def far(cosine: float, scale: float = 0.02) -> dict[str, Any]:
    """An orthographic camera that looks at the origin from θo: every pixel has the same."""
    sine = float(np.sqrt(1 - cosine**2))
    T = mi.ScalarTransform4f()
    return {
        "type": "orthographic",
        "to_world": T.look_at(
            origin=(4 * sine, 0, 4 * cosine), target=(0, 0, 0), up=(0, 1, 0)
        ).scale([scale, scale, 1]),
        "film": {"type": "hdrfilm", "rfilter": {"type": "box"}},
    }


def mirror(roughness: float, delta: bool = True) -> Material:
    """A metal that reflects all that reaches it (k = 1 and η = 0 is Mitsuba's "none")."""
    values = {
        "color": (0.9, 0.6, 0.3),
        "roughness": roughness,
        "eta": (0.0, 0.0, 0.0),
        "k": (1.0, 1.0, 1.0),
    }
    return material(("specular", CookTorranceConductor("ggx"), values), bins=64, delta=delta)


# -- furnaces ---------------------------------------------------------------------------------


@pytest.mark.parametrize("bounces", [1, 4])
def test_a_white_sphere_vanishes_in_a_white_world(bounces: int) -> None:
    scene = world(
        {
            "ball": {"type": "sphere", "bsdf": {"type": "diffuse"}},
            "sky": SKY,
            "view": camera((0, -4, 0), (0, 0, 0), fov=40),
        },
        {"ball": lambert(WHITE)},
    )
    basis = basis_for(scene, None, (1,) * bounces)
    picture = pictures(scene, basis, spp=1024)[0]
    seen = picture.mean + picture.emission
    np.testing.assert_allclose(seen.mean(), 1, rtol=2e-3)
    # Edge pixels see part of the sky directly; there the two parts are correlated
    inside = picture.emission.max(axis=-1) == 0
    z = (picture.mean - 1)[inside] / np.sqrt(picture.variance[inside])
    assert np.abs(z).max() < 5
    assert abs(z.mean()) * np.sqrt(z.size) < 4


def test_a_closed_box_of_lamps_is_a_geometric_series() -> None:
    """All walls emit 1 − d and reflect d: L = 1 − dⁿ⁺¹ after n bounces, everywhere."""
    d = np.array([0.8, 0.5, 0.0])
    emitted = 1 - d
    scene = world(
        {
            "box": {
                "type": "cube",
                "flip_normals": True,
                "bsdf": {"type": "diffuse"},
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": emitted.tolist()}},
            },
            "view": camera((-0.5, -0.5, 0.3), (0.6, 0.4, 0), fov=60),
        },
        {"box": lambert(tuple(d))},
        resolution=(8, 8),
    )
    for series in ((1,), (1, 1, 1, 1), (1, 1, 1, 1, 1, 1)):
        picture = pictures(scene, basis_for(scene, None, series), spp=512, per_pass=64)[0]
        expected = 1 - d ** (len(series) + 1) - emitted
        result = against(picture, expected)
        assert result.passed, str(result)
        # Where nothing is reflected the answer is exactly zero
        assert not picture.mean[..., 2].any()


# -- one plane under a constant sky -----------------------------------------------------------


def single_plane(item: Material, cosine: float) -> Scene:
    return world(
        {"floor": plane(size=2.0), "sky": SKY, "view": far(cosine)},
        {"floor": item},
        resolution=(8, 8),
    )


def test_every_column_is_its_bin_s_energy() -> None:
    """T of column j under a sky of 1 is ∫ q b_j cosθ dω, at a node of the quadrature."""
    item = blinn(RED, GREY, 40.0, bins=16)
    layer = item.layer("specular")
    cosines, _, expected = energies(layer)
    node = len(cosines) * 2 // 3
    scene = single_plane(item, float(cosines[node]))
    basis = basis_for(scene, None, (16,))
    tensor = accumulator(scene, basis)
    passes = []
    for number in range(32):
        clear(tensor)
        tensor.run(256, number)
        passes.append(tensor.transport()[0].mean(axis=(0, 2, 3)))
    T, sigma = np.mean(passes, axis=0), np.std(passes, axis=0, ddof=1) / np.sqrt(len(passes))
    own = basis.slices(0)[1]
    assert (np.abs(T[own.start : own.stop] - expected[node, 0]) <= 5 * sigma[1:] + 1e-6).all()
    assert (sigma[1:] <= 0.02 * expected[node, 0] + 1e-6).all()
    # The colour is in the coefficient, so Lambert's column is the energy of 1/π
    np.testing.assert_allclose(T[0], 1, rtol=0.005)


def directional(item: Material, state: MaterialState, layer: str, cosine: float) -> Float64:
    """Directional albedo of a layer as its bins have it: float64 [3]."""
    cosines, albedos = directional_albedo(item.layer(layer), state.layers[layer])
    return np.array([np.interp(cosine, cosines, albedos[:, h]) for h in range(3)])


@pytest.mark.parametrize("node", [2, 10, 21])
@pytest.mark.parametrize(
    "item",
    [blinn(RED, GREY, 40.0), blinn(RED, GREY, 1000.0), mirror(0.2), mirror(0.02), mirror(0.0)],
    ids=["exponent 40", "exponent 1000", "alpha 0.2", "alpha 0.02", "smooth"],
)
def test_a_plane_under_the_sky_shows_its_directional_albedo(item: Material, node: int) -> None:
    cosine = float(energies(item.layers[0])[0][node])
    scene = single_plane(item, cosine)
    picture = pictures(scene, basis_for(scene, None, (64,)), spp=1024, per_pass=64)[0]
    expected = np.zeros(3)
    for layer in item.layers:
        expected += directional(item, item.initial, layer.name, cosine)
    sigma = np.sqrt(picture.variance.mean(axis=(0, 1)) / 64)
    assert (np.abs(picture.mean.mean(axis=(0, 1)) - expected) < 4 * sigma + 1e-4 * expected).all()
    assert (sigma < 0.015 * expected).all()


def test_an_edit_needs_no_new_samples() -> None:
    """One pass serves every exponent: each shows its own directional albedo."""
    item = blinn((0.0, 0.0, 0.0), WHITE, 40.0)
    scene = single_plane(item, 0.7)
    basis = basis_for(scene, None, (64,))
    tensor = accumulator(scene, basis)
    tensor.run(1024, 5)
    for exponent in (5.0, 40.0, 300.0):
        state = {"floor": edited(item.initial, "specular", exponent=exponent)}
        expected = directional(item, state["floor"], "specular", 0.7)
        assert polynomial(tensor, state).mean() == pytest.approx(expected[0], rel=0.01)


# -- two facing planes ------------------------------------------------------------------------


def test_two_facing_planes_are_a_series_in_their_albedos() -> None:
    """The upper one emits 1: the lower one shows d_l (1 + d_u d_l + …), term by term."""
    size = 3000.0
    scene = world(
        {
            "lower": plane(size=size),
            "upper": plane(z=1.0, size=size, down=True, emitter={"type": "area", "radiance": 1.0}),
            "view": {**camera((0, 0, 0.9), (0.3, 0, 0), fov=30)},
        },
        {"lower": lambert(GREY), "upper": lambert(GREY)},
        resolution=(4, 4),
    )
    basis = basis_for(scene, None, (1,) * 5)
    tensor = accumulator(scene, basis)
    tensor.run(4096, 1)
    # Each monomial of the albedos alone: 1, d_u d_l and (d_u d_l)², and no other
    T = tensor.transport()[0].mean(axis=(0, 1, 3))
    lower, upper = basis.index("lower"), basis.index("upper")
    for exponents, value in zip(basis.monomials.exponents, T, strict=True):
        known = 1.0 if exponents[lower] == exponents[upper] else 0.0
        assert value == pytest.approx(known, abs=0.01)
    # And the picture, with no light at all in one channel and one bounce in another
    state = {
        "lower": edited(initial_state(basis.objects)["lower"], "diffuse", color=(0.8, 0.0, 0.6)),
        "upper": edited(initial_state(basis.objects)["upper"], "diffuse", color=(0.5, 0.7, 0.0)),
    }
    image = polynomial(tensor, state).mean(axis=(0, 1))
    np.testing.assert_allclose(image, [0.8 * (1 + 0.4 + 0.16), 0.0, 0.6], rtol=0.01)
    assert image[1] == 0


# -- mirrors ----------------------------------------------------------------------------------

CHECKS = np.array([[[4, 1, 1], [1, 4, 1]], [[1, 1, 4], [3, 3, 0.5]]], np.float32)
LAMP_SIZE, LAMP_HEIGHT = 1.5, 2.0


def textured_lamp(item: Material) -> Scene:
    """A mirror-like floor under a lamp with a square of four colours."""
    radiance = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(CHECKS),
        "filter_type": "nearest",
        "wrap_mode": "clamp",
        "raw": True,
    }
    return world(
        {
            "floor": plane(size=3.0),
            "lamp": plane(
                z=LAMP_HEIGHT,
                size=LAMP_SIZE,
                down=True,
                emitter={"type": "area", "radiance": radiance},
            ),
            "view": camera((0.2, -3.0, 1.2), (0, 0.4, 0), fov=45),
        },
        {"floor": item},
        resolution=(32, 32),
    )


def reflected_lamp(scene: Scene, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """What a perfect mirror at z = 0 shows at the pixels' centres, by plane geometry.

    Gives radiance [h, w, 3] and where the reflected ray lands at least `margin` away from
    every edge of the picture on the lamp.
    """
    view = scene.view()
    y, x = np.mgrid[: view.height, : view.width]
    u = mi.Point2f(
        mi.Float(((x.ravel() + 0.5) / view.width).astype(np.float32)),
        mi.Float(((y.ravel() + 0.5) / view.height).astype(np.float32)),
    )
    ray, _ = view.sensor.sample_ray(0.0, 0.5, u, mi.Point2f(0.5))
    o, d = (np.broadcast_to(np.array(v, np.float64).T, (x.size, 3)) for v in (ray.o, ray.d))
    t = -o[:, 2] / d[:, 2]
    floor = o + t[:, None] * d
    hits = (d[:, 2] < 0) & (np.abs(floor[:, :2]) < 3.0 - margin).all(axis=1)
    at = floor - d * (LAMP_HEIGHT / d[:, 2])[:, None]
    # The lamp's uv: turned by 180° about x, so y runs against v; a bitmap's first row has v = 0
    s = at[:, 0] / LAMP_SIZE
    v = -at[:, 1] / LAMP_SIZE
    inside = (np.abs(s) < 1) & (np.abs(v) < 1)
    edge = np.min([np.abs(s), np.abs(v), np.abs(np.abs(s) - 1), np.abs(np.abs(v) - 1)], axis=0)
    colour = CHECKS[(v > 0).astype(int), (s > 0).astype(int)]
    radiance = np.where(inside[:, None], colour, 0.0)
    clear = hits & (edge * LAMP_SIZE > margin)
    shape = (view.height, view.width)
    return radiance.reshape(*shape, 3), clear.reshape(shape)


def test_a_delta_column_reflects_a_textured_light() -> None:
    item = mirror(0.0)
    scene = textured_lamp(item)
    picture = pictures(scene, basis_for(scene, None, (64,)), spp=4096, per_pass=256)[0]
    expected, clear = reflected_lamp(scene, margin=0.12)
    tint = coefficients(item.layers[0], item.initial.layers["specular"])[-1]
    expected = expected * tint
    unlit = clear & (expected.max(axis=-1) == 0)
    lit = clear & ~unlit
    assert min(lit.sum(), unlit.sum()) > 50
    assert not picture.mean[unlit].any()
    # Each stratified pass spends the same share on the delta lobe: no noise is left
    np.testing.assert_allclose(picture.mean[lit], expected[lit], rtol=1e-5)


def test_a_mirror_like_lobe_reflects_a_textured_light() -> None:
    """α = 0.005: within the margin the lobe sees one colour, so it is the mirror's picture
    times its directional albedo, which masking takes below 1 by a few parts in 10⁵."""
    item = mirror(0.005, delta=False)
    scene = textured_lamp(item)
    basis = basis_for(scene, None, (256,))
    picture = pictures(scene, basis, spp=4096, per_pass=256)[0]
    expected, clear = reflected_lamp(scene, margin=0.25)
    expected = expected * np.array(item.initial.layers["specular"].values["color"])
    lit = clear & (expected.max(axis=-1) > 0)
    assert lit.sum() > 50
    ratio = picture.mean[lit].mean(axis=0) / expected[lit].mean(axis=0)
    sigma = np.sqrt(picture.variance[lit].sum(axis=0)) / expected[lit].sum(axis=0)
    # GGX has a tail: what little of it leaves the square is lost or has another colour
    assert (np.abs(ratio - 1) < 4 * sigma + 0.01).all(), (ratio, sigma)
    assert sigma.max() < 0.01
