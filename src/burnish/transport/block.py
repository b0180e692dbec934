"""Blocks: the stored transport of a few neighbouring rows, compressed.

Locality is what compresses: the rows of one object inside one 8 × 8-pixel square see
nearly the same light. A block is a Tucker form of T over (rows, columns, tails, rgb):

    T[r, c, z, h] ≈ Σ_a Σ_b U[r, a] · C[a, c, b, h] / w_c · S[b, z]

with column weights w_c applied before the truncation, so that narrow bins, which hold
little energy but meet the largest coefficients, survive it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from burnish.core.types import Float32, Int32
from burnish.transport.rows import Rows

BLOCK_AXES = ("row", "column", "tail", "rgb")
"""Named axes of what a block stands for. Light groups are outermost on the tail axis; further
axes (second curve, component) extend the column axis. The basis describes both."""


@dataclass
class Block:
    """Compressed transport of rows of one object and one kind, for a run of their columns.

    rows: int32 [r], indices into the tile's (later the view's) Rows, all of one object and
      kind. U: float32 [r, a]. core: float32 or float16 [a, c, b, 3], still multiplied by
      the column weights. S: float32 [b, z]. column_scale: float32 [c], 1/w_c. start: the
      first of the columns c among the object's.
    """

    object: int
    indirect: bool
    rows: Int32
    U: Float32
    core: np.ndarray
    S: Float32
    column_scale: Float32
    start: int = 0

    def dense(self) -> Float32:
        """T: float32 [r, c, z, 3]."""
        core = self.core.astype(np.float32) * self.column_scale[None, :, None, None]
        return np.asarray(np.einsum("ra,acbh,bz->rczh", self.U, core, self.S, optimize=True))

    @property
    def nbytes(self) -> int:
        return self.U.nbytes + self.core.nbytes + self.S.nbytes


@dataclass
class Tile:
    """The finished transport of a rectangle of pixels, as the bake hands it to the store.

    x, y, width, height: the rectangle within the view. rows: its Rows (pixel indices of the
    whole view). blocks: their `rows` index into this tile's rows. fixed: float32
    [height, width, 3], light that met no symbolic object, directly seen emission left out;
    emission: the same, directly seen emission alone; both float32 [lights, height, width, 3]
    where light groups are told apart. samples: per pixel. lost: samples
    whose (pixel, object) the prepass had not found.
    """

    x: int
    y: int
    width: int
    height: int
    rows: Rows
    blocks: list[Block]
    fixed: Float32
    emission: Float32
    samples: int
    lost: int = 0
