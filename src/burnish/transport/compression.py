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

so the truncation is made in the norm with column weights w_j = e_j^-½. Columns that are
principal components have no such energies: there w_j is the size that c_j has over the range
of the parameters.

Monte Carlo noise has no low rank, and in that norm it outweighs the signal up to many
thousand samples per pixel. Ranks that followed it would store noise, so they stop at a
third of what RGBE would take. A truncation in noise drops signal as well, and always
downwards: with ranks (8, 8) a sharp lobe lost 5 % of its mean at 64 samples per pixel. So
a few directions are kept whatever the spectrum says: the mean over the rows, and the tails
of a scene of albedo one half and of the scene's own materials. With them the means of a
square are the samples' own (to 0.4 % at 64 samples, 0.1 % at 1,024), and only detail inside
it is given up. Which detail, the protected tails decide: rows are told apart by what those
see, many samples together, before noise is (on the ring at (64, 16) and 1,024 samples: 8 %
error instead of 34 %).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Float32, Float64, Int32
from burnish.materials.coefficients import coarse_energies, energies
from burnish.transport.basis import Basis, coarse_count, initial_state
from burnish.transport.block import Block
from burnish.transport.cells import Cells
from burnish.transport.rows import Rows

SQUARE = 8
"""Pixels on the side of the square whose rows share a block."""

DEFAULT_TOLERANCE = 0.01
"""Relative L2 error of the weighted signal that a block may have."""

_CLEAR_SHARE = 10.0
"""Weight of the Gram matrix of the protected tails beside that of all tails, for the rows."""

_FEW_COLUMNS = 4
_RGBE_BYTES = 4
_SMALLEST_ENERGY = 1e-8
_DEPENDENT = 1e-6
"""Singular values below this share of the largest are rounding."""


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
        sizes = layer.model.amplitude_sizes()
        if sizes is None:
            _, weight, directional = energies(layer)
            parts.append(np.pi * np.einsum("o,okj->kj", weight, directional).ravel())
        else:
            parts.append(1 / np.maximum(sizes, 1e-6 * sizes.max()) ** 2)
        if layer.delta:
            parts.append(np.array([np.pi]))
    return column_scale_of(np.concatenate(parts))


def rgbe_bytes(T: Float32) -> int:
    """Bytes of T [..., 3] as RGBE with zeros dropped, the storage of 2008, section 6.

    Four bytes per triple that is not black; positions are not counted.
    """
    # Bits rather than `any` over a short axis, which is several times slower
    bits = np.ascontiguousarray(T).view(np.uint32)
    return _RGBE_BYTES * int(np.count_nonzero(bits[..., 0] | bits[..., 1] | bits[..., 2]))


def tail_scale(basis: Basis) -> Float32:
    """1/w_z of every tail: float32 [z].

    A coarse coefficient of the second encounter is like a column's: up to π/e_w for a lobe
    that lies in bin w. Without weights the tails of narrow coarse bins were cut off as small
    and then multiplied by hundreds.
    """
    result = np.ones(basis.light_tails, np.float32)
    if basis.coarse:
        energies = [
            coarse_energies(layer, coarse_count(layer, basis.coarse_bins)) / np.pi
            for item in basis.objects
            for layer in item.material.layers
        ]
        result[1:] = np.repeat(
            np.concatenate([column_scale_of(part) for part in energies]), len(basis.monomials)
        )
    return np.tile(result, max(len(basis.lights), 1))


def protected_tails(basis: Basis) -> Float32:
    """Directions over the tails that a block keeps exactly: float32 [z, kept], orthonormal.

    The tails of a scene whose albedos are all one half, and those of the materials that the
    scene came with; for the slower series the light that met nothing further by itself, and
    the second encounters once with even curves and once with the scene's. Each of them for
    every light group by itself. See the module's text for why.
    """
    alone = _protected_of_one_light(replace(basis, lights=()))
    return np.kron(np.eye(max(len(basis.lights), 1), dtype=np.float32), alone)


