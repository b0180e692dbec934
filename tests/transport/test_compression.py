"""Compression: the error bound holds, and where noise is cut the means survive."""

from __future__ import annotations

import numpy as np
import pytest

from burnish.core.types import Float32, Float64
from burnish.materials.coefficients import coarse_energies
from burnish.transport.basis import Basis, coarse_count
from burnish.transport.block import Block
from burnish.transport.compression import (
    column_scale_of,
    compress,
    compress_tile,
    protected_tails,
    rgbe_bytes,
    tail_scale,
)
from burnish.transport.rows import Rows
from tests.runtime.worlds import basis_of

SOLID_ANGLE = np.diff(1 - np.cos(np.linspace(0, 1, 33) ** 2 * np.pi / 2))
SCALE = column_scale_of(np.concatenate([[np.pi], np.pi * SOLID_ANGLE]))


def light(rows: int = 64, tails: int = 35, seed: int = 0) -> Float32:
    """Smooth light over a square, as a diffuse and a glossy layer of 32 bins see it."""
    rng = np.random.default_rng(seed)
    y, x = np.divmod(np.arange(rows), 8) / np.float64(8)
    theta = (np.linspace(0, 1, 33)[1:] ** 2)[None]
    T = np.zeros((rows, 33, tails, 3))
    for k in range(3):
        wave = 1 + np.sin(9 * (theta + (0.3 * x * (k + 1) + 0.2 * y)[:, None]) + k)
        columns = np.concatenate([(1 + 0.3 * x)[:, None], wave * SOLID_ANGLE], axis=1)
        tail = rng.random((tails, 3)) * np.exp(-4 * rng.random(tails))[:, None]
        T += columns[:, :, None, None] * tail[None, None]
    return T.astype(np.float32)


def size_of(T: Float32) -> float:
    return float(np.linalg.norm(T / SCALE[None, :, None, None]))


def indices(T: Float32) -> np.ndarray:
    return np.arange(len(T), dtype=np.int32)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("rows", [1, 3, 64])
def test_error_stays_within_the_tolerance(tolerance: float, rows: int) -> None:
    T = light(rows)
    block = compress(T, 2, True, indices(T), SCALE, tolerance)
    # Half precision of the core adds no more than its unit roundoff to every entry
    assert size_of(block.dense() - T) <= (tolerance + 2**-10) * size_of(T)
    assert (block.object, block.indirect) == (2, True)
    assert block.core.dtype == np.float16
    assert block.nbytes < rgbe_bytes(T)


def test_smooth_light_is_small() -> None:
    T = light()
    block = compress(T, 0, False, indices(T), SCALE, 0.01)
    assert block.nbytes * 15 < rgbe_bytes(T)


def test_tolerance_zero_keeps_every_number() -> None:
    T = np.random.default_rng(1).random((5, 33, 7, 3)).astype(np.float32)
    block = compress(T, 0, False, indices(T), SCALE, 0.0)
    np.testing.assert_allclose(block.dense(), T, rtol=3e-7)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_any_brightness_fits_in_half_precision(scale: float) -> None:
    T = light() * np.float32(scale)
    block = compress(T, 0, False, indices(T), SCALE, 0.01)
    assert np.isfinite(block.core).all()
    assert size_of(block.dense() - T) <= 0.011 * size_of(T)


def test_no_light_is_nothing() -> None:
    T = np.zeros((4, 33, 7, 3), np.float32)
    block = compress(T, 0, False, indices(T), SCALE)
    assert block.nbytes == 0
    np.testing.assert_array_equal(block.dense(), T)


def test_pure_noise_is_no_larger_than_rgbe() -> None:
    rng = np.random.default_rng(2)
    T = rng.random((64, 33, 35, 3)) * (rng.random((64, 33, 35, 1)) < 0.1)
    T = T.astype(np.float32)
    assert compress(T, 0, False, indices(T), SCALE, 0.01).nbytes <= rgbe_bytes(T)


def noisy(truth: Float32, seed: int) -> Float32:
    """Poisson counts of equal weight, as splats of paths are."""
    step = 2e-3
    return (np.random.default_rng(seed).poisson(truth / step) * step).astype(np.float32)


def test_noise_is_cut_at_a_third_of_rgbe() -> None:
    T = noisy(light(), 3)
    assert compress(T, 0, False, indices(T), SCALE, 0.01).nbytes <= rgbe_bytes(T) / 3


def rounding_of_the_means(block: Block, T: Float32, protected: Float64) -> Float64:
    """The most that number formats can change Σ_rz T p_z: float64 [c, p, 3].

    The core is rounded to half precision, each entry by its unit roundoff 2⁻¹¹ or, below the
    normal numbers, by half a step of 2⁻²⁴. What is stored of U, S and the column scales says
    how much of each entry is in a mean. Everything else is sums in single precision, each
    over at most n numbers: n · 2⁻²⁴ of the sum of their sizes (Higham 2002, section 3.1).
    """
    unit = 2.0**-11
    core = np.abs(block.core.astype(np.float64)) * (unit / (1 - unit)) + 2.0**-25
    rows = np.abs(block.U.sum(axis=0, dtype=np.float64))
    tails = np.abs(block.S.astype(np.float64) @ protected)
    half = np.einsum("a,acbh,bp,c->cph", rows, core, tails, block.column_scale)
    n = sum(block.U.shape) + sum(block.S.shape)
    return half + n * 2.0**-24 * np.einsum("rczh,zp->cph", np.abs(T), np.abs(protected))


