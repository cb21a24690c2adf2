"""The engine `numpy`: float64, on one thread, written for reading; the others are held against it."""

from __future__ import annotations

from collections.abc import Mapping

from engines.choices import Choice, Option
from engines.errors import Unsupported, why_unsupported
from engines.interface import Settings
from engines.numpy_reference.renderer import Renderer, require_numpy
from engines.scene import Scene
from engines.scene.support import refusal_of


def _leaf_size(value: object) -> str | None:
    whole = isinstance(value, int) and not isinstance(value, bool)
    return None if whole and 1 <= value <= 16 else "an integer in [1, 16]"


ACCELERATORS: dict[str, dict[str, Option]] = {
    "auto": {},
    "none": {},
    "bvh": {"leaf_size": Option(4, "largest number of primitives in a leaf", _leaf_size)},
}


class Engine:
    """The reference engine: NumPy in float64, with separate formulas, one concept per file. It supports every shader, sampler
    and camera, and plugins that have a NumPy function.

    It accepts any number of threads and renders on one.
    """

    name = "numpy"
    lineage = "raybench-numpy"
    version = "1.0"

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        """None where `prepare` would work, else one sentence that says what is lacking."""
        return why_unsupported(self._supported, scene, settings)

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        """Raises `UnknownName`, `ConfigError` for bad settings, and `Unsupported` with the words of `why_not`."""
        return Renderer(scene, self._supported(scene, settings))

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        """`none`: every ray against everything. `bvh`: an eight-wide tree. `auto`: the faster one for the scene."""
        return ACCELERATORS

    def _supported(self, scene: Scene, settings: Settings) -> Settings:
        return supported(scene, settings, ACCELERATORS, self.name)


def supported(scene: Scene, settings: Settings, accelerators: Mapping[str, Mapping[str, Option]], name: str) -> Settings:
    """The settings with every choice resolved; raises where the engine `name` cannot follow them."""
    chosen = settings.resolved(accelerators, "float64")
    if refusal := refusal_of(scene):
        raise Unsupported(refusal)
    if chosen.precision == "float32":
        raise Unsupported(f"the engine {name} computes in float64 only")
    if chosen.accelerator.plugin is not None:
        raise Unsupported(f"the engine {name} takes no accelerator plugins")
    _require_numpy("shader", chosen.shader)
    _require_numpy("sampler", chosen.sampler)
    require_numpy(scene, f"the engine {name}")
    return chosen


def _require_numpy(kind: str, choice: Choice) -> None:
    if choice.plugin is not None and not callable(getattr(choice.plugin, "numpy", None)):
        raise Unsupported(f"the {kind} {choice.name!r} has no NumPy function (`numpy`)")
