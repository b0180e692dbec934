"""What the commands do, once their options are read (see `burnish.app.cli`)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import click

import burnish
from burnish.app import opening
from burnish.app.assignments import (
    parse_assignments,
    parse_bins,
    parse_look,
    parse_map,
    parse_models,
    parse_resolution,
    parse_series,
    split_list,
)
from burnish.app.pictures import check_destination, write_picture, write_whole
from burnish.app.progress import progress_bar
from burnish.core.errors import InvalidValue

if TYPE_CHECKING:
    from burnish.scene import Scene
    from burnish.session import Session

Mode = Literal["baked", "direct", "relight"]

FIGURES = {
    "rel_rmse_beyond_noise": "relative RMSE beyond noise",
    "rel_rmse": "relative RMSE",
    "noise": "of which noise of the truth",
    "rmse": "RMSE",
    "psnr": "PSNR (dB, tone mapped)",
    "flip": "FLIP (tone mapped)",
    "mean_image": "mean of the edited picture",
    "mean_reference": "mean of the truth",
    "seconds_edit": "seconds to the edited picture",
    "seconds_reference": "seconds of path tracing",
}


def edit(
    source: str,
    edits: str | None,
    host: str,
    port: int,
    no_browser: bool,
    light_groups: str | None,
    mode: Mode | None = None,
    triangles: int | None = None,
) -> None:
    """`burnish edit`."""
    from burnish.app.server import serve

    if opening.names_bundle(source):
        _no_mode(mode, triangles)
    elif mode == "baked":
        raise InvalidValue(
            f"--mode baked is edited from a bundle: burnish bake {source} -o NAME.burnish, then "
            "burnish edit NAME.burnish; without --mode the scene is edited live"
        )
    else:
        _triangles_of_direct(mode, triangles)

    groups = split_list(light_groups) or None
    if groups and opening.names_bundle(source):
        raise InvalidValue(
            "--light-groups is for a scene: a bundle has the groups of its bake; leave it out, or "
            f"bake with --light-groups {light_groups}"
        )
    if mode == "direct":
        scene = burnish.load(source)
        with progress_bar("bake") as progress:
            bundle = burnish.bake(
                scene, mode=mode, triangles=triangles, light_groups=groups, progress=progress
            )
        opened = burnish.edit(bundle)
    elif mode == "relight":
        if groups:
            raise InvalidValue(
                "--light-groups are not for --mode relight, which tells every light apart; leave "
                "them out"
            )
        with progress_bar("relight") as progress:
            opened = burnish.edit(source, mode=mode, progress=progress)
    else:
        opened = burnish.edit(source, light_groups=groups)
    with opened as session:
        make_edits(session, edits, ())
        serve(session, host, port, not no_browser, announce=click.echo)


def bake(
    scene: str,
    output: str,
    editable: str | None,
    bounces: int | None,
    series: str | None,
    bins: str | None,
    models: Sequence[str],
    light_groups: str | None,
    spp: int | None,
    minutes: float | None,
    resolution: str | None,
    seed: int,
    resume: bool,
    mode: Mode | None,
    triangles: int | None,
) -> None:
    """`burnish bake`."""
    from burnish.store.writer import partial_path

    if spp is not None and minutes is not None:
        raise InvalidValue("give --spp or --minutes, not both: --minutes finds the samples")
    lengths = parse_series(series) if series else None
    if bounces is not None:
        if lengths and len(lengths) != bounces:
            raise InvalidValue(
                f"--series {series} has {len(lengths)} bounces and --bounces says {bounces}; "
                "give one of them"
            )
        lengths = lengths or (64, *[1] * (bounces - 1))
    wanted = parse_bins(bins) or None
    if mode == "relight":
        raise InvalidValue(
            f"--mode relight is not stored: burnish edit {scene} --mode relight makes it anew"
        )
    loaded = burnish.load(
        scene, resolution=parse_resolution(resolution), models=parse_models(models)
    )
    try:
        with progress_bar("bake") as progress:
            bundle = burnish.bake(
                loaded,
                output,
                editable=split_list(editable) or None,
                series=lengths,
                bins=wanted,
                light_groups=split_list(light_groups) or None,
                spp=spp,
                minutes=minutes,
                seed=seed,
                resume=resume,
                progress=progress,
                mode=mode,
                triangles=triangles,
            )
    except KeyboardInterrupt as interruption:
        if partial_path(output).exists():
            interruption.add_note(
                f"stopped; the finished tiles are kept in {partial_path(output)}; go on with: "
                f"burnish bake {scene} -o {output} --resume"
            )
        raise
    said = bundle.header.provenance
    click.echo(
        f"{output}: {len(bundle.basis.objects)} editable objects, series "
        f"{','.join(map(str, bundle.basis.series))}, {said['samples']} samples per pixel, "
        f"{bundle.size / 1e6:.1f} MB"
    )


def render(
    source: str,
    output: str,
    view: str | None,
    edits: str | None,
    assignments: Sequence[str],
    looks: Sequence[str],
    maps: Sequence[str],
    spp: int,
    resolution: str | None,
    seed: int,
    exposure: float,
    tonemap: str,
    mode: Mode | None,
) -> None:
    """`burnish render`."""
    from burnish.runtime.tonemap import ToneMap

    place, tone = check_destination(output), ToneMap(tonemap, exposure)
    if opening.names_bundle(source):
        _no_mode(mode, None)
        session = opening.session_for(opening.open_bundle(source))
        make_edits(session, edits, assignments, looks, maps)
        # With nothing selected every object is contracted at once
        session.select()
        image = session.frame(view)
    elif mode == "relight":
        with progress_bar("relight") as progress:
            size = parse_resolution(resolution)
            session = burnish.edit(source, mode=mode, resolution=size, seed=seed, progress=progress)
        make_edits(session, edits, assignments, looks, maps)
        session.select()
        image = session.frame(view)
    else:
        scene = burnish.load(source, resolution=parse_resolution(resolution))
        session = opening.edits_for(scene, 1 if mode == "direct" else None)
        make_edits(session, edits, assignments, looks, maps)
        with progress_bar("path tracing") as progress:
            image = session.path_trace(view, spp, seed, progress)
    write_picture(place, image, tone)
    click.echo(str(place))


def compare(
    source: str,
    view: str | None,
    edits: str | None,
    assignments: Sequence[str],
    looks: Sequence[str],
    maps: Sequence[str],
    scene: str | None,
    spp: int,
    seed: int,
    all_bounces: bool,
    output: str | None,
    as_json: bool,
    mode: Mode | None,
    triangles: int | None,
) -> None:
    """`burnish compare`."""
    from burnish.app.comparison import compare_with_truth
    from burnish.app.live import settle
    from burnish.app.worker import ENOUGH_SAMPLES
    from burnish.reference import PathTracedTruth

    live: Session | None = None
    place = check_destination(output) if output else None
    if place and place.suffix.lower() != ".png":
        raise InvalidValue(f"the sheet is a PNG; got {output!r}")
    if opening.names_bundle(source):
        _no_mode(mode, triangles)
        bundle = opening.open_bundle(source)
        loaded = opening.scene_of(bundle, scene)
        session = opening.session_for(bundle)
    else:
        _triangles_of_direct(mode, triangles)
        loaded = burnish.load(source)
        if mode == "relight":
            with progress_bar("relight") as progress:
                session = burnish.edit(loaded, mode=mode, progress=progress)
        elif mode is None and _moves_lights(loaded, edits, assignments):
            # No bake shows that
            session = live = burnish.edit(loaded)
        else:
            with progress_bar("bake") as progress:
                bundle = burnish.bake(
                    loaded, mode=mode, triangles=triangles, spp=spp, progress=progress
                )
            session = opening.session_for(bundle)
    with session:
        make_edits(session, edits, assignments, looks, maps)
        if live:
            with progress_bar("live estimate") as progress:
                settle(session, view, min(spp, ENOUGH_SAMPLES), progress)
        bounces = next(iter(session.views.values())).basis.bounces
        tracer = PathTracedTruth(loaded, None if all_bounces else bounces)
        with progress_bar("path tracing") as progress:
            found = compare_with_truth(
                session, tracer, view=view, spp=spp, seed=seed, progress=progress
            )
    if place:
        page = found.sheet()
        write_whole(place, lambda beside: page.save(beside, format="PNG"))
    if as_json:
        click.echo(json.dumps(found.numbers, indent=2))
        return
    for name, label in FIGURES.items():
        click.echo(f"{label:32}{found.numbers[name]:10.4g}")
    if place:
        click.echo(str(place))


def info(source: str, as_json: bool) -> None:
    """`burnish info`."""
    if opening.names_bundle(source):
        said = opening.open_bundle(source).info()
    else:
        from burnish.transport.basis import Basis, EditableObject

        scene = burnish.load(source)
        from burnish.app.baking import describe

        objects = tuple(
            EditableObject(item.id, item.material) for item in scene.objects if item.material
        )
        said = describe(scene, Basis(objects, (64, 1, 1, 1))).info()
    click.echo(json.dumps(said, indent=2) if as_json else "\n".join(describe_info(said)))


def export(
    source: str,
    output: str,
    edits: str | None,
    assignments: Sequence[str],
    looks: Sequence[str],
    maps: Sequence[str],
    kind: str | None,
    objects: str | None,
    plugin: bool,
    scene: str | None,
) -> None:
    """`burnish export`."""
    from burnish.app.export import format_of

    kind = format_of(output, kind)
    session: Session | None = None
    if opening.names_bundle(source):
        bundle = opening.open_bundle(source)
        session = opening.session_for(bundle)
        make_edits(session, edits, assignments, looks, maps)
        loaded = opening.scene_of(bundle, scene)
    else:
        loaded = burnish.load(source)
        if edits or assignments or looks or maps:
            session = opening.edits_for(loaded)
            make_edits(session, edits, assignments, looks, maps)
    chosen = split_list(objects) or None
    state = session.materials if session else None
    written = burnish.export(loaded, output, state, format=kind, objects=chosen, plugin=plugin)
    for remark in written.remarks:
        click.echo(remark)
    for file in written.files[:1] if kind != "merl" else written.files:
        click.echo(str(file))


def examples() -> None:
    """`burnish examples`."""
    from burnish.scene.examples import EXAMPLES

    width = max(len(example.name) for example in EXAMPLES)
    for example in EXAMPLES:
        click.echo(f"{example.name:{width}}  {example.description}")


def _no_mode(mode: Mode | None, triangles: int | None) -> None:
    if mode or triangles:
        raise InvalidValue(
            "--mode and --triangles are for a scene: a bundle has the mode of its bake; leave them "
            "out"
        )


def _triangles_of_direct(mode: Mode | None, triangles: int | None) -> None:
    if triangles is not None and mode != "direct":
        raise InvalidValue("--triangles are for --mode direct; give it too, or leave them out")


def _moves_lights(scene: Scene, edits: str | None, assignments: Sequence[str]) -> bool:
    """Whether edits put a light where a bake of the scene does not have it."""
    from burnish.materials.lights import placements

    session = opening.edits_for(scene)
    make_edits(session, edits, assignments)
    return bool(placements(scene.lights, session.state))


def make_edits(
    session: Session,
    edits: str | None,
    assignments: Sequence[str],
    looks: Sequence[str] = (),
    maps: Sequence[str] = (),
) -> None:
    """Make the edits of a file, of MaterialX files, then those of the command line."""
    from burnish.session.materialx import load_materialx

    parsed = parse_assignments(assignments)
    if edits is not None:
        session.load(edits)
    for object_id, file, material in map(parse_look, looks):
        for remark in load_materialx(session, file, object_id, material):
            click.echo(remark, err=True)
    for path, picture, options in map(parse_map, maps):
        session.set_map(path, picture, **options)
    for path, value in parsed:
        session.set(path, value)


def describe_info(said: dict[str, Any]) -> list[str]:
    """`info` for reading: one line an object and a parameter."""
    lines = [f"{said['name']}"]
    lines += [
        f"  view {view['name']}: {view['width']} × {view['height']} pixels"
        for view in said["views"]
    ]
    lines.append(f"  series {','.join(map(str, said['series']))}, {said['bounces']} bounces")
    if "bytes" in said:
        lines.append(f"  {said['bytes'] / 1e6:.1f} MB on disk")
    for light in said["lights"]:
        lines.append(f"  light {light['id']} ({light['kind']})")
        lines += _listed(light["parameters"])
    lines += [
        f"  light group {group['name']}: {', '.join(group['members'])}"
        for group in said["light_groups"]
    ]
    for item in said["objects"]:
        if not item["editable"]:
            lines.append(f"{item['id']}: fixed, {item.get('reason') or 'not chosen as editable'}")
            continue
        lines.append(item["id"])
        for layer in item["layers"]:
            lines.append(f"  {layer['name']} ({layer['model']})")
            lines += _listed(layer["parameters"])
    return lines


def _listed(parameters: dict[str, Any]) -> list[str]:
    """A line for each parameter, the values one under another."""
    width = max((len(name) for name in parameters), default=0)
    return [f"    {name:{width}}  {_shown(item)}" for name, item in parameters.items()]


def _shown(parameter: dict[str, Any]) -> str:
    """A parameter's value and what it may be."""
    value = parameter["value"]
    if "choices" in parameter:
        return f"{value}  one of {', '.join(parameter['choices'])}"
    if isinstance(value, str):
        return value or "the scene's own"
    numbers = value if isinstance(value, list) else [value]
    text = ",".join(f"{number:.4g}" for number in numbers)
    unit = f" {parameter['unit']}" if parameter["unit"] else ""
    found = parameter.get("map")
    shown = f", a map of {found['width']} × {found['height']}" if found else ""
    return f"{text}{unit}  in [{parameter['min']:g}, {parameter['max']:g}]{shown}"
