"""burnish: edit materials in the finished scene, with every bounce of light answering.

>>> import burnish
>>> scene = burnish.load("cornell-box")                              # doctest: +SKIP
>>> bundle = burnish.bake(scene, series=(64, 1, 1, 1), spp=256)      # doctest: +SKIP
>>> session = burnish.edit(bundle)                                   # doctest: +SKIP
>>> session.set("back.diffuse.color", (0.6, 0.1, 0.1))               # doctest: +SKIP
>>> image = session.frame()                                          # doctest: +SKIP
>>> truth = burnish.path_trace(scene, session.materials, spp=1024)   # doctest: +SKIP

Importing burnish imports no ray tracer; the functions here do, when they need one. Bad
input raises a `burnish.core.errors.BurnishError` whose message says what to do.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from burnish.core.errors import BurnishError, InvalidValue
from burnish.core.version import __version__

if TYPE_CHECKING:
    from burnish.app.comparison import Comparison
    from burnish.app.export import Exported
    from burnish.core.types import Float32, Progress
    from burnish.materials.layer import Material
    from burnish.scene import Scene
    from burnish.session import Fit, FitOptions, FitStep, Session
    from burnish.store.bundle import Bundle
    from burnish.transport.basis import State

__all__ = [
    "BurnishError",
    "__version__",
    "bake",
    "compare_with_truth",
    "edit",
    "export",
    "fit",
    "fit_steps",
    "load",
    "load_materialx",
    "mitsuba_plugin",
    "open_bundle",
    "path_trace",
]

DIRECT_TRIANGLES = 4000
"""Triangle lights of a bake of direct light for which no number is given."""


def load(
    scene: str | Path | Mapping[str, Any],
    editable: Sequence[str] | None = None,
    variant: str | None = None,
    *,
    resolution: tuple[int, int] | None = None,
    by_bsdf: bool = False,
    materials: Mapping[str, Material] | None = None,
    models: Mapping[str, str] | None = None,
    **parameters: object,
) -> Scene:
    """Load a scene: a Mitsuba 3 XML file, a Mitsuba dictionary or an example's name.

    editable: ids of the objects to keep editable, all that can be without it. variant:
    Mitsuba variant, chosen by itself without it. resolution: width and height in pixels
    instead of the films' own. by_bsdf: one object for all shapes that share a BSDF.
    materials: by object id, materials to give objects in place of what the scene says. models:
    by "object.layer", reflectance models to give layers, such as "cook-torrance-curves".
    parameters: values for `$name` in the file.

    >>> scene = burnish.load("kitchen.xml", resolution=(640, 360))   # doctest: +SKIP
    >>> [item.id for item in scene.editable()]                       # doctest: +SKIP

    Raises MissingFile, SceneError with the place in the file, UnknownName, DeviceError,
    MissingRayTracer.
    """
    from burnish.scene import load

    return load(
        scene,
        editable,
        variant,
        resolution=resolution,
        by_bsdf=by_bsdf,
        materials=materials,
        models=models,
        **parameters,
    )


def bake(
    scene: Scene,
    path: str | Path | None = None,
    *,
    editable: Sequence[str] | None = None,
    mode: Literal["baked", "direct"] | None = None,
    series: Sequence[int] | None = None,
    bins: Mapping[str, int] | None = None,
    light_groups: Sequence[str] | None = None,
    spp: int | None = None,
    minutes: float | None = None,
    triangles: int | None = None,
    seed: int = 0,
    resume: bool = False,
    progress: Progress | None = None,
) -> Bundle:
    """Trace a scene once, so that its materials can be edited from then on.

    path: where the bundle goes; a temporary one, gone with the process, without it.
    mode: "direct" for direct light alone, gathered from the environment as `triangles` lights
    (4,000 without it; 400 for a preview) rather than traced: reference quality, with as many as
    256 bins. series: bins per bounce from the eye, (64, 1, 1, 1) without it, (256,) in mode
    "direct". bins: other numbers of bins by object id or "object.layer". light_groups: lights
    to tell apart, so that material edits under a changed mix need no tracing: names,
    "name=light+light", or ("each",); up to four with the one of all others, and the bundle
    grows by as many times. spp: samples per pixel, 256 without `minutes`, which spends about
    that long instead. resume: go on with an interrupted bake of the same path, with its
    settings. progress: called with the fraction done and what is being done.

    >>> burnish.bake(scene, "out.burnish", series=(128, 8, 1), minutes=20)   # doctest: +SKIP

    Raises InvalidValue, UnknownName, TooLarge before anything is traced, BundleError,
    CannotWrite.
    """
    from burnish.app.baking import bake
    from burnish.precompute.plan import basis_for

    if path is None:
        import atexit
        import shutil
        import tempfile

        folder = tempfile.mkdtemp(prefix="burnish-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        path = Path(folder) / f"{scene.name}.burnish"
    chosen = any(option is not None for option in (editable, series, bins, light_groups))
    if mode not in (None, "baked", "direct"):
        raise InvalidValue(f"mode must be 'baked' or 'direct'; got {mode!r}")
    if triangles is not None and mode != "direct":
        raise InvalidValue("triangles are for mode 'direct': give it too, or leave them out")
    usual = (256,) if mode == "direct" else (64, 1, 1, 1)
    basis = basis_for(scene, editable, series or usual, bins, light_groups or ())
    if mode == "direct" and triangles is None and not resume:
        triangles = DIRECT_TRIANGLES
    return bake(
        scene,
        basis if chosen or not resume else None,
        path,
        spp=spp,
        minutes=minutes,
        seed=seed,
        resume=resume,
        progress=progress,
        triangles=triangles,
        mode=mode,
    )


def open_bundle(path: str | Path) -> Bundle:
    """Open what `bake` wrote; needs no ray tracer.

    >>> burnish.open_bundle("out.burnish").info()["series"]          # doctest: +SKIP

    Raises MissingFile, BundleError.
    """
    from burnish.app.opening import open_bundle

    return open_bundle(path)


def edit(source: Bundle | Scene | str | Path, **options: Any) -> Session:
    """Begin editing: a bundle, with no ray tracer, or a scene, live and with no bake.

    source: a bundle or the path of one; a scene, its file or an example's name. A scene is
    traced by a process of its own, which `session.close()` ends. options: for a scene that
    is named, what `load` takes, `series`, and `light_groups` as for `bake`: the estimate then
    has room for each group, and materials are exact under any mix while they are edited.
    mode: "direct" bakes direct light first, with what `bake` takes for it; "relight" traces
    first how light goes from surface to surface; lights then move, aim and change as materials
    do, with direct light exact and one glossy bounce before the matte ones (`samples`: gather
    samples, 16,384 without it; `series`).

    >>> session = burnish.edit("out.burnish")                        # doctest: +SKIP
    >>> session.set("teapot.specular.roughness", 0.12)               # doctest: +SKIP
    >>> with burnish.edit("teatray", resolution=(512, 384)) as live: # doctest: +SKIP
    ...     live.set("teapot.specular.roughness", 0.12)
    ...     image = live.frame()

    Raises MissingFile, BundleError, and what `load` raises.
    """
    from burnish.app.opening import names_bundle, session_for
    from burnish.store.bundle import Bundle

    if isinstance(source, (str, Path)) and names_bundle(source):
        return session_for(open_bundle(source))
    if isinstance(source, Bundle):
        return session_for(source)
    mode = options.pop("mode", None)
    if mode not in (None, "direct", "relight"):
        raise InvalidValue(
            f"mode must be 'direct' or 'relight'; got {mode!r}: leave it out to edit "
            "live, or edit what burnish.bake gives"
        )
    if mode == "direct":
        own = ("triangles", "progress", "series", "bins", "light_groups", "spp", "seed")
        asked = {name: options.pop(name) for name in own if name in options}
        if isinstance(source, (str, Path)):
            source = load(source, **options)
        elif options:
            source = load(source.request.scene, **{**source.request.options, **options})
        return session_for(bake(source, mode=mode, **asked))
    if mode == "relight":
        from burnish.app.relight import relight_session

        return relight_session(source, **options)
    from burnish.app.live import live_session

    if isinstance(source, (str, Path)):
        return live_session(source, **options)
    return live_session(source.request.scene, **{**source.request.options, **options})


def fit(
    session: Session,
    target: Float32,
    *,
    mask: Float32 | None = None,
    objects: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
    view: str | None = None,
    options: FitOptions | None = None,
) -> Fit:
    """Give a session the materials whose picture comes closest to a target, as one undo step.

    target: [height, width, 3], linear RGB (display colours with `options.tone`); a photograph,
    a painting, a rendering; NaN where nothing is asked. mask: [height, width], bool or
    weights. objects: whose materials may change; the selected ones, or all, without it.
    parameters: such as "diffuse.color", "ball.specular.roughness", "specular.curve"; all of
    layers that reflect something without it. options: `burnish.session.FitOptions`.

    >>> found = burnish.fit(session, photograph, objects=["teapot"])   # doctest: +SKIP
    >>> print(found.report())                                          # doctest: +SKIP

    Raises UnknownName, InvalidValue, TooLarge, and then changes nothing.
    """
    from burnish.session.fitting import fit

    return fit(
        session,
        target,
        mask=mask,
        objects=objects,
        parameters=parameters,
        view=view,
        options=options,
    )


def fit_steps(session: Session, target: Float32, **options: Any) -> Iterator[FitStep]:
    """The same, step by step, to show it on the way and to stop it; takes what `fit` takes.

    >>> with session.gesture():                                        # doctest: +SKIP
    ...     for step in burnish.fit_steps(session, target):
    ...         session.restore(step.state)

    The session's materials are left alone. The last step has a `result`.
    """
    from burnish.session.fitting import fit_steps

    return fit_steps(session, target, **options)


def path_trace(
    scene: Scene,
    materials: State | None = None,
    *,
    view: str | None = None,
    spp: int = 256,
    seed: int = 0,
    bounces: int | None = None,
    series: Sequence[int] | None = None,
    progress: Progress | None = None,
) -> Float32:
    """The truth: Mitsuba's path tracer on the scene with edited materials.

    materials: a session's `materials`; the scene's own without it. view: the first without a
    name. bounces: scattering events per path, all without a number; a bundle of series
    (64, 1, 1, 1) has 4. series: the series' own approximations instead (bins, equivalent
    albedos), for all objects in `materials`: what an endless bake would converge to.
    Returns float32 [height, width, 3], linear RGB.

    >>> burnish.path_trace(scene, session.materials, spp=1024)       # doctest: +SKIP

    Raises UnknownName, InvalidValue.
    """
    name = scene.view(view).name
    if series is not None:
        from burnish.reference.series import series_image

        initial = {
            item.id: item.material.initial for item in scene.editable() if item.material is not None
        }
        state = materials if materials is not None else initial
        return series_image(scene, state, series, name, spp, seed, progress=progress).image
    from burnish.reference.truth import PathTracedTruth

    return PathTracedTruth(scene, bounces).render(materials or {}, name, spp, seed, progress)


def export(
    scene: Scene,
    path: str | Path,
    materials: State | None = None,
    *,
    format: str | None = None,
    objects: Sequence[str] | None = None,
    plugin: bool = False,
) -> Exported:
    """Write a scene, or its materials, in a format that renderers read.

    path: .xml for Mitsuba 3, .mtlx for MaterialX (OpenPBR), .glb or .gltf, .binary for MERL;
    format: "mitsuba", "materialx", "glb", "gltf" or "merl" where the suffix does not say it.
    materials: a session's `materials`; the scene's own without it. objects: whose materials,
    all that are editable without it. plugin: let Mitsuba XML name burnish's own BSDF (see
    `burnish.mitsuba_plugin`) where no stock one holds a material. The result has the `files`
    and, as `remarks`, what the format could not hold.

    >>> burnish.export(scene, "look.xml", session.materials).remarks   # doctest: +SKIP

    Raises UnknownName, InvalidValue, MissingFile, CannotWrite.
    """
    from burnish.app.export import export

    return export(scene, path, materials, format=format, objects=objects, plugin=plugin)


def load_materialx(
    session: Session, path: str | Path, object: str | None = None, material: str | None = None
) -> list[str]:
    """Give an object the OpenPBR values of a MaterialX file, as one undo step.

    object: without it, every object that the file's look names. material: which of the file's,
    where it has several. Returns what could not be held, one line each.

    >>> burnish.load_materialx(session, "gold.mtlx", "teapot")         # doctest: +SKIP

    Raises MissingFile, InvalidValue, UnknownName.
    """
    from burnish.session.materialx import load_materialx

    return load_materialx(session, path, object, material)


def mitsuba_plugin() -> None:
    """Let the Mitsuba variant in use load the BSDF `burnish`, which exported scenes may name.

    >>> mitsuba.set_variant("llvm_ad_rgb")                             # doctest: +SKIP
    >>> burnish.mitsuba_plugin()                                       # doctest: +SKIP
    >>> scene = mitsuba.load_file("look.xml")                          # doctest: +SKIP

    Raises MissingRayTracer.
    """
    from burnish.reference import layered_class

    layered_class()


def compare_with_truth(
    session: Session,
    scene: Scene,
    *,
    view: str | None = None,
    spp: int = 256,
    seed: int = 1,
    bounces: int | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Hold a session's picture against the path tracer given the same materials.

    Takes what `path_trace` takes. The result has both pictures, their figures and a sheet:

    >>> found = burnish.compare_with_truth(session, scene, bounces=4)   # doctest: +SKIP
    >>> found.numbers["rel_rmse_beyond_noise"]                          # doctest: +SKIP
    >>> found.sheet().save("sheet.png")                                 # doctest: +SKIP
    """
    from burnish.app.comparison import compare_with_truth
    from burnish.reference.truth import PathTracedTruth

    return compare_with_truth(
        session,
        PathTracedTruth(scene, bounces),
        view=view,
        spp=spp,
        seed=seed,
        progress=progress,
    )
