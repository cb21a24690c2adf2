"""Passes that Mitsuba renders into its own film: those of the scalar variant, of one sample per pixel on its own threads, and
in the other variant those of integrators that do not estimate the radiance along single rays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.film import Film
from engines.peers.mitsuba import plugins
from engines.peers.mitsuba.library import LLVM
from engines.peers.mitsuba.shaders import path_node, volumetric_node
from engines.peers.mitsuba.stage import Stage, far_corner
from engines.peers.mitsuba.streams import seed_of

BLOCK = 16
"""Pixels a side of Mitsuba's blocks. Fixed: its seeds depend on the block, and by default the block on the threads."""


MOST_LANES = 1 << 26
"""Samples in a pass of the JIT-compiled variant, where a pixel needs no more."""


def renders_images(mi: Any, integrator: Any) -> bool:
    """Whether an integrator only renders whole images: it has no radiance along single rays, or a `render` in Python."""
    classes = type(integrator).__mro__
    own = any("render" in made.__dict__ for made in classes if made.__module__.partition(".")[0] != "mitsuba")
    return own or not isinstance(integrator, mi.SamplingIntegrator)


class Passes:
    """Passes of one sample per pixel, in the JIT-compiled variant of several; each has a seed of its own."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._kind = stage.settings.shader.name
        self._integrator = stage.mi.load_dict(self._node())
        self._several = stage.mi.variant() == LLVM
        if not self._several and isinstance(self._integrator, stage.mi.SamplingIntegrator):
            self._integrator = stage.mi.load_dict({**self._node(), "block_size": BLOCK})
        self.restart()

    def _node(self) -> dict[str, Any]:
        options = self._stage.settings.shader.options
        if self._kind == "path_tracer":
            return path_node(options)
        if self._kind == "volumetric_path_tracer":
            return volumetric_node(options)
        if self._kind == "mitsuba":
            return plugins.node(options)
        return {"type": "aov", "aovs": "a:albedo" if self._kind == "albedo" else "t:depth,p:position"}

    def restart(self) -> None:
        """Back to before the first sample."""
        width, height = self._stage.size
        self.done = 0
        self._film = Film(width, height)

    def step(self, left: int, seen: bool) -> int:
        """Samples per pixel after which `stop` is heard."""
        width, height = self._stage.size
        return min(left, max(1, MOST_LANES // (width * height))) if self._several and not seen else 1

    def compile(self) -> None:
        """Nothing in the scalar variant. In the other what an integrator compiles follows from what it renders: once an image
        of one sample per pixel, by an integrator made for it."""
        if self._several:
            np.array(self._stage.mi.load_dict(self._node()).render(self._stage.loaded, self._stage.camera, seed=0, spp=1))

    def render(self, samples: int) -> bool:
        """Adds samples to every pixel; False where `cancel` ended one, which then does not count."""
        count = samples if self._several else 1
        for _ in range(samples // count):
            self._cancelled = False
            seed = seed_of(self._stage.settings.seed, self.done)
            developed = self._integrator.render(self._stage.loaded, self._stage.camera, seed=seed, spp=count)
            image = np.array(developed, np.float64)
            if self._cancelled:
                return False
            self._film.add_mean(self._colours(image), count)
            self.done += count
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
        if self._kind in ("path_tracer", "volumetric_path_tracer", "mitsuba"):
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
