"""Direct light as blocks: of low rank where it is smooth, every row where it is not.

What is gathered has little noise, and is looked at through lobes that are narrower than any
traced transport's: a row whose mirror direction misses a lamp shows what it has there, however
bright the lamp is in its other bins or in its neighbours' rows. So rows and columns are scaled
to equal size before the truncation, by turns (Sinkhorn 1964), and each entry keeps about the
same relative error. Ranks follow from that error alone; with as many as there are rows the
block is the rows themselves, in half precision.
"""

from __future__ import annotations

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Float32, Float64, Int32
from burnish.transport.basis import Basis
from burnish.transport.block import Block
from burnish.transport.compression import SQUARE, column_scale
from burnish.transport.rows import Rows

TOLERANCE = 0.02
"""Relative L2 error of the scaled entries of a block."""

DIMMEST = 1e-3
"""Of the brightest bin of a block, radiance below which a bin's error may be larger."""


def compress_rows(
    T: Float32, rows: Rows, which: Int32, width: int, basis: Basis, tolerance: float = TOLERANCE
) -> list[Block]:
    """Compress rows of one object, square by square and layer by layer.

    T: float32 [r, c, z, 3 or more]. rows: the tile's. which: int32 [r], the rows of T among
    them, all fine rows of one object. width: pixels across the view. Squares without light
    give no block.
    """
    index = int(rows.object[which[0]])
    scale = column_scale(basis, index)
    pixel = rows.pixel[which]
    square = (pixel // width // SQUARE).astype(np.int64) * (width // SQUARE + 1)
    square += pixel % width // SQUARE
    order = np.lexsort((pixel, square))
    cuts = np.flatnonzero(np.diff(square[order])) + 1

    def work(members: AnyArray) -> list[Block]:
        found = []
        for part in basis.slices(index):
            values = T[members, part.start : part.stop, :, :3]
            lit = values.any(axis=(1, 2, 3))
            if lit.any():
                own = which[members[lit]]
                block = _compress(values[lit], scale[part.start : part.stop], tolerance)
                found.append(Block(index, False, own, *block, part.start))
        return found

    return [block for blocks in parallel_map(work, np.split(order, cuts)) for block in blocks]


def _compress(
    T: Float32, scale: Float32, tolerance: float
) -> tuple[Float32, AnyArray, Float32, Float32]:
    """U, core, S and the columns' scale of a block; T: float32 [r, c, z, 3]."""
    r, c, z, _ = T.shape
    across, down = _sizes(T.astype(np.float64), scale)
    scaled = (T / (across[:, None, None, None] * down[None, :, None, None])).reshape(r, -1)
    values, vectors = np.linalg.eigh((scaled @ scaled.T).astype(np.float64))
    energy = np.maximum(values[::-1], 0.0)
    lost = np.append(np.cumsum(energy[::-1])[::-1], 0.0)
    rank = max(int(np.argmax(lost <= tolerance**2 * lost[0])), 1)
    basis = vectors[:, ::-1][:, :rank]
    core = (basis.T @ scaled).reshape(rank, c, z, 3) * (down / scale)[None, :, None, None]
    U = across[:, None] * basis
    peak = np.abs(core).max(axis=(1, 2, 3))
    peak = np.where(peak > 0.0, peak, 1.0)
    return (
        np.ascontiguousarray(U * peak, np.float32),
        (core / peak[:, None, None, None]).astype(np.float16),
        np.eye(z, dtype=np.float32),
        scale,
    )


def _sizes(T: Float64, scale: Float32) -> tuple[Float64, Float64]:
    """Sizes of the rows [r] and the columns [c] of T [r, c, z, 3], by which its entries are
    divided; scale: that of even radiance over the columns."""
    square = (T * T).mean(axis=(2, 3))
    across = np.ones(len(square))
    down = np.ones(square.shape[1])
    even = scale.astype(np.float64) ** 2
    for _ in range(2):
        own = np.sqrt((square / across[:, None] ** 2).mean(axis=0))
        down = np.maximum(own, DIMMEST * even * (own / even).max())
        across = np.sqrt((square / down[None] ** 2).mean(axis=1))
    return across, down
