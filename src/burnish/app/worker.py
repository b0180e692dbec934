"""The process that traces while someone edits: it owns the scene, Mitsuba and the cores' rest.

It runs at the lowest priority, so that frames come first. It takes messages over a pipe,
refines the estimate of the current selection between them, and publishes it into files
mapped by both processes, preferably in memory. Readers need no lock: every row they find,
older or newer, is an unbiased estimate.
"""

from __future__ import annotations

import os
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from burnish.core.errors import BurnishError
from burnish.core.types import Crop, Float32, Value
from burnish.materials.layer import Replacement
from burnish.materials.lights import Light, LightGroup, placements
from burnish.transport.basis import Basis, ColumnSlice, State
from burnish.transport.frozen import Powers
from burnish.transport.rows import Rows

Models = dict[str, dict[str, Replacement]]
Placed = dict[str, dict[str, Value]]
"""Where lights stand that are not as in the scene; see `materials.lights.placements`."""

PUBLISH_SECONDS = 1.0
PUBLISH_SHARE = 0.25
"""A publication is never further off than this share of the time since the selection, as long as
that is less than a second: what is seen first gets better fastest."""
ENOUGH_SAMPLES = 1 << 16
SPECK = 1e-3
"""Size of a lamp that is to hide nothing."""
UNSEEN_SHARE = 16
"""How many times fewer samples a view gets while nobody looks at it."""


@dataclass(frozen=True)
class Opened:
    """The scene is loaded. objects: (id, editable, reason) of all of them; denoiser_missing:
    why nothing can be denoised, or "". cameras: see `scene.views.projection`."""

    name: str
    basis: Basis
    objects: tuple[tuple[str, bool, str], ...]
    views: tuple[tuple[str, int, int], ...]
    rows: dict[str, Rows]
    cameras: dict[str, tuple[float, ...]]
    lights: tuple[Light, ...]
    warnings: tuple[str, ...]
    denoiser_missing: str


@dataclass(frozen=True)
class Select:
    """Make these objects symbolic, under lights that stand as `placed` says. edited: ids that
    are no longer as the scene has them."""

    serial: int
    targets: tuple[str, ...]
    state: State
    edited: tuple[str, ...]
    placed: Placed


@dataclass(frozen=True)
class Follow:
    """Let sampling follow these materials; nothing is lost."""

    state: State


@dataclass(frozen=True)
class Watch:
    """These views are looked at; the others need not be as clean."""

    views: tuple[str, ...]


@dataclass(frozen=True)
class Pause:
    """Stop refining, or go on."""

    paused: bool


@dataclass(frozen=True)
class Render:
    """Path-trace a reference with these materials."""

    job: int
    state: State
    view: str
    spp: int
    seed: int
    crop: Crop | None = None


@dataclass(frozen=True)
class Denoise:
    """Clean a picture of a view."""

    job: int
    view: str
    image: Float32


@dataclass(frozen=True)
class LightUp:
    """Trace what each light group adds to a view with these materials."""

    job: int
    state: State
    view: str
    groups: tuple[LightGroup, ...]
    spp: int
    seed: int


@dataclass(frozen=True)
class Part:
    """Where a part's F lies: an offset into the mapped floats, and its shape."""

    object: int
    indirect: bool
    slice: ColumnSlice
    pixel: np.ndarray
    cos_theta_o: np.ndarray
    offset: int
    shape: tuple[int, int, int]


@dataclass(frozen=True)
class Mapped:
    """A view's estimate has a file. The base image comes first in it, then emission, then F;
    base and emission by light group, where the basis has them.

    basis: the session's with the models and bins that F is counted in.
    """

    serial: int
    view: str
    basis: Basis
    file: str
    floats: int
    parts: tuple[Part, ...]
    powers: Powers


@dataclass(frozen=True)
class Published:
    """A view's file holds an estimate of so many samples per pixel."""

    serial: int
    view: str
    samples: int


@dataclass(frozen=True)
class Pictured:
    """A reference, a cleaned picture or the lights' are done; error says why not."""

    job: int
    image: Float32 | None
    error: str = ""


@dataclass(frozen=True)
class Progressed:
    """How far a reference is."""

    job: int
    fraction: float
    what: str


