"""Stacks: whatever is kept, dark or stored in 16 bits, the light is that of the blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import Basis, initial_state
from burnish.transport.block import Tile
from burnish.transport.compression import compress_tile
from burnish.transport.contraction import back, collect, contract, fold, unfold
from burnish.transport.pack import TiledBlocks
from burnish.transport.stack import Stack
from tests.runtime.worlds import basis_of, edited, plain_image, random_world, shaded

WIDTH, HEIGHT = 20, 16


def compressed(basis: Basis, seed: int = 3) -> tuple[TiledBlocks, list[tuple[Tile, dict]]]:
    """A view whose blocks have half-precision cores, and what they stand for exactly."""
    _, tiles = random_world(basis, WIDTH, HEIGHT, seed)
    fresh = []
    for tile, dense in tiles:
        blocks = []
        for which, T in dense.values():
            blocks += compress_tile(T, tile.rows, which.astype(np.int32), WIDTH, basis, 0.2)
        for key, (which, T) in dense.items():
            exact = np.zeros_like(T)
            for block in blocks:
                if (block.object, block.indirect) == key:
                    rows = np.searchsorted(which, block.rows)
                    stop = block.start + len(block.column_scale)
                    exact[rows, block.start : stop] += block.dense()
            dense[key] = which, exact
        tile.blocks = blocks
        fresh.append((tile, dense))
    return TiledBlocks.of(basis, WIDTH, HEIGHT, [tile for tile, _ in fresh]), fresh


@pytest.mark.parametrize("series", [(6, 1, 1), (6, 3, 1)])
def test_16_bits_hold_half_precision_to_half_a_step(series: tuple[int, ...]) -> None:
    basis = basis_of(series, shaded("lid"))
    source, tiles = compressed(basis)
    assert all(stack.core.dtype == np.int16 for stack in source.stacks())
    start = initial_state(basis.objects)
    for targets in ((), (0,), (0, 2)):
        state = edited(start, *(basis.objects[t].id for t in targets), exponent=60.0)
        image = Renderer(freeze(source, targets, start)).image(state)
        expected = plain_image(basis, tiles, state, WIDTH, HEIGHT)
        # Half a step in 32,767 of each column's largest number, in sums of like signs
        np.testing.assert_allclose(image, expected, rtol=1e-4, atol=1e-4 * expected.max())


def test_what_is_kept_is_what_is_contracted_anew() -> None:
    source, _ = compressed(basis_of((6, 1)))
    stack = source.stacks()[1]
    rng = np.random.default_rng(0)
    first, second = rng.random((2, stack.columns, 3))
    # A colour alone, one channel alone, a dark channel, dark columns, and back
    narrow = np.where(np.arange(stack.columns)[:, None] > 2, 1e-12, 1.0) * first
    steps = [first, first * [2.0, 0.5, 1.0], np.where([True, False, False], second, first)]
    steps += [first * [1.0, 0.0, 1.0], narrow, first]
    for weights in steps:
        ((cells, peak),) = contract([stack], [weights])
        own = [cell * factor for cell, factor in zip(cells, peak, strict=True)]
        exact = np.einsum("hmcn,hc,ch->hmn", stack.core, stack.scale, weights).reshape(3, -1)
        np.testing.assert_allclose(np.stack(own), exact, rtol=1e-5, atol=1e-6 * exact.max())


def test_a_column_without_light_hides_no_other() -> None:
    """However large its coefficient: a sharp lobe's first bins see no lamp."""
    basis = basis_of((6, 1))
    source, _ = compressed(basis)
    pack = source.packs()[1]
    core = np.array(pack.core)
    core[:, 0] = 0
    stack = Stack.of([replace(pack, core=core)], source.rows, source.width)
    weights = np.ones((stack.columns, 3))
    weights[0] = 1e9
    ((cells, peak),) = contract([stack], [weights])
    own = [cell * factor for cell, factor in zip(cells, peak, strict=True)]
    exact = np.einsum("hmcn,hc->hmn", stack.core[:, :, 1:], stack.scale[:, 1:]).reshape(3, -1)
    np.testing.assert_allclose(np.stack(own), exact, rtol=1e-5, atol=1e-5 * np.abs(exact).max())


def test_products_backwards_are_the_transposes() -> None:
    source, _ = compressed(basis_of((6, 2, 1)))
    rng = np.random.default_rng(1)
    for stack in source.stacks():
        weights = rng.random((stack.columns, 3))
        tails = rng.standard_normal((3, len(stack.S))).astype(np.float32)
        latent = rng.standard_normal((3, stack.directions)).astype(np.float32)
        ((cells, peak),) = contract([stack], [weights])
        forward = fold(stack, cells, tails[:, None])[:, 0] * peak[:, None]
        product = float((forward.astype(np.float64) * latent).sum())
        size = float(np.abs(forward * latent).sum())
        through_columns = float((back(stack, unfold(stack, latent, tails)) * weights).sum())
        through_tails = float((collect(stack, cells, latent) * peak[:, None] * tails).sum())
        assert through_columns == pytest.approx(product, abs=1e-5 * size)
        assert through_tails == pytest.approx(product, abs=1e-5 * size)


def test_chunks_hold_every_cell_once() -> None:
    # Cells of one run may lie across chunks: make them small
    source, _ = compressed(basis_of((6, 1)))
    whole = source.stacks()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("burnish.transport.stack.CHUNK", 42)
        patch.setattr("burnish.transport.stack._NARROWEST", 1)
        small = [
            Stack.of(
                [
                    pack
                    for pack in source.packs()
                    if (pack.object, pack.indirect, pack.start)
                    == (stack.object, stack.indirect, stack.start)
                ],
                source.rows,
                source.width,
            )
            for stack in whole
        ]
    assert max(stack.core.shape[1] for stack in small) > 3
    for one, other in zip(whole, small, strict=True):
        count = one.runs[-1].cells.stop
        cells = [
            stack.core.transpose(0, 1, 3, 2).reshape(3, -1, stack.columns) for stack in (one, other)
        ]
        np.testing.assert_array_equal(cells[0][:, :count], cells[1][:, :count])
        assert not cells[1][:, count:].any()
