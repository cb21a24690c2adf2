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


def radiance(folder: Path, body: str, place: tuple[float, float] = (0.0, 0.0), depth: int = 2) -> list[float]:
    """The RGB radiance of `body` that is seen from above, along -z, at a place of the plane z = 0: one ray of the NumPy engine,
    whose light is that of `SUN` or of emitters."""
    x, y = place
    look = f'<lookat origin="{x},{y},5" target="{x},{y},0" up="0,1,0"/>'
    sensor = f"""<sensor type="orthographic"><transform name="to_world"><scale x="1e-5" y="1e-5"/>{look}</transform>
<film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/></film></sensor>"""
    found = engines.load_scene(written(folder, body, sensor=sensor))
    shader = {"name": "path_tracer", "max_depth": depth, "rr_depth": 100}
    film = engines.engine("numpy").prepare(found, engines.Settings(shader=shader, sampler="random", seed=1)).render(1)
    return film.sums[0, 0].tolist()


SUN = """<emitter type="directional"><vector name="direction" x="0" y="0" z="-1"/>
<rgb name="irradiance" value="3.141592653589793"/></emitter>"""
"""Shines down: a diffuse surface that faces it has its reflectance as radiance."""
