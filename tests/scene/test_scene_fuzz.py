"""Random scenes: valid ones load and render, one mutation raises SceneError and nothing else. Files: tests/fuzz."""

from __future__ import annotations

import contextlib
import copy
import struct

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import engines
from engines.errors import SceneError
from engines.scene.metals import METALS
from tests.fuzz.mutate import NEVER_RIGHT, places

QUICK = settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])

coordinate = st.floats(-1e6, 1e6)
triple = st.lists(coordinate, min_size=3, max_size=3)
share = st.floats(0, 0.33)
color = st.one_of(share, st.lists(share, min_size=3, max_size=3))
positive = st.floats(1e-6, 1e6)
direction = triple.filter(any)


lobes = st.fixed_dictionaries(
    {},
    optional={
        "kd": color,
        "ks": color,
        "kt": color,
        "ior": st.floats(0.1, 4),
        "fresnel": st.booleans(),
        "two_sided": st.booleans(),
    },
)
rough = {"alpha": st.one_of(st.just(0), st.floats(1e-4, 1), st.lists(st.floats(1e-4, 1), min_size=2, max_size=2))}
index = st.lists(st.floats(0.01, 10), min_size=3, max_size=3)
conductors = st.one_of(
    st.fixed_dictionaries({"metal": st.sampled_from(sorted(METALS))}, optional=rough | {"specular_reflectance": color}),
    st.fixed_dictionaries({"eta": index, "k": index}, optional=rough),
    st.fixed_dictionaries({"reflectance": color}, optional=rough),
)
materials = st.one_of(lobes, st.fixed_dictionaries({"conductor": conductors}, optional={"two_sided": st.booleans()}))


def shape(kind, body):
    return st.fixed_dictionaries({kind: st.fixed_dictionaries(body), "material": st.sampled_from(["a", "b"])})


shapes = st.one_of(
    shape("sphere", {"center": triple, "radius": positive}),
    shape("disk", {"center": triple, "normal": direction, "radius": positive}),
    shape("plane", {"point": triple, "normal": direction}),
    shape("triangle", {"a": triple, "b": triple, "c": triple}),
    shape(
        "mesh",
        {
            "vertices": st.lists(triple, min_size=3, max_size=5),
            "faces": st.lists(st.lists(st.integers(0, 2), min_size=3, max_size=3), min_size=1, max_size=4),
        },
    ),
    shape("procedural", {"name": st.just("box"), "half_size": st.lists(positive, min_size=3, max_size=3)}),
    shape("procedural", {"name": st.just("sphereflake"), "level": st.integers(0, 2)}),
)
lights = st.one_of(
    st.fixed_dictionaries({"point": st.fixed_dictionaries({"position": triple, "intensity": positive})}),
    st.fixed_dictionaries(
        {
            "spot": st.fixed_dictionaries(
                {"position": triple, "direction": direction, "intensity": positive}, optional={"cutoff": st.floats(1, 179)}
            )
        }
    ),
    st.fixed_dictionaries(
        {
            "projector": st.fixed_dictionaries(
                {"position": triple, "direction": direction, "texture": st.just("t")}, optional={"fov": st.floats(1, 179)}
            )
        }
    ),
    st.fixed_dictionaries({"directional": st.fixed_dictionaries({"direction": direction, "irradiance": color})}),
    st.fixed_dictionaries({"environment": st.fixed_dictionaries({"radiance": color})}),
)


@st.composite
def scenes(draw):
    return {
        "raybench_scene": 1,
        "camera": {
            "type": "perspective",
            "eye": [0, 1, 5],
            "target": [0, 1, 0],
            "fov": draw(st.floats(1, 179)),
            "resolution": draw(st.lists(st.integers(1, 64), min_size=2, max_size=2)),
        },
        "textures": {"t": {"checkerboard": {"a": draw(positive)}}},
        "materials": {"a": draw(materials), "b": draw(materials), "lamp": {"emission": draw(positive)}},
        "shapes": draw(st.lists(shapes, max_size=3)),
        "lights": draw(st.lists(lights, max_size=2)),
    }


@QUICK
@given(scenes())
def test_valid_scenes_load_the_same_from_python_and_from_yaml(tmp_path, data):
    scene = engines.scene_from(data)
    assert len(scene.shapes) == len(data["shapes"]) and len(scene.lights) == len(data["lights"])
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(data))
    assert engines.load_scene(tmp_path / "s.yaml").content_hash == scene.content_hash


UNWRITTEN = [object(), b"x"]
"""What YAML cannot say."""


