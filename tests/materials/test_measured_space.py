"""A space of measured materials: what it is given it reproduces, and it stays among them."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from burnish.core.errors import InvalidValue, MeasurementError, UnknownName
from burnish.materials.coefficients import albedo, directional_albedo
from burnish.materials.layer import LayerState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.measured import ReflectanceTable, measured_space, read_merl, write_merl
from burnish.materials.measured.space import MeasuredSpace, _mixture
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.registry import material_from_json, material_to_json
from tests.materials.test_measured import pairs

SHAPE = (40, 18, 20)
TRAITS = {"shiny": (("gold", "varnish"), ("chalk",))}


def table(
    gloss: float, exponent: float, matte: tuple[float, float, float], shape: Any = SHAPE
) -> ReflectanceTable:
    wi, wo = ReflectanceTable(np.zeros((3, *shape))).directions()
    up = [Vector(w.x, w.y, np.abs(w.z) + 1e-3) for w in (wi, wo)]
    values = {"color": (gloss,) * 3, "exponent": exponent}
    rho = np.stack(
        [np.broadcast_to(v, shape) for v in BlinnPhong().evaluate(numpy_maths, *up, values)]
    )
    return ReflectanceTable(rho + np.reshape(matte, (3, 1, 1, 1)) / np.pi)


GIVEN = {
    "chalk": table(0.0, 1.0, (0.7, 0.7, 0.6)),
    "gold": table(0.8, 60.0, (0.1, 0.06, 0.01)),
    "varnish": table(0.05, 200.0, (0.3, 0.1, 0.05)),
    "rubber": table(0.2, 4.0, (0.02, 0.03, 0.1)),
}


def space(**options: Any) -> MeasuredSpace:
    model = measured_space(GIVEN, TRAITS, **options).layers[0].model
    assert isinstance(model, MeasuredSpace)
    return model


def product(model: MeasuredSpace, values: dict[str, Any], wi: Vector, wo: Vector) -> np.ndarray:
    q = np.stack(model.quotients(numpy_maths, wi, wo, {}))
    return np.einsum("kn,kc->cn", q, model.amplitudes(values, {}))


@pytest.mark.parametrize("name", GIVEN)
def test_a_given_material_is_itself(name: str) -> None:
    model = space()
    wi, wo = pairs()
    values: dict[str, Any] = dict(model.values_of(name))
    expected = np.stack(GIVEN[name].evaluate(numpy_maths, wi, wo))
    np.testing.assert_allclose(model.weights(values), [n == name for n in GIVEN], atol=1e-12)
    np.testing.assert_allclose(model.evaluate(numpy_maths, wi, wo, values), expected, rtol=1e-9)
    # By its components, over pairs as the error weighs them
    gap = product(model, values, wi, wo) - expected
    weight = wi.z * wo.z
    assert np.sum(weight * gap**2) <= (2 * model.error) ** 2 * np.sum(weight * expected**2)


def test_components_are_as_many_as_the_error_asks_for() -> None:
    fine, coarse = space(error=1e-3), space(error=0.1)
    assert fine.rank <= 3 * len(GIVEN)
    assert coarse.rank < fine.rank
    for model in (fine, coarse):
        assert model.span.errors[model.rank - 1] <= model.error
    # Orthogonal, and the shares of every channel are its projections
    sampled = np.concatenate([t.filled.reshape(3, -1) for t in GIVEN.values()])
    tables = fine.span.tables[..., 1:-1].reshape(fine.rank, -1)
    shares = np.moveaxis(fine.span.shares, 1, 2).reshape(-1, fine.rank)
    lit = np.asarray(GIVEN["gold"].directions()[0].z > 0) & np.asarray(
        GIVEN["gold"].directions()[1].z > 0
    )
    inside = np.broadcast_to(lit, SHAPE).ravel()
    again = shares @ tables
    np.testing.assert_allclose(again[:, inside], sampled[:, inside], atol=2e-2 * sampled.max())


def test_sliders_go_along_what_tells_the_materials_apart() -> None:
    model = space()
    place = model.coordinates
    n = len(GIVEN)
    np.testing.assert_allclose(place.mean(axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(place.T @ place, n * np.eye(n - 1), atol=1e-8)
    knobs = {item.name: item for item in model.parameters}
    assert list(knobs) == ["color", "component_1", "component_2", "component_3", "shiny"]
    assert knobs["component_1"].minimum == pytest.approx(place[:, 0].min())
    for words, j in zip(("component_1", "component_3"), (0, 2), strict=True):
        high = list(GIVEN)[int(place[:, j].argmax())]
        assert knobs[words].description.endswith(f"to {high}")


def test_limits_hold_what_another_machine_rounds_to() -> None:
    model = measured_space({name: GIVEN[name] for name in ("gold", "chalk")}).layers[0].model
    assert isinstance(model, MeasuredSpace)
    # Two materials have as much of a component each: the first has it positive
    np.testing.assert_allclose(model.coordinates, [[1.0], [-1.0]], atol=1e-12)
    knob = next(item for item in model.parameters if item.name == "component_1")
    assert (knob.minimum, knob.maximum) == (-1.000000001, 1.000000001)
    for name in ("gold", "chalk"):
        (place,) = (z for knob, z in model.values_of(name).items() if knob == "component_1")
        knob.validate(place)
        knob.validate(place * (1 + 1e-12))


def test_a_trait_leads_to_those_that_have_it() -> None:
    model = space()
    start: dict[str, Any] = dict(model.values_of("chalk"))
    np.testing.assert_allclose(
        model.weights({**start, "shiny": 1.0}), [0.0, 0.5, 0.5, 0.0], atol=1e-9
    )
    np.testing.assert_allclose(
        model.weights({**start, "shiny": 0.4}), [0.6, 0.2, 0.2, 0.0], atol=1e-9
    )


@settings(deadline=None)
@given(st.lists(st.floats(-5, 5), min_size=1, max_size=8))
def test_mixtures_are_the_nearest_that_can_be(asked: list[float]) -> None:
    """By the sorting algorithm of Held, Wolfe and Crowder (1974)."""
    v = np.array(asked) + (1 - sum(asked)) / len(asked)
    ordered = np.sort(v)[::-1]
    excess = (np.cumsum(ordered) - 1) / np.arange(1, len(v) + 1)
    limit = excess[np.nonzero(ordered > excess)[0][-1]]
    np.testing.assert_allclose(_mixture(list(v)), np.maximum(v - limit, 0), atol=1e-12)


def corners(model: MeasuredSpace) -> list[dict[str, Any]]:
    rng = np.random.default_rng(4)
    base = {p.name: p.validate(p.default) for p in model.parameters}
    free = [p for p in model.parameters if p.kind == "scalar"]
    return [
        {**base, **{p.name: (p.minimum, p.maximum)[int(rng.integers(2))] for p in free}}
        for _ in range(12)
    ]


def test_wherever_the_sliders_are_it_is_a_material() -> None:
    material = measured_space(GIVEN, TRAITS)
    layer, model = material.layers[0], space()
    most = max(
        directional_albedo(layer, LayerState(model.values_of(name)))[1].max() for name in GIVEN
    )
    wi, wo = pairs()
    below = Vector(wi.x, wi.y, -wi.z)
    for values in corners(model):
        there = np.stack(model.evaluate(numpy_maths, wi, wo, values))
        back = np.stack(model.evaluate(numpy_maths, wo, wi, values))
        assert (there >= 0).all()
        np.testing.assert_allclose(there, back, rtol=1e-6)
        assert not np.stack(model.evaluate(numpy_maths, below, wo, values)).any()
        state = LayerState(values)
        assert directional_albedo(layer, state)[1].max() <= most * (1 + 5e-3)
        assert albedo(layer, state).min() > 0


def test_numpy_equals_drjit() -> None:
    mi = pytest.importorskip("mitsuba")
    from burnish.scene.device import activate

    activate()
    from burnish.scene.maths import drjit_maths

    model = space()
    wi, wo = (Vector(*(np.float32(a).astype(float) for a in w)) for w in pairs())
    device = [mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in w)) for w in (wi, wo)]
    values = corners(model)[0]
    numbers = {
        k: [mi.Float(x) for x in v] if isinstance(v, tuple) else mi.Float(v)
        for k, v in values.items()
    }
    for expected, found in (
        *zip(
            model.quotients(numpy_maths, wi, wo, {}),
            model.quotients(drjit_maths, *device, {}),
            strict=True,
        ),
        *zip(
            model.evaluate(numpy_maths, wi, wo, values),
            model.evaluate(drjit_maths, *device, numbers),
            strict=True,
        ),
    ):
        np.testing.assert_allclose(
            np.asarray(found), expected, rtol=5e-4, atol=1e-4 * np.abs(expected).max()
        )


def test_files_are_named_and_not_copied(tmp_path: Path) -> None:
    for name, gloss in (("a", 0.1), ("b", 0.4)):
        whole = table(gloss, 30.0, (0.1, 0.2, 0.3), (90, 90, 180))
        write_merl(tmp_path / f"{name}.binary", whole)
    material = measured_space([tmp_path / "a.binary", tmp_path / "b.binary"], start="b")
    stored = json.loads(json.dumps(material_to_json(material)))
    again = material_from_json(stored)
    assert again == material == pickle.loads(pickle.dumps(material))
    assert again.layers[0].parameters == material.layers[0].parameters
    wi, wo = pairs(100)
    values: Any = material.initial.layers["measured"].values
    found = np.stack(again.layers[0].model.evaluate(numpy_maths, wi, wo, values))
    expected = np.stack(read_merl(tmp_path / "b.binary").evaluate(numpy_maths, wi, wo))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_bad_spaces_are_refused() -> None:
    chalk, gold = GIVEN["chalk"], GIVEN["gold"]
    with pytest.raises(InvalidValue, match="1 to 21 measured materials; got 0"):
        measured_space([])
    with pytest.raises(InvalidValue, match=r"error must lie in \[0.001, 0.5\]; got 0"):
        measured_space([chalk], error=0.0)
    with pytest.raises(InvalidValue, match="have the same data"):
        measured_space({"one": chalk, "two": chalk})
    with pytest.raises(UnknownName, match="silver"):
        measured_space(GIVEN, {"shiny": (["silver"], ["chalk"])})
    with pytest.raises(UnknownName, match="silver"):
        measured_space(GIVEN, start="silver")
    with pytest.raises(InvalidValue, match="one material with it and one without"):
        measured_space(GIVEN, {"shiny": (["gold"], ["gold"])})
    with pytest.raises(InvalidValue, match="no other parameter's; got 'color'"):
        measured_space(GIVEN, {"color": (["gold"], ["chalk"])})
    with pytest.raises(MeasurementError, match="12 x 8 x 10 and 40 x 18 x 20"):
        measured_space({"gold": gold, "other": table(0.1, 9.0, (0.1,) * 3, (12, 8, 10))})
