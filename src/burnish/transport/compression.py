"""From dense transport to blocks: a truncated higher-order SVD per 8 × 8-pixel square.

The rows of one object inside one small square see nearly the same light, so their
transport is of low rank over rows and over tails (`block`). Ranks are found for each
block by itself, from the spectra of its two unfoldings (De Lathauwer et al. 2000,
sequentially truncated as in Vannieuwenhoven et al. 2012), which are those of Gram
matrices no larger than the rows or the tails.

What a bin's error costs is what its coefficient multiplies. A lobe of a given energy
has coefficients like 1/e_j, with e_j the energy that a constant curve puts into bin j
(for a half-vector bin, its solid angle up to masking). By Cauchy and Schwarz,

    |Σ_j c_j δT_j| ≤ (Σ_j e_j c_j²)^½ · (Σ_j δT_j² / e_j)^½,

so the truncation is made in the norm with column weights w_j = e_j^-½.

Monte Carlo noise has no low rank, and in that norm it outweighs the signal up to many
thousand samples per pixel. Ranks that followed it would store noise. So the noise is
measured, from the difference of two halves of the samples, and a component is dropped
when the *signal* lost with everything after it is within the tolerance.
"""

from __future__ import annotations

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Float32, Float64, Int32
from burnish.materials.coefficients import coarse_energies, energies
from burnish.transport.basis import Basis, coarse_count
from burnish.transport.block import Block
from burnish.transport.rows import Rows

SQUARE = 8
"""Pixels on the side of the square whose rows share a block."""

DEFAULT_TOLERANCE = 0.01
"""Relative L2 error of the weighted signal that a block may have."""

_SKETCHES = 8

_RGBE_BYTES = 4
_SMALLEST_ENERGY = 1e-8


def column_scale_of(energies: Float64) -> Float32:
    """1/w_c for columns of the given energies e_c [columns]: float32 [columns].

    Energies of correction terms (quotients after the first) may be tiny or negative; they
    count by their size, and none below 1e-8 of the largest.
    """
    size = np.abs(energies)
    largest = float(size.max(initial=0.0))
    if largest == 0.0:
        return np.ones(len(size), np.float32)
    return np.sqrt(np.maximum(size, _SMALLEST_ENERGY * largest)).astype(np.float32)


def column_scale(basis: Basis, index: int, indirect: bool = False) -> Float32:
    """`column_scale_of` the columns of one object's rows: float32 [columns]."""
    parts = []
    for layer in basis.objects[index].material.layers:
        if indirect:
            parts.append(coarse_energies(layer, coarse_count(layer, basis.indirect_bins)))
            continue
        _, weight, directional = energies(layer)
        parts.append(np.pi * np.einsum("o,okj->kj", weight, directional).ravel())
        if layer.delta:
            parts.append(np.array([np.pi]))
    return column_scale_of(np.concatenate(parts))


def rgbe_bytes(T: Float32) -> int:
    """Bytes of T [r, c, z, 3] as RGBE with zeros dropped, the storage of 2008, section 6.

    Four bytes per (row, column, tail) that is not black; positions are not counted.
    """
    return _RGBE_BYTES * int(np.count_nonzero(T.any(axis=-1)))


def sketch(T: Float32, column_scale: Float32) -> Float32:
    """Random projections from which `compress_tile` measures the noise.

    T: float32 [r, c, z, 3], the estimate from the first half of the samples, on the same
    scale as the final one. Returns float32 [r, z, 8]: sums over columns and channels with
    random signs, so that the mean square over the last axis has the expectation
    Σ_c Σ_h (T / column_scale)². Linear in T.
    """
    r, c, z, _ = T.shape
    random = np.random.default_rng(0x5EED)
    signs = random.choice(np.array([-1.0, 1.0], np.float32), (_SKETCHES, c)) / column_scale
    channel_signs = random.choice(np.array([-1.0, 1.0], np.float32), (_SKETCHES, 3))
    projected = (signs @ T.reshape(r, c, z * 3)).reshape(r, _SKETCHES, z, 3)
    return np.asarray(np.einsum("rkzh,kh->rzk", projected, channel_signs))


