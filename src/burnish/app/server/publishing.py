"""What goes out to the pages: the state, the pictures, the curves and the progress.

Each part goes out when what it shows has changed. Pictures go out when a page can take one;
curves and progress less often than pictures, since the page draws them on the same cores.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from typing import Any

from burnish.app import messages as m
from burnish.app.server import describe
from burnish.app.server.autosave import Autosave
from burnish.app.server.frames import Frame, Kind
from burnish.app.server.lights import lights as describe_lights
from burnish.app.server.mailbox import Mailbox
from burnish.app.server.pages import Pages
from burnish.app.server.plots import Plots, Subject
from burnish.app.server.resting import ENOUGH_SAMPLES, Cleaned, NoiseMeter, Resting, samples_of
from burnish.app.server.tracing import Tracing
from burnish.core.errors import BurnishError, InvalidValue
from burnish.core.types import Float32
from burnish.materials.layer import Replacement
from burnish.session import Session
from burnish.transport.frozen import Transport

log = logging.getLogger("burnish.editor")

REST_SECONDS = 0.15
"""So long after an edit what is slow begins: plots, denoising, comparing."""
LIGHTS_AFTER = 64
"""Samples per pixel of a live view after which its lights are traced, unless they are mixed
before."""
_CURVE_SECONDS = 0.1
_PROGRESS_SECONDS = 0.25


class Publishing:
    """Knows what each page has and sends what is new. Used from the engine's thread alone."""

    def __init__(
        self,
        session: Session,
        pages: Pages,
        resting: Resting,
        tracing: Tracing,
        autosave: Autosave,
        run: str,
    ) -> None:
        """run: tells this server from one before it."""
        self._session, self._pages, self._run = session, pages, run
        self._resting, self._tracing, self._autosave = resting, tracing, autosave
        self.plots = Plots(pages.to_all)
        self._owns = {info.id: session.own_material(info.id) for info in session.objects}
        self.objects = tuple(
            describe.scene_object(info, self._owns[info.id]) for info in session.objects
        )
        self._order = {item.id: i + 1 for i, item in enumerate(self.objects)}
        self._known: dict[str, Any] = {}
        self._values: dict[str, m.ObjectValues] = {}
        self._layers: dict[str, tuple[dict[str, Replacement], tuple[m.LayerInfo, ...]]] = {}
        self._stamps: dict[str, int] = {}
        self._stamp = 0
        self._frame_keys: dict[str, object] = {}
        self._frames: dict[str, Frame] = {}
        self._object_frames: dict[str, tuple[int, Frame]] = {}
        self._resting_frames: dict[str, Frame] = {}
        self._meters = {name: NoiseMeter() for name in pages.views}
        self._waiting: set[str] = set()
        self._drafted: dict[str, bool] = {}
        """The views whose last picture is a draft, and whether that was exact to rounding."""
        self._prepared: dict[str, object] = {}
        self._frame_times: deque[float] = deque(maxlen=120)
        self._theta_i = 45.0
        self._state_key: object = None
        self._lights: m.Lights | None = None
        self._plot_key: object = None
        self._curves_key: object = None
        self._curves_due = self._progress_due = 0.0
        # Pictures do not wait for a better mix
        session.light_mix.background = True
        self._progress: m.Progress | None = None
        self.last_edit = 0.0

    @property
    def at_rest(self) -> bool:
        """Whether nothing has been edited for a moment."""
        return time.monotonic() - self.last_edit >= REST_SECONDS

    @property
    def changed(self) -> bool:
        """Whether any material or light differs from the scene's own, as last published."""
        lights = self._lights.items if self._lights else ()
        edited = any(values.changed for values in self._values.values())
        return edited or any(light.changed for light in lights)

    @property
    def waits(self) -> bool:
        """Whether a view is asked for that has nothing to show yet."""
        return bool(self._waiting)

    def welcome(self, box: Mailbox) -> None:
        """Everything that a new page needs."""
        from burnish.runtime import tonemap

        views = self._session.views
        box.put(
            m.Welcome(
                version=m.VERSION,
                session=self._session.name,
                run=self._run,
                objects=self.objects,
                views=tuple(describe.view(name, views[name]) for name in self._pages.views),
                path_tracer=self._tracing.unavailable,
                denoiser=self._resting.unavailable,
                tone_mappings=tuple(tonemap.OPERATORS),
                models=describe.models(),
                models_fixed=self._session.models_fixed,
                metals=describe.metals(),
            )
        )
        box.put(self._tracing.message(self._session.revision))
        # Before any picture: it says whether pictures at rest are denoised
        box.put(self._progress or self._present_progress(time.monotonic()))
        self._state_key = self._plot_key = self._curves_key = self._lights = None
        for index, view in enumerate(self._pages.views):
            if box.watches(index):
                self._show_all(box, view)
        reference = self._tracing.image
        if reference is not None:
            box.put_frame(self._pages.frame(Kind.COMPARISON, *reference))

    def watched(self, box: Mailbox) -> None:
        """A page has begun to show other views: send it what there is of them."""
        self.tell_transports()
        for index, view in enumerate(self._pages.views):
            if box.watches(index):
                self._show_all(box, view)

    def tell_transports(self) -> None:
        """Live views that are looked at get most of the samples."""
        for index, view in enumerate(self._pages.views):
            watch = getattr(self._session.views[view], "watch", None)
            if watch is not None:
                watch(self._pages.watch(index))

    def _show_all(self, box: Mailbox, view: str) -> None:
        if view in self._object_frames:
            box.put_frame(self._object_frames[view][1])
        for frames in (self._frames, self._resting_frames):
            if view in frames:
                box.put_frame(frames[view])

    # -- the state --------------------------------------------------------------------------

    def state(self) -> None:
        """What is set, selected and saved."""
        session = self._session
        labels, position = session.history
        selected = tuple(session.selected)
        key = session.revision, selected, position, len(labels), self._autosave.saved
        if key == self._state_key:
            return
        for item in self.objects:
            if item.layers:
                self._renew(item.id)
        message = m.State(
            revision=session.revision,
            selected=selected,
            materials=dict(self._values),
            layers={name: layers for name, (_, layers) in self._layers.items()},
            history=tuple(labels),
            position=position,
            warnings=tuple(session.warnings()),
            saved=self._autosave.saved,
        )
        stamps = dict(self._stamps)
        for box in list(self._pages.boxes):
            box.put_state(message, stamps)
        if self._tracing.image is not None:
            self._pages.to_all(self._tracing.message(session.revision))
        self._state_key = key

    def lights(self) -> None:
        """What is set on the lights, and how exact their mix is."""
        views = self._pages.views
        shown = [view for i, view in enumerate(views) if self._pages.watch(i)] or views[:1]
        message = describe_lights(self._session, shown[0])
        if message != self._lights:
            self._lights = message
            self._pages.to_all(message)

    def _renew(self, name: str) -> None:
        """Describe an object's material anew if it has changed."""
        state = self._session.state[name]
        if self._known.get(name) is state:
            return
        self._known[name] = state
        material = self._session.material(name)
        assert material is not None
        self._stamp += 1
        self._values[name] = describe.values(material, state)
        self._stamps[name] = self._stamp
        other = state.replacements
        if not other:
            self._layers.pop(name, None)
        elif name not in self._layers or self._layers[name][0] != other:
            own = self._owns[name]
            self._layers[name] = other, describe.layers(material, own)

    # -- pictures ---------------------------------------------------------------------------

    def _look_key(self) -> tuple[int, tuple[str, ...]]:
        """What a live picture is of; a bundle's does not depend on the selection."""
        return self._session.revision, tuple(self._session.selected)

    def _frame_key(self, view: str) -> object:
        transport = self._session.views[view]
        look = self._look_key() if samples_of(transport) >= 0 else self._session.revision
        return look, transport.revision, self._session.light_mix.revision

    def wanted(self) -> bool:
        """Whether some page waits for a view that has changed and can be shown."""
        return any(
            view not in self._waiting and self._due(i, view)
            for i, view in enumerate(self._pages.views)
        )

    def _due(self, index: int, view: str) -> bool:
        changed = self._frame_keys.get(view) != self._frame_key(view)
        # A draft comes closer, and at rest the picture itself takes its place
        unfinished = view in self._drafted and (self.at_rest or not self._drafted[view])
        return (changed or unfinished) and self._pages.want(index)

    def frames(self) -> None:
        """The changed views that some page is ready to show."""
        for index, view in enumerate(self._pages.views):
            self._waiting.discard(view)
            if self._due(index, view):
                self._picture(view)

    def _picture(self, view: str) -> None:
        key = self._frame_key(view)
        try:
            if not self._session.ready(view):
                self._waiting.add(view)
                return
            self._frame_keys[view] = key
            image = self._image(view)
            self._measure(view, image)
            self._objects_under_pixels(view)
            frame = self._pages.frame(Kind.PICTURE, view, image)
        except Exception as error:
            self._frame_keys[view] = key
            log.exception("view %s failed", view)
            words = str(error) if isinstance(error, BurnishError) else repr(error)
            self._pages.to_all(
                m.Notice(
                    "error",
                    f"The picture could not be computed: {words} "
                    "It is tried again after the next edit; undo brings back the last look.",
                )
            )
            return
        self._frames[view] = frame
        self._frame_times.append(time.monotonic())
        self._pages.show(frame)

    def _image(self, view: str) -> Float32:
        """The picture of a view; while something is dragged, a draft where that is faster."""
        self._drafted.pop(view, None)
        if self.at_rest or not self._session.drafts_help(view):
            return self._session.frame(view)
        draft = self._session.draft(view)
        if not draft.frame:
            self._drafted[view] = draft.exact
        return draft.image

    def prepare_drafts(self) -> None:
        """Let the views that are looked at measure whether drafts are faster, once a look."""
        for index, view in enumerate(self._pages.views):
            key = self._look_key(), self._session.views[view].revision
            if self._pages.watch(index) and self._prepared.get(view) != key:
                self._prepared[view] = key
                try:
                    self._session.prepare_drafts(view)
                except Exception:
                    # Pictures do without; what is wrong with the view its picture says
                    log.exception("view %s has no drafts", view)

    def _objects_under_pixels(self, view: str) -> None:
        """The object under each pixel, once per view or when its rows have changed."""
        count = len(self._session.views[view].rows)
        known = self._object_frames.get(view)
        if known is None or known[0] != count:
            numbers = describe.object_numbers(self._session, view, self._order)
            known = count, self._pages.frame(Kind.OBJECTS, view, numbers)
            self._object_frames[view] = known
            self._pages.show(known[1])

    def finished_picture(self, view: str) -> Float32 | None:
        """The picture of a view, not denoised; None while a new selection is being traced."""
        self._pages.index(view)
        return self._session.frame(view) if self._session.ready(view) else None

    def _measure(self, view: str, image: Float32) -> None:
        """Keep the estimate of a live view's noise."""
        transport, meter = self._session.views[view], self._meters[view]
        if (samples := samples_of(transport)) < 0:
            return
        if self.at_rest:
            meter.take(self._look_key(), samples, image, self._session.emission(view))
        else:
            meter.edited(self._look_key())

    # -- in a pause -------------------------------------------------------------------------

    def denoise(self) -> None:
        """Have noisy pictures of the present look cleaned."""
        if not self._resting.active:
            return
        now = time.monotonic()
        for index, view in enumerate(self._pages.views):
            transport = self._session.views[view]
            key, revision = self._look_key(), transport.revision
            if (
                0 < samples_of(transport) < ENOUGH_SAMPLES
                and self._pages.watch(index)
                and self._resting.due(view, key, revision, now)
                and self._session.ready(view)
            ):
                self._resting.begin(view, key, revision, self._session.frame(view), now)

    def trace_lights(self) -> None:
        """What each light adds: better, where lights are mixed, and before they are where a
        worker traces and has little left to do."""
        for index, view in enumerate(self._pages.views):
            if self._pages.watch(index):
                self._session.light_mix.ready(view, self._session.state)
                if samples_of(self._session.views[view]) >= LIGHTS_AFTER:
                    self._session.light_mix.prepare(view, self._session.state)

    def cleaned(self, done: Cleaned | str) -> None:
        """A cleaned picture is there, or why there is none."""
        if isinstance(done, str):
            if self._resting.unavailable:
                self._pages.to_all(m.Notice("warning", f"Pictures cannot be denoised: {done}"))
        elif done.key == self._look_key():
            frame = self._pages.frame(Kind.RESTING, done.view, done.image)
            self._resting_frames[done.view] = frame
            self._pages.show(frame)

    def compare(self) -> None:
        """Hold the picture against the reference, again when a live one has doubled."""
        view = self._tracing.compared_view
        if view is not None and self._session.ready(view):
            doublings = samples_of(self._session.views[view]).bit_length()
            self._tracing.compare_at_rest(
                self._session.revision, doublings, lambda name: self._session.frame(name)
            )

    # -- the selected object's curves and plots ----------------------------------------------

    def inspect(self, theta_i: float) -> None:
        """Light the polar plot from another angle, in degrees. Raises InvalidValue."""
        if not 0.0 <= theta_i <= 89.0:
            raise InvalidValue(f"theta_i must lie in [0, 89] degrees; got {theta_i:g}")
        self._theta_i = theta_i

    def curves(self) -> None:
        """The curves as they are now."""
        selected = tuple(self._session.selected)
        key = self._session.revision, selected
        now = time.monotonic()
        if key == self._curves_key or not self._pages.boxes or now < self._curves_due:
            return
        self._curves_key = key
        self._curves_due = now + _CURVE_SECONDS
        material = self._session.material(selected[0]) if selected else None
        if material is not None:
            state = self._session.state[selected[0]]
            profiles, outgoing, second = describe.curves(material, state)
            self._pages.to_all(m.Curves(selected[0], profiles, outgoing, second))

    def draw_plots(self) -> None:
        """The ball and the polar plot."""
        selected = tuple(self._session.selected)
        key = self._session.revision, selected, self._theta_i
        if key == self._plot_key or not self._pages.boxes:
            return
        self._plot_key = key
        material = self._session.material(selected[0]) if selected else None
        if material is not None:
            state = self._session.state[selected[0]]
            self.plots.draw(Subject(selected[0], material, state, self._theta_i))

    # -- progress ---------------------------------------------------------------------------

    def progress(self) -> None:
        """Samples, noise and frames per second, a few times a second."""
        now = time.monotonic()
        if now < self._progress_due:
            return
        self._progress_due = now + _PROGRESS_SECONDS
        message = self._present_progress(now)
        if message != self._progress:
            self._progress = message
            self._pages.to_all(message)

    def _present_progress(self, now: float) -> m.Progress:
        recent = [t for t in self._frame_times if now - t < 1.0]
        rate = (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 2 else 0.0
        # A bundle is as good as it will get; a live view counts its samples.
        views = self._pages.views
        shown = [v for i, v in enumerate(views) if self._pages.watch(i)] or views[:1]
        view = min(shown, key=lambda name: samples_of(self._session.views[name]))
        samples = samples_of(self._session.views[view])
        noise = self._meters[view].noise(samples)
        text = _progress_text(self._session.views[view], view in self._waiting)
        if view in self._waiting and self._session.light_mix.notice(view, self._session.state):
            text = "tracing the lights …"
        return m.Progress(
            text=text,
            fraction=1.0 if samples < 0 else -1.0,
            frames_per_second=round(rate, 1),
            samples=samples,
            noise=float(f"{noise:.2g}"),
            denoise=self._resting.active,
            resting=self._resting.active and 0 <= samples < ENOUGH_SAMPLES,
        )


def _progress_text(transport: Transport, waiting: bool) -> str:
    samples = samples_of(transport)
    if samples < 0:
        return ""
    if waiting or samples == 0:
        return "tracing the selection …"
    words = f"{samples} sample{'' if samples == 1 else 's'}"
    if getattr(transport, "coarser", False):
        words += ", fewer bins for want of memory"
    return f"tracing … {words}" if samples < ENOUGH_SAMPLES else words
