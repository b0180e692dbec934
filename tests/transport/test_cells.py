"""Cells: nothing that is not black gets lost, and compressing them is compressing T."""

from __future__ import annotations

import numpy as np
import pytest

from burnish.core.types import Float32
from burnish.transport.cells import Cells
from burnish.transport.compression import compress


def sparse(rows: int = 20, seed: int = 0) -> Float32:
    """Light in a tenth of the cells and half of the rows of those."""
    rng = np.random.default_rng(seed)
    T = rng.random((rows, 9, 11, 3)) * (rng.random((9, 11, 1)) < 0.1)
    return (T * (rng.random((rows, 1, 1, 1)) < 0.5)).astype(np.float32)


@pytest.mark.parametrize("members", [[0], [3, 4, 5, 9, 10, 19], list(range(20)), []])
def test_dense_again(members: list[int]) -> None:
    T = sparse()
    rows = np.array(members, np.int64)
    cells = Cells.of(T, rows)
    np.testing.assert_array_equal(cells.dense(), T[rows])
    np.testing.assert_array_equal(cells.lit_rows(), T[rows].any(axis=(1, 2, 3)))
    assert cells.values.shape[1] == T[rows].any(axis=(0, 3)).sum()


def test_pieces_and_scales() -> None:
    T = sparse(seed=1)
    rows = np.arange(len(T))
    scale = np.linspace(1, 2, 9, dtype=np.float32)
    piece = Cells.of(T, rows).scaled(scale).piece(2, 7)
    np.testing.assert_array_equal(piece.dense(), (T * scale[:, None, None])[:, 2:7])
    chosen = np.array([1, 5, 6])
    np.testing.assert_array_equal(piece.select(chosen).dense(), piece.dense()[chosen])


def test_black_columns_and_tails_change_nothing() -> None:
    rng = np.random.default_rng(2)
    outer = [rng.random((64, 1, 1, 1)) * rng.random((5, 4, 3)) for _ in range(2)]
    small = np.sum(outer, axis=0).astype(np.float32)
    columns, tails = [0, 2, 3, 6, 8], [1, 4, 5, 9]
    T = np.zeros((64, 9, 11, 3), np.float32)
    T[:, np.array(columns)[:, None], tails] = small
    scale = np.linspace(0.5, 1, 9, dtype=np.float32)
    rows = np.arange(64, dtype=np.int32)
    wide = compress(T, 0, False, rows, scale, 1e-3).dense()
    narrow = compress(small, 0, False, rows, scale[columns], 1e-3).dense()
    np.testing.assert_allclose(wide[:, columns][:, :, tails], narrow, atol=5e-3)
    np.testing.assert_allclose(wide, T, atol=5e-3)