def compress(
    T: Float32,
    object_index: int,
    indirect: bool,
    rows: Int32,
    column_scale: Float32,
    tolerance: float = DEFAULT_TOLERANCE,
    noise: Float32 | None = None,
) -> Block:
    """Compress the transport of one square's rows.

    T: float32 [r, c, z, 3], linear RGB. rows: int32 [r], what `Block.rows` will hold.
    column_scale: float32 [c], see `column_scale_of`. tolerance: the weighted relative L2
    error allowed; 0 keeps every number in float32. noise: float32 [r, z], the expected
    square of T's noise, weighted, summed over columns and channels; None for none.
    No block is larger than `rgbe_bytes(T)` unless its ranks are (1, 1).
    """
    weighted = T / column_scale[None, :, None, None]
    if tolerance <= 0.0:
        return _lossless(weighted, object_index, indirect, rows, column_scale)
    r, c, z, _ = T.shape
    noise_energy = np.zeros((r, z)) if noise is None else noise.astype(np.float64)

    # Rotate the rows onto their principal directions
    row_spectrum, row_basis = _principal(weighted.reshape(r, -1), tolerance)
    total = float(row_spectrum.sum())
    if total <= 0.0:
        return _empty(T.shape, object_index, indirect, rows, column_scale)
    allowed = 0.5 * tolerance**2 * max(total - float(noise_energy.sum()), 0.0)
    row_noise = (row_basis.astype(np.float64) ** 2).T @ noise_energy.sum(axis=1)
    kept = _rank(row_spectrum, row_noise, allowed)
    core = (row_basis[:, :kept].T @ weighted.reshape(r, -1)).reshape(kept, c, z, 3)

    # Then the tails, with the noise that the kept rows still carry
    unfolded = np.ascontiguousarray(core.transpose(2, 0, 1, 3)).reshape(z, -1)
    tail_spectrum, tail_basis = _principal(unfolded, tolerance)
    kept_noise = (row_basis[:, :kept].astype(np.float64) ** 2).sum(axis=1) @ noise_energy
    tail_noise = (tail_basis.astype(np.float64) ** 2).T @ kept_noise
    a, b = _fit(
        row_spectrum,
        tail_spectrum,
        kept,
        _rank(tail_spectrum, tail_noise, allowed),
        (r, c, z),
        rgbe_bytes(T),
    )
    rotated = (tail_basis[:, :b].T @ unfolded).reshape(b, kept, c, 3)[:, :a]
    return _scaled(
        row_basis[:, :a],
        np.ascontiguousarray(rotated.transpose(1, 2, 0, 3)),
        tail_basis[:, :b].T,
        object_index,
        indirect,
        rows,
        column_scale,
    )


