"""Frames from folded blocks, row directions and dense rows are the same, forwards and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.core.types import Float32, Int32
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import initial_state
from burnish.transport.expansion import Expansion, blank, flattened
from burnish.transport.frozen import FoldedPart, Frozen, FrozenPart
from burnish.transport.pack import TiledBlocks
from tests.runtime.worlds import basis_of, edited, random_world, shaded

WIDTH, HEIGHT = 20, 16


def directions(seed: int = 0) -> list[tuple[Float32, Int32]]:
    """U of blocks of many shapes and the pixels of their rows, two in the same square."""
    rng = np.random.default_rng(seed)
    blocks = []
    for number, (r, a) in enumerate([(64, 3), (64, 4), (1, 1), (7, 5), (64, 70), (3, 0), (9, 3)]):
        y, x = divmod(number % 6, 3)
        columns = min(8, WIDTH - 8 * x)
        places = rng.permutation(8 * columns)[:r]
        pixel = (8 * y + places // columns) * WIDTH + 8 * x + places % columns
        U = rng.standard_normal((len(pixel), a)).astype(np.float32)
        blocks.append((U, pixel.astype(np.int32)))
    return blocks


def test_expansion_is_the_blocks_one_by_one() -> None:
    blocks = directions()
    expansion = Expansion.of(blocks, WIDTH)
    rng = np.random.default_rng(1)
    latent = rng.standard_normal((3, expansion.latent)).astype(np.float32)
    light = rng.standard_normal((3, expansion.rows)).astype(np.float32)
    cut = np.cumsum([U.shape[1] for U, _ in blocks])[:-1]
    expected = [
        part @ U.T for part, (U, _) in zip(np.split(latent, cut, axis=1), blocks, strict=True)
    ]
    np.testing.assert_allclose(
        expansion.expand(latent), np.concatenate(expected, axis=1), rtol=1e-5, atol=1e-5
    )
    # The same in a picture, with a factor of each row
    factor = rng.random((expansion.rows, 3)).astype(np.float32)
    squares = blank(WIDTH, HEIGHT, 3)
    expansion.add(latent, squares, factor)
    picture = np.zeros((HEIGHT * WIDTH, 3))
    pixel = np.concatenate([own for _, own in blocks])
    np.add.at(picture, pixel, np.concatenate(expected, axis=1).T * factor)
    image = flattened(squares)[:HEIGHT, :WIDTH]
    np.testing.assert_allclose(image.reshape(-1, 3), picture, rtol=1e-5, atol=1e-5)
    # Its transpose, by the inner product
    forward = float((expansion.expand(latent) * light).sum())
    assert forward == pytest.approx(float((latent * expansion.back(light)).sum()), rel=1e-4)


def low_rank(source: TiledBlocks) -> TiledBlocks:
    """The same world with its first two directions only, and some of them doubled."""
    packs = []
    for pack in source.packs():
        blocks = [
            replace(
                block,
                U=np.ascontiguousarray(block.U[:, :2]) + np.float32(0.1),
                core=block.core[:2],
            )
            for block in pack.blocks()
        ]
        packs.append(type(pack).of(blocks))
    return replace(source, content=packs)


def expanded(frozen: Frozen) -> Frozen:
    """The same frozen form with dense rows."""
    parts: list[FrozenPart | FoldedPart] = []
    for part in (item.dense() for item in frozen.parts):
        if part.expansion is not None:
            F = np.stack([part.expansion.expand(np.stack([x] * 3))[0] for x in columns_of(part.F)])
            F = F.reshape(3, part.F.shape[2], -1).transpose(0, 2, 1)
            part = replace(part, F=np.ascontiguousarray(F), expansion=None)
        parts.append(part)
    return replace(frozen, parts=parts)


def columns_of(F: Float32) -> Float32:
    """Every column of every channel: float32 [3 · columns, directions]."""
    return F.transpose(0, 2, 1).reshape(-1, F.shape[1])


@pytest.mark.parametrize("series", [(6, 1, 1), (6, 3, 1)])
def test_frames_and_gradients_are_those_of_dense_rows(series: tuple[int, ...]) -> None:
    basis = basis_of(series, shaded("lid"))
    source = low_rank(random_world(basis)[0])
    start = initial_state(basis.objects)
    frozen = freeze(source, (0, 2), start)
    assert any(isinstance(part, FoldedPart) for part in frozen.parts)
    directed = replace(frozen, parts=[part.dense() for part in frozen.parts])
    state = edited(start, "box", exponent=7.0)
    ours, dense = Renderer(frozen), Renderer(expanded(frozen))
    np.testing.assert_allclose(ours.image(state), dense.image(state), rtol=1e-4, atol=1e-5)
    image = Renderer(directed).image(state)
    np.testing.assert_allclose(image, dense.image(state), rtol=1e-4, atol=1e-5)
    upstream = np.random.default_rng(2).random(ours.image(state).shape).astype(np.float32)
    a, b = ours.gradient(state, upstream), dense.gradient(state, upstream)
    np.testing.assert_allclose(a.powers, b.powers, rtol=1e-3, atol=1e-3)
    for key, columns in b.columns.items():
        np.testing.assert_allclose(a.columns[key], columns, rtol=1e-3, atol=1e-3)
    for part_key, factor in b.outgoing.items():
        np.testing.assert_allclose(a.outgoing[part_key], factor, rtol=1e-3, atol=1e-3)
