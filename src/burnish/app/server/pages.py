"""The pages that are connected, and the frames that are made for them."""

from __future__ import annotations

from typing import Any

from burnish.app import messages as m
from burnish.app.server.frames import Frame, Kind, halves
from burnish.app.server.mailbox import Mailbox
from burnish.core.errors import UnknownName
from burnish.session import Session


class Pages:
    """Whom to tell. Used from the engine's thread, but for `to_all`."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.views = tuple(session.views)
        self.boxes: list[Mailbox] = []
        self._number = 0

    def to_all(self, message: m.ServerMessage) -> None:
        """Send a message to every page."""
        for box in list(self.boxes):
            box.put(message)

    def show(self, frame: Frame) -> None:
        """Send a frame to the pages that show its view."""
        for box in list(self.boxes):
            if box.watches(frame.view):
                box.put_frame(frame)

    def want(self, index: int) -> bool:
        """Whether a new picture of the view would go out to some page at once."""
        return any(box.wants(index) for box in list(self.boxes))

    def watch(self, index: int) -> bool:
        """Whether some page shows the view."""
        return any(box.watches(index) for box in list(self.boxes))

    def index(self, view: str) -> int:
        """The view's place among the session's. Raises UnknownName."""
        if view not in self.views:
            raise UnknownName("view", view, self.views)
        return self.views.index(view)

    def frame(self, kind: Kind, view: str, pixels: Any, corner: tuple[int, int] = (0, 0)) -> Frame:
        """A new frame: linear RGB float32, or numbers uint16 [height, width, channels].

        corner: the view's pixel that its first one lies on.
        """
        self._number += 1
        return Frame(
            kind=kind,
            view=self.index(view),
            number=self._number,
            revision=self._session.revision,
            pixels=pixels if pixels.dtype == "uint16" else halves(pixels),
            corner=corner,
        )
