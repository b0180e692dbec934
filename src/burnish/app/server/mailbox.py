"""What waits for one page: the newest frame of each view and the newest of each message.

The engine puts things in from its thread and never waits; the page's connection takes
them out at its own speed. A page that stalls costs one frame of memory and no time.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

from burnish.app.messages import (
    Appearance,
    Curves,
    Notice,
    ObjectValues,
    Refused,
    ServerMessage,
    State,
    Welcome,
)
from burnish.app.server.frames import Frame, Kind

FRAMES_IN_FLIGHT = 2
"""Frames sent and not yet shown; a second one hides the way there and back."""
_NOTICES = 32
_SLOW_LINK = 12e6
"""Bytes a second; a link that never does better gets deflated frames."""
_SLOW_LOOPBACK = 2e6
"""The same for this machine's own address: a busy machine is no slow link, where deflating
would make things worse, but a tunnel to another one may be."""
_TELLING_BYTES = 200_000
"""Smaller frames say more about the way's length than about its width."""
_REMEMBERED = 8


class Mailbox:
    """One page's outgoing side. All methods may be called from any thread."""

    def __init__(
        self, client: str, loop: asyncio.AbstractEventLoop, loopback: bool = False
    ) -> None:
        """loopback: whether the page, or its tunnel's end, is on this machine."""
        self.client = client
        self._slow = _SLOW_LOOPBACK if loopback else _SLOW_LINK
        self._loop = loop
        self._wake = asyncio.Event()
        self._lock = threading.Lock()
        self._views: frozenset[int] = frozenset()
        self._frames: dict[tuple[Kind, int], Frame] = {}
        self._messages: dict[type[ServerMessage], ServerMessage] = {}
        self._words: deque[ServerMessage] = deque(maxlen=_NOTICES)
        self._state: State | None = None
        self._stamps: Mapping[str, int] = {}
        self._sent_stamp = -1
        self._in_flight: dict[int, tuple[float, int]] = {}
        self._speeds: deque[float] = deque(maxlen=_REMEMBERED)

    # -- the engine's side ----------------------------------------------------------------

    def wants(self, view: int) -> bool:
        """Whether a new frame of the view would go out at once."""
        with self._lock:
            return (
                view in self._views
                and (Kind.PICTURE, view) not in self._frames
                and not self._behind
            )

    def watches(self, view: int) -> bool:
        """Whether the page shows the view."""
        return view in self._views

    def put_frame(self, frame: Frame) -> None:
        """Replace the waiting frame of the same kind and view."""
        with self._lock:
            self._frames[frame.slot] = frame
            behind = self._behind
        if not behind:
            self._notify()

    def put(self, message: ServerMessage) -> None:
        """Replace the waiting message of the same type; words to the user queue up."""
        with self._lock:
            if isinstance(message, (Notice, Refused, Welcome)):
                self._words.append(message)
            else:
                self._messages.pop(type(message), None)
                self._messages[type(message)] = message
            behind = self._behind and not self._words
        if not behind:
            self._notify()

    def put_state(self, state: State, stamps: Mapping[str, int]) -> None:
        """Replace the waiting state. stamps: when each object last changed."""
        with self._lock:
            self._state, self._stamps = state, stamps
            behind = self._behind
        if not behind:
            self._notify()

    # -- the connection's side ------------------------------------------------------------

    def watch(self, views: frozenset[int]) -> None:
        """Show these views from now on."""
        with self._lock:
            self._views = views
            self._frames = {slot: f for slot, f in self._frames.items() if slot[1] in views}

    def shown(self, number: int, held: float) -> None:
        """The page has shown a frame, `held` seconds after it arrived there."""
        with self._lock:
            sent, size = self._in_flight.pop(number, (0.0, 0))
            if size >= _TELLING_BYTES:
                way = time.monotonic() - sent - held
                self._speeds.append(size / max(way, 1e-3))
        self._notify()

    def sent(self, number: int, size: int) -> None:
        """A frame of `size` bytes has begun its way."""
        with self._lock:
            if number in self._in_flight:
                self._in_flight[number] = time.monotonic(), size

    @property
    def deflate(self) -> bool:
        """Whether the link is so slow that making frames smaller makes them faster."""
        return len(self._speeds) == _REMEMBERED and max(self._speeds) < self._slow

    @property
    def busy(self) -> bool:
        """Whether something waits to be sent, or a picture to be shown."""
        with self._lock:
            return bool(
                self._frames or self._messages or self._words or self._state or self._in_flight
            )

    @property
    def _behind(self) -> bool:
        """Whether the page has yet to show what it was sent; it is not woken until then."""
        return len(self._in_flight) >= FRAMES_IN_FLIGHT

    def _notify(self) -> None:
        # The loop is closed when the server is: nobody will read this any more.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._wake.set)

    async def take(self) -> ServerMessage | Frame:
        """The next thing to send: words first, then the state, then pictures.

        A page that is behind with its pictures gets words alone.
        """
        while True:
            found = self._next()
            if found is not None:
                return found
            await self._wake.wait()
            self._wake.clear()

    def _next(self) -> ServerMessage | Frame | None:
        with self._lock:
            if self._words:
                return self._words.popleft()
            if self._behind:
                return None
            if self._state is not None:
                return self._changed_state()
            for kind in list(self._messages):
                if kind not in (Appearance, Curves) or not self._frames:
                    return self._messages.pop(kind)
            for slot, frame in self._frames.items():
                if slot[0] == Kind.PICTURE:
                    self._in_flight[frame.number] = time.monotonic(), 0
                return self._frames.pop(slot)
        return None

    def _changed_state(self) -> State:
        """The waiting state with only the objects that this page has not seen so."""
        state, self._state = self._state, None
        assert state is not None
        changed: dict[str, ObjectValues] = {
            name: values
            for name, values in state.materials.items()
            if self._stamps[name] > self._sent_stamp
        }
        self._sent_stamp = max(self._stamps.values(), default=-1)
        return replace(state, materials=changed)