def compress_tile(
    T: Float32,
    rows: Rows,
    which: Int32,
    width: int,
    column_scale: Float32,
    tolerance: float = DEFAULT_TOLERANCE,
    half: Float32 | None = None,
) -> list[Block]:
    """Compress a tile's rows of one object and kind, square by square.

    T: float32 [r, c, z, 3]. rows: the tile's rows. which: int32 [r], the rows of T among
    them, all of one object and kind. width: pixels across the whole view. half: `sketch`
    of the estimate that the first half of the samples gave, for telling signal from
    noise; without it noise is stored as if it were signal, up to the size of RGBE.
    Squares with no light at all give no block.
    """
    if len(which) == 0:
        return []
    noise = None
    if half is not None:
        noise = ((half - sketch(T, column_scale)) ** 2).mean(axis=-1)
    pixel = rows.pixel[which]
    square = (pixel // width // SQUARE).astype(np.int64) * (width // SQUARE + 1)
    square += pixel % width // SQUARE
    order = np.lexsort((pixel, square))
    cuts = np.flatnonzero(np.diff(square[order])) + 1
    object_index, indirect = int(rows.object[which[0]]), bool(rows.indirect[which[0]])

    def work(members: AnyArray) -> Block:
        return compress(
            T[members],
            object_index,
            indirect,
            which[members],
            column_scale,
            tolerance,
            None if noise is None else noise[members],
        )

    return [block for block in parallel_map(work, np.split(order, cuts)) if block.U.size]


def _principal(unfolded: Float32, tolerance: float) -> tuple[Float64, Float32]:
    """Squared singular values, largest first, and left singular vectors of a matrix."""
    # Gram matrices square the condition: below 0.002 single precision would not resolve it
    wide = unfolded.astype(np.float64) if tolerance < 2e-3 else unfolded
    values, vectors = np.linalg.eigh((wide @ wide.T).astype(np.float64))
    return np.maximum(values[::-1], 0.0), vectors[:, ::-1].astype(np.float32)


def _rank(spectrum: Float64, noise: Float64, allowed: float) -> int:
    """The smallest rank, at least 1, that discards no more than the allowed signal energy."""
    signal = spectrum - noise
    discarded = np.append(np.cumsum(signal[::-1])[::-1][1:], 0.0)
    return int(np.argmax(discarded <= allowed)) + 1


def _fit(
    row_spectrum: Float64,
    tail_spectrum: Float64,
    a: int,
    b: int,
    shape: tuple[int, int, int],
    budget: int,
) -> tuple[int, int]:
    """The ranks up to (a, b) that lose least within a budget of bytes; at least (1, 1)."""
    r, c, z = shape
    ranks_a, ranks_b = np.arange(1, a + 1)[:, None], np.arange(1, b + 1)[None, :]
    size = 4 * r * ranks_a + 6 * c * ranks_a * ranks_b + 4 * z * ranks_b
    lost_a = row_spectrum.sum() - np.cumsum(row_spectrum)[:a]
    lost_b = tail_spectrum.sum() - np.cumsum(tail_spectrum)[:b]
    lost = np.where(size <= budget, lost_a[:, None] + lost_b[None, :], np.inf)
    if not np.isfinite(lost).any():
        return 1, 1
    best = np.unravel_index(int(np.argmin(lost)), lost.shape)
    return int(best[0]) + 1, int(best[1]) + 1


def _scaled(
    U: Float32,
    core: Float32,
    S: Float32,
    object_index: int,
    indirect: bool,
    rows: Int32,
    column_scale: Float32,
) -> Block:
    """A block whose half-precision core uses its range: each slice over a peaks at 1."""
    peak = np.abs(core).max(axis=(1, 2, 3))
    scale = np.where(peak > 0.0, peak, 1.0).astype(np.float32)
    return Block(
        object=object_index,
        indirect=indirect,
        rows=rows.astype(np.int32),
        U=np.ascontiguousarray(U * scale),
        core=(core / scale[:, None, None, None]).astype(np.float16),
        S=np.ascontiguousarray(S, dtype=np.float32),
        column_scale=column_scale,
    )


def _lossless(
    weighted: Float32, object_index: int, indirect: bool, rows: Int32, column_scale: Float32
) -> Block:
    r, _, z, _ = weighted.shape
    return Block(
        object_index,
        indirect,
        rows.astype(np.int32),
        np.eye(r, dtype=np.float32),
        weighted.astype(np.float32),
        np.eye(z, dtype=np.float32),
        column_scale,
    )


def _empty(
    shape: tuple[int, ...],
    object_index: int,
    indirect: bool,
    rows: Int32,
    column_scale: Float32,
) -> Block:
    r, c, z, _ = shape
    return Block(
        object_index,
        indirect,
        rows.astype(np.int32),
        np.zeros((r, 0), np.float32),
        np.zeros((0, c, 0, 3), np.float16),
        np.zeros((0, z), np.float32),
        column_scale,
    )
