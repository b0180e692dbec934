"""Gather samples and the light transfer from them: the data of relighting (2010).

Surfaces are cut into *cells*, one for each gather sample. A cell has one radiance L, linear
RGB, the same towards all sides. A row x of a view receives

    I(x) = Σ_c coefficient_c · (T(x) L)_c        (2010, eq. 7; c runs over an object's columns,
                                                  a diffuse layer's T being the paper's D)

and the cells receive M L, an irradiance over π, from each other; an albedo then makes it
radiance (2010, eq. 16–17, with M_s = albedo × M, so that albedos and textures stay editable).

The cells are the leaves of a binary tree. A matrix is kept in blocks of neighbouring rows. A
block reads means over nodes of the tree: for each column the nodes of a *cut*, whose span is
that of the Haar wavelets of all nodes above it, the columns sharing one budget; and it has
few directions r among its rows: T ≈ U S.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from burnish.core.types import AnyArray, Float32, Int32
from burnish.transport.basis import Basis
from burnish.transport.rows import Rows


@dataclass(frozen=True)
class CellTree:
    """A binary tree over g cells, which stand in the order of its leaves.

    Arrays over n nodes, parents before children: start, stop: int32, the node's cells.
    child: int32, the first of its two children, side by side; -1 for a leaf. extent: float32,
    how far apart the cells of the node lie, 0 for a leaf. area: float32 [g], of the cells.
    """

    start: Int32
    stop: Int32
    child: Int32
    extent: Float32
    area: Float32

    @property
    def cells(self) -> int:
        return int(self.stop[0])

    def means(self, values: Float32) -> Float32:
        """The mean of a quantity of cells [g, q] over every node, by area: float32 [n, q]."""
        sums = np.zeros((len(values) + 1, values.shape[1] + 1))
        np.cumsum(values * self.area[:, None], axis=0, dtype=np.float64, out=sums[1:, :-1])
        np.cumsum(self.area, dtype=np.float64, out=sums[1:, -1])
        total = sums[self.stop] - sums[self.start]
        return np.asarray(total[:, :-1] / total[:, -1:], np.float32)


@dataclass(frozen=True)
class Blocks:
    """Blocks of one shape: k of them, of R rows, r directions and m terms.

    rows: int32 [k, R], one past the last row where padded. U: float32 [k, R, r]. S: float32
    [k, r, m]. node, column: int32 [k, m], rising by column within a block; padded terms have
    S = 0.
    """

    rows: Int32
    U: Float32
    S: Float32
    node: Int32
    column: Int32

    @property
    def nbytes(self) -> int:
        arrays: tuple[AnyArray, ...] = (self.rows, self.U, self.S, self.node, self.column)
        return sum(array.nbytes for array in arrays)


@dataclass(frozen=True)
class Transfer:
    """A matrix [rows, columns, cells] in blocks; a row lies in one block at most."""

    rows: int
    columns: int
    blocks: tuple[Blocks, ...]

    @property
    def nbytes(self) -> int:
        return sum(blocks.nbytes for blocks in self.blocks)


@dataclass(frozen=True)
class RowTransfer:
    """What the rows of one object receive through the columns of one layer.

    object: index into `Basis.objects`; -1 for fixed surfaces, whose columns are the three
    channels of what they reflect. layer: of the material. row: int32 [r], into the view's rows
    (pixels for fixed surfaces). tint: float32 [r, 3], the mean weight map of the layer times
    what mirrors before the row reflect. transfer: has the layer's columns, those of a delta
    lobe last, and r rows.
    """

    object: int
    layer: int
    row: Int32
    tint: Float32
    transfer: Transfer


@dataclass(frozen=True)
class GatherSamples:
    """The cells' samples, in the order of the tree's leaves; p points in each cell.

    Some cells are no surface that is lit but what glossy objects show of the lights: parts of
    the sky, whose points are directions, and whole lamps (`shows`, `through`).

    position, normal: float32 [g, 3], world space, the normal on the side that is seen; area:
    float32 [g]; glossy: bool [g], found by a glossy reflection. object: int32 [g], index into
    the scene's objects.
    point, point_normal, point_surface: float32 [g, p, 3], where direct light is asked: the
    shading normal and the true one.
    variable: int32 [g, v], of the polynomial, -1 for none. reflects: float32 [g, p, v, 3], the
    weight map of each at the points. fixed: float32 [g, p, 3], the albedo of what is no variable.
    shows: int32 [g], which of the scene's lights the cell shows, -1 for surfaces; through: int32
    [g], the object of the basis that shows it.
    """

    position: Float32
    normal: Float32
    area: Float32
    glossy: AnyArray
    object: Int32
    point: Float32
    point_normal: Float32
    point_surface: Float32
    variable: Int32
    reflects: Float32
    fixed: Float32
    shows: Int32
    through: Int32

    def __len__(self) -> int:
        return len(self.area)


@dataclass(frozen=True)
class GatherView:
    """One view's transfer. width, height: pixels. rows: those that an editable object is met in."""

    width: int
    height: int
    rows: Rows
    parts: tuple[RowTransfer, ...]


@dataclass(frozen=True)
class GatherData:
    """All that was precomputed of a scene. bounce: M, one column, of all cells' rows."""

    basis: Basis
    tree: CellTree
    samples: GatherSamples
    bounce: Transfer
    views: dict[str, GatherView] = field(default_factory=dict)

    @property
    def nbytes(self) -> dict[str, int]:
        """Bytes of T, D and M, as the paper's Table 5 counts them."""
        sizes = {"T": 0, "D": 0, "M": self.bounce.nbytes}
        for view in self.views.values():
            for part in view.parts:
                sizes["D" if part.transfer.columns in (1, 3) else "T"] += part.transfer.nbytes
        return sizes
