"""Painting: from a brush's way over the picture to strokes on the objects under it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from burnish.core.colour import colour_from_hex
from burnish.core.errors import InvalidValue, TooLarge
from burnish.core.types import RGB, AnyArray, Float64
from burnish.materials.layer import MaterialState
from burnish.materials.painting.stroke import Dab, Edit, Stroke, Triple, narrow
from burnish.session.brushes import Wish, brush_named, brushes, edits
from burnish.session.surface import Surface
from burnish.transport.basis import State

if TYPE_CHECKING:
    from burnish.session.session import Session

Point = Sequence[float]
"""(x, y) or (x, y, pressure): view pixels from the upper left corner, pressure 0 to 1."""
LARGEST = 4096.0


@dataclass(frozen=True)
class BrushOptions:
    """How a brush is held.

    size: its radius in view pixels, above 0 to 4096. strength: 0 to 1, the largest share of
    the effect. falloff: the Gaussian's standard deviation as a share of the radius, 0 for a
    hard edge (2015: radius 25, standard deviation 15). color: linear RGB, "#rrggbb" (sRGB) or
    None. amount, layer: see `Brush`. source: the pixel that a clone stamp copies from as the
    stroke begins; it moves along. straight: from the first point to the last alone.
    Raises InvalidValue.
    """

    size: float = 25.0
    strength: float = 1.0
    falloff: float = 0.6
    color: RGB | str | None = None
    amount: float | None = None
    layer: str | None = None
    source: tuple[float, float] | None = None
    straight: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.size <= LARGEST:
            raise InvalidValue(f"size must lie above 0 and at most {LARGEST:g}; got {self.size!r}")
        for name, high in (("strength", 1.0), ("falloff", 10.0)):
            value = getattr(self, name)
            if not 0 <= value <= high:
                raise InvalidValue(f"{name} must lie in [0, {high:g}]; got {value!r}")

    @property
    def wish(self) -> Wish:
        """What is asked of a brush."""
        colour = self.color
        if isinstance(colour, str):
            colour = colour_from_hex(colour)
        return Wish(colour, self.amount, self.layer)


class PaintStroke:
    """A stroke being drawn: the picture shows it while it grows.

    >>> with session.stroke("diffuse-color", color="#c03020", size=20) as brush:  # doctest: +SKIP
    ...     brush.extend([(100, 80), (120, 84)])
    ...     show(session.frame())
    ...     brush.extend([(150, 90, 0.5)])
    """

    def __init__(
        self,
        session: Session,
        brush: str,
        options: BrushOptions,
        objects: Sequence[str] | Literal["all"] | None,
        view: str | None,
    ) -> None:
        self._session, self._options, self._view = session, options, view
        self._brush = brush
        self._before: State = session.state
        self._points: list[Triple] = []
        self._dabs: dict[str, list[Dab]] = {}
        self._lengths: dict[str, Float64] = {}
        """cos² and sin² to the u direction, weighted by length."""
        self._objects: tuple[str, ...] | None = None
        if objects == "all":
            self._objects = tuple(name for name in self._names if self._has_brush(name))
            if not self._objects:
                raise InvalidValue(f"no object has a material for the brush {brush!r}")
        elif objects is not None:
            self._objects = tuple(objects)
            self._check()

    @property
    def _names(self) -> list[str]:
        """The editable objects, as `Session.object_map` counts them."""
        views = self._session.views
        view = next(iter(views)) if self._view is None else self._view
        return [item.id for item in views[view].basis.objects]

    @property
    def objects(self) -> tuple[str, ...]:
        """The objects that the stroke has painted on so far."""
        return tuple(name for name, dabs in self._dabs.items() if dabs)

    def extend(self, points: Sequence[Point]) -> None:
        """Draw on to further points. Raises InvalidValue."""
        for point in points:
            numbers = tuple(float(x) for x in point)
            if len(numbers) not in (2, 3) or not np.isfinite(numbers).all():
                raise InvalidValue(f"a point must be (x, y) or (x, y, pressure); got {point!r}")
            x, y, pressure = (*numbers, 1.0)[:3]
            if not 0 <= pressure <= 1:
                raise InvalidValue(f"pressure must lie in [0, 1]; got {pressure!r}")
            if self._options.straight and self._points:
                self._start_again()
                self._lay(self._points[0], (x, y, pressure))
                continue
            self._lay(self._points[-1] if self._points else None, (x, y, pressure))
            self._points.append((x, y, pressure))
        self._show()

    def _start_again(self) -> None:
        first = self._points[0]
        self._dabs, self._lengths, self._points = {}, {}, []
        self._lay(None, first)
        self._points = [first]

    def _check(self) -> None:
        """Whether the brush works on the stroke's objects. Raises InvalidValue, UnknownName."""
        assert self._objects is not None
        for name in self._objects:
            self._edits(name, self._before)

    def _has_brush(self, name: str) -> bool:
        return brush_named(self._session.brushes(name), self._brush).available

    def _edits(self, object_id: str, state: State) -> tuple[str, tuple[Edit, ...]]:
        material = self._session.material(object_id)
        if material is None:
            self._session.select(object_id)
            raise InvalidValue(f"object {object_id} cannot be painted")
        brush = brush_named(brushes(material, state[object_id]), self._brush)
        along = self._lengths.get(object_id)
        share = 1.0 if along is None or not along.sum() else float(along[0] / along.sum())
        wish = replace(self._options.wish, along=narrow(share))
        if brush.name == "clone" and self._options.source is None:
            raise InvalidValue("the clone stamp needs a source: the pixel to copy from")
        return brush.label, edits(brush, material, state[object_id], wish)

    def _lay(self, start: Triple | None, stop: Triple) -> None:
        """Dabs from a point to the next, on the surfaces under them."""
        if start is None:
            way = np.array([stop])
        else:
            length = float(np.hypot(stop[0] - start[0], stop[1] - start[1]))
            steps = max(1, int(np.ceil(length / max(0.5, self._options.size / 8))))
            share = (np.arange(steps) + 1)[:, None] / steps
            way = np.array(start) + share * (np.array(stop) - np.array(start))
        session, view = self._session, self._view
        covered = session.object_map(view)
        height, width = covered.shape
        x, y = np.floor(way[:, 0]).astype(np.int64), np.floor(way[:, 1]).astype(np.int64)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        way, x, y = way[inside], x[inside], y[inside]
        names = self._names
        under = covered[y, x]
        if self._objects is None:
            seen = np.flatnonzero(under >= 0)
            if not len(seen):
                return
            # The stroke stays on the object where it first meets one
            self._objects = (names[int(under[seen[0]])],)
            self._check()
        for name in self._objects:
            own = under == names.index(name)
            if own.any():
                self._lay_on(name, way[own], x[own] + width * y[own])

    def _lay_on(self, name: str, way: Float64, pixel: AnyArray) -> None:
        surface = self._session.surface(name, self._view)
        row = surface.row_at(pixel)
        way, row = way[row >= 0], row[row >= 0]
        radius = self._options.size * surface.footprint[row]
        sources = self._sources(surface, way)
        dabs = self._dabs.setdefault(name, [])
        for k, r in enumerate(row):
            if sources is not None and sources[k] < 0:
                continue
            dab = Dab(
                _triple(surface.position[r]),
                _triple(surface.normal[r]),
                narrow(radius[k]),
                narrow(way[k, 2]),
            )
            if sources is not None:
                at = int(sources[k])
                dab = dab._replace(
                    source=_triple(surface.position[at]), source_normal=_triple(surface.normal[at])
                )
            if dabs:
                step = np.subtract(dab.position, dabs[-1].position)
                cos = float(np.dot(step, surface.along_u[r]))
                both = np.array([cos * cos, max(float(step @ step) - cos * cos, 0.0)])
                length = max(float(np.linalg.norm(step)), 1e-30)
                self._lengths[name] = self._lengths.get(name, np.zeros(2)) + both / length
            dabs.append(dab)

    def _sources(self, surface: Surface, way: Float64) -> AnyArray | None:
        """The rows that a clone stamp copies from, -1 for none."""
        if self._brush != "clone" or self._options.source is None:
            return None
        first = self._points[0] if self._points else tuple(way[0])
        offset = np.subtract(self._options.source, first[:2])
        at = np.floor(way[:, :2] + offset).astype(np.int64)
        inside = (at >= 0).all(axis=1) & (at[:, 0] < surface.width) & (at[:, 1] < surface.height)
        row = surface.row_at(at[:, 0] + surface.width * at[:, 1])
        return np.where(inside, row, -1)

    def _show(self) -> None:
        """Make the stroke as it is now part of the state."""
        state: dict[str, MaterialState] = dict(self._before)
        label = ""
        for name in self.objects:
            label, change = self._edits(name, self._before)
            if self._brush in ("eraser", "clone") and not self._before[name].strokes:
                continue
            stroke = _stroke(self._brush, change, self._options, tuple(self._dabs[name]))
            strokes = (*self._before[name].strokes, stroke)
            state[name] = replace(self._before[name], strokes=strokes)
        if state != self._before:
            _record(self._session, state, f"{label} on {', '.join(self.objects)}")


