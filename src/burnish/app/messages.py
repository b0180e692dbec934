"""What the editor's page and its server say to each other.

Every message is a JSON object with a `type` (the class's name below) and its fields. The
page's types in `client/src/messages.ts` are generated from this file by `client/message_types.py`,
and the build stops when they differ. Colours are linear RGB, angles degrees, pixels count
from the picture's top left. Pictures themselves travel in binary (`server/frames.py`).

This module imports only the standard library, so that the page can be built without the
package installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

VERSION = 5
"""Grows when a message changes; a page that speaks another version is asked to reload."""

MAXIMUM_MESSAGE_BYTES = 4 * 1024 * 1024
"""A longer message from a page closes its connection."""

RGB = tuple[float, float, float]
Crop = tuple[int, int, int, int]
"""Pixels of a view: left, top, width, height."""
Value = float | RGB | str
Pixel = tuple[float, float]
PenPoint = tuple[float, float, float]
"""x, y and pressure."""


@dataclass(frozen=True)
class CurveData:
    """A freehand edit of a layer's profile: values [n, 3] at rising t in [0, 1]."""

    mode: Literal["replace", "gain"]
    interpolation: Literal["cubic", "linear"]
    t: tuple[float, ...]
    values: tuple[RGB, ...]


@dataclass(frozen=True)
class MapData:
    """How a picture in place of a value lies and is edited: scale · picture + offset. file: ""
    for the scene's own. repeat: along u and v. rotate: degrees."""

    file: str
    channel: Literal["", "red", "green", "blue", "alpha"]
    scale: float
    offset: float
    repeat: tuple[float, float]
    rotate: float


# -- from the page -------------------------------------------------------------------------


@dataclass(frozen=True)
class ClientMessage:
    """What every message of a page carries: a number that rises with each one."""

    seq: int


@dataclass(frozen=True)
class Hello(ClientMessage):
    """First on every connection. client: a page's own name, kept when it reconnects."""

    version: int
    client: str


@dataclass(frozen=True)
class Watch(ClientMessage):
    """Which views this page shows; only those are computed for it."""

    views: tuple[str, ...]


@dataclass(frozen=True)
class Shown(ClientMessage):
    """A frame has been shown, so the next one may come. held: seconds that the page itself
    took from its arrival on; the rest was the way."""

    frame: int
    held: float


@dataclass(frozen=True)
class Select(ClientMessage):
    """Make these objects the edited ones; none deselects."""

    objects: tuple[str, ...]


@dataclass(frozen=True)
class Gesture(ClientMessage):
    """A drag begins or ends; all its edits are one step of undo."""

    active: bool


@dataclass(frozen=True)
class SetValue(ClientMessage):
    """Set "object.layer.parameter"."""

    path: str
    value: Value


@dataclass(frozen=True)
class SetMap(ClientMessage):
    """Put a picture in place of the value of "object.layer.parameter", or with a file of null
    lay the one that is there as told; see `Session.set_map`."""

    path: str
    file: str | None
    map: MapData


@dataclass(frozen=True)
class ClearMap(ClientMessage):
    """Give "object.layer.parameter" one value again."""

    path: str


@dataclass(frozen=True)
class SetCurve(ClientMessage):
    """Set or, with null, remove the freehand curve of "object.layer"."""

    layer: str
    curve: CurveData | None


@dataclass(frozen=True)
class SetOutgoingCurve(ClientMessage):
    """Set or, with null, remove the freehand factor on the viewing angle of "object.layer"."""

    layer: str
    curve: CurveData | None


@dataclass(frozen=True)
class SetSecondCurve(ClientMessage):
    """Set or, with null, remove the freehand edit of the second curve of "object.layer"."""

    layer: str
    curve: CurveData | None


@dataclass(frozen=True)
class SetModel(ClientMessage):
    """Give "object.layer" another reflectance model, a name of Welcome.models."""

    layer: str
    model: str


@dataclass(frozen=True)
class SetMetal(ClientMessage):
    """Give "object.layer" the reflectance of a metal, a name of Welcome.metals."""

    layer: str
    metal: str


@dataclass(frozen=True)
class SetEnabled(ClientMessage):
    """Switch the layer "object.layer" on or off."""

    layer: str
    enabled: bool


@dataclass(frozen=True)
class SetWeight(ClientMessage):
    """Scale the layer "object.layer"."""

    layer: str
    weight: float


