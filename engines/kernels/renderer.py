"""The renderer of the jitted engines: compiles the stages a scene needs, keeps the film, shares tiles among threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.concurrency import CallGuard
from engines.errors import RendererFailed, Unsupported
from engines.film import Film
from engines.interface import Hits, OnPass, Settings
from engines.kernels import driver, pipeline, queries
from engines.kernels.compile import jit
from engines.kernels.compile.second_process import compile_jobs
from engines.kernels.flatten import flatten
from engines.kernels.flatten.guide import bind_guide
from engines.kernels.flatten.light_samplers import bind_light_cells, bind_light_sampler
from engines.kernels.guide_records import records_of
from engines.kernels.layout import LANES, SHADER_OPTIONS, VERTEX_DRAWS, SceneTable, aligned, batch_bytes, stack_bytes
from engines.kernels.resolve import known, no_instances
from engines.kernels.stages import camera, sampler, shade, surface
from engines.light_cells import light_cells
from engines.scene import Camera, Scene, Shape
from engines.scene.support import foreign
from engines.sd_tree import Training

CHUNK = 4
"""Samples per pixel between two commits of a tile."""
SAMPLES_A_TABLE = 4096
"""Samples whose quasi-random points are tabulated at once."""
STACK_CAPACITY, LARGEST_STACK = 32, 1 << 16
"""Rays that may wait on a lane's stack: at first, and at most. A stack that is full is doubled, and the pass repeated."""
SHARED_RAYS = 4096
"""From so many rays on, `trace` and `occluded` share them among threads."""


Reals = NDArray[np.float64]


