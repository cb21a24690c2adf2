"""The engine `numba`: everything in compiled kernels, float64 or float32."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from engines.choices import Option, number, one_of
from engines.errors import Unsupported, why_unsupported
from engines.interface import Settings
from engines.kernels.renderer import Renderer
from engines.kernels.resolve import no_instances, supported
from engines.numba_cpu.accel import area_hierarchy, bvh, grid, none
from engines.numba_cpu.accel.choice import choose
from engines.scene import Instance, Scene

ACCELERATORS: dict[str, dict[str, Option]] = {
    "auto": {},
    "none": {},
    "bvh": {
        "quality": Option(
            bvh.DEFAULT_QUALITY, "of the tree: fast is built sooner, and its rays take more steps", one_of(*bvh.QUALITIES)
        )
    },
    "grid": {"density": Option(grid.DENSITY, "cells per primitive", number(0.01, 1000.0))},
    "area_hierarchy": {},
}
MADE = {
    "none": none.Accelerator,
    "grid": grid.Accelerator,
    "bvh": bvh.Accelerator,
    "area_hierarchy": area_hierarchy.Accelerator,
}


class Engine:
    """Compiled for the scene, sixteen paths at a time; brute force, grid, BVH or area hierarchy. Float64 by default,
    as accurate as the reference engine; float32 is faster."""

    name = "numba"
    lineage = "raybench-kernels"
    version = "1"

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        return ACCELERATORS

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return why_unsupported(self._supported, scene, settings)

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        chosen = self._supported(scene, settings)
        accelerator: Any = chosen.accelerator
        name = accelerator.name
        if name == "auto":
            name, _ = choose(scene, chosen.precision or "float64")
        make = accelerator.plugin.make if accelerator.plugin is not None else MADE[name]
        return Renderer(scene, chosen, make(accelerator.options))

    def _supported(self, scene: Scene, settings: Settings) -> Settings:
        chosen = supported(scene, settings, ACCELERATORS, "float64", self.name)
        accelerator: Any = chosen.accelerator
        finds = accelerator.name == "auto" or getattr(MADE.get(accelerator.name), "instances", False)
        if not finds and any(isinstance(shape, Instance) for shape in scene.shapes):
            raise Unsupported(no_instances(accelerator.name))
        return chosen

    def auto_accelerator(self, scene: Scene, settings: Settings) -> str:
        """What `accelerator: auto` takes, and why; see `engines.interface.Engine`."""
        name, why = choose(scene, settings.precision or "float64")
        return f"{name} ({why})"
