"""The plugin interface: what an engine is, what a renderer does, and the settings they take.

An engine is two classes. `Engine` says what it can do and builds; `Renderer` holds one scene with one set of settings
and fills a film. Shaders, samplers, accelerators and cameras are chosen by name or given as plugin objects.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.choices import SAMPLERS, SHADERS, Option, resolve
from engines.errors import ConfigError
from engines.film import Film
from engines.scene import Camera, Scene, Shape

OnPass = Callable[[Film], Any]
Table = Mapping[str, Mapping[str, Option]]
"""Options by name, of each name of a shader, sampler or accelerator."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How to render. `width` and `height`, in [1, 65536] pixels, default to the scene's resolution.

    `shader`, `sampler` and `accelerator` take a name, a mapping `{"name": ..., option: value}` or a plugin object.
    `precision` is "float64", "float32", or None for the engine's own default. `threads` lies in [1, 1024], `seed` in
    [0, 2^64 - 1]. An image depends on the scene and on these settings, but never on `threads`. Raises `ConfigError` for
    values out of range; names and options are checked by `Engine.prepare`.
    """

    width: int | None = None
    height: int | None = None
    shader: Any = "path_tracer"
    sampler: Any = "sobol"
    accelerator: Any = "auto"
    threads: int = 1
    seed: int = 0
    precision: str | None = None

    def __post_init__(self) -> None:
        limits = {"width": (1, 65_536), "height": (1, 65_536), "threads": (1, 1024), "seed": (0, 2**64 - 1)}
        for key, (low, high) in limits.items():
            value = getattr(self, key)
            if value is None and key in ("width", "height"):
                continue
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not low <= value <= high:
                raise ConfigError(f"settings.{key} = {value!r}: must be an integer in [{low}, {high}]")
            object.__setattr__(self, key, int(value))
        if self.precision not in (None, "float32", "float64"):
            raise ConfigError(f"settings.precision = {self.precision!r}: must be float32 or float64")

    def resolved(
        self, accelerators: Table, precision: str | None, shaders: Table = SHADERS, samplers: Table = SAMPLERS
    ) -> Settings:
        """These with shader, sampler and accelerator as `Choice`s with every option, by the tables of an engine, and with its
        `precision` where they name none. Raises `UnknownName` and `ConfigError` as `engines.choices.resolve` does."""
        return replace(
            self,
            shader=resolve("shader", self.shader, shaders),
            sampler=resolve("sampler", self.sampler, samplers),
            accelerator=resolve("accelerator", self.accelerator, accelerators),
            precision=self.precision or precision,
        )

    def size(self, scene: Scene) -> tuple[int, int]:
        """(width, height) in pixels, from here or from the scene's camera."""
        width, height = scene.camera.resolution
        return int(self.width or width), int(self.height or height)


@dataclass(frozen=True, slots=True)
class Hits:
    """Closest hits of n rays: `t` (n,) in units of the direction's length, inf for a miss; `shape`, `primitive` (n,)
    int64, -1 for a miss; `normal` (n, 3) unit, geometric, facing the ray, 0 for a miss; `u`, `v` (n,) barycentric
    weights of the second and third vertex of a triangle, 0 elsewhere."""

    t: NDArray[np.float64]
    shape: NDArray[np.int64]
    primitive: NDArray[np.int64]
    normal: NDArray[np.float64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]


