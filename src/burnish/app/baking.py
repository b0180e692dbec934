"""A bake from start to finish: plan, trace tile by tile, store, resume."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from burnish.core.errors import InvalidValue, MissingFile
from burnish.core.types import Float32, Progress
from burnish.core.version import __version__
from burnish.materials.lights import Light
from burnish.precompute.bake import ViewPlan, plan_views, strata, trace_tile
from burnish.precompute.direct.bake import DirectPlan, gather_tile
from burnish.precompute.pilot import samples_for
from burnish.runtime.freeze import BakedTransport
from burnish.runtime.renderer import Renderer
from burnish.scene import Scene
from burnish.scene.examples import EXAMPLES
from burnish.store.bundle import Bundle, StoredView, open_bundle
from burnish.store.header import BundleHeader, ObjectHeader, ViewHeader
from burnish.store.writer import BundleWriter, partial_path
from burnish.transport.basis import Basis, initial_state
from burnish.transport.compression import DEFAULT_TOLERANCE

DEFAULT_SAMPLES = 256
DIRECT_TOLERANCE = 0.02
"""Of the scaled entries of blocks, see `direct.compress`: what is gathered has little noise."""

PREVIEW_SIDE = 256
"""Pixels of the longer side of a bundle's preview, at most."""


def bake(
    scene: Scene,
    basis: Basis | None,
    path: str | Path,
    *,
    spp: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    resume: bool = False,
    progress: Progress | None = None,
    tolerance: float | None = None,
    triangles: int | None = None,
    mode: str | None = None,
) -> Bundle:
    """Trace every tile of every view into the bundle at `path`, and open it.

    basis: what stays symbolic; None, when resuming, for that of the unfinished bake.
    spp: samples per pixel, rounded up to whole strata (256 without `minutes`).
    minutes: spend about this long instead; a timed pilot fixes the samples of all tiles.
    resume: go on with the unfinished bake of `path`, whose settings hold; other ones are
      refused. tolerance: of the compression, relative; as fits the mode without it.
    triangles: mode `direct`, with the environment as so many triangle lights; spp is of what is
      traced all the same. mode: when resuming, the one that the bake was begun in; any without
      it.
    An interrupted bake keeps its finished tiles in `partial_path(path)`.

    Raises InvalidValue, TooLarge before anything is traced, MissingFile for the folder,
    BundleError, CannotWrite when the disk is full.
    """
    started = time.perf_counter()
    place = Path(path)
    if spp is not None and minutes is not None:
        raise InvalidValue("give spp or minutes, not both: minutes finds the samples by itself")
    if triangles is not None and minutes is not None:
        raise InvalidValue("minutes is not for direct light, whose lights are gathered one by one")
    if not place.absolute().parent.is_dir():
        raise MissingFile(
            f"output folder {str(place.parent)!r} does not exist; make it first: "
            f"mkdir -p {place.parent}"
        )
    direct: DirectPlan | None = None
    if resume:
        writer = BundleWriter.resume(place)
        basis = _resumed_basis(writer.header, scene, basis, spp, seed, triangles, mode)
        plans = plan_views(scene, basis, int(writer.header.provenance["seed"]))
    else:
        if basis is None:
            raise InvalidValue("a new bake needs a basis; `burnish.bake` makes one")
        plans = plan_views(scene, basis, seed)
        direct = _direct(scene, basis, triangles)
        samples = spp or DEFAULT_SAMPLES
        if tolerance is None:
            tolerance = DIRECT_TOLERANCE if direct else DEFAULT_TOLERANCE
        if minutes is not None:
            samples = samples_for(plans, started + 60 * minutes, seed, tolerance)
        header = describe(scene, basis, plans, place, samples, seed, tolerance)
        if direct:
            said = {**header.provenance, **direct.described()}
            header = replace(header, provenance=said)
        writer = BundleWriter.create(place, header)

    if resume and writer.header.provenance.get("mode") == "direct":
        direct = _direct(scene, basis, int(writer.header.provenance["triangles"]))
    _trace(writer, plans, direct, progress)
    writer.close(_preview(partial_path(place), writer.header))
    return open_bundle(place)


def describe(
    scene: Scene,
    basis: Basis,
    plans: Sequence[ViewPlan] = (),
    path: Path | None = None,
    samples: int = 0,
    seed: int = 0,
    tolerance: float = DEFAULT_TOLERANCE,
) -> BundleHeader:
    """The header of a bake of this scene; without plans, of the views untraced."""
    tiles = {plan.name: tuple((t.x, t.y, t.width, t.height) for t in plan.tiles) for plan in plans}
    provenance: dict[str, Any] = {
        "scene": scene_reference(scene, path),
        "scene_hash": scene.hash,
        "burnish": __version__,
    }
    if models := scene.request.options.get("models"):
        provenance["models"] = dict(models)
    if plans:
        provenance |= {"samples": sum(strata(samples)), "seed": seed, "tolerance": tolerance}
    return BundleHeader(
        basis=basis,
        views=tuple(
            ViewHeader(view.name, view.width, view.height, tiles.get(view.name, ()))
            for view in scene.views
        ),
        objects=tuple(ObjectHeader(item.id, item.editable, item.reason) for item in scene.objects),
        provenance=provenance,
        name=scene.name,
        lights=tuple(Light(light.name, light.kind, light.parameters) for light in scene.lights),
    )