@dataclass(frozen=True)
class Solo(ClientMessage):
    """Leave only this layer of its object on; a second time, all of them."""

    layer: str


@dataclass(frozen=True)
class Reset(ClientMessage):
    """Back to the scene's own value: a parameter, a layer, an object or, with null, all."""

    path: str | None


@dataclass(frozen=True)
class Undo(ClientMessage):
    """One step back."""


@dataclass(frozen=True)
class Redo(ClientMessage):
    """One step forth."""


@dataclass(frozen=True)
class GoTo(ClientMessage):
    """To a place in the history: 0 is the scene as it was loaded."""

    position: int


@dataclass(frozen=True)
class TakeSnapshot(ClientMessage):
    """Keep the present look. thumbnail: a data URL of a small picture of it."""

    label: str
    view: str
    thumbnail: str


@dataclass(frozen=True)
class RestoreSnapshot(ClientMessage):
    """Edit on from a kept look."""

    snapshot: int


@dataclass(frozen=True)
class ForgetSnapshot(ClientMessage):
    """Drop a kept look."""

    snapshot: int


@dataclass(frozen=True)
class CompareSnapshot(ClientMessage):
    """Send the kept look's picture as the other side of the wipe."""

    snapshot: int


@dataclass(frozen=True)
class PathTrace(ClientMessage):
    """Path-trace a view with the present materials, in the background. crop: only these
    pixels; null for all."""

    view: str
    spp: int
    crop: Crop | None


@dataclass(frozen=True)
class CancelPathTrace(ClientMessage):
    """Stop that."""


@dataclass(frozen=True)
class LoadEdits(ClientMessage):
    """Replace all edits by those of a file's text."""

    text: str


@dataclass(frozen=True)
class Recover(ClientMessage):
    """Take up, or drop, the edits that an earlier run left behind."""

    accept: bool


@dataclass(frozen=True)
class Inspect(ClientMessage):
    """What the polar plot shows: light that comes in at `theta_i` degrees from the normal."""

    theta_i: float


@dataclass(frozen=True)
class Denoise(ClientMessage):
    """Show noisy live pictures denoised while nothing is edited, or as they are."""

    active: bool


@dataclass(frozen=True)
class BrushSettings:
    """How a brush is held: see `burnish.session.painting.BrushOptions`. layer: "" for the
    first that the brush works on. source: the pixel that a clone stamp copies from."""

    brush: str
    size: float
    strength: float
    falloff: float
    color: RGB
    amount: float
    layer: str
    source: Pixel | None


@dataclass(frozen=True)
class PaintBegin(ClientMessage):
    """A stroke begins; it is one step of undo. every: whether it ignores objects' borders.
    straight: a line from its first point to its last."""

    view: str
    settings: BrushSettings
    every: bool
    straight: bool


@dataclass(frozen=True)
class PaintTo(ClientMessage):
    """The stroke goes on through these points: x and y in pixels of the view, pressure."""

    points: tuple[PenPoint, ...]


@dataclass(frozen=True)
class PaintEnd(ClientMessage):
    """The stroke ends."""


@dataclass(frozen=True)
class PaintWhole(ClientMessage):
    """The brush on all of the selected objects."""

    settings: BrushSettings


# -- from the server -----------------------------------------------------------------------


@dataclass(frozen=True)
class ParameterInfo:
    """One knob as the page draws it; see `burnish.materials.parameter.Parameter`. scale: how a
    slider's travel maps to the value."""

    name: str
    kind: Literal["scalar", "colour", "choice", "vector", "direction", "file"]
    default: Value
    minimum: float
    maximum: float
    soft_minimum: float
    soft_maximum: float
    unit: str
    choices: tuple[str, ...]
    description: str
    scale: Literal["linear", "logarithmic", "square"]


@dataclass(frozen=True)
class LayerInfo:
    """A layer's fixed side. coordinate: γ's name, "none" without a curve; its maximum is in
    degrees when the coordinate is an angle. second_coordinate: that of a second curve, an angle
    up to 90 degrees, or "none". weight: the scene's own. own_model: that of the
    scene. fresnel: what sets the reflectance at normal incidence, the parameter `color`, an
    index of refraction `ior`, or the complex one `eta` and `k`; "" for none of them."""

    name: str
    model: str
    description: str
    coordinate: str
    coordinate_maximum: float
    second_coordinate: str
    weight: float
    own_model: str
    fresnel: Literal["", "color", "ior", "complex"]
    parameters: tuple[ParameterInfo, ...]


