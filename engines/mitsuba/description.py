"""A scene in Mitsuba's terms: nested dictionaries that `mitsuba.load_dict` takes and that `raybench export` writes as XML.

Transforms are 4 x 4 float64 arrays and meshes are files, written by a function that the caller gives. What differs:
planes are disks, so large that nothing tells; a surface that emits on both sides is two surfaces a hair apart,
as Mitsuba's area lights have one side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene import (
    BLACK,
    Camera,
    Conductor,
    CustomBSDF,
    CustomLight,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    Light,
    Material,
    Mesh,
    Orthographic,
    Perspective,
    Plane,
    PointLight,
    Scene,
    Sphere,
    SphereSet,
    SpotLight,
    Triangle,
    Triple,
)

Array = NDArray[Any]
Node = dict[str, Any]
PlaceMesh = Callable[[str, Array, Array, "Array | None"], str]
PlaceImage = Callable[[str, Array], str]

NEAR, FAR = 1e-4, 1e7
"""The clipping planes of the camera: nothing of a scene is meant to be cut off."""
PLANE_EXTENTS = 1e4
"""Radius of the disk that stands for a plane, in extents of the rest of the scene. Hits of a rectangle of that size are so far
off it in float32 that it shadows itself where it is tilted."""
GAP = 1e-5
"""Half the distance between the sides of a surface that emits on both, in extents of the scene."""


@dataclass(frozen=True, slots=True)
class Part:
    """A shape of Mitsuba's: `node` without its name, the scene's shape it comes from, and what its primitives are there.

    `flipped` parts have their second and third vertices exchanged.
    """

    node: Node
    shape: int
    material: int
    primitives: Array
    flipped: bool = False


@dataclass(frozen=True, slots=True)
class Description:
    """`parts` in the order in which they stand in `nodes` ("shape_0", ...)."""

    nodes: Node
    parts: tuple[Part, ...]


def described(scene: Scene, place_mesh: PlaceMesh, place_image: PlaceImage, robust: bool = True) -> Description:
    """Materials, shapes and lights; the caller adds the sensor and the integrator. `why_not` must have agreed."""
    nodes: Node = {"type": "scene", "embree_use_robust_intersections": robust}
    for index, material in enumerate(scene.materials):
        nodes[f"material_{index}"] = bsdf(material)
    parts = tuple(_parts(scene, place_mesh))
    for index, part in enumerate(parts):
        nodes[f"shape_{index}"] = part.node
    for index, light in enumerate(scene.lights):
        nodes[f"light_{index}"] = _light(light, place_image)
    return Description(nodes, parts)


def scene_lacks(scene: Scene) -> str | None:
    """One sentence on what of the scene Mitsuba has no counterpart for, or None."""
    if lacks := camera_lacks(scene.camera):
        return f"Mitsuba has no counterpart of {lacks}"
    for material in scene.materials:
        if lacks := material_lacks(material):
            return f"material {material.name!r}: Mitsuba has no counterpart of {lacks}"
    planes = (scene.materials[shape.material] for shape in scene.shapes if isinstance(shape, Plane))
    for material in planes:
        if isinstance(material.bsdf, Conductor) and material.bsdf.alpha[0] != material.bsdf.alpha[1]:
            return f"material {material.name!r}: Mitsuba has no counterpart of an anisotropic conductor on a plane"
    if sum(isinstance(light, EnvironmentLight) for light in scene.lights) > 1:
        return "the scene has several environments, of which Mitsuba renders one"
    if any(isinstance(light, CustomLight) for light in scene.lights):
        return "Mitsuba has no counterpart of light plugins"
    if any(isinstance(light, PointLight) and not light.falloff for light in scene.lights):
        return "Mitsuba's point lights fall off with the square of the distance"
    return None


# ---- materials -------------------------------------------------------------------------------------------------------


def material_lacks(material: Material) -> str | None:
    """What of a material Mitsuba has no counterpart for, or None."""
    if isinstance(material.bsdf, CustomBSDF):
        return "BSDF plugins"
    diffuse, mirror, glass = (max(weights) > 0.0 for weights in (material.kd, material.ks, material.kt))
    if glass and not (material.fresnel and not diffuse):
        return "refraction without Fresnel's equations, or beside a diffuse lobe"
    if glass and material.emits and material.two_sided:
        return "glass that emits on both sides"
    if mirror and not glass and material.fresnel:
        return "a mirror weighted by Fresnel's equations without refraction"
    if diffuse and mirror and max(material.kd) + max(material.ks) > 1.0:
        return "a blend of a diffuse and a mirror lobe whose largest components add up to more than 1"
    return None


def bsdf(material: Material) -> Node:
    """The BSDF of a material that `material_lacks` nothing."""
    if isinstance(material.bsdf, Conductor):
        return {"type": "twosided", "bsdf": _conductor(material.bsdf)}
    diffuse, mirror = max(material.kd), max(material.ks)
    if max(material.kt) > 0.0:
        return {
            "type": "dielectric", "int_ior": material.ior, "ext_ior": 1.0,
            "specular_reflectance": rgb(material.ks), "specular_transmittance": rgb(material.kt),
        }  # fmt: skip
    if mirror == 0.0:
        return {"type": "twosided", "bsdf": _diffuse(material.kd)}
    if diffuse == 0.0:
        return {"type": "twosided", "bsdf": _mirror(material.ks)}
    weight = mirror / (diffuse + mirror)
    kd, ks = (tuple(x / w for x in lobe) for lobe, w in ((material.kd, 1.0 - weight), (material.ks, weight)))
    blend = {"type": "blendbsdf", "weight": weight, "bsdf_0": _diffuse(kd), "bsdf_1": _mirror(ks)}
    return {"type": "twosided", "bsdf": blend}


def _diffuse(reflectance: Any) -> Node:
    return {"type": "diffuse", "reflectance": rgb(reflectance)}


def _mirror(reflectance: Any) -> Node:
    return {"type": "conductor", "material": "none", "specular_reflectance": rgb(reflectance)}


def _conductor(metal: Conductor) -> Node:
    node: Node = {"type": "conductor", "eta": rgb(metal.eta), "k": rgb(metal.k)}
    node["specular_reflectance"] = rgb(metal.reflectance)
    if max(metal.alpha) == 0.0:
        return node
    alpha_u, alpha_v = metal.alpha
    return {**node, "type": "roughconductor", "distribution": "ggx", "alpha_u": alpha_u, "alpha_v": alpha_v}


def rgb(values: Any) -> Node:
    return {"type": "rgb", "value": [float(value) for value in values]}


# ---- shapes ----------------------------------------------------------------------------------------------------------


def extent(scene: Scene) -> float:
    """The largest coordinate of anything finite in the scene, the camera included; at least 1e-3."""
    reach = [np.abs(box).max() for shape in scene.shapes if (box := shape.bounds()) is not None]
    reach += [np.abs(shape.point).max() for shape in scene.shapes if isinstance(shape, Plane)]
    reach += [np.abs(getattr(scene.camera, name, BLACK)).max() for name in ("eye", "target")]
    return float(max(1e-3, *reach))


def _parts(scene: Scene, place_mesh: PlaceMesh) -> Iterator[Part]:
    size = extent(scene)
    for index, shape in enumerate(scene.shapes):
        if not isinstance(shape, (Triangle, Mesh)):
            yield from _round_or_flat(scene, index, shape, size)
            continue
        pieces = _triangles(shape)
        for material in np.unique(pieces.materials):
            faces = np.flatnonzero(pieces.materials == material)
            for piece, side in _sides(pieces, faces, scene.materials[material], GAP * size):
                name = f"shape_{index}_{scene.materials[material].name}_{'back' if side < 0 else 'front'}"
                node: Node = {"type": "ply", "filename": place_mesh(name, *piece), "face_normals": piece[2] is None}
                yield _finished(scene, node, Part(node, index, int(material), faces, side < 0))


def _triangles(shape: Triangle | Mesh) -> Mesh:
    if isinstance(shape, Mesh):
        return shape
    corners = np.array([shape.a, shape.b, shape.c])
    return Mesh(corners, np.array([[0, 1, 2]], np.int32), np.array([shape.material], np.int32))


def _sides(
    mesh: Mesh, chosen: Array, material: Material, gap: float
) -> Iterator[tuple[tuple[Array, Array, Array | None], int]]:
    """Vertices, faces and normals of the chosen faces, and 1 for the front; -1 for a back with a surface of its own."""
    faces = mesh.faces[chosen]
    if not (material.emits and material.two_sided):
        used, faces = np.unique(faces, return_inverse=True)
        normals = None if mesh.normals is None else mesh.normals[used]
        yield (mesh.vertices[used], faces.reshape(-1, 3), normals), 1
        return
    corners = mesh.vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0)[:, None, :]
    order = np.arange(3 * len(faces)).reshape(-1, 3)
    smooth = None if mesh.normals is None else mesh.normals[faces].reshape(-1, 3)
    yield ((corners + gap * normal).reshape(-1, 3), order, smooth), 1
    yield ((corners - gap * normal).reshape(-1, 3), order[:, [0, 2, 1]], None if smooth is None else -smooth), -1


def _round_or_flat(scene: Scene, index: int, shape: Plane | Disk | Sphere | SphereSet, size: float) -> Iterator[Part]:
    material = scene.materials[shape.material]
    sides = ((1, GAP * size), (-1, GAP * size)) if material.emits and material.two_sided else ((1, 0.0),)
    for side, gap in sides:
        if isinstance(shape, Plane):
            point = np.add(shape.point, np.multiply(shape.normal, side * gap))
            nodes = [{"type": "disk", "to_world": facing(point, np.multiply(shape.normal, side), PLANE_EXTENTS * size)}]
        elif isinstance(shape, Disk):
            center = np.add(shape.center, np.multiply(shape.normal, side * gap))
            nodes = [{"type": "disk", "to_world": facing(center, np.multiply(shape.normal, side), shape.radius)}]
        else:
            spheres = (
                [(shape.center, shape.radius)]
                if isinstance(shape, Sphere)
                else list(zip(shape.centers, shape.radii, strict=True))
            )
            nodes = [
                {"type": "sphere", "center": [float(x) for x in center], "radius": float(radius) + side * gap}
                | ({"flip_normals": True} if side < 0 else {})
                for center, radius in spheres
            ]  # fmt: skip
        for primitive, node in enumerate(nodes):
            yield _finished(scene, node, Part(node, index, shape.material, np.array([primitive]), side < 0))


def facing(point: Any, normal: Any, scale: float) -> Array:
    """(4, 4) the transform of the plane z = 0 to the one through `point`, `scale` times as large and +z to `normal`."""
    tangent = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    tangent /= np.linalg.norm(tangent)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = tangent * scale, np.cross(normal, tangent) * scale
    matrix[:3, 2], matrix[:3, 3] = normal, point
    return matrix


def _finished(scene: Scene, node: Node, part: Part) -> Part:
    """The part with its material and light."""
    material = scene.materials[part.material]
    node["bsdf"] = {"type": "ref", "id": f"material_{part.material}"}
    if material.emits:
        node["emitter"] = {"type": "area", "radiance": rgb(material.emission)}
    return part


# ---- lights and camera -----------------------------------------------------------------------------------------------


def _light(light: Light, place_image: PlaceImage) -> Node:
    if isinstance(light, PointLight):
        return {"type": "point", "position": list(light.position), "intensity": rgb(light.intensity)}
    if isinstance(light, DirectionalLight):
        return {"type": "directional", "direction": list(light.direction), "irradiance": rgb(light.irradiance)}
    if isinstance(light, SpotLight):
        return {
            "type": "spot", "to_world": facing(light.position, light.direction, 1.0), "intensity": rgb(light.intensity),
            "cutoff_angle": light.cutoff, "beam_width": light.beam_width,
        }  # fmt: skip
    assert isinstance(light, EnvironmentLight)
    if light.image is None:
        return {"type": "constant", "radiance": rgb(light.radiance)}
    return {"type": "envmap", "filename": place_image("sky", _knots(light))}


def _knots(light: EnvironmentLight) -> Array:
    """The image as Mitsuba interpolates it: its rows reach from pole to pole, ours are centred in equal bands.

    Bilinear interpolation over twice as many bands and one row gives the same function, knot for knot.
    """
    assert light.image is not None
    image = light.image * np.array(light.radiance)
    rows = np.clip(np.arange(2 * len(image) + 1) / 2.0 - 0.5, 0.0, len(image) - 1.0)
    low = np.floor(rows).astype(int)
    high, share = np.minimum(low + 1, len(image) - 1), (rows - low)[:, None, None]
    return image[low] * (1.0 - share) + image[high] * share


def camera_lacks(camera: Camera) -> str | None:
    if isinstance(camera, (Perspective, Orthographic)):
        return None
    return "cameras but perspective and orthographic ones"


def sensor(camera: Camera, width: int, height: int, sampler: Node, size: float) -> Node:
    """A sensor with a film of `width` x `height` pixels and a box filter. `size`: the extent of the scene."""
    assert isinstance(camera, (Perspective, Orthographic))
    film = {
        "type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}, "pixel_format": "rgb",
        "component_format": "float32", "sample_border": False,
    }  # fmt: skip
    to_world = look_at(camera.eye, camera.target, camera.up)
    clip = {"near_clip": NEAR * size, "far_clip": FAR * size}
    if isinstance(camera, Perspective):
        lens: Node = {"type": "perspective", "fov": camera.fov, "fov_axis": camera.fov_axis, **clip}
    else:
        # Mitsuba's window is two wide, whatever the shape of the image
        half = camera.height / 2.0 * width / height
        to_world = to_world @ np.diag([half, half, 1.0, 1.0])
        lens = {"type": "orthographic", **clip}
    return {**lens, "to_world": to_world, "film": film, "sampler": sampler}


def look_at(eye: Triple, target: Triple, up: Triple) -> Array:
    """Camera to world: +z forward, +y up, +x to the left."""
    forward = np.subtract(target, eye)
    forward = forward / np.linalg.norm(forward)
    left = np.cross(up, forward)
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3] = np.stack([left, np.cross(forward, left), forward, eye], axis=1)
    return matrix
