"""The table of docs/guides/mitsuba_scenes.md says what the importer does, and every plugin of Mitsuba's is in it."""

import re
from importlib import metadata
from pathlib import Path

import pytest

from engines.scene.mitsuba_xml import bsdfs, emitters, sensors, shapes, textures
from tests.needs import needs
from tests.scene.mitsuba_files import LAMP, SENSOR, refusal, scene

PAGE = Path(__file__).resolve().parents[2] / "docs" / "guides" / "mitsuba_scenes.md"
ROW = re.compile(r"^\| (\w+) \| (\w+) \| (`.+) \|$", re.MULTILINE)
NAME = re.compile(r"`(\w+)`")
TABLE = {
    (kind, name): said for kind, said, names in ROW.findall(PAGE.read_text(encoding="utf-8")) for name in NAME.findall(names)
}
REGISTRIES = {
    "shape": ({**shapes.SHAPES, **dict.fromkeys(shapes.GROUPS)}, shapes.REFUSED),
    "bsdf": (bsdfs.BSDFS, bsdfs.REFUSED),
    "texture": (textures.TEXTURES, textures.REFUSED),
    "emitter": ({**emitters.EMITTERS, "area": None}, {**emitters.REFUSED, "area": ""}),
    "sensor": (sensors.SENSORS, sensors.REFUSED),
}


@pytest.mark.parametrize("kind", REGISTRIES)
def test_the_table_has_what_the_registries_have(kind):
    taken, refused = REGISTRIES[kind]
    said = {name: verdict for (of, name), verdict in TABLE.items() if of == kind}
    assert {name for name, verdict in said.items() if verdict in ("renders", "approximates")} == set(taken)
    assert {name for name, verdict in said.items() if verdict == "refuses"} == set(refused) - {"area"}


@pytest.mark.parametrize("name", [name for kind, name in TABLE if kind == "integrator"])
def test_integrators_of_the_table_suggest_a_shader(tmp_path, name):
    found = scene(tmp_path, f'<integrator type="{name}"/><shape type="sphere"/>{LAMP}')
    assert found.shader is not None
    noted = any(f"integrator {name}" in warning for warning in found.warnings)
    assert noted == (TABLE["integrator", name] == "approximates")


@pytest.mark.parametrize(("kind", "name"), [key for key, said in TABLE.items() if said == "drops"])
def test_what_the_table_drops_is_dropped_with_a_note(tmp_path, kind, name):
    dropped = f'<{kind} type="{name}"/>'
    sensor = SENSOR.replace("</film>", f"{dropped}</film>") if kind == "rfilter" else SENSOR.replace("<film", f"{dropped}<film")
    assert any("dropped" in warning and name in warning for warning in scene(tmp_path, LAMP, sensor=sensor).warnings)


@pytest.mark.parametrize("name", [name for (kind, name), said in TABLE.items() if (kind, said) == ("medium", "refuses")])
def test_media_of_the_table_are_refused(tmp_path, name):
    assert "media" in refusal(tmp_path, f'<shape type="sphere"><medium type="{name}" name="interior"/></shape>')


@needs("mitsuba-scalar")
def test_every_plugin_of_mitsuba_is_in_the_table():
    folder = Path(metadata.distribution("mitsuba").locate_file("mitsuba/plugins"))
    named = {
        file.name.removeprefix("lib").split(".")[0] for file in folder.iterdir() if file.suffix in (".so", ".dll", ".dylib")
    }
    assert len(named) > 50
    assert named - {name for _, name in TABLE} == set()
