"""The engine `numba`: everything in compiled kernels, float64 or float32."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from engines.choices import Option, number
from engines.errors import Unsupported
from engines.interface import Settings
from engines.kernels.renderer import Renderer
from engines.kernels.resolve import resolved, why_not
from engines.numba_cpu.accel import area_hierarchy, bvh, grid, none
from engines.scene import Mesh, Scene, SphereSet

ACCELERATORS: dict[str, dict[str, Option]] = {
    "auto": {},
    "none": {},
    "bvh": {},
    "grid": {"density": Option(grid.DENSITY, "cells a primitive", number(0.01, 1000.0))},
    "area_hierarchy": {},
}
MADE = {
    "none": none.Accelerator, "grid": grid.Accelerator, "bvh": bvh.Accelerator,
    "area_hierarchy": area_hierarchy.Accelerator,
}  # fmt: skip
LIST_LIMIT = 96
"""Up to so many primitives `auto` takes no tree."""


class Engine:
    """Float64 by default, as accurate as the reference; float32 is nearly twice as fast."""

    name = "numba"
    lineage = "raybench-kernels"
    version = "1"

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        return ACCELERATORS

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return why_not(scene, resolved(settings, ACCELERATORS, "float64"), self.name)

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        chosen = resolved(settings, ACCELERATORS, "float64")
        lacking = why_not(scene, chosen, self.name)
        if lacking:
            raise Unsupported(lacking)
        wanted: Any = chosen.accelerator
        name = wanted.name
        if name == "auto":
            name = "none" if _primitives(scene) <= LIST_LIMIT else "bvh"
        make = wanted.plugin.make if wanted.plugin is not None else MADE[name]
        return Renderer(scene, chosen, make(wanted.options))


def _primitives(scene: Scene) -> int:
    sizes = (
        len(s.faces) if isinstance(s, Mesh) else len(s.radii) if isinstance(s, SphereSet) else 1 for s in scene.shapes
    )
    return sum(sizes)
