"""Live sessions: a scene edited with no bake, traced by a worker process beside us."""

from __future__ import annotations

import atexit
import itertools
import multiprocessing
import shutil
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from burnish.app import worker as w
from burnish.core.errors import BurnishError, SceneError
from burnish.core.types import Crop, Float32, Progress
from burnish.materials.layer import unpainted
from burnish.materials.lights import LightGroup, each, placements, without_lights
from burnish.transport.basis import Basis, State, initial_state
from burnish.transport.frozen import Frozen, FrozenPart
from burnish.transport.lights import base_under
from burnish.transport.rows import Rows

if TYPE_CHECKING:
    from burnish.session import Session

MOST_DEATHS = 3
"""Workers in a row that may end before they have published anything of a selection."""

_POLL_SECONDS = 0.05
PATIENCE_SECONDS = 300.0
"""How long to wait for a worker that compiles or traces before calling it stuck."""


def live_session(source: str | Path | Mapping[str, Any], **options: Any) -> Session:
    """A session on a scene with no bake.

    source: a scene file, a Mitsuba dictionary or an example's name; options as
    `burnish.load` takes them, `series`, and `light_groups` as for a bake. Close it with
    `session.close()`. Raises what loading the scene raises.
    """
    from burnish.session import ObjectInfo, Session

    studio = LiveStudio(source, options)
    opened = studio.opened
    materials = {item.id: item.material for item in opened.basis.objects}
    layers = {name: material.layers for name, material in materials.items()}
    objects = [
        ObjectInfo(name, name in materials, reason, layers.get(name, ()))
        for name, _, reason in opened.objects
    ]
    session = Session(
        studio.views, objects, studio, opened.name, each(opened.lights), light_pictures=studio
    )
    session.denoiser = studio
    session.on_change(lambda: studio.follow(session.state))
    session.on_close(studio.close)
    return session


def settle(session: Session, view: str | None, samples: int, progress: Progress) -> None:
    """Wait until a live view has so many samples per pixel of the session's present look, with
    nothing selected. Raises SceneError in the worker's words."""
    session.select()
    name = view or next(iter(session.views))
    shown = session.views[name]
    assert isinstance(shown, LiveView)
    while not session.ready(name) or shown.samples < samples:
        progress(min(shown.samples / samples, 1.0), f"{shown.samples} of {samples} samples")
        time.sleep(_POLL_SECONDS)
    progress(1.0, f"{shown.samples} samples")


