"""The scene file that a program is given, by its format.

A format is a function of scene, settings (the shader resolved) and an empty folder; it returns the file, made in the
folder where it is exported, and raises `Unsupported` for what the format cannot say.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from engines.errors import Unsupported
from engines.interface import Settings
from engines.scene import Scene
from engines.scene.support import foreign
from engines.scene.write import KNOWN

Format = Callable[[Scene, Settings, Path], Path]


def own_file(scene: Scene, settings: Settings, folder: Path) -> Path:
    """The file that the scene was read from."""
    if not scene.source:
        raise Unsupported(f"the scene {scene.name!r} is not in a file as it is: a program cannot be given it")
    if scene.native is not None:
        raise Unsupported(f"the scene {scene.name!r} is in a file of Mitsuba's: raybench convert writes one of raybench's")
    if lacks := foreign(scene, KNOWN, "a scene file without code"):
        raise Unsupported(lacks)
    return Path(scene.source).absolute()


def mitsuba_file(scene: Scene, settings: Settings, folder: Path) -> Path:
    """XML with the parameters `spp` and `seed`, for `mitsuba -D spp=16 -D seed=7`."""
    file = _exported("mitsuba", scene, settings, folder)
    root = ElementTree.parse(file).getroot()
    (sampler,) = root.iter("sampler")
    for count in sampler.findall("integer[@name='sample_count']"):
        sampler.remove(count)
    for name, parameter in (("sample_count", "spp"), ("seed", "seed")):
        ElementTree.SubElement(sampler, "integer", name=name, value=f"${parameter}")
    file.write_text(ElementTree.tostring(root, encoding="unicode"))
    return file


def pbrt_file(scene: Scene, settings: Settings, folder: Path) -> Path:
    """A file for `pbrt --spp 16 --seed 7`."""
    return _exported("pbrt", scene, settings, folder)


def _exported(form: str, scene: Scene, settings: Settings, folder: Path) -> Path:
    expected = "volumetric_path_tracer" if scene.media else "path_tracer"
    if settings.shader.name != expected:
        raise Unsupported(f"this scene is exported to {form} with the shader {expected}, not with {settings.shader.name}")
    from engines.peers.export import export

    sized = replace(scene, camera=replace(scene.camera, resolution=settings.size(scene)))
    return export(sized, form, folder, max_depth=settings.shader.options["max_depth"])


FORMATS: Mapping[str, Format] = {"raybench": own_file, "mitsuba": mitsuba_file, "pbrt": pbrt_file}
CARRIES: Mapping[str, frozenset[str]] = {
    "raybench": frozenset(),
    "mitsuba": frozenset({"shader.max_depth"}),
    "pbrt": frozenset({"shader.max_depth"}),
}
"""Options that are written into the file: they need not be passed."""
