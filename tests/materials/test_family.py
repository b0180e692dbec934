"""Families of BRDFs by principal components."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.materials.coefficients import albedo
from burnish.materials.components import SHAPE, damping, grid, half_difference, principal
from burnish.materials.layer import Layer, LayerState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.models.family import PrincipledFamily
from burnish.materials.registry import model_from_json, model_to_json

PRINCIPLED = PrincipledFamily(varied=("roughness",), error=1e-3)
VALUES: dict[str, Any] = {
    "color": (0.1, 0.5, 0.9),
    "metallic": 0.0,
    "roughness": 0.5,
    "specular": 0.5,
    "clearcoat": 0.0,
}


def pairs(count: int = 20_000) -> tuple[Vector, Vector]:
    """Half of the pairs anywhere, half near the mirror direction."""
    rng = np.random.default_rng(1)
    z, phi = rng.uniform(0.05, 1, (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    sin = np.sqrt(1 - z * z)
    w = np.stack([sin * np.cos(phi), sin * np.sin(phi), z], axis=1)
    near = w[1] * np.array([[-1], [-1], [1]]) + 0.1 * rng.standard_normal((3, count))
    near[2] = np.maximum(near[2], 0.05)
    w[0, :, ::2] = (near / np.linalg.norm(near, axis=0))[:, ::2]
    return Vector(*w[0]), Vector(*w[1])


def turned(w: Vector, angle: float, flip: bool) -> Vector:
    c, s = np.cos(angle), np.sin(angle)
    x, y = c * w.x - s * w.y, s * w.x + c * w.y
    return Vector(x, -y if flip else y, w.z)


def product_form(values: dict[str, Any], wi: Vector, wo: Vector) -> np.ndarray:
    q = np.stack(PRINCIPLED.quotients(numpy_maths, wi, wo, {}))
    return np.einsum("kc,kn->cn", PRINCIPLED.amplitudes(values, {}), q)


def test_half_and_difference_angles_have_the_symmetries() -> None:
    wi, wo = pairs(2000)
    found = half_difference(numpy_maths, wi, wo)
    for a, b in (
        (wo, wi),
        (turned(wi, 1.1, False), turned(wo, 1.1, False)),
        (turned(wi, 0.3, True), turned(wo, 0.3, True)),
    ):
        for first, second in zip(found, half_difference(numpy_maths, a, b), strict=True):
            np.testing.assert_allclose(first, second, atol=2e-6)
            assert (first >= 0).all()
            assert (first <= 1).all()


def test_nodes_lie_where_their_angles_say() -> None:
    nodes = grid()
    lit = nodes.weight > 0
    found = half_difference(numpy_maths, nodes.wi, nodes.wo)
    expected = np.meshgrid(*(np.linspace(0, 1, n) for n in SHAPE), indexing="ij")
    for own, node in zip(found, expected, strict=True):
        np.testing.assert_allclose(own[lit], node[lit], atol=1e-6)
    for w in (nodes.wi, nodes.wo):
        np.testing.assert_allclose((w.x**2 + w.y**2 + w.z**2)[lit], 1, atol=1e-9)


def test_components_of_a_known_span() -> None:
    rng = np.random.default_rng(2)
    true = 0.1 + rng.random((3, *SHAPE))
    mixed = np.tensordot(rng.random((12, 3)), true, axes=1)
    found = principal(mixed, 1e-6)
    assert len(found.tables) == 3
    assert found.errors[2] < 1e-6
    weights = found.project(mixed.transpose(1, 2, 3, 0))
    lit = grid().weight > 0
    again = np.tensordot(weights.T, found.tables, axes=1)
    np.testing.assert_allclose(again[:, lit], mixed[:, lit], rtol=1e-6)
    # The mean comes first, and is positive
    mean = mixed / np.sqrt((mixed**2 * grid().weight).sum(axis=(1, 2, 3)))[:, None, None, None]
    np.testing.assert_allclose(found.tables[0], mean.mean(axis=0), rtol=1e-9)


def test_errors_fall_to_what_was_asked() -> None:
    found = PRINCIPLED.components
    assert (np.diff(found.errors) <= 0).all()
    assert found.errors[PRINCIPLED.rank - 1] <= 1e-3 < found.errors[PRINCIPLED.rank - 2]
    assert PRINCIPLED.rank <= 14
    assert PrincipledFamily(varied=("roughness",), error=0.05).rank < PRINCIPLED.rank


@pytest.mark.parametrize("roughness", [0.2, 0.23, 0.5, 0.77, 1.0])
def test_edits_between_members_and_nodes(roughness: float) -> None:
    """1e-3 at the nodes, and what linear interpolation between them costs."""
    wi, wo = pairs()
    values = {**VALUES, "roughness": roughness}
    true = np.stack(PRINCIPLED.evaluate(numpy_maths, wi, wo, values))
    error = product_form(values, wi, wo) - true
    weight = wi.z * wo.z
    assert np.sqrt(np.sum(error**2 * weight) / np.sum(true**2 * weight)) < 0.02


def test_colour_is_exact_in_the_amplitudes() -> None:
    ends = [
        PRINCIPLED.amplitudes({**VALUES, "color": (x, x, x)}, {})[:, 0] for x in (0.0, 0.5, 1.0)
    ]
    np.testing.assert_allclose(ends[1], (ends[0] + ends[2]) / 2, atol=1e-12 * abs(ends[2]).max())


def test_albedo_is_the_layers() -> None:
    """Against the exact layers that the same model splits into."""
    from burnish.materials.models.principled import PrincipledBase, PrincipledSpecular

    layer = Layer.starting_at("all", PRINCIPLED, VALUES)
    assert (layer.bins, layer.columns) == (1, PRINCIPLED.rank)
    found = albedo(layer, LayerState(VALUES))
    full = {**VALUES, "spec_tint": 0.0}
    parts = [
        Layer.starting_at("part", model, full) for model in (PrincipledBase(), PrincipledSpecular())
    ]
    expected = sum(albedo(part, LayerState(full)) for part in parts)
    np.testing.assert_allclose(found, expected, rtol=0.01)


def test_numpy_equals_drjit() -> None:
    mi = pytest.importorskip("mitsuba")
    from burnish.scene.device import activate

    activate()
    from burnish.scene.maths import drjit_maths

    wi, wo = pairs(4096)
    device = [mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in w)) for w in (wi, wo)]
    expected = PRINCIPLED.quotients(numpy_maths, wi, wo, {})
    for own, found in zip(expected, PRINCIPLED.quotients(drjit_maths, *device, {}), strict=True):
        damp = damping(wi, wo)
        scale = np.abs(own * damp).max()
        np.testing.assert_allclose(np.asarray(found) * damp, own * damp, atol=2e-3 * scale)


def test_round_trip_and_bad_choices() -> None:
    model = PrincipledFamily(varied=("roughness", "metallic"), held=(("clearcoat", 0.5),))
    assert model_from_json(json.loads(json.dumps(model_to_json(model)))) == model
    with pytest.raises(InvalidValue, match="varied and held must name roughness"):
        PrincipledFamily(varied=("sheen",))
