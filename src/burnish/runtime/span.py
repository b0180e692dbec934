"""Frames of a drag: weights in the span of those already met cost no reading of F.

Light is linear in the weights, coefficient times power (2008, eq. 28), and what a drag goes
through (the values of a slider, a colour, a point of a curve) spans few directions: an exponent
that runs from 20 to 800 spans 9 of 296, to 1e-4. The products of F with these directions are
kept, and a frame mixes them. Weights outside the span cost one more product, which is kept too.

Where a live estimate is written over the F that a drag reads, the products are brought up to
date by and by, some rows with each frame, so that no frame is late. Rows of an older estimate,
and a row whose products are of two estimates, are as unbiased as any.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from burnish.core.parallel import core_count, parallel_map
from burnish.core.types import Float32, Float64, Int32
from burnish.transport.frozen import FrozenPart

CLOSE = 1e-4
"""What is left out of weights, relative to them, each column counted by its root mean square in
F. Pictures are then off by some 1e-6; float16, in which they are shown, leaves out 2e-4."""
DRAG_SECONDS = 0.5
"""Frames that follow one another faster belong to a drag; others are read from F."""
_MOST = 48
"""Most directions that are kept."""
_LEAST = 4
"""Where there is room for fewer, none are kept."""
_BLOCKS = 16
"""Parts of the picture that are brought up to date one after the other, one with each frame."""
_GROWTH = 4.0
"""Columns that have grown so much since they were weighed are weighed anew."""
_FLOOR = 1e-12
"""The least root mean square of a column, relative to the largest."""
SMALL = 1 << 16
"""Entries of F below which threads cost more than they save."""

Places = NDArray[np.intp]
"""For each row, where its light goes; NumPy would widen narrower ones at every use."""


class Span:
    """The light of some parts of a frozen form, which add up pixel by pixel.

    pixel: int32 [n], where the light belongs, the rows of a part that stands by itself; None for
    all pixels in their order.
    """

    def __init__(
        self,
        parts: Sequence[FrozenPart],
        pixels: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """parts: of targets, without expansions, pixels rising where they are several.

        pixels: of the view.
        """
        self.parts = tuple(parts)
        self.pixel, self._groups = _gather(self.parts)
        self._count = pixels if self.pixel is None else len(self.pixel)
        self._clock = clock
        self._columns = sum(part.F.shape[2] for part in self.parts)
        # A product takes 12 bytes a pixel; together they may take three quarters of F
        size = sum(part.F.nbytes for part in self.parts)
        self._room = min(_MOST, size // (16 * max(self._count, 1)))
        self._seen: deque[Float64] = deque(maxlen=_MOST)
        self._last: tuple[Float32, Float32] | None = None
        self._asked = -np.inf
        # Of the columns in F; None until there are directions
        self._scale: Float64 | None
        # Orthonormal in scaled weights: float64 [3, directions, columns]
        self._directions: Float64
        # Of F with the directions: float32 [3, room, n]
        self._products: Float32
        # Blocks whose products are of an older F, and the columns' squares in the other blocks
        self._stale: list[int]
        self._squares: Float64
        self._forget()

    def continues(self, parts: Sequence[FrozenPart]) -> bool:
        """Whether parts are these with newer numbers in the same memory."""
        return len(parts) == len(self.parts) and all(
            new.F.shape == old.F.shape
            and new.F.ctypes.data == old.F.ctypes.data
            and (new.pixel is old.pixel or np.array_equal(new.pixel, old.pixel))
            for new, old in zip(parts, self.parts, strict=True)
        )

    def renew(self, parts: Sequence[FrozenPart]) -> None:
        """There are newer numbers in F; parts: those that it continues with."""
        self.parts = tuple(parts)
        self._last = None
        self._stale = list(range(_BLOCKS)) if self._directions.shape[1] else []
        self._squares[:] = 0.0

    def light(self, weights: Float64) -> Float32:
        """F times weights [3, columns], those of the parts one after the other: float32 [3, n].

        Equal to `plain` but for `CLOSE`, and for rows that are still those of an older estimate.
        """
        narrow = weights.astype(np.float32)
        if self._last is not None and np.array_equal(self._last[0], narrow):
            return self._last[1]
        moved = not self._seen or not np.array_equal(self._seen[-1], weights)
        now = self._clock()
        dragged = moved and now - self._asked < DRAG_SECONDS and self._room >= _LEAST
        if moved:
            self._seen.append(weights)
            self._asked = now
        if not dragged and self._stale:
            # The next drag would begin with rows of long ago
            self._forget()
        light = self._mixed(weights) if dragged else self.plain(weights)
        self._last = narrow, light
        return light

    def plain(self, weights: Float64) -> Float32:
        """The same, read from F: float32 [3, n]."""
        light = np.empty((3, 1, self._count), np.float32)
        self._contract(weights.astype(np.float32)[:, None], light)
        return light[:, 0]

    # -- inside -----------------------------------------------------------------------------

    def _forget(self) -> None:
        """Begin without directions."""
        self._scale = None
        self._directions = np.zeros((3, 0, self._columns))
        self._products = np.zeros((3, 0, self._count), np.float32)
        self._stale, self._squares = [], np.zeros((3, self._columns))

    def _mixed(self, weights: Float64) -> Float32:
        """The light as a mixture of products."""
        self._refresh()
        if self._scale is None:
            self._scale = self._weighed(self._sums_of_squares(0, self._count))
        scaled = weights * self._scale
        size = np.linalg.norm(scaled, axis=1)
        shares, rest = self._split(scaled)
        left = np.linalg.norm(rest, axis=1)
        if (left > CLOSE * size).any():
            if self._directions.shape[1] >= self._room:
                self._condense()
                shares, rest = self._split(scaled)
                left = np.linalg.norm(rest, axis=1)
            # A channel whose rest is rounding has no direction to add
            left[left < 1e-3 * CLOSE * size] = 0.0
            direction = np.divide(1.0, left, out=np.zeros(3), where=left > 0.0)[:, None] * rest
            self._keep(direction[:, None])
            shares = np.concatenate([shares, left[:, None]], axis=1)
        return self._mix(shares.astype(np.float32))

    def _split(self, scaled: Float64) -> tuple[Float64, Float64]:
        """Shares of the directions [3, directions], and what is orthogonal to them."""
        shares = np.einsum("hkc,hc->hk", self._directions, scaled)
        rest = scaled - np.einsum("hkc,hk->hc", self._directions, shares)
        # Once more: what is left is small, and must be orthogonal to its own precision
        again = np.einsum("hkc,hc->hk", self._directions, rest)
        return shares + again, rest - np.einsum("hkc,hk->hc", self._directions, again)

    def _mix(self, shares: Float32) -> Float32:
        """Σ_k share · product of each channel: float32 [3, n]."""
        result = np.empty((3, self._count), np.float32)
        for h in range(3):
            np.matmul(shares[h], self._products[h, : shares.shape[1]], out=result[h])
        return result

    def _keep(self, directions: Float64) -> None:
        """Add directions [3, k, columns] with their products."""
        assert self._scale is not None
        known, more = self._directions.shape[1], directions.shape[1]
        if known + more > self._products.shape[1]:
            # Room for twice as many, so that a drag copies each but once
            room = min(max(2 * (known + more), 8), self._room)
            grown = np.empty((3, room, self._count), np.float32)
            grown[:, :known] = self._products[:, :known]
            self._products = grown
        weights = directions / self._scale[:, None]
        self._contract(weights.astype(np.float32), self._products[:, known : known + more])
        self._directions = np.concatenate([self._directions, directions], axis=1)

    def _condense(self) -> None:
        """Turn the directions to the principal ones of what was seen last, and keep those."""
        assert self._scale is not None
        recent = np.stack(list(self._seen)[-self._room // 2 : -1], axis=1) * self._scale[:, None]
        shares = np.einsum("hkc,hmc->hmk", self._directions, recent)
        turns = _principal(shares, self._room // 2)
        known, count = self._directions.shape[1], turns.shape[1]
        self._directions = turns @ self._directions
        narrow = turns.astype(np.float32)

        def turn(h: int) -> None:
            self._products[h, :count] = narrow[h] @ self._products[h, :known]

        parallel_map(turn, range(3))

    def _refresh(self) -> None:
        """Bring a block up to date; at the last, see whether the columns are as they were."""
        if self._scale is None or not self._stale:
            return
        weights = (self._directions / self._scale[:, None]).astype(np.float32)
        products = self._products[:, : weights.shape[1]]
        block = self._stale.pop()
        start, stop = (self._count * (block + i) // _BLOCKS for i in (0, 1))
        self._contract(weights, products, start, stop)
        self._squares += self._sums_of_squares(start, stop)
        if not self._stale and (self._weighed(self._squares) > _GROWTH * self._scale).any():
            self._forget()

    # -- reading F --------------------------------------------------------------------------

    def _weighed(self, squares: Float64) -> Float64:
        """Root mean squares of the columns of F from their squares' sums: float64 [3, columns]."""
        rows = np.concatenate([np.full(part.F.shape[2], part.F.shape[1]) for part in self.parts])
        means = squares / np.maximum(rows, 1)
        largest = means.max(axis=1, keepdims=True)
        # No column counts for nothing: its weights may be large
        return np.sqrt(np.where(largest > 0.0, np.maximum(means, _FLOOR**2 * largest), 1.0))

    def _sums_of_squares(self, start: int, stop: int) -> Float64:
        """Of each column over the rows of some places: float64 [3, columns]."""
        result = np.zeros((3, self._columns))

        def work(h: int, low: int, high: int) -> None:
            found = [
                np.einsum("rc,rc->c", F[h, rows], F[h, rows])
                for rows, _, own in self._rows(low, high)
                for F, _ in own
            ]
            spans = [span for _, _, own in self._rows(low, high) for _, span in own]
            for span, sums in zip(spans, found, strict=True):
                result[h, span] += sums

        parallel_map(work, range(3), [start] * 3, [stop] * 3)
        return result

    def _contract(
        self, weights: Float32, out: Float32, start: int = 0, stop: int | None = None
    ) -> None:
        """F times several weights [3, k, columns] in one reading, into [3, k, n] from start to
        stop."""

        def work(h: int, low: int, high: int) -> None:
            if self.pixel is None:
                out[h, :, low:high] = 0.0
            for rows, place, own in self._rows(low, high):
                products = [F[h, rows] @ weights[h, :, span].T for F, span in own]
                light = sum(products[1:], products[0])
                if place is None:
                    out[h, :, rows] = light.T
                    continue
                at = place[rows]
                for k in range(weights.shape[1]):
                    out[h, k, at] += light[:, k]

        end = self._count if stop is None else stop
        small = sum(part.F.size for part in self.parts) < SMALL
        step = max(end - start if small else -(-(end - start) // (4 * core_count())), 1)
        pieces = [
            (h, low, min(low + step, end)) for h in range(3) for low in range(start, end, step)
        ]
        if small:
            for piece in pieces:
                work(*piece)
        elif pieces:
            parallel_map(work, *zip(*pieces, strict=True))

    def _rows(
        self, low: int, high: int
    ) -> list[tuple[slice, Places | None, list[tuple[Float32, slice]]]]:
        """The rows whose light goes to places from low to high, where to, and what is theirs."""
        result = []
        for place, own in self._groups:
            rows = slice(low, high)
            if place is not None:
                rows = slice(*np.searchsorted(place, (low, high)).tolist())
            result.append((rows, place, own))
        return result


_Group = tuple[Places | None, list[tuple[Float32, slice]]]
"""Rows' places, None where they are the rows, and F and columns of the parts with these rows."""


def _gather(parts: Sequence[FrozenPart]) -> tuple[Int32 | None, list[_Group]]:
    """Where parts put their light together, the pixels of one or None for every pixel, and the
    sets of rows that go there."""
    stops = np.cumsum([part.F.shape[2] for part in parts]).tolist()
    spans = [slice(stop - p.F.shape[2], stop) for p, stop in zip(parts, stops, strict=True)]
    if len(parts) == 1:
        return parts[0].pixel, [(None, [(parts[0].F, spans[0])])]
    groups: list[tuple[Int32, list[tuple[Float32, slice]]]] = []
    for part, span in zip(parts, spans, strict=True):
        for known, own in groups:
            if known is part.pixel or np.array_equal(known, part.pixel):
                own.append((part.F, span))
                break
        else:
            groups.append((part.pixel, [(part.F, span)]))
    return None, [(pixel.astype(np.intp), own) for pixel, own in groups]


def _principal(vectors: Float64, most: int) -> Float64:
    """Orthonormal directions that span vectors [3, m, c] but for `CLOSE`: float64 [3, k, c]."""
    if vectors.shape[1] == 0:
        return vectors
    _, values, turned = np.linalg.svd(vectors, full_matrices=False)
    largest = values.max(axis=1, keepdims=True, initial=0.0)
    # Of the mean vector's size, so that none is left out by more
    needed = values > CLOSE * largest / np.sqrt(vectors.shape[1])
    count = min(int(needed.sum(axis=1).max(initial=0)), most)
    return np.asarray(turned[:, :count])
