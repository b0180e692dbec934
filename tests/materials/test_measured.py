"""Measured data: files, angles, factors, edits, and the path tracers that read a table."""

from __future__ import annotations

import importlib.util
import json
import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from burnish.core.errors import CannotWrite, InvalidValue, MeasurementError, MissingFile
from burnish.materials.coefficients import albedo
from burnish.materials.curve import Curve
from burnish.materials.layer import LayerState, Material, MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.measured import (
    ReflectanceTable,
    edited_table,
    measured_material,
    read_merl,
    register,
    table_of_samples,
    write_merl,
)
from burnish.materials.measured.factors import factorise
from burnish.materials.measured.table import half_difference
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.registry import material_from_json, material_to_json

FORMS: list[tuple[Any, Any]] = [
    ("half-difference", "theta_h"),
    ("half-difference", "theta_d"),
    ("homomorphic", "theta_h"),
    ("homomorphic", "theta_in"),
]


def pairs(count: int = 3000, lowest: float = 0.05) -> tuple[Vector, Vector]:
    rng = np.random.default_rng(1)
    z, phi = rng.uniform(lowest, 1.0, (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    sin = np.sqrt(1 - z * z)
    a, b = (Vector(s * np.cos(p), s * np.sin(p), c) for s, p, c in zip(sin, phi, z, strict=True))
    return a, b


def analytic(shape: tuple[int, int, int] = (60, 30, 36)) -> ReflectanceTable:
    """Blinn-Phong over Lambert, tabulated at the cell centres."""
    wi, wo = ReflectanceTable(np.zeros((3, *shape))).directions()
    up = [Vector(w.x, w.y, np.abs(w.z) + 1e-3) for w in (wi, wo)]
    values = BlinnPhong().evaluate(numpy_maths, *up, {"color": (0.3, 0.2, 0.1), "exponent": 40.0})
    raw = np.stack([np.broadcast_to(v, shape) for v in values])
    return ReflectanceTable(raw + np.array([0.1, 0.2, 0.3]).reshape(3, 1, 1, 1) / np.pi)


def total(material: Material, wi: Vector, wo: Vector, products: bool) -> np.ndarray:
    """Σ of the layers: by `evaluate`, or by quotients and curves."""
    result = np.zeros((3, len(wi.z)))
    for layer in material.layers:
        model, values = layer.model, material.initial.layers[layer.name].values
        if not products:
            result += np.stack(model.evaluate(numpy_maths, wi, wo, values))
            continue
        q = np.stack(model.quotients(numpy_maths, wi, wo, {}))
        result += q * model.profile(model.coordinate(numpy_maths, wi, wo, {}), values, {}).T
    return result


# -- angles and tables -----------------------------------------------------------------------


def rusinkiewicz(a: np.ndarray, b: np.ndarray) -> tuple[float, float, float]:
    """θh, θd, φd by rotating ωi, as MERL's own code does."""
    h = (a + b) / np.linalg.norm(a + b)
    theta, phi = math.acos(h[2]), math.atan2(h[1], h[0])
    c, s = math.cos(-phi), math.sin(-phi)
    turned = np.array([c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]])
    c, s = math.cos(-theta), math.sin(-theta)
    d = np.array([c * turned[0] + s * turned[2], turned[1], -s * turned[0] + c * turned[2]])
    return theta, math.acos(min(1.0, d[2])), math.atan2(d[1], d[0]) % math.pi


def test_angles_are_rusinkiewicz_s() -> None:
    wi, wo = pairs(300)
    found = np.stack(half_difference(numpy_maths, wi, wo), axis=1)
    for n in range(300):
        a, b = np.array([w[n] for w in wi]), np.array([w[n] for w in wo])
        h, d, p = rusinkiewicz(a, b)
        expected = (h * 2 / math.pi, d * 2 / math.pi, p / math.pi)
        np.testing.assert_allclose(found[n], expected, atol=1e-7)
    np.testing.assert_allclose(found, np.stack(half_difference(numpy_maths, wo, wi), 1), atol=1e-7)


def test_cells_are_found_by_their_own_centres() -> None:
    rng = np.random.default_rng(2)
    table = ReflectanceTable(rng.random((3, 12, 8, 10)))
    wi, wo = (Vector(*(np.broadcast_to(a, (12, 8, 10)) for a in w)) for w in table.directions())
    lit = (wi.z > 0.01) & (wo.z > 0.01)
    wi, wo = (Vector(*(a[lit] for a in w)) for w in (wi, wo))
    expected = table.raw[:, lit]
    np.testing.assert_array_equal(table.nearest(wi, wo), expected)
    np.testing.assert_allclose(np.stack(table.evaluate(numpy_maths, wi, wo)), expected, atol=1e-6)


def test_invalid_cells_take_a_neighbour_s_value() -> None:
    whole = ReflectanceTable(np.full((3, 6, 5, 8), 0.25))
    raw = whole.raw.copy()
    raw[0, 2, 3, 4], raw[1, 0, 0, :], raw[2, 5, :, :] = np.nan, -1.0, np.inf
    table = ReflectanceTable(raw)
    assert table.invalid_count == 1 + 8 + 40
    np.testing.assert_array_equal(table.filled, whole.filled)
    ramp = ReflectanceTable(np.broadcast_to(np.arange(8.0), (3, 6, 5, 8)).copy())
    ramp.raw[:, 1, 1, 7] = -1.0
    # φd is periodic: cells 6 and 0 are both next to 7
    assert ReflectanceTable(ramp.raw).filled[0, 1, 1, 7] in (0.0, 6.0)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (np.zeros((3, 4, 4)), r"shape \[3, h, d, p\]"),
        (np.zeros((1, 4, 4, 4)), r"shape \[3, h, d, p\]"),
        (np.full((3, 4, 4, 4), -1.0), "no valid cell"),
    ],
)
def test_bad_tables_are_refused(raw: np.ndarray, message: str) -> None:
    with pytest.raises(MeasurementError, match=message):
        ReflectanceTable(raw)


