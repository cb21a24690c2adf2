"""The JSON schema of scenes: it accepts what the loader accepts, and its keys are the loader's."""

import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from jsonschema import Draft202012Validator

import engines
from engines.errors import SceneError
from engines.scene import scene_schema
from engines.scene.procedural import GENERATORS

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = json.loads(json.dumps(scene_schema()))
CAMERA = {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]}
SPHERE = {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}
SCENE = {"raybench_scene": 1, "camera": CAMERA, "materials": {"grey": {"kd": 0.5}}, "shapes": [SPHERE]}


@pytest.fixture(scope="module")
def validator():
    Draft202012Validator.check_schema(SCHEMA)
    return Draft202012Validator(SCHEMA)


@pytest.mark.parametrize("path", sorted(ROOT.glob("scenes/**/*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_scene_is_accepted(validator, path):
    assert list(validator.iter_errors(yaml.safe_load(path.read_text()))) == []


def kinds(schema, key):
    """The properties of every kind of shape or light, by kind."""
    found = {}
    for each in schema["properties"][key]["items"]["anyOf"]:
        kind = next(iter(each["properties"]))
        found[kind] = each["properties"][kind]
    return found


def objects():
    """Name, properties in the schema, and the scene in which an unknown key stands where they belong."""
    yield "scene", SCHEMA["properties"], {**SCENE, "zzz": 1}
    material = SCHEMA["properties"]["materials"]["additionalProperties"]["properties"]
    yield "material", material, {**SCENE, "materials": {"grey": {"zzz": 1}}}
    for name, body in material.items():
        if "properties" in body and name != "plugin":  # whose options are its own
            yield name, body["properties"], {**SCENE, "materials": {"grey": {name: {"zzz": 1}}}}
    for body in SCHEMA["properties"]["textures"]["additionalProperties"]["anyOf"]:
        name = next(iter(body["properties"]))
        yield name, body["properties"], {**SCENE, "textures": {"grey": {name: {}, "zzz": 1}}}
    for camera in SCHEMA["properties"]["camera"]["anyOf"]:
        if "const" in camera["properties"]["type"]:
            kind = camera["properties"]["type"]["const"]
            yield kind, camera["properties"], {**SCENE, "camera": {"type": kind, "zzz": 1}}
    for kind, body in kinds(SCHEMA, "shapes").items():
        if kind != "procedural":
            yield kind, body["properties"], {**SCENE, "shapes": [{kind: {"zzz": 1}, "material": "grey"}]}
    for body in kinds(SCHEMA, "shapes")["procedural"]["anyOf"]:
        name = body["properties"]["name"]["const"]
        shape = {"procedural": {"name": name, "zzz": 1}, "material": "grey"}
        yield name, body["properties"], {**SCENE, "shapes": [shape]}
    for kind, body in kinds(SCHEMA, "lights").items():
        if kind == "plugin":  # whose options are its own
            continue
        yield kind, body["properties"], {**SCENE, "lights": [{kind: {"zzz": 1}}]}


@pytest.mark.parametrize(("properties", "wrong"), [pytest.param(*rest, id=name) for name, *rest in objects()])
def test_its_keys_are_those_that_the_loader_knows_and_each_is_explained(validator, properties, wrong):
    with pytest.raises(SceneError, match="zzz: unknown key") as refused:
        engines.scene_from(wrong)
    assert set(re.split(", ", str(refused.value).partition("known: ")[2])) == set(properties or ["none"])
    assert all(told["description"] for told in properties.values())
    assert list(validator.iter_errors(wrong)) != []


def test_it_knows_every_generator():
    listed = {body["properties"]["name"]["const"] for body in kinds(SCHEMA, "shapes")["procedural"]["anyOf"]}
    assert listed == set(GENERATORS)


FORMS = {
    "nulls": {"materials": None, "shapes": None, "lights": None},
    "alpha": {"materials": {"m": {"conductor": {"metal": "Au", "alpha": [0.1, 0.2]}, "emission": [1, 2, 3]}}},
    "eta, k": {"materials": {"m": {"conductor": {"eta": 0.5, "k": [1, 2, 3], "specular_reflectance": 0.5}}}},
    "reflectance": {"materials": {"m": {"conductor": {"reflectance": 1, "alpha": 0.1, "distribution": "ggx"}}}},
    "target": {"lights": [{"spot": {"position": [0, 3, 0], "target": [0, 0, 0], "intensity": 1}}]},
    "direction": {"lights": [{"spot": {"position": [0, 3, 0], "direction": [0, 0, 1], "intensity": 1, "beam_width": 1}}]},
    "shown": {
        "textures": {"t": {"checkerboard": {}}},
        "lights": [
            {"spot": {"position": [0, 3, 0], "target": [0, 0, 0], "intensity": 1, "texture": "t", "up": [1, 0, 0]}},
            {
                "projector": {
                    "position": [0, 3, 0],
                    "direction": [0, 0, 1],
                    "texture": "t",
                    "fov_axis": "x",
                    "irradiance": [1, 2, 3],
                }
            },
        ],
    },
    "disk": {"shapes": [{"disk": {"center": [0, 0, 0], "normal": [0, 0, 3], "radius": 1}, "material": "grey"}]},
    "scale": {
        "shapes": [
            {
                "mesh": {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]], "scale": [1, 2, 3]},
                "material": "grey",
            }
        ]
    },
    "quad": {
        "shapes": [{"procedural": {"name": "quad", "points": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}, "material": "grey"}]
    },
    "plugins": {
        "materials": {"m": {"plugin": {"type": "scene_plugin:own"}, "emission": 1}},
        "lights": [{"plugin": {"type": "scene_plugin:own", "x": 2}}],
    },
}
NOT = {
    "two metals": {"materials": {"m": {"conductor": {"metal": "Au", "reflectance": 1}}}},
    "no k": {"materials": {"m": {"conductor": {"eta": 1}}}},
    "unknown metal": {"materials": {"m": {"conductor": {"metal": "Xx"}}}},
    "no plugin": {"lights": [{"plugin": {"x": 1}}]},
    "no module": {"materials": {"m": {"plugin": {"type": "own"}}}},
    "neither": {"lights": [{"spot": {"position": [0, 3, 0], "intensity": 1}}]},
    "no texture": {"lights": [{"projector": {"position": [0, 3, 0], "target": [0, 0, 0]}}]},
    "three points": {
        "shapes": [{"procedural": {"name": "quad", "points": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]}, "material": "grey"}]
    },
    "large level": {"shapes": [{"procedural": {"name": "tree", "level": 31}, "material": "grey"}]},
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_that_is_read_is_accepted(validator, form, monkeypatch):
    plugin = SimpleNamespace(name="own", options={"x": 1})
    monkeypatch.setitem(sys.modules, "scene_plugin", SimpleNamespace(own=plugin))
    assert engines.scene_from({**SCENE, "shapes": [], **FORMS[form]}, allow_imports=True)
    assert list(validator.iter_errors({**SCENE, "shapes": [], **FORMS[form]})) == []


@pytest.mark.parametrize("form", NOT)
def test_what_a_schema_can_say_is_refused_by_both(validator, form):
    with pytest.raises(SceneError):
        engines.scene_from({**SCENE, **NOT[form]})
    assert list(validator.iter_errors({**SCENE, **NOT[form]})) != []


def test_its_defaults_change_nothing():
    def filled(properties):
        return {key: told["default"] for key, told in properties.items() if "default" in told}

    material = filled(SCHEMA["properties"]["materials"]["additionalProperties"]["properties"])
    camera = filled(SCHEMA["properties"]["camera"]["anyOf"][0]["properties"])
    procedural = kinds(SCHEMA, "shapes")["procedural"]["anyOf"]
    shapes = [{"procedural": {"name": "box"}, "material": "grey"}]
    (box,) = (filled(body["properties"]) for body in procedural if body["properties"]["name"]["const"] == "box")
    lights = [{"environment": {"radiance": filled(kinds(SCHEMA, "lights")["environment"]["properties"])["radiance"]}}]
    short = engines.scene_from({**SCENE, "materials": {"grey": {}}, "shapes": shapes, "lights": lights})
    long = engines.scene_from(
        {
            **SCENE,
            "camera": {**camera, **CAMERA},
            "materials": {"grey": material},
            "lights": lights,
            "shapes": [
                {
                    "procedural": {"name": "box", **{key: list(v) if isinstance(v, tuple) else v for key, v in box.items()}},
                    "material": "grey",
                }
            ],
        }
    )
    assert (long.content_hash, long.camera) == (short.content_hash, short.camera)
