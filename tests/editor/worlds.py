"""A small scene with an answer by hand: a ball and a wall over a floor, lit by a soft box.

Direct light is put into the bins of each layer by the models' own quotients; one bounce
between neighbours gives the polynomial its mixed terms. No ray tracer takes part.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from burnish.core.errors import InvalidValue
from burnish.core.types import Crop, Float32, Float64, Progress
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import Vector, numpy_maths
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.lambert import Lambert
from burnish.session import ObjectInfo, Session
from burnish.transport.basis import Basis, EditableObject, State
from burnish.transport.block import Tile
from burnish.transport.compression import compress_tile
from burnish.transport.pack import TiledBlocks
from burnish.transport.rows import Rows

NAMES = ("ball", "floor", "wall")
_RADIUS = 0.8
_EYE = np.array([0.0, 0.9, 4.2])


def editable(name: str, colour: tuple[float, float, float], bins: int = 24) -> EditableObject:
    """An object with a diffuse and a Blinn-Phong layer."""
    layers = (Layer("diffuse", Lambert(), bins=1), Layer("specular", BlinnPhong(), bins=bins))
    state = {
        "diffuse": LayerState({"color": colour}),
        "specular": LayerState({"color": (0.08, 0.08, 0.08), "exponent": 60.0}),
    }
    return EditableObject(name, Material(layers, MaterialState(state)))


@cache
def basis() -> Basis:
    """Three objects, two bounces."""
    colours = [(0.55, 0.16, 0.10), (0.45, 0.45, 0.42), (0.12, 0.30, 0.40)]
    return Basis(
        tuple(editable(n, c) for n, c in zip(NAMES, colours, strict=True)), (24, 1), indirect_bins=2
    )


@cache
def world(width: int = 160, height: int = 112, turn: float = 0.0) -> TiledBlocks:
    """The scene seen from the front, or from `turn` radians to the side."""
    symbols = basis()
    directions = _rays(width, height)
    c, s = np.cos(turn), np.sin(turn)
    spin = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    directions, eye = directions @ spin.T, spin @ _EYE
    index, position, normal = _intersect(eye, directions)
    pixels = np.flatnonzero(index >= 0)
    pixels = pixels[np.argsort(index[pixels], kind="stable")]
    position, normal, owner = position[pixels], normal[pixels], index[pixels]
    wo = eye - position
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    count = len(pixels)
    rows = Rows(
        pixel=pixels.astype(np.int32),
        object=owner.astype(np.int32),
        indirect=np.zeros(count, np.bool_),
        weight=np.ones(count, np.float32),
        position=position.astype(np.float32),
        normal=normal.astype(np.float32),
        uv=np.zeros((count, 2), np.float32),
        cos_theta_o=(wo * normal).sum(axis=1).astype(np.float32),
    )
    blocks = []
    for i in range(len(NAMES)):
        members = np.flatnonzero(owner == i)
        transport = _transport(symbols, i, position[members], normal[members], wo[members])
        blocks += compress_tile(
            transport, rows, members.astype(np.int32), width, symbols, tolerance=0.0
        )
    sky = np.zeros((height * width, 3), np.float32)
    sky[index < 0] = (0.10, 0.11, 0.12)
    tile = Tile(
        x=0,
        y=0,
        width=width,
        height=height,
        rows=rows,
        blocks=blocks,
        fixed=sky.reshape(height, width, 3),
        emission=np.zeros((height, width, 3), np.float32),
        samples=1,
    )
    return TiledBlocks.of(symbols, width, height, [tile])


class LitTruth:
    """Stands in for a path tracer: the session's own picture with a little noise."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def render(
        self,
        state: State,
        view: str,
        spp: int,
        seed: int = 0,
        progress: Progress | None = None,
        crop: Crop | None = None,
    ) -> Float32:
        if spp < 2:
            raise InvalidValue("spp must be at least 2, as for the path tracer itself")
        twin = Session(dict(self._session.views), name="twin")
        twin.restore(state)
        image = twin.frame(view)
        if crop is not None:
            left, top, width, height = crop
            image = image[top : top + height, left : left + width]
        if progress is not None:
            progress(1.0, "path tracing")
        noise = np.random.default_rng(seed).normal(1.0, 0.2 / np.sqrt(spp), image.shape)
        return (image * noise).astype(np.float32)


def session(views: int = 1, truth: bool = False) -> Session:
    """A session on one or two views, with a lamp that cannot be edited."""
    transports = {"front": world()}
    if views > 1:
        transports["side"] = world(96, 112, turn=0.7)
    infos = [ObjectInfo(item.id, layers=item.material.layers) for item in basis().objects]
    infos.append(ObjectInfo("lamp", editable=False, reason="it is a light source"))
    result = Session(transports, objects=infos, name="ball room")
    if truth:
        result.truth = LitTruth(result)
    return result


