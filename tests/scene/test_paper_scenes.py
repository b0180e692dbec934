"""The papers' scenes: their objects and layers, sound meshes, and Mitsuba's picture of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.special import beta

from burnish.core.types import AnyArray, Float64
from burnish.reference import PathTracedTruth
from burnish.scene import Scene, load
from burnish.scene.examples import EXAMPLES
from burnish.scene.examples.geometry import Mesh
from burnish.scene.examples.implicit import ball, blended, carved, limb, meshed, sheet
from burnish.scene.examples.shapes import cushion, ellipsoid, pierced, rounded_box, spline, tube
from tests.scene import test_examples
from tests.scene.test_examples import assert_clean, volume
from tests.verify.pictures import Halves, against_truth

MATTE = ["diffuse"]
COATED = ["diffuse", "specular"]
CLOTH = ["diffuse", "sheen", "specular", "coat"]
# Editable objects: their layers
OBJECTS: dict[str, dict[str, list[str]]] = {
    "vase": {
        "vase": ["diffuse", "anisotropic", "fresnel"],
        "flowers": ["diffuse"],
        "stems": COATED,
        "table": COATED,
        "wall": ["diffuse"],
    },
    "room": {
        **dict.fromkeys(("floor", "walls", "ceiling", "sills", "stairs"), COATED),
        "couch": CLOTH,
        **dict.fromkeys(("rug", "picture"), MATTE),
    },
    "earrings": {
        "pearls": ["diffuse", "specular", "haze"],
        "posts": ["specular"],
        "cloth": CLOTH,
        "pedestal": COATED,
    },
    "still-life": {
        **dict.fromkeys(("ball", "bottle", "box", "fruits", "floor"), COATED),
        "bowl": ["specular"],
        "wall": COATED,
    },
    "interior": {
        **dict.fromkeys(("floor", "walls", "ceiling", "frame", "pot", "plant"), COATED),
        "curtain": ["diffuse"],
        "rod": ["specular"],
        "armchair": CLOTH,
    },
    "tableau": {"bunny": COATED, "dragon": COATED, "floor": COATED},
}
FIXED = {"room": {"table", "glass", "railing", "legs"}}
LIGHTS = {"room": {"sky", "sun"}, "interior": {"sky", "side-sky", "sun"}}
# Thin cloth, petals and leaves have an edge
OPEN = {"flowers", "stems", "cloth", "curtain", "plant"}


@pytest.fixture(scope="module", params=OBJECTS)
def scene(request: pytest.FixtureRequest) -> Scene:
    return load(request.param, resolution=(24, 24))


def test_it_renders_and_its_objects_have_the_layers_of_the_paper(scene: Scene) -> None:
    found = {
        item.id: [layer.name for layer in item.material.layers]
        for item in scene.objects
        if item.material is not None
    }
    assert OBJECTS[scene.name].items() <= found.items()
    assert FIXED.get(scene.name, set()) <= {item.id for item in scene.objects}
    assert_clean(scene)
    lights = {item.id for item in scene.objects if item.reason == "it is a light"}
    assert lights == LIGHTS.get(scene.name, set())
    assert not lights & set(found)


def test_its_meshes_are_sound(scene: Scene) -> None:
    """Unit normals that look where the faces look; closed surfaces without a gap."""
    import mitsuba as mi

    shapes = scene.mi_scene.shapes()
    for item in scene.objects:
        for shape in (shapes[number] for number in item.shapes):
            if not isinstance(shape, mi.Mesh) or shape.vertex_count() == 4:
                continue  # a formula or a rectangle
            mesh = read(shape)
            lengths = np.linalg.norm(mesh.normals, axis=1)
            np.testing.assert_allclose(lengths, 1.0, atol=1e-5, err_msg=item.id)
            assert np.isfinite(mesh.positions).all()
            assert np.isfinite(mesh.uv).all()
            assert agreement(mesh) > 0.995, item.id
            if item.id not in OPEN:
                assert gaps(mesh) == 0, item.id
                assert volume(mesh) > 0, item.id


def read(shape: AnyArray) -> Mesh:
    """What Mitsuba holds of a mesh."""

    def rows(buffer: AnyArray, width: int) -> Float64:
        return np.asarray(buffer, np.float64).reshape(-1, width)

    return Mesh(
        rows(shape.vertex_positions_buffer(), 3),  # type: ignore[attr-defined]
        rows(shape.vertex_normals_buffer(), 3),  # type: ignore[attr-defined]
        rows(shape.vertex_texcoords_buffer(), 2),  # type: ignore[attr-defined]
        np.asarray(shape.faces_buffer(), np.int32).reshape(-1, 3),  # type: ignore[attr-defined]
    )


def agreement(mesh: Mesh) -> float:
    """The share of the surface whose three normals lie on the side that its face looks to."""
    a, b, c = (mesh.positions[mesh.faces[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    good = (np.einsum("fk,fnk->fn", flat, mesh.normals[mesh.faces]) > 0).all(axis=1)
    area = np.linalg.norm(flat, axis=1)
    return float(area[good].sum() / area.sum())


def gaps(mesh: Mesh) -> int:
    """How many edges lack a neighbour that runs the other way, equal points being one."""
    near = cKDTree(mesh.positions).query_pairs(4e-6, output_type="ndarray")
    count = len(mesh.positions)
    graph = coo_array((np.ones(len(near)), near.T), (count, count))
    _, point = connected_components(graph, directed=False)
    corners = point[mesh.faces]
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.int64)
    edges = edges[edges[:, 0] != edges[:, 1]]
    forward, backward = edges @ [count, 1], edges @ [1, count]
    keys = np.unique(np.concatenate([forward, backward]))
    balance = np.bincount(np.searchsorted(keys, forward), minlength=len(keys))
    balance -= np.bincount(np.searchsorted(keys, backward), minlength=len(keys))
    return int(np.abs(balance).sum())


def test_every_example_is_tested() -> None:
    assert {example.name for example in EXAMPLES} == set(OBJECTS) | set(test_examples.OBJECTS)


def test_unedited_the_vase_is_path_traced_alike(tmp_path: Path) -> None:
    """With it alone editable, at two bounces, within 0.05 and twice what the noise hides."""
    scene = load("vase", resolution=(20, 20))
    halves = Halves.bake(scene, tmp_path, series=(32, 1), spp=256, editable=["vase"])
    found = against_truth(halves, PathTracedTruth(scene, bounces=2), {}, 256).metrics
    hidden = found["rel_rmse_beyond_noise_error"]
    assert found["rel_rmse_beyond_noise"] <= 0.05 + 2 * hidden


def test_shapes_have_the_volumes_of_their_formulas() -> None:
    assert volume(ellipsoid((1, 2, 3), (1, 2, 3))) == pytest.approx(8 * np.pi, rel=5e-3)
    corner = 0.2
    flat = rounded_box((0, 0, 0), (1, 2, 3), corner, 12)
    # Steiner: the inner box, slabs on its faces, quarter cylinders on its edges, one ball
    inner = 8 * 0.8 * 1.8 * 2.8
    slabs = 8 * corner * (0.8 * 1.8 + 1.8 * 2.8 + 0.8 * 2.8)
    edges = 2 * np.pi * corner**2 * (0.8 + 1.8 + 2.8)
    exact = inner + slabs + edges + 4 / 3 * np.pi * corner**3
    assert volume(flat) == pytest.approx(exact, rel=2e-3)
    for upright, plan in ((0.5, 0.3), (1.0, 0.4)):
        # Barr 1981
        stuffed = 12 * upright * plan * beta(upright / 2 + 1, upright) * beta(plan / 2, plan / 2)
        assert volume(cushion((0, 0, 0), (1, 2, 3), upright, plan)) == pytest.approx(
            stuffed, rel=0.01
        )
    straight = spline([(0, 0, 0), (0, 0, 2)], 8)
    rod = np.pi * 0.3**2 * 2 + 4 / 3 * np.pi * 0.3**3
    assert volume(tube(straight, 0.3, 64)) == pytest.approx(rod, rel=0.02)
    wall = pierced((0, 1, 2, 4), (0, 1, 3), 0.5, [(1, 0)])
    assert volume(wall) == pytest.approx(0.5 * (4 * 3 - 1))
    assert gaps(wall) == 0


def test_solids_from_distances_are_closed_and_of_the_right_size() -> None:
    low, high = (-1.5, -1.5, -1.5), (1.5, 1.5, 1.5)
    round_one = meshed(ball((0.1, 0, 0), 1.0), low, high, 0.1)
    assert volume(round_one) == pytest.approx(4 / 3 * np.pi, rel=5e-3)
    away = round_one.positions - (0.1, 0, 0)
    # The four points that tell a vertex's gradient lie at cell / 32
    step = 0.1 / 32
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 1.0, atol=1.1 * step**2)
    np.testing.assert_allclose(round_one.normals, away, atol=step)
    halved = carved(ball((0, 0, 0), 1.0), ball((2.0, 0, 0), (2.0, 20.0, 20.0)), 0.01)
    assert volume(meshed(halved, low, high, 0.05)) == pytest.approx(2 / 3 * np.pi, rel=0.03)
    arm = limb([(0, 0, -0.8), (0, 0, 0.8)], (0.3, 0.1))
    fin = sheet(((0, 0, -0.5), (0, 0, 0.5), (1.2, 0, 0)), 0.1)
    joined = meshed(blended([arm, fin], 0.2), low, high, 0.05)
    assert gaps(joined) == 0
    assert agreement(joined) > 1 - 1e-9