@QUICK
@given(scenes(), st.data())
def test_one_wrong_value_raises_scene_error_and_nothing_else(data, choice):
    path = choice.draw(st.sampled_from([p for p in places(data) if p[0] != "name" and len(p) > 0]))
    mutated = copy.deepcopy(data)
    parent = mutated
    for step in path[:-1]:
        parent = parent[step]
    if choice.draw(st.booleans()) or not isinstance(parent, dict):
        parent[path[-1]] = choice.draw(st.sampled_from(NEVER_RIGHT + UNWRITTEN))
    else:
        parent[f"{path[-1]}x"] = parent.pop(path[-1])
    if path == ("camera", "type") and parent.get("type").__class__ is object:
        return  # an object is a camera plugin
    if path[0] == "materials" and len(path) == 2 and mutated["materials"] and f"{path[1]}x" in mutated["materials"]:
        with contextlib.suppress(SceneError):  # a renamed material is wrong only where it was used
            engines.scene_from(mutated)
        return
    with pytest.raises(SceneError) as caught:
        engines.scene_from(mutated)
    assert len(str(caught.value)) < 1000 and "\n" not in str(caught.value)


@QUICK
@given(st.lists(st.integers(0, 2**64 - 1), min_size=9, max_size=9))
def test_any_bit_patterns_as_vertices_load_or_are_refused(bits):
    vertices = np.frombuffer(struct.pack("<9Q", *bits), np.float64).reshape(3, 3)
    data = {
        "raybench_scene": 1,
        "camera": {"type": "perspective", "eye": [0, 1, 5], "target": [0, 1, 0]},
        "materials": {"m": {}},
        "shapes": [{"mesh": {"vertices": vertices, "faces": [[0, 1, 2]], "smooth": True}, "material": "m"}],
    }
    if np.isfinite(vertices).all():
        normals = engines.scene_from(data).shapes[0].normals
        assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    else:
        with pytest.raises(SceneError, match="must be finite"):
            engines.scene_from(data)


@settings(QUICK, max_examples=60)
@given(scenes(), st.sampled_from(["path_tracer", "whitted", "no_shadows", "depth_map", "albedo"]), st.integers(0, 99))
def test_valid_scenes_render_finite(data, shader, seed):
    """Two samples of 4 x 4 pixels: every one a finite number that is not negative."""
    chosen = engines.Settings(width=4, height=4, shader=shader, seed=seed)
    assume(engines.engine("numpy").why_not(engines.scene_from(data), chosen) is None)
    film = _reference(data, shader=shader, seed=seed).render(2)
    assert film.bad_samples == 0
    assert np.isfinite(film.mean()).all() and (film.mean() >= 0).all()


def _reference(data, **more):
    return engines.engine("numpy").prepare(engines.scene_from(data), engines.Settings(width=4, height=4, **more))


finite_bits = st.integers(0, 2**64 - 1).filter(lambda bits: bits >> 52 & 0x7FF != 0x7FF)


@pytest.mark.parametrize("engine", ["numpy", "numba"])
@settings(QUICK, max_examples=25)
@given(st.lists(finite_bits, min_size=36, max_size=36))
def test_any_finite_bit_patterns_are_traced_and_never_crash(engine, bits):
    """Four triangles of any doubles, denormal to 1e308, in every accelerator: hits or misses, in order, never NaN."""
    vertices = np.frombuffer(struct.pack("<36Q", *bits), np.float64).reshape(12, 3)
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 1, 5], "target": [0, 1, 0]},
            "materials": {"m": {}},
            "shapes": [{"mesh": {"vertices": vertices, "faces": np.arange(12).reshape(4, 3)}, "material": "m"}],
        }
    )
    centers = vertices.reshape(4, 3, 3).mean(axis=1, where=np.abs(vertices.reshape(4, 3, 3)) < 1e300)
    origins = np.concatenate([np.zeros((4, 3)), np.ones((4, 3))])
    directions = np.nan_to_num(np.concatenate([centers, centers - 1.0]))
    for accelerator in ("none", "bvh", "grid") if engine == "numba" else ("none", "bvh"):
        settings_ = engines.Settings(accelerator=accelerator, precision="float64")
        try:
            hits = engines.engine(engine).prepare(scene, settings_).trace(origins, directions)
        except engines.RaybenchError:
            continue  # an engine may refuse what its arithmetic cannot hold
        assert not np.isnan(hits.t).any() and (hits.t > 0).all()
        assert ((hits.primitive >= 0) == np.isfinite(hits.t)).all() and (hits.primitive < 4).all()
