"""The command `raybench render`, which also draws Dahlquist's frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import (
    DEFAULT_ENGINE,
    AllowCommands,
    AllowImports,
    AllowOutside,
    Command,
    Define,
    Scene,
    Size,
    Threads,
    engines,
    parameters_of,
    parse_size,
    words,
)
from harness.cli.options import choices as named

DAHLQUIST = "dahlquist"
_FILE = "Image file: .exr, .png, .jpg (quality 95), .bmp, .tif or .webp (lossless)."


class Render(Command):
    """`render dahlquist` draws the frames of the program, not the scene of that name, unless it is asked for samples, a shader
    or anything else that the program has not."""

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        port = parent.command.commands[DAHLQUIST] if parent is not None and args[:1] == [DAHLQUIST] else None
        if port is None or not _all_known(args[1:], port):
            return super().make_context(info_name, args, parent, **extra)
        return port.make_context(f"render {DAHLQUIST}", args[1:], parent, **extra)


def _all_known(args: list[str], command: Any) -> bool:
    """Whether a command has all options that are given, and the engine is one of its."""
    options = {option for param in command.params for option in param.opts} | {"-h", "--help", "--output"}
    given = [word.partition("=")[0] for word in args if word.startswith("-")]
    engine = args[args.index("--engine") + 1 :][:1] if "--engine" in args else []
    return set(given) <= options and ("--calls" in given or engine in ([], ["numpy"], ["numba"]))


def render(
    scene: Scene,
    engine: Annotated[
        str, typer.Option(help="An engine, as `raybench list` names it.", autocompletion=engines)
    ] = DEFAULT_ENGINE,
    shader: Annotated[
        str,
        typer.Option(
            help="A name, or '{name: path_tracer, max_depth: 6}'.",
            show_default="the scene's, else path_tracer",
            autocompletion=named("SHADERS"),
        ),
    ] = "",
    sampler: Annotated[
        str,
        typer.Option(
            help="A name, or a mapping with options.",
            show_default="sobol, or random where the engine lacks it",
            autocompletion=named("SAMPLERS"),
        ),
    ] = "",
    accelerator: Annotated[str, typer.Option(help="A name, or a mapping with options.")] = "auto",
    threads: Threads = None,
    spp: Annotated[int, typer.Option(help="Samples per pixel.")] = 16,
    size: Annotated[
        Any | None, typer.Option(parser=parse_size, metavar="WxH", help="Pixels.", show_default="the scene's")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sampler: another seed gives another noise.")] = 1,
    precision: Annotated[
        str | None,
        typer.Option(help="float64 or float32.", show_default="the engine's", autocompletion=words("float64", "float32")),
    ] = None,
    tone_mapper: Annotated[
        str,
        typer.Option(
            help="linear, srgb, reinhard, aces or module:attribute; not for .exr.", autocompletion=named("TONE_MAPPERS")
        ),
    ] = "srgb",
    exposure: Annotated[
        float, typer.Option(min=-30, max=30, metavar="STOPS", help="Brighten the image by so many stops; not for .exr.")
    ] = 0.0,
    output: Annotated[Path | None, typer.Option("--out", "-o", help=_FILE, show_default="<scene>.exr")] = None,
    define: Define = None,
    allow_imports: AllowImports = False,
    allow_commands: AllowCommands = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Render one image: .exr (linear, with variance and both halves), or 8-bit .png, .jpg, .bmp, .tif or .webp.

    `render dahlquist` draws frames of N. Dahlquist's ray tracer: see `render dahlquist -h`.
    """
    from harness.cli.render import Request
    from harness.cli.render import render as rendered

    chosen = {"shader": shader, "sampler": sampler, "accelerator": accelerator}
    image = threads, spp, size, seed, precision, tone_mapper, output
    allowed = allow_imports, allow_commands, allow_outside
    rendered(Request(scene, engine, chosen, *image, *allowed, parameters_of(define), exposure))


def dahlquist(
    size: Size = "320x480",
    calls: Annotated[int, typer.Option(help="Number of frame calls; the frame of the last one is written.")] = 1,
    time_elapsed: Annotated[
        int, typer.Option(help="Elapsed time given to each call; 3000 are a unit of the animation's time.")
    ] = 3000,
    no_reflections: Annotated[bool, typer.Option("--no-reflections", help="Balls reflect only the light probe.")] = False,
    no_probe: Annotated[bool, typer.Option("--no-probe", help="Use neither light probe nor background.")] = False,
    interlaced: Annotated[bool, typer.Option("--interlaced", help="Draw every other row in each call.")] = False,
    exact: Annotated[
        bool, typer.Option("--exact", help="Do without the area hierarchy, whose boxes are slightly wrong.")
    ] = False,
    redraw: Annotated[bool, typer.Option("--redraw", help="Draw the background in every call, not once.")] = False,
    probe: Annotated[
        str,
        typer.Option(
            help="Light probe, the image that balls reflect: checker or smooth.", autocompletion=words("checker", "smooth")
        ),
    ] = "checker",
    probe_image: Annotated[Path | None, typer.Option(help="An 8-bit image as the light probe.")] = None,
    background_image: Annotated[Path | None, typer.Option(help="An 8-bit image as the background.")] = None,
    engine: Annotated[
        str, typer.Option(help="numpy or numba; the frames are the same.", autocompletion=words("numpy", "numba"))
    ] = "numba",
    threads: Threads = None,
    animate: Annotated[
        int | None,
        typer.Option(metavar="N", help="Write the frames of N calls, from the last of --calls on, to a folder, .gif or .mp4."),
    ] = None,
    fps: Annotated[float, typer.Option(help="Frames per second of a .gif or .mp4.")] = 25.0,
    output: Annotated[
        Path, typer.Option("--out", "-o", help="PNG file, whose alpha is 255 on a ball and 254 on the background.")
    ] = Path("dahlquist.png"),
) -> None:
    """Draw the frames of N. Dahlquist's Android ray tracer (2012), byte for byte."""
    from harness.cli.dahlquist import Request, draw

    switches = not no_reflections, not no_probe, interlaced, exact, redraw
    pictures = probe, probe_image, background_image
    draw(Request(size, calls, time_elapsed, *switches, *pictures, engine, threads, animate, fps, output))
