"""A page without a browser: a websocket that speaks the editor's messages."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, Self

from websockets.sync.client import ClientConnection, connect

from burnish.app.messages import VERSION
from burnish.app.server import EditorServer
from burnish.app.server.frames import Frame, Kind, read

SECONDS = 20.0


class Page:
    """Connects, says Hello, watches views, and keeps what it is sent."""

    def __init__(
        self, server: EditorServer, views: tuple[str, ...] = ("front",), name: str = "test"
    ) -> None:
        self.seq = 0
        self.acknowledge = True
        self.messages: list[dict[str, Any]] = []
        self.frames: list[Frame] = []
        self._open = ExitStack()
        self.socket: ClientConnection = self._open.enter_context(
            connect(server.url.replace("http", "ws", 1) + "socket", compression=None, max_size=None)
        )
        self.send("Hello", version=VERSION, client=name)
        if views:
            self.send("Watch", views=list(views))

    def send(self, kind: str, **fields: Any) -> int:
        """Send a message; returns its number."""
        self.seq += 1
        self.socket.send(json.dumps({"type": kind, "seq": self.seq, **fields}))
        return self.seq

    def receive(self, seconds: float = SECONDS) -> dict[str, Any] | Frame:
        """The next message or frame; frames are acknowledged."""
        data = self.socket.recv(timeout=seconds)
        if isinstance(data, str):
            message: dict[str, Any] = json.loads(data)
            self.messages.append(message)
            return message
        frame = read(data)
        self.frames.append(frame)
        if self.acknowledge and frame.kind == Kind.PICTURE:
            self.send("Shown", frame=frame.number, held=0.0)
        return frame

    def until(
        self, wanted: Callable[[dict[str, Any] | Frame], bool], seconds: float = SECONDS
    ) -> Any:
        """Receive until something fits."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            item = self.receive(max(end - time.monotonic(), 0.01))
            if wanted(item):
                return item
        raise TimeoutError("nothing of what was wanted came")

    def message(self, kind: str, **fields: Any) -> dict[str, Any]:
        """Receive until a message of that type with those fields."""

        def fits(item: dict[str, Any] | Frame) -> bool:
            if isinstance(item, Frame) or item["type"] != kind:
                return False
            return all(item[key] == value for key, value in fields.items())

        result: dict[str, Any] = self.until(fits)
        return result

    def picture(self, revision: int | None = None) -> Frame:
        """Receive until a picture, of at least that revision."""

        def fits(item: dict[str, Any] | Frame) -> bool:
            return (
                isinstance(item, Frame)
                and item.kind == Kind.PICTURE
                and (revision is None or item.revision >= revision)
            )

        result: Frame = self.until(fits)
        return result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def drop(self) -> None:
        """End without a word, like a machine that has lost its network."""
        self.socket.close_socket()
        self._open.close()