# -- factors and models ----------------------------------------------------------------------


@pytest.mark.parametrize(("form", "curve"), FORMS)
def test_unedited_material_is_the_table(form: Any, curve: Any) -> None:
    table = analytic()
    material = measured_material(table, form, curve)
    wi, wo = pairs()
    expected = np.stack(table.evaluate(numpy_maths, wi, wo))
    for products in (False, True):
        np.testing.assert_allclose(total(material, wi, wo, products), expected, rtol=1e-12)
    assert np.array_equal(edited_table(material, material.initial).raw, table.raw)


def test_factors_are_not_negative_and_meet_what_they_can_express() -> None:
    table = analytic()
    wi, wo = pairs(3000, 0.2)
    found = factorise(table, "half-difference")
    material = measured_material(table)
    light, view, difference, half = material.layers[0].model._all(numpy_maths, wi, wo)  # type: ignore[attr-defined]
    fit = np.stack(
        [a * b + c * e for a, b, c, e in zip(light, view, difference, half, strict=True)]
    )
    exact = np.stack(table.evaluate(numpy_maths, wi, wo))
    assert np.sqrt(np.mean((fit / exact - 1) ** 2)) < 0.03
    for each in (found, factorise(table, "homomorphic")):
        assert min(each.direction.min(), each.difference.min(), each.half.min()) > 0


def test_edits_are_written_back() -> None:
    """The tint and weight of a layer, a switched-off layer, and a curve, in the table."""
    table = analytic()
    material = measured_material(table)
    initial = material.initial
    dark = MaterialState(
        {name: replace(s, weight=0.25) for name, s in initial.layers.items()}, initial.conserve
    )
    wi, wo = (
        Vector(*(np.broadcast_to(a, table.valid.shape) for a in w)) for w in table.directions()
    )
    lit = (wi.z > 0) & (wo.z > 0)
    np.testing.assert_allclose(edited_table(material, dark).raw[:, lit], 0.25 * table.raw[:, lit])
    double = Curve((0.0, 1.0), ((2.0, 2.0, 2.0), (2.0, 2.0, 2.0)))
    for edit in ({"color": (2.0, 2.0, 2.0)}, {}):
        gloss = LayerState(edit or initial.layers["specular"].values, None if edit else double)
        state = MaterialState({**initial.layers, "specular": gloss})
        up_i, up_o = (Vector(*(a[lit] for a in w)) for w in (wi, wo))
        share = np.stack(material.layers[1].model.share(numpy_maths, up_i, up_o))  # type: ignore[attr-defined]
        found = edited_table(material, state).raw[:, lit]
        np.testing.assert_allclose(found, table.raw[:, lit] * (1 + share), rtol=1e-9)
    off = MaterialState(
        {**initial.layers, "diffuse": replace(initial.layers["diffuse"], enabled=False)}
    )
    again = edited_table(material, off).raw[:, lit]
    np.testing.assert_allclose(again, table.raw[:, lit] * share, rtol=1e-6)