class LiveStudio:
    """Our end of the worker: its views as transports, and its path tracer as the truth.

    A worker that dies is started again and goes on with the current selection; what it had
    published stays on the screen.
    """

    def __init__(self, source: str | Path | Mapping[str, Any], options: Mapping[str, Any]) -> None:
        self._source = str(source) if isinstance(source, Path) else source
        self._options = dict(options)
        shared = Path("/dev/shm")  # a memory file system, where there is one
        self._folder = Path(
            tempfile.mkdtemp(prefix="burnish-", dir=shared if shared.is_dir() else None)
        )
        atexit.register(shutil.rmtree, self._folder, ignore_errors=True)
        self._changed = threading.Condition()
        self._serials = itertools.count(1)
        self._jobs: dict[int, w.Pictured | None] = {}
        self._progress: dict[int, Progress] = {}
        self._request: w.Select | None = None
        self._failure: w.Failed | None = None
        self._closed = False
        self._outbox: deque[object] = deque()
        self._shown: frozenset[str] = frozenset()
        self.restarts = 0
        self._deaths = 0
        self.views: dict[str, LiveView] = {}
        self.opened = self._start()
        for name, width, height in self.opened.views:
            self.views[name] = LiveView(
                self, name, self.opened.basis, width, height, self.opened.rows[name]
            )
            self.views[name].camera = self.opened.cameras[name]

    # -- the process ------------------------------------------------------------------------

    def _start(self) -> w.Opened:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        self._process = context.Process(
            target=w.main,
            args=(theirs, self._source, self._options, str(self._folder)),
            name="burnish-worker",
            daemon=True,
        )
        self._process.start()
        theirs.close()
        self._pipe = ours
        try:
            answer = ours.recv()
        except EOFError:
            raise SceneError(
                "the tracing process ended before the scene was open; run `burnish info` on the "
                "scene to see why"
            ) from None
        if isinstance(answer, w.Failed):
            self.close()
            raise SceneError(answer.text)
        assert isinstance(answer, w.Opened)
        for target in (self._listen, self._post):
            threading.Thread(target=target, args=(ours,), name="burnish-live", daemon=True).start()
        return answer

    def _listen(self, pipe: Connection) -> None:
        while True:
            try:
                message = pipe.recv()
            except (EOFError, OSError):
                break
            with self._changed:
                self._receive(message)
                self._changed.notify_all()
        self._give_up_jobs("the tracing process ended; try again")
        if not self._closed:
            self._restart()

    def _post(self, pipe: Connection) -> None:
        """Send what waits: the worker reads between passes, and nobody may wait for that."""
        while True:
            with self._changed:
                self._changed.wait_for(
                    lambda: self._outbox or self._closed or self._pipe is not pipe
                )
                if self._closed or self._pipe is not pipe:
                    return
                message = self._outbox.popleft()
            try:
                pipe.send(message)
            except OSError:  # the listener sees it too, and starts another worker
                self._give_up_jobs("the tracing process ended; try again")
                return
            except Exception as error:  # noqa: BLE001 - what cannot be pickled raises anything
                self._refuse(message, f"the tracing process cannot be told of it: {error}")

    def _receive(self, message: object) -> None:
        current = self._request.serial if self._request else 0
        if isinstance(message, w.Mapped) and message.serial == current:
            self.views[message.view].map(message)
        elif isinstance(message, w.Published) and message.serial == current:
            self.views[message.view].publish(message)
            self._deaths = 0
        elif isinstance(message, w.Failed) and message.serial == current:
            self._failure = message
        elif isinstance(message, w.Pictured) and message.job in self._jobs:
            self._jobs[message.job] = message
        elif isinstance(message, w.Progressed) and message.job in self._progress:
            self._progress[message.job](message.fraction, message.what)

    def _restart(self) -> None:
        """Bring a dead worker back with the selection that it had."""
        self.restarts += 1
        self._deaths += 1
        try:
            self._start()
        except BurnishError as error:
            with self._changed:
                current = self._request.serial if self._request else 0
                self._failure = w.Failed(str(error), current, lasting=True)
                self._changed.notify_all()
            return
        with self._changed:
            self._send(w.Watch(tuple(sorted(self._shown))))
            waiting = any(isinstance(message, w.Select) for message in self._outbox)
            if self._request is None or waiting:
                return
            if self._deaths < MOST_DEATHS:
                self._send(self._request)
                return
            self._deaths = 0
            text = (
                f"the tracing process ended {MOST_DEATHS} times over this selection, perhaps for "
                "want of memory; select fewer objects or a smaller resolution"
            )
            self._failure = w.Failed(text, self._request.serial)
            self._changed.notify_all()

    def _send(self, message: object) -> None:
        """Queue a message; it replaces a waiting one that it makes pointless."""
        with self._changed:
            if isinstance(message, (w.Select, w.Follow)):
                waiting = [m for m in self._outbox if not isinstance(m, type(message))]
                self._outbox = deque(waiting)
            self._outbox.append(message)
            self._changed.notify_all()

    def _give_up_jobs(self, why: str) -> None:
        with self._changed:
            for job, done in self._jobs.items():
                if done is None:
                    self._jobs[job] = w.Pictured(job, None, why)
            self._changed.notify_all()

    def _refuse(self, message: object, why: str) -> None:
        """Tell who waits for a message's answer that none will come: nothing of it was sent."""
        with self._changed:
            job: Any = getattr(message, "job", None)
            if self._jobs.get(job, ...) is None:
                self._jobs[job] = w.Pictured(job, None, why)
            if isinstance(message, w.Select) and message is self._request:
                self._failure = w.Failed(why, message.serial)
            self._changed.notify_all()

    def close(self) -> None:
        """End the worker and free what it had mapped."""
        self._closed = True
        self._process.terminate()
        self._process.join(timeout=5.0)
        if self._process.is_alive():
            self._process.kill()
        self._give_up_jobs("the session was closed")
        shutil.rmtree(self._folder, ignore_errors=True)

    # -- what a session asks ----------------------------------------------------------------

    def pause(self, paused: bool = True) -> None:
        """Stop refining, or go on."""
        self._send(w.Pause(paused))

    def watch(self, name: str, shown: bool) -> None:
        """Say whether a view is looked at: such views get most of the samples."""
        with self._changed:
            others = self._shown - {name}
            now = others | {name} if shown else others
            if now != self._shown:
                self._shown = now
                self._send(w.Watch(tuple(sorted(now))))

    def follow(self, state: State) -> None:
        """Let the samples to come follow the current look."""
        if self._request is not None and self._request.targets:
            self._send(w.Follow(unpainted(without_lights(state))))

    def select(self, targets: tuple[str, ...], state: State) -> None:
        """Ask for an estimate with these objects symbolic, unless it is the one that runs."""
        placed = placements(self.opened.lights, state)
        state = without_lights(state)
        initial = unpainted(initial_state(self.opened.basis.objects))
        edited = tuple(
            name for name in initial if name not in targets and state[name] != initial[name]
        )
        running = self._request
        if (
            running is not None
            and running.targets == targets
            and running.edited == edited
            and running.placed == placed
            and all(running.state[name] == state[name] for name in edited)
            and all(running.state[name].replacements == state[name].replacements for name in state)
        ):
            return
        for view in self.views.values():
            view.forget()
        if self._failure is not None and not self._failure.lasting:
            self._failure = None
        self._request = w.Select(next(self._serials), targets, dict(state), edited, placed)
        self._send(self._request)

    def wait(self, view: LiveView) -> None:
        """Wait until a view has something to show. Raises BurnishError in the worker's words."""
        with self._changed:
            done = self._changed.wait_for(
                lambda: view.samples > 0 or self._failure is not None, PATIENCE_SECONDS
            )
            self.check()
            if not done:
                raise SceneError("the tracing process does not answer; reopen the scene")

    def check(self) -> None:
        """Raises SceneError in the worker's words when the selection could not be traced."""
        failure = self._failure
        if failure is not None:
            self._request = None
            if not failure.lasting:
                self._failure = None
            raise SceneError(f"tracing failed: {failure.text}")

    @property
    def lock(self) -> threading.Condition:
        """Guards the views against the listener."""
        return self._changed

    def render(
        self,
        state: State,
        view: str,
        spp: int,
        seed: int = 0,
        progress: Progress | None = None,
        crop: Crop | None = None,
    ) -> Float32:
        """The path tracer's picture, made by the worker: float32 [height, width, 3]."""
        asked = dict(state), view, spp, seed, crop
        return self._picture(lambda job: w.Render(job, *asked), progress)

    @property
    def denoiser_missing(self) -> str:
        """Why the worker cannot denoise, or ""."""
        return self.opened.denoiser_missing

    def denoise(self, image: Float32, view: str) -> Float32:
        """A noisy picture of a view, cleaned by the worker: float32 [height, width, 3]."""
        return self._picture(lambda job: w.Denoise(job, view, image), None)

    def light_pictures(
        self, state: State, view: str, groups: Sequence[LightGroup], spp: int, seed: int
    ) -> tuple[Float32, Float32]:
        """What each light group adds to a view, traced by the worker; see `LightPictures`."""
        asked = dict(state), view, tuple(groups), spp, seed
        both = self._picture(lambda job: w.LightUp(job, *asked), None)
        return both[0], both[1]

    def _picture(self, ask: Callable[[int], object], progress: Progress | None) -> Float32:
        """Ask the worker for a picture and wait for it. Raises SceneError in its words."""
        job = next(self._serials)
        with self._changed:
            self._jobs[job] = None
            if progress:
                self._progress[job] = progress
            self._send(ask(job))
            self._changed.wait_for(lambda: self._jobs[job] is not None)
            done = self._jobs.pop(job)
            self._progress.pop(job, None)
        assert done is not None
        if done.image is None:
            raise SceneError(done.error)
        return done.image


