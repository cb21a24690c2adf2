"""What the schema calls wrong, the loader refuses where it stands: each key of a scene with every kind of record is given a
text, a number below and one above its range, and each mapping a key that it does not know, or loses one that it must have.
Words are in tests/schema."""

from __future__ import annotations

import json

import pytest
import yaml
from jsonschema import Draft202012Validator

import engines
from engines.errors import SceneError
from engines.scene import scene_schema

POINT, UP = [0.0, 1.0, 5.0], [0.0, 1.0, 0.0]
VIEW = {"eye": POINT, "target": [0.0, 0.5, 0.0], "up": UP, "resolution": [8, 8], "mirror": False}
CAMERAS = [
    {"type": "perspective", **VIEW, "fov": 40.0, "fov_axis": "y", "principal_point": [0.1, 0.0]},
    {"type": "thin_lens", **VIEW, "fov": 40.0, "aperture_radius": 0.1, "focus_distance": 2.0},
    {"type": "orthographic", **VIEW, "height": 2.0},
]
SCENE = {
    "raybench_scene": 1,
    "name": "all",
    "camera": CAMERAS[0],
    "textures": {"tiles": {"checkerboard": {"a": 0.8, "b": [0.1, 0.2, 0.3]}, "scale": [2.0, 3.0], "offset": [0.5, 0.25]}},
    "materials": {
        "red": {"kd": [0.5, 0.1, 0.1], "ks": 0.2, "kt": 0.1, "ior": 1.5, "fresnel": True, "emission": 0.0, "two_sided": True},
        "gold": {"conductor": {"metal": "Au", "alpha": [0.1, 0.2], "distribution": "ggx", "specular_reflectance": 0.5}},
        "own": {"conductor": {"eta": 0.5, "k": [1.0, 2.0, 3.0]}},
        "grey": {"diffuse": {"reflectance": 0.5}},
        "glass": {"dielectric": {"ior": 1.5, "alpha": 0.1, "distribution": "beckmann", "specular_transmittance": 0.5}},
        "pane": {"thin_dielectric": {"ior": 1.3, "specular_reflectance": 0.5}},
        "wax": {"plastic": {"diffuse": 0.5, "ior": 1.5, "alpha": 0.1, "nonlinear": True}},
        "paint": {
            "principled": {
                "base_color": 0.5,
                "roughness": 0.3,
                "anisotropic": 0.1,
                "metallic": 0.2,
                "eta": 1.4,
                "clearcoat": 0.1,
                "clearcoat_gloss": 0.2,
                "spec_trans": 0.3,
                "sheen": 0.1,
                "flatness": 0.2,
            }
        },
        "leaf": {"mask": {"opacity": 0.5, "of": "red"}},
        "worn": {"blend": {"weight": 0.5, "a": "red", "b": {"kd": 0.5}}},
    },
    "shapes": [
        {"sphere": {"center": POINT, "radius": 1.0}, "material": "red"},
        {"spheres": {"centers": [POINT], "radii": [1.0]}, "material": "red"},
        {"plane": {"point": POINT, "normal": UP}, "material": "red"},
        {"triangle": {"a": [0.0, 0.0, 0.0], "b": [1.0, 0.0, 0.0], "c": UP}, "material": "red"},
        {
            "mesh": {"vertices": [POINT, UP, [1.0, 0.0, 0.0]], "faces": [[0, 1, 2]], "scale": 2.0, "smooth": True},
            "material": "red",
        },
        {"procedural": {"name": "sphereflake", "level": 1}, "material": "red"},
        {"procedural": {"name": "box", "half_size": [1.0, 1.0, 1.0], "rotate_y": 10.0}, "material": "red"},
        {"disk": {"center": POINT, "normal": UP, "radius": 0.5}, "material": "gold"},
        {"cylinder": {"p0": POINT, "p1": UP, "radius": 0.5}, "material": "gold"},
    ],
    "lights": [
        {"point": {"position": POINT, "intensity": 10.0, "falloff": "inverse_square"}},
        {"directional": {"direction": UP, "irradiance": 1.0}},
        {"environment": {"radiance": 1.0}},
        {"spot": {"position": POINT, "target": UP, "intensity": 5.0, "cutoff": 30.0, "beam_width": 20.0}},
        {
            "spot": {
                "position": POINT,
                "direction": [0.0, 0.5, 2.0],
                "intensity": 5.0,
                "texture": "tiles",
                "up": [0.0, 1.0, 0.5],
            }
        },
        {
            "projector": {
                "position": POINT,
                "direction": [0.0, 0.5, 2.0],
                "up": UP,
                "irradiance": 5.0,
                "texture": "tiles",
                "fov": 30.0,
                "fov_axis": "x",
            }
        },
    ],
}
SCHEMA = scene_schema()
VALIDATOR = Draft202012Validator(SCHEMA)
WRONG = ["wrong", -98765.5, 98765.5]


