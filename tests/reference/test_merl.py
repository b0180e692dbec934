"""The MERL plugin: an independent reading of the same file, with a sampler that is honest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from burnish.core.errors import InvalidValue, MeasurementError, MissingFile
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.measured import ReflectanceTable, read_merl, write_merl
from burnish.materials.measured.merl import SCALE, SHAPE
from burnish.reference.merl import merl_bsdf
from tests.reference.worlds import MATTE  # activates a variant

assert MATTE


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shiny material whose value depends on every angle and channel."""
    empty = ReflectanceTable(np.ones((3, *SHAPE)), SCALE)
    h, d, p = (
        a.reshape(s)
        for a, s in zip(empty.angles(), ((-1, 1, 1), (1, -1, 1), (1, 1, -1)), strict=True)
    )
    colour = np.reshape([0.2, 0.5, 0.9], (3, 1, 1, 1))
    rho = colour * (1 + np.cos(2 * p) * np.sin(d) ** 2 / 2) / np.pi
    rho = rho + (0.1 + np.sin(d) ** 5) * np.cos(h) ** 200 * (1 + colour)
    path = tmp_path_factory.mktemp("merl") / "shiny.binary"
    write_merl(path, ReflectanceTable(rho / np.reshape(SCALE, (3, 1, 1, 1)), SCALE))
    return path


def pairs(count: int) -> tuple[Vector, Vector]:
    rng = np.random.default_rng(8)
    z, phi = rng.uniform(0.05, 1, (2, count)), rng.uniform(0, 2 * np.pi, (2, count))
    sin = np.sqrt(1 - z * z)
    w = np.stack([sin * np.cos(phi), sin * np.sin(phi), z], axis=1)
    near = w[1] * np.array([[-1], [-1], [1]]) + 0.1 * rng.standard_normal((3, count))
    near[2] = np.maximum(near[2], 0.05)
    w[0, :, ::2] = (near / np.linalg.norm(near, axis=0))[:, ::2]
    first, second = (Vector(*np.float32(a).astype(np.float64)) for a in w)
    return first, second


def value(bsdf: Any, wi: Vector, wo: Vector) -> np.ndarray:
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi.z))
    si.wi = mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in wo))
    light = mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in wi))
    return np.asarray(bsdf.eval(mi.BSDFContext(), si, light), np.float64) / wi.z


def test_two_readers_of_one_file(file: Path) -> None:
    """Interpolated and cell by cell, against the table that burnish reads."""
    table = read_merl(file)
    wi, wo = pairs(20_000)
    expected = np.stack(table.evaluate(numpy_maths, wi, wo))
    found = value(merl_bsdf(file), wi, wo)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4 * expected.max())
    np.testing.assert_allclose(value(merl_bsdf(file), wo, wi), found, rtol=1e-3, atol=1e-4)
    cells = value(merl_bsdf(file, "nearest"), wi, wo)
    same = np.isclose(cells, table.nearest(wi, wo), rtol=1e-5).all(axis=0)
    # Single precision puts a few pairs into the cell beside
    assert same.mean() > 0.998
    assert np.abs(cells / found - 1).max() > 0.01


def test_nothing_below_the_surface(file: Path) -> None:
    bsdf, up = merl_bsdf(file), Vector(*np.array([[0.6], [0.0], [0.8]]))
    down = Vector(up.x, up.y, -up.z)
    assert not value(bsdf, down, up).any()
    assert not value(bsdf, up, down).any()


@pytest.mark.parametrize("wo", [(0.0, 0.0, 1.0), (0.5, 0.2, 0.7), (0.9, -0.3, 0.2)])
def test_directions_have_the_density_that_pdf_says(file: Path, wo: tuple[float, ...]) -> None:
    bsdf, context = merl_bsdf(file), mi.BSDFContext()

    def interaction(lanes: int) -> Any:
        si = dr.zeros(mi.SurfaceInteraction3f, lanes)
        si.wi = dr.normalize(mi.Vector3f(*map(float, wo)))
        return si

    def sample(u: Any) -> tuple[Any, Any]:
        bs, weight = bsdf.sample(context, interaction(dr.width(u)), u[0], mi.Point2f(u[1], u[2]))
        value, pdf = bsdf.eval_pdf(context, interaction(dr.width(u)), bs.wo)
        assert dr.all(dr.abs(weight * pdf - value) <= 1e-4 * dr.max(value), axis=None)
        return bs.wo, dr.select(bs.pdf > 0, 1.0, 0.0)

    test = mi.chi2.ChiSquareTest(
        domain=mi.chi2.SphericalDomain(),
        sample_func=sample,
        pdf_func=lambda wi: bsdf.pdf(context, interaction(dr.width(wi)), wi),
        sample_dim=3,
        sample_count=400_000,
        res=71,
        ires=32,
        seed=3,
    )
    assert test.run(significance_level=0.01, test_count=3, quiet=True), test.messages


def test_a_scene_file_names_it(file: Path) -> None:
    merl_bsdf(file)
    bsdf = mi.load_dict({"type": "merl", "filename": str(file), "interpolation": "nearest"})
    assert "shiny.binary" in str(bsdf)
    assert bsdf.nearest


def test_bad_files_and_choices(file: Path, tmp_path: Path) -> None:
    with pytest.raises(MissingFile, match=r"none.binary: no such file"):
        merl_bsdf(tmp_path / "none.binary")
    short = tmp_path / "short.binary"
    short.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(MeasurementError, match="123 values"):
        merl_bsdf(short)
    with pytest.raises(InvalidValue, match="interpolation must be linear or nearest; got 'cubic'"):
        merl_bsdf(file, "cubic")
