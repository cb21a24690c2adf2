"""Passes of the scalar variant: Mitsuba renders one sample per pixel, on its own threads, into its own film."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.film import Film
from engines.peers.mitsuba.native import integrator_node
from engines.peers.mitsuba.shaders import path_node
from engines.peers.mitsuba.stage import Stage, far_corner
from engines.peers.mitsuba.streams import seed_of

BLOCK = 16
"""Pixels a side of Mitsuba's blocks. Fixed: its seeds depend on the block, and by default the block on the threads."""


class Passes:
    """Passes of one sample per pixel; each has a seed of its own."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._kind = stage.settings.shader.name
        self._integrator = stage.mi.load_dict(self._node())
        if isinstance(self._integrator, stage.mi.SamplingIntegrator):
            self._integrator = stage.mi.load_dict({**self._node(), "block_size": BLOCK})
        self.restart()

    def _node(self) -> dict[str, Any]:
        options = self._stage.settings.shader.options
        if self._kind == "path_tracer":
            return path_node(options)
        if self._kind == "mitsuba":
            return integrator_node(options)
        return {"type": "aov", "aovs": "a:albedo" if self._kind == "albedo" else "t:depth,p:position"}

    def restart(self) -> None:
        """Back to before the first sample."""
        width, height = self._stage.size
        self.done = 0
        self._film = Film(width, height)

    def step(self, left: int, seen: bool) -> int:
        """Samples per pixel after which `stop` is heard."""
        return 1

    def compile(self) -> None:
        """There is nothing to compile."""

    def render(self, samples: int) -> bool:
        """Adds samples to every pixel; False where `cancel` ended one, which then does not count."""
        for _ in range(samples):
            self._cancelled = False
            seed = seed_of(self._stage.settings.seed, self.done)
            developed = self._integrator.render(self._stage.loaded, self._stage.camera, seed=seed, spp=1)
            if self._cancelled:
                return False
            self._film.add(self._colours(np.array(developed, np.float64)))
            self.done += 1
        return True

    def cancel(self) -> None:
        """Ends a running pass, from another thread."""
        self._cancelled = True
        self._integrator.cancel()

    def fill(self, film: Film) -> None:
        """Copies what has been gathered to the film."""
        for name in ("sums", "squares", "even_sums", "counts"):
            getattr(film, name)[...] = getattr(self._film, name)
        film.bad_samples = self._film.bad_samples

    def _colours(self, developed: NDArray[np.float64]) -> NDArray[np.float64]:
        """(h, w, 3) of what Mitsuba's film shows: colours, reflectances, or depth and position."""
        if self._kind in ("path_tracer", "mitsuba"):
            return np.repeat(developed, 3, axis=2) if developed.shape[2] == 1 else developed[..., :3]
        if self._kind == "albedo":
            return self._stage.scale * developed[..., -3:]
        depth, position = developed[..., -4], developed[..., -3:]
        return np.repeat(_grey(self._stage, depth > 0.0, depth, position)[..., None], 3, axis=2)


def _grey(
    stage: Stage, hit: NDArray[np.bool_], depth: NDArray[np.float64], position: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The shader depth_map, from distances and positions of hits."""
    corner = far_corner(stage)
    if corner is None:
        return np.zeros(depth.shape)
    camera = stage.scene.camera
    forward = np.subtract(camera.target, camera.eye)  # type: ignore[union-attr]
    eye = np.array(camera.eye)  # type: ignore[union-attr]
    if hasattr(camera, "height"):  # orthographic: the ray began in the plane of the eye
        forward = forward / np.linalg.norm(forward)
        eye = position - ((position - eye) @ forward)[..., None] * forward
    reach = 1.1 * np.linalg.norm(corner - eye, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(hit & (reach > 0.0), np.maximum(0.0, (reach - depth) / reach), 0.0)
