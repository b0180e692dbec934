"""`make demo`: open the editor on an example, live.

With `--bake` instead: bake the Cornell box, make three edits, hold the last one against the
truth, and leave pictures.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from statistics import median

import click
import numpy as np

import burnish
from burnish.app import commands
from burnish.app.cli import exit_code
from burnish.app.pictures import write_picture, write_whole
from burnish.app.progress import progress_bar
from burnish.core.types import Float32, Value
from burnish.session import Session

EDITS: tuple[tuple[str, dict[str, Value]], ...] = (
    ("yellow-box", {"large-box.diffuse.color": (0.75, 0.55, 0.06)}),
    (
        "glossy-back-wall",
        {
            "back.diffuse.color": (0.3, 0.3, 0.3),
            "back.specular.weight": 1.0,
            "back.specular.color": (0.5, 0.5, 0.5),
            "back.specular.exponent": 400.0,
        },
    ),
    ("blue-left-wall", {"left.diffuse.color": (0.06, 0.14, 0.5)}),
)
"""What is edited, one on top of the other."""

STEPS = 12
"""Pictures of a drag."""


def editor(scene: str) -> None:
    """Open the editor on a scene with no bake, until Ctrl+C; its address is printed."""
    click.echo(f"opening {scene} ...")
    commands.edit(scene, None, "127.0.0.1", 0, no_browser=False, light_groups=None)


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
        picture, seconds = drag(session, settings)
        write_picture(folder / f"{number}-{name}.png", picture)
        click.echo(
            f"{name.replace('-', ' ')}: {seconds[0]:.2f} s to its first picture, then "
            f"{1000 * median(seconds[1:]):.0f} ms for each step of the drag"
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
    for path in sorted(folder.glob("*.png")):
        click.echo(f"  {path}")
    click.echo(f"\nTry: burnish render {bundle.path} -o look.png --set left.diffuse.color=#2060c0")


def drag(session: Session, settings: Mapping[str, Value]) -> tuple[Float32, list[float]]:
    """Go to the settings in steps, as a slider does, as one step of undo.

    Returns the last picture and the seconds that each took.
    """
    start = {path: np.asarray(session.get(path)) for path in settings}
    picture, seconds = session.frame(), []
    with session.gesture():
        for fraction in np.linspace(0, 1, STEPS + 1)[1:]:
            began = time.perf_counter()
            for path, value in settings.items():
                session.set(path, (start[path] + fraction * (value - start[path])).tolist())
            picture = session.frame()
            seconds.append(time.perf_counter() - began)
    return picture, seconds


def main() -> None:
    """Run the demo that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", nargs="?", default="teatray", help="what the editor opens")
    parser.add_argument("--bake", action="store_true", help="bake and compare, with no editor")
    parser.add_argument("--folder", type=Path, default=Path("demo-output"))
    parser.add_argument("--side", type=int, default=256, help="pixels of a side")
    parser.add_argument("--spp", type=int, default=128, help="samples per pixel of the bake")
    parser.add_argument("--truth-spp", type=int, default=256, help="… of the path tracer")
    options = parser.parse_args()
    if options.bake:
        sizes = options.side, options.spp, options.truth_spp
        sys.exit(exit_code(lambda: demo(options.folder, *sizes)))
    sys.exit(exit_code(lambda: editor(options.scene)))


if __name__ == "__main__":
    main()
