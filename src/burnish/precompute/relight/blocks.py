"""From samples to a compressed matrix: cuts through the tree of cells, and row directions.

For each column of a block, cells whose transfer is small, or whose neighbours see the same,
are taken together: of all nodes above the cells those with the largest (transfer × extent) are
opened, as many as the budget says, columns competing for it by their energy. Opened nodes are
closed under parents, as transfer and extent grow towards the root, so that what is kept is the
span of their Haar wavelets.

The rows of a block are combinations of few directions. Their products among each other are
known without the samples' noise, from two independent halves, and directions that are no
larger than the noise are left out: compression cleans.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from burnish.core.types import AnyArray, Float32, Float64, Int32
from burnish.precompute.relight.rays import Samples
from burnish.precompute.relight.smoothing import Smoother
from burnish.transport.gather import Blocks, CellTree, Transfer

ROWS = 256
"""Most rows of a block."""
MOST_DIRECTIONS = 64
FEWER = 64
"""Terms that decide about the directions, and four more for each further column."""
LEAST_ENERGY = 1e-5
"""Of the first direction's, that others have at least."""
PADDED = (2, 4, 8, 16, 24, 32, 48, 64)
"""What the number of directions is padded to, so that one product serves many blocks."""


@dataclass
class Block:
    """One block before it is padded: rows int32 [R], U [R, r], S [r, m], node, column [m]."""

    rows: Int32
    U: Float32
    S: Float32
    node: Int32
    column: Int32


class Compressor:
    """Makes blocks of one kind. weight: float32 [columns], how much a column counts."""

    def __init__(
        self, tree: CellTree, columns: int, terms: int, weight: Float64 | None = None
    ) -> None:
        self.tree, self.columns, self.terms = tree, columns, terms
        self.weight = np.ones(columns) if weight is None else weight
        inner = np.flatnonzero(tree.child >= 0)
        self._inner = inner
        parent = np.full(len(tree.start), -1, np.int64)
        parent[tree.child[inner]] = inner
        parent[tree.child[inner] + 1] = inner
        self._parent = parent

    def block(
        self,
        rows: Int32,
        samples: Samples,
        smoother: Smoother | None = None,
        coverage: Float64 | None = None,
    ) -> Block:
        """rows: where the block's rows stand; samples: theirs, `row` counted in the block.

        coverage: float64 [R], the share of its pixel that each row has, which neighbours need
        not share.
        """
        if coverage is not None:
            scale = np.where(coverage > 0, 1 / np.where(coverage > 0, coverage, 1), 0)
            samples = replace(samples, value=samples.value * scale[samples.row])
        fewer = FEWER + 4 * (self.columns - 1)
        a, b = self._halves(len(rows), samples, *self._cut(samples, fewer)[1:])
        fit = None if smoother is None else smoother.choose(a, b)
        U = _directions(a, b) if fit is None else _directions(fit @ a, fit @ b)
        node, column, term = self._cut(samples, self.terms)
        whole = _table(len(rows), len(node), samples, term)
        S = U.T @ (whole if fit is None else fit @ whole)
        if coverage is not None:
            U = U * coverage[:, None]
        return Block(rows, U.astype(np.float32), S.astype(np.float32), node, column)

    def _halves(
        self, rows: int, samples: Samples, column: Int32, term: AnyArray
    ) -> tuple[Float64, Float64]:
        """Two halves of a table of few terms, weighted: what lights differ in from cell to cell
        counts little, and is noisy."""
        tables = []
        for half in (False, True):
            own = samples.half == half
            some = Samples(*(getattr(samples, name)[own] for name in _FIELDS))
            tables.append(2 * _table(rows, len(column), some, term[own]) * self.weight[column])
        return tables[0], tables[1]

    def _cut(self, samples: Samples, terms: int) -> tuple[Int32, Int32, AnyArray]:
        """Nodes and columns of the terms, rising by column, and the term of every sample."""
        tree, cells = self.tree, self.tree.cells
        at = samples.column.astype(np.int64) * cells + samples.cell
        mass = np.bincount(at, np.abs(samples.value), self.columns * cells)
        sums = np.zeros((self.columns, cells + 1))
        np.cumsum(mass.reshape(self.columns, cells), axis=1, out=sums[:, 1:])
        inner = self._inner
        share = sums[:, tree.stop[inner]] - sums[:, tree.start[inner]]
        worth = share * tree.extent[inner] * self.weight[:, None]
        used = worth > 0
        budget = max(terms - self.columns, 1)
        opened = np.zeros((self.columns, len(tree.start)), bool)
        if int(used.sum()) > budget:
            threshold = np.partition(worth[used], -budget)[-budget]
            opened[:, inner] = worth > threshold
        else:
            opened[:, inner] = used
        # A term is a node that is not opened, under a parent that is
        parent = self._parent
        under = np.zeros_like(opened)
        under[:, 1:] = opened[:, parent[1:]]
        under[:, 0] = True
        column, node = np.nonzero(under & ~opened)
        # Cells in the order of their nodes, column by column
        order = np.lexsort((tree.start[node], column))
        column, node = column[order], node[order]
        length = tree.stop[node] - tree.start[node]
        owner = np.repeat(np.arange(len(node)), length)
        term = owner[at]
        kept = np.unique(term)
        place = np.zeros(len(node), np.int64)
        place[kept] = np.arange(len(kept))
        return node[kept].astype(np.int32), column[kept].astype(np.int32), place[term]


