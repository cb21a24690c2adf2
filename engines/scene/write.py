"""Scenes as files: a YAML file with meshes and textures beside it, which loads as the same scene."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import ConfigError
from engines.image import decoded_srgb, write_channels, write_image
from engines.scene.bsdf import INNER, Blend, Bsdf, Bump, Mask, NormalMap, Sides
from engines.scene.bsdf_tree import is_opaque
from engines.scene.cameras import Camera, Orthographic, Perspective, PerspectiveArctan, ThinLens
from engines.scene.formats.ply import write_ply
from engines.scene.leaf_fields import LEAF_PLUGINS
from engines.scene.lights import DirectionalLight, EnvironmentLight, Light, PointLight, ProjectorLight, SpotLight
from engines.scene.materials import Material
from engines.scene.media import SIDES, HomogeneousMedium
from engines.scene.mesh import Mesh, SphereSet
from engines.scene.models import Mixture
from engines.scene.scene import FORMAT, Scene
from engines.scene.shapes import Cylinder, Disk, Instance, Plane, Shape, Single, Sphere, Triangle, groups_of
from engines.scene.support import foreign
from engines.scene.textures import IDENTITY, Checkerboard, ImageTexture, MeshAttribute, Texture
from engines.scene.triple import BLACK, WHITE, Triple
from engines.schema.fields import unit
from engines.schema.yaml_file import yaml_text

__all__ = ["save_scene"]

FILE = "scene.yaml"
MESHES, TEXTURES = "meshes", "textures"
LONGEST = 60
"""Characters of a file's name."""
MOST_SPHERES = 50_000
"""Spheres of a set, each of five values of the YAML file."""

Keys = dict[str, Any]


def save_scene(scene: Scene, folder: str | PathLike[str]) -> Path:
    """Writes a scene into a folder, which is made where it is missing, and returns the path of its YAML file.

    Meshes become binary PLY files, textures and environments EXR files (float32). Loading the file gives a scene of the same
    content hash, except where an environment has more precision than float32. Files of the same names are replaced.

    Raises `ConfigError` where the folder cannot be written, for plugins, and for more spheres, instances or others than a YAML
    file can hold.
    """
    root = Path(folder)
    if lacks := foreign(scene, KNOWN, "a scene file"):
        raise ConfigError(lacks)
    try:
        root.mkdir(parents=True, exist_ok=True)
        tree = _Writer(root).scene(scene)
        (root / FILE).write_text(yaml_text(tree, str(root / FILE)), encoding="utf-8")
    except OSError as problem:
        raise ConfigError(f"{root}: cannot be written: {problem.strerror or problem}") from problem
    return root / FILE


