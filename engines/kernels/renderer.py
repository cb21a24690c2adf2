"""The renderer of the jitted engines: compiles the stages a scene needs, keeps the film, shares tiles among threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from itertools import chain
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.choices import Choice
from engines.film import Film
from engines.interface import Hits, OnPass, Settings
from engines.kernels import camera, driver, jit, lights, samplers, surface
from engines.kernels.block import block_bytes
from engines.kernels.shaders import stage as shading
from engines.kernels.world import (
    CAMERA,
    FIRST_SAMPLE,
    MARGINS,
    N_LIGHTS,
    OPTIONS,
    POINTS,
    POINTS_STRIDE,
    SEED_KEY,
    WANTED,
    Needs,
    World,
    flatten,
)
from engines.scene.model import Camera, CustomCamera, Perspective, PerspectiveArctan, Scene, Shape

TILE = 32
"""Pixels a side. A tile's last lanes run half empty, so tiles are not small; a hundred of them keep threads busy."""
CHUNK = 4
"""Samples a pixel between two commits of a tile."""
SAMPLES_A_TABLE = 4096
"""Samples whose quasi-random points are tabulated at once."""


class Accelerator(Protocol):
    """What finds hits: builds its arrays into the world and gives the stages that walk them."""

    name: str
    scratch: int
    precision: Any
    """Scalar type in which it traces, or None for that of the block."""
    build_seconds: float

    @property
    def bytes(self) -> int: ...

    def build(self, world: World, threads: int) -> None: ...

    def stages(self, needs: Needs, real: Any) -> tuple[Any, Any]: ...


