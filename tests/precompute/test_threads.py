"""Additions that are not atomic lose nothing: no two threads meet on one pixel."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from burnish.core.types import Float32
from burnish.precompute import accumulate
from burnish.precompute.accumulate import Accumulator, Rectangle, threads_are_apart
from burnish.precompute.plan import basis_for
from burnish.precompute.prepass import find_rows
from burnish.precompute.symbolic import SymbolicMaterials
from burnish.precompute.tracer import Tracer
from burnish.scene import Scene
from tests.precompute import worlds


@pytest.mark.parametrize("threads", [1, 2, 3, 4, 6, 8, 12, 16, 64])
@pytest.mark.parametrize("packet", [4, 8, 16])
def test_blocks_hold_whole_pixels(
    monkeypatch: pytest.MonkeyPatch, threads: int, packet: int
) -> None:
    """By a model of how Dr.Jit deals out a launch: for every launch that passes, each block
    begins where a pixel does."""
    monkeypatch.setattr(accumulate.dr, "thread_count", lambda: threads)
    passed = 0
    for per_pixel in (1, 4, 16, 64, 256):
        for pixels in (64, 66 * 66, 66 * 128, 128 * 128, 96 * 96, 450 * 2):
            lanes = per_pixel * pixels
            packets = -(-lanes // packet)
            if threads == 1:
                block = lanes
            elif packets <= threads:
                block = packet
            elif lanes <= 16384 * threads * 2:
                block = -(-packets // (2 * threads)) * packet
            else:
                block = 16384
            if threads_are_apart(lanes, per_pixel):
                passed += 1
                assert block % per_pixel == 0 or block >= lanes
    assert passed


@pytest.mark.parametrize("world", [worlds.glossy, worlds.metals])
def test_plain_additions_equal_atomic_ones(
    monkeypatch: pytest.MonkeyPatch, world: Callable[[int], Scene]
) -> None:
    """Of layers with one quotient, and of several, which are added to two at a time."""
    scene = world(32)
    basis = basis_for(scene, None, (16, 8, 1))
    tracer = Tracer(scene, scene.view(), SymbolicMaterials(scene, basis))
    rows = find_rows(tracer, 0).rows

    def tensors() -> list[Float32]:
        accumulator = Accumulator(tracer, Rectangle(0, 0, 32, 32), rows)
        accumulator.run(256, 3)
        return accumulator.transport()

    assert threads_are_apart(32 * 32 * 256, 256)
    fast = tensors()
    monkeypatch.setattr(accumulate, "threads_are_apart", lambda *_: False)
    slow = tensors()
    for a, b in zip(fast, slow, strict=True):
        # Sums of at most 256 · 4 additions in another order
        largest = np.abs(b).max()
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=2**-22 * largest)
