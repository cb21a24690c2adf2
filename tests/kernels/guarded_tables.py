"""Run as a program with the names of an engine and of a function below: renders with tables between pages nobody may touch.

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
    bind(flat, field, guarded(np.ascontiguousarray(value)) if field in GUARDED else value)


def samples(engine) -> None:
    scene = engines.load_scene("two_spheres")
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


def fewer_instances(engine) -> None:
    """Shadow rays that meet instances of which there are fewer afterwards, and what lies outside of groups."""
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "materials": {"grey": {"kd": 0.5}},
            "groups": {"g": [{"triangle": {"a": [-4, 2, -4], "b": [4, 2, -4], "c": [0, 2, 4]}, "material": "grey"}]},
            "shapes": [
                {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"},
                {"sphere": {"center": [0, 3, 0], "radius": 0.5}, "material": "grey"},
                *[{"instance": {"group": "g", "matrix": np.column_stack([np.eye(3), [0, 1e-6 * k, 0]])}} for k in range(9000)],
            ],
            "lights": [{"point": {"position": [0, 9, 0], "intensity": 100}}],
        }
    )
    renderer = engine.prepare(scene, engines.Settings(8, 8, precision="float64", threads=1))
    renderer.render(2)
    renderer.update(shapes=scene.shapes[:3])
    assert np.isfinite(renderer.render(2).mean()).all()
    print("rendered")


GUARDED = (SceneTable.sample_points, SceneTable.instances)
FlatScene.bind = bind_guarded
{"samples": samples, "fewer_instances": fewer_instances}[sys.argv[2]](engines.engine(sys.argv[1]))
