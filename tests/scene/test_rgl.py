"""RGL files: a material of known values, written in their format, read through Mitsuba."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from burnish.core.errors import MeasurementError, MissingFile
from burnish.materials.maths import numpy_maths
from burnish.materials.measured import measured_material, read_merl, write_merl
from burnish.scene.device import activate
from burnish.scene.rgl import read_rgl
from tests.materials.test_measured import pairs

activate()

SIDE, INCIDENT = 32, 12
SHAPE = (30, 20, 24)


def fields(anisotropic: bool = False) -> dict[str, Any]:
    """ρ cosθo over (θi, half vector): with an even warp, samples lie at √θm and φm − φi.

    ρ = colour (1 + cosθm¹⁰) / 4, which is reciprocal; ρ cosθo follows from ωi and ωm.
    """
    theta_i = np.linspace(0, np.pi / 2 * 0.98, INCIDENT)
    phi_i = np.linspace(0, 2 * np.pi, 9) if anisotropic else np.zeros(1)
    u = np.linspace(0, 1, SIDE)
    theta_m = (np.pi / 2 * u**2)[None, None, None, :]
    phi_m = (2 * np.pi * (u - 0.5))[None, None, :, None]
    cos_i, sin_i = (f(theta_i)[None, :, None, None] for f in (np.cos, np.sin))
    i_dot_m = sin_i * np.sin(theta_m) * np.cos(phi_m) + cos_i * np.cos(theta_m)
    cos_o = np.maximum(2 * i_dot_m * np.cos(theta_m) - cos_i, 0.0)
    rho = (1 + np.cos(theta_m) ** 10) / 4
    if anisotropic:
        rho = rho * (1 + 0.5 * np.cos(2 * phi_i))[:, None, None, None]
    value = np.broadcast_to(rho * cos_o, (len(phi_i), INCIDENT, SIDE, SIDE))
    colour = np.reshape([0.2, 0.5, 0.9], (1, 1, 3, 1, 1))
    even = np.ones((len(phi_i), INCIDENT, SIDE, SIDE), np.float32)
    return {
        "theta_i": theta_i.astype(np.float32),
        "phi_i": phi_i.astype(np.float32),
        "ndf": np.ones((2, 2), np.float32),
        "sigma": np.ones((2, 2), np.float32),
        "vndf": even,
        "luminance": even,
        "rgb": (value[:, :, None] * colour).astype(np.float32),
        "description": np.frombuffer(b"made by a test", np.uint8),
        "jacobian": np.zeros(1, np.uint8),
    }


def written(path: Path, **changes: Any) -> Path:
    from mitsuba.python.tensor_io import write

    data = {**fields(), **changes}
    write(str(path), **{name: value for name, value in data.items() if value is not None})
    return path


def test_a_material_of_known_values(tmp_path: Path) -> None:
    table = read_rgl(written(tmp_path / "known_rgb.bsdf"), SHAPE)
    wi, wo = pairs(2000, 0.3)
    h = np.stack(wi) + np.stack(wo)
    cos_m = h[2] / np.linalg.norm(h, axis=0)
    expected = np.array([[0.2], [0.5], [0.9]]) * (1 + cos_m**10) / 4
    found = np.stack(table.evaluate(numpy_maths, wi, wo))
    # Linear interpolation of 32 half vectors and 12 incident angles, then of the cells
    assert np.sqrt(np.mean((found / expected - 1) ** 2)) < 0.02
    assert 0 < table.invalid_count < table.valid.size / 2
    material = measured_material(table)
    total = sum(
        np.stack(
            layer.model.evaluate(numpy_maths, wi, wo, material.initial.layers[layer.name].values)
        )
        for layer in material.layers
    )
    np.testing.assert_allclose(total, found, rtol=1e-9)


def test_it_is_kept_as_a_merl_file(tmp_path: Path) -> None:
    table = read_rgl(written(tmp_path / "known_rgb.bsdf"))
    write_merl(tmp_path / "known.binary", table)
    again = read_merl(tmp_path / "known.binary")
    np.testing.assert_array_equal(again.raw, table.raw)
    assert again.invalid_count == table.invalid_count


def test_bad_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFile, match=r"none.bsdf: no such file"):
        read_rgl(tmp_path / "none.bsdf")
    other = tmp_path / "other.bsdf"
    other.write_bytes(b"RIFF" * 10)
    with pytest.raises(MeasurementError, match=r"no RGL \.bsdf file"):
        read_rgl(other)
    whole = written(tmp_path / "whole.bsdf").read_bytes()
    for length in (14, 40, len(whole) // 2, len(whole) - 8):
        (tmp_path / "short.bsdf").write_bytes(whole[:length])
        with pytest.raises(MeasurementError, match="truncated"):
            read_rgl(tmp_path / "short.bsdf")
    spectral = written(tmp_path / "spectral.bsdf", rgb=None, spectra=np.zeros(3, np.float32))
    with pytest.raises(MeasurementError, match="spectral; give the material's _rgb"):
        read_rgl(spectral)
    misshapen = written(tmp_path / "misshapen.bsdf", theta_i=np.zeros((2, 2), np.float32))
    with pytest.raises(MeasurementError, match="Mitsuba cannot read it"):
        read_rgl(misshapen)
    nothing = written(tmp_path / "nothing.bsdf", rgb=np.full_like(fields()["rgb"], np.nan))
    with pytest.raises(MeasurementError, match="no valid cell"):
        read_rgl(nothing, SHAPE)


def test_an_anisotropic_material_is_refused(tmp_path: Path) -> None:
    brushed = written(tmp_path / "brushed.bsdf", **fields(anisotropic=True))
    with pytest.raises(MeasurementError, match="anisotropic: it changes by"):
        read_rgl(brushed, SHAPE)
