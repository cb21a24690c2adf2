"""The engine, and what traces: triangles through `open3d.t.geometry.RaycastingScene`, in float32."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from importlib import metadata, util
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.choices import Option, resolve
from engines.errors import Unsupported
from engines.interface import Hits, Settings
from engines.packages import install_extra
from engines.scene import Mesh, Scene, Triangle
from engines.scene.shapes import as_mesh
from engines.scene.support import foreign

ACCELERATORS: dict[str, dict[str, Option]] = {"auto": {}}
RENDERS_NOTHING = "Open3D traces rays and renders no images: raybench race --rays compares it"


class Engine:
    """Open3D's RaycastingScene: it traces rays in scenes of triangles, for `raybench race --rays`, and renders no images."""

    name = "open3d"
    tracing_precision = "float32"

    @property
    def version(self) -> str:
        """That of the package."""
        try:
            return f"1 (Open3D {metadata.version('open3d')})"
        except metadata.PackageNotFoundError:
            return "1"

    def accelerators(self) -> Mapping[str, Mapping[str, Option]]:
        return ACCELERATORS

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        resolve("accelerator", settings.accelerator, ACCELERATORS)
        return RENDERS_NOTHING

    def prepare(self, scene: Scene, settings: Settings) -> Any:
        raise Unsupported(self.why_not(scene, settings))

    def why_not_tracer(self, scene: Scene, settings: Settings) -> str | None:
        """None where the scene has triangles alone, and Open3D is installed."""
        if resolve("accelerator", settings.accelerator, ACCELERATORS).plugin is not None:
            return "Open3D takes no accelerator plugins"
        if settings.precision == "float64":
            return "Open3D traces in float32 only"
        if not scene.shapes:
            return "Open3D's RaycastingScene traces triangles, and the scene has no shapes"
        if lacks := foreign(scene, {Mesh, Triangle}, "Open3D's RaycastingScene", kinds=("shape",)):
            return lacks
        if util.find_spec("open3d") is None:
            return f"Open3D is not installed: {install_extra('open3d')}"
        try:
            importlib.import_module("open3d")
        except (ImportError, OSError) as error:
            return f"Open3D cannot be loaded: {error}"
        return None

    def tracer(self, scene: Scene, settings: Settings) -> Tracer:
        """Raises `Unsupported` in the words of `why_not_tracer`."""
        lacking = self.why_not_tracer(scene, settings)
        if lacking:
            raise Unsupported(lacking)
        return Tracer(scene, settings.threads)


class Tracer:
    """One scene: each shape is a geometry of its own, whose number is that of the shape. Calls share `threads` threads."""

    def __init__(self, scene: Scene, threads: int) -> None:
        start = perf_counter()
        open3d = importlib.import_module("open3d")
        self._tensor, self._threads = open3d.core.Tensor, threads
        self._scene = open3d.t.geometry.RaycastingScene(nthreads=threads)
        for shape in scene.shapes:
            mesh = as_mesh(shape)
            assert mesh is not None
            vertices, faces = np.ascontiguousarray(mesh.vertices, np.float32), np.ascontiguousarray(mesh.faces, np.uint32)
            self._scene.add_triangles(self._tensor(vertices), self._tensor(faces))
        self._scene.cast_rays(self._tensor(np.ones((1, 6), np.float32)), nthreads=threads)  # the first query builds
        self._build_seconds = perf_counter() - start

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Closest hits; see `engines.interface.Renderer`."""
        rays, good, far = _rays(origins, directions, t_max)
        answer = self._scene.cast_rays(self._tensor(rays), nthreads=self._threads)
        t = answer["t_hit"].numpy().astype(np.float64)
        miss = ~good | ~(t < far)
        normal = answer["primitive_normals"].numpy().astype(np.float64)
        away = (normal * rays[:, 3:]).sum(axis=1, keepdims=True) > 0
        uv = answer["primitive_uvs"].numpy().astype(np.float64)
        shape, primitive = (answer[name].numpy().astype(np.int64) for name in ("geometry_ids", "primitive_ids"))
        for array, nothing in ((t, np.inf), (shape, -1), (primitive, -1), (uv, 0.0)):
            array[miss] = nothing
        normal = np.where(miss[:, None], 0.0, np.where(away, -normal, normal))
        return Hits(t, shape, primitive, normal, uv[:, 0], uv[:, 1])

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """Whether anything lies in (0, t_max). Open3D takes one end for all rays of a call: rays with an end of their own get
        a direction of that length, and end at 1."""
        rays, good, far = _rays(origins, directions, t_max)
        dark = np.zeros(len(rays), bool)
        for finite in (True, False):
            chosen = np.flatnonzero(good & (np.isfinite(far) == finite))
            if not chosen.size:
                continue
            part = rays[chosen]
            if finite:
                part[:, 3:] = (part[:, 3:] * far[chosen, None]).astype(np.float32)
            end = 1.0 if finite else np.inf
            answer = self._scene.test_occlusions(self._tensor(part), tfar=end, nthreads=self._threads)
            dark[chosen] = answer.numpy()
        return dark

    def counters(self) -> Mapping[str, float]:
        """Seconds of the build. Open3D does not report the memory of its tree."""
        return {"build_seconds": self._build_seconds, "compile_seconds": 0.0, "accelerator_bytes": 0.0}


def _rays(
    origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float64]]:
    """Rays (n, 6), which of them can hit anything, and their ends. Those that cannot are at rest, which Open3D misses with."""
    with np.errstate(over="ignore"):
        parts = [np.asarray(each, np.float32).reshape(-1, 3) for each in (origins, directions)]
    if parts[0].shape != parts[1].shape:
        raise ValueError(f"origins {parts[0].shape} and directions {parts[1].shape}: both must have the shape (n, 3)")
    rays = np.concatenate(parts, axis=1)
    far = np.broadcast_to(np.asarray(t_max, np.float64), (len(rays),))
    good = np.isfinite(rays).all(axis=1) & rays[:, 3:].any(axis=1) & (far > 0)
    rays[~good] = 0.0
    return rays, good, far
