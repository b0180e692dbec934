"""The editor's server: `serve` for the command line, `EditorServer` for everything else."""

from __future__ import annotations

import ipaddress
import os
import platform
import secrets
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import Self

import uvicorn

from burnish.app.messages import MAXIMUM_MESSAGE_BYTES
from burnish.app.server.application import build
from burnish.app.server.engine import Engine
from burnish.core.errors import DeviceError, InvalidValue
from burnish.session import Session

HOST_WARNING = (
    "Serving on {host}: whoever can reach this machine and has the address with its token "
    "can see the scene, change the edits and save pictures. The connection is not encrypted; "
    "on a network that is not yours, keep to 127.0.0.1 and use an SSH tunnel."
)
"""What `--host` means; shown when it is not a loopback address."""


def serve(
    session: Session,
    host: str = "127.0.0.1",
    port: int = 0,
    open_browser: bool = True,
    *,
    autosave: Path | None = None,
    announce: Callable[[str], None] | None = None,
) -> None:
    """Open the editor on a session and stay until Ctrl+C.

    port 0 takes a free one. autosave: where edits are kept; by default a file in the user's
    state folder, named after the session. announce: gets the lines that the user should see.
    Raises DeviceError when the port is taken, InvalidValue for a bad host or port.
    """
    say = announce or _write_line
    place = default_autosave(session.name) if autosave is None else autosave
    with EditorServer(session, host, port, autosave=place) as server:
        # Whoever has read the address may press Ctrl+C before the next line runs
        try:
            if not is_loopback(host):
                say(HOST_WARNING.format(host=host))
            say(f"The editor is at {server.url}")
            say("Press Ctrl+C to close it.")
            if open_browser and has_display():
                webbrowser.open(server.url)
            server.wait()
        except KeyboardInterrupt:
            say("Closing; the edits are autosaved.")


class EditorServer:
    """A running editor: `url` is its address. Closing it frees the port."""

    def __init__(
        self,
        session: Session,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        autosave: Path | None = None,
    ) -> None:
        if not 0 <= port <= 65535:
            raise InvalidValue(f"port must lie in [0, 65535]; got {port}")
        self.token = secrets.token_urlsafe(24)
        self.engine = Engine(session, autosave)
        hosts = frozenset({"127.0.0.1", "localhost", "::1", host}) if is_loopback(host) else None
        application = build(self.engine, self.token, hosts)
        self._socket = _bind(host, port)
        self.host, self.port = host, int(self._socket.getsockname()[1])
        config = uvicorn.Config(
            application,
            log_level="warning",
            access_log=False,
            lifespan="off",
            ws="websockets-sansio",
            ws_max_size=MAXIMUM_MESSAGE_BYTES,
            ws_per_message_deflate=False,
            ws_ping_interval=20.0,
            ws_ping_timeout=20.0,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        # Not the thread is waited for: a join that Ctrl+C interrupts may take it for ended
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="burnish-web", daemon=True)

    @property
    def url(self) -> str:
        """The page's address, with this run's token."""
        name = "127.0.0.1" if self.host in ("0.0.0.0", "") else self.host
        if ":" in name:
            name = f"[{'::1' if name == '::' else name}]"
        return f"http://{name}:{self.port}/{self.token}/"

    def start(self) -> Self:
        """Begin to serve; returns once the port answers."""
        self.engine.start()
        self._thread.start()
        while not self._server.started:
            if self._ended.is_set():
                raise DeviceError(f"the server on {self.host}:{self.port} did not start")
            time.sleep(0.01)
        return self

    def wait(self) -> None:
        """Stay until the server ends or Ctrl+C is pressed."""
        while not self._ended.wait(0.5):
            pass

    def _run(self) -> None:
        try:
            self._server.run([self._socket])
        finally:
            self._ended.set()

    def close(self) -> None:
        """Close all pages' connections, autosave and free the port."""
        self._server.should_exit = True
        if self._thread.ident is not None:
            self._ended.wait(10.0)
        self.engine.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the host."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def has_display() -> bool:
    """Whether a browser could open here."""
    if platform.system() == "Linux":
        return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return True


def default_autosave(name: str) -> Path:
    """Where the edits of a session of that name are kept between runs."""
    base = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    digest = sha256(f"{Path.cwd()}:{name}".encode()).hexdigest()[:12]
    return Path(base) / "burnish" / f"autosave-{digest}.json"


def _bind(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        result = socket.socket(family, kind, protocol)
    except OSError as error:
        raise InvalidValue(f"host {host!r} is not an address of this machine: {error}") from None
    try:
        result.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        result.bind(address)
    except OSError as error:
        result.close()
        raise DeviceError(
            f"port {port} on {host} cannot be used: {error.strerror}; "
            "choose another with --port, or leave it out for a free one"
        ) from None
    return result


def _write_line(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
