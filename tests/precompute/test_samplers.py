"""Every sampler of the path tracer draws what its density says (chi-squared)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from burnish.materials.models.cook_torrance import CookTorranceConductor
from burnish.materials.models.lambert import Lambert
from burnish.precompute.lobes import CELLS, EVEN_SHARE, coarse_lobe_of
from burnish.precompute.plan import basis_for
from burnish.precompute.symbolic import SymbolicMaterials
from burnish.scene import Scene
from tests.reference.worlds import SKY, blinn, camera, initial, lambert, material, plane, world

GREY = (0.5, 0.5, 0.5)
DIRECTIONS = ((0.0, 0.0, 1.0), (0.5, 0.2, 0.7), (0.9, -0.3, 0.2))
SIGNIFICANCE = 0.01


def metal(alpha: float) -> Any:
    values = {"color": GREY, "roughness": alpha, "eta": (0.2, 0.9, 1.1), "k": (3.9, 2.4, 2.2)}
    return material(
        ("diffuse", Lambert(), {"color": GREY}),
        ("specular", CookTorranceConductor("ggx"), values),
        delta=True,
    )


@pytest.fixture(scope="module")
def scene() -> Scene:
    return world(
        {
            "matte": plane(z=0),
            "glossy": plane(z=1),
            "sharp": plane(z=2),
            "metal": plane(z=3),
            "mirror": plane(z=4),
            "sky": SKY,
            "view": camera((0, -5, 5), (0, 0, 0)),
        },
        {
            "matte": lambert(GREY),
            "glossy": blinn(GREY, GREY, 40.0),
            "sharp": blinn(GREY, GREY, 2000.0),
            "metal": metal(0.1),
            "mirror": metal(0.0),
        },
        resolution=(4, 4),
    )


@pytest.fixture(scope="module")
def kinds(scene: Scene) -> dict[str, SymbolicMaterials]:
    """Symbolic, with coarse bins, with the lobes following the state, and settled materials."""
    everything, one = basis_for(scene), basis_for(scene, ["matte"])
    numeric = {name: state for name, state in initial(scene).items() if name != "matte"}
    return {
        "symbolic": SymbolicMaterials(scene, everything),
        "coarse": SymbolicMaterials(scene, basis_for(scene, series=(64, 8, 1))),
        "following": SymbolicMaterials(scene, everything, follow=initial(scene)),
        "settled": SymbolicMaterials(scene, one, numeric=numeric),
    }


class HalfVectors:
    """Directions as (u, φ / 2π) of their half vector, θh = (π/2) u²: there, a density that
    has a pole at the mirror direction is bounded and can be integrated cell by cell."""

    def __init__(self, wo: Any) -> None:
        self.wo = wo

    def bounds(self) -> Any:
        return mi.ScalarBoundingBox2f([0, 0], [1, 1])

    def aspect(self) -> float:
        return 1.0

    def map_forward(self, p: Any) -> Any:
        return p

    def map_backward(self, p: Any) -> Any:
        return p

    def direction(self, p: Any) -> tuple[Any, Any]:
        """ωi, and its solid angle per unit of (u, φ / 2π)."""
        sin_theta, cos_theta = dr.sincos((dr.pi / 2) * dr.square(p.x))
        sin_phi, cos_phi = dr.sincos(2 * dr.pi * p.y)
        wh = mi.Vector3f(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
        wi = 2 * dr.dot(self.wo, wh) * wh - self.wo
        area = 4 * dr.maximum(dr.dot(self.wo, wh), 0) * sin_theta * dr.pi * p.x * 2 * dr.pi
        return wi, area

    def position(self, wi: Any) -> Any:
        wh = dr.normalize(wi + self.wo)
        theta = dr.atan2(dr.hypot(wh.x, wh.y), wh.z)
        phi = dr.atan2(wh.y, wh.x) / (2 * dr.pi)
        return mi.Point2f(dr.sqrt(theta * (2 / dr.pi)), dr.select(phi < 0, phi + 1, phi))


def chi_squared(
    wo: Any, sample: Callable[[Any], tuple[Any, Any]], pdf: Callable[[Any], Any], tests: int
) -> None:
    domain = HalfVectors(wo)

    def position(u: Any) -> tuple[Any, Any]:
        wi, weight = sample(u)
        # Directions that carry nothing may lie below the horizon
        return dr.select(weight > 0, domain.position(wi), 0.5), weight

    def density(p: Any) -> Any:
        wi, area = domain.direction(p)
        return dr.select(area > 0, pdf(wi) * area, 0)

    test = mi.chi2.ChiSquareTest(
        domain=domain,
        sample_func=position,
        pdf_func=density,
        sample_dim=3,
        sample_count=300_000,
        # The lobes' densities jump between the cells of u only
        res=CELLS,
        ires=16,
        seed=5,
    )
    passed = test.run(significance_level=SIGNIFICANCE, test_count=tests, quiet=True)
    assert passed, test.messages


CASES = [
    (kind, name, wo)
    for kind, name in (
        ("symbolic", "matte"),
        ("symbolic", "glossy"),
        ("symbolic", "metal"),
        ("following", "glossy"),
        ("following", "sharp"),
        ("settled", "sharp"),
        ("settled", "metal"),
    )
    for wo in DIRECTIONS
]


@pytest.mark.parametrize(("kind", "name", "wo"), CASES)
def test_a_first_encounter_s_directions(
    scene: Scene,
    kinds: dict[str, SymbolicMaterials],
    kind: str,
    name: str,
    wo: tuple[float, float, float],
) -> None:
    materials, obj = kinds[kind], index_of(scene, name)
    outgoing = dr.normalize(mi.Vector3f(*wo))

    def sample(u: Any) -> tuple[Any, Any]:
        wi, pdf, is_delta = materials.sample(
            dr.full(mi.UInt32, obj, dr.width(u)), outgoing, u[0], mi.Point2f(u[1], u[2])
        )
        return wi, dr.select(~is_delta & (pdf > 0), 1.0, 0.0)

    def pdf(wi: Any) -> Any:
        return materials.pdf(dr.full(mi.UInt32, obj, dr.width(wi)), wi, outgoing)

    chi_squared(outgoing, sample, pdf, len(CASES))


LAYERS = [
    (name, slot, wo)
    for name in ("glossy", "metal", "mirror")
    for slot in (0, 1)
    for wo in DIRECTIONS
]


@pytest.mark.parametrize(("name", "slot", "wo"), LAYERS)
def test_a_second_encounter_s_directions(
    scene: Scene,
    kinds: dict[str, SymbolicMaterials],
    name: str,
    slot: int,
    wo: tuple[float, float, float],
) -> None:
    materials, obj = kinds["coarse"], index_of(scene, name)
    outgoing = dr.normalize(mi.Vector3f(*wo))

    def sample(u: Any) -> tuple[Any, Any]:
        n = dr.width(u)
        wi, pdf = materials.sample_layer(
            dr.full(mi.UInt32, obj, n),
            dr.full(mi.UInt32, slot, n),
            outgoing,
            u[0],
            mi.Point2f(u[1], u[2]),
        )
        return wi, dr.select(pdf > 0, 1.0, 0.0)

    def pdf(wi: Any) -> Any:
        n = dr.width(wi)
        return materials.pdf_layer(
            dr.full(mi.UInt32, obj, n), dr.full(mi.UInt32, slot, n), wi, outgoing
        )

    chi_squared(outgoing, sample, pdf, len(LAYERS))


@pytest.mark.parametrize("count", [1, 2, 7, 8, 32, 96])
@pytest.mark.parametrize("alpha", [0.0, 0.3])
def test_every_coarse_bin_is_drawn_as_its_energy_asks(count: int, alpha: float) -> None:
    """Half evenly and half by the energy, and within a bin evenly in solid angle."""
    layer = metal(alpha).layers[1].with_bins(96)
    state = metal(alpha).initial.layers["specular"]
    cells = coarse_lobe_of(layer, state, count)
    assert cells.sum() == pytest.approx(1)
    assert cells.min() > 0
    # Any one bin has its even share, wherever its edges are among the cells
    edges = np.sqrt(layer.edges[-(-np.arange(count + 1) * 96 // count)])
    drawn = np.diff(np.interp(edges, np.linspace(0, 1, CELLS + 1), np.append(0, cells.cumsum())))
    if CELLS % count == 0:
        assert drawn.min() >= EVEN_SHARE / count * (1 - 1e-9)
        assert drawn[0] > 0.5 or alpha > 0 or count == 1
        u = np.linspace(0, 1, CELLS + 1)
        per_steradian = cells / np.diff(-np.cos(np.pi / 2 * u**2))
        of_a_bin = per_steradian.reshape(count, -1)
        np.testing.assert_allclose(of_a_bin, of_a_bin[:, :1] + 0 * of_a_bin, rtol=1e-6)


def test_the_sampled_density_is_the_one_that_is_reported(
    scene: Scene, kinds: dict[str, SymbolicMaterials]
) -> None:
    rng = np.random.default_rng(2)
    u1, a, b = (mi.Float(rng.random(4096, np.float32)) for _ in range(3))
    outgoing = dr.normalize(mi.Vector3f(0.4, 0.1, 0.6))
    for kind, materials in kinds.items():
        obj = dr.full(mi.UInt32, index_of(scene, "metal"), 4096)
        wi, pdf, is_delta = materials.sample(obj, outgoing, u1, mi.Point2f(a, b))
        smooth = np.array(is_delta)
        again = np.array(materials.pdf(obj, wi, outgoing))
        np.testing.assert_allclose(np.array(pdf)[~smooth], again[~smooth], rtol=1e-6)
        # A settled rough metal has no use for its delta lobe
        assert smooth.any() == (kind != "settled")
        if not smooth.any():
            continue
        # The delta lobe is the mirror direction, with its probability
        share = np.array(pdf)[smooth]
        assert share.std() < 1e-6
        assert abs(smooth.mean() - share[0]) < 5 * np.sqrt(share[0] / 4096)
        mirrored = np.array(wi)[:, smooth]
        expected = np.array([[-1], [-1], [1]]) * np.array(outgoing)
        np.testing.assert_allclose(mirrored, np.broadcast_to(expected, mirrored.shape), rtol=1e-6)


def test_layers_and_groups_are_chosen_evenly(scene: Scene) -> None:
    """A second encounter picks a layer, a later one a group; one over the chance is the weight."""
    grouped = replace(
        blinn(GREY, GREY, 40.0),
        layers=tuple(
            replace(layer, group=group)
            for layer, group in zip(blinn(GREY, GREY, 40.0).layers, ("", "tinted"), strict=True)
        ),
    )
    objects = tuple(
        replace(item, material=grouped) if item.id == "sharp" else item for item in scene.objects
    )
    materials = SymbolicMaterials(
        replace(scene, objects=objects), basis_for(replace(scene, objects=objects))
    )
    u = mi.Float(((np.arange(1000) + 0.5) / 1000).astype(np.float32))
    for name, layers, expected in (
        ("matte", True, [1000]),
        ("glossy", True, [500, 500]),
        ("glossy", False, [1000]),
        ("sharp", False, [500, 500]),
    ):
        obj = dr.full(mi.UInt32, index_of(scene, name), 1000)
        slot, weight = materials.choose(obj, u, mi.Bool(layers))
        assert np.bincount(np.array(slot)).tolist() == expected
        assert np.unique(np.array(weight)).tolist() == [len(expected)]


def index_of(scene: Scene, name: str) -> int:
    return [item.id for item in scene.objects].index(name)