def test_json_and_pickle_name_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = analytic((90, 90, 180))
    write_merl(tmp_path / "a.binary", table)
    material = measured_material(tmp_path / "a.binary")
    stored = json.loads(json.dumps(material_to_json(material)))
    assert material_from_json(stored) == material
    assert pickle.loads(pickle.dumps(material)) == material
    model = material.layers[0].model
    monkeypatch.setattr(register, "_tables", {})
    assert model.data.raw.shape == (3, 90, 90, 180)  # type: ignore[attr-defined]
    monkeypatch.setattr(register, "_tables", {})
    with (tmp_path / "a.binary").open("r+b") as file:
        file.seek(1000)
        file.write(b"\0" * 8)
    with pytest.raises(MeasurementError, match="other data than when the material was made"):
        _ = model.data  # type: ignore[attr-defined]
    (tmp_path / "a.binary").unlink()
    with pytest.raises(MissingFile, match="no such file"):
        _ = model.data  # type: ignore[attr-defined]
    with pytest.raises(InvalidValue, match="homomorphic over theta_h, theta_in or both"):
        measured_material(table, "homomorphic", "theta_d")


def test_numpy_equals_drjit() -> None:
    mi = pytest.importorskip("mitsuba")
    from burnish.scene.device import activate

    activate()
    from burnish.scene.maths import drjit_maths

    wi, wo = pairs()
    wi, wo = (Vector(*(np.float32(a).astype(float) for a in w)) for w in (wi, wo))
    device = [mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in w)) for w in (wi, wo)]
    for form, curve in FORMS:
        for layer in measured_material(analytic(), form, curve).layers:
            model = layer.model
            values: dict[str, Any] = {"color": [1.0, 0.5, 2.0]}
            for expected, found in (
                *zip(
                    model.quotients(numpy_maths, wi, wo, {}),
                    model.quotients(drjit_maths, *device, {}),
                    strict=True,
                ),
                *zip(
                    model.evaluate(numpy_maths, wi, wo, values),
                    model.evaluate(drjit_maths, *device, values),
                    strict=True,
                ),
            ):
                np.testing.assert_allclose(
                    np.asarray(found), expected, rtol=5e-4, atol=1e-4 * expected.max()
                )


