"""A scene as a file for pbrt-v4 (Pharr, Jakob, Humphreys 2023), with its meshes beside it.

What differs: planes are squares a thousand times as large as the scene, colours and coefficients of media pass
through pbrt's spectra, textures are filtered, masking and shadowing of its rough conductors are correlated by height, and its
integrators have a roulette of their own. Depths count in segments here and in bounces there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import engines.scene as model
from engines.errors import Unsupported
from engines.peers.adapters.colors import largest, mirror_share
from engines.peers.adapters.geometry import OWN_UVS, extent, pieces, with_uvs
from engines.peers.adapters.lacks import is_diffuse, point_lights_lack, textures_lack
from engines.peers.adapters.tessellation import squares
from engines.peers.export.files import Beside, numbers
from engines.peers.mitsuba.bsdfs import material_lacks
from engines.peers.mitsuba.cameras import CAMERAS, camera_lacks
from engines.peers.mitsuba.lights import LIGHTS
from engines.peers.mitsuba.shapes import SHAPES
from engines.scene.bsdf_tree import textures
from engines.scene.frames import facing
from engines.scene.leaf_fields import is_rough
from engines.scene.shapes import Single, as_spheres, singles
from engines.scene.support import foreign

PLANE_EXTENTS = 1e3
_LEAVES = (model.Diffuse, model.Conductor, model.Dielectric, model.ThinDielectric, model.Null)
KNOWN: frozenset[type] = frozenset(
    {*CAMERAS, *SHAPES, *LIGHTS, model.HomogeneousMedium, model.Mixture, *_LEAVES, model.ImageTexture}
)
"""The types of scenes that are written."""


def write_pbrt(scene: model.Scene, path: Path, max_depth: int = 6, spp: int = 64) -> None:
    """Writes `path` (.pbrt). Raises `Unsupported` for what pbrt does not support."""
    if reason := _lacks(scene):
        raise Unsupported(reason)
    beside = Beside(path)
    lines = [*map(_medium, range(len(scene.media)), scene.media), *_view(scene, max_depth, spp)]
    for light in scene.lights:
        lines += _light(light)
    for index, material in enumerate(scene.materials):
        lines += _material(f"material_{index}", material, beside)
    for _, shape in singles(scene.shapes):
        lines += _shape(scene, shape, beside)
    path.write_text("\n".join(lines) + "\n")


def _lacks(scene: model.Scene) -> str | None:
    """One sentence on what pbrt does not support, or None."""
    if lacks := foreign(scene, KNOWN, "pbrt"):
        return lacks
    if lacks := camera_lacks(scene.camera) or _view_lacks(scene.camera):
        return f"pbrt does not support {lacks}"
    for material in scene.materials:
        if lacks := material_lacks(material) or _textures_lack(material) or _bsdf_lacks(material):
            return f"material {material.name!r}: pbrt does not support {lacks}"
    lights_lack = next(filter(None, map(_light_lacks, scene.lights)), None)
    return lights_lack or point_lights_lack(scene, "pbrt") or textures_lack(scene)


def _view_lacks(camera: Any) -> str | None:
    if camera.mirror or camera.principal_point != (0.0, 0.0) or camera.clip != (0.0, math.inf):
        return "mirrored, shifted and clipped cameras"
    return None


def _light_lacks(light: model.Light) -> str | None:
    if isinstance(light, model.SpotLight | model.ProjectorLight) and light.texture is not None:
        return "pbrt's spot lights show no images, and its projectors do without filtering"
    if isinstance(light, model.EnvironmentLight) and light.image is not None:
        return "pbrt's images of the sky are octahedral, and ours is latitude-longitude"
    if isinstance(light, model.SpotLight) and light.beam_width < light.cutoff:
        return "pbrt's spot lights fall off smoothly in the cosine, and ours linearly in the angle"
    return None


def _textures_lack(material: model.Material) -> str | None:
    if isinstance(material.emission, model.ImageTexture):
        return "emission from textures"
    for texture in textures(material.as_bsdf):
        assert isinstance(texture, model.ImageTexture)
        if not is_diffuse(material.as_bsdf):
            return "textures on anything but a diffuse BSDF"
        if texture.wrap == "mirror" or texture.to_uv[1] != 0.0 or texture.to_uv[3] != 0.0:
            return "textures that are mirrored, or whose coordinates are turned"
    return None


def _bsdf_lacks(material: model.Material) -> str | None:
    bsdf = material.as_bsdf
    if isinstance(bsdf, model.Null) and material.emits:
        return "clear surfaces that emit"
    if isinstance(bsdf, model.Conductor) and bsdf.reflectance != model.WHITE:
        return "a conductor whose reflectance is scaled"
    if isinstance(bsdf, (model.Conductor, model.Dielectric)) and is_rough(bsdf):
        if bsdf.alpha[0] != bsdf.alpha[1]:
            return f"the tangents of an anisotropic {type(bsdf).__name__.lower()}"
        if bsdf.distribution != "ggx":
            return "microfacets but GGX"
    colors = ("reflectance", "transmittance") if isinstance(bsdf, (model.Dielectric, model.ThinDielectric)) else ()
    if isinstance(bsdf, model.Mixture) and largest(bsdf.kt) > 0.0:
        colors = ("ks", "kt")
    return "tinted glass" if any(getattr(bsdf, name) != model.WHITE for name in colors) else None


def _view(scene: model.Scene, max_depth: int, spp: int) -> Iterator[str]:
    camera = scene.camera
    assert isinstance(camera, (model.Perspective, model.Orthographic, model.ThinLens))
    width, height = camera.resolution
    if camera.medium is not None:
        yield _between(None, camera.medium)
    yield "Scale -1 1 1"  # pbrt's camera space is left-handed
    yield f"LookAt {numbers((*camera.eye, *camera.target, *camera.up))}"
    if isinstance(camera, (model.Perspective, model.ThinLens)):
        yield f'Camera "perspective" "float fov" [ {_shorter_fov(camera)!r} ]{_lens(camera)}'
    else:
        across, high = camera.window(width / height)
        x, y = across / 2.0, high / 2.0
        yield f'Camera "orthographic" "float screenwindow" [ {numbers((-x, x, -y, y))} ]'
    name = re.sub(r"[^\w.-]", "_", Path(scene.source).stem) or "scene"  # a quote in it would end pbrt's string
    yield f'Film "rgb" "integer xresolution" [ {width} ] "integer yresolution" [ {height} ] "string filename" [ "{name}.exr" ]'
    yield 'PixelFilter "box" "float xradius" [ 0.5 ] "float yradius" [ 0.5 ]'
    yield f'Sampler "independent" "integer pixelsamples" [ {spp} ]'
    yield f'Integrator "{"volpath" if scene.media else "path"}" "integer maxdepth" [ {max_depth - 1} ]'
    yield "WorldBegin"
    if camera.medium is not None:
        yield _between(None, None)  # else shapes that are no boundaries would be those of this medium


def _lens(camera: model.Perspective | model.ThinLens) -> str:
    if isinstance(camera, model.Perspective):
        return ""
    return f' "float lensradius" [ {camera.aperture_radius!r} ] "float focaldistance" [ {camera.focus_distance!r} ]'


def _shorter_fov(camera: model.Perspective | model.ThinLens) -> float:
    """pbrt measures the angle along the shorter side."""
    sides = dict(zip("xy", camera.resolution, strict=True))
    ratio = min(sides.values()) / sides[camera.fov_axis]
    return math.degrees(2.0 * math.atan(math.tan(math.radians(camera.fov) / 2.0) * ratio))


def _light(light: model.Light) -> Iterator[str]:
    if isinstance(light, model.PointLight):
        yield f'LightSource "point" {_rgb("I", light.intensity)} "point3 from" [ {numbers(light.position)} ]'
    elif isinstance(light, model.SpotLight):
        ends = f'"point3 from" [ {numbers(light.position)} ] "point3 to" [ {numbers(np.add(light.position, light.direction))} ]'
        cone = f'"float coneangle" [ {light.cutoff!r} ] "float conedeltaangle" [ 0 ]'
        yield f'LightSource "spot" {_rgb("I", light.intensity)} {ends} {cone}'
    elif isinstance(light, model.DirectionalLight):
        ends = f'"point3 from" [ 0 0 0 ] "point3 to" [ {numbers(light.direction)} ]'
        yield f'LightSource "distant" {_rgb("L", light.irradiance)} {ends}'
    elif isinstance(light, model.EnvironmentLight):
        yield f'LightSource "infinite" {_rgb("L", light.radiance)}'


def _medium(index: int, medium: model.HomogeneousMedium) -> str:
    scattered = np.multiply(medium.sigma_t, medium.albedo)
    sigmas = f"{_rgb('sigma_a', medium.sigma_t - scattered)} {_rgb('sigma_s', scattered)}"
    return f'MakeNamedMedium "medium_{index}" "string type" [ "homogeneous" ] {sigmas} "float g" [ {float(medium.g)!r} ]'


def _between(interior: int | None, exterior: int | None) -> str:
    """The media behind and before what follows."""
    behind, before = ("" if index is None else f"medium_{index}" for index in (interior, exterior))
    return f'MediumInterface "{behind}" "{before}"'


def _material(name: str, material: model.Material, beside: Beside) -> Iterator[str]:
    bsdf = material.as_bsdf
    if isinstance(bsdf, model.Conductor):
        yield _named(name, "conductor", f"{_rgb('eta', bsdf.eta)} {_rgb('k', bsdf.k)} {_roughness(bsdf.alpha)}")
    elif isinstance(bsdf, model.Dielectric):
        yield _named(name, "dielectric", f'"float eta" [ {bsdf.ior!r} ] {_roughness(bsdf.alpha)}')
    elif isinstance(bsdf, model.ThinDielectric):
        yield _named(name, "thindielectric", f'"float eta" [ {bsdf.ior!r} ]')
    elif isinstance(bsdf, model.Diffuse):
        yield from _diffuse(name, bsdf.reflectance, beside)
    elif isinstance(bsdf, model.Null):
        yield _named(name, "interface", "")
    else:
        assert isinstance(bsdf, model.Mixture)
        yield from _mixture(name, bsdf, beside)


def _roughness(alpha: Any) -> str:
    return f'"float roughness" [ {alpha[0]!r} ] "bool remaproughness" [ false ]'


def _diffuse(name: str, reflectance: Any, beside: Beside) -> Iterator[str]:
    if isinstance(reflectance, model.ImageTexture):
        yield _image(f"{name}_map", reflectance, beside)
        yield _named(name, "diffuse", f'"texture reflectance" [ "{name}_map" ]')
    else:
        yield _named(name, "diffuse", _rgb("reflectance", reflectance))


def _image(name: str, texture: model.ImageTexture, beside: Beside) -> str:
    """An image of which pbrt turns v over: there the first row has the largest."""
    file = beside.image(name, texture.pixels)["filename"]
    how = f'"string filter" [ "{"bilinear" if texture.filter == "bilinear" else "point"}" ] "string wrap" [ "{texture.wrap}" ]'
    u, _, across, _, v, down = texture.to_uv
    placing = {"uscale": u, "udelta": across, "vscale": -v, "vdelta": 1.0 - down}
    placed = " ".join(f'"float {key}" [ {float(value)!r} ]' for key, value in placing.items())
    return f'Texture "{name}" "spectrum" "imagemap" "string filename" [ "{file}" ] {how} {placed}'


def _mixture(name: str, lobes: Any, beside: Beside) -> Iterator[str]:
    share = mirror_share(lobes)
    if max(lobes.kt) > 0.0:
        yield _named(name, "dielectric", f'"float eta" [ {lobes.ior!r} ]')
    elif share == 0.0:
        yield from _diffuse(name, lobes.kd, beside)
    elif share == 1.0:
        yield _named(name, "conductor", _rgb("reflectance", lobes.ks))
    else:
        yield _named(f"{name}_kd", "diffuse", _rgb("reflectance", np.divide(lobes.kd, 1.0 - share)))
        yield _named(f"{name}_ks", "conductor", _rgb("reflectance", np.divide(lobes.ks, share)))
        yield _named(name, "mix", f'"string materials" [ "{name}_kd" "{name}_ks" ] "float amount" [ {share!r} ]')


def _named(name: str, kind: str, parameters: str) -> str:
    return f'MakeNamedMaterial "{name}" "string type" [ "{kind}" ] {parameters}'.rstrip()


def _shape(scene: model.Scene, shape: Single, beside: Beside) -> Iterator[str]:
    if isinstance(shape, model.Plane):
        corners, faces = squares(shape, extent(scene) * PLANE_EXTENTS)
        indices = " ".join(map(str, faces.ravel()))
        body = f'Shape "trianglemesh" "point3 P" [ {numbers(corners.ravel())} ] "integer indices" [ {indices} ]'
        yield from _dressed(scene, shape, shape.material, [body])
    elif isinstance(shape, model.Disk):
        columns = numbers(facing(shape.center, shape.normal, 1.0).T.ravel())
        body = [f"ConcatTransform [ {columns} ]", f'Shape "disk" "float radius" [ {shape.radius!r} ]']
        yield from _dressed(scene, shape, shape.material, body)
    elif isinstance(shape, model.Cylinder):
        axis = np.subtract(shape.p1, shape.p0)
        length = float(np.linalg.norm(axis))
        columns = numbers(facing(shape.p0, axis / length, 1.0).T.ravel())
        ends = f'"float zmin" [ 0 ] "float zmax" [ {length!r} ]'
        body = [f"ConcatTransform [ {columns} ]", f'Shape "cylinder" "float radius" [ {shape.radius!r} ] {ends}']
        yield from _dressed(scene, shape, shape.material, body)
    elif isinstance(shape, model.Triangle):
        corners = numbers((*shape.a, *shape.b, *shape.c))
        uvs = numbers(OWN_UVS.ravel())
        body = f'Shape "trianglemesh" "point3 P" [ {corners} ] "point2 uv" [ {uvs} ] "integer indices" [ 0 1 2 ]'
        yield from _dressed(scene, shape, shape.material, [body])
    elif isinstance(shape, model.Mesh):
        for piece in pieces(shape):
            placed = with_uvs(piece) if scene.materials[piece.material].uses_uvs else piece._replace(uvs=None)
            file = beside.mesh(shape.name, placed.vertices, placed.faces, placed.normals, placed.uvs)
            yield from _dressed(scene, shape, piece.material, [f'Shape "plymesh" "string filename" [ "{file}" ]'])
    elif (spheres := as_spheres(shape)) is not None:
        for center, radius in zip(spheres.centers, spheres.radii, strict=True):
            body = [f"Translate {numbers(center)}", f'Shape "sphere" "float radius" [ {float(radius)!r} ]']
            yield from _dressed(scene, shape, shape.material, body)


def _dressed(scene: model.Scene, shape: Single, index: int, body: list[str]) -> Iterator[str]:
    """A shape's `body` with the material `index`, light, and media."""
    material = scene.materials[index]
    yield "AttributeBegin"
    yield f'  NamedMaterial "material_{index}"'
    if material.emits:
        sides = "true" if material.two_sided else "false"
        yield f'  AreaLightSource "diffuse" {_rgb("L", material.mean_emission)} "bool twosided" [ {sides} ]'
    if shape.is_boundary:
        yield f"  {_between(shape.interior, shape.exterior)}"
    yield from (f"  {line}" for line in body)
    yield "AttributeEnd"


def _rgb(name: str, values: Any) -> str:
    return f'"rgb {name}" [ {numbers(values)} ]'