def scene_reference(scene: Scene, bundle: Path | None) -> str | None:
    """How the scene is found again: a file, relative to the bundle's folder, or an example.

    None for a dictionary.
    """
    if scene.source is not None:
        folder = bundle.absolute().parent if bundle else Path.cwd()
        return os.path.relpath(scene.source.absolute(), folder)
    return scene.name if any(example.name == scene.name for example in EXAMPLES) else None


def _direct(scene: Scene, basis: Basis, triangles: int | None) -> DirectPlan | None:
    """The lights of mode `direct`. Raises InvalidValue, SceneError."""
    if triangles is None:
        return None
    if basis.bounces != 1:
        raise InvalidValue(
            f"direct light has one bounce, and the series {basis.bounces}: give one number, like "
            "256"
        )
    return DirectPlan.of(scene, basis, triangles)


def _resumed_basis(
    header: BundleHeader,
    scene: Scene,
    basis: Basis | None,
    spp: int | None,
    seed: int,
    triangles: int | None,
    mode: str | None,
) -> Basis:
    """The basis of the unfinished bake, once it is known to be of this scene and these wishes."""
    begun = header.provenance
    if begun["scene_hash"] != scene.hash:
        raise InvalidValue(
            f"scene {scene.name!r} has changed since this bake began; bake it anew without --resume"
        )
    if mode not in (None, begun.get("mode", "baked")):
        raise InvalidValue(
            f"the unfinished bake has mode '{begun.get('mode', 'baked')}'; got {mode!r}: leave the "
            "mode out to go on with its own"
        )
    if basis is not None and basis_json(basis) != basis_json(header.basis):
        raise InvalidValue(
            "the unfinished bake has other editable objects, series or bins; leave those "
            "options out to go on with its own"
        )
    if triangles is not None and triangles != begun.get("triangles"):
        raise InvalidValue(
            f"the unfinished bake has {begun.get('triangles', 'no')} triangles; leave the mode and "
            "the triangles out to go on with its own"
        )
    other_samples = spp is not None and sum(strata(spp)) != begun["samples"]
    if other_samples or seed not in (0, begun["seed"]):
        raise InvalidValue(
            f"the unfinished bake has {begun['samples']} samples per pixel and seed "
            f"{begun['seed']}; leave those options out to go on with its own"
        )
    return header.basis


def basis_json(basis: Basis) -> dict[str, Any]:
    """A basis as plain values, which compare by what they say."""
    return BundleHeader(basis, ()).to_json()


def _trace(
    writer: BundleWriter,
    plans: Sequence[ViewPlan],
    direct: DirectPlan | None,
    progress: Progress | None,
) -> None:
    """Trace what is missing; progress counts pixels, since all have the same samples."""
    settings = writer.header.provenance
    samples, seed = int(settings["samples"]), int(settings["seed"])
    tolerance = float(settings["tolerance"])
    work = [(plan, number) for plan in plans for number in range(len(plan.tiles))]
    finished = {plan.name: writer.finished(plan.name) for plan in plans}
    total = sum(plan.tiles[number].width * plan.tiles[number].height for plan, number in work)
    done = 0
    for position, (plan, number) in enumerate(work):
        area = plan.tiles[number].width * plan.tiles[number].height

        def report(part: float, before: int = done, area: int = area, at: int = position) -> None:
            if progress:
                progress((before + part * area) / total, f"tile {at + 1} of {len(work)}")

        report(0.0)
        if number not in finished[plan.name]:
            if direct:
                tile = gather_tile(direct, plan, number, samples, seed, tolerance, report)
            else:
                tile = trace_tile(plan, number, samples, seed, tolerance)
            writer.write_tile(plan.name, number, tile)
        done += area
    if progress:
        progress(1.0, "done")


def _preview(folder: Path, header: BundleHeader) -> Float32:
    """A small picture of the first view: float32 [h, w, 3], linear RGB."""
    view = header.views[0]
    source = StoredView(folder / "views" / view.name, view, header.basis)
    state = initial_state(header.basis.objects)
    picture = Renderer(BakedTransport(source).freeze((), state)).image(state)
    # Average whole squares of pixels; what is left at the edges goes
    side = max(1, -(-max(picture.shape[:2]) // PREVIEW_SIDE))
    height, width = picture.shape[0] // side, picture.shape[1] // side
    squares = picture[: height * side, : width * side].reshape(height, side, width, side, 3)
    return np.asarray(squares.mean(axis=(1, 3)), np.float32)