@contextmanager
def painting(
    session: Session,
    brush: str,
    options: BrushOptions,
    objects: Sequence[str] | Literal["all"] | None,
    view: str | None,
) -> Iterator[PaintStroke]:
    """One stroke, one step of undo."""
    with session.gesture():
        yield PaintStroke(session, brush, options, objects, view)


def paint_whole(
    session: Session, brush: str, options: BrushOptions, objects: Sequence[str]
) -> tuple[str, ...]:
    """A brush on all of some objects at once, as one step. Raises InvalidValue, UnknownName."""
    state: dict[str, MaterialState] = dict(session.state)
    label = ""
    for name in objects:
        material = session.material(name)
        if material is None:
            session.select(name)
            raise InvalidValue(f"object {name} cannot be painted")
        found = brush_named(brushes(material, state[name]), brush)
        if found.name == "clone":
            raise InvalidValue("the clone stamp paints strokes alone, not whole objects")
        change = edits(found, material, state[name], options.wish)
        stroke = replace(_stroke(brush, change, options, ()), everywhere=True)
        state[name] = replace(state[name], strokes=(*state[name].strokes, stroke))
        if found.name == "eraser" and options.strength == 1:
            state[name] = replace(state[name], strokes=())
        label = found.label
    if label:
        _record(session, state, f"{label} on all of {', '.join(objects)}")
    return tuple(objects)


def _record(session: Session, state: State, label: str) -> None:
    """Make a state with paint the present one, unless so many objects do not fit together."""
    before = session.state
    fresh = [name for name in state if state[name].strokes and not before[name].strokes]
    session.restore(state, label)
    painted = [name for name in state if state[name].strokes]
    if fresh and len(painted) > 1:
        try:
            if session.ready():
                session.renderer()
        except TooLarge:
            session.restore(before, label)
            raise


def _stroke(
    brush: str, change: tuple[Edit, ...], options: BrushOptions, dabs: tuple[Dab, ...]
) -> Stroke:
    return Stroke(
        brush,
        change,
        dabs,
        narrow(options.strength),
        narrow(options.falloff),
    )


def _triple(values: AnyArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