@dataclass(frozen=True)
class Failed:
    """Something went wrong, in words; `lasting` when the worker can do no more."""

    text: str
    serial: int = 0
    lasting: bool = False


@dataclass(frozen=True)
class _Sent:
    """What was published last of a view: its samples, and when the next may follow, by the
    clock on the wall and by the processors' time."""

    samples: int = 0
    next: float = 0.0
    due: float = 0.0


def main(pipe: Connection, source: Any, options: dict[str, Any], folder: str) -> None:
    """Serve until the pipe closes. source, options: as `burnish.scene.load` takes them."""
    # Ctrl+C reaches us too; the process that we serve decides when we end
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(19)
    try:
        worker = _Worker(pipe, source, options, Path(folder))
    except BurnishError as error:
        pipe.send(Failed(str(error), lasting=True))
        return
    except Exception as error:  # noqa: BLE001 - a process boundary: the other side decides
        text = f"{type(error).__name__}: {error}"
        pipe.send(Failed(f"the scene could not be opened: {text}", lasting=True))
        return
    try:
        worker.serve()
    except (EOFError, BrokenPipeError, KeyboardInterrupt):
        return


class _Worker:
    def __init__(
        self, pipe: Connection, source: Any, options: dict[str, Any], folder: Path
    ) -> None:
        from burnish.precompute.denoise import available
        from burnish.precompute.live import first_rows
        from burnish.precompute.plan import basis_for
        from burnish.scene import load
        from burnish.scene.moving import LightMover
        from burnish.scene.views import projection

        options = dict(options)
        editable, series = options.pop("editable", None), options.pop("series", (64, 1, 1, 1))
        light_groups = options.pop("light_groups", None) or ()
        self.pipe, self.folder = pipe, folder
        self.scene = load(source, editable, **options)
        self.basis = basis_for(self.scene, None, series, light_groups=light_groups)
        self.mover = LightMover(self.scene)
        self.placed: Placed = {}
        self.asked: object = None
        self.estimates: dict[str, Any] = {}
        self.files: dict[str, tuple[Float32, list[Float32]]] = {}
        self.published: dict[str, _Sent] = {}
        self.models: Models = {}
        self.watched: tuple[str, ...] = ()
        self.serial, self.began = 0, 0.0
        self.paused = False
        self.truth: Any = None
        self.denoisers: dict[str, Any] = {}
        self.lights: tuple[Any, Any] | None = None
        scene = self.scene
        pipe.send(
            Opened(
                scene.name,
                self.basis,
                tuple((item.id, item.editable, item.reason) for item in scene.objects),
                tuple((view.name, view.width, view.height) for view in scene.views),
                {view.name: first_rows(scene, view, self.basis) for view in scene.views},
                {view.name: projection(view) for view in scene.views},
                tuple(Light(light.name, light.kind, light.parameters) for light in scene.lights),
                tuple(scene.warnings),
                "" if available() else "Needs Open Image Denoise: pip install pyoidn",
            )
        )

    def serve(self) -> None:
        while True:
            busy = bool(self.estimates) and not self.paused and self._unfinished() is not None
            while self.pipe.poll(0 if busy else None):
                self._take(self.pipe.recv())
                busy = bool(self.estimates) and not self.paused
            try:
                self._refine()
            except (EOFError, BrokenPipeError):
                raise
            except Exception as error:  # noqa: BLE001 - the session must live
                self.estimates = {}
                self.pipe.send(Failed(_words(error), self.serial))

    def _take(self, message: object) -> None:
        if isinstance(message, Select):
            # Only the latest selection counts
            while self.pipe.poll(0):
                later = self.pipe.recv()
                if isinstance(later, Select):
                    message = later
                else:
                    self._take(later)
            try:
                self._select(message)
            except Exception as error:  # noqa: BLE001 - the session must live
                self.estimates = {}
                self.pipe.send(Failed(_words(error), message.serial))
        elif isinstance(message, Follow):
            # One that was sent before a change of model has nothing to say here
            if _models(message.state) == self.models:
                for estimate in self.estimates.values():
                    estimate.follow(message.state)
        elif isinstance(message, Watch):
            self.watched = message.views
        elif isinstance(message, Pause):
            self.paused = message.paused
        elif isinstance(message, Render):
            self._picture(message.job, lambda: self._rendered(message))
        elif isinstance(message, LightUp):
            self._picture(message.job, lambda: self._lit(message))
        elif isinstance(message, Denoise):
            self._picture(message.job, lambda: self._denoised(message))

    def _select(self, message: Select) -> None:
        from burnish.precompute.live import LiveEstimate

        self.serial, self.began = message.serial, time.monotonic()
        self.published, self.files = {}, self._unmapped()
        if message.placed != self.placed:
            # Guides show the lamps where they stood
            self.denoisers = {}
        kept = self.estimates if self.asked == _asked(message, self.scene) else {}
        # Let go of the old tensors first: two selections may not fit
        self.estimates = {}
        scene, basis = _remodelled(self.scene, self.basis, message.state)
        self.models = _models(message.state)
        if not kept:
            # No lamp that moves may hide a row that it uncovers later
            lamps = _moved_lamps(message.placed, self.scene)
            specks = {name: {**message.placed[name], "size": SPECK} for name in lamps}
            self.mover.place(message.placed | specks)
        for view in () if kept else scene.views:
            self.estimates[view.name] = LiveEstimate(
                scene,
                view,
                basis,
                message.targets,
                message.state,
                message.edited,
                seed=message.serial,
            )
        self.mover.place(message.placed)
        self.placed, self.asked = message.placed, _asked(message, self.scene)
        for view, estimate in kept.items():
            estimate.restart(message.state, message.serial)
            self.estimates[view] = estimate
        for view, estimate in self.estimates.items():
            self._map(view, estimate)

    def _unmapped(self) -> dict[str, tuple[Float32, list[Float32]]]:
        """No files, once those of before are let go."""
        for _, mapped in self.files.values():
            mapped.clear()
        return {}

    def _map(self, view: str, estimate: Any) -> None:
        """Make the view's file and say what lies where in it."""
        pixels = estimate.view.width * estimate.view.height
        offset, parts = 6 * pixels * max(len(self.basis.lights), 1), []
        for part in estimate.parts():
            parts.append(
                Part(
                    part.object,
                    part.indirect,
                    part.slice,
                    part.pixel,
                    part.cos_theta_o,
                    offset,
                    part.shape,
                )
            )
            offset += int(np.prod(part.shape))
        number = list(self.estimates).index(view)
        path = self.folder / f"{self.serial}-{number}"
        data = np.memmap(path, np.float32, "w+", shape=(max(offset, 1),))
        arrays = [
            data[part.offset : part.offset + int(np.prod(part.shape))].reshape(part.shape)
            for part in parts
        ]
        self.files[view] = data, arrays
        self.pipe.send(
            Mapped(
                self.serial,
                view,
                estimate.frozen_basis,
                str(path),
                len(data),
                tuple(parts),
                estimate.powers,
            )
        )

    def _unfinished(self) -> str | None:
        """The view with the fewest samples, while there is one to refine.

        Views that nobody looks at have a sixteenth of the others' and come after them.
        """
        left = {
            view: estimate.samples
            for view, estimate in self.estimates.items()
            if estimate.samples < ENOUGH_SAMPLES
        }

        def rank(view: str) -> tuple[int, bool]:
            shown = not self.watched or view in self.watched
            return left[view] * (1 if shown else UNSEEN_SHARE), not shown

        return min(left, key=rank, default=None)

    def _refine(self) -> None:
        import drjit as dr

        view = self._unfinished()
        if view is None or self.paused:
            return
        estimate = self.estimates[view]
        estimate.step()
        # Kernels only queue up by themselves, and a message would wait for the whole queue
        dr.sync_thread()
        sent = self.published.get(view, _Sent())
        # At once while there is little to see, then ever later, at last once a second; the last
        # samples whenever they come, as none follow
        due = time.monotonic() >= sent.next and time.process_time() >= sent.due
        if due or sent.samples < 16 or estimate.samples >= ENOUGH_SAMPLES:
            self._publish(view, estimate)

    def _publish(self, view: str, estimate: Any) -> None:
        data, arrays = self.files[view]
        start = time.process_time()
        fixed, emission = estimate.base()
        data[: fixed.size] = (fixed + emission).ravel()
        data[fixed.size : 2 * fixed.size] = emission.ravel()
        estimate.write(arrays)
        # Publishing may take a tenth of our processors' time at most; the clock on the wall
        # goes on while others have them
        now = time.process_time()
        due = now + 9 * (now - start)
        clock = time.monotonic()
        wait = min(PUBLISH_SECONDS, PUBLISH_SHARE * (clock - self.began))
        self.published[view] = _Sent(estimate.samples, clock + wait, due)
        self.pipe.send(Published(self.serial, view, estimate.samples))

    def _picture(self, job: int, make: Callable[[], Float32]) -> None:
        """Make a picture and send it, or why there is none."""
        try:
            answer = Pictured(job, make())
        except (EOFError, BrokenPipeError):
            raise
        except Exception as error:  # noqa: BLE001 - the session must live
            answer = Pictured(job, None, _words(error))
        self.pipe.send(answer)

    def _rendered(self, message: Render) -> Float32:
        from burnish.reference.truth import PathTracedTruth

        if self.truth is None:
            self.truth = PathTracedTruth(self.scene, self.basis.bounces)

        def progress(fraction: float, what: str) -> None:
            self.pipe.send(Progressed(message.job, fraction, what))

        with self._lights_at({}):
            image: Float32 = self.truth.render(
                message.state, message.view, message.spp, message.seed, progress, message.crop
            )
        return image

    @contextmanager
    def _lights_at(self, placed: Placed) -> Iterator[None]:
        """Others of our tracers want the lights elsewhere for a while."""
        self.mover.place(placed)
        try:
            yield
        finally:
            self.mover.place(self.placed)

    def _lit(self, message: LightUp) -> Float32:
        """Both pictures of `LightTracer`: float32 [2, groups, height, width, 3]."""
        from burnish.precompute.light_pictures import LightTracer

        asked = message.view, message.state, message.groups
        if self.lights is None or self.lights[0] != asked:
            scene, basis = _remodelled(self.scene, self.basis, message.state)
            tracer = LightTracer(
                scene, scene.view(message.view), basis, message.state, message.groups
            )
            self.lights = asked, tracer
        with self._lights_at(placements(self.scene.lights, message.state)):
            image: Float32 = np.stack(self.lights[1].pictures(message.spp, message.seed))
        return image

    def _denoised(self, message: Denoise) -> Float32:
        from burnish.precompute.denoise import Denoiser

        if message.view not in self.denoisers:
            self.denoisers[message.view] = Denoiser.of(self.scene, self.scene.view(message.view))
        image: Float32 = self.denoisers[message.view].clean(message.image)
        return image


