"""`make demo`: bake the Cornell box, make three edits, hold the last one against the truth."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import click

import burnish
from burnish.app.assignments import make_edit
from burnish.app.cli import exit_code
from burnish.app.pictures import write_picture, write_whole
from burnish.app.progress import progress_bar
from burnish.core.types import Value

EDITS: tuple[tuple[str, dict[str, Value]], ...] = (
    ("red-back-wall", {"back.diffuse.color": (0.62, 0.12, 0.08)}),
    (
        "polished-floor",
        {
            "floor.diffuse.color": (0.25, 0.25, 0.25),
            "floor.specular.weight": 1.0,
            "floor.specular.color": (0.5, 0.5, 0.5),
            "floor.specular.exponent": 600.0,
        },
    ),
    (
        "golden-box",
        {
            "large-box.diffuse.color": (0.06, 0.04, 0.01),
            "large-box.specular.weight": 1.0,
            "large-box.specular.color": (0.85, 0.6, 0.25),
            "large-box.specular.exponent": 150.0,
        },
    ),
)
"""What is edited, one on top of the other."""


def demo(folder: Path, side: int, spp: int, truth_spp: int) -> None:
    """Bake, edit and compare, and write what comes out into `folder`.

    side: pixels of a side of the square pictures. spp: of the bake; truth_spp: of the path
    tracer.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scene = burnish.load("cornell-box", resolution=(side, side))
    with progress_bar("baking the Cornell box") as progress:
        bundle = burnish.bake(scene, folder / "cornell-box.burnish", spp=spp, progress=progress)
    click.echo(f"baked {len(bundle.basis.objects)} editable objects, {bundle.size / 1e6:.0f} MB\n")

    session = burnish.edit(bundle)
    write_picture(folder / "0-as-it-was.png", session.frame())
    for number, (name, settings) in enumerate(EDITS, start=1):
        with session.gesture():
            for path, value in settings.items():
                make_edit(session, path, value)
        start = time.perf_counter()
        first = session.frame()
        frozen = time.perf_counter()
        session.frame()
        again = time.perf_counter()
        write_picture(folder / f"{number}-{name}.png", first)
        click.echo(
            f"{name.replace('-', ' ')}: {frozen - start:.2f} s to its first picture, "
            f"{1000 * (again - frozen):.0f} ms for each one after"
        )
    session.save(folder / "edits.json")

    with progress_bar("path tracing the truth") as progress:
        found = burnish.compare_with_truth(
            session, scene, spp=truth_spp, bounces=bundle.basis.bounces, progress=progress
        )
    page = found.sheet()
    write_whole(folder / "comparison.png", lambda beside: page.save(beside, format="PNG"))
    click.echo(
        f"\nagainst {truth_spp} samples per pixel of Mitsuba's path tracer "
        f"({found.numbers['seconds_reference']:.0f} s): relative error "
        f"{found.numbers['rel_rmse_beyond_noise']:.3f} beyond the truth's own noise of "
        f"{found.numbers['noise']:.3f}\n"
    )
    for picture in sorted(folder.glob("*.png")):
        click.echo(f"  {picture}")
    click.echo(f"\nTry: burnish render {bundle.path} -o look.png --set left.diffuse.color=#2060c0")


def main() -> None:
    """Run the demo with the sizes of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("demo-output"))
    parser.add_argument("--side", type=int, default=256, help="pixels of a side")
    parser.add_argument("--spp", type=int, default=128, help="samples per pixel of the bake")
    parser.add_argument("--truth-spp", type=int, default=256, help="… of the path tracer")
    options = parser.parse_args()
    sys.exit(exit_code(lambda: demo(options.folder, options.side, options.spp, options.truth_spp)))


if __name__ == "__main__":
    main()