@dataclass(frozen=True)
class ModelInfo:
    """A reflectance model that a layer can be given."""

    name: str
    description: str


@dataclass(frozen=True)
class MetalInfo:
    """A metal and its reflectance at normal incidence, linear RGB."""

    name: str
    reflectance: RGB


@dataclass(frozen=True)
class ObjectData:
    """An object of the scene; `reason` says why it cannot be edited."""

    id: str
    editable: bool
    reason: str
    layers: tuple[LayerInfo, ...]


@dataclass(frozen=True)
class ViewData:
    """A picture's name and size in pixels. camera: the matrix [3, 4], row by row, from places
    of the world (x, y, z, 1) to (d · column, d · row, d), d the depth; empty where the page
    need not know it."""

    name: str
    width: int
    height: int
    camera: tuple[float, ...]


@dataclass(frozen=True)
class LayerValues:
    """What is set on a layer. maps: of the parameters that have one."""

    values: Mapping[str, Value]
    maps: Mapping[str, MapData]
    curve: CurveData | None
    outgoing_curve: CurveData | None
    second_curve: CurveData | None
    enabled: bool
    weight: float


@dataclass(frozen=True)
class ObjectValues:
    """What is set on an object. changed: whether it differs from the scene's own material.
    albedo: the reflected share of the light under a uniform sky, linear RGB."""

    layers: Mapping[str, LayerValues]
    changed: bool
    albedo: RGB


@dataclass(frozen=True)
class LightData:
    """A light, or group of lights that are its members, and what is set on it. path: where
    SetValue and Reset find it, such as "light:lamp", with ".intensity" and so on behind it;
    on and solo take "on" and "off". parameters: what else it has, such as ".position", with
    the scene's values as defaults, and `values` as it is now. changed: whether it is not as the
    scene has it."""

    path: str
    name: str
    members: tuple[str, ...]
    intensity: float
    tint: RGB
    on: bool
    solo: bool
    parameters: tuple[ParameterInfo, ...]
    values: Mapping[str, Value]
    changed: bool


@dataclass(frozen=True)
class SnapshotData:
    """A kept look."""

    id: int
    label: str
    thumbnail: str


@dataclass(frozen=True)
class ServerMessage:
    """What the server sends."""


@dataclass(frozen=True)
class Welcome(ServerMessage):
    """Answers Hello. path_tracer, denoiser: why there is none, or "" when there is one.
    tone_mappings: the names that saved pictures may use. models_fixed: why no layer can be
    given another model, or ""."""

    version: int
    session: str
    run: str
    objects: tuple[ObjectData, ...]
    views: tuple[ViewData, ...]
    path_tracer: str
    denoiser: str
    tone_mappings: tuple[str, ...]
    models: tuple[ModelInfo, ...]
    models_fixed: str
    metals: tuple[MetalInfo, ...]


@dataclass(frozen=True)
class State(ServerMessage):
    """Everything that edits change. materials holds only objects that changed since the
    last State of this connection. layers: those of every object that has other models than
    Welcome says."""

    revision: int
    selected: tuple[str, ...]
    materials: Mapping[str, ObjectValues]
    layers: Mapping[str, tuple[LayerInfo, ...]]
    history: tuple[str, ...]
    position: int
    warnings: tuple[str, ...]
    saved: bool


@dataclass(frozen=True)
class Lights(ServerMessage):
    """The mix of the lights. maximum: of an intensity. text: what is not exact about the
    picture's mix at the moment, or "". fixed: why no light can be moved, turned or replaced, or
    ""; what only scales it can be set all the same."""

    items: tuple[LightData, ...]
    maximum: float
    text: str
    fixed: str


@dataclass(frozen=True)
class BrushData:
    """A brush of the selected material; see `burnish.session.brushes.Brush`. reason: why it
    cannot be used, or "". amount: what it does unless told, in [minimum, maximum], which are
    equal where it takes none."""

    name: str
    label: str
    reason: str
    layers: tuple[str, ...]
    colour: bool
    amount: float
    minimum: float
    maximum: float
    meaning: str


@dataclass(frozen=True)
class Brushes(ServerMessage):
    """The brushes of the selected object, or with "" all that there are. painted: the objects
    that carry paint."""

    object: str
    items: tuple[BrushData, ...]
    painted: tuple[str, ...]