def _rays(width: int, height: int) -> Float64:
    x = (np.arange(width) + 0.5) / width * 2.0 - 1.0
    y = (np.arange(height) + 0.5) / height * 2.0 - 1.0
    scale = 0.42
    gx, gy = np.meshgrid(x * scale * width / height, -y * scale - 0.12)
    directions = np.stack([gx, gy, -np.ones_like(gx)], axis=-1).reshape(-1, 3)
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def _intersect(eye: Float64, d: Float64) -> tuple[np.ndarray, Float64, Float64]:
    """The nearest of ball, floor (y = 0) and wall (z = -1.6); index -1 for none."""
    centre = np.array([0.0, _RADIUS, 0.0])
    o = eye - centre
    b = d @ o
    discriminant = b * b - (o @ o - _RADIUS**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        ball = np.where(discriminant > 0, -b - np.sqrt(np.maximum(discriminant, 0)), np.inf)
        floor = np.where(d[:, 1] < 0, -eye[1] / d[:, 1], np.inf)
        wall = np.where(d[:, 2] < 0, (-1.6 - eye[2]) / d[:, 2], np.inf)
    ball[ball <= 0] = np.inf
    distance = np.stack([ball, floor, wall])
    index = distance.argmin(axis=0)
    nearest = distance.min(axis=0)
    hit = np.isfinite(nearest) & (nearest < 12.0)
    position = eye + d * np.where(hit, nearest, 0.0)[:, None]
    normals = [
        (position - centre) / _RADIUS,
        np.tile([0.0, 1.0, 0.0], (len(d), 1)),
        np.tile([0.0, 0.0, 1.0], (len(d), 1)),
    ]
    normal = np.choose(index[:, None], normals)
    length = np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return np.where(hit, index, -1), position, normal / length


def _transport(
    symbols: Basis, index: int, position: Float64, normal: Float64, wo: Float64
) -> Float32:
    """T [rows, columns, tails, 3]: soft-box light in the bins, neighbours' light in the tails."""
    material = symbols.objects[index].material
    result = np.zeros((len(position), symbols.columns(index), symbols.tails, 3), np.float32)
    tangent = np.cross(normal, [0.31, 0.52, 0.79])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    frame = tangent, np.cross(normal, tangent), normal
    local_wo = Vector(*((axis * wo).sum(axis=1) for axis in frame))
    rows = np.arange(len(position))
    steps = np.linspace(-0.6, 0.6, 7)
    for a in steps:
        for b in steps:
            light = np.array([-1.5 + a, 3.2, 1.6 + b]) - position
            square = (light * light).sum(axis=1)
            light /= np.sqrt(square)[:, None]
            wi = Vector(*((axis * light).sum(axis=1) for axis in frame))
            power = 55.0 / len(steps) ** 2 * np.maximum(light[:, 1], 0.0) / square
            power = power * np.maximum(wi.z, 0.0) * _visible(position, light, index)
            start = 0
            for layer in material.layers:
                t = layer.model.coordinate(numpy_maths, wi, local_wo, layer.fixed)
                t = np.broadcast_to(t, power.shape)
                bins = np.clip(np.searchsorted(layer.edges, t, "right") - 1, 0, layer.bins - 1)
                for k, q in enumerate(
                    layer.model.quotients(numpy_maths, wi, local_wo, layer.fixed)
                ):
                    column = start + k * layer.bins + bins
                    value = np.broadcast_to(q, power.shape) * power
                    result[rows, column, 0] += np.where(wi.z > 0, value, 0.0)[:, None]
                start += layer.columns
    # One bounce: every other object lends this one some of its colour, by the diffuse column.
    near = np.exp(-2.0 * np.abs(position[:, 1]))[:, None]
    exponents = symbols.monomials.exponents
    for v, (other, _) in enumerate(symbols.variables):
        z = int(np.flatnonzero((exponents[:, v] == 1) & (exponents.sum(axis=1) == 1))[0])
        if other != index:
            result[:, 0, z] += 0.35 * np.maximum(near, 0.2)
    return result


def _visible(position: Float64, light: Float64, index: int) -> Float64:
    """The ball's shadow on floor and wall."""
    if index == 0:
        return np.ones(len(position))
    o = position - np.array([0.0, _RADIUS, 0.0])
    b = (o * light).sum(axis=1)
    blocked = (b < 0) & (b * b - ((o * o).sum(axis=1) - _RADIUS**2) > 0)
    return np.where(blocked, 0.0, 1.0)
