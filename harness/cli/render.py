"""`raybench render`: one image, in this process, with what it took on stderr."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from engines import memory
from engines.choices import SAMPLERS, SHADERS, Choice, resolve
from engines.errors import ConfigError, Unsupported
from engines.film import BYTES_A_PIXEL_WRITTEN, Film
from engines.image import SUFFIXES
from engines.interface import Engine, Settings
from engines.registry import engine as engine_of
from engines.registry import load_attribute
from engines.scene import load_scene
from engines.schema.yaml_file import parse_yaml
from engines.tonemap import ToneMapper, to_bitmap, tone_mapper
from harness.cli.outputs import check_file
from harness.config import paths
from harness.config.settings import known
from harness.console import consoles
from harness.measure import clock, machine
from harness.processes import allow_here
from harness.run.progress import duration
from harness.settings import completed, plugin_or_choice, require_commands, require_imports

MAX_SPP = 2**31
DEFAULTS = {"shader": "path_tracer", "sampler": "sobol", "accelerator": "auto"}


class Request(NamedTuple):
    """The command line. `chosen` has shader, sampler and accelerator as YAML text. An empty shader is the one that the scene
    suggests, an empty sampler sobol, or random where the engine lacks that. `parameters` are those of a Mitsuba file. The tone
    mapper is given the image brightened by `exposure` stops."""

    scene: str
    engine: str
    chosen: Mapping[str, str]
    threads: int | None
    spp: int
    size: tuple[int, int] | None
    seed: int
    precision: str | None
    tone_mapper: str
    output: Path | None
    allow_imports: bool
    allow_commands: bool = False
    allow_outside: bool = False
    parameters: Mapping[str, str] = {}
    exposure: float = 0.0


def render(request: Request) -> Film:
    """Renders and writes the image; refuses before rendering what could only fail after it."""
    if not 1 <= request.spp <= MAX_SPP:
        raise ConfigError(f"--spp {request.spp}: must be in [1, {MAX_SPP}]")
    path = paths.find("scenes", request.scene)
    output = request.output or Path(f"{path.stem}.exr")
    check_file(output, SUFFIXES)
    allow_here(request.allow_imports)
    mapper = _tone_mapper(request.tone_mapper, request.allow_imports)
    require_imports(request.engine, request.allow_imports)
    require_commands(request.engine, request.allow_commands)
    engine = engine_of(request.engine)
    chosen = _chosen(request)
    scene = load_scene(path, request.allow_imports, request.allow_outside, natively=True, parameters=request.parameters)
    if scene.native is not None and scene.native.refusal and not getattr(engine, "takes_native", False):
        raise Unsupported(f"{scene.native.refusal}. The engine mitsuba is given the file as it is")
    if scene.shader is not None and not request.chosen["shader"]:
        chosen["shader"] = resolve("shader", scene.shader, known("shader", scene.shader["name"], SHADERS))
    console = consoles()[1]
    for warning in scene.warnings:
        console.print(f"warning: {path}: {warning}", style="yellow", markup=False, soft_wrap=True)
    settings = _settings(request, chosen)
    if not request.chosen["sampler"] and engine.why_not(scene, settings):
        # also where the engine declines this, too: then the reason is not a sampler that nobody asked for
        chosen["sampler"] = resolve("sampler", "random", SAMPLERS)
        settings = _settings(request, chosen)
    width, height = settings.size(scene)
    memory.require(BYTES_A_PIXEL_WRITTEN * width * height, f"an image of {width}x{height} pixels")
    why_not = engine.why_not(scene, settings)
    if why_not:
        raise Unsupported(why_not)
    renderer, build, compilation = clock.prepare(engine, scene, settings)
    console.print(f"{scene.name}: built in {duration(build)}, compiled in {duration(compilation)}", markup=False)
    start = perf_counter()
    film = renderer.render(spp=request.spp)
    seconds = perf_counter() - start
    provenance = _provenance(request, settings, chosen, scene.identity, engine, seconds, scene.warnings)
    film.save(output, provenance=provenance, tone_mapper=lambda radiance: mapper(radiance * 2.0**request.exposure))
    _print_summary(console, film, seconds, clock.rays_traced(renderer), output)
    return film


def _tone_mapper(name: str, allow_imports: bool) -> ToneMapper:
    """The tone mapper of a name or of `module:attribute`, after a pixel has shown that it works."""
    if ":" not in name:
        return tone_mapper(name)
    require_imports(name, allow_imports)
    mapper = tone_mapper(load_attribute(name))
    try:
        to_bitmap(np.full((1, 1, 3), 0.5), mapper)
    except Exception as error:
        raise ConfigError(f"--tone-mapper {name}: fails: {type(error).__name__}: {error}") from error
    return mapper


def _print_summary(console: Console, film: Film, seconds: float, rays: float | None, output: Path) -> None:
    paths = film.width * film.height * film.spp
    speed = f"{paths / seconds / 1e6:.3g} million paths/s"
    if rays is not None:
        speed += f", {rays / seconds / 1e6:.3g} million rays/s"
    words = f"{film.width}x{film.height}, {film.spp} spp in {duration(seconds)}: {speed} -> {output}"
    console.print(words, markup=False, soft_wrap=True)
    if film.bad_samples:
        console.print(f"warning: {film.bad_samples} samples were not finite; they count as black", style="yellow")


def _chosen(request: Request) -> dict[str, Choice]:
    """Shader, sampler and accelerator, as an experiment would have them."""
    tables = {"shader": SHADERS, "sampler": SAMPLERS}
    chosen: dict[str, Choice] = {}
    for kind, written in request.chosen.items():
        text = written or DEFAULTS[kind]
        choice = parse_yaml(text, f"--{kind}", ConfigError).plain() if text.lstrip().startswith("{") else {"name": text}
        if not isinstance(choice, dict) or not isinstance(choice.get("name"), str):
            raise ConfigError(f"--{kind} {text}: a name, or {{name: ..., option: value}}, is expected")
        if kind in tables and ":" not in choice["name"]:
            chosen[kind] = resolve(kind, choice, known(kind, choice["name"], tables[kind]))
        else:
            chosen[kind] = completed(kind, Choice.of(choice), request.allow_imports)
    return chosen


def _settings(request: Request, chosen: Mapping[str, Choice]) -> Settings:
    """What the engine is given."""
    width, height = request.size or (None, None)
    return Settings(
        **{kind: plugin_or_choice(kind, choice, request.allow_imports) for kind, choice in chosen.items()},
        width=width,
        height=height,
        precision=request.precision,
        threads=request.threads if request.threads is not None else len(machine.usable_cores()),
        seed=request.seed,
    )


def _provenance(
    request: Request,
    settings: Settings,
    chosen: Mapping[str, Choice],
    scene_hash: str,
    engine: Engine,
    seconds: float,
    warnings: Sequence[str],
) -> dict[str, Any]:
    return {
        "scene": request.scene,
        "scene_hash": scene_hash,
        "engine": request.engine,
        "engine_version": str(engine.version),
        "settings": {
            "width": settings.width,
            "height": settings.height,
            "precision": settings.precision,
            "threads": settings.threads,
            **{kind: choice.describe() for kind, choice in chosen.items()},
        },
        "seed": request.seed,
        "spp": request.spp,
        "render_seconds": seconds,
        "machine": machine.environment(),
        "warnings": list(warnings),
        **({"parameters": dict(request.parameters)} if request.parameters else {}),
    }