def fits(schema, value):
    return VALIDATOR.evolve(schema=schema).is_valid(value)


def walk(schema, value, path=()):
    """Each place in `value`, the schema of what may stand there, and that of what stands there."""
    chosen = next(one for one in schema.get("anyOf", [schema]) if fits(one, value))
    if "$ref" in chosen:
        chosen = SCHEMA["properties"]["materials"]["additionalProperties"]
    yield path, schema, chosen
    if isinstance(value, dict):
        properties, others = chosen.get("properties", {}), chosen.get("additionalProperties")
        for key, child in value.items():
            yield from walk(properties.get(key, others), child, (*path, key))
    elif isinstance(value, list) and isinstance(chosen.get("items"), dict):
        for index, child in enumerate(value):
            if isinstance(child, dict) or index == 1:  # one number of a list stands for all
                yield from walk(chosen["items"], child, (*path, index))


def dotted(path):
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return "".join(steps).removeprefix(".")


def refusal(file, scene, path, value):
    """The message about `scene` with `value` at `path`, or without a value where it is None, and the line of the file on which
    this stands."""
    needed = {"raybench_scene", "camera", path[0], {"shapes": "materials", "lights": "textures"}.get(path[0], "")}
    changed = json.loads(json.dumps({key: part for key, part in scene.items() if key in needed}))
    inner = changed
    for step in path[:-1]:
        inner = inner[step]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    text = yaml.safe_dump(changed, sort_keys=False, default_flow_style=False)
    file.write_text(text)
    with pytest.raises(SceneError) as refused:
        engines.load_scene(file)
    mark = "wrong" if path[-1] == "wrong" else str(value)
    return str(refused.value), 1 + text[: text.find(mark)].count("\n")


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera["type"])
def test_what_the_schema_calls_wrong_is_refused_with_file_line_key_and_value(tmp_path, camera):
    file, scene, tried = tmp_path / "s.yaml", {**SCENE, "camera": camera}, 0
    for path, schema, chosen in walk(SCHEMA, scene):
        if camera is not CAMERAS[0] and path[:1] != ("camera",):
            continue
        for value in WRONG if path else ():
            if not fits(schema, value):
                said, line = refusal(file, scene, path, value)
                assert said.startswith(f"{file}:{line} {dotted(path)} = {value!r}: ") and "\n" not in said, said
                tried += 1
        if chosen.get("additionalProperties") is False:
            said, line = refusal(file, scene, (*path, "wrong"), 1)
            assert said.startswith(f"{file}:{line} {dotted((*path, 'wrong'))}: unknown "), said
            tried += 1
        for key in chosen.get("required", ()):
            said, _ = refusal(file, scene, (*path, key), None)
            lacks = f" {dotted((*path, key))}: is missing", f" {dotted(path)}: must have "
            assert any(words in said for words in lacks), said
            tried += 1
    assert tried > (200 if camera is CAMERAS[0] else 20)
