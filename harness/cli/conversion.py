"""The commands `raybench export` and `raybench import`: scenes for other renderers, and from one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import AllowImports, AllowOutside, Define, Scene, parameters_of, words


def export(
    scene: Scene,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="mitsuba|pbrt",
            help="Mitsuba 3's XML, or pbrt-v4's format.",
            autocompletion=words("mitsuba", "pbrt"),
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="A file, or a folder for it; meshes go beside it.")],
    max_depth: Annotated[int, typer.Option(min=1, help="Largest number of segments of a path.")] = 6,
    spp: Annotated[int, typer.Option(min=1, help="Samples per pixel.")] = 64,
    define: Define = None,
    allow_imports: AllowImports = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Write a scene for another renderer, with its camera and a path integrator."""
    from engines.peers.export import export as exported
    from engines.scene import load_scene
    from harness.config import paths

    held = load_scene(paths.find("scenes", scene), allow_imports, allow_outside, parameters_of(define))
    typer.echo(f"written: {exported(held, to, output, max_depth, spp)}")


def import_(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="A Mitsuba file, of version 0.4 to 3.x.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="A folder; scene.yaml in it is replaced.")],
    define: Define = None,
    allow_outside: AllowOutside = False,
) -> None:
    """Write a Mitsuba scene as a raybench scene: YAML, with its meshes and images beside it."""
    from engines.errors import ConfigError
    from engines.scene import load_scene, save_scene
    from harness.config import paths
    from harness.console import consoles

    file = paths.find("scenes", scene)
    if file.suffix.lower() != ".xml":
        raise ConfigError(f"{scene}: a Mitsuba file, .xml, is expected")
    held = load_scene(file, allow_outside=allow_outside, parameters=parameters_of(define))
    for warning in held.warnings:
        consoles()[1].print(f"warning: {file}: {warning}", style="yellow", markup=False, soft_wrap=True)
    typer.echo(f"written: {save_scene(held, output)}")
