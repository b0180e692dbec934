"""The web application: one page, its websocket and the files it can download.

Everything lies below /TOKEN/, a name that each run draws at random, and only pages of the
server's own origin get an answer: other sites open in the same browser cannot reach it.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import secrets
import tempfile
import time
from collections.abc import Awaitable, Callable, MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from burnish.app import messages as m
from burnish.app.server.engine import Engine
from burnish.app.server.frames import Frame
from burnish.app.server.mailbox import Mailbox
from burnish.app.server.wire import decode, encode
from burnish.core.errors import BurnishError, InvalidValue

log = logging.getLogger("burnish.editor")

STATIC = Path(__file__).resolve().parent.parent / "static"
_HELLO_SECONDS = 10.0
_TRACING_SECONDS = 60.0

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

_HEADERS = (
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
    (
        b"content-security-policy",
        b"default-src 'self'; img-src 'self' data: blob:; connect-src 'self' ws: wss:; "
        b"frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    ),
)


class Guard:
    """Lets a request pass only with the token, a known Host and no foreign Origin.

    hosts: names that the Host header may have, or None for any (a server for others).
    """

    def __init__(self, app: Any, token: str, hosts: frozenset[str] | None) -> None:
        self._app, self._token, self._hosts = app, token.encode(), hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The ASGI interface."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        reason = self._refusal(scope)
        if reason is None:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 4403, "reason": reason})
        else:
            await PlainTextResponse(reason + "\n", 403)(scope, receive, send)

    def _refusal(self, scope: Scope) -> str | None:
        headers = {key: value.decode("latin-1") for key, value in scope["headers"]}
        host = headers.get(b"host", "")
        name = urlsplit(f"//{host}").hostname or ""
        if self._hosts is not None and name not in self._hosts:
            return "This server does not go by that name."
        origin = headers.get(b"origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return "Pages of other origins are refused."
        first = str(scope["path"]).split("/", 2)[1] if "/" in scope["path"] else ""
        if not secrets.compare_digest(first.encode(), self._token):
            return "The address lacks this run's token; use the one that burnish printed."
        return None


def _with_headers(send: Send) -> Send:
    async def wrapped(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *_HEADERS]
        await send(message)

    return wrapped


def build(engine: Engine, token: str, hosts: frozenset[str] | None) -> Any:
    """The ASGI application for one engine. Raises InvalidValue when the page is not built."""
    if not (STATIC / "index.html").exists():
        raise InvalidValue(
            f"the editor's page is missing from {STATIC}; build it with: python client/build.py"
        )
    page = Connection(engine)
    routes = [
        WebSocketRoute(f"/{token}/socket", page.serve),
        Route(f"/{token}/edits.json", page.edits),
        Route(f"/{token}/picture.exr", page.picture),
        Mount(f"/{token}", StaticFiles(directory=STATIC, html=True)),
    ]
    return Guard(Starlette(routes=routes), token, hosts)


class Connection:
    """What a page can ask of the server."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    async def edits(self, request: Request) -> Response:
        """The edits file."""
        text = await asyncio.wrap_future(self._engine.call(self._engine.autosave.text))
        name = _file_name(self._engine.session.name) + "-edits.json"
        return _download(text.encode(), "application/json", name)

    async def picture(self, request: Request) -> Response:
        """The picture as a float32 EXR in linear RGB."""
        from burnish.app.pictures import write_picture

        session, engine = self._engine.session, self._engine
        view = request.query_params.get("view", engine.pages.views[0])
        end = time.monotonic() + _TRACING_SECONDS
        try:
            while True:
                call = asyncio.wrap_future(engine.finished_picture(view))
                if (image := await call) is not None:
                    break
                if time.monotonic() > end:
                    return PlainTextResponse("The picture is still being traced.\n", 503)
                await asyncio.sleep(0.1)
        except BurnishError as error:
            return PlainTextResponse(f"{error}\n", 404)
        with tempfile.TemporaryDirectory(prefix="burnish-") as folder:
            path = Path(folder) / "picture.exr"
            await asyncio.to_thread(write_picture, path, image)
            data = path.read_bytes()
        return _download(data, "image/x-exr", _file_name(f"{session.name}-{view}") + ".exr")

    async def serve(self, socket: WebSocket) -> None:
        """One page's connection, from its Hello to its end."""
        await socket.accept()
        try:
            hello = await asyncio.wait_for(_receive(socket), _HELLO_SECONDS)
        except (WebSocketDisconnect, TimeoutError):
            with suppress(WebSocketDisconnect, RuntimeError):
                await socket.close(4400, "no Hello")
            return
        except InvalidValue as error:
            await socket.close(4400, str(error)[:100])
            return
        if not isinstance(hello, m.Hello) or hello.version != m.VERSION:
            await socket.close(4409, "this page is of another version; reload it")
            return
        here = socket.client is not None and _is_loopback(socket.client.host)
        box = Mailbox(hello.client, asyncio.get_running_loop(), here)
        self._engine.attach(box)
        writer = asyncio.create_task(_write(socket, box))
        try:
            await self._read(socket, box, hello.seq)
        except WebSocketDisconnect:
            pass
        finally:
            writer.cancel()
            self._engine.detach(box)
            with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await writer

    async def _read(self, socket: WebSocket, box: Mailbox, last: int) -> None:
        while True:
            try:
                message = await _receive(socket)
            except InvalidValue as error:
                box.put(m.Refused(-1, str(error)))
                continue
            if message.seq <= last:
                words = f"message {message.seq} came after {last} and was not carried out"
                box.put(m.Refused(message.seq, words))
                continue
            last = message.seq
            match message:
                case m.Shown(frame=number, held=held):
                    box.shown(number, held)
                    self._engine.poke()
                case m.Watch(views=names):
                    self._watch(box, message, names)
                case _:
                    self._engine.submit(box, message)

    def _watch(self, box: Mailbox, message: m.Watch, names: tuple[str, ...]) -> None:
        unknown = [name for name in names if name not in self._engine.pages.views]
        if unknown:
            box.put(m.Refused(message.seq, f"there is no view {unknown[0]!r}"))
            return
        box.watch(frozenset(self._engine.pages.index(name) for name in names))
        self._engine.watch(box)


async def _receive(socket: WebSocket) -> m.ClientMessage:
    data = await socket.receive()
    if data["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(data.get("code", 1000))
    text = data.get("text")
    if text is None:
        raise InvalidValue("messages to the server are text, not binary")
    return decode(text)


async def _write(socket: WebSocket, box: Mailbox) -> None:
    """Send what the mailbox holds, for as long as the connection lasts."""
    try:
        while True:
            item = await box.take()
            if isinstance(item, Frame):
                data = (
                    await asyncio.to_thread(lambda f: f.deflated, item) if box.deflate else item.raw
                )
                box.sent(item.number, len(data))
                await socket.send_bytes(data)
            else:
                await socket.send_text(encode(item))
    except (WebSocketDisconnect, RuntimeError) as error:
        log.debug("connection of %s ended: %s", box.client, error)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _download(data: bytes, kind: str, name: str) -> Response:
    headers = {"content-disposition": f'attachment; filename="{name}"'}
    return Response(data, media_type=kind, headers=headers)


def _file_name(name: str) -> str:
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in name)
