"""Kept looks: the materials, the picture that they gave, and a thumbnail."""

from __future__ import annotations

from dataclasses import dataclass

from burnish.app.messages import SnapshotData
from burnish.app.messages import Snapshots as SnapshotsMessage
from burnish.core.errors import InvalidValue
from burnish.core.types import Float32
from burnish.session import Session
from burnish.transport.basis import State

_MOST = 64
_LONGEST_THUMBNAIL = 200_000
_THUMBNAILS = ("data:image/png;base64,", "data:image/jpeg;base64,", "data:image/webp;base64,")


@dataclass(frozen=True)
class _Snapshot:
    data: SnapshotData
    state: State
    view: str
    image: Float32


class Snapshots:
    """The looks that were kept in this run. Used from the engine's thread alone."""

    def __init__(self) -> None:
        self._items: dict[int, _Snapshot] = {}
        self._last = 0

    def message(self) -> SnapshotsMessage:
        """All of them, oldest first."""
        return SnapshotsMessage(tuple(item.data for item in self._items.values()))

    def take(self, session: Session, label: str, view: str, thumbnail: str) -> None:
        """Keep the present look. Raises InvalidValue for a thumbnail that is no small picture."""
        if not thumbnail.startswith(_THUMBNAILS) or len(thumbnail) > _LONGEST_THUMBNAIL:
            raise InvalidValue("thumbnail must be a PNG, JPEG or WebP data URL below 200 kB")
        if len(self._items) >= _MOST:
            raise InvalidValue(f"{_MOST} looks are kept at most; delete one first")
        if not session.ready(view):
            raise InvalidValue("the selection is still being traced; keep the look in a moment")
        image = session.frame(view).copy()
        self._last += 1
        data = SnapshotData(self._last, label[:80] or f"Look {self._last}", thumbnail)
        self._items[self._last] = _Snapshot(data, session.state, view, image)

    def restore(self, session: Session, number: int) -> None:
        """Make a kept look the present one: one step of undo."""
        item = self._item(number)
        session.restore(item.state, f"Restored {item.data.label}")

    def forget(self, number: int) -> None:
        """Drop a kept look."""
        self._item(number)
        del self._items[number]

    def picture(self, number: int) -> tuple[str, Float32]:
        """A kept look's view and its linear RGB picture."""
        item = self._item(number)
        return item.view, item.image

    def _item(self, number: int) -> _Snapshot:
        if number not in self._items:
            raise InvalidValue(f"there is no look {number}; it may have been deleted")
        return self._items[number]
