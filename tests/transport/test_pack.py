"""Packs hold the same blocks, and tiles join into a view in the documented order."""

from __future__ import annotations

import numpy as np

from burnish.transport.compression import compress
from burnish.transport.pack import Pack, packs_of
from tests.runtime.worlds import basis_of, random_world


def test_a_pack_gives_its_blocks_back() -> None:
    rng = np.random.default_rng(0)
    scale = rng.random(5).astype(np.float32) + 0.5
    blocks = [
        compress(
            rng.random((r, 5, 4, 3)).astype(np.float32),
            1,
            False,
            np.arange(10 * r, 11 * r, dtype=np.int32),
            scale,
            tolerance,
        )
        for r, tolerance in ((1, 0.1), (7, 0.3), (3, 0.01))
    ]
    for block, again in zip(blocks, Pack.of(blocks).blocks(), strict=True):
        np.testing.assert_array_equal(block.rows, again.rows)
        np.testing.assert_array_equal(block.dense(), again.dense())
    packs = packs_of(blocks)
    assert len(packs) == 1
    assert packs[0].nbytes > sum(block.nbytes for block in blocks)


def test_joined_rows_are_sorted_and_packs_follow_them() -> None:
    basis = basis_of((6, 1))
    view, tiles = random_world(basis)
    rows = view.rows
    key = np.stack([rows.object, rows.indirect, rows.pixel])
    assert (np.lexsort(key[::-1]) == np.arange(len(rows))).all()
    for pack in view.packs():
        assert (rows.object[pack.rows] == pack.object).all()
        assert (rows.indirect[pack.rows] == pack.indirect).all()
    assert len(rows) == sum(len(tile.rows) for tile, _ in tiles)
