"""What the pages ask for, done to the session."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from typing import Any

from burnish.app import messages as m
from burnish.app.server import describe
from burnish.app.server.autosave import Autosave
from burnish.app.server.frames import Kind
from burnish.app.server.lights import moves_a_light
from burnish.app.server.mailbox import Mailbox
from burnish.app.server.pages import Pages
from burnish.app.server.publishing import Publishing
from burnish.app.server.resting import Resting
from burnish.app.server.snapshots import Snapshots
from burnish.app.server.tracing import Tracing
from burnish.core.errors import InvalidValue, UnknownName
from burnish.session import Session

_QUIET_SECONDS = 10.0
"""So long after a light has moved another move says nothing."""


class Actions:
    """Carries out messages. Used from the engine's thread alone."""

    def __init__(
        self,
        session: Session,
        pages: Pages,
        publishing: Publishing,
        snapshots: Snapshots,
        tracing: Tracing,
        resting: Resting,
        autosave: Autosave,
    ) -> None:
        self._session, self._pages, self._publishing = session, pages, publishing
        self._snapshots, self._tracing, self._resting = snapshots, tracing, resting
        self._autosave = autosave
        self._gesture: tuple[Mailbox, AbstractContextManager[Any]] | None = None
        self._moved = -_QUIET_SECONDS

    def carry_out(self, box: Mailbox, item: m.ClientMessage) -> None:
        """Do what a message asks. Raises BurnishError, and then has changed nothing."""
        session = self._session
        match item:
            case m.Select(objects=objects):
                session.select(*objects)
            case m.Gesture(active=active):
                self.gesture(box if active else None)
            case m.SetValue(path=path, value=value):
                self._set_value(path, value)
            case m.SetMap(path=path, file=file, map=lies):
                self._set_map(path, file, lies)
            case m.ClearMap(path=path):
                session.clear_map(path)
            case m.SetCurve(layer=layer, curve=curve):
                session.set_curve(layer, describe.curve_from(curve))
            case m.SetOutgoingCurve(layer=layer, curve=curve):
                session.set_outgoing_curve(layer, describe.curve_from(curve))
            case m.SetSecondCurve(layer=layer, curve=curve):
                session.set_second_curve(layer, describe.curve_from(curve))
            case m.SetModel(layer=layer, model=model):
                self._set_model(layer, model)
            case m.SetMetal(layer=layer, metal=metal):
                self._set_metal(layer, metal)
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
                self._snapshots.take(session, label, view, thumbnail)
                self._pages.to_all(self._snapshots.message())
            case m.RestoreSnapshot(snapshot=number):
                self._snapshots.restore(session, number)
            case m.ForgetSnapshot(snapshot=number):
                self._snapshots.forget(number)
                self._pages.to_all(self._snapshots.message())
            case m.CompareSnapshot(snapshot=number):
                view, pixels = self._snapshots.picture(number)
                box.put_frame(self._pages.frame(Kind.COMPARISON, view, pixels))
            case m.PathTrace(view=view, spp=spp, crop=crop):
                self._pages.index(view)
                self._tracing.begin(view, spp, crop)
            case m.CancelPathTrace():
                self._tracing.cancel()
            case m.LoadEdits(text=text):
                session.load_text(text)
            case m.Recover(accept=accept):
                self._autosave.recover(accept)
            case m.Inspect(theta_i=theta_i):
                self._publishing.inspect(theta_i)
            case m.Denoise(active=active):
                self._resting.wanted = active
                self._resting.forget()
            case _:
                raise InvalidValue(f"{type(item).__name__} cannot be sent twice")

    def gesture(self, box: Mailbox | None) -> None:
        """A page begins a drag; with None the drag in progress ends."""
        if self._gesture is not None:
            _, context = self._gesture
            self._gesture = None
            context.__exit__(None, None, None)
        if box is not None:
            context = self._session.gesture()
            context.__enter__()
            self._gesture = box, context

    def farewell(self, box: Mailbox) -> None:
        """A page has gone, and its drag with it."""
        if self._gesture is not None and self._gesture[0] is box:
            self.gesture(None)

    def _set_value(self, path: str, value: m.Value) -> None:
        before = self._session.revision
        self._session.set(path, value)
        now = time.monotonic()
        if moves_a_light(path) and self._session.revision != before:
            if now - self._moved > _QUIET_SECONDS:
                words = "The lights stand otherwise now: their light is being traced anew."
                self._pages.to_all(m.Notice("info", words))
            self._moved = now

    def _set_map(self, path: str, file: str | None, wanted: m.MapData) -> None:
        """A new picture is laid as it comes; the one that is there as wanted."""
        if file is not None:
            self._session.set_map(path, file, channel=wanted.channel)
            return
        image = self._session.map_of(path)
        lies = None if image is None else describe.map_data(image)
        self._session.set_map(
            path,
            scale=wanted.scale,
            offset=wanted.offset,
            # A page knows no shear: what it leaves as it was keeps what it has
            repeat=None if lies and wanted.repeat == lies.repeat else wanted.repeat,
            rotate=None if lies and wanted.rotate == lies.rotate else wanted.rotate,
        )

    def _set_model(self, path: str, model: str) -> None:
        before = self._session.revision
        self._session.set_model(path, model)
        if self._session.revision != before:
            words = (
                f"{path} is {model} now: its light is being traced anew; undo brings the other back"
            )
            self._pages.to_all(m.Notice("info", words))

    def _set_metal(self, path: str, name: str) -> None:
        """The metal's index of refraction, or its reflectance, whichever the layer takes."""
        object_id, layer = self._layer(path)
        material = self._session.material(object_id)
        assert material is not None
        values = describe.metal_values(material.layer(layer).model, name)
        with self._session.gesture():
            for parameter, value in values.items():
                self._session.set(f"{path}.{parameter}", value)

    def _solo(self, path: str) -> None:
        object_id, name = self._layer(path)
        layers = self._session.state[object_id].layers
        alone = all(state.enabled == (other == name) for other, state in layers.items())
        with self._session.gesture():
            for other in layers:
                self._session.set_enabled(f"{object_id}.{other}", alone or other == name)

    def _layer(self, path: str) -> tuple[str, str]:
        """Object and layer of "object.layer". Raises UnknownName."""
        object_id, _, name = path.rpartition(".")
        if object_id not in self._session.state:
            raise UnknownName("object", object_id, self._session.state)
        layers = self._session.state[object_id].layers
        if name not in layers:
            raise UnknownName("layer", name, layers)
        return object_id, name

    def _go_to(self, position: int) -> None:
        labels, now = self._session.history
        if not 0 <= position <= len(labels):
            raise InvalidValue(f"position must lie in [0, {len(labels)}]; got {position}")
        for _ in range(now - position):
            self._session.undo()
        for _ in range(position - now):
            self._session.redo()
