"""Frames of painted objects: coefficients of their own in every row.

B = base + Σ_parts s(θo; row) · H(row) · Σ_n power_n Σ_c coefficient_c(row) F[row, c, n]: 2008's
eq. 28 with c a function of the row. What the rows of a part make of each power is kept, and
computed anew only for rows whose own material has changed; the powers, which the mean of all
rows decides, are those of the same frame. So a stroke costs its own rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import AnyArray, Bool, Float32, Int64
from burnish.materials.painting.varied import VariedLayer, VariedMaterial
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import State
from burnish.transport.frozen import FoldedPart, Frozen, FrozenPart

_ROWS = 64
"""Rows contracted at a time: their coefficients and F stay in cache."""
_BLOCKS = 4


@dataclass(frozen=True)
class PaintedRows:
    """An object's fine rows and what they are made of in the present frame.

    pixel: int32 [r], rising. material: its numbers, row by row.
    """

    pixel: AnyArray
    material: VariedMaterial


class PaintedRenderer:
    """Turns a `Frozen` of which some targets are painted into images.

    >>> renderer = PaintedRenderer(frozen, {0})                    # doctest: +SKIP
    >>> picture = renderer.image(state, {0: rows})                 # doctest: +SKIP
    """

    def __init__(self, frozen: Frozen, painted: frozenset[int]) -> None:
        self.frozen, self.painted = frozen, painted
        own = [part for part in frozen.parts if _is_painted(part, painted)]
        others = [part for part in frozen.parts if not _is_painted(part, painted)]
        self._others = Renderer(replace(frozen, parts=others))
        self._parts = [_Part(part.dense(), len(frozen.powers.exponents)) for part in own]

    def image(self, state: State, rows: Mapping[int, PaintedRows]) -> Float32:
        """The picture: float32 [h, w, 3], linear RGB. rows: those of each painted object.

        A painted object counts by its mean from the second encounter on, and where it is
        first met after rough surfaces.
        """
        objects = self.frozen.basis.objects
        mixed = {**state, **{objects[i].id: item.material.mean for i, item in rows.items()}}
        image = np.array(self._others.image(mixed))
        flat = image.reshape(-1, 3)
        powers = self.frozen.powers.evaluate(self.frozen.basis, mixed).astype(np.float32)
        for part in self._parts:
            flat[part.pixel] += part.light(rows[part.object], powers)
        return image


def _is_painted(part: FrozenPart | FoldedPart, painted: frozenset[int]) -> bool:
    return part.object in painted and part.slice is not None and not part.indirect


class _Part:
    """A frozen part whose rows have coefficients of their own."""

    def __init__(self, part: FrozenPart, powers: int) -> None:
        assert part.slice is not None
        self.part, self.slice = part, part.slice
        self.object, self.pixel = part.object, part.pixel
        self._light = np.zeros((len(part.pixel), powers, 3), np.float32)
        self._outgoing: Float32 | None = None
        self._place: AnyArray | None = None
        self._known: VariedLayer | None = None

    def light(self, rows: PaintedRows, powers: Float32) -> Float32:
        """What the part adds to its pixels: float32 [r, 3]."""
        layer = rows.material.layers[self.slice.layer]
        if self._place is None:
            self._place = np.searchsorted(rows.pixel, self.pixel)
        changed = self._changed(layer)
        if changed.any():
            self._contract(layer, rows, np.flatnonzero(changed))
        self._known = layer
        light = np.einsum("rnh,nh->rh", self._light, powers)
        light *= layer.factor[self._place]
        if self._outgoing is not None:
            light *= self._outgoing
        return np.asarray(light)

    def _changed(self, layer: VariedLayer) -> Bool:
        """Which of the part's rows have other coefficients than in the last frame."""
        before, place = self._known, self._place
        if before is layer:
            return np.zeros(len(self.pixel), np.bool_)
        if before is None or before.version != layer.version:
            return np.ones(len(self.pixel), np.bool_)
        if before.index.shape != layer.index.shape:
            return np.ones(len(self.pixel), np.bool_)
        # Entries of the two tables are told apart by their values, not by their places
        where = {node: n for n, node in enumerate(layer.nodes)}
        same = np.array([where.get(node, -1) for node in before.nodes])
        index = same[before.index] != layer.index
        other = (index | (before.share != layer.share)).reshape(len(layer.index), -1)
        return np.asarray(other.any(axis=1)[place])

    def _contract(self, layer: VariedLayer, rows: PaintedRows, changed: Int64) -> None:
        """Σ_c coefficient_c(row) F[row, c, n] of some rows, and their outgoing factors."""
        assert self._place is not None
        part, start = self.part, self._first_column(rows)
        columns = slice(self.slice.start - start, self.slice.stop - start)
        work = list(self._pieces(changed))

        def contract(piece: tuple[Int64, tuple[AnyArray, ...]]) -> None:
            own, source = piece
            place = self._place
            assert place is not None
            c = layer.coefficients(place[own], columns)
            for h in range(3):
                F = _rows_of(part, source, h).reshape(len(own), c.shape[1], -1)
                self._light[own, :, h] = np.matmul(c[:, None, :, h], F)[:, 0]

        parallel_map(contract, work)
        cosines = part.cos_theta_o[changed].astype(np.float64)
        factor = layer.outgoing(self._place[changed], cosines, self.slice.delta)
        if factor is None:
            if self._outgoing is not None:
                self._outgoing[changed] = 1.0
            return
        if self._outgoing is None:
            self._outgoing = np.ones((len(self.pixel), 3), np.float32)
        self._outgoing[changed] = factor

    def _first_column(self, rows: PaintedRows) -> int:
        """The first column of the slice's layer among the object's."""
        return sum(item.layer.columns for item in rows.material.layers[: self.slice.layer])

    def _pieces(self, changed: Int64) -> Iterator[tuple[Int64, tuple[AnyArray, ...]]]:
        """Rows to contract together, and where their F comes from.

        Either the rows themselves, or U [k, r, a], the directions [k, a] and which of the
        k · r combinations the rows are.
        """
        expansion = self.part.expansion
        if expansion is None:
            for first in range(0, len(changed), _ROWS):
                own = changed[first : first + _ROWS]
                yield own, (own,)
            return
        wanted = np.zeros(len(self.pixel) + 1, np.bool_)
        wanted[changed] = True
        for group in expansion.groups:
            hit = wanted[group.rows]
            used = np.flatnonzero(hit.any(axis=1))
            for first in range(0, len(used), _BLOCKS):
                blocks = used[first : first + _BLOCKS]
                which = np.flatnonzero(hit[blocks])
                own = group.rows[blocks].ravel()[which].astype(np.int64)
                yield own, (group.U[blocks], group.latent[blocks], which)


def _rows_of(part: FrozenPart, source: tuple[AnyArray, ...], h: int) -> Float32:
    """F of one channel at the rows of a piece: float32 [r, columns · powers]."""
    if len(source) == 1:
        return np.asarray(part.F[h, source[0]])
    U, latent, which = source
    # Padded directions meet zeros of U
    directions = part.F[h][np.minimum(latent, part.F.shape[1] - 1)]
    return np.asarray(np.matmul(U, directions).reshape(-1, part.F.shape[2])[which])