def _asked(message: Select, scene: Any) -> object:
    """What an estimate has to be made anew for; where the lights stand only begins it again."""
    edited = {name: message.state[name] for name in message.edited}
    lamps = _moved_lamps(message.placed, scene)
    return message.targets, edited, _models(message.state), lamps


def _moved_lamps(placed: Placed, scene: Any) -> frozenset[str]:
    """The lights with a surface, which can hide something, that are not as in the scene."""
    return frozenset(light.name for light in scene.lights if light.shapes and light.name in placed)


def _models(state: State) -> Models:
    """The models that a state has put in place of the scene's, by object and layer."""
    return {name: item.replacements for name, item in state.items() if item.replacements}


def _remodelled(scene: Any, basis: Basis, state: State) -> tuple[Any, Basis]:
    """Scene and basis with the models that a state has put in place of the scene's own."""
    if not any(item.replacements for item in state.values()):
        return scene, basis
    edited = tuple(
        replace(item, material=item.material.as_in(state[item.id])) for item in basis.objects
    )
    given = {item.id: item.material for item in edited if state[item.id].replacements}
    objects = tuple(
        replace(item, material=given[item.id], factory=None) if item.id in given else item
        for item in scene.objects
    )
    return replace(scene, objects=objects), replace(basis, objects=edited)


def _words(error: Exception) -> str:
    """An error as a sentence; with the place where it arose when it is none of ours."""
    # Dr.Jit's loops say only that something went wrong inside
    while not isinstance(error, BurnishError) and isinstance(error.__cause__, Exception):
        error = error.__cause__
    if isinstance(error, BurnishError):
        return str(error)
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})"