def _protected_of_one_light(basis: Basis) -> Float32:
    degree = basis.monomials.exponents.sum(axis=1)
    powers = 0.5**degree
    if not basis.coarse:
        own = basis.tail_values(initial_state(basis.objects)).mean(axis=1)
        return _orthonormal(np.stack([powers, own], axis=1))
    even = np.concatenate([[0.0], np.tile(powers, len(basis.coarse))])
    own = basis.coarse_values(initial_state(basis.objects)).mean(axis=1)
    given = np.concatenate([[0.0], np.outer(own, powers).ravel()])
    direct = np.zeros(basis.tails)
    direct[0] = 1.0
    return _orthonormal(np.stack([direct, even, given], axis=1))


def compress(
    T: Float32,
    object_index: int,
    indirect: bool,
    rows: Int32,
    column_scale: Float32,
    tolerance: float = DEFAULT_TOLERANCE,
    protected: Float32 | None = None,
    start: int = 0,
    tails: Float32 | None = None,
) -> Block:
    """Compress the transport of one square's rows.

    T: float32 [r, c, z, 3], linear RGB. rows: int32 [r], what `Block.rows` will hold.
    column_scale: float32 [c], see `column_scale_of`. tolerance: the weighted relative L2
    error allowed; 0 keeps every number in float32. protected: see `protected_tails`. start:
    the first of the columns c among the object's. tails: float32 [z], see `tail_scale`; 1
    without it.
    """
    cells = Cells.of(T, np.arange(len(T)))
    if protected is None:
        protected = _orthonormal(np.ones((T.shape[2], 1)))
    if tails is None:
        tails = np.ones(T.shape[2], np.float32)
    return _compress(
        cells, object_index, indirect, rows, column_scale, tails, tolerance, protected, start
    )


