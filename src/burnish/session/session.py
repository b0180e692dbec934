"""A session: materials that change, their history, and the pictures that they give."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from burnish.core.colour import colour_from_hex
from burnish.core.errors import (
    CannotWrite,
    InvalidValue,
    MissingFile,
    MissingRayTracer,
    TooLarge,
    UnknownName,
)
from burnish.core.types import Float32, Float64, Int32, Progress, Value
from burnish.materials.coefficients import albedo, conserved
from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, Material, MaterialState
from burnish.materials.lights import PREFIX, LightGroup, lights_in
from burnish.materials.names import WEIGHT, resolve
from burnish.materials.paths import resolve_layer
from burnish.materials.reflectance import asymmetry
from burnish.materials.replacement import replaced
from burnish.materials.two_curves import check_two_curves
from burnish.runtime.renderer import Renderer
from burnish.session.brushes import Brush, BrushName, brushes
from burnish.session.drafting import Drafting
from burnish.session.edits import edits_from_text, edits_to_text
from burnish.session.history import History
from burnish.session.lighting import Lighting, shown
from burnish.session.lightmix import LightMix
from burnish.session.mapping import MapEditing, own_maps
from burnish.session.painting import BrushOptions, PaintStroke, paint_whole, painting
from burnish.session.pictures import ViewPictures
from burnish.session.surface import Surface
from burnish.transport.basis import State, initial_state
from burnish.transport.frozen import Transport
from burnish.transport.lights import mixed
from burnish.transport.pack import BlockSource
from burnish.transport.protocols import Denoiser, LightPictures, Truth

_ALBEDO_SLACK = 1e-3
_ASYMMETRY_SLACK = 0.02


@dataclass(frozen=True)
class ObjectInfo:
    """An object of the scene: whether it can be edited, if not why, and its layers."""

    id: str
    editable: bool = True
    reason: str = ""
    layers: tuple[Layer, ...] = ()


class Session(Lighting, MapEditing, Drafting):
    """Edit the materials of a scene and see it.

    transports: one for each view, by name; stored blocks are frozen by `runtime.freeze`.
    objects: all objects of the scene (default: the editable ones). truth: a path tracer,
    or None. name: shown to the user and written into edits files. lights: what can be mixed
    where the transports tell no light groups apart, by what light_pictures traces.

    Not for use from several threads at once.

    >>> session = Session(bundle.views, name="teatray")        # doctest: +SKIP
    >>> session.set("teapot.specular.roughness", 0.12)         # doctest: +SKIP
    >>> image = session.frame()                                # doctest: +SKIP
    >>> session.undo()                                         # doctest: +SKIP
    True
    """

    def __init__(
        self,
        transports: Mapping[str, Transport | BlockSource],
        objects: Sequence[ObjectInfo] = (),
        truth: Truth | None = None,
        name: str = "",
        lights: Sequence[LightGroup] = (),
        light_pictures: LightPictures | None = None,
    ) -> None:
        if not transports:
            raise InvalidValue("a session needs at least one view; got none")
        self.name = name
        self.truth = truth
        self.denoiser: Denoiser | None = None
        self._pictures = {key: ViewPictures(key, value) for key, value in transports.items()}
        self._basis = next(iter(self._pictures.values())).transport.basis
        self._materials = {item.id: item.material for item in self._basis.objects}
        self._objects = tuple(objects) or tuple(
            ObjectInfo(item.id, layers=item.material.layers) for item in self._basis.objects
        )
        self._lights = self._basis.lights or tuple(lights)
        self.light_mix = LightMix(() if self._basis.lights else self._lights, light_pictures)
        self._history = History(initial_state(self._basis.objects))
        self._selected: tuple[str, ...] = ()
        self._warned: dict[str, tuple[MaterialState, list[str]]] = {}
        self._listeners: list[Callable[[], None]] = []
        self._closers: list[Callable[[], None]] = []
        self._revision = 0

    # -- what there is ----------------------------------------------------------------------

    @property
    def objects(self) -> tuple[ObjectInfo, ...]:
        """All objects of the scene, editable or not."""
        return self._objects

    @property
    def views(self) -> Mapping[str, Transport]:
        """The views by name; the first is the default."""
        return MappingProxyType({name: view.transport for name, view in self._pictures.items()})

    @property
    def state(self) -> State:
        """The state of every editable object's material, and of the lights that are not as the
        scene has them, under "light:NAME". States are values: keep them."""
        return MappingProxyType(dict(self._history.state))

    @property
    def materials(self) -> State:
        """The same as `state`."""
        return self.state

    @property
    def revision(self) -> int:
        """Grows with every change of the state."""
        return self._revision

    @property
    def history(self) -> tuple[list[str], int]:
        """What each step did, oldest first, and how many of them are in force."""
        return self._history.labels, self._history.position

    def material(self, object_id: str) -> Material | None:
        """The material of an editable object, with the models that it has now, else None."""
        material = self._materials.get(object_id)
        return None if material is None else material.as_in(self._history.state[object_id])

    def own_material(self, object_id: str) -> Material | None:
        """The material of an editable object with the scene's own models, else None."""
        return self._materials.get(object_id)

    def on_change(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Call `callback` after every change of the state, such as to save automatically.

        Inside a gesture it is called for every change. Returns a function that ends it.
        """
        self._listeners.append(callback)

        def end() -> None:
            if callback in self._listeners:
                self._listeners.remove(callback)

        return end

    def on_close(self, callback: Callable[[], None]) -> None:
        """Call `callback` when the session ends, such as to end a tracing process."""
        self._closers.append(callback)

    def close(self) -> None:
        """End the session and what serves it. Closing again does nothing."""
        closers, self._closers = self._closers, []
        for callback in closers:
            callback()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- selection --------------------------------------------------------------------------

    @property
    def selected(self) -> tuple[str, ...]:
        """The objects whose edits show at once; editing another one selects it."""
        return self._selected

    def select(self, *object_ids: str) -> None:
        """Select objects to edit together; none to select nothing.

        Raises UnknownName; InvalidValue for an object that is not editable, with the
        reason; TooLarge when so many at a time do not fit, and then keeps the selection.
        """
        chosen = tuple(dict.fromkeys(object_ids))
        for object_id in chosen:
            self._check_editable(object_id)
        before, self._selected = self._selected, chosen
        if len(chosen) > 1:
            try:
                if self.ready():
                    self.renderer()
            except TooLarge:
                self._selected = before
                raise

    def pick(self, x: int, y: int, view: str | None = None) -> str | None:
        """The editable object that covers most of a pixel, or None. Raises InvalidValue."""
        picture = self._view(view)
        width, height = picture.transport.width, picture.transport.height
        if not (0 <= x < width and 0 <= y < height):
            raise InvalidValue(
                f"a pixel must lie in [0, {width - 1}] × [0, {height - 1}]; got ({x}, {y})"
            )
        index = int(picture.object_map()[y, x])
        return None if index < 0 else self._basis.objects[index].id

    def object_map(self, view: str | None = None) -> Int32:
        """Which editable object covers most of each pixel: int32 [height, width].

        Indices into the basis's objects, -1 where none is met directly or in a mirror.
        """
        return self._view(view).object_map()

    # -- edits ------------------------------------------------------------------------------

    def get(self, path: str) -> Value:
        """A parameter's value, such as get("teapot.specular.roughness").

        Paths are those of `materials.names`, OpenPBR's names among them, and of
        `materials.lights`, such as "light:lamp.intensity". Raises UnknownName.
        """
        if path.startswith(PREFIX):
            return self._get_light(path)
        address = resolve(self._current(), path)
        return address.read(self._history.state[address.object])

    def set(self, path: str, value: object) -> None:
        """Set a parameter; a colour takes three numbers, one, or "#rrggbb" (sRGB).

        Raises UnknownName with the nearest names, InvalidValue with the range.
        """
        if path.startswith(PREFIX):
            self._set_light(path, value)
            return
        materials = self._current()
        address = resolve(materials, path)
        if isinstance(value, str) and value.startswith("#"):
            value = colour_from_hex(value)
        material, state = materials[address.object], self._history.state[address.object]
        changed = address.write(material, state, value)
        self._change(address.object, changed, f"Set {path} to {shown(address.read(changed))}")

    def set_curve(self, layer_path: str, curve: Curve | None) -> None:
        """Put a freehand curve on a layer's profile, or take it away. Raises UnknownName."""
        label = f"Drew the curve of {layer_path}" if curve else f"Cleared the curve of {layer_path}"
        self._change_layer(layer_path, label, curve=curve)

    def set_outgoing_curve(self, layer_path: str, curve: Curve | None) -> None:
        """Put a freehand factor on the viewing angle of a layer, or take it away.

        At t = θo / 90°; see `LayerState`. Raises UnknownName.
        """
        label = f"{'Drew' if curve else 'Cleared'} the viewing curve of {layer_path}"
        self._change_layer(layer_path, label, outgoing_curve=curve)

    def set_second_curve(self, layer_path: str, curve: Curve | None) -> None:
        """Put a freehand curve on the second curve of a layer with two, or take it away.

        Raises UnknownName, InvalidValue for a layer with one curve.
        """
        object_id, name = resolve_layer(self._materials, layer_path)
        model = self._current()[object_id].layer(name).model
        check_two_curves(model, f"{object_id}.{name}")
        label = f"{'Drew' if curve else 'Cleared'} the second curve of {layer_path}"
        self._change_layer(layer_path, label, second_curve=curve)

    @property
    def models_fixed(self) -> str:
        """Why no layer can be given another model here, or ""."""
        if all(getattr(view.transport, "remodels", False) for view in self._pictures.values()):
            return ""
        return (
            "A bake holds the light for the models that it was made with; open the scene itself "
            "to choose another one."
        )

    def set_model(self, layer_path: str, model: str) -> None:
        """Give a layer another reflectance model, by its name; what can carries over.

        The light that reaches the object has to be traced anew: for live sessions alone. The
        name of the scene's own model brings that back, with its numbers. Raises UnknownName,
        InvalidValue.
        """
        object_id, name = resolve_layer(self._materials, layer_path)
        state = self._history.state[object_id]
        changed = replaced(self._materials[object_id], state, name, model, self._basis.series[0])
        self._check_models({object_id: changed})
        self._change(object_id, changed, f"Made {layer_path} {model}")

    def set_enabled(self, layer_path: str, enabled: bool) -> None:
        """Switch a layer on or off. Raises UnknownName."""
        label = f"Switched {layer_path} {'on' if enabled else 'off'}"
        self._change_layer(layer_path, label, enabled=bool(enabled))

    def set_weight(self, layer_path: str, weight: float) -> None:
        """Scale a layer by a number in [0, 100]. Raises UnknownName, InvalidValue."""
        accepted = WEIGHT.validate(weight, f"{layer_path}.")
        self._change_layer(layer_path, f"Weighted {layer_path} by {accepted:g}", weight=accepted)

    def set_conserve(self, object_id: str, conserve: bool) -> None:
        """Link an object's layer weights so that they reflect no more than they receive.

        Raises UnknownName, InvalidValue for an object that is not editable.
        """
        self._check_editable(object_id)
        state = replace(self._history.state[object_id], conserve=bool(conserve))
        label = f"{'Linked' if conserve else 'Unlinked'} the layers of {object_id}"
        self._change(object_id, state, label)

    # -- paint ------------------------------------------------------------------------------

    def brushes(self, object_id: str) -> dict[BrushName, Brush]:
        """The brushes of an object's material, those that it lacks with the reason.

        Raises UnknownName, InvalidValue for an object that is not editable.
        """
        self._check_editable(object_id)
        material = self.material(object_id)
        assert material is not None
        return brushes(material, self._history.state[object_id])

    def stroke(
        self,
        brush: str,
        *,
        objects: Sequence[str] | Literal["all"] | None = None,
        view: str | None = None,
        **options: Any,
    ) -> AbstractContextManager[PaintStroke]:
        """Draw a stroke bit by bit: one step of undo, and the picture follows.

        brush: a name of `brushes`. objects: the one that the stroke first meets, those named,
        or "all". options: those of `BrushOptions`: size, strength, falloff, color, amount,
        layer, source, straight.

        >>> with session.stroke("blur", size=30) as drawn:         # doctest: +SKIP
        ...     drawn.extend([(120, 90), (140, 95)])
        ...     image = session.frame()

        Raises UnknownName, InvalidValue, TooLarge.
        """
        return painting(self, brush, BrushOptions(**options), objects, view)

    def paint(
        self,
        brush: str,
        points: Sequence[Sequence[float]],
        *,
        objects: Sequence[str] | Literal["all"] | None = None,
        view: str | None = None,
        **options: Any,
    ) -> tuple[str, ...]:
        """A whole stroke at once; takes what `stroke` takes and gives the objects it met.

        points: (x, y) or (x, y, pressure), in view pixels from the upper left corner.

        >>> way = [(100, 80), (160, 95)]
        >>> session.paint("diffuse-color", way, color="#c03020")   # doctest: +SKIP
        ('teapot',)
        """
        with self.stroke(brush, objects=objects, view=view, **options) as drawn:
            drawn.extend(points)
        return drawn.objects

    def paint_whole(
        self, brush: str, objects: Sequence[str] | None = None, **options: Any
    ) -> tuple[str, ...]:
        """A brush on all of some objects (the selected ones), what is painted there included.

        options: strength, color, amount and layer of `BrushOptions`. An eraser of strength 1
        takes all paint off. Raises UnknownName, InvalidValue.
        """
        chosen = self._selected if objects is None else tuple(objects)
        if not chosen:
            raise InvalidValue("name the objects to paint, or select some")
        return paint_whole(self, brush, BrushOptions(**options), chosen)

    def surface(self, object_id: str, view: str | None = None) -> Surface:
        """What a view shows of an object's surface, row by row. Raises UnknownName."""
        return self._view(view).surface(self._basis.index(object_id))

    # -- the scene's own --------------------------------------------------------------------

    def reset(self, path: str | None = None) -> None:
        """Back to the scene's own: a parameter, a layer, an object, a light, or everything (None).

        Raises UnknownName.
        """
        if path is None:
            self._record("Reset everything", initial_state(self._basis.objects))
            return
        label = f"Reset {path}"
        if path.startswith(PREFIX):
            self._reset_light(path, label)
            return
        if path in self._materials:
            self._change(path, self._materials[path].initial, label)
            return
        try:
            object_id, layer = resolve_layer(self._materials, path)
        except UnknownName:
            # The stored number itself: OpenPBR's roughness would round on its way
            materials = self._current()
            address = replace(resolve(materials, path), squared=False)
            material = materials[address.object]
            state = self._history.state[address.object]
            original = address.write(material, state, address.read(material.initial))
            if not address.of_map:
                original = own_maps(original, material, address.layer, address.parameter)
            self._change(address.object, original, label)
            return
        own = self._materials[object_id]
        state = own_maps(self._history.state[object_id], own, layer)
        layers = {**state.layers, layer: own.initial.layers[layer]}
        self._change(object_id, replace(state, layers=layers), label)

    def restore(self, state: State, label: str = "Restored a state") -> None:
        """Make a kept `state` the present one, as one step. Raises UnknownName, InvalidValue.

        Lights that it does not name are as the scene has them.
        """
        for object_id in self._materials:
            if object_id not in state:
                raise UnknownName("object", object_id, state)
        self._check_models(state)
        self._check_lights(state)
        self._record(label, {name: state[name] for name in self._materials} | lights_in(state))

    def gesture(self) -> AbstractContextManager[None]:
        """Everything inside is one step of undo, such as the drag of a slider.

        >>> with session.gesture():                                # doctest: +SKIP
        ...     for roughness in (0.1, 0.2, 0.3):
        ...         session.set("teapot.specular.roughness", roughness)
        """
        return self._history.gesture()

    def undo(self) -> bool:
        """Take the last step back; False when there is none."""
        return self._travel(self._history.undo)

    def redo(self) -> bool:
        """Make the last undone step again; False when there is none."""
        return self._travel(self._history.redo)

    # -- pictures ---------------------------------------------------------------------------

    def frame(self, view: str | None = None) -> Float32:
        """The picture with the present materials: float32 [height, width, 3], linear RGB.

        Light that no edit changes and directly seen emission are in it. Freezes when the
        selection, another object's material or the transport have changed. Raises
        UnknownName, TooLarge.
        """
        shown, state = self._view(view), self._history.state
        return self.light_mix.applied(shown.name, shown.image(self._targets(), state), state)

    def emission(self, view: str | None = None) -> Float32:
        """What of the picture is directly seen emission: float32 [height, width, 3]."""
        shown, state = self._view(view), self._history.state
        seen = shown.transport.emission
        if self._basis.lights:
            return mixed(self._basis, seen, state)
        return self.light_mix.applied(shown.name, seen, state, emission=True)

    def ready(self, view: str | None = None) -> bool:
        """Whether `frame` answers at once.

        Where it does not, a live session begins to trace what is missing: ask again. Raises
        UnknownName, SceneError when that has failed.
        """
        shown, state = self._view(view), self._history.state
        return shown.ready(self._targets(), state) and self.light_mix.ready(shown.name, state)

    def renderer(self, view: str | None = None) -> Renderer:
        """The renderer of the present selection, for gradients."""
        return self._view(view).renderer(self._targets(), self._history.state)

    def gradient(
        self,
        loss: Callable[[Float32], tuple[float, Float32]],
        objects: Sequence[str] | None = None,
        parameters: Sequence[str] | None = None,
        view: str | None = None,
    ) -> tuple[float, dict[str, Float64]]:
        """The derivative of a loss by parameters, exact and without a ray.

        loss: from a picture [height, width, 3] to a number and its derivative by the picture.
        objects: the selected ones, or all, without it; they become selected. parameters: as
        for `burnish.fit`. Gives the loss and, by path, float64 [] per scalar, [3] per
        colour, by the parameter's own value (linear RGB, alpha, exponent, ...).

        >>> def loss(image):                                       # doctest: +SKIP
        ...     return ((image - wish) ** 2).sum(), 2 * (image - wish)
        >>> value, slopes = session.gradient(loss, ["teapot"])     # doctest: +SKIP

        A roughness below 0.001 counts as 0.001. Raises UnknownName, InvalidValue, TooLarge.
        """
        from burnish.session.gradient import gradient

        return gradient(self, loss, objects, parameters, view)

    def path_trace(
        self,
        view: str | None = None,
        spp: int = 256,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Float32:
        """The path-traced picture of the present materials. Raises MissingRayTracer."""
        if self.truth is None:
            raise MissingRayTracer(
                "path tracing needs the scene and Mitsuba; open the scene itself, where "
                "Mitsuba can be imported (pip install mitsuba)"
            )
        return self.truth.render(
            dict(self._history.state), self._view(view).name, spp, seed, progress
        )

    def denoised(self, view: str | None = None) -> Float32:
        """The present picture with its noise cleaned away, for the eye alone.

        float32 [height, width, 3], linear RGB. Raises MissingRayTracer where nothing traces.
        """
        if self.denoiser is None:
            raise MissingRayTracer("only a live session denoises: a bundle is as clean as its bake")
        return self.denoiser.denoise(self.frame(view), self._view(view).name)

    def warnings(self) -> list[str]:
        """What is odd about the present materials, one line each."""
        result: list[str] = []
        for object_id, material in self._current().items():
            state = self._history.state[object_id]
            known = self._warned.get(object_id)
            if known is None or known[0] != state:
                known = state, _material_warnings(object_id, material, state)
                self._warned[object_id] = known
            result += known[1]
        return result

    # -- files ------------------------------------------------------------------------------

    def edits_text(self) -> str:
        """The edits as the text of their file (see `session.edits`)."""
        return edits_to_text(self._history.state, self._materials, self.name, self._lights)

    def load_text(self, text: str, where: str = "edits") -> None:
        """Replace all edits by those of a file's text, as one step.

        Raises InvalidValue, UnknownName, and then changes nothing.
        """
        state = edits_from_text(text, self._materials, where, self._lights)
        self._check_models(state)
        self._check_lights(state)
        self._record(f"Loaded {where}", state)

    def save(self, path: str | Path) -> None:
        """Write the edits to a small readable file. Raises MissingFile, CannotWrite."""
        path = Path(path)
        if not path.parent.is_dir():
            raise MissingFile(f"{path.parent}: this folder does not exist; create it first")
        fresh = path.with_name(f".{path.name}-{os.getpid()}")
        try:
            try:
                fresh.write_text(self.edits_text(), "utf-8")
                os.replace(fresh, path)
            finally:
                fresh.unlink(missing_ok=True)
        except OSError as error:
            raise CannotWrite(f"{path}: cannot be written ({error.strerror or error})") from error

    def load(self, path: str | Path) -> None:
        """Replace all edits by those of a file. Raises MissingFile, InvalidValue, UnknownName."""
        path = Path(path)
        try:
            text = path.read_text("utf-8")
        except UnicodeDecodeError:
            raise InvalidValue(f"{path}: not a burnish edits file (not UTF-8 text)") from None
        except OSError as error:
            raise MissingFile(f"{path}: cannot be read ({error.strerror or error})") from None
        self.load_text(text, path.name)

    # -- inside -----------------------------------------------------------------------------

    def _targets(self) -> tuple[int, ...]:
        """The selected objects."""
        return tuple(i for i, item in enumerate(self._basis.objects) if item.id in self._selected)

    def _current(self) -> dict[str, Material]:
        """The materials with the models that they have now."""
        state = self._history.state
        return {name: material.as_in(state[name]) for name, material in self._materials.items()}

    def _check_models(self, state: State) -> None:
        """Raises InvalidValue when a state has models that this session cannot show."""
        if not self.models_fixed:
            return
        for object_id, item in state.items():
            for layer in item.replacements:
                raise InvalidValue(
                    f"{object_id}.{layer} cannot have another model: {self.models_fixed}"
                )

    def _view(self, view: str | None) -> ViewPictures:
        if view is None:
            return next(iter(self._pictures.values()))
        if view not in self._pictures:
            raise UnknownName("view", view, self._pictures)
        return self._pictures[view]

    def _check_editable(self, object_id: str) -> None:
        if object_id in self._materials:
            return
        for info in self._objects:
            if info.id == object_id:
                reason = info.reason or "it was not chosen as editable"
                raise InvalidValue(f"object {object_id} cannot be edited: {reason}")
        raise UnknownName("object", object_id, self._materials)

    def _change_layer(self, path: str, label: str, **changes: Any) -> None:
        object_id, name = resolve_layer(self._materials, path)
        state = self._history.state[object_id]
        layers = {**state.layers, name: replace(state.layers[name], **changes)}
        self._change(object_id, replace(state, layers=layers), label)

    def _change(self, object_id: str, material: MaterialState, label: str) -> None:
        if object_id not in self._selected:
            self._selected = (object_id,)
        self._record(label, {**self._history.state, object_id: material})

    def _record(self, label: str, state: State) -> None:
        if self._history.record(label, state):
            self._changed()

    def _travel(self, step: Callable[[], bool]) -> bool:
        before = self._history.state
        if not step():
            return False
        now = self._history.state
        changed = [name for name in self._materials if now[name] != before[name]]
        if len(changed) == 1 and changed[0] not in self._selected:
            self._selected = (changed[0],)
        self._changed()
        return True

    def _changed(self) -> None:
        self._revision += 1
        for listener in list(self._listeners):
            listener()


def _material_warnings(object_id: str, material: Material, state: MaterialState) -> list[str]:
    """What is odd about one material, one line each."""
    lopsided = asymmetry(material, state)
    if lopsided <= _ASYMMETRY_SLACK:
        return _energy_warnings(object_id, material, state)
    return [
        f"{object_id} is not reciprocal (with light and eye exchanged it reflects "
        f"{100 * lopsided:.0f} % differently): no real surface does that; mend its viewing curve "
        "or its falloffs",
        *_energy_warnings(object_id, material, state),
    ]


def _energy_warnings(object_id: str, material: Material, state: MaterialState) -> list[str]:
    settled = conserved(material, state)
    total = sum(albedo(layer, settled.layers[layer.name]) for layer in material.layers)
    worst = float(np.max(total))
    if worst <= 1.0 + _ALBEDO_SLACK:
        return []
    channel = ("red", "green", "blue")[int(np.argmax(total))]
    return [
        f"{object_id} reflects more light than it receives (albedo {worst:.2f} in {channel}): "
        "lower a colour or weight, or link the layers"
    ]
