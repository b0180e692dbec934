"""The command line: `burnish edit | bake | render | compare | info | export | examples`.

Commands read their options, call `burnish.app.commands` and print. Whatever a user can get
wrong ends as one line on stderr and exit code 2; Ctrl+C ends with 130 and what was kept.
"""

from __future__ import annotations

import errno
import sys
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import click

from burnish.core.errors import BurnishError
from burnish.core.version import __version__

Command = TypeVar("Command", bound=Callable[..., Any])

INTERRUPTED = 130
"""Exit code after Ctrl+C, as shells have it."""


class Group(click.Group):
    """Commands in the order in which they are met, and the nearest name for a wrong one."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of definition."""
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does, with `UnknownName`'s hint."""
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            from burnish.core.errors import UnknownName

            raise UnknownName("command", args[0], self.commands)
        return super().resolve_command(ctx, args)


@click.group(
    cls=Group,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Start with: burnish examples",
)
@click.version_option(__version__, prog_name="burnish")
def cli() -> None:
    """Edit materials in the finished scene, with every bounce of light answering.

    SCENE is a Mitsuba 3 XML file, a glTF or GLB file, or the name of an example; BUNDLE is what
    `bake` wrote.
    """


def mode_options(command: Command) -> Command:
    """The options that say which light there is."""
    mode = click.option(
        "--mode",
        type=click.Choice(["baked", "direct", "relight"]),
        help="direct: direct light alone, at full frequency, from lights cut into triangles. "
        "relight (of a SCENE, nothing is stored): lights and materials together, one glossy "
        "bounce and matte ones after it.",
    )
    triangles = click.option(
        "--triangles",
        type=click.IntRange(100, 100_000),
        metavar="N",
        help="Of --mode direct: lights that the environment becomes (4000; 400 for a preview).",
    )
    return mode(triangles(command))


def edit_options(command: Command) -> Command:
    """The options that say which view is shown and which edits are made."""
    view = click.option(
        "--view", metavar="NAME", help="Which view of the scene (the first without it)."
    )
    return change_options(view(command))


def change_options(command: Command) -> Command:
    """The options that say which edits are made."""
    for option in (
        click.option(
            "--materialx",
            "looks",
            metavar="[OBJECT=]FILE[#MATERIAL]",
            multiple=True,
            help="OpenPBR values of a MaterialX file, on OBJECT or on those that its look names; "
            "before every --set.",
        ),
        click.option(
            "--edits",
            metavar="FILE",
            help="Edits that a session has saved; made before every --set.",
        ),
        click.option(
            "--set-map",
            "maps",
            metavar="OBJECT.LAYER.PARAM=[FILE][,KEY=VALUE…]",
            multiple=True,
            help="A picture (PNG, JPEG, EXR) in place of a parameter's value, or, without FILE, "
            "the one that is there edited. KEY: scale, offset, repeat (4 or 4x2), rotate "
            "(degrees), shift (0.1x0), wrap (repeat, clamp, mirror), channel (red, green, blue, "
            "alpha). Before every --set.",
        ),
        click.option(
            "--set",
            "assignments",
            metavar="OBJECT.LAYER.PARAM=VALUE|light:NAME.PARAM=VALUE",
            multiple=True,
            help="One edit, may be given many times. VALUE: a number, R,G,B (linear), "
            "#rrggbb (sRGB) or a choice. PARAM may be weight too; a light has intensity, tint, "
            "on, solo, and what `info` lists of it, such as position (X,Y,Z) or rotation.",
        ),
    ):
        command = option(command)
    return command


@cli.command(
    epilog="""\b
Examples:
  burnish edit teatray
  burnish edit scene.xml
  burnish edit helmet.glb
  burnish edit teatray --mode direct --triangles 400
  burnish edit interior --mode relight
  burnish edit box.burnish
  burnish edit box.burnish --edits look.json --no-browser --port 8000"""
)
@click.argument("source", metavar="SCENE|BUNDLE")
@click.option("--edits", metavar="FILE", help="Edits to begin with, as a session has saved them.")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Address to serve on; another one lets other machines in.",
)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Port to serve on (a free one)."
)
@click.option("--no-browser", is_flag=True, help="Print the address and open no browser.")
@click.option(
    "--light-groups",
    metavar="A,B,NAME=C+D|each",
    help="Of a SCENE: lights to tell apart in the live estimate, as `bake` does.",
)
@mode_options
def edit(**options: Any) -> None:
    """Open the editor on SCENE or BUNDLE in the browser."""
    from burnish.app import commands

    commands.edit(**options)


