"""The thread that owns the session: it takes the pages' messages and makes frames.

One round: carry out everything that has arrived (a parameter that was dragged through
twenty values since the last round is set once, to the last), then compute each changed view
that some page is ready to show. Plots, autosave, denoising and error metrics wait for a pause.
A live view that has no samples yet is asked again; the last picture stays until it has.
"""

from __future__ import annotations

import logging
import os
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, TypeVar

from burnish.app import messages as m
from burnish.app.server import describe
from burnish.app.server.frames import Frame, Kind, halves
from burnish.app.server.mailbox import Mailbox
from burnish.app.server.plots import Plots, Subject
from burnish.app.server.resting import ENOUGH_SAMPLES, Cleaned, NoiseMeter, Resting, samples_of
from burnish.app.server.snapshots import Snapshots
from burnish.app.server.tracing import Tracing
from burnish.core.errors import BurnishError, InvalidValue, UnknownName
from burnish.core.types import Float32
from burnish.session import Session

log = logging.getLogger("burnish.editor")

T = TypeVar("T")
_QUEUE = 2000
_POLL_SECONDS = 0.05
_REST_SECONDS = 0.15
_AUTOSAVE_SECONDS = 1.0


class Engine:
    """Drives one session for any number of pages. Public methods are thread-safe."""

    def __init__(self, session: Session, autosave: Path | None = None) -> None:
        self.session = session
        self.autosave = autosave
        self.run = uuid.uuid4().hex
        self.views = tuple(session.views)
        self.snapshots = Snapshots()
        self.tracing = Tracing(session, self._reference_changed)
        self.resting = Resting(session, lambda done: self._cleaned(done))
        self._resting_frames: dict[str, Frame] = {}
        self._meters = {name: NoiseMeter() for name in self.views}
        self._waiting: set[str] = set()
        self._plots = Plots(self._to_all)
        self._boxes: list[Mailbox] = []
        self._queue: deque[tuple[Mailbox | None, Any]] = deque()
        self._changed = threading.Condition()
        self._stop = False
        self._thread = threading.Thread(target=self._loop, name="burnish-engine", daemon=True)
        self._gesture: tuple[Mailbox, AbstractContextManager[Any]] | None = None
        self._objects = tuple(
            describe.scene_object(info, self._material(info.id)) for info in session.objects
        )
        self._order = {item.id: i + 1 for i, item in enumerate(self._objects)}
        self._known: dict[str, Any] = {}
        self._values: dict[str, m.ObjectValues] = {}
        self._stamps: dict[str, int] = {}
        self._stamp = 0
        self._frame_number = 0
        self._frame_keys: dict[str, object] = {}
        self._frames: dict[str, Frame] = {}
        self._object_frames: dict[str, tuple[int, Frame]] = {}
        self._frame_times: deque[float] = deque(maxlen=60)
        self._theta_i = 45.0
        self._state_key: object = None
        self._plot_key: object = None
        self._curves_key: object = None
        self._saved_revision = session.revision
        self._autosaved_revision = session.revision
        self._last_edit = 0.0
        self._recoverable = _left_behind(autosave)
        self._progress: m.Progress | None = None

    # -- for the connections ----------------------------------------------------------------

    def start(self) -> None:
        """Begin."""
        self._plots.start()
        self._thread.start()

    def close(self) -> None:
        """Stop after the round in progress, with the edits autosaved."""
        self.tracing.cancel()
        with self._changed:
            self._stop = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)
        self._plots.close()

    def attach(self, box: Mailbox) -> None:
        """A page has come: send it everything."""
        self.call(lambda: self._welcome(box))

    def detach(self, box: Mailbox) -> None:
        """A page has gone."""
        self.call(lambda: self._farewell(box))

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

    # -- the rounds -------------------------------------------------------------------------

    def _loop(self) -> None:
        while True:
            with self._changed:
                if not self._queue and not self._stop and not self._wanted():
                    self._changed.wait(_POLL_SECONDS)
                batch = list(self._queue)
                self._queue.clear()
                stop = self._stop
            for box, item in batch:
                self._carry_out(box, item)
            self._publish_state()
            self._publish_frames()
            self._publish_curves()
            if stop:
                self._save_automatically()
                return
            self._at_rest()

    def _carry_out(self, box: Mailbox | None, item: Any) -> None:
        if box is None:
            item()
            return
        before = self.session.revision
        try:
            self._handle(box, item)
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
            self._last_edit = time.monotonic()

    def _handle(self, box: Mailbox, item: m.ClientMessage) -> None:
        session = self.session
        match item:
            case m.Select(objects=objects):
                session.select(*objects)
            case m.Gesture(active=active):
                self._gesture_to(box if active else None)
            case m.SetValue(path=path, value=value):
                session.set(path, value)
            case m.SetCurve(layer=layer, curve=curve):
                session.set_curve(layer, None if curve is None else describe.curve_from(curve))
            case m.SetEnabled(layer=layer, enabled=enabled):
                session.set_enabled(layer, enabled)
            case m.SetWeight(layer=layer, weight=weight):
                session.set_weight(layer, weight)
            case m.Solo(layer=layer):
                self._solo(layer)
            case m.Reset(path=path):
                session.reset(path)
            case m.Undo():
                session.undo()
            case m.Redo():
                session.redo()
            case m.GoTo(position=position):
                self._go_to(position)
            case m.TakeSnapshot(label=label, view=view, thumbnail=thumbnail):
                self.snapshots.take(session, label, view, thumbnail)
                self._to_all(self.snapshots.message())
            case m.RestoreSnapshot(snapshot=number):
                self.snapshots.restore(session, number)
            case m.ForgetSnapshot(snapshot=number):
                self.snapshots.forget(number)
                self._to_all(self.snapshots.message())
            case m.CompareSnapshot(snapshot=number):
                view, pixels = self.snapshots.picture(number)
                box.put_frame(self._new_frame(Kind.COMPARISON, view, pixels))
            case m.PathTrace(view=view, spp=spp):
                self._view_index(view)
                self.tracing.begin(view, spp)
            case m.CancelPathTrace():
                self.tracing.cancel()
            case m.LoadEdits(text=text):
                self.load_text(text)
            case m.Recover(accept=accept):
                self._recover(accept)
            case m.Inspect(theta_i=theta_i):
                if not 0.0 <= theta_i <= 89.0:
                    raise InvalidValue(f"theta_i must lie in [0, 89] degrees; got {theta_i:g}")
                self._theta_i = theta_i
            case m.Denoise(active=active):
                self.resting.wanted = active
                self.resting.forget()
            case _:
                raise InvalidValue(f"{type(item).__name__} cannot be sent twice")

    def _gesture_to(self, box: Mailbox | None) -> None:
        if self._gesture is not None:
            _, context = self._gesture
            self._gesture = None
            context.__exit__(None, None, None)
        if box is not None:
            context = self.session.gesture()
            context.__enter__()
            self._gesture = box, context

    def _solo(self, path: str) -> None:
        object_id, _, name = path.rpartition(".")
        if object_id not in self.session.state:
            raise UnknownName("object", object_id, self.session.state)
        layers = self.session.state[object_id].layers
        if name not in layers:
            raise UnknownName("layer", name, layers)
        alone = all(state.enabled == (other == name) for other, state in layers.items())
        with self.session.gesture():
            for other in layers:
                self.session.set_enabled(f"{object_id}.{other}", alone or other == name)

    def _go_to(self, position: int) -> None:
        labels, now = self.session.history
        if not 0 <= position <= len(labels):
            raise InvalidValue(f"position must lie in [0, {len(labels)}]; got {position}")
        for _ in range(now - position):
            self.session.undo()
        for _ in range(position - now):
            self.session.redo()

    # -- pages come and go ------------------------------------------------------------------

    def _welcome(self, box: Mailbox) -> None:
        from burnish.runtime import tonemap

        self._boxes.append(box)
        box.put(
            m.Welcome(
                version=m.VERSION,
                session=self.session.name,
                run=self.run,
                objects=self._objects,
                views=tuple(describe.view(name, self.session.views[name]) for name in self.views),
                path_tracer=self.tracing.unavailable,
                denoiser=self.resting.unavailable,
                tone_mappings=tuple(tonemap.OPERATORS),
            )
        )
        box.put(self.snapshots.message())
        box.put(self.tracing.message(self.session.revision))
        if self._progress is not None:
            box.put(self._progress)
        if self._recoverable is not None:
            box.put(m.Notice("info", "Edits from an earlier run were found.", offer="recover"))
        self._state_key = None
        self._plot_key = self._curves_key = None
        for name, (_, frame) in self._object_frames.items():
            if box.watches(self._view_index(name)):
                box.put_frame(frame)
        for frame in (*self._frames.values(), *self._resting_frames.values()):
            if box.watches(frame.view):
                box.put_frame(frame)
        reference = self.tracing.image
        if reference is not None:
            view, image = reference
            box.put_frame(self._new_frame(Kind.COMPARISON, view, image))

    def _farewell(self, box: Mailbox) -> None:
        if box in self._boxes:
            self._boxes.remove(box)
        if self._gesture is not None and self._gesture[0] is box:
            self._gesture_to(None)

    def _to_all(self, message: m.ServerMessage) -> None:
        for box in list(self._boxes):
            box.put(message)

    # -- what goes out ----------------------------------------------------------------------

    def _publish_state(self) -> None:
        labels, position = self.session.history
        saved = self.session.revision == self._saved_revision
        key = (self.session.revision, tuple(self.session.selected), position, len(labels), saved)
        if key == self._state_key:
            return
        for name, state in self.session.state.items():
            if self._known.get(name) is not state:
                self._known[name] = state
                material = self._material(name)
                assert material is not None
                self._stamp += 1
                self._values[name] = describe.values(material, state)
                self._stamps[name] = self._stamp
        message = m.State(
            revision=self.session.revision,
            selected=tuple(self.session.selected),
            materials=dict(self._values),
            history=tuple(labels),
            position=position,
            warnings=tuple(self.session.warnings()),
            saved=saved,
        )
        stamps = dict(self._stamps)
        for box in list(self._boxes):
            box.put_state(message, stamps)
        if self.tracing.image is not None:
            self._to_all(self.tracing.message(self.session.revision))
        self._state_key = key

    def _look_key(self) -> tuple[int, tuple[str, ...]]:
        """What a live picture is of; a bundle's does not depend on the selection."""
        return self.session.revision, tuple(self.session.selected)

    def _frame_key(self, view: str) -> object:
        transport = self.session.views[view]
        look = self._look_key() if samples_of(transport) >= 0 else self.session.revision
        return look, transport.revision

    def _wanted(self) -> bool:
        """Whether some page waits for a view that has changed and can be shown."""
        return any(
            view not in self._waiting and self._due(i, view) for i, view in enumerate(self.views)
        )

    def _due(self, index: int, view: str) -> bool:
        return self._frame_keys.get(view) != self._frame_key(view) and any(
            box.wants(index) for box in list(self._boxes)
        )

    def _publish_frames(self) -> None:
        for index, view in enumerate(self.views):
            self._waiting.discard(view)
            if not self._due(index, view):
                continue
            key = self._frame_key(view)
            try:
                if not self.session.ready(view):
                    self._waiting.add(view)
                    continue
                self._frame_keys[view] = key
                image = self.session.frame(view)
                self._measure(view, image)
                frame = self._new_frame(Kind.PICTURE, view, image)
                self._publish_objects(index, view)
            except Exception as error:
                self._frame_keys[view] = key
                log.exception("view %s failed", view)
                words = str(error) if isinstance(error, BurnishError) else repr(error)
                self._to_all(
                    m.Notice(
                        "error",
                        f"The picture could not be computed: {words} "
                        "It is tried again after the next edit; undo brings back the last look.",
                    )
                )
                continue
            self._frames[view] = frame
            self._frame_times.append(time.monotonic())
            for box in list(self._boxes):
                if box.watches(index):
                    box.put_frame(frame)

    def _publish_objects(self, index: int, view: str) -> None:
        """The object under each pixel, once per view or when its rows have changed."""
        count = len(self.session.views[view].rows)
        known = self._object_frames.get(view)
        if known is None or known[0] != count:
            numbers = describe.object_numbers(self.session, view, self._order)
            known = count, self._new_frame(Kind.OBJECTS, view, numbers)
            self._object_frames[view] = known
            for box in list(self._boxes):
                if box.watches(index):
                    box.put_frame(known[1])

    def show_objects(self, box: Mailbox) -> None:
        """Send a page that has begun to watch a view what it already can have."""

        def job() -> None:
            for view, frame in self._frames.items():
                if box.watches(frame.view):
                    box.put_frame(self._object_frames[view][1])
                    box.put_frame(frame)
                    if view in self._resting_frames:
                        box.put_frame(self._resting_frames[view])

        self.call(job)

    def _new_frame(self, kind: Kind, view: str, pixels: Any) -> Frame:
        self._frame_number += 1
        return Frame(
            kind=kind,
            view=self._view_index(view),
            number=self._frame_number,
            revision=self.session.revision,
            pixels=pixels if kind == Kind.OBJECTS or pixels.dtype == "uint16" else halves(pixels),
        )

    def _frame_of(self, view: str) -> tuple[str, Float32]:
        self._view_index(view)
        return view, self.session.frame(view)

    def finished_picture(self, view: str) -> Float32 | None:
        """The picture of a view, not denoised; None while a new selection is being traced."""
        self._view_index(view)
        return self.session.frame(view) if self.session.ready(view) else None

    # -- in a pause -------------------------------------------------------------------------

    def _at_rest(self) -> None:
        self._publish_progress()
        now = time.monotonic()
        if self._queue or now - self._last_edit < _REST_SECONDS:
            return
        self._draw_plots()
        self._rest(now)
        self._compare()
        if now - self._last_edit > _AUTOSAVE_SECONDS:
            self._save_automatically()

    def _compare(self) -> None:
        """Hold the picture against the reference, again when a live one has doubled."""
        view = self.tracing.compared_view
        if view is not None and self.session.ready(view):
            doublings = samples_of(self.session.views[view]).bit_length()
            self.tracing.compare_at_rest(self.session.revision, doublings, self._frame_of)

    def _rest(self, now: float) -> None:
        """Have noisy pictures of the present look cleaned."""
        if not self.resting.active:
            return
        for index, view in enumerate(self.views):
            transport = self.session.views[view]
            key, revision = self._look_key(), transport.revision
            if (
                0 < samples_of(transport) < ENOUGH_SAMPLES
                and any(box.watches(index) for box in self._boxes)
                and self.resting.due(view, key, revision, now)
                and self.session.ready(view)
            ):
                self.resting.begin(view, key, revision, self.session.frame(view), now)

    def _cleaned(self, done: Cleaned | str) -> None:
        """A cleaned picture is there, or why there is none; from the denoiser's thread."""

        def job() -> None:
            if isinstance(done, str):
                if self.resting.unavailable:
                    self._to_all(m.Notice("warning", f"Pictures cannot be denoised: {done}"))
            elif done.key == self._look_key():
                frame = self._new_frame(Kind.RESTING, done.view, done.image)
                self._resting_frames[done.view] = frame
                for box in list(self._boxes):
                    if box.watches(frame.view):
                        box.put_frame(frame)

        self.call(job)

    def _measure(self, view: str, image: Float32) -> None:
        """Keep the estimate of a live view's noise."""
        transport, meter = self.session.views[view], self._meters[view]
        if (samples := samples_of(transport)) < 0:
            return
        if time.monotonic() - self._last_edit < _REST_SECONDS:
            meter.edited(self._look_key())
        else:
            meter.take(self._look_key(), samples, image, transport.emission)

    def _publish_curves(self) -> None:
        """The selected object's curves as they are now; cheap enough for every round."""
        selected = tuple(self.session.selected)
        key = self.session.revision, selected
        if key == self._curves_key or not self._boxes:
            return
        self._curves_key = key
        material = self._material(selected[0]) if selected else None
        if material is not None:
            state = self.session.state[selected[0]]
            self._to_all(m.Curves(selected[0], describe.curves(material, state)))

    def _draw_plots(self) -> None:
        selected = tuple(self.session.selected)
        key = self.session.revision, selected, self._theta_i
        if key == self._plot_key or not self._boxes:
            return
        self._plot_key = key
        material = self._material(selected[0]) if selected else None
        if material is not None:
            state = self.session.state[selected[0]]
            self._plots.draw(Subject(selected[0], material, state, self._theta_i))

    def _publish_progress(self) -> None:
        times = self._frame_times
        recent = [t for t in times if time.monotonic() - t < 1.0]
        rate = (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 2 else 0.0
        # A bundle is as good as it will get; a live view counts its samples.
        watched = [v for i, v in enumerate(self.views) if any(b.watches(i) for b in self._boxes)]
        view = min(watched or self.views[:1], key=lambda name: samples_of(self.session.views[name]))
        samples = samples_of(self.session.views[view])
        noise = self._meters[view].noise(samples)
        message = m.Progress(
            text=_progress_text(samples, view in self._waiting),
            fraction=1.0 if samples < 0 else -1.0,
            frames_per_second=round(rate, 1),
            samples=samples,
            noise=float(f"{noise:.2g}"),
            denoise=self.resting.active,
            resting=self.resting.active and 0 <= samples < ENOUGH_SAMPLES,
        )
        if message != self._progress:
            self._progress = message
            self._to_all(message)

    # -- files --------------------------------------------------------------------------------

    def edits_text(self) -> str:
        """The edits as their file's text; counts as saved."""
        text = self.session.edits_text()
        self._saved_revision = self.session.revision
        return text

    def load_text(self, text: str) -> None:
        """Replace the edits by a file's. Raises BurnishError and changes nothing when bad."""
        self.session.load_text(text)

    def _save_automatically(self) -> None:
        if self.autosave is None or self.session.revision == self._autosaved_revision:
            return
        self._autosaved_revision = self.session.revision
        try:
            if not any(values.changed for values in self._values.values()):
                self.autosave.unlink(missing_ok=True)
                return
            self.autosave.parent.mkdir(parents=True, exist_ok=True)
            partial = self.autosave.with_suffix(".partial")
            partial.write_text(self.session.edits_text(), "utf-8")
            os.replace(partial, self.autosave)
        except OSError as error:
            self._to_all(m.Notice("warning", f"The edits could not be autosaved: {error}"))

    def _recover(self, accept: bool) -> None:
        text, self._recoverable = self._recoverable, None
        if accept and text is not None:
            self.load_text(text)

    # -- small things -------------------------------------------------------------------------

    def _reference_changed(self, picture: tuple[str, Float32] | None) -> None:
        """The path tracer has something new; called from its thread."""

        def job() -> None:
            self._to_all(self.tracing.message(self.session.revision))
            if picture is not None:
                view, image = picture
                frame = self._new_frame(Kind.COMPARISON, view, image)
                for box in list(self._boxes):
                    box.put_frame(frame)

        self.call(job)

    def _material(self, name: str) -> Any:
        return self.session.material(name)

    def _view_index(self, view: str) -> int:
        if view not in self.views:
            raise UnknownName("view", view, self.views)
        return self.views.index(view)


def _left_behind(autosave: Path | None) -> str | None:
    """The text of an earlier run's autosaved edits, if there are any."""
    if autosave is None:
        return None
    try:
        return autosave.read_text("utf-8")
    except (OSError, UnicodeDecodeError):
        return None


def _progress_text(samples: int, waiting: bool) -> str:
    if samples < 0:
        return ""
    if waiting or samples == 0:
        return "tracing the selection …"
    words = f"{samples} sample{'' if samples == 1 else 's'}"
    return f"tracing … {words}" if samples < ENOUGH_SAMPLES else words


def _slot(item: object) -> tuple[object, ...] | None:
    """Messages of equal slot replace one another; None lets nothing pass it."""
    match item:
        case m.SetValue(path=path):
            return "value", path
        case m.SetCurve(layer=layer):
            return "curve", layer
        case m.SetWeight(layer=layer):
            return "weight", layer
        case m.Inspect():
            return ("inspect",)
    return None
