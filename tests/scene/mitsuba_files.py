"""Small Mitsuba files for tests."""

from pathlib import Path

import engines

SENSOR = """<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">
<lookat origin="0,0,-5" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="4"/></film></sensor>"""
LAMP = '<emitter type="point"><point name="position" x="0" y="3" z="0"/></emitter>'


def written(folder: Path, body: str, version: str = "3.0.0", name: str = "s.xml", sensor: str = SENSOR) -> Path:
    file = folder / name
    file.write_text(f'<scene version="{version}">\n{body}\n{sensor}\n</scene>\n', encoding="utf-8")
    return file


def scene(folder: Path, body: str, version: str = "3.0.0", sensor: str = SENSOR, **options) -> engines.Scene:
    return engines.load_scene(written(folder, body, version, sensor=sensor), **options)


def bsdf(folder: Path, xml: str, version: str = "3.0.0", extra: str = ""):
    """The BSDF of a rectangle that has the one of `xml`."""
    found = scene(folder, f'{extra}<shape type="rectangle">{xml}</shape>{LAMP}', version)
    return found.materials[found.shapes[0].materials[0]].bsdf


def shape(folder: Path, xml: str, version: str = "3.0.0"):
    """The one shape of `xml`."""
    return scene(folder, xml + LAMP, version).shapes[0]


def light(folder: Path, xml: str, version: str = "3.0.0"):
    """The one light of `xml`."""
    return scene(folder, f'<shape type="sphere"/>{xml}', version).lights[0]


def refusal(folder: Path, body: str, version: str = "3.0.0", sensor: str = SENSOR, **options) -> str:
    """The message about a file that is refused; a single line."""
    try:
        scene(folder, body, version, sensor, **options)
    except engines.SceneError as problem:
        text = str(problem)
        assert "\n" not in text
        return text
    raise AssertionError("was imported")
