"""A canvas: points of an object's surface, and what strokes have made of its parameters there.

A painted parameter is u = scale · u0 + shift at each point, with u0 what the material itself
has: 1 and 0 where nothing was painted, so that erasing is exact and a slider still moves what
is not covered. u is slider travel for scalars, linear RGB for colours, and H, relative to the
layer's own weight, for weights.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from burnish.core.types import Float32, Float64, Int64
from burnish.materials.images.image import Place
from burnish.materials.painting.stroke import WEIGHT, Dab, Edit, Stroke

MAXIMUM_WEIGHT = 100.0
_RUN = 8
"""Dabs that are sought together: their box holds few points beside theirs."""
_FACING = -0.5
"""Surfaces turned further away than this cosine are the other side of a sheet."""


@dataclass
class PaintedMap:
    """A parameter over the points: float32 [n + 1] and [n + 1, 1 or 3].

    The last entry is a point that no dab reaches: what whole-object strokes alone have made.
    """

    scale: Float32
    shift: Float32


@dataclass(frozen=True)
class _Undone:
    """What a stroke replaced: for each place the entries and their old values, None for no map."""

    stroke: Stroke
    entries: Int64
    old: dict[Place, tuple[Float32, Float32] | None]


class Canvas:
    """The maps of one object over some of its points, kept up with a list of strokes.

    positions, normals: float32 [n, 3]. Undo keeps what each stroke replaced, of the points
    that it touched alone, and puts back the very bits.
    """

    def __init__(self, positions: Float32, normals: Float32) -> None:
        self.positions = np.ascontiguousarray(positions, np.float32)
        self.normals = np.ascontiguousarray(normals, np.float32)
        self.maps: dict[Place, PaintedMap] = {}
        self._done: list[_Undone] = []
        self._weight: Float32 | None = None
        """The last stroke's weights, so that it can be drawn further."""

    @property
    def strokes(self) -> tuple[Stroke, ...]:
        """The strokes that the maps show."""
        return tuple(item.stroke for item in self._done)

    @property
    def nbytes(self) -> int:
        """What the history of the maps holds."""
        return sum(
            item.entries.nbytes
            + sum(a.nbytes + b.nbytes for a, b in filter(None, item.old.values()))
            for item in self._done
        )

    def show(self, strokes: Sequence[Stroke]) -> None:
        """Make the maps those of these strokes, from where the maps are."""
        common = 0
        for mine, wanted in zip(self._done, strokes, strict=False):
            if mine.stroke is not wanted and mine.stroke != wanted:
                break
            common += 1
        grown = (
            common == len(self._done) - 1
            and common < len(strokes)
            and strokes[common].continues(self._done[common].stroke)
        )
        weight = self._weight if grown else None
        known = len(self._done[-1].stroke.dabs) if weight is not None else 0
        while len(self._done) > common:
            self._take_back()
        for stroke in strokes[common:]:
            self._draw(stroke, weight, known)
            weight, known = None, 0

    def _take_back(self) -> None:
        last = self._done.pop()
        self._weight = None
        for place, old in last.old.items():
            if old is None:
                del self.maps[place]
                continue
            self.maps[place].scale[last.entries], self.maps[place].shift[last.entries] = old

    def _draw(self, stroke: Stroke, weight: Float32 | None, known: int) -> None:
        """Draw a stroke, of whose first `known` dabs the weights are there already."""
        count = len(self.positions)
        if weight is None:
            weight = np.zeros(count + 1, np.float32)
        if stroke.everywhere:
            weight[:] = stroke.strength
        self._touch(stroke, stroke.dabs[known:], weight)
        self._weight = weight
        entries = np.flatnonzero(weight)
        before = {
            place: (item.scale[entries].copy(), item.shift[entries].copy())
            for place, item in self.maps.items()
        }
        fresh = dict(before)
        sources: Int64 | None = None
        for edit in stroke.edits:
            if edit.kind == "clone" and sources is None:
                sources = self._sources(stroke, entries)
            self._apply(edit, fresh, weight[entries], entries, sources)
        old: dict[Place, tuple[Float32, Float32] | None] = {}
        for place, (scale, shift) in fresh.items():
            known_before = before.get(place)
            if known_before is None:
                self.maps[place] = PaintedMap(
                    np.ones(count + 1, np.float32),
                    np.zeros((count + 1, shift.shape[1]), np.float32),
                )
            elif known_before[0] is scale and known_before[1] is shift:
                continue
            old[place] = known_before
            self.maps[place].scale[entries], self.maps[place].shift[entries] = scale, shift
        self._done.append(_Undone(stroke, entries, old))

    # -- where ------------------------------------------------------------------------------

    def _touch(self, stroke: Stroke, dabs: Sequence[Dab], weight: Float32) -> None:
        """Raise the weights to what the dabs give: the largest counts, so overlaps do not add."""
        for near, distance, pressure in self._near(dabs):
            falloff = gaussian(distance, stroke.falloff) * pressure * stroke.strength
            weight[near] = np.maximum(weight[near], falloff.max(axis=1).astype(np.float32))

    def _near(self, dabs: Sequence[Dab]) -> Iterator[tuple[Int64, Float64, Float64]]:
        """Points near a run of dabs, their distances in radii [m, k], and the pressures [k]."""
        for start in range(0, len(dabs), _RUN):
            run = dabs[start : start + _RUN]
            centre = np.array([dab.position for dab in run], np.float64)
            radius = np.array([dab.radius for dab in run], np.float64)
            near = self._in_box(
                (centre - radius[:, None]).min(axis=0), (centre + radius[:, None]).max(axis=0)
            )
            if not len(near):
                continue
            offset = self.positions[near].astype(np.float64)[:, None] - centre
            distance = np.sqrt((offset**2).sum(axis=2)) / radius
            facing = self.normals[near].astype(np.float64) @ np.array([dab.normal for dab in run]).T
            distance[facing < _FACING] = np.inf
            yield near, distance, np.array([dab.pressure for dab in run], np.float64)

    def _in_box(self, low: Float64, high: Float64) -> Int64:
        """The points of a box."""
        x = self.positions[:, 0]
        near = np.flatnonzero((x >= low[0]) & (x <= high[0]))
        for axis in (1, 2):
            x = self.positions[near, axis]
            near = near[(x >= low[axis]) & (x <= high[axis])]
        return near

    # -- what -------------------------------------------------------------------------------

    def _apply(
        self,
        edit: Edit,
        maps: dict[Place, tuple[Float32, Float32]],
        weight: Float32,
        entries: Int64,
        sources: Int64 | None,
    ) -> None:
        """Change the maps of the touched entries (new arrays, old ones stay)."""
        w, wide = weight, weight[:, None]
        place = (edit.layer, edit.parameter)
        if edit.kind == "erase":
            for key, (scale, shift) in maps.items():
                if not edit.layer or key == place:
                    # Plus zero, so that no -0 is left
                    maps[key] = (1 - w) * scale + w, (1 - wide) * shift + np.float32(0)
        elif edit.kind == "clone":
            assert sources is not None
            for key, (scale, shift) in maps.items():
                item = self.maps[key]
                own = np.asarray(np.where(sources >= 0, w, 0), np.float32)
                maps[key] = (
                    (1 - own) * scale + own * item.scale[sources],
                    (1 - own[:, None]) * shift + own[:, None] * item.shift[sources],
                )
        elif edit.kind == "move":
            share, ratio = np.float32(edit.value[0]), np.float32(edit.value[1])
            taken = (edit.source, WEIGHT)
            scale, shift = maps.get(taken, _untouched(len(w), 1))
            more, most = maps.get(place, _untouched(len(w), 1))
            # Both as absolute factors, so that what one loses is what the other gains
            moved = w * share * np.maximum(scale + shift[:, 0], 0)
            gained = np.minimum(more + most[:, 0] + moved * ratio, MAXIMUM_WEIGHT)
            left = np.asarray(1 - w * share, np.float32)
            maps[taken] = left * scale, left[:, None] * shift
            maps[place] = more, (gained - more)[:, None]
        else:
            size = len(edit.value) if edit.kind == "set" else 1
            scale, shift = maps.get(place, _untouched(len(w), size))
            if edit.kind == "set":
                target = np.asarray(edit.value, np.float32)
                maps[place] = (1 - w) * scale, (1 - wide) * shift + wide * target
            elif edit.kind == "add":
                base = np.float32(edit.base)
                own = scale * base
                u = np.clip(own + shift[:, 0] + w * np.float32(edit.value[0]), 0, 1)
                maps[place] = scale, (u - own)[:, None]
            else:
                factor = np.asarray(1 - w + w * edit.value[0], np.float32)
                maps[place] = scale * factor, shift * factor[:, None]

    def _sources(self, stroke: Stroke, entries: Int64) -> Int64:
        """For each entry the point that a clone stamp copies it from, -1 for none.

        The strongest dab decides: its source, and the way from the dab to the point turned
        with the surface.
        """
        result = np.full(len(entries), -1, np.int64)
        best = np.zeros(len(self.positions), np.float64)
        dab_of = np.full(len(self.positions), -1, np.int64)
        first = 0
        for start in range(0, len(stroke.dabs), _RUN):
            for near, distance, pressure in self._near(stroke.dabs[start : start + _RUN]):
                w = gaussian(distance, max(stroke.falloff, 1.0)) * pressure
                k = w.argmax(axis=1)
                value = w[np.arange(len(near)), k]
                better = value > best[near]
                best[near[better]] = value[better]
                dab_of[near[better]] = first + k[better]
            first += _RUN
        inside = entries[entries < len(self.positions)]
        for index in np.unique(dab_of[inside]):
            dab = stroke.dabs[index] if index >= 0 else None
            if dab is None or dab.source is None or dab.source_normal is None:
                continue
            own = np.flatnonzero((entries < len(self.positions)) & (_at(dab_of, entries) == index))
            offset = self.positions[entries[own]].astype(np.float64) - np.array(dab.position)
            wanted = np.array(dab.source) + offset @ _turn(dab.normal, dab.source_normal).T
            margin = 0.25 * dab.radius
            near = self._in_box(wanted.min(axis=0) - margin, wanted.max(axis=0) + margin)
            if not len(near):
                continue
            squared = ((wanted[:, None] - self.positions[near].astype(np.float64)) ** 2).sum(axis=2)
            nearest = squared.argmin(axis=1)
            close = squared[np.arange(len(own)), nearest] <= margin**2
            result[own[close]] = near[nearest[close]]
        return result