class Renderer:
    """One scene, one set of resolved settings (every choice a `Choice`), one accelerator."""

    def __init__(self, scene: Scene, settings: Settings, accelerator: pipeline.Accelerator) -> None:
        self._wanted = settings
        self._scene = scene
        self._accelerator = accelerator
        self._real: Any = np.float64 if settings.precision == "float64" else np.float32
        self._tracing = accelerator.precision or self._real
        self._rays = 0
        self._compile_seconds = 0.0
        self._build_seconds = 0.0
        self._guard = CallGuard(after_fork=self._start_threads)
        self._start_threads()
        self._control = np.zeros(3, np.int64)
        self._resize(scene)
        self._stages: pipeline.Stages | None = None
        self._ray_stages: pipeline.Stages | None = None
        self._batch_bytes = batch_bytes(self._real, accelerator.scratch)
        # of each thread: its ray batch, and behind it the one in which samples begin
        both = self._batch_bytes + batch_bytes(self._real, 0)
        self._memory = [aligned(both) for _ in range(settings.threads)]
        self._set_stacks(STACK_CAPACITY)
        self._build(scene)

    # ---- preparation -------------------------------------------------------------------------------------------------

    def _start_threads(self) -> None:
        """Pools for rendering and for tracing beside it; their threads start when there is work. And the locks that
        threads share."""
        self._pool = ThreadPoolExecutor(self._wanted.threads, thread_name_prefix="raybench")
        self._tracing_pool = ThreadPoolExecutor(self._wanted.threads, thread_name_prefix="raybench-trace")
        self._preparing, self._counting = threading.RLock(), threading.Lock()

    def _resize(self, scene: Scene) -> None:
        """An empty film, and tiles, of the size that the settings and the scene's camera give. Raises `ConfigError` where
        it does not fit into memory, and then changes nothing."""
        width, height = self._wanted.size(scene)
        self.film = Film(width, height)
        self.settings = replace(self._wanted, width=width, height=height)
        self._tiles = driver.tiles(width, height)
        self._done = np.zeros(len(self._tiles), np.int64)

    def _set_stacks(self, capacity: int) -> None:
        """Stacks with room for `capacity` rays per lane, one per thread."""
        self._stack_capacity = capacity
        self._stacks = [aligned(stack_bytes(self._real, capacity)) for _ in self._memory]

    def _build(self, scene: Scene) -> None:
        """Takes `scene`; where that fails, everything is left as it was."""
        start, compiled = time.perf_counter(), jit.compile_seconds
        flat = flatten(scene, self._real, self._tracing)
        if flat.features.instances and not getattr(self._accelerator, "instances", False):
            raise Unsupported(no_instances(self._accelerator.name))
        bind_light_sampler(flat, scene, shade.light_sampler(self._wanted.shader))
        flat.features = shade.with_integrator(flat.features, self._wanted.shader)
        self._accelerator.build(flat, self._wanted.threads)
        compiled = jit.compile_seconds - compiled
        self._build_seconds = time.perf_counter() - start - compiled
        self._compile_seconds += compiled
        if self._wanted.size(scene) != (self.film.width, self.film.height):
            self._resize(scene)
        self._scene, self._flat, self._stages, self._ray_stages = scene, flat, None, None
        self._lights_learned = not flat.features.light_cells
        self._flat.bind(SceneTable.margins, surface.margins(self._tracing))
        self._training = self._untrained()
        self._bind_guide()
        self._bind_options()
        self._bind_camera()

    def _bind_options(self) -> None:
        shader, chosen = self.settings.shader, self.settings.sampler
        numbers = np.zeros(16)
        numbers[:SHADER_OPTIONS] = shade.option_numbers(shader, self._flat.bounds, self._flat.center)
        if chosen.plugin is None and chosen.name == "constant":
            numbers[sampler.SAMPLER_OPTION] = chosen.options["value"]
        elif chosen.plugin is None and chosen.name == "stratified":
            numbers[sampler.SAMPLER_OPTION] = (chosen.options["strata"].bit_length() - 1) // 2
        self._flat.bind(SceneTable.options, numbers)
        self._flat.bind(SceneTable.seed_key, sampler.seed_key(self.settings.seed))
        n_lights = int(self._flat.table[SceneTable.n_lights.first])
        self._flat.bind(SceneTable.light_choices, 1 if shade.integrator_of(shader).every_light else n_lights)
        self._flat.bind(SceneTable.wanted_draws, shade.wanted_draws(shader, self._flat.features))
        self._bind_points(0, 1)

    def _untrained(self) -> Training | None:
        """What guides paths, before it has learned anything; None where nothing does."""
        if not self._flat.features.guided:
            return None
        options, boxes = self._wanted.shader.options, [shape.bounds() for shape in self._scene.shapes]
        finite = [box for box in boxes if box is not None]
        return Training(finite, options["spatial_threshold"], options["flux_threshold"])

    def _bind_guide(self) -> None:
        if self._training is not None:
            fraction = self._wanted.shader.options["bsdf_fraction"] if self._training.guides else 1.0
            bind_guide(self._flat, self._training.tree, fraction)

    def _guide_totals(self) -> NDArray[np.int64]:
        return np.zeros((0, 4, 3), np.int64) if self._training is None else self._training.totals

    def _bind_camera(self) -> None:
        width, height = self.film.width, self.film.height
        view = self._scene.camera
        self._flat.bind(SceneTable.camera, camera.parameters(view, width, height, self._flat.center))
        medium = getattr(view, "medium", None)
        self._flat.bind(SceneTable.camera_medium, len(self._scene.media) if medium is None else medium)
        if hasattr(self._accelerator, "look"):  # one that knows where camera rays start
            self._accelerator.look(self._flat, camera.has_eye(view))

    def _bind_points(self, first: int, last: int) -> None:
        points = sampler.points(self.settings.sampler, first, last)
        spare = np.zeros((len(points), VERTEX_DRAWS), np.uint32)  # a row is read to its end and beyond
        self._flat.bind(SceneTable.sample_points, np.hstack([points, spare]))
        self._flat.bind(SceneTable.points_stride, points.shape[1] + VERTEX_DRAWS)
        self._flat.bind(SceneTable.first_sample, first)

    def _require_stages(self) -> pipeline.Stages:
        """The stages, which the first call compiles or loads."""
        with self._preparing:
            if self._stages is None:
                start = time.perf_counter()
                self._compile()
                self._compile_seconds += time.perf_counter() - start
            assert self._stages is not None
            return self._stages

    def _require_ray_stages(self) -> pipeline.Stages:
        """The same of those that single rays need: the integrator's and its lights' are not among them."""
        with self._preparing:
            if self._ray_stages is None:
                start = time.perf_counter()
                self._ray_stages, self._kept_for_rays = pipeline.stages(pipeline.ray_table(self._stage_config()))
                self._compile_seconds += time.perf_counter() - start
            return self._ray_stages

    def _stage_config(self) -> pipeline.StageConfig:
        settings, camera_model = self.settings, self._scene.camera
        return pipeline.StageConfig(
            self._flat.features, settings.shader, settings.sampler, camera_model, self._accelerator, self._real
        )

    def _compile(self) -> None:
        """Compiles or loads the driver, and the stages that the scene and its integrator need."""
        config = self._stage_config()
        table = list(pipeline.table(config))
        compile_jobs([self._compile_driver, *pipeline.jobs(table)])
        self._stages, self._kept = pipeline.stages(table)  # machine code lives as long as its stage
        self._plan = pipeline.plan(config, int(self._flat.table[SceneTable.n_lights.first]))

    # ---- rendering ---------------------------------------------------------------------------------------------------

    def warm_up(self) -> None:
        """Compiles everything `render`, `trace` and `occluded` need, by running it on one pixel of a film of its own."""
        with self._guard.rendering("warm_up"):
            start, before = time.perf_counter(), self._compile_seconds
            self._control[driver.STOP] = 0
            # sample 0 is drawn, whatever the film has: the table must begin with it
            self._bind_points(0, 1)
            film, tile = Film(self.film.width, self.film.height), self._tiles[:1].copy()
            tile[0, 2:] = 1
            learned = self._guide_totals().copy()
            self._drive(film, tile, np.zeros(1, np.int64), 1)
            self._guide_totals()[:] = learned
            ray = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.full(1, np.inf)
            self._trace(*ray)
            self._occluded(*ray)
            self._compile_seconds = before + time.perf_counter() - start

    def render(self, spp: int, on_pass: OnPass | None = None) -> Film:
        """Adds `spp` samples per pixel; see `engines.interface.Renderer`."""
        with self._guard.rendering():
            self._control[driver.STOP] = 0
            self._require_stages()
            self._learn_lights()
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

    def _learn_lights(self) -> None:
        """Traces the rays by which lights are chosen, before the first sample that depends on them."""
        if not self._lights_learned:
            bind_light_cells(self._flat, light_cells(self._scene, self.trace))
            self._lights_learned = True

    def _render_to(self, target: int) -> None:
        """Brings every tile to `target` samples per pixel (a stopped render may have left some ahead of others)."""
        training = self._training
        while training is not None and training.end <= target and not self._control[driver.STOP]:
            self._render_tiles_to(training.end)
            if self._done.min() >= training.end:
                training.advance()
                self._bind_guide()
        if not self._control[driver.STOP]:
            self._render_tiles_to(target)

    def _render_tiles_to(self, target: int) -> None:
        self._bind_points(int(self._done.min()), target)
        self._count(self._drive(self.film, self._tiles, self._done, target))

    def _drive(self, film: Film, tiles: NDArray[np.int32], done: NDArray[np.int64], target: int) -> int:
        """Runs the driver on all threads until every tile has `target` samples; returns the rays traced."""
        rays = self._drive_once(film, tiles, done, target)
        while self._control[driver.STACK_FULL]:
            if self._stack_capacity >= LARGEST_STACK:
                raise RendererFailed(
                    f"the shader {self.settings.shader.name!r} leaves more than {LARGEST_STACK:,} rays waiting in one "
                    "path: it must end its paths, by their depth for example"
                )
            self._set_stacks(2 * self._stack_capacity)
            rays += self._drive_once(film, tiles, done, target)
        return rays

    def _drive_once(self, film: Film, tiles: NDArray[np.int32], done: NDArray[np.int64], target: int) -> int:
        stages = self._require_stages()  # before NEXT_TILE is set: compiling the driver takes a tile
        plan = self._plan
        self._control[driver.NEXT_TILE] = self._control[driver.STACK_FULL] = 0

        def work(memory: NDArray[np.uint8], stack: NDArray[np.uint8]) -> NDArray[np.int64]:
            return self._call_driver(stages, plan, film, tiles, done, target, memory, stack)

        futures = [self._pool.submit(work, *parts) for parts in zip(self._memory, self._stacks, strict=True)]
        try:
            totals = sum(future.result() for future in futures)
        except BaseException:  # an interrupt, say: the threads must not go on writing to the film
            self._control[driver.STOP] = 1
            wait(futures)
            raise
        film.bad_samples += int(totals[driver.BAD_SAMPLES])
        return int(totals[driver.RAYS])

    def _call_driver(
        self,
        stages: pipeline.Stages,
        plan: pipeline.Plan,
        film: Film,
        tiles: NDArray[np.int32],
        done: NDArray[np.int64],
        target: int,
        memory: NDArray[np.uint8],
        stack: NDArray[np.uint8],
    ) -> NDArray[np.int64]:
        """What one thread does; returns the driver's totals."""
        shadows = aligned(self._batch_bytes if plan.null_lobes else 0)
        totals = np.zeros(2, np.int64)
        buffer = np.empty(3 * CHUNK * driver.TILE**2, self._real)
        records = records_of(CHUNK * driver.TILE**2 if plan.guided else 0, self._guide_totals(), self._real)
        batch = memory.ctypes.data
        addresses = driver.Memory(
            batch, batch + self._batch_bytes, shadows.ctypes.data, stack.ctypes.data, self._stack_capacity
        )
        arrays = driver.FilmArrays(*(each.reshape(-1) for each in (film.sums, film.squares, film.even_sums, film.counts)))
        drive, scene = driver.driver(self._real), self._flat.address
        work = tiles, done, target, CHUNK, film.width
        drive(stages, plan, scene, addresses, *work, self._control, arrays, buffer, records, totals)
        return totals

    def _compile_driver(self) -> None:
        """Compiles or loads the driver, by a call without tiles."""
        nothing = self._tiles[:0], self._done[:0], 0
        self._call_driver(pipeline.Stages(), pipeline.Plan(), self.film, *nothing, self._memory[0], self._stacks[0])

    def _count(self, rays: int) -> None:
        with self._counting:
            self._rays += rays

    def stop(self) -> None:
        """Ends a running `render` soon; what whole tiles have gathered stays."""
        self._control[driver.STOP] = 1

    def update(self, camera: Camera | None = None, shapes: Sequence[Shape] | None = None) -> None:
        """Changes the view or the shapes (a new accelerator is built) and restarts the film."""
        with self._guard.updating():
            scene = self._scene if camera is None else replace(self._scene, camera=camera)
            scene = scene if shapes is None else replace(scene, shapes=tuple(shapes))
            if lacking := foreign(scene, known(), "this engine", ("camera", "shape")):
                raise Unsupported(lacking)
            if shapes is not None:
                self._build(scene)
            elif camera is not None:
                if self._wanted.size(scene) != (self.film.width, self.film.height):
                    self._resize(scene)
                self._scene, self._stages = scene, None
                self._bind_camera()
            self._done[:] = 0
            self.film.clear()
            if self._training is not None:
                self._training.restart()
                self._bind_guide()

    # ---- rays --------------------------------------------------------------------------------------------------------

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """Closest hits; see `engines.interface.Renderer`."""
        rays = queries.rays_of(origins, directions, t_max)
        with self._guard.tracing():
            hits, traced = self._trace(*rays)
        self._count(traced)
        return hits

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """Whether anything lies in (0, t_max); see `engines.interface.Renderer`."""
        rays = queries.rays_of(origins, directions, t_max)
        with self._guard.tracing():
            answer, traced = self._occluded(*rays)
        self._count(traced)
        return answer

    def _trace(self, o: Reals, d: Reals, t_max: Reals) -> tuple[Hits, int]:
        n = len(o)
        t, shape, primitive, normal = np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 3))
        hits = t, shape, primitive, normal, np.empty(n), np.empty(n)
        kernel = queries.tracer(self._flat.features.instances, self._real)
        traced = self._share(kernel, n, o, d, t_max, (self._flat.first_id, self._flat.places, *hits))
        return Hits(*hits), traced

    def _occluded(self, o: Reals, d: Reals, t_max: Reals) -> tuple[NDArray[np.bool_], int]:
        answer = np.zeros(len(o), np.bool_)
        return answer, self._share(queries.shadow_tracer(self._real), len(o), o, d, t_max, (answer,))

    def _share(self, kernel: Any, n: int, o: Reals, d: Reals, t_max: Reals, outputs: tuple[Any, ...]) -> int:
        """Runs `kernel` over n rays, a stretch a thread, in memory of this call's own, as a render may be under way;
        returns how many of the rays were traced."""
        stages, scene, center = self._require_ray_stages(), self._flat.address, self._flat.center
        threads = self.settings.threads if n >= SHARED_RAYS else 1
        edges = [n * k // threads // LANES * LANES for k in range(threads)] + [n]

        def work(k: int) -> int:
            memory = aligned(self._batch_bytes)
            return kernel(stages, memory.ctypes.data, scene, o, d, t_max, center, edges[k], edges[k + 1], *outputs)

        return work(0) if threads == 1 else sum(self._tracing_pool.map(work, range(threads)))

    def counters(self) -> dict[str, float]:
        """Rays traced, seconds spent building and compiling, bytes of the accelerator and of the scene, bad samples."""
        return {
            "rays": self._rays,
            "build_seconds": self._build_seconds,
            "compile_seconds": self._compile_seconds,
            "accelerator_bytes": self._accelerator.bytes,
            "scene_bytes": self._flat.bytes,
            "bad_samples": self.film.bad_samples,
        }