class LiveView:
    """A `Transport` whose estimate grows while it is used."""

    traces_the_scene = True
    """What is not selected and as the scene has it is traced with the scene's own BSDF."""
    remodels = True
    """A layer can be given another model: the selection is traced anew."""
    relights = True
    """A light can be put elsewhere: everything is traced anew."""

    def __init__(
        self, studio: LiveStudio, name: str, basis: Basis, width: int, height: int, rows: Rows
    ) -> None:
        self._studio = studio
        self.name, self.basis, self.width, self.height, self.rows = name, basis, width, height, rows
        self.camera: tuple[float, ...] = ()
        """From the world to pixels, [3, 4] row by row; empty for a camera that is not so."""
        self.samples = 0
        """Samples per pixel of what was last published."""
        self.revision = 0
        apart = (len(basis.lights),) if basis.lights else ()
        self._shape = (*apart, height, width, 3)
        self._mapped: w.Mapped | None = None
        self._data: Float32 = np.zeros(2 * int(np.prod(self._shape)), np.float32)

    @property
    def emission(self) -> Float32:
        """Directly seen emission: float32 [height, width, 3], or [lights, height, width, 3]."""
        size = int(np.prod(self._shape))
        return self._data[size : 2 * size].reshape(self._shape)

    @property
    def coarser(self) -> bool:
        """Whether the estimate has fewer bins than the session's, for want of memory."""
        mapped = self._mapped
        return mapped is not None and any(
            ours.bins < theirs.bins
            for mine, item in zip(mapped.basis.objects, self.basis.objects, strict=True)
            for ours, theirs in zip(mine.material.layers, item.material.layers, strict=True)
            if ours.model == theirs.model
        )

    def watch(self, shown: bool) -> None:
        """Say whether the view is looked at."""
        self._studio.watch(self.name, shown)

    def ready(self, targets: tuple[int, ...], state: State) -> bool:
        """Whether `freeze` answers at once; begins what it would wait for.

        Raises SceneError in the worker's words.
        """
        ids = tuple(self.basis.objects[i].id for i in targets)
        with self._studio.lock:
            self._studio.select(ids, state)
            self._studio.check()
            return self.samples > 0

    def freeze(self, targets: tuple[int, ...], state: State, fine: tuple[int, ...] = ()) -> Frozen:
        """The current estimate; waits for the first samples of a new selection."""
        targets = tuple(sorted({*targets, *fine}))
        ids = tuple(self.basis.objects[i].id for i in targets)
        with self._studio.lock:
            self._studio.select(ids, state)
        self._studio.wait(self)
        with self._studio.lock:
            mapped, data = self._mapped, self._data
            assert mapped is not None
            light = data[: int(np.prod(self._shape))].reshape(self._shape)
            base, first = base_under(mapped.basis, mapped.powers, light, state)
            return Frozen(
                basis=mapped.basis,
                targets=targets,
                width=self.width,
                height=self.height,
                base=base,
                powers=mapped.powers,
                parts=[*first, *(_part(part, data) for part in mapped.parts)],
                revision=self.revision,
                in_place=True,
            )

    # -- from the worker, under the lock ------------------------------------------------------

    def forget(self) -> None:
        """A new selection has begun."""
        self.samples = 0
        self._mapped = None

    def map(self, message: w.Mapped) -> None:
        """Map the estimate's file; its name can go, the memory stays as long as it is used."""
        path = Path(message.file)
        self._data = np.memmap(path, np.float32, "r", shape=(message.floats,))
        path.unlink()
        self._mapped = message

    def publish(self, message: w.Published) -> None:
        """There are new numbers in the file."""
        self.samples = message.samples
        self.revision += 1


def _part(part: w.Part, data: Float32) -> FrozenPart:
    size = int(np.prod(part.shape))
    F = data[part.offset : part.offset + size].reshape(part.shape)
    return FrozenPart(part.object, part.indirect, part.pixel, F, part.cos_theta_o, part.slice)
