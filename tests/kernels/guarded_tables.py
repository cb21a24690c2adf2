"""Run as a program with an engine's name: renders with sample tables that lie between pages nobody may touch.

A read before or behind the table then ends the process instead of returning whatever lies there.
"""

import ctypes
import mmap
import sys

import numpy as np

import engines
from engines.kernels.flatten import FlatScene
from engines.kernels.layout import SceneTable

GUARD = 16 << 20
kept: list = []
bind = FlatScene.bind


def guarded(values: np.ndarray) -> np.ndarray:
    """A copy of `values` that starts right behind inaccessible memory and ends less than a page before more of it."""
    size = -(-values.nbytes // mmap.PAGESIZE) * mmap.PAGESIZE
    memory = mmap.mmap(-1, GUARD + size + GUARD)
    kept.append(memory)
    start = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    protect = ctypes.CDLL(None, use_errno=True).mprotect
    for place in (start, start + GUARD + size):
        assert protect(ctypes.c_void_p(place), ctypes.c_size_t(GUARD), 0) == 0
    copy = np.frombuffer(memory, values.dtype, values.size, GUARD).reshape(values.shape)
    copy[:] = values
    return copy


def bind_guarded(flat: FlatScene, field, value) -> None:
    bind(flat, field, guarded(np.ascontiguousarray(value)) if field is SceneTable.sample_points else value)


FlatScene.bind = bind_guarded
engine, scene = engines.engine(sys.argv[1]), engines.load_scene("two_spheres")
for sampler in ("halton", "sobol"):
    settings = engines.Settings(1, 1, shader={"name": "path_tracer", "max_depth": 3}, sampler=sampler)
    renderer = engine.prepare(scene, settings)
    renderer.render(4100)
    renderer.warm_up()
    renderer.update(camera=scene.camera)
    renderer.warm_up()
    film = renderer.render(5)
    assert film.spp == 5 and np.isfinite(film.mean()).all()
    print(sampler)
