"""The commands `raybench render` and `raybench dahlquist`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from harness.cli.options import DEFAULT_ENGINE, AllowCommands, AllowImports, AllowOutside, Define, Scene, engines, words
from harness.cli.options import choices as named
from harness.cli.options import size as parse_size

_FILE = "Image file: .exr, .png, .jpg (quality 95), .bmp, .tif or .webp (lossless)."


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
    threads: Annotated[Optional[int], typer.Option(help="Number of threads.", show_default="every core")] = None,  # noqa: UP045
    spp: Annotated[int, typer.Option(help="Samples per pixel.")] = 16,
    size: Annotated[
        Optional[Any],  # noqa: UP045
        typer.Option(parser=parse_size, metavar="WxH", help="Pixels.", show_default="the scene's"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sampler: another seed gives another noise.")] = 1,
    precision: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(help="float64 or float32.", show_default="the engine's", autocompletion=words("float64", "float32")),
    ] = None,
    tone_mapper: Annotated[
        str,
        typer.Option(
            help="linear, srgb, reinhard, aces or module:attribute; not for .exr.", autocompletion=named("TONE_MAPPERS")
        ),
    ] = "srgb",
    output: Annotated[Optional[Path], typer.Option("-o", "--output", help=_FILE, show_default="<scene>.exr")] = None,  # noqa: UP045
    define: Define = None,
    allow_imports: AllowImports = False,
    allow_commands: AllowCommands = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Render one image: .exr (linear, with variance and both halves), or 8-bit .png, .jpg, .bmp, .tif or .webp."""
    from harness.cli.render import Request, parameters_of
    from harness.cli.render import render as rendered

    chosen = {"shader": shader, "sampler": sampler, "accelerator": accelerator}
    rendered(
        Request(
            scene,
            engine,
            chosen,
            threads,
            spp,
            size,
            seed,
            precision,
            tone_mapper,
            output,
            allow_imports,
            allow_commands,
            allow_outside,
            parameters_of(define or []),
        )
    )


def dahlquist(
    size: Annotated[Any, typer.Option(parser=parse_size, metavar="WxH", help="Pixels.")] = "320x480",
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
    probe_image: Annotated[Optional[Path], typer.Option(help="An 8-bit image as the light probe.")] = None,  # noqa: UP045
    background_image: Annotated[Optional[Path], typer.Option(help="An 8-bit image as the background.")] = None,  # noqa: UP045
    engine: Annotated[
        str, typer.Option(help="numpy or numba; the frames are the same.", autocompletion=words("numpy", "numba"))
    ] = "numba",
    threads: Annotated[Optional[int], typer.Option(help="Number of threads.", show_default="every core")] = None,  # noqa: UP045
    animate: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(metavar="N", help="Write the frames of N calls, from the last of --calls on, to a folder, .gif or .mp4."),
    ] = None,
    fps: Annotated[float, typer.Option(help="Frames per second of a .gif or .mp4.")] = 25.0,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="PNG file, whose alpha is 255 on a ball and 254 on the background.")
    ] = Path("dahlquist.png"),
) -> None:
    """Draw the frames of N. Dahlquist's Android ray tracer (2012), byte for byte."""
    from harness.cli.dahlquist import Request, draw

    request = Request(
        size,
        calls,
        time_elapsed,
        not no_reflections,
        not no_probe,
        interlaced,
        exact,
        redraw,
        probe,
        probe_image,
        background_image,
        engine,
        threads,
        animate,
        fps,
        output,
    )
    draw(request)
