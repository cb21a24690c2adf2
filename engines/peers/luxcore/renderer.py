"""A scene loaded into a session of LuxCore, whose threads run while an image is rendered."""

from __future__ import annotations

import atexit
import contextlib
import importlib
import io
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.interface import Settings
from engines.peers.adapters import ImageRenderer
from engines.peers.luxcore.description import images, properties, shapes
from engines.peers.luxcore.materials import Properties
from engines.scene import Scene

LEAST_WAIT, LONGEST_WAIT = 2e-4, 0.05
"""Seconds between two looks at how far a render is."""
_loaded: list[Any] = []


def library() -> Any:
    """The module pyluxcore, silent."""
    if not _loaded:
        with contextlib.redirect_stdout(io.StringIO()):  # it tells what it finds
            module = importlib.import_module("pyluxcore")
            module.Init(lambda message: None)
        atexit.register(module.SetLogHandler, None)  # it logs while Python ends, which aborts
        _loaded.append(module)
    return _loaded[0]


class Renderer(ImageRenderer):
    """Threads are started and stopped by editing the scene, and changing nothing: that draws new seeds, and keeps what is
    built. A session that is started anew would build all again.

    `counters()["surplus_samples"]`: samples per pixel beyond those asked for, on average.
    """

    def build(self, scene: Scene, settings: Settings) -> None:
        self._surplus = 0.0
        self._session: Any = None  # the session before must end first
        lux = library()
        described = lux.Scene()
        for name, pixels in images(scene):
            height, width, channels = pixels.shape
            described.DefineImageMap(name, pixels.ravel(), 1.0, channels, width, height)
        described.Parse(_properties(lux, properties(scene, settings)))
        for shape in shapes(scene):
            if shape.vertices is not None:
                normals, uvs = (None if each is None else _tuples(each) for each in (shape.normals, shape.uvs))
                described.DefineMesh(shape.mesh, _tuples(shape.vertices), _tuples(shape.faces), normals, uvs, None, None)
            placed: Properties = {"shape": shape.mesh, "material": f"m{shape.material}"}
            if shape.transformation is not None:
                placed["transformation"] = shape.transformation.T.reshape(-1).tolist()
            described.Parse(_properties(lux, {f"scene.objects.{shape.name}.{key}": placed[key] for key in placed}))
        self._config = lux.RenderConfig(_properties(lux, self._settings()), described)
        self._session = lux.RenderSession(self._config)
        self._session.Start()  # builds, and begins to render
        self._session.BeginSceneEdit()

    def _settings(self) -> Properties:
        options, depth = self.settings.shader.options, self.settings.shader.options["max_depth"]
        return {
            "renderengine.type": "PATHCPU",
            "renderengine.seed": self.seed,
            "native.threads.count": self.settings.threads,
            "sampler.type": "RANDOM",
            "sampler.random.adaptive.strength": 0.0,
            "path.pathdepth.total": depth,
            "path.pathdepth.diffuse": depth,
            "path.pathdepth.glossy": depth,
            "path.pathdepth.specular": depth,
            "path.russianroulette.depth": options["rr_depth"],
            "path.clamping.variance.maxvalue": 0.0,
            "path.hybridbackforward.enable": False,
            "lightstrategy.type": options["light_sampler"].upper(),
            "film.width": self.film.width,
            "film.height": self.film.height,
            "film.filter.type": "NONE",
            "film.opencl.enable": False,
            "film.outputs.0.type": "RADIANCE_GROUP",
            "film.outputs.0.id": 0,
            "film.outputs.0.filename": "radiance.exr",
            "film.outputs.1.type": "SAMPLECOUNT",
            "film.outputs.1.filename": "samples.exr",
        }

    def image(self, spp: int, offset: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
        """Renders until every pixel has `spp` samples, or `stop` is called; with the number of samples of each pixel."""
        lux, session = library(), self._session
        film = session.GetFilm()
        film.Clear()
        counts = np.zeros((self.film.height, self.film.width), np.uint32)
        begin = perf_counter()
        session.EndSceneEdit()
        try:
            wait = LEAST_WAIT
            while not self.stopped.wait(wait):
                session.UpdateStats()
                done = session.GetStats().Get("stats.renderengine.total.samplecount").GetFloat() / counts.size
                if done >= spp:
                    film.GetOutputUInt(lux.FilmOutputType.SAMPLECOUNT, counts, 0)
                    if counts.min() >= spp:
                        break
                missing = (perf_counter() - begin) * (spp / done - 1.0) if done > 0.0 else LEAST_WAIT
                wait = min(max(missing / 2.0, LEAST_WAIT), LONGEST_WAIT)
        finally:
            session.BeginSceneEdit()
        radiance = np.zeros((*counts.shape, 3), np.float32)
        film.GetOutputUInt(lux.FilmOutputType.SAMPLECOUNT, counts, 0)
        if not counts.any():
            return None
        film.GetOutputFloat(lux.FilmOutputType.RADIANCE_GROUP, radiance, 0)
        self._surplus += max(float(counts.mean()) - spp, 0.0)
        return radiance[::-1].astype(np.float64), counts[::-1].astype(np.int64)

    def compile(self) -> None:
        """Nothing is compiled, and what is built is built: an image makes threads and caches warm."""
        surplus = self._surplus
        self.image(1, 0, self.seed)
        self._surplus = surplus

    def counters(self) -> dict[str, float]:
        """With `surplus_samples`."""
        return {**super().counters(), "surplus_samples": self._surplus}


def _tuples(rows: Any) -> list[tuple[Any, ...]]:
    """Python's own numbers: it takes no NumPy ones."""
    return list(map(tuple, rows.tolist()))


def _properties(lux: Any, given: Properties) -> Any:
    properties = lux.Properties()
    for key, value in given.items():
        properties.Set(lux.Property(key, value if isinstance(value, list) else [value]))
    return properties
