"""The engine of a renderer's file, and its renderer: every call of `render` is a process."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.choices import SAMPLERS, SHADERS, Choice, Option
from engines.errors import RendererFailed, Unsupported, why_unsupported
from engines.interface import Settings
from engines.peers.adapters import MEANS_ALONE, ImageRenderer, derive_seed
from engines.peers.external.description import UNITS, Description, filled, read
from engines.peers.external.pictures import read_picture
from engines.peers.external.process import Process
from engines.peers.external.scenes import CARRIES, FORMATS
from engines.scene import Scene
from engines.scene.support import refusal_of
from engines.temporary import TemporaryFolder

THREAD_POOLS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to the threads asked for: the program may inherit others from a harness."""
NOT_PROMISED = {
    **MEANS_ALONE,
    "a_split_render_is_the_same": "every call is a process with a seed of its own",
    "stop_in_a_callback_ends_the_render": "a call is one process, and one pass",
    "stop_from_a_thread_ends_the_render": "a process that is stopped is killed, and its samples are lost",
}
"""Keys of claims of `engines.conformance`, with reasons."""


class Engine:
    """A program that renders, as its file describes it.

    `listed`: the shaders, samplers and threads that the file lists, the only ones to ask for. `reads_files`: whether the
    program reads the scene's own file, so that a scene must lie in one.
    """

    not_promised: Mapping[str, str] = NOT_PROMISED
    smooth_samplers = ()  # what the program does under a sampler's name is not known

    def __init__(self, file: str | PathLike[str]) -> None:
        self._description = description = read(Path(file))
        self.name, self.lineage = description.name, description.lineage
        self.version = f"{description.version}-{description.digest}"
        self.reads_files = description.scene_format == "raybench"
        self.listed: Mapping[str, Sequence[Any]] = {
            "shader": [choice.describe() for choice in description.shaders.values()],
            "sampler": [choice.describe() for choice in description.samplers.values()],
            "threads": [description.threads or 1],
        }

    def source_files(self) -> list[Path]:
        """The files that the command and the environment name: the program where it is a path, its scripts."""
        description = self._description
        program, *words = description.command
        named = [description.file.absolute().parent / Path(program).expanduser()] if "/" in program else []
        # The end of `--script=/path/to/it`, too. A program runs in a folder of its own: other relative paths are none.
        ends = [word.rpartition("=")[2] for word in (*words, *description.environment.values())]
        named += [path for path in map(Path, ends) if path.is_absolute()]
        return [path for path in named if path.is_file()]

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        """`auto` alone: the program chooses its accelerator."""
        return {"auto": {}}

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        """None where the program is there and its file says that it can do this."""
        return why_unsupported(self._supported, scene, settings)

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        return Renderer(self, self._description, scene, self._supported(scene, settings))

    def _supported(self, scene: Scene, settings: Settings) -> Settings:
        description = self._description
        chosen = settings.resolved(self.accelerators(), description.precision)
        if refusal := refusal_of(scene):
            raise Unsupported(refusal)
        program(description)
        self._require("shader", chosen.shader, description.shaders, SHADERS)
        self._require("sampler", chosen.sampler, description.samplers, SAMPLERS)
        if chosen.precision != description.precision:
            raise Unsupported(f"{description.name} computes in {description.precision}")
        if description.threads not in (None, settings.threads):
            raise Unsupported(f"{description.name} always takes {description.threads} threads")
        with TemporaryFolder() as folder:
            FORMATS[description.scene_format](scene, chosen, Path(folder))
        return chosen

    def _require(
        self, kind: str, asked: Choice, known: Mapping[str, Choice], table: Mapping[str, Mapping[str, Option]]
    ) -> None:
        if asked.plugin is not None or asked.name not in known:
            raise Unsupported(f"{self._description.name} has no {kind} {asked.name}: its file lists {', '.join(known)}")
        for key, value in asked.options.items():
            fixed = known[asked.name].options[key]
            passed = self._description.passed | CARRIES[self._description.scene_format]
            if f"{kind}.{key}" not in passed and value != fixed:
                raise Unsupported(f"{self._description.name} has {kind} {asked.name} with {key} = {fixed} only")
        for passed in sorted(self._description.passed):
            if passed.startswith(f"{kind}.") and passed.partition(".")[2] not in asked.options:
                raise Unsupported(f"{self._description.name} is passed {{{passed}}}, which {asked.name} does not have")