# -- files -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "0 bytes are too few"),
        (
            np.array([90, 90, 180], "<i4").tobytes() + b"\0" * 80,
            "truncated: 92 bytes in place of 34992012",
        ),
        (
            np.array([90, 90, 360], "<i4").tobytes(),
            "dimensions are 90 x 90 x 360, not 90 x 90 x 180",
        ),
    ],
)
def test_bad_files_are_named(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "bad.binary"
    path.write_bytes(content)
    with pytest.raises(MeasurementError, match=message) as caught:
        read_merl(path)
    assert str(path) in str(caught.value)


def test_files_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(MissingFile, match=r"none.binary: no such file"):
        read_merl(tmp_path / "none.binary")
    with pytest.raises(MeasurementError, match="90 x 90 x 180 cells; this table has 60 x 30 x 36"):
        write_merl(tmp_path / "small.binary", analytic())
    with pytest.raises(CannotWrite):
        write_merl(tmp_path / "no" / "folder.binary", analytic((90, 90, 180)))


def networks(assets: Path) -> Any:
    spec = importlib.util.spec_from_file_location("nbrdf", assets / "brdf" / "nbrdf" / "nbrdf.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        pytest.param("merl/red-fabric", 0.005, marks=pytest.mark.verify),
        ("merl/alum-bronze", 0.03),
        pytest.param("merl/red-metallic-paint", 0.02, marks=pytest.mark.verify),
    ],
)
def test_real_materials(assets: Path, tmp_path: Path, name: str, tolerance: float) -> None:
    """A genuine file of a fabric, a metal, a paint: round trip, angles, and the product form."""
    nbrdf = networks(assets)
    net = nbrdf.load(name)
    raw = nbrdf.to_merl(net)
    path = tmp_path / "measured.binary"
    with path.open("wb") as file:
        np.array([90, 90, 180], np.int32).tofile(file)
        raw.tofile(file)
    table = read_merl(path)
    assert np.array_equal(table.raw, raw)
    assert table.invalid_count == 0
    wi, wo = pairs(5000, 0.1)
    true = nbrdf.eval_io(net, np.stack(wi, -1), np.stack(wo, -1)).T
    found = np.stack(table.evaluate(numpy_maths, wi, wo))
    # The rest is interpolation between cells; the network knows no cells
    assert np.linalg.norm(found - true) <= tolerance * np.linalg.norm(true)
    material = measured_material(table)
    for products in (False, True):
        np.testing.assert_allclose(
            total(material, wi, wo, products), found, rtol=1e-12, atol=1e-12 * found.max()
        )
    assert sum(albedo(x, material.initial.layers[x.name]) for x in material.layers).max() < 1
    write_merl(tmp_path / "again.binary", edited_table(material, material.initial))
    assert (tmp_path / "again.binary").read_bytes() == path.read_bytes()
    path.unlink()
    (tmp_path / "again.binary").unlink()


# -- tables of samples -----------------------------------------------------------------------


def test_samples_of_a_smooth_material() -> None:
    angles = np.random.default_rng(4).uniform(0, [80, 360, 80, 360], (1000, 4))
    i, o = np.radians(angles[:, 0]), np.radians(angles[:, 2])
    values = (np.cos(i) * np.cos(o))[:, None] * np.array([0.1, 0.2, 0.3])
    values[:50] = np.nan
    values[50:60] = -1
    wi, wo = pairs(1000, 0.3)
    for unit in ("degrees", "radians"):
        given = angles if unit == "degrees" else np.radians(angles)
        table = table_of_samples(given, values, unit=unit, shape=(12, 12, 12))  # type: ignore[arg-type]
        found = np.stack(table.evaluate(numpy_maths, wi, wo))
        expected = np.array([[0.1], [0.2], [0.3]]) * wi.z * wo.z
        assert np.sqrt(np.mean((found - expected) ** 2)) < 0.05 * expected.max()


def test_bad_samples_are_refused() -> None:
    with pytest.raises(MeasurementError, match=r"angles \[n, 4\]"):
        table_of_samples(np.zeros((5, 3)), np.zeros((5, 3)))
    with pytest.raises(MeasurementError, match=r"only 0 of 5 samples .* read as radians"):
        table_of_samples(np.full((5, 4), 2.0), np.ones((5, 3)), unit="radians")


# -- path tracers ----------------------------------------------------------------------------


def test_a_measured_sphere_baked_against_the_path_tracer() -> None:
    pytest.importorskip("mitsuba")
    import burnish

    material = measured_material(analytic(), bins=64)
    scene = burnish.load("sphere", materials={"sphere": material}, resolution=(16, 16))
    bundle = burnish.bake(scene, editable=["sphere"], series=(64, 1), spp=512)
    session = burnish.edit(bundle)
    gain = Curve((0.0, 0.2, 1.0), ((1.0, 1.0, 1.0), (0.2, 1.0, 2.0), (1.0, 1.0, 1.0)))
    middle = (slice(5, 10), slice(6, 10))
    for edited in (False, True):
        if edited:
            session.set_curve("sphere.specular", gain)
            session.set("sphere.diffuse.color", (2.0, 1.0, 0.5))
        image = session.frame()[middle]
        truth = burnish.path_trace(scene, session.materials, spp=1024, bounces=2)[middle]
        assert np.linalg.norm(image - truth) <= 0.1 * np.linalg.norm(truth)
