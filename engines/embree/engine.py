"""The engine `embree`: Embree's trees and traversal, with the shading of `engines.kernels`."""

from __future__ import annotations

from collections.abc import Mapping

from engines.choices import Option, one_of
from engines.embree.accelerator import Accelerator
from engines.embree.library import QUALITIES, library
from engines.errors import why_unsupported
from engines.interface import Settings
from engines.kernels.renderer import Renderer
from engines.kernels.resolve import supported
from engines.scene import Scene

_OPTIONS = {
    "quality": Option("medium", "Embree's build quality", one_of(*QUALITIES)),
    "robust": Option(
        True,
        "Embree's robust traversal: 1 in 1,000 rays aimed exactly at a vertex leaks; without it edges leak, too",
        one_of(True, False),
    ),
    "watertight": Option(
        False,
        "solve all triangles in float64, so that nothing leaks at vertices either, at about half the speed",
        one_of(True, False),
    ),
    "refine": Option(
        "auto",
        "compute every hit again in float64, and drop those that miss their triangle; auto: only in float64",
        one_of("auto", True, False),
    ),
}
ACCELERATORS: dict[str, dict[str, Option]] = {"auto": _OPTIONS, "embree": _OPTIONS}

NOT_PROMISED = {
    "ties_go_to_the_lower_index": "among faces that coincide Embree takes the first or the last, as its packets come"
}
"""Keys of the checks of `engines.conformance` that this engine does not promise, with reasons."""


class Engine:
    """Intel's Embree finds the hits, and the kernels of `numba` do the rest. Embree traces in float32; shading is in float32
    by default. With shading in float64 its hits are confirmed and solved again, unless `refine` is off."""

    name = "embree"
    lineage = "raybench-kernels"
    version = "2"
    not_promised: Mapping[str, str] = NOT_PROMISED

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        return ACCELERATORS

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return why_unsupported(self._supported, scene, settings)

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        chosen = self._supported(scene, settings)
        options = chosen.accelerator.options
        refine = chosen.precision == "float64" if options["refine"] == "auto" else options["refine"]
        return Renderer(scene, chosen, Accelerator(options, refine))

    def _supported(self, scene: Scene, settings: Settings) -> Settings:
        chosen = supported(scene, settings, ACCELERATORS, "float32", self.name)
        library()
        return chosen