def program(description: Description) -> str:
    """The program's path; raises `Unsupported` where there is none."""
    word = description.command[0]
    place = description.file.absolute().parent / Path(word).expanduser() if "/" in word else word
    path = shutil.which(place)
    if path is None:
        where = f"at {place}" if "/" in word else "on PATH"
        raise Unsupported(f"{description.name}: there is no program {word!r} {where}")
    return path


class Renderer(ImageRenderer):
    """A scene for a program. `counters()["told_seconds"]` is the time that counts, over all calls of `render`."""

    samples_a_pass = sys.maxsize  # a call is one process, whoever looks on

    def __init__(self, engine: Engine, description: Description, scene: Scene, settings: Settings) -> None:
        self._description = description
        self._folder = TemporaryFolder()
        self._process = Process()
        self._told = 0.0
        super().__init__(engine, scene, settings)

    def build(self, scene: Scene, settings: Settings) -> None:
        self._scene_file = FORMATS[self._description.scene_format](scene, settings, Path(self._folder.name))

    def compile(self) -> None:
        """A process of one sample where the program's own words are the clock; else starting is part of every call."""
        if self._description.time is not None:
            self._process.stopped = False
            self._run(1, derive_seed(self.seed, "warm-up"))

    def image(self, spp: int, offset: int, seed: int) -> NDArray[np.float64] | None:
        """One process of `spp` samples. `stop` kills it; its samples are then lost."""
        self._process.stopped = False
        if self.stopped.is_set():  # the line above would undo a stop that came before it
            return None
        rendered = self._run(spp, derive_seed(seed, offset))
        if rendered is None:
            return None
        self._told += rendered[1]
        return rendered[0]

    def interrupt(self) -> None:
        self._process.stop()

    def counters(self) -> Mapping[str, float]:
        """Build and memory are not known: 0; rays are not counted. `told_by_program` is 1 where the clock is the program's
        own words, 0 where it is that of its process."""
        unknown = dict.fromkeys(("build_seconds", "compile_seconds"), 0.0)
        clock = {"told_seconds": self._told, "told_by_program": float(self._description.time is not None)}
        return {**super().counters(), **unknown, **clock}

    def _run(self, spp: int, seed: int) -> tuple[NDArray[np.float64], float] | None:
        """The image of `spp` new samples and the seconds that count; None where it was stopped."""
        description, settings = self._description, self.settings
        folder = Path(self._folder.name)
        image = folder / f"image.{description.image}"
        image.unlink(missing_ok=True)
        width, height = self.film.width, self.film.height
        values: dict[str, Any] = {
            "scene": self._scene_file,
            "image": image,
            "folder": folder,
            "spp": spp,
            "seed": seed,
            "threads": settings.threads,
            "width": width,
            "height": height,
            "precision": description.precision,
        }
        for kind, choice in (("shader", settings.shader), ("sampler", settings.sampler)):
            values[kind] = choice.name
            values |= {f"{kind}.{key}": value for key, value in choice.options.items()}
        words = [program(description), *(filled(word, values) for word in description.command[1:])]
        environment = dict.fromkeys(THREAD_POOLS, str(settings.threads))
        environment |= {key: filled(value, values) for key, value in description.environment.items()}
        ran = self._process.run(description.name, words, environment, folder)
        if ran is None:
            return None
        seconds = ran.seconds if description.time is None else told_seconds(description.name, description.time, ran.output)
        return read_picture(description.name, image, width, height), seconds


def told_seconds(name: str, pattern: re.Pattern[str], output: str) -> float:
    """The sum of the groups of the last match, in seconds. Raises `RendererFailed` where there is no number."""
    matches = list(pattern.finditer(output))
    try:
        groups = {unit: text for unit, text in matches[-1].groupdict().items() if text} if matches else {}
        seconds = sum(float(text) * UNITS[unit] for unit, text in groups.items())
    except ValueError as error:
        raise RendererFailed(f"{name}: its output tells no time: {error}") from error
    if not groups or not 0.0 <= seconds < np.inf:
        raise RendererFailed(f"{name}: its output tells no time: nothing in it matches {pattern.pattern!r}")
    return seconds
