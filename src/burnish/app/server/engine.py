"""The thread that owns the session: it takes the pages' messages and makes frames.

One round: carry out everything that has arrived (a parameter that was dragged through
twenty values since the last round is set once, to the last), then compute each changed view
that some page is ready to show. Plots, autosave, denoising and error metrics wait for a pause.
A live view that has no samples yet is asked again; the last picture stays until it has.
"""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any, TypeVar

from burnish.app import messages as m
from burnish.app.server.actions import Actions
from burnish.app.server.autosave import Autosave
from burnish.app.server.frames import Kind
from burnish.app.server.lights import moves_a_light
from burnish.app.server.mailbox import Mailbox
from burnish.app.server.pages import Pages
from burnish.app.server.painting import Painting
from burnish.app.server.publishing import Publishing
from burnish.app.server.resting import Cleaned, Resting
from burnish.app.server.snapshots import Snapshots
from burnish.app.server.tracing import Picture, Tracing
from burnish.core.errors import BurnishError
from burnish.core.types import Float32
from burnish.session import Session

log = logging.getLogger("burnish.editor")

T = TypeVar("T")
_QUEUE = 2000
_POLL_SECONDS = 0.05
_AUTOSAVE_SECONDS = 1.0


class Engine:
    """Drives one session for any number of pages. Public methods are thread-safe."""

    def __init__(self, session: Session, autosave: Path | None = None) -> None:
        self.session = session
        self.run = uuid.uuid4().hex
        self.pages = Pages(session)
        self.snapshots = Snapshots()
        self.tracing = Tracing(session, self._reference_changed)
        self.resting = Resting(session, lambda done: self._cleaned(done))
        self.autosave = Autosave(session, autosave)
        self._out = Publishing(
            session, self.pages, self.resting, self.tracing, self.autosave, self.run
        )
        self._actions = Actions(
            session,
            self.pages,
            self._out,
            self.snapshots,
            self.tracing,
            self.resting,
            self.autosave,
        )
        self._painting = Painting(session, self.pages)
        self._queue: deque[tuple[Mailbox | None, Any]] = deque()
        self._changed = threading.Condition()
        self._stop = False
        self._thread = threading.Thread(target=self._loop, name="burnish-engine", daemon=True)

    # -- for the connections ----------------------------------------------------------------

    def start(self) -> None:
        """Begin."""
        self._out.plots.start()
        self._thread.start()

    def close(self) -> None:
        """Stop after the round in progress, with the edits autosaved."""
        self.tracing.cancel()
        with self._changed:
            self._stop = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)
        self._out.plots.close()

    def attach(self, box: Mailbox) -> None:
        """A page has come: send it everything."""
        self.call(lambda: self._welcome(box))

    def detach(self, box: Mailbox) -> None:
        """A page has gone."""
        self.call(lambda: self._farewell(box))

    def watch(self, box: Mailbox) -> None:
        """A page shows other views than before."""
        self.call(lambda: self._out.watched(box))

    def poke(self) -> None:
        """A page can take a frame again."""
        with self._changed:
            self._changed.notify()

    def submit(self, box: Mailbox, message: m.ClientMessage) -> None:
        """Queue a page's message; it replaces an older value of the same thing."""
        with self._changed:
            slot = _slot(message)
            if slot is not None:
                for i in range(len(self._queue) - 1, -1, -1):
                    other_box, other = self._queue[i]
                    other_slot = _slot(other)
                    if other_slot is None:
                        break
                    if other_slot == slot and other_box is box:
                        self._queue[i] = box, message
                        return
            if len(self._queue) >= _QUEUE:
                box.put(m.Refused(message.seq, "Too many messages at once; try again."))
                return
            self._queue.append((box, message))
            self._changed.notify()

    def call(self, function: Callable[[], T]) -> Future[T]:
        """Run a function between two rounds, in the engine's thread."""
        future: Future[T] = Future()

        def job() -> None:
            try:
                future.set_result(function())
            except BaseException as error:  # noqa: BLE001 - the future carries it to its reader
                future.set_exception(error)

        with self._changed:
            if self._stop:
                future.cancel()
                return future
            self._queue.append((None, job))
            self._changed.notify()
        return future

    def finished_picture(self, view: str) -> Future[Float32 | None]:
        """The picture of a view, not denoised; None while a new selection is being traced."""
        return self.call(lambda: self._out.finished_picture(view))

    # -- the rounds -------------------------------------------------------------------------

    def _loop(self) -> None:
        while True:
            with self._changed:
                if not (self._due() or self._stop or self._out.wanted()):
                    self._changed.wait(_POLL_SECONDS)
                batch = self._due()
                self._queue = deque(item for item in self._queue if item not in batch)
                stop = self._stop
            for box, item in batch:
                self._carry_out(box, item)
            self._out.state()
            self._out.lights()
            self._out.frames()
            self._out.curves()
            self._out.progress()
            if stop:
                self._save_automatically()
                return
            if not self._queue and self._out.at_rest:
                self._rest()

    def _due(self) -> list[tuple[Mailbox | None, Any]]:
        """What can be carried out now: all that has arrived, but for the place of a light that
        is dragged while the picture of the last one is still to come. A light that never stood
        still would never be seen."""
        asked = [item for box, item in self._queue if box is not None]
        moves = all(isinstance(item, m.SetValue) and moves_a_light(item.path) for item in asked)
        if moves and self._out.waits and not self._stop:
            return [(box, item) for box, item in self._queue if box is None]
        return list(self._queue)

    def _rest(self) -> None:
        """What waits for a pause."""
        self._painting.publish()
        self._out.prepare_drafts()
        self._out.draw_plots()
        self._out.denoise()
        self._out.trace_lights()
        self._out.compare()
        if time.monotonic() - self._out.last_edit > _AUTOSAVE_SECONDS:
            self._save_automatically()

    def _carry_out(self, box: Mailbox | None, item: Any) -> None:
        if box is None:
            item()
            return
        before = self.session.revision
        try:
            if not self._painting.carry_out(box, item):
                self._actions.carry_out(box, item)
        except BurnishError as error:
            box.put(m.Refused(item.seq, str(error)))
        except Exception as error:
            log.exception("message %s failed", type(item).__name__)
            box.put(
                m.Refused(
                    item.seq,
                    f"That did not work ({type(error).__name__}: {error}). "
                    "The edits made before it are kept.",
                )
            )
        if self.session.revision != before:
            self._out.last_edit = time.monotonic()

    def _save_automatically(self) -> None:
        try:
            self.autosave.write(self._out.changed)
        except BurnishError as error:
            words = str(error)
            self.pages.to_all(m.Notice("warning", words[0].upper() + words[1:]))

    # -- pages come and go ------------------------------------------------------------------

    def _welcome(self, box: Mailbox) -> None:
        self.pages.boxes.append(box)
        self._out.welcome(box)
        box.put(self.snapshots.message())
        self._painting.welcome()
        if self.autosave.left_behind is not None:
            box.put(m.Notice("info", "Edits from an earlier run were found.", offer="recover"))

    def _farewell(self, box: Mailbox) -> None:
        if box in self.pages.boxes:
            self.pages.boxes.remove(box)
            self._out.tell_transports()
        self._painting.farewell(box)
        self._actions.farewell(box)

    # -- from other threads -------------------------------------------------------------------

    def _cleaned(self, done: Cleaned | str) -> None:
        self.call(lambda: self._out.cleaned(done))

    def _reference_changed(self, picture: Picture | None) -> None:
        """The path tracer has something new; called from its thread."""

        def job() -> None:
            self.pages.to_all(self.tracing.message(self.session.revision))
            if picture is not None:
                frame = self.pages.frame(Kind.COMPARISON, *picture)
                for box in list(self.pages.boxes):
                    box.put_frame(frame)

        self.call(job)


def _slot(item: object) -> tuple[object, ...] | None:
    """Messages of equal slot replace one another; None lets nothing pass it."""
    match item:
        case m.SetValue(path=path):
            return "value", path
        case m.SetMap(path=path, file=None):
            return "map", path
        case m.SetCurve(layer=layer):
            return "curve", layer
        case m.SetOutgoingCurve(layer=layer):
            return "outgoing", layer
        case m.SetSecondCurve(layer=layer):
            return "second", layer
        case m.SetWeight(layer=layer):
            return "weight", layer
        case m.Inspect():
            return ("inspect",)
    return None
