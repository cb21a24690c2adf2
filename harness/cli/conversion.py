"""The command `raybench convert`: scenes for other renderers, and from one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import AllowImports, AllowOutside, Define, Scene, parameters_of

FORMATS = {".xml": "mitsuba", ".pbrt": "pbrt"}
"""Suffixes of files for other renderers; a folder, or scene.yaml in it, is a raybench scene."""


def convert(
    scene: Scene,
    output: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE|DIR",
            help="A .xml for Mitsuba 3, a .pbrt for pbrt-v4, or a folder for a raybench scene: scene.yaml in it is replaced.",
        ),
    ],
    max_depth: Annotated[
        int | None, typer.Option(min=1, help="Most segments of a path, for other renderers.", show_default="the scene's, or 16")
    ] = None,
    spp: Annotated[int, typer.Option(min=1, help="Samples per pixel, for other renderers.")] = 64,
    define: Define = None,
    allow_imports: AllowImports = False,
    allow_outside: AllowOutside = False,
) -> None:
    """Convert a scene, of raybench's, Mitsuba's or glTF's format or a mesh, to raybench's, Mitsuba's or pbrt's."""
    from engines.choices import SHADERS
    from engines.errors import ConfigError
    from engines.peers.export import export
    from harness.config import paths

    suffix = output.suffix.lower()
    if suffix in FORMATS:
        file = paths.find("scenes", scene)
        written = output / f"{file.stem}{suffix}" if output.is_dir() else output
        targets = written, written.with_name(f"{written.stem}_files")
        held = _loaded(file, targets, allow_imports, allow_outside, define)
        depth = max_depth or (held.shader or {}).get("max_depth", SHADERS["path_tracer"]["max_depth"].default)
        file = export(held, FORMATS[suffix], output, depth, spp)
        beside = file.with_name(f"{file.stem}_files")
        typer.echo(f"written: {file}{f', {beside}' if beside.exists() else ''}")
    elif output.name in ("scene.yaml", "scene.yml"):
        _write_scene(scene, output.parent, define, allow_imports, allow_outside)
    elif not suffix or output.is_dir():
        _write_scene(scene, output, define, allow_imports, allow_outside)
    else:
        raise ConfigError(f"-o {output}: a file that ends in .xml or .pbrt is expected, or a folder")


def _write_scene(scene: str, output: Path, define: list[str] | None, allow_imports: bool, allow_outside: bool) -> None:
    """Writes a raybench scene into a folder."""
    from engines.scene import save_scene
    from harness.config import paths

    file = paths.find("scenes", scene)
    targets = output / "scene.yaml", output / "meshes", output / "textures"
    held = _loaded(file, targets, allow_imports, allow_outside, define)
    typer.echo(f"written: {save_scene(held, output)}")


def _loaded(file: Path, targets: tuple[Path, ...], imports: bool, outside: bool, define: list[str] | None) -> Any:
    """The scene, whose warnings are printed. Refuses to write over what it reads."""
    from engines.input_files import files_opened
    from engines.scene import load_scene
    from harness.console import consoles

    _keep([file], targets)
    with files_opened() as opened:
        held = load_scene(file, imports, outside, parameters_of(define))
    _keep(opened, targets)
    for warning in held.warnings:
        consoles()[1].print(f"warning: {file}: {warning}", style="yellow", markup=False, soft_wrap=True)
    return held


def _keep(files: list[Path], targets: tuple[Path, ...]) -> None:
    """Refuses targets, files and folders, that are or hold some of the files."""
    from engines.errors import ConfigError
    from harness.config.paths import shown

    for file in files:
        if target := next((target for target in targets if file.resolve().is_relative_to(target.resolve())), None):
            raise ConfigError(f"-o {target}: the scene to convert reads {shown(file)}: another file or folder is expected")
