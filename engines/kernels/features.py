"""What a scene holds, as far as machine code depends on it."""

from __future__ import annotations

from functools import wraps
from typing import Any, NamedTuple


class SceneFeatures(NamedTuple):
    """Stages are compiled for the features that they read (`per_features`), so that scenes which differ in others share
    their machine code, and no stage has code for what the scene lacks. Kinds are those of `engines.kernels.flatten`."""

    triangles: bool = False
    spheres: bool = False
    planes: bool = False
    analytic: tuple[int, ...] = ()
    """Kinds of the bounded shapes, besides spheres, that have a formula."""
    instances: bool = False
    """Some shapes are groups, placed by matrices."""
    smooth: bool = False
    """Triangles with vertex normals."""
    bsdfs: tuple[int, ...] = ()
    """Kinds of BSDF models."""
    lobes: bool = False
    """Some BSDF may choose among lobes: a plugin's, rough glass, plastic, principled."""
    diffuse: bool = False
    """Some kd is above 0; mirror and refraction the same of ks and kt."""
    mirror: bool = False
    refraction: bool = False
    specular_reflection: bool = False
    specular_transmission: bool = False
    transmission: bool = False
    """Some BSDF sends light through the surface by a lobe that is no delta: light samples may lie on the far side."""
    clearcoat: bool = False
    """Some principled BSDF has a clearcoat; spec_trans: one transmits."""
    spec_trans: bool = False
    tangents: bool = False
    """Some material is anisotropic."""
    emission: bool = False
    """Some surface emits."""
    textured_emission: bool = False
    """Some surface emits what a texture holds."""
    lights: tuple[int, ...] = ()
    """Kinds of listed lights."""
    light_frames: bool = False
    """Some spot light or projector shows a texture."""
    many_lights: bool = False
    power_lights: bool = False
    """The integrator chooses lights by their power; light_hierarchy: by a hierarchy."""
    light_hierarchy: bool = False
    light_cells: bool = False
    """It chooses them by the cell of a grid that the point lies in."""
    turned_environment: bool = False
    """The environment's image is rotated."""
    mesh_lights: bool = False
    """Some light is a mesh, of which a face is chosen."""

    programs: bool = False
    """Some material has a program: textures, or models wrapped by others."""
    textures: bool = False
    attributes: bool = False
    """Some texture is an attribute of meshes."""
    uvs: bool = False
    """Some mesh that a program meets has texture coordinates."""
    choices: bool = False
    """Some program takes one way or the other by chance."""
    masks: bool = False
    blends: int = 0
    """How many blends some program has around each other, counted along their first parts."""
    tilts: bool = False
    """Some program tilts the shading normal."""

    null_lobes: bool = False
    """Some surface lets rays pass as if it were not there."""
    transparent: bool = False
    """Null lobes are crossed freely, by paths and shadow rays: the integrator's `transparent_shadows`."""
    hidden_emitters: bool = False
    """The camera does not see what emits: the integrator's `hide_emitters`."""
    media: bool = False
    """There are media, which the integrator shows."""
    guided: bool = False
    """Directions are sampled by an SD-tree as well: the integrator's `guiding`."""

    @property
    def other_shapes(self) -> bool:
        """There are other shapes than triangles."""
        return self.spheres or self.planes or len(self.analytic) > 0


class FeatureReader:
    """Features that note which of them are read."""

    def __init__(self, features: Any) -> None:
        self._features, self.read = features, dict[str, Any]()

    def __getattr__(self, name: str) -> Any:
        self.read[name] = value = getattr(self._features, name)
        return value


def plain(features: Any) -> SceneFeatures:
    """The features behind a reader, which notes nothing then."""
    return features._features if isinstance(features, FeatureReader) else features


def per_features(make: Any) -> Any:
    """Keeps what a factory (features, *arguments) makes for each set of arguments and of features *that it has read*: scenes
    that differ in others share machine code, and no factory has to say which concern it."""
    kept: dict[tuple[Any, ...], list[tuple[dict[str, Any], Any]]] = {}

    @wraps(make)
    def made(features: Any, *arguments: Any) -> Any:
        same, given = kept.setdefault(arguments, []), plain(features)
        found = next((one for one in same if all(getattr(given, name) == value for name, value in one[0].items())), None)
        if found is None:
            reader = FeatureReader(given)
            found = reader.read, make(reader, *arguments)
            same.append(found)
        read, result = found
        if isinstance(features, FeatureReader):
            features.read.update(read)
        return result

    return made
