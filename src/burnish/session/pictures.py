"""What a view shows: its frozen form, kept until something outside the targets changes."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from burnish.core.errors import TooLarge
from burnish.core.types import Float32, Int32
from burnish.materials.layer import Material, MaterialState, unpainted
from burnish.materials.lights import mix, standing
from burnish.materials.painting.canvas import Canvas
from burnish.materials.painting.varied import VariedObject
from burnish.runtime.drafts import Choice, Drafts
from burnish.runtime.freeze import BakedTransport
from burnish.runtime.painted import PaintedRenderer, PaintedRows
from burnish.runtime.renderer import Renderer, Spans
from burnish.session.surface import Surface
from burnish.transport.basis import State
from burnish.transport.frozen import Frozen, Transport
from burnish.transport.pack import BlockSource

_GRID = 32
"""Points along u and v that stand for an object whose own rows a view does not have."""


@dataclass(frozen=True)
class _Frozen:
    targets: tuple[int, ...]
    fine: tuple[int, ...]
    state: State
    revision: int
    frozen: Frozen

    spans: Spans
    """Of the form before, where this one's numbers lie in the same memory."""

    @cached_property
    def renderer(self) -> Renderer:
        return Renderer(self.frozen, self.spans)

    @property
    def spans_so_far(self) -> Spans:
        """What the next form's frames may go on with."""
        return self.renderer.spans if "renderer" in vars(self) else {}