@pytest.mark.parametrize("weighed", [False, True])
@pytest.mark.parametrize("series", [(6, 1, 1), (6, 3, 1)])
def test_the_means_of_a_square_survive_any_truncation(
    series: tuple[int, ...], weighed: bool
) -> None:
    basis = basis_of(series)
    protected = protected_tails(basis)
    np.testing.assert_allclose(protected.T @ protected, np.eye(protected.shape[1]), atol=1e-6)
    T = np.random.default_rng(4).random((64, 33, basis.tails, 3)).astype(np.float32)
    T *= np.random.default_rng(5).random(T.shape[:3])[..., None] < 0.2
    scale = tail_scale(basis) if weighed else None
    block = compress(T, 0, False, indices(T), SCALE, 0.9, protected, 0, scale)
    assert block.U.shape[1] < 64
    kept = protected.astype(np.float64)
    means = [np.einsum("rczh,zp->cph", x.astype(np.float64), kept) for x in (T, block.dense())]
    assert (np.abs(means[1] - means[0]) <= rounding_of_the_means(block, T, kept)).all()


def test_tails_of_albedo_one_half_are_protected() -> None:
    basis = basis_of((6, 3, 1))
    protected = protected_tails(basis).astype(np.float64)
    albedo = np.full((len(basis.variables), 3), 0.5)
    further = np.tile(basis.monomials.evaluate(albedo)[:, 0], len(basis.coarse))
    for vector in (np.eye(basis.tails)[0], np.concatenate([[0.0], further])):
        np.testing.assert_allclose(protected @ (protected.T @ vector), vector, atol=1e-6)


def test_tails_of_narrow_coarse_bins_are_as_precious_as_their_coefficients() -> None:
    """A gloss whose coarse coefficients reach far apart keeps its light at the same rank."""
    basis = basis_of((6, 3, 1))
    scale = tail_scale(basis)
    energies = basis_energies(basis)
    assert scale[0] == 1
    np.testing.assert_allclose(
        scale[1:].reshape(len(basis.coarse), -1)[:, 0] ** 2, energies, rtol=1e-6
    )
    # Light in the narrowest bin alone, beside far more in the widest
    T = np.zeros((64, 33, basis.tails, 3), np.float32)
    rng = np.random.default_rng(8)
    z = 1 + np.array([energies.argmin(), energies.argmax()]) * len(basis.monomials)
    for tail in z:
        T[:, :, tail] = rng.random((64, 1, 3)) * scale[tail] ** 2
    kept = compress(T, 0, False, indices(T), SCALE, 0.01, protected_tails(basis), 0, scale)
    narrow = int(z[0])
    lost = np.abs(kept.dense() - T)[:, :, narrow].max() / T[:, :, narrow].max()
    assert lost < 0.02


def basis_energies(basis: Basis) -> np.ndarray:
    """e_w / π of every coarse column."""
    return np.concatenate(
        [
            coarse_energies(layer, coarse_count(layer, basis.coarse_bins)) / np.pi
            for item in basis.objects
            for layer in item.material.layers
        ]
    )


def test_a_tile_is_cut_into_squares_of_eight_pixels() -> None:
    basis = basis_of((6, 1, 1))
    width = 20
    pixel = np.flatnonzero(np.random.default_rng(6).random(width * 16) < 0.7).astype(np.int32)
    count = len(pixel)
    rows = Rows.empty().select(np.zeros(0, int))
    rows = Rows(
        **{
            **{
                name: np.zeros((count, *getattr(rows, name).shape[1:]), getattr(rows, name).dtype)
                for name in vars(rows)
            },
            "pixel": pixel,
        }
    )
    rng = np.random.default_rng(7)
    T = rng.random((count, basis.columns(0), basis.tails, 3)).astype(np.float32)
    T[(pixel % width < 8) & (pixel // width < 8)] = 0
    which = np.arange(count, dtype=np.int32)
    blocks = compress_tile(T, rows, which, width, basis, 0.0)
    joined = np.zeros_like(T)
    for block in blocks:
        x, y = pixel[block.rows] % width // 8, pixel[block.rows] // width // 8
        assert len(set(zip(x.tolist(), y.tolist(), strict=True))) == 1
        assert (np.diff(pixel[block.rows]) > 0).all()
        columns = slice(block.start, block.start + len(block.column_scale))
        joined[block.rows, columns] = block.dense()
    # Six squares, one of them dark; two layers each
    assert len(blocks) == 5 * 2
    np.testing.assert_allclose(joined, T, rtol=3e-7)
    assert compress_tile(T[:0], rows, which[:0], width, basis) == []


def test_narrow_bins_weigh_as_much_as_their_energy() -> None:
    energies = np.array([4.0, 1e-4, -1e-4, 0.0])
    np.testing.assert_allclose(column_scale_of(energies), [2.0, 1e-2, 1e-2, 2e-4], rtol=1e-6)
    np.testing.assert_array_equal(column_scale_of(np.zeros(3)), np.ones(3))