@dataclass(frozen=True)
class LayerCurve:
    """A profile at t: as the parameters make it (base) and as edited (result), [n, 3]."""

    layer: str
    t: tuple[float, ...]
    base: tuple[RGB, ...]
    result: tuple[RGB, ...]


@dataclass(frozen=True)
class Curves(ServerMessage):
    """The curves of the selected object. outgoing: each layer's factor on the viewing angle,
    at t = θo / 90°. second: of layers with two curves, the second one."""

    object: str
    layers: tuple[LayerCurve, ...]
    outgoing: tuple[LayerCurve, ...]
    second: tuple[LayerCurve, ...]


@dataclass(frozen=True)
class Appearance(ServerMessage):
    """The selected BRDF by itself: a lit ball (a PNG data URL) and ρ cosθ in the plane of
    incidence, linear RGB at `theta` degrees from the normal, light from -theta_i."""

    object: str
    ball: str
    theta_i: float
    theta: tuple[float, ...]
    radiance: tuple[RGB, ...]


@dataclass(frozen=True)
class Progress(ServerMessage):
    """How far the estimate is. fraction: 0 to 1, below 0 where there is no end. samples: per
    pixel of live views, below 0 for a bundle. noise: the relative error by noise that they
    leave, below 0 while unknown. denoise: whether that is asked for. resting: whether
    pictures are so noisy that denoised ones stand in for them at rest."""

    text: str
    fraction: float
    frames_per_second: float
    samples: int
    noise: float
    denoise: bool
    resting: bool


@dataclass(frozen=True)
class Snapshots(ServerMessage):
    """All kept looks."""

    items: tuple[SnapshotData, ...]


@dataclass(frozen=True)
class Reference(ServerMessage):
    """The path-traced picture. stale: the materials have changed since. metrics: name to
    number, of the present picture against it, inside the crop where there is one."""

    view: str
    crop: Crop | None
    status: Literal["none", "running", "done", "failed"]
    fraction: float
    spp: int
    stale: bool
    metrics: Mapping[str, float]
    text: str


@dataclass(frozen=True)
class Notice(ServerMessage):
    """Words for the user. offer: what a button beside them would do."""

    level: Literal["info", "warning", "error"]
    text: str
    offer: Literal["", "recover"] = ""


@dataclass(frozen=True)
class Refused(ServerMessage):
    """A message that was not carried out, and why; nothing has changed."""

    seq: int
    text: str


FRAME_MAGIC = 0x4E52_5542
"""First four bytes of a binary message, little endian: "BURN"."""


@dataclass(frozen=True)
class FrameHeader:
    """The 40 bytes before a picture's pixels: ten little-endian uint32 in this order.

    kind: what it is (0 the picture, 1 the object under each pixel, 2 the other side of a
    comparison, 3 the picture denoised, for the eye alone). view: index into Welcome.views.
    codec: 0 float16 rows, 1 the same with each row's differences split into byte planes and
    deflated; object numbers are uint16, coded likewise. revision: of the state that the
    picture shows. left, top: the view's pixel that the first one lies on.
    """

    magic: int
    kind: int
    view: int
    codec: int
    width: int
    height: int
    frame: int
    revision: int
    left: int
    top: int


CLIENT_MESSAGES: tuple[type[ClientMessage], ...] = (
    Hello, Watch, Shown, Select, Gesture, SetValue, SetCurve, SetOutgoingCurve, SetSecondCurve,
    SetModel, SetMap, ClearMap,
    SetMetal, SetEnabled, SetWeight, Solo, Reset, Undo, Redo, GoTo, TakeSnapshot, RestoreSnapshot,
    ForgetSnapshot, CompareSnapshot, PathTrace, CancelPathTrace, LoadEdits, Recover, Inspect,
    Denoise, PaintBegin, PaintTo, PaintEnd, PaintWhole,
)  # fmt: skip

SERVER_MESSAGES: tuple[type[ServerMessage], ...] = (
    Welcome, State, Lights, Curves, Appearance, Progress, Snapshots, Reference, Notice, Refused,
    Brushes,
)  # fmt: skip

SHARED = (
    CurveData, ParameterInfo, LayerInfo, ModelInfo, MetalInfo, ObjectData, ViewData, LayerValues,
    ObjectValues, LightData, SnapshotData, LayerCurve, FrameHeader, BrushSettings,
    BrushData, MapData,
)  # fmt: skip
