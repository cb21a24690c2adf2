"""What a renderer works with: the scene loaded into Mitsuba, and how its shapes are told apart again."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from engines.interface import Settings
from engines.peers.adapters.geometry import extent
from engines.peers.mitsuba import blends, native, plugins
from engines.peers.mitsuba.albedo import painted
from engines.peers.mitsuba.cameras import sensor
from engines.peers.mitsuba.description import Description, described
from engines.peers.mitsuba.library import LLVM, activate
from engines.peers.mitsuba.nodes import Array, Node, Placing
from engines.peers.mitsuba.patterns import USUAL
from engines.peers.mitsuba.shapes import Part
from engines.scene import Plane, Scene
from engines.scene.formats.ply import write_ply
from engines.temporary import TemporaryFolder


class Stage(NamedTuple):
    """`mi`, `dr`: the modules. `loaded`: Mitsuba's scene. `places`: for each of its shapes the index of its part. `scale`:
    what its diffuse reflectances have to be multiplied by, where they are colours to show."""

    mi: Any
    dr: Any
    loaded: Any
    scene: Scene
    settings: Settings
    size: tuple[int, int]
    parts: tuple[Part, ...]
    places: Array
    scale: float = 1.0

    @property
    def camera(self) -> Any:
        """Mitsuba's sensor."""
        return self.loaded.sensors()[0]


def staged(scene: Scene, settings: Settings, variant: str) -> Stage:
    """Loads `scene` into Mitsuba, by way of mesh files in a folder that is gone when this returns, or the file it came from.

    Meshes stay apart, so that a hit can be told from another; uniting them, as Mitsuba does by default, gains nothing
    measurable on cornell_box.
    """
    plugins.register(plugins.named(settings), variant, settings.threads)
    mi, dr = activate(variant, settings.threads)
    width, height = settings.size(scene)
    if scene.native is not None:
        robust = settings.accelerator.options["robust"]
        activate(variant, max(native.LOADING_THREADS, settings.threads))
        loaded = native.load(mi, scene, (width, height), sampler_node(settings), robust)
        activate(variant, settings.threads)
        return Stage(mi, dr, loaded, scene, settings, (width, height), (), np.zeros(0, np.int64))
    scale = 1.0
    if settings.shader.name == "albedo":
        scene, scale = painted(scene)
    with TemporaryFolder() as folder:
        description = _described(mi, scene, settings, Path(folder))
        nodes = dict(description.nodes)
        if variant == LLVM:
            blends.register(mi, dr)
            nodes = blends.exact(nodes)
        nodes["sensor"] = sensor(scene.camera, width, height, sampler_node(settings), extent(scene))
        loaded = mi.load_dict(_with_transforms(mi, nodes), optimize=False)
    order = {f"shape_{index}": index for index in range(len(description.parts))}
    places = np.array([order[shape.id()] for shape in loaded.shapes()], np.int64)
    return Stage(mi, dr, loaded, scene, settings, (width, height), description.parts, places, scale)


def _described(mi: Any, scene: Scene, settings: Settings, folder: Path) -> Description:
    def place_mesh(name: str, *columns: Any) -> str:
        file = folder / f"{len(list(folder.iterdir()))}.ply"
        *arrays, attributes = columns
        write_ply(file, *arrays, attributes=attributes)
        return str(file)

    def place_image(name: str, image: Array) -> Node:
        return {"bitmap": mi.Bitmap(np.require(image, np.float32, ["C", "W"]))}

    return described(scene, Placing(place_mesh, place_image), settings.accelerator.options["robust"])


def _with_transforms(mi: Any, node: Any) -> Any:
    """Arrays of 4 x 4 as Mitsuba's transforms."""
    if isinstance(node, dict):
        return {key: _with_transforms(mi, value) for key, value in node.items()}
    if isinstance(node, np.ndarray):
        return mi.ScalarTransform4f(node)
    return node


def sampler_node(settings: Settings) -> dict[str, Any]:
    """Mitsuba's sampler of the settings' name; its pattern has `sample_count` samples."""
    name, options = settings.sampler.name, settings.sampler.options
    if name == "random":
        name = "independent"
    if name == "mitsuba":
        return {"sample_count": USUAL, **plugins.node(options)}
    count = options.get("strata", options.get("sample_count"))
    return {"type": name, "sample_count": count or (1 if name == "independent" else USUAL)}


# ---- what shaders of ours ask of a scene -----------------------------------------------------------------------------


def listed_emitters(stage: Stage) -> list[Any]:
    """Mitsuba's emitters but for planes, which raybench never samples."""
    planes = {index for index, part in enumerate(stage.parts) if isinstance(stage.scene.shapes[part.shape], Plane)}
    shapes = [shape for shape, place in zip(stage.loaded.shapes(), stage.places, strict=True) if place not in planes]
    others = [light for light in stage.loaded.emitters() if light.id().startswith("light_")]
    return [*others, *(shape.emitter() for shape in shapes if shape.is_emitter())]


def far_corner(stage: Stage) -> Array | None:
    """The point from which the shader depth_map measures: its option, or the upper corner of all that is finite."""
    given = stage.settings.shader.options["max_point"]
    if given is not None:
        return np.array(given, np.float64)
    corners = [box[1] for shape in stage.scene.shapes if (box := shape.bounds()) is not None]
    return np.max(corners, axis=0) if corners else None