class Renderer:
    """One scene, one set of resolved settings (every choice a `Choice`), one accelerator."""

    def __init__(self, scene: Scene, settings: Settings, accelerator: Accelerator, plugins: Mapping[str, Any]) -> None:
        width, height = settings.size(scene)
        self.settings = replace(settings, width=width, height=height)
        self.film = Film(width, height)
        self._scene = scene
        self._accelerator = accelerator
        self._plugins = plugins
        self._real: Any = np.float64 if settings.precision == "float64" else np.float32
        self._tracing = accelerator.precision or self._real
        self._rays = 0
        self._compile_seconds = 0.0
        self._build_seconds = 0.0
        self._running = threading.Lock()
        self._control = np.zeros(2, np.int64)
        self._tiles = _tiles(width, height)
        self._done = np.zeros(len(self._tiles), np.int64)
        self._addresses: NDArray[np.int64] | None = None
        self._pool = ThreadPoolExecutor(settings.threads, thread_name_prefix="raybench")
        self._block_bytes = block_bytes(self._real, accelerator.scratch)
        # of each thread: its block of lanes, and behind it the one in which samples begin
        both = self._block_bytes + block_bytes(self._real, 0)
        self._memory = [_aligned(both) for _ in range(settings.threads)]
        self._build()

    # ---- preparation -------------------------------------------------------------------------------------------------

    def _build(self) -> None:
        start, compiled = time.perf_counter(), jit.compile_seconds
        self._world = flatten(self._scene, self._real, self._tracing)
        self._accelerator.build(self._world, self.settings.threads)
        compiled = jit.compile_seconds - compiled
        self._build_seconds = time.perf_counter() - start - compiled
        self._compile_seconds += compiled
        self._lit = int(self._world.table[N_LIGHTS]) > 0
        self._world.bind(MARGINS, surface.margins(self._tracing))
        self._bind_options()
        self._bind_camera()
        self._addresses = None

    def _bind_options(self) -> None:
        shader, sampler = self.settings.shader, self.settings.sampler
        numbers = np.zeros(16)
        numbers[: shading.SHADER_OPTIONS] = shading.option_numbers(shader, self._world.bounds, self._world.center)
        if sampler.name == "constant":
            numbers[samplers.SAMPLER_OPTION] = sampler.options["value"]
        elif sampler.name == "stratified":
            numbers[samplers.SAMPLER_OPTION] = (sampler.options["strata"].bit_length() - 1) // 2
        self._world.bind(OPTIONS, numbers)
        self._world.bind(SEED_KEY, samplers.seed_key(self.settings.seed))
        self._world.bind(WANTED, shading.wanted_draws(shader, self._world.needs))
        self._bind_points(0, 1)

    def _bind_camera(self) -> None:
        width, height = self.settings.size(self._scene)
        self._world.bind(CAMERA, camera.parameters(self._scene.camera, width, height, self._world.center))
        if hasattr(self._accelerator, "look"):  # one that knows where camera rays start
            has_eye = isinstance(self._scene.camera, (Perspective, PerspectiveArctan))
            self._accelerator.look(self._world, has_eye)

    def _bind_points(self, first: int, last: int) -> None:
        points = samplers.points(self.settings.sampler, first, last)
        spare = np.zeros((len(points), samplers.DRAWS), np.uint32)  # a row is read to its end and beyond
        self._world.bind(POINTS, np.hstack([points, spare]))
        self._world.bind(POINTS_STRIDE, points.shape[1] + samplers.DRAWS)
        self._world.bind(FIRST_SAMPLE, first)

    def _stages(self) -> NDArray[np.int64]:
        """Addresses of the stages, compiled or loaded the first time they are asked for; that of `trace` alone by `_trace`."""
        if self._addresses is not None:
            return self._addresses
        start = time.perf_counter()
        needs, real, shader = self._world.needs, self._real, self.settings.shader
        closest, occluded = self._accelerator.stages(needs, real)
        draw_pixel, draw_vertex = self._sampler_stages()
        every, self._shadows, self._branches = self._shader_traits()
        self._turns = max(int(self._world.table[N_LIGHTS]), 1) if every else 1
        self._lit = self._lit and shader.name not in ("albedo", "depth_map")
        if shader.plugin is None:
            shade = shading.stage(shader.name, needs, self._lit, real)
        else:
            shade = shading.plugin_stage(self._plugins["shader"], every, needs, self._lit, real)
        light = lights.stage(needs, every, real) if self._lit else shade
        order = [
            draw_pixel,
            self._camera_stage(),
            closest,
            surface.stage(needs, real),
            draw_vertex,
            light,
            shade,
            occluded,
        ]
        self._kept = order  # machine code lives as long as its stage
        self._addresses = np.array([*(stage.address for stage in order), 0], np.int64)
        self._compile_seconds += time.perf_counter() - start
        return self._addresses

    def _sampler_stages(self) -> tuple[Any, Any]:
        sampler = self.settings.sampler
        if sampler.plugin is not None:
            return samplers.plugin_stages(self._plugins["sampler"], self._real)
        return samplers.stages(sampler.name, sampler.options.get("scramble") != "none", self._real)

    def _shader_traits(self) -> tuple[bool, bool, bool]:
        """(called for every light, sends shadow rays, follows two rays from a hit)."""
        shader = self.settings.shader
        if shader.plugin is not None:
            return getattr(shader.plugin, "lights", "one") == "all", True, True
        rule = shading.SHADERS[shader.name]
        return rule.EVERY_LIGHT, shader.name != "no_shadows", rule.BRANCHES

    def _camera_stage(self) -> Any:
        view = self._scene.camera
        if isinstance(view, CustomCamera):
            options = tuple(float(value) for value in view.options.values())
            return camera.plugin_stage(view.plugin.jitted, options, self._real)
        return camera.stage(type(view), self._real)

    # ---- rendering ---------------------------------------------------------------------------------------------------

    def warm_up(self) -> None:
        """Compiles everything `render`, `trace` and `occluded` need, by running it on one pixel of a film of its own."""
        start, before = time.perf_counter(), self._compile_seconds
        self._stages()
        done, film = self._done[:1].copy(), Film(*self.settings.size(self._scene))
        tile = self._tiles[:1].copy()
        tile[0, 2:] = 1
        self._drive(film, tile, done, 1)
        ray = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
        self._trace(*ray, np.inf)
        self._occluded(*ray, np.inf)
        self._compile_seconds = before + time.perf_counter() - start

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        """Adds `spp` samples a pixel; see `engines.interface.Renderer`."""
        if not self._running.acquire(blocking=False):
            raise RuntimeError("this renderer is rendering already")
        try:
            self._control[driver.STOP] = 0
            self._stages()
            first = self.film.spp
            step = 1 if on_pass else SAMPLES_A_TABLE
            # not a list: that of an endless render takes tenths of a second to make, and to drop after stop()
            for target in chain(range(first + step, first + spp, step), [first + spp] if spp > 0 else []):
                self._render_to(target)
                if self._control[driver.STOP]:
                    break
                if on_pass:
                    on_pass(self.film)
                if self._control[driver.STOP]:
                    break
            return self.film
        finally:
            self._running.release()

    def _render_to(self, target: int) -> None:
        """Brings every tile to `target` samples a pixel (a stopped render may have left some ahead of others)."""
        self._bind_points(int(self._done.min()), target)
        self._rays += self._drive(self.film, self._tiles, self._done, target)

    def _drive(self, film: Film, tiles: NDArray[np.int32], done: NDArray[np.int64], target: int) -> int:
        """Runs the driver on all threads; returns the rays traced."""
        self._control[driver.NEXT_TILE] = 0
        stages, kernel = self._stages(), driver.driver(self._real)
        width, _ = self.settings.size(self._scene)
        rule = driver.Rule(self._lit, self._shadows, self._branches, self._turns)
        sums = [array.reshape(-1, 3) for array in (film.sums, film.squares, film.even_sums)]

        def work(memory: NDArray[np.uint8]) -> NDArray[np.int64]:
            totals = np.zeros(2, np.int64)
            buffer = np.empty((CHUNK * TILE * TILE, 3), self._real)
            kernel(
                stages, memory.ctypes.data, memory.ctypes.data + self._block_bytes, self._world.address, rule,
                tiles, done, target, CHUNK, width, self._control, *sums, film.counts.reshape(-1), buffer, totals,
            )  # fmt: skip
            return totals

        futures = [self._pool.submit(work, memory) for memory in self._memory]
        try:
            totals = sum(future.result() for future in futures)
        except BaseException:  # an interrupt, say: the threads must not go on writing to the film
            self._control[driver.STOP] = 1
            wait(futures)
            raise
        film.bad_samples += int(totals[driver.BAD_SAMPLES])
        return int(totals[driver.RAYS])

    def stop(self) -> None:
        """Ends a running `render` soon; what whole tiles have gathered stays."""
        self._control[driver.STOP] = 1

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        """Changes the view or the shapes (a new accelerator is built) and restarts the film."""
        if camera is not None:
            self._scene = replace(self._scene, camera=camera)
        if shapes is not None:
            self._scene = replace(self._scene, shapes=tuple(shapes))
            self._build()
        elif camera is not None:
            self._bind_camera()
            self._addresses = None
        self._done[:] = 0
        self.film.clear()

    # ---- rays --------------------------------------------------------------------------------------------------------

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Closest hits; see `engines.interface.Renderer`."""
        return self._trace(origins, directions, t_max)

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """Whether anything lies in (0, t_max); see `engines.interface.Renderer`."""
        return self._occluded(origins, directions, t_max)

    def _trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> Hits:
        o, d, reach = _rays(origins, directions, t_max)
        n = len(o)
        t, shape, primitive, normal = np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 3))
        hits = t, shape, primitive, normal, np.empty(n), np.empty(n)
        stages = self._stages()
        if not stages[driver.BARE_SURFACE]:
            self._kept.append(surface.bare_stage(self._world.needs, self._real))
            stages[driver.BARE_SURFACE] = self._kept[-1].address
        self._share(driver.tracer(self._real), n, o, d, reach, (self._world.first_rank, *hits))
        return Hits(*hits)

    def _occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> NDArray[np.bool_]:
        o, d, reach = _rays(origins, directions, t_max)
        answer = np.zeros(len(o), np.bool_)
        self._share(driver.shadow_tracer(self._real), len(o), o, d, reach, (answer,))
        return answer

    def _share(self, kernel: Any, n: int, o: Any, d: Any, reach: Any, outputs: tuple[Any, ...]) -> None:
        """Runs `kernel` over n rays, a stretch a thread."""
        stages, world, center = self._stages(), self._world.address, self._world.center
        threads = self.settings.threads if n >= 4096 else 1
        edges = [n * k // threads // jit.LANES * jit.LANES for k in range(threads)] + [n]

        def work(k: int) -> None:
            kernel(
                stages, self._memory[k].ctypes.data, world, o, d, reach, center, edges[k], edges[k + 1], *outputs
            )  # fmt: skip

        list(self._pool.map(work, range(threads)))

    def counters(self) -> dict[str, float]:
        """rays traced by `render`, seconds spent building and compiling, bytes of the accelerator and of the scene."""
        return {
            "rays": self._rays,
            "build_seconds": self._build_seconds,
            "compile_seconds": self._compile_seconds,
            "accelerator_bytes": self._accelerator.bytes,
            "scene_bytes": self._world.bytes,
            "bad_samples": self.film.bad_samples,
        }


def _rays(origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> tuple[NDArray[np.float64], ...]:
    o = np.ascontiguousarray(np.atleast_2d(np.asarray(origins, np.float64)))
    d = np.ascontiguousarray(np.atleast_2d(np.asarray(directions, np.float64)))
    if o.ndim != 2 or o.shape[1] != 3 or o.shape != d.shape:
        raise ValueError(f"origins {o.shape} and directions {d.shape}: both must have the shape (n, 3)")
    return o, d, np.ascontiguousarray(np.broadcast_to(np.asarray(t_max, np.float64), (len(o),)))


def _tiles(width: int, height: int) -> NDArray[np.int32]:
    """(n, 4) x, y, columns, rows of the tiles that cover an image."""
    return np.array(
        [
            (x, y, min(TILE, width - x), min(TILE, height - y))
            for y in range(0, height, TILE)
            for x in range(0, width, TILE)
        ],
        np.int32,
    )


def _aligned(size: int) -> NDArray[np.uint8]:
    """Zeroed memory that starts on a cache line."""
    memory = np.zeros(size + 64, np.uint8)
    start = -memory.ctypes.data % 64
    return memory[start : start + size]


__all__ = ["Accelerator", "Choice", "Renderer"]