_FIELDS = ("row", "cell", "column", "value", "half")


def _table(rows: int, terms: int, samples: Samples, term: AnyArray) -> Float64:
    """Samples added up by row and term: float64 [rows, terms]."""
    at = samples.row.astype(np.int64) * terms + term
    sums = np.bincount(at, samples.value, rows * terms)
    return np.asarray(sums.reshape(rows, terms), np.float64)


def _directions(a: Float64, b: Float64) -> Float64:
    """Orthonormal row directions of two noisy halves [R, m]: [R, r]."""
    if not a.size:
        return np.zeros((len(a), 0))
    cross = a @ b.T
    values, vectors = np.linalg.eigh((cross + cross.T) / 2)
    # Of the mean of both halves, the noise in a direction is that of half their difference; a
    # direction is worth keeping where it holds more than that
    noise = ((vectors.T @ (a - b) / 2) ** 2).sum(axis=1)
    worth = (values > noise) & (values > LEAST_ENERGY * values[-1])
    kept = np.flatnonzero(worth)[-MOST_DIRECTIONS:]
    if not len(kept):
        kept = np.array([len(values) - 1])
    return np.asarray(vectors[:, kept[::-1]])


def transfer_of(rows: int, columns: int, blocks: list[Block]) -> Transfer:
    """The matrix of some blocks, those of like size padded to one shape."""
    alike: dict[tuple[int, int, int], list[Block]] = {}
    for block in blocks:
        if not len(block.node):
            continue
        r = next(size for size in PADDED if size >= block.U.shape[1])
        height = _rounded(len(block.rows), 32)
        alike.setdefault((r, height, _rounded(len(block.node), 128)), []).append(block)
    return Transfer(rows, columns, tuple(_padded(rows, size, own) for size, own in alike.items()))


def _rounded(count: int, step: int) -> int:
    return -(-count // step) * step


def _padded(rows: int, size: tuple[int, int, int], blocks: list[Block]) -> Blocks:
    r, height, terms = size
    k = len(blocks)
    at = np.full((k, height), rows, np.int32)
    U = np.zeros((k, height, r), np.float32)
    S = np.zeros((k, r, terms), np.float32)
    node = np.zeros((k, terms), np.int32)
    column = np.zeros((k, terms), np.int32)
    for i, block in enumerate(blocks):
        n, own = block.U.shape
        m = len(block.node)
        at[i, :n] = block.rows
        U[i, :n, :own] = block.U
        S[i, :own, :m] = block.S
        node[i, :m], column[i, :m] = block.node, block.column
        column[i, m:] = block.column[-1]
    return Blocks(at, U, S, node, column)


def neighbourhoods(place: Float64, most: int = ROWS) -> list[AnyArray]:
    """Rows at places [r, d] in groups of at most `most` neighbours: indices."""
    waiting, result = [np.arange(len(place))], []
    while waiting:
        own = waiting.pop()
        if len(own) <= most:
            if len(own):
                result.append(own)
            continue
        axis = int(np.argmax(np.ptp(place[own], axis=0)))
        order = own[np.argsort(place[own, axis], kind="stable")]
        # Whole blocks on one side
        half = -(-len(own) // (2 * most)) * most
        half = half if half < len(own) else len(own) // 2
        waiting += [order[half:], order[:half]]
    return result