@runtime_checkable
class Renderer(Protocol):
    """One scene with one set of settings, ready to render.

    Calls may come from any thread. One `render`, `warm_up` or `update` runs at a time: another one raises RuntimeError, at
    once and without effect, also from `on_pass`. `trace` and `occluded` may be called at any time and answer as they do
    alone; they may wait for a pass or an update to end, or raise RuntimeError. In a forked process every call works, or
    raises RuntimeError. `engines.concurrency.CallGuard` keeps these rules for a renderer.
    """

    @property
    def film(self) -> Film:
        """All samples so far."""
        ...

    def warm_up(self) -> None:
        """Compiles what `render` needs and leaves the film untouched; counters()["compile_seconds"] says how long."""
        ...

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        """Adds `spp` samples to every pixel and returns the film. Splitting a call changes no bit of the image.

        `on_pass(film)` is called after every pass over the image. Returns early after `stop`, keeping what is done.
        """
        ...

    def stop(self) -> None:
        """Makes a running `render` return within 0.2 s. May be called from any thread, and from `on_pass`."""
        ...

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        """Changes the camera or the shapes, refits or rebuilds the accelerator, and restarts the film.

        The film then has the size that `Settings.size` gives with the new camera: that of the settings, else the camera's
        resolution. Raises `Unsupported` where the engine lacks the change; the renderer is then as it was.
        """
        ...

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Closest hits in (0, t_max) of rays (n, 3), (n, 3); `t_max` is a number or (n,). Rays that are not finite, or zero,
        miss. Raises `Unsupported` where the engine traces no single rays."""
        ...

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """(n,) bool: whether rays (n, 3), (n, 3) hit anything in (0, t_max). Raises `Unsupported` where the engine traces no
        single rays."""
        ...

    def counters(self) -> Mapping[str, float]:
        """At least: build_seconds, compile_seconds, accelerator_bytes, bad_samples.

        And `rays`, from an engine that counts them: all rays that `render`, `trace` and `occluded` have traced, camera
        rays, scattered rays and shadow rays, each once. Rays that can hit nothing (not finite, zero, t_max not above 0)
        and those of `warm_up` do not count. An engine that cannot count all of them has no `rays`.
        """
        ...


@runtime_checkable
class Engine(Protocol):
    """A way to render scenes. `version` changes when its images or speed may change.

    An engine may have an attribute `lineage`, a line of text: engines of one lineage share code, and with it errors, so that
    none of them certifies a reference by another. Without it the lineage is `name`.

    Optional: `smooth_samplers`, the names of the samplers whose error falls smoothly with every sample, as that of independent
    samples does. Without it that is `random`. Errors of other samplers are not interpolated between measurements.

    Optional: `auto_accelerator(scene, settings)`, a line of text: which accelerator `auto` takes for the scene with these
    settings, and why. `raybench plan` prints it.

    Optional: `overshoots`, true where `render` may leave more samples in the film than were asked for, because the renderer
    stops by being asked whether it is done. The film counts them, and they are on the clock.
    """

    name: str
    version: str

    def why_not(self, scene: Scene, settings: Settings) -> str | None:
        """None where `prepare` would work, else one sentence that says what this engine lacks for the scene.

        Raises `UnknownName` and `ConfigError` where `prepare` does, for settings that are wrong and not merely lacking.
        """
        ...

    def prepare(self, scene: Scene, settings: Settings) -> Renderer:
        """Builds a renderer. Raises `UnknownName` for names and options that do not exist, `ConfigError` for values out of
        range, and `Unsupported`, with the sentence of `why_not`, exactly where that answers one."""
        ...

    def accelerators(self) -> Mapping[str, Mapping[str, Any]]:
        """Known accelerator names, each with its options (name -> `engines.choices.Option`)."""
        ...


@dataclass(frozen=True, slots=True)
class FullPattern:
    """A whole pattern of a sampler: `spp` samples per pixel, and the `sampler`, as plain data `{"name": ..., option: value}`,
    with which one `render(spp)` of a renderer that has rendered nothing yet takes exactly that pattern."""

    spp: int
    sampler: Mapping[str, Any]


@runtime_checkable
class HasPatterns(Protocol):
    """An optional part of `Engine`: samplers whose points are good only as whole patterns, such as multi-jittered ones.

    raybench measures a contestant with such a sampler at whole patterns only: every checkpoint is a renderer of its own,
    prepared with `FullPattern.sampler`, and one timed call `render(FullPattern.spp)`.
    """

    def full_pattern(self, sampler: Mapping[str, Any], spp: int) -> FullPattern | None:
        """The smallest whole pattern of `sampler` with at least `spp` samples per pixel; None where the sampler has no
        patterns. `sampler` is plain data, `{"name": ..., option: value}`, as `Settings.sampler` takes it; `spp` is at
        least 1. The answer depends on these two alone, and does not fall as `spp` rises."""
        ...


@runtime_checkable
class RayTracer(Protocol):
    """One scene, ready to trace rays: `trace`, `occluded` and `counters` as `Renderer` has them."""

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Closest hits; see `Renderer.trace`."""
        ...

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """Whether anything is in the way; see `Renderer.occluded`."""
        ...

    def counters(self) -> Mapping[str, float]:
        """At least: build_seconds, compile_seconds, accelerator_bytes."""
        ...


@runtime_checkable
class HasTracer(Protocol):
    """An optional part of `Engine`: one that traces rays, and need not render.

    `raybench race --rays` asks these where they are there, else `why_not` and `prepare`. Where an engine renders nothing at
    all, its `why_not` says so of every scene.
    """

    def why_not_tracer(self, scene: Scene, settings: Settings) -> str | None:
        """None where `tracer` would work, else one sentence that says what is lacking. Of the settings `accelerator`, `threads`
        and `precision` count; raises as `Engine.why_not` does."""
        ...

    def tracer(self, scene: Scene, settings: Settings) -> RayTracer:
        """Builds what traces. Raises as `Engine.prepare` does."""
        ...