def gaussian(distance: Float64, falloff: float) -> Float64:
    """1 at the centre, 0 from the radius (distance 1) on; falloff is the standard deviation.

    The Gaussian of 2015 (radius 25 pixels, standard deviation 15: 0.6), lowered to reach 0 at
    the radius. 0 is a hard edge.
    """
    inside = distance <= 1
    if falloff == 0:
        return np.asarray(inside.astype(np.float64))
    edge = np.exp(-0.5 / falloff**2)
    value = np.exp(-0.5 * np.where(inside, distance, 1.0) ** 2 / falloff**2)
    return np.asarray(np.where(inside, (value - edge) / (1 - edge), 0.0))


def _untouched(count: int, size: int) -> tuple[Float32, Float32]:
    return np.ones(count, np.float32), np.zeros((count, size), np.float32)


def _at(values: Int64, entries: Int64) -> Int64:
    """values[entries], -1 for the entry beyond the last point."""
    return np.append(values, -1)[entries]


def _turn(normal: Sequence[float], onto: Sequence[float]) -> Float64:
    """The least rotation that brings one direction onto another: float64 [3, 3]."""
    a, b = (
        np.asarray(v, np.float64) / max(float(np.linalg.norm(v)), 1e-12) for v in (normal, onto)
    )
    axis, cos = np.cross(a, b), float(a @ b)
    if cos < -0.999:
        return np.eye(3)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1 + cos))
