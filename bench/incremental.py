"""Frames of a curve of 256 bins, plain and incremental, and curve switching (2006, §5.3, §6)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from bench.report import Goal, Report
from bench.timing import interleaved
from burnish.materials.curve import Curve
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.model import Model
from burnish.materials.models.ashikhmin_shirley_curves import AshikhminShirleyCurves
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.materials.models.lambert import Lambert
from burnish.runtime.drafts import Drafts
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import Basis, EditableObject, State, initial_state
from burnish.transport.block import Block
from burnish.transport.compression import column_scale
from burnish.transport.pack import Pack, TiledBlocks
from burnish.transport.rows import Rows

SQUARE = 8
METAL: dict[str, Any] = {
    "color": (1.0, 1.0, 1.0),
    "roughness": 0.1,
    "eta": (0.2, 0.92, 1.1),
    "k": (3.9, 2.45, 2.14),
}
BRUSHED: dict[str, Any] = {"color": (0.5, 0.5, 0.5), "exponent_u": 300.0, "exponent_v": 20.0}


def run(quick: bool) -> Report:
    """Frames and switches at the sizes of 2006, table 3."""
    size = 256 if quick else 512
    repeats = 12 if quick else 60
    rows, goals = [], []
    for share, rank in ((0.25, 16), (0.25, 40)):
        row = frames(size, share, rank, repeats)
        rows.append(row)
        fastest = max(row["plain fps"], row["draft fps"])
        goals.append(Goal(f"frames a second at rank {rank}, 256 bins", fastest, 120, at_least=True))
    for name, model, values, pixels in (
        (
            "Cook-Torrance 256/64",
            CookTorranceCurves(masking_terms=1, bins=256, bins2=64),
            METAL,
            7626,
        ),
        ("Ashikhmin-Shirley 128/128", AshikhminShirleyCurves(), BRUSHED, 17709),
    ):
        row = switching(name, model, values, pixels, 16 if quick else 4, max(3, repeats // 10))
        rows.append(row)
        goals.append(Goal(f"{name}: curve switch, s", row["switch s"], 0.1))
    notes = (
        f"Made-up blocks of {size}×{size} pixels, one bounce: a curve of 256 bins on a quarter of "
        "the picture, at the row ranks that direct light has in squares of 8×8. Plain frames "
        "contract all lit columns; drafts add 30 wavelets of 256 a channel (2006, §6); both draw a "
        "freehand drag, interleaved, and the whole frame is timed. `chosen` is what a session "
        "would use, by its own measurement of a piece. Switches contract the dormant curve of "
        "two-curve layers (eq. 26) of 2006, table 3, at row rank 24 of 64, measured on a share of "
        "the pixels and counted as many times."
    )
    return Report("incremental", "Incremental wavelets and curve switching", notes, rows, goals)


def frames(size: int, share: float, rank: int, repeats: int) -> dict[str, Any]:
    """Frames a second of a freehand drag, plain and as drafts."""
    source = made_up(BlinnPhong(), {"color": (0.5,) * 3, "exponent": 200.0}, size, share, rank, 256)
    start = initial_state(source.basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    drafts = Drafts(renderer)
    began = time.perf_counter()
    drafts.prepare(start)
    prepared = time.perf_counter() - began
    (choice,) = drafts.choices.values()
    forced = Drafts(renderer)
    forced.prepare(start, force=True)
    # Apart, so that neither finds kept what the other has just contracted
    turn = {"plain": 0, "draft": 1000}

    def dragged(kind: str, draw: Callable[[State], object]) -> Callable[[], object]:
        def frame() -> None:
            turn[kind] += 1
            draw(drawn(start, turn[kind]))

        return frame

    found = interleaved(
        {
            "plain": dragged("plain", renderer.image),
            "draft": dragged("draft", forced.image),
        },
        repeats,
    )
    draft, _ = forced.image(drawn(start, turn["draft"] + 1))
    exact = renderer.image(drawn(start, turn["draft"] + 1))
    return {
        "what": f"frame, {size}×{size}, rank {rank}",
        "core MB": sum(s.core.nbytes for s in source.stacks()) / 1e6,
        "plain fps": 1 / found["plain"],
        "draft fps": 1 / found["draft"],
        "draft / plain": found["draft"] / found["plain"],
        "draft error": float(np.linalg.norm(draft - exact) / np.linalg.norm(exact)),
        "prepare s": prepared,
        "chosen": "drafts" if choice.drafts else "plain",
    }


def drawn(state: State, frame: int) -> State:
    """A bump that someone drags along the curve of the lobe."""
    t = np.linspace(0.0, 1.0, 24) ** 1.5
    bump = np.exp(-(((t - 0.3 - 0.2 * np.sin(frame / 5)) / 0.1) ** 2))
    gain = np.repeat((1 + bump)[:, None], 3, axis=1)
    curve = Curve(tuple(t.tolist()), tuple(map(tuple, gain.tolist())))
    pot = state["pot"]
    layers = {**pot.layers, "specular": replace(pot.layers["specular"], curve=curve)}
    return {**state, "pot": MaterialState(layers)}


def switching(
    name: str, model: Model, values: dict[str, Any], pixels: int, share: int, repeats: int
) -> dict[str, Any]:
    """Seconds to switch to either curve and show a frame, and frames of a drag between.

    Measured on one in `share` of the pixels.
    """
    size = int(np.ceil(np.sqrt(pixels / share) / SQUARE)) * SQUARE
    source = made_up(model, values, size, 1.0, 24, 128)
    start = initial_state(source.basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    renderer.image(start)
    first, second = [], []
    ramp = ((0.0, 1.0), (1.0, 1.0, 1.0))
    for turn in range(repeats):
        level = 0.5 + turn / repeats
        curve = Curve(ramp[0], ((level,) * 3, ramp[1]))
        layers = dict(start["pot"].layers)
        layers["specular"] = replace(layers["specular"], second_curve=curve)
        changed = {**start, "pot": MaterialState(layers)}
        began = time.perf_counter()
        renderer.image(changed)
        second.append(time.perf_counter() - began)
        layers["specular"] = replace(layers["specular"], curve=curve)
        both = {**start, "pot": MaterialState(layers)}
        began = time.perf_counter()
        renderer.image(both)
        first.append(time.perf_counter() - began)
    drag = interleaved({"frame": lambda: renderer.image(both)}, repeats)
    core = sum(s.core.nbytes for s in source.stacks())
    taken = float(np.median(first + second))
    return {
        "what": name,
        "pixels": pixels,
        "core MB": core / 1e6 * pixels / size**2,
        "switch s": taken * pixels / size**2,
        "GB/s": core / taken / 1e9,
        "plain fps": 1 / drag["frame"],
    }


def made_up(
    model: Model, values: dict[str, Any], size: int, share: float, rank: int, bins: int
) -> TiledBlocks:
    """A view of random blocks: an object in the upper `share` of the picture."""
    rng = np.random.default_rng(1)
    layers = (
        Layer.starting_at("diffuse", Lambert(), {"color": (0.5, 0.5, 0.5)}),
        Layer.starting_at("specular", model, values, bins=bins),
    )
    states = {
        "diffuse": LayerState({"color": (0.5, 0.5, 0.5)}),
        "specular": LayerState({p.name: values[p.name] for p in model.parameters}),
    }
    basis = Basis((EditableObject("pot", Material(layers, MaterialState(states))),), (bins,))
    height = max(int(size * share) // SQUARE, 1) * SQUARE
    pixel = np.arange(height * size, dtype=np.int32)
    count = len(pixel)
    rows = Rows(
        pixel=pixel,
        object=np.zeros(count, np.int32),
        indirect=np.zeros(count, np.bool_),
        weight=np.ones(count, np.float32),
        position=np.zeros((count, 3), np.float32),
        normal=np.zeros((count, 3), np.float32),
        uv=np.zeros((count, 2), np.float32),
        cos_theta_o=np.full(count, 0.7, np.float32),
    )
    scale = column_scale(basis, 0)
    square = pixel // size // SQUARE * (size // SQUARE) + pixel % size // SQUARE
    order = np.argsort(square, kind="stable").astype(np.int32)
    packs = []
    for piece in basis.slices(0):
        columns = piece.stop - piece.start
        blocks = []
        for which in np.split(order, count // SQUARE**2):
            core = rng.standard_normal((rank, columns, 1, 3), np.float32)
            blocks.append(
                Block(
                    object=0,
                    indirect=False,
                    rows=which,
                    U=rng.standard_normal((len(which), rank), np.float32),
                    core=core.astype(np.float16),
                    S=np.ones((1, basis.tails), np.float32),
                    column_scale=scale[piece.start : piece.stop],
                    start=piece.start,
                )
            )
        packs.append(Pack.of(blocks))
    dark = np.zeros((size, size, 3), np.float32)
    return TiledBlocks(basis, size, size, rows, dark, dark, packs)