@dataclass(slots=True)
class _Writer:
    """The state of writing one scene: names that are taken, by kind, and the names of textures and groups by identity."""

    root: Path
    taken: dict[str, set[str]] = field(default_factory=dict)
    textures: dict[int, str] = field(default_factory=dict)
    tree: Keys = field(default_factory=dict)
    groups: dict[int, str] = field(default_factory=dict)

    def scene(self, scene: Scene) -> Keys:
        names = [self.name("materials", material.name) for material in scene.materials]
        materials = {name: self.material(each) for name, each in zip(names, scene.materials, strict=True)}
        media = [self.name("media", medium.name) for medium in scene.media]
        shown = groups_of(scene.shapes)
        self.groups = {id(group): self.name("groups", group.name) for group in shown}
        groups = {self.groups[id(group)]: [self.shape(shape, names, media) for shape in group.shapes] for group in shown}
        shapes = [self.shape(shape, names, media) for shape in scene.shapes]
        keys = {
            "raybench_scene": FORMAT,
            "name": scene.name,
            "media": {name: _medium(medium) for name, medium in zip(media, scene.media, strict=True)},
            "camera": _camera(scene.camera, media),
            "textures": self.tree,
            "materials": materials,
            "groups": groups,
            "shapes": shapes,
            "lights": [self.light(light) for light in scene.lights],
        }
        return {key: value for key, value in keys.items() if value not in ({}, [])}

    def name(self, kind: str, proposed: str, file: bool = False) -> str:
        """A name of its own; one that a file may have everywhere, with `file`."""
        proposed = re.sub(r"[^A-Za-z0-9_.-]+", "_", proposed).strip("._")[:LONGEST] if file else proposed.strip()
        taken, unique, count = self.taken.setdefault(kind, set()), proposed or kind, 1
        while unique.lower() in taken:
            count += 1
            unique = f"{proposed or kind}_{count}"
        taken.add(unique.lower())
        return unique

    def path(self, folder: str, proposed: str, suffix: str) -> str:
        """The path, relative to the scene, of a file that is to be written."""
        (self.root / folder).mkdir(exist_ok=True)
        stem = re.sub(r"\.(obj|ply|stl|serialized|png|jpe?g|exr|hdr|tga)$", "", Path(proposed).name, flags=re.IGNORECASE)
        return f"{folder}/{self.name(folder, stem, file=True)}{suffix}"

    # ---- materials and textures --------------------------------------------------------------------------------------

    def material(self, material: Material) -> Keys:
        keys = self.bsdf(material.bsdf) if material.bsdf else self.lobes(material)
        emission = {"emission": self.value(material.emission)} if material.emission != BLACK else {}
        return keys | emission | ({"two_sided": True} if material.two_sided else {})

    def lobes(self, of: Material | Mixture) -> Keys:
        colors = {key: self.value(getattr(of, key)) for key in ("kd", "ks", "kt") if getattr(of, key) != BLACK}
        return colors | ({"ior": of.ior} if of.ior != 1.0 else {}) | ({"fresnel": True} if of.fresnel else {})

    def bsdf(self, bsdf: Bsdf) -> Keys:
        """The keys of a material with this BSDF."""
        if isinstance(bsdf, Mixture):
            return self.lobes(bsdf)
        if isinstance(bsdf, Sides):
            front = {} if bsdf.front is None else self.bsdf(bsdf.front)
            if bsdf.back is None and front and bsdf.front and "sides" not in front and is_opaque(bsdf.front):
                return {**front, "sides": "front"}
            return {"by_side": {side: self.bsdf(part) for side in ("front", "back") if (part := getattr(bsdf, side))}}
        if type(bsdf) in LEAF_PLUGINS:
            return self.leaf(bsdf)
        parts = {item.name: getattr(bsdf, item.name) for item in fields(bsdf)}
        inner = INNER[type(bsdf)]
        keys = {key: self.bsdf(part) if key in inner else self.value(part) for key, part in parts.items()}
        return {_WRAPPERS[type(bsdf)]: keys}

    def leaf(self, leaf: Any) -> Keys:
        plugin, keys = LEAF_PLUGINS[type(leaf)], {}
        for item in fields(leaf):
            value = getattr(leaf, item.name)
            if item.name == "alpha" and isinstance(value, tuple):
                first, second = map(self.value, value)
                keys["alpha"] = first if value[0] == value[1] else [first, second]
            else:
                keys[plugin.key_of(item.name)] = self.value(value)
        return {plugin.key: keys}

    def value(self, value: Any) -> Any:
        """A number, a colour, or the name of a texture."""
        if isinstance(value, Texture):
            return self.texture(value)
        return _color(value) if isinstance(value, tuple) else value

    def texture(self, texture: Texture) -> str:
        if id(texture) not in self.textures:
            proposed = "checkerboard" if isinstance(texture, Checkerboard) else texture.name
            name = self.textures[id(texture)] = self.name("textures", proposed)
            self.tree[name] = self.texture_keys(texture)
        return self.textures[id(texture)]

    def texture_keys(self, texture: Texture) -> Keys:
        match texture:
            case ImageTexture():
                return self.image(texture)
            case MeshAttribute(name, scale):
                return {"attribute": name, **({} if scale == 1.0 else {"scale": scale})}
            case Checkerboard(a, b, to_uv):
                return {"checkerboard": {"a": _color(a), "b": _color(b)}, **_placing(to_uv)}

    def image(self, texture: ImageTexture) -> Keys:
        path = self.path(TEXTURES, texture.name, ".exr")
        channels = ("Y",) if texture.pixels.shape[2] == 1 else ("R", "G", "B")
        write_channels(self.root / path, {name: texture.pixels[:, :, i] for i, name in enumerate(channels)})
        how = {"color_space": "raw"} | _other_than(texture, {"filter": "bilinear", "wrap": "repeat"})
        return {"image": path, **how, **_placing(texture.to_uv)}

    # ---- shapes and lights -------------------------------------------------------------------------------------------

    def shape(self, shape: Shape, names: list[str], media: list[str]) -> Keys:
        if isinstance(shape, Instance):
            return {"instance": {"group": self.groups[id(shape.group)], "matrix": shape.matrix.tolist()}}
        return {**self.single(shape, names), **_sides(shape, media)}

    def single(self, shape: Single, names: list[str]) -> Keys:
        if isinstance(shape, Mesh):
            return self.mesh(shape, names)
        if isinstance(shape, SphereSet):
            if len(shape.radii) > MOST_SPHERES:
                raise ConfigError(f"{self.root}: a set of {len(shape.radii)} spheres: at most {MOST_SPHERES} can be written")
            spheres = {"centers": shape.centers.tolist(), "radii": shape.radii.tolist()}
            return {"spheres": spheres, "material": names[shape.material]}
        kind = _SHAPES[type(shape)]
        keys = {item.name: _plain(getattr(shape, item.name)) for item in fields(shape) if item.name not in _NAMED}
        if isinstance(shape, Disk | Plane):
            keys["normal"] = _direction(shape.normal)
        return {kind: keys, "material": names[shape.material]}

    def mesh(self, mesh: Mesh, names: list[str]) -> Keys:
        used, place = np.unique(mesh.materials, return_inverse=True)
        path = self.path(MESHES, mesh.name, ".ply")
        several = place.astype(np.int32) if len(used) > 1 else None
        columns = mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, several
        write_ply(self.root / path, *columns, exact=True, attributes=mesh.attributes)
        material = [names[index] for index in used]
        smooth = {} if mesh.normals is None else {"smooth": True}
        return {"mesh": {"file": path, **smooth}, "material": material if several is not None else material[0]}

    def light(self, light: Light) -> Keys:
        if isinstance(light, PointLight):
            falloff = {} if light.falloff else {"falloff": "none"}
            return {"point": {"position": [*light.position], "intensity": _color(light.intensity), **falloff}}
        if isinstance(light, DirectionalLight):
            irradiance = _color(light.irradiance)
            return {"directional": {"direction": _direction(light.direction), "irradiance": irradiance}}
        if isinstance(light, SpotLight):
            cone = {"cutoff": light.cutoff, "beam_width": light.beam_width}
            shown = {} if light.texture is None else {"texture": self.texture(light.texture), "up": _direction(light.up)}
            return {"spot": {**_axis(light), "intensity": _color(light.intensity), **cone, **shown}}
        if isinstance(light, ProjectorLight):
            frame = {"up": _direction(light.up), "fov": light.fov, "fov_axis": light.fov_axis}
            shown = {"irradiance": _color(light.irradiance), "texture": self.texture(light.texture)}
            return {"projector": {**_axis(light), **shown, **frame}}
        assert isinstance(light, EnvironmentLight)
        image = {} if light.image is None else {"image": self.sky(light.image)}
        how = _other_than(light, {"rotation": EnvironmentLight(WHITE).rotation, "rows": "cells"}) if image else {}
        return {"environment": {"radiance": _color(light.radiance), **image, **how}}

    def sky(self, image: NDArray[np.float64]) -> str:
        """An EXR file, or a PNG where the image has come from eight bits, which float32 does not hold exactly."""
        levels = decoded_srgb(np.arange(256, dtype=np.uint8))
        nearest = np.searchsorted(levels, image).clip(0, 255).astype(np.uint8)
        exact = np.array_equal(levels[nearest], image)
        path = self.path(TEXTURES, "environment", ".png" if exact else ".exr")
        write_image(self.root / path, nearest if exact else image)
        return path


