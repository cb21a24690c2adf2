"""An engine of a function, as `engines.from_function` makes it.

The film, warm-up, passes, checkpoints and counters come with it. See docs/extend/engine.md.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from engines.choices import Option
from engines.errors import RendererFailed, why_unsupported
from engines.film import Image
from engines.interface import Settings
from engines.peers.adapters.image_renderer import MEANS_ALONE, ImageRenderer, derive_seed
from engines.scene import Scene

RenderFunction = Callable[[Scene, Settings, int, int], Any]
"""`render(scene, settings, spp, seed)`: the mean of `spp` samples per pixel, (h, w, 3) linear radiance, row 0 at the top."""


class FunctionRenderer(ImageRenderer):
    """Calls the function for every image, each time with a seed of its own."""

    engine: FunctionEngine

    def build(self, scene: Scene, settings: Settings) -> None:
        """Nothing: what the function builds, it builds in every call."""

    def image(self, spp: int, offset: int, seed: int) -> Image:
        """The function's image. Raises `RendererFailed` where that has another shape than the film."""
        found = np.asarray(self.engine.function(self.scene, self.settings, spp, derive_seed(seed, offset)), np.float64)
        expected = (self.film.height, self.film.width, 3)
        if found.shape != expected:
            raise RendererFailed(f"{self.engine.name}: returned an array of shape {found.shape}: expected {expected}")
        return found


class FunctionEngine:
    """Renders every scene by one function.

    The function gets the scene, the settings with every choice resolved, the samples per pixel and a seed in [1, 2^31). It may
    raise `Unsupported` with a sentence for what it cannot render.
    """

    not_promised: Mapping[str, str] = {
        **MEANS_ALONE,
        "a_split_render_is_the_same": "every call of the function has a seed of its own",
        "why_not_and_prepare_agree": "what a function cannot render is known once it is called",
        "stop_from_a_thread_ends_the_render": "a call of the function ends by itself",
    }

    def __init__(self, function: RenderFunction, name: str, version: str = "1") -> None:
        self.function, self.name, self.version = function, name, version

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        """`auto` alone: the function chooses its accelerator."""
        return {"auto": {}}

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        """None; raises `UnknownName` and `ConfigError` for names and options that do not exist."""
        return why_unsupported(self.prepare, scene, settings)

    def prepare(self, scene: Scene, settings: Settings) -> FunctionRenderer:
        """A renderer that calls the function."""
        return FunctionRenderer(self, scene, settings.resolved(self.accelerators(), "float64"))

    def source_files(self) -> list[Path]:
        """The file of the function, so that its results are measured again after a change."""
        function = inspect.unwrap(self.function)
        try:
            file = inspect.getsourcefile(function if inspect.isroutine(function) else type(function))
        except TypeError:
            return []
        return [Path(file)] if file else []