class ViewPictures:
    """One view of a session. Stored blocks are frozen by `runtime.freeze`."""

    def __init__(self, name: str, source: Transport | BlockSource) -> None:
        self.name = name
        self.transport: Transport = (
            cast(Transport, source) if hasattr(source, "freeze") else BakedTransport(source)
        )
        self._frozen: _Frozen | None = None
        self._drafts: Drafts | None = None
        self._shown: State | None = None
        self._painted: PaintedRenderer | None = None
        self._surfaces: dict[int, Surface] = {}
        self._varied: dict[int, VariedObject] = {}
        self._map: tuple[int, Int32] | None = None

    @property
    def _traced(self) -> bool:
        """Whether the view is traced while it is looked at, as a live session's are."""
        return bool(getattr(self.transport, "traces_the_scene", False))

    def _fine(self, targets: tuple[int, ...], state: State) -> tuple[int, ...]:
        """Objects beside the targets whose rows differ, weight maps apart."""
        return tuple(
            i
            for i, item in enumerate(self.transport.basis.objects)
            if i not in targets
            and item.material.varies(state[item.id])
            and not (self._traced and state[item.id] == item.material.initial)
        )

    def _freeze(self, targets: tuple[int, ...], state: State) -> _Frozen:
        """The form frozen for targets (rising indices), made again only where it must be."""
        fine = self._fine(targets, state)
        if self._frozen is None or not self._holds(self._frozen, targets, fine, state):
            before = self._frozen
            spans = before.spans_so_far if before and before.targets == targets else {}
            # Let go of the old form first: two of them may not fit
            self._frozen = self._painted = self._drafts = before = None
            plain = unpainted(state)
            # A tracer keeps what varies symbolic, and so needs no means
            for i in () if self._traced else fine:
                item = self.transport.basis.objects[i]
                found = self._varied_object(i, item.material, state[item.id])
                if found is not None:
                    plain[item.id] = found.at(state[item.id]).mean
            more = (fine,) if fine else ()
            frozen = self.transport.freeze(targets, plain, *more)
            self._frozen = _Frozen(targets, fine, state, frozen.revision, frozen, spans)
        return self._frozen

    def renderer(self, targets: tuple[int, ...], state: State) -> Renderer:
        """The renderer for targets, blind to paint, for gradients."""
        return self._freeze(targets, state).renderer

    def image(self, targets: tuple[int, ...], state: State) -> Float32:
        """The picture with the targets' materials and paint: float32 [height, width, 3].

        An object that the view does not meet itself counts as unpainted, and its pictures by
        their mean.
        """
        if self._only_lights_change(targets, state):
            targets = ()
        self._shown = state
        frozen = self._freeze(targets, state)
        rows: dict[int, PaintedRows] = {}
        mixed: dict[str, MaterialState] = dict(state)
        for i in (*targets, *frozen.fine):
            item = frozen.frozen.basis.objects[i]
            if not item.material.varies(state[item.id]):
                continue
            found = self._varied_object(i, item.material, state[item.id])
            if found is None:
                continue
            if len(self.surface(i).pixel):
                rows[i] = PaintedRows(self.surface(i).pixel, found.at(state[item.id]))
            else:
                mixed[item.id] = found.at(state[item.id]).mean
        if not rows:
            return frozen.renderer.image(mixed)
        painted = frozenset(rows)
        if self._painted is None or self._painted.painted != painted:
            self._painted = PaintedRenderer(frozen.frozen, painted)
        return self._painted.image(mixed, rows)

    def _varied_object(
        self, index: int, material: Material, state: MaterialState
    ) -> VariedObject | None:
        """What an object is made of row by row; of points all over its pictures where the view
        has no rows of it; None where then only strokes make it vary."""
        surface = self.surface(index)
        if not len(surface.pixel) and not state.images:
            return None
        known = self._varied.get(index)
        if known is None or known.material is not material:
            if len(surface.pixel):
                known = VariedObject(material, surface.canvas, surface.area, surface.uv_points)
            else:
                known = _all_over(material)
            self._varied[index] = known
        return known

    def draft(self, targets: tuple[int, ...], state: State) -> tuple[Float32, bool, bool]:
        """`image`, or a draft of it where that is faster; whether it is exact up to rounding,
        and whether it is the image itself."""
        drafts = self._drafts
        if drafts is None:
            return self.image(targets, state), True, True
        with drafts.drawing():
            image = self.image(targets, state)
        return image, drafts.exact, not drafts.drawn

    def prepare_drafts(self, targets: tuple[int, ...], state: State) -> None:
        """Freeze what is selected, measure whether drafts of it are faster, and begin them from
        the picture of `state`. Nothing while lights are mixed, for whose mix it is frozen."""
        if hasattr(self.transport, "ready"):
            return
        if self._frozen is not None and len(self._frozen.frozen.powers.lights):
            return
        with suppress(TooLarge):
            frozen = self._freeze(targets, state)
            if self._drafts is None:
                self._drafts = Drafts(frozen.renderer)
            self._drafts.prepare(state)

    @property
    def drafts_help(self) -> bool:
        """Whether `draft` is faster than `image` for anything that is frozen."""
        return self._drafts is not None and self._drafts.useful

    @property
    def draft_choices(self) -> tuple[Choice, ...]:
        """What was measured for the form that is frozen."""
        return () if self._drafts is None else tuple(self._drafts.choices.values())

    def surface(self, index: int) -> Surface:
        """What the view shows of an object's surface, with its paint."""
        known = self._surfaces.get(index)
        if known is None or known.rows is not self.transport.rows:
            known = self._surfaces[index] = Surface(self.transport, index)
            self._varied.pop(index, None)
        return known

    def ready(self, targets: tuple[int, ...], state: State) -> bool:
        """Whether `renderer` answers at once; a live transport begins what it would wait for."""
        ready = getattr(self.transport, "ready", None)
        if ready is None:
            return True
        every = tuple(sorted({*targets, *self._fine(targets, state)}))
        return bool(ready(every, unpainted(state)))

    def _only_lights_change(self, targets: tuple[int, ...], state: State) -> bool:
        """Whether the mix of the lights is what is being edited: then it alone is symbolic.

        Never where it is always symbolic, as in what is traced.
        """
        basis, frozen, shown = self.transport.basis, self._frozen, self._shown
        if self._traced or not basis.lights or frozen is None or shown is None:
            return False
        if frozen.targets == targets and len(frozen.frozen.powers.lights):
            return False
        if any(shown[item.id] != state[item.id] for item in basis.objects):
            return False
        if any(item.material.varies(state[item.id]) for item in basis.objects):
            return False
        return not self._holds(frozen, targets, frozen.fine, state)

    def _holds(
        self, frozen: _Frozen, targets: tuple[int, ...], fine: tuple[int, ...], state: State
    ) -> bool:
        if (frozen.targets, frozen.fine) != (targets, fine):
            return False
        if frozen.revision != self.transport.revision:
            return False
        relights = getattr(self.transport, "relights", False)
        if relights and standing(frozen.state) != standing(state):
            return False
        basis = self.transport.basis
        fixed = basis.lights and not len(frozen.frozen.powers.lights)
        if fixed and (mix(basis.lights, frozen.state) != mix(basis.lights, state)).any():
            return False
        return all(
            frozen.state[item.id].replacements == state[item.id].replacements
            if i in targets
            else frozen.state[item.id] == state[item.id]
            for i, item in enumerate(self.transport.basis.objects)
        )

    def object_map(self) -> Int32:
        """The object that covers most of each pixel: int32 [height, width], -1 for none."""
        transport = self.transport
        if self._map is None or self._map[0] != transport.revision:
            rows = transport.rows
            seen = np.flatnonzero(~rows.indirect)
            # The last write of a pixel wins: the heaviest row comes last
            order = seen[np.argsort(rows.weight[seen], kind="stable")]
            flat = np.full(transport.width * transport.height, -1, np.int32)
            flat[rows.pixel[order]] = rows.object[order]
            self._map = transport.revision, flat.reshape(transport.height, transport.width)
        return self._map[1]


def _all_over(material: Material) -> VariedObject:
    """An object that is seen alike all over its pictures, and where no stroke reaches."""
    side = (np.arange(_GRID) + 0.5) / _GRID
    uv = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 1, 2)
    nowhere = np.full((len(uv), 3), np.nan, np.float32)
    return VariedObject(material, Canvas(nowhere, nowhere), np.ones(len(uv)), uv)
