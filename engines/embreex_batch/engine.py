"""The engine: numpy's renderer over another tracer."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import metadata

import numpy as np

from engines.choices import Choice, Option, one_of
from engines.errors import Unsupported, why_unsupported
from engines.interface import Settings
from engines.numpy_reference.accelerators.exhaustive import Exhaustive
from engines.numpy_reference.accelerators.nearest import Part
from engines.numpy_reference.accelerators.tracer import Tracer
from engines.numpy_reference.accelerators.turned import TurnedParts
from engines.numpy_reference.engine import supported
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.renderer import Renderer
from engines.numpy_reference.shapes import Triangles
from engines.packages import install
from engines.scene import Mesh, Scene, Triangle
from engines.scene.shapes import singles

_OPTIONS = {
    "robust": Option(
        True,
        "Embree's robust traversal: 1 in 1,000 rays aimed exactly at a vertex leaks; without it edges leak, too",
        one_of(True, False),
    )
}
ACCELERATORS: dict[str, dict[str, Option]] = {"auto": _OPTIONS, "embree": _OPTIONS}


class Engine:
    """Embree as its Python package embreex ships it: a wavefront of rays per call, shaded by the engine `numpy`. It traces
    triangles in float32 and shades in float64, always on one thread.

    Other shapes beside the triangles are tested in NumPy, one by one; a scene of these alone is declined.
    """

    name = "embreex_batch"
    lineage = "raybench-numpy"
    version = "1"
    tracing_precision = "float32"

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        return ACCELERATORS

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        return why_unsupported(self._supported, scene, settings)

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        return Renderer(scene, self._supported(scene, settings), _tracer)

    def _supported(self, scene: Scene, settings: Settings) -> Settings:
        found = supported(scene, settings, ACCELERATORS, self.name)
        shapes = [shape for _, shape in singles(scene.shapes)]
        if shapes and not any(isinstance(shape, Triangle | Mesh) for shape in shapes):
            raise Unsupported("embreex holds triangles only, and none of the shapes is one")
        try:
            metadata.version("embreex")
        except metadata.PackageNotFoundError as error:
            raise Unsupported(f"the engine {self.name} needs the package embreex: {install('embreex>=4.4')}") from error
        return found


def _tracer(geometry: Geometry, accelerator: Choice) -> Tracer:
    parts = _parts(geometry, accelerator.options["robust"])
    return Tracer(geometry, Choice("embree", accelerator.options), parts, epsilon=float(np.finfo(np.float32).eps))


def _parts(geometry: Geometry, robust: bool) -> list[Part]:
    from engines.embreex_batch.triangles import BatchTriangles

    parts: list[Part] = [
        BatchTriangles(primitives, robust) if isinstance(primitives, Triangles) else Exhaustive(primitives)
        for primitives in geometry.sets
        if primitives.primitive_id.size
    ]
    if geometry.instances is not None:
        parts.append(TurnedParts(geometry.instances, [_parts(group, robust) for group in geometry.groups], tree=True))
    return parts
