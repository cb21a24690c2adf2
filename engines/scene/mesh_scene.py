"""The scene of a mesh file alone: the mesh in front of a camera that frames it, under a neutral sky and a sun."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.scene.cameras import Perspective
from engines.scene.content import content_hash
from engines.scene.context import SceneReader
from engines.scene.files import Place
from engines.scene.mesh import Mesh
from engines.scene.scene import SCENE, Scene
from engines.schema.yaml_file import locate

FOV, RESOLUTION = 40.0, (640, 480)
"""Degrees along the height, and pixels."""
MARGIN = 1.08
"""By how much the camera is farther away than where the mesh touches the frame."""
GREY = {"diffuse": {"reflectance": 0.35}}
SKY = {"environment": {"radiance": 0.6}}
SUN = 1.5
"""Irradiance; it comes from above the camera's left."""
# Viewpoint and axis upwards: y in what modelling programs write as OBJ and PLY, z in STL, which comes from CAD programs.
VIEWS = {".stl": ((0.55, -1.0, 0.45), (0.0, 0.0, 1.0))}
VIEW = ((0.55, 0.45, 1.0), (0.0, 1.0, 0.0))


def mesh_scene(file: Path, place: Place) -> Scene:
    """The scene of an OBJ, with the materials of its MTL, a PLY or an STL.

    It is smooth where the file has vertex normals. Where materials are missing the mesh is grey, with a note in
    `Scene.warnings`. Raises `SceneError` where there is no file,
    and for one that is no mesh.
    """
    if not file.is_file():
        raise SceneError(f"{file}: no such file")
    if file.suffix.lower() == ".obj":
        try:
            return _framed(file, place)
        except SceneError as problem:
            why = str(problem).rpartition(f"mesh.file = {file.name!r}: ")[2].removesuffix(": name a material beside 'mesh'")
        found = _framed(file, place, GREY)
        return replace(found, warnings=(*found.warnings, f"the mesh is grey, for the file {why}"))
    return _framed(file, place, GREY)


def _framed(file: Path, place: Place, material: Any = None) -> Scene:
    """The scene, of one `material` or of those that the file names."""
    shape: dict[str, Any] = {"mesh": {"file": file.name, "smooth": _has_normals(file)}}
    towards, up = VIEWS.get(file.suffix.lower(), VIEW)
    eye = np.array(towards) / np.linalg.norm(towards)
    camera = {"type": "perspective", "eye": eye.tolist(), "target": [0, 0, 0], "up": list(up), "fov": FOV}
    scene = {
        "raybench_scene": 1,
        "camera": {**camera, "resolution": list(RESOLUTION)},
        "materials": {"grey": material} if material else None,
        "shapes": [{**shape, **({"material": "grey"} if material else {})}],
        "lights": neutral_lights(eye, np.array(up)),
    }
    made = SCENE.read(locate(scene, str(file)), SceneReader(place, file.stem, str(file)))
    (mesh,) = made.shapes
    assert isinstance(mesh, Mesh) and isinstance(made.camera, Perspective)
    framed = framing(made.camera, mesh.vertices[np.unique(mesh.faces)], eye)
    return replace(made, camera=framed, content_hash=content_hash(framed, made.materials, made.shapes, made.lights))


def neutral_lights(towards: NDArray[np.float64], up: NDArray[np.float64]) -> list[dict[str, Any]]:
    """A sky, and a sun above the left of a camera in the direction `towards` (3,) with this axis upwards, as a scene file has
    them."""
    direction = -0.6 * towards - up + np.cross(up, towards)
    return [SKY, {"directional": {"direction": direction.tolist(), "irradiance": SUN}}]


def _has_normals(file: Path) -> bool:
    """Whether an OBJ or a PLY has vertex normals; an STL never has."""
    data = file.read_bytes()
    if file.suffix.lower() == ".ply":
        return b" nx" in data.partition(b"end_header")[0]
    return file.suffix.lower() == ".obj" and re.search(rb"^\s*vn\s", data, re.MULTILINE) is not None


def framing(camera: Perspective, points: NDArray[np.float64], towards: NDArray[np.float64]) -> Perspective:
    """`camera` moved so that it sees all `points` (n, 3) as large as they fit, from the direction `towards` (3,), of length 1.

    A single point is seen from a distance of 1.
    """
    width, height = camera.resolution
    vertical = np.tan(np.radians(FOV) / 2)
    horizontal = vertical * width / height
    right = np.cross(camera.up, towards)
    right /= np.linalg.norm(right)
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    x, y, z = ((points - centre) @ axis for axis in (right, np.cross(towards, right), towards))
    distance = MARGIN * max(float((abs(x) / horizontal + z).max()), float((abs(y) / vertical + z).max())) or 1.0
    return replace(camera, eye=tuple((centre + distance * towards).tolist()), target=tuple(centre.tolist()))