_SHAPES = {Sphere: "sphere", Disk: "disk", Plane: "plane", Cylinder: "cylinder", Triangle: "triangle"}
_CAMERAS = {
    Perspective: "perspective",
    ThinLens: "thin_lens",
    PerspectiveArctan: "perspective_arctan",
    Orthographic: "orthographic",
}
_NAMED = ("material", *SIDES)
"""Fields of shapes that are places in lists of the scene."""
_WRAPPERS = {Mask: "mask", Blend: "blend", Bump: "bump", NormalMap: "normal_map"}


def _medium(medium: HomogeneousMedium) -> Keys:
    anisotropic = {"g": medium.g} if medium.g else {}
    return {"sigma_t": _color(medium.sigma_t), "albedo": _color(medium.albedo), **anisotropic}


def _sides(shape: Single, media: list[str]) -> Keys:
    """The names of the media on its sides."""
    return {side: media[index] for side in SIDES if (index := getattr(shape, side)) is not None}


def _camera(camera: Camera, media: list[str]) -> Keys:
    keys = {item.name: _plain(getattr(camera, item.name)) for item in fields(camera)}
    medium = keys.pop("medium")
    defaults = {"principal_point": [0.0, 0.0], "mirror": False, "clip": [0.0, math.inf], "width": None, "height": None}
    for key, default in defaults.items():
        if key in keys and keys[key] == default:
            del keys[key]
    return {"type": _CAMERAS[type(camera)], **keys, **({} if medium is None else {"medium": media[medium]})}


KNOWN: frozenset[type] = frozenset(
    {
        *_CAMERAS,
        *_SHAPES,
        Mesh,
        SphereSet,
        Instance,
        PointLight,
        DirectionalLight,
        SpotLight,
        ProjectorLight,
        EnvironmentLight,
        HomogeneousMedium,
        *LEAF_PLUGINS,
        *_WRAPPERS,
        Mixture,
        Sides,
        ImageTexture,
        Checkerboard,
        MeshAttribute,
    }
)
"""The types of scenes that are written."""


def _color(color: Triple) -> float | list[float]:
    return color[0] if color[0] == color[1] == color[2] else [*color]


def _plain(value: Any) -> Any:
    """Tuples as lists, within each other too."""
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _other_than(thing: Any, defaults: Keys) -> Keys:
    return {key: _plain(getattr(thing, key)) for key, default in defaults.items() if getattr(thing, key) != default}


def _placing(to_uv: tuple[float, ...]) -> Keys:
    a, b, c, d, e, f = to_uv
    if to_uv == IDENTITY:
        return {}
    if b == d == 0.0:
        return {"scale": [a, e], "offset": [c, f]}
    return {"to_uv": [[a, b, c], [d, e, f]]}


def _axis(light: SpotLight | ProjectorLight) -> Keys:
    return {"position": [*light.position], "direction": _direction(light.direction)}


def _direction(direction: Triple) -> list[float]:
    """A vector that the reader makes exactly this unit vector of: rounding may need another length."""
    for length in np.linspace(1.0, 2.0, 200):
        x, y, z = (float(length * axis) for axis in direction)
        if unit((x, y, z)) == direction:
            return [x, y, z]
    return [*direction]