@cli.command(
    epilog="""\b
Examples:
  burnish bake cornell-box -o box.burnish
  burnish bake scene.xml -o out.burnish --editable teapot,tray --series 128,8,1
  burnish bake teatray -o direct.burnish --mode direct --triangles 4000
  burnish bake scene.xml -o out.burnish --bins teapot=256,tray=16 --minutes 30
  burnish bake ring -o ring.burnish --light-groups lamp,studio
  burnish bake scene.xml -o out.burnish --resume"""
)
@click.argument("scene")
@click.option("-o", "--output", required=True, metavar="OUT.burnish", help="The bundle to write.")
@click.option(
    "--editable", metavar="A,B,…", help="Objects that stay editable (all that can be without it)."
)
@click.option(
    "--bounces",
    type=click.IntRange(1, 8),
    metavar="N",
    help="Bounces of light, 1 to 8; short for --series 64,1,…,1.",
)
@click.option(
    "--series",
    metavar="J,…",
    help="Bins per bounce from the eye, such as 64,1,1,1 (the default), 128,8,1 or 64,16.",
)
@click.option("--bins", metavar="A=N,…", help="Other numbers of bins for an object or a layer.")
@click.option(
    "--model",
    "models",
    metavar="OBJECT.LAYER=MODEL",
    multiple=True,
    help="Another reflectance model for a layer, such as teapot.specular=cook-torrance-curves; "
    "what can carries over.",
)
@click.option(
    "--light-groups",
    metavar="A,B,NAME=C+D|each",
    help="Lights to tell apart, up to four groups with the one of the others, so that materials "
    "can be edited under a changed mix with no tracing.",
)
@click.option(
    "--spp",
    type=click.IntRange(1),
    metavar="N",
    help="Samples per pixel, rounded up to full strata (256 without --minutes).",
)
@click.option(
    "--minutes",
    type=click.FloatRange(0, min_open=True),
    metavar="T",
    help="Spend about this long; a timed pilot fixes the samples.",
)
@click.option(
    "--resolution", metavar="WxH", help="Pixels of every view, instead of the scene's own."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Other samples, other noise.")
@click.option("--resume", is_flag=True, help="Go on with a bake that was interrupted.")
@mode_options
def bake(**options: Any) -> None:
    """Trace SCENE once, so that its materials can be edited from then on."""
    from burnish.app import commands

    commands.bake(**options)


@cli.command(
    epilog="""\b
Examples:
  burnish render box.burnish -o box.png
  burnish render box.burnish -o red.exr --set left.diffuse.color=0.6,0.1,0.1
  burnish render ring.burnish -o warm.png --set light:lamp.intensity=2 --set light:studio.on=off
  burnish render scene.xml -o truth.exr --spp 1024 --set teapot.specular.roughness=0.1"""
)
@click.argument("source", metavar="SCENE|BUNDLE")
@click.option("-o", "--output", required=True, metavar="OUT.exr|.png", help="The picture to write.")
@edit_options
@click.option(
    "--spp",
    type=click.IntRange(1),
    default=256,
    show_default=True,
    help="Samples per pixel of a path-traced SCENE; a bundle needs none.",
)
@click.option(
    "--resolution",
    metavar="WxH",
    help="Pixels of every view of a path-traced SCENE, instead of its own.",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of a path-traced SCENE.")
@click.option(
    "--exposure", type=float, default=0.0, show_default=True, help="Stops; of a PNG alone."
)
@click.option(
    "--tonemap", default="srgb", show_default=True, metavar="NAME", help="Of a PNG alone."
)
@click.option(
    "--mode",
    type=click.Choice(["baked", "direct", "relight"]),
    help="Of a SCENE; direct: one bounce of light, path-traced; relight: by relighting.",
)
def render(**options: Any) -> None:
    """Write a picture with edited materials: from a bundle at once, of a scene by path tracing."""
    from burnish.app import commands

    commands.render(**options)


@cli.command(
    epilog="""\b
Examples:
  burnish compare box.burnish --set back.diffuse.color=#c83c28 -o sheet.png
  burnish compare box.burnish --edits look.json --spp 2048 --json"""
)
@click.argument("source", metavar="SCENE|BUNDLE")
@edit_options
@click.option(
    "--spp",
    type=click.IntRange(2),
    default=256,
    show_default=True,
    help="Samples per pixel of the truth.",
)
@click.option("--seed", type=int, default=1, show_default=True, help="Of the truth.")
@click.option(
    "--all-bounces", is_flag=True, help="Let the truth have more bounces than the bundle has."
)
@click.option("--scene", metavar="SCENE", help="Where the bundle's scene is now.")
@click.option("-o", "--output", metavar="SHEET.png", help="Write ours, truth, FLIP and figures.")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
@mode_options
def compare(**options: Any) -> None:
    """Hold an edited picture against Mitsuba's path tracer with the same materials."""
    from burnish.app import commands

    commands.compare(**options)


@cli.command(
    epilog="""\b
Examples:
  burnish info cornell-box
  burnish info box.burnish --json"""
)
@click.argument("source", metavar="SCENE|BUNDLE")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON.")
def info(**options: Any) -> None:
    """List objects, layers, models, parameters with their ranges, views and sizes."""
    from burnish.app import commands

    commands.info(**options)


@cli.command(
    epilog="""\b
Examples:
  burnish export box.burnish -o box.xml --edits look.json
  burnish export scene.xml -o looks.mtlx --set teapot.specular.roughness=0.1
  burnish export model.glb -o model2.glb --edits look.json
  burnish export scene.xml -o teapot.binary --object teapot"""
)
@click.argument("source", metavar="SCENE|BUNDLE")
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="OUT",
    help="What to write: .xml (Mitsuba 3), .mtlx (MaterialX), .glb or .gltf, .binary (MERL).",
)
@change_options
@click.option(
    "--format",
    "kind",
    metavar="NAME",
    help="mitsuba, materialx, glb, gltf or merl, where the suffix does not say it.",
)
@click.option(
    "--object",
    "objects",
    metavar="A,B,…",
    help="Whose materials are written (all that can be edited without it).",
)
@click.option(
    "--plugin",
    is_flag=True,
    help="Mitsuba XML: name burnish's own BSDF where no stock one holds a material.",
)
@click.option("--scene", metavar="SCENE", help="Where the bundle's scene is now.")
def export(**options: Any) -> None:
    """Write the scene, or its materials, with edits, and say what the format cannot hold."""
    from burnish.app import commands

    commands.export(**options)


@cli.command(
    epilog="""\b
Examples:
  burnish examples
  burnish bake teatray -o teatray.burnish"""
)
def examples() -> None:
    """List the scenes that come along."""
    from burnish.app import commands

    commands.examples()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit code."""
    sys.exit(exit_code(lambda: cli.main(arguments, prog_name="burnish", standalone_mode=False)))


def exit_code(work: Callable[[], object]) -> int:
    """Do the work: 0 when done, 2 for what the user can mend, 130 after Ctrl+C."""
    try:
        work()
    except BurnishError as error:
        return complain(str(error))
    except click.UsageError as error:
        path = error.ctx.command_path if error.ctx else "burnish"
        return complain(f"{error.format_message()} (see {path} --help)")
    except click.ClickException as error:
        return complain(error.format_message())
    except (KeyboardInterrupt, click.Abort) as interruption:
        # Click wraps the interruption, whose note says what was kept and how to go on
        chain = (interruption, interruption.__cause__)
        found = (getattr(error, "__notes__", None) for error in chain)
        notes = next(filter(None, found), ["stopped; nothing was written"])
        click.echo(f"burnish: {' '.join(notes)}", err=True)
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has left, as `head` does.
        sys.stderr.close()
        return 0
    except OSError as error:
        return complain(operating_system_error(error))
    return 0


def complain(message: str) -> int:
    """One line on stderr; the exit code for what the user can mend."""
    click.echo(f"burnish: {' '.join(message.split())}", err=True)
    return 2


def operating_system_error(error: OSError) -> str:
    """What the system refused, for which file, and what helps."""
    remedies = {
        errno.ENOSPC: "; free some space or choose another folder",
        errno.EDQUOT: "; free some space or choose another folder",
        errno.EACCES: "; choose a place that you may write to",
        errno.EROFS: "; choose a place that you may write to",
    }
    subject = f"{error.filename!r}: " if error.filename else ""
    reason = error.strerror or str(error) or type(error).__name__
    return f"{subject}{reason}{remedies.get(error.errno or 0, '')}"


if __name__ == "__main__":
    main()
