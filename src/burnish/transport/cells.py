"""The cells that light reaches: most of a square's transport is zeros.

A path adds to one tail of one column or of a few. In the Cornell box at series (64,1,1,1)
and 1,024 samples per pixel, 8 % of the numbers of an 8 × 8-pixel square are not zero, and
70 % of the (column, tail) pairs are zero in all of its rows. Only the others are copied.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from burnish.core.types import AnyArray, Float32


@dataclass(frozen=True)
class Cells:
    """T [r, c, z, 3] of some rows without the (column, tail) pairs that are black in all.

    values: float32 [r, n, 3]. cells: int64 [n], rising; column · z + tail of each.
    columns, tails: c and z.
    """

    values: Float32
    cells: AnyArray
    columns: int
    tails: int

    @staticmethod
    def of(T: Float32, rows: AnyArray) -> Cells:
        """Those of the given rows of T [R, c, z, 3 or more]; of rising row indices.

        Channels after the third are padding, all zero.
        """
        _, c, z, width = T.shape
        return Cells.among(T.reshape(len(T), c * z, width), rows, c, z)

    @staticmethod
    def among(
        flat: Float32, rows: AnyArray, columns: int, tails: int, keys: AnyArray | None = None
    ) -> Cells:
        """The same of numbers [R, places, 3 or more] that lie in any order.

        keys: int64 [places], column · tails + tail of each place, negative for one that is
        always black; None where they are in order.
        """
        width = flat.shape[-1]
        # Neighbouring rows lie side by side: one call for each such run
        starts = np.flatnonzero(np.diff(rows, prepend=-2) != 1)
        runs = [(int(run[0]), int(run[-1]) + 1) for run in np.split(rows, starts[1:]) if len(run)]
        seen = np.zeros(flat.shape[1:], np.uint32)
        for first, stop in runs:
            bits = flat[first:stop].view(np.uint32)
            np.bitwise_or(seen, np.bitwise_or.reduce(bits, axis=0), out=seen)
        places = cells = np.flatnonzero(seen[:, 0] | seen[:, 1] | seen[:, 2])
        if keys is not None:
            places = places[np.argsort(keys[places])]
            cells = keys[places]
        values = np.empty((len(rows), len(cells), width), np.float32)
        at = 0
        for first, stop in runs:
            # "clip" writes in place, where "raise" would go through a copy
            target = values[at : at + stop - first]
            np.take(flat[first:stop], places, axis=1, out=target, mode="clip")
            at += stop - first
        return Cells(np.ascontiguousarray(values[..., :3]), cells, columns, tails)

    def lit_rows(self) -> AnyArray:
        """Which rows have any light: bool [r]."""
        return np.asarray(self.values.any(axis=(1, 2)))

    def select(self, rows: AnyArray) -> Cells:
        """Some of the rows, by indices or mask; their cells stay."""
        return Cells(self.values[rows], self.cells, self.columns, self.tails)

    def piece(self, start: int, stop: int) -> Cells:
        """The columns start … stop."""
        low, high = np.searchsorted(self.cells, (start * self.tails, stop * self.tails))
        cells = self.cells[low:high] - start * self.tails
        return Cells(self.values[:, low:high], cells, stop - start, self.tails)

    def scaled(self, columns: Float32, tails: Float32 | None = None) -> Cells:
        """Every column c times columns[c], and every tail z times tails[z]."""
        factor = columns[self.cells // self.tails]
        if tails is not None:
            factor = factor * tails[self.cells % self.tails]
        values = self.values * factor[None, :, None]
        return Cells(values, self.cells, self.columns, self.tails)

    def dense(self) -> Float32:
        """T: float32 [r, c, z, 3]."""
        result = np.zeros((len(self.values), self.columns * self.tails, 3), np.float32)
        result[:, self.cells] = self.values
        return result.reshape(-1, self.columns, self.tails, 3)
