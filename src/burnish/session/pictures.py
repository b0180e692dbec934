"""What a view shows: its frozen form, kept until something outside the targets changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from burnish.core.types import Int32
from burnish.runtime.freeze import BakedTransport
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import State
from burnish.transport.frozen import Transport
from burnish.transport.pack import BlockSource


@dataclass(frozen=True)
class _Frozen:
    targets: tuple[int, ...]
    state: State
    revision: int
    renderer: Renderer


class ViewPictures:
    """One view of a session. Stored blocks are frozen by `runtime.freeze`."""

    def __init__(self, name: str, source: Transport | BlockSource) -> None:
        self.name = name
        self.transport: Transport = (
            cast(Transport, source) if hasattr(source, "freeze") else BakedTransport(source)
        )
        self._frozen: _Frozen | None = None
        self._map: tuple[int, Int32] | None = None

    def renderer(self, targets: tuple[int, ...], state: State) -> Renderer:
        """The renderer for targets (rising indices), frozen again only where it must be."""
        if self._frozen is None or not self._holds(self._frozen, targets, state):
            # Let go of the old form first: two of them may not fit
            self._frozen = None
            frozen = self.transport.freeze(targets, state)
            self._frozen = _Frozen(targets, state, frozen.revision, Renderer(frozen))
        return self._frozen.renderer

    def ready(self, targets: tuple[int, ...], state: State) -> bool:
        """Whether `renderer` answers at once; a live transport begins what it would wait for."""
        ready = getattr(self.transport, "ready", None)
        return ready is None or bool(ready(targets, state))

    def _holds(self, frozen: _Frozen, targets: tuple[int, ...], state: State) -> bool:
        if frozen.targets != targets or frozen.revision != self.transport.revision:
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