def _compress(
    cells: Cells,
    object_index: int,
    indirect: bool,
    rows: Int32,
    column_scale: Float32,
    tail_scale: Float32,
    tolerance: float,
    protected: Float32,
    start: int,
) -> Block:
    """`compress` of what is left of T without its black (column, tail) pairs."""
    r, n, _ = cells.values.shape
    c, z = cells.columns, cells.tails
    if n == 0:
        return _empty((r, c, z, 3), object_index, indirect, rows, column_scale, start)
    if tolerance <= 0.0:
        weighted = cells.scaled(np.reciprocal(column_scale))
        return _lossless(weighted.dense(), object_index, indirect, rows, column_scale, start)
    # Directions over the tails that occur: the others are zero in S
    columns, column_of = np.unique(cells.cells // z, return_inverse=True)
    tails, tail_of = np.unique(cells.cells % z, return_inverse=True)
    weighted = cells.scaled(np.reciprocal(column_scale), np.reciprocal(tail_scale))
    # What is kept exactly is a sum over unweighted tails
    protected = _orthonormal(protected[tails] * tail_scale[tails, None])
    kept = protected.shape[1]
    limit = _affordable(r, c, z, rgbe_bytes(cells.values), slower=kept > 1)

    # Rotate the rows: their mean first, then what deviates from it most
    unfolded = weighted.values.reshape(r, -1)
    gram = unfolded @ unfolded.T
    total = float(np.trace(gram, dtype=np.float64))
    row_basis, row_lost = _row_basis(gram, _clear_gram(weighted, protected, column_of, tail_of))
    a = _rank(row_lost, 0.5 * tolerance**2 * total, minimum=1)
    a = min(a, max(limit // _bytes(r, c, z, 1, kept), 1))
    rotated = unfolded.T @ np.ascontiguousarray(row_basis[:, :a])

    # Then the tails, on the grid of the tails and columns that occur
    core = np.zeros((len(tails) * len(columns), 3 * a), np.float32)
    core[tail_of * len(columns) + column_of] = rotated.reshape(n, 3 * a)
    unfolded = core.reshape(len(tails), -1)
    tail_basis, tail_lost = _principal(unfolded @ unfolded.T, protected)
    b = _rank(tail_lost, 0.5 * tolerance**2 * total, minimum=kept)
    a, b = _fit(row_lost, tail_lost, a, b, kept, limit, (r, c, z))
    if 3 * a < core.shape[1]:
        core = core.reshape(len(core), 3, -1)[:, :, :a]
    small = tail_basis[:, :b].T @ core.reshape(len(tails), -1)
    spread = np.zeros((a, c, b, 3), np.float32)
    spread[:, columns] = small.reshape(b, len(columns), 3, a).transpose(3, 1, 0, 2)
    S = np.zeros((b, z), np.float32)
    S[:, tails] = tail_basis[:, :b].T * tail_scale[tails]
    return _scaled(row_basis[:, :a], spread, S, object_index, indirect, rows, column_scale, start)


def compress_tile(
    T: Float32,
    rows: Rows,
    which: Int32,
    width: int,
    basis: Basis,
    tolerance: float = DEFAULT_TOLERANCE,
    factor: float = 1.0,
    keys: AnyArray | None = None,
) -> list[Block]:
    """Compress a tile's rows of one object and kind, square by square and layer by layer.

    The columns of a diffuse layer and those of a lobe's bins differ in size and in noise by
    orders of magnitude: together, the ranks would follow the noisiest of them.
    T: float32 [r, c, z, 3], or float32 [r, places, 3 or more], whose `keys` are as in
    `Cells.among`. rows: the tile's rows. which: int32 [r], the rows of T among
    them, all of one object and kind. width: pixels across the whole view. factor: what T is
    multiplied by. Squares with no light at all give no block.
    """
    if len(which) == 0:
        return []
    index, indirect = int(rows.object[which[0]]), bool(rows.indirect[which[0]])
    scale, protected = column_scale(basis, index, indirect), protected_tails(basis)
    tails = tail_scale(basis)
    pieces = (basis.indirect_slices if indirect else basis.slices)(index)
    pixel = rows.pixel[which]
    square = (pixel // width // SQUARE).astype(np.int64) * (width // SQUARE + 1)
    square += pixel % width // SQUARE
    columns = pieces[-1].stop
    flat = T.reshape(len(T), -1, T.shape[-1])
    order = np.lexsort((pixel, square))
    cuts = np.flatnonzero(np.diff(square[order])) + 1

    def work(members: AnyArray) -> list[Block]:
        cells = Cells.among(flat, members, columns, basis.tails, keys)
        np.multiply(cells.values, np.float32(factor), out=cells.values)
        lit = cells.lit_rows()
        if not lit.all():
            cells, members = cells.select(lit), members[lit]
        return [
            _compress(
                cells.piece(piece.start, piece.stop),
                index,
                indirect,
                which[members],
                scale[piece.start : piece.stop],
                tails,
                tolerance,
                protected,
                piece.start,
            )
            for piece in pieces
        ]

    found = parallel_map(work, np.split(order, cuts))
    return [block for blocks in found for block in blocks if block.U.size]


def _orthonormal(columns: AnyArray) -> Float32:
    """An orthonormal basis of the columns' span, at least one of which is not zero: float32."""
    basis, size, _ = np.linalg.svd(columns.astype(np.float64), full_matrices=False)
    return np.asarray(basis[:, size > _DEPENDENT * size[0]], np.float32)


def _clear_gram(
    weighted: Cells, protected: Float32, column_of: AnyArray, tail_of: AnyArray
) -> Float32:
    """The rows' Gram matrix as the protected tails alone see the light: float32 [r, r].

    They are sums of many samples that stand together against the noise of each.
    """
    r, kept = len(weighted.values), protected.shape[1]
    first = np.flatnonzero(np.diff(column_of, prepend=-1))
    gram = np.zeros((r, r), np.float32)
    for p in range(kept):
        part = weighted.values * protected[tail_of, p][None, :, None]
        seen = np.add.reduceat(part, first, axis=1).reshape(r, -1)
        gram += seen @ seen.T
    return gram


def _row_basis(gram: Float32, clear: Float32) -> tuple[Float32, Float64]:
    """An orthonormal basis of the rows, their mean first, by what stands out of the noise.

    Returns float32 [r, r] and float64 [r + 1]: the energy that each number of directions
    loses, that of the clear part counted `_CLEAR_SHARE` times.
    """
    total, scale = float(np.trace(gram)), float(np.trace(clear))
    mixed = gram + clear * (_CLEAR_SHARE * total / scale if scale > 0 else 0.0)
    basis, _ = _principal(mixed, _orthonormal(np.ones((len(gram), 1))))
    # Where there is no energy the eigenvectors may lean on the mean
    basis = np.linalg.qr(basis.astype(np.float64))[0].astype(np.float32)
    energy = np.einsum("ra,rs,sa->a", basis, mixed, basis, optimize=True).astype(np.float64)
    lost = np.append(np.maximum(np.cumsum(energy[::-1])[::-1], 0.0), 0.0)
    lost[0] = np.inf
    return basis, lost


def _principal(gram: Float32, protected: Float32) -> tuple[Float32, Float64]:
    """An orthonormal basis of a matrix's columns' space, from its Gram matrix [n, n]: the
    protected directions, then the principal ones of what they leave; and the energy that
    each number of them loses.

    Returns float32 [n, n] and float64 [n + 1].
    """
    # Project the Gram matrix rather than the data
    kept_by = protected.astype(np.float64)
    outside = np.eye(len(gram)) - kept_by @ kept_by.T
    values, vectors = np.linalg.eigh(outside @ gram.astype(np.float64) @ outside)
    kept = len(values) - protected.shape[1]
    spectrum = np.maximum(values[::-1][:kept], 0.0)
    basis = np.concatenate([protected, vectors[:, ::-1][:, :kept].astype(np.float32)], axis=1)
    lost = np.append(np.cumsum(spectrum[::-1])[::-1], 0.0)
    return basis, np.concatenate([np.full(protected.shape[1], np.inf), lost])


def _rank(lost: Float64, allowed: float, minimum: int) -> int:
    """The smallest rank that loses no more than the allowed energy."""
    return max(int(np.argmax(lost <= allowed)), minimum)


def _affordable(r: int, c: int, z: int, rgbe: int, slower: bool) -> int:
    """Bytes that a block may have: a third of RGBE's, or ranks (8, 8) where that is more.

    A few rows at a silhouette need fewer ranks over rows and more over tails. Two kinds of
    block may have more, since their squares can be seen otherwise: layers of few columns,
    such as a diffuse one, which cost little (ranks 32, 8), and the slower series, whose
    tails hold a second lobe (ranks 16, 16). No other block but one of the smallest ranks is
    larger than RGBE.
    """
    if c <= _FEW_COLUMNS:
        return max(rgbe // 3, int(_bytes(r, c, z, 32, 8)))
    if slower:
        return max(rgbe // 3, int(_bytes(r, c, z, 16, 16)))
    return max(rgbe // 3, min(rgbe, int(_bytes(r, c, z, 8, 8))))


def _bytes(r: int, c: int, z: int, a: Any, b: Any) -> Any:
    return 4 * r * a + 6 * c * a * b + 4 * z * b


def _fit(
    row_lost: Float64,
    tail_lost: Float64,
    a: int,
    b: int,
    least_b: int,
    limit: int,
    shape: tuple[int, int, int],
) -> tuple[int, int]:
    """The ranks up to (a, b) that lose least within a limit of bytes."""
    ranks_a, ranks_b = np.arange(1, a + 1)[:, None], np.arange(least_b, b + 1)[None, :]
    lost = row_lost[1 : a + 1, None] + tail_lost[None, least_b : b + 1]
    lost = np.where(_bytes(*shape, ranks_a, ranks_b) <= limit, lost, np.inf)
    best = np.unravel_index(int(np.argmin(lost)), lost.shape)
    return int(best[0]) + 1, int(best[1]) + least_b


def _scaled(
    U: Float32,
    core: Float32,
    S: Float32,
    object_index: int,
    indirect: bool,
    rows: Int32,
    column_scale: Float32,
    start: int,
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
        start=start,
    )


def _lossless(
    weighted: Float32,
    object_index: int,
    indirect: bool,
    rows: Int32,
    column_scale: Float32,
    start: int,
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
        start,
    )


def _empty(
    shape: tuple[int, ...],
    object_index: int,
    indirect: bool,
    rows: Int32,
    column_scale: Float32,
    start: int,
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
        start,
    )
