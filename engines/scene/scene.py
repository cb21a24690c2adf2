"""The scene as a whole: what engines get, and the keys of a scene file with its JSON schema. The format: docs/guides/scene.md.

Right-handed, metres, linear RGB. A `Triple` is three floats. Shapes name materials by index into
`Scene.materials`, and as cameras do media by index into `Scene.media`. The arrays are read-only float64/int32. Everything in a
scene has been checked by the loader (`engines.scene.load`): engines may rely on finite numbers, unit plane normals and valid
indices.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from engines.errors import SceneError
from engines.scene.bsdf import Bump, NormalMap
from engines.scene.bsdf_tree import members, own_textures
from engines.scene.cameras import CAMERA, Camera
from engines.scene.content import content_hash
from engines.scene.context import SceneReader
from engines.scene.lights import LIGHTS, Light
from engines.scene.materials import MATERIAL, Material
from engines.scene.media import MEDIUM, HomogeneousMedium
from engines.scene.mesh import Mesh
from engines.scene.shapes import GROUPS, SHAPE, Instance, Shape, emitting, materials_of, singles
from engines.scene.textures import TEXTURES, MeshAttribute
from engines.schema.keys import Given, Key, Record, by_name, list_of
from engines.schema.kinds import TEXT, ContextKind, integer
from engines.schema.yaml_file import Located

__all__ = ["Scene", "scene_schema"]

FORMAT = 1


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """All that is rendered. `content_hash` identifies what the pixels depend on (not names, comments or key order). `shader`
    is the shader that the file names, or that its media need, or None.

    `native` is the Mitsuba file that the scene came from (`engines.scene.native`). If its `refusal` says why it cannot be
    imported, the other fields have no meaning, and engines that do not take such files decline the scene with that text.
    """

    name: str
    camera: Camera
    materials: tuple[Material, ...]
    shapes: tuple[Shape, ...]
    lights: tuple[Light, ...]
    content_hash: str
    source: str = ""
    warnings: tuple[str, ...] = field(default=())
    shader: Mapping[str, Any] | None = None
    native: Any = None
    media: tuple[HomogeneousMedium, ...] = ()

    @property
    def identity(self) -> str:
        """What identifies a request for images of the scene: its content, and that of the file it came from."""
        if self.native is None:
            return self.content_hash
        return hashlib.sha256(f"{self.content_hash} {self.native.digest}".encode()).hexdigest()


def check_attributes(context: SceneReader, shapes: Sequence[Shape]) -> None:
    """Raises `SceneError` where `attributes_lack` finds something, in scenes that have such textures."""
    has_some = any(isinstance(texture, MeshAttribute) for texture in context.textures.values())
    if has_some and (lacks := attributes_lack(context.table.materials, shapes)):
        raise SceneError(f"{context.source}: {lacks}" if context.source else lacks)


def attributes_lack(materials: Sequence[Material], shapes: Sequence[Shape]) -> str | None:
    """One sentence on the first attribute that a shape does not have and its material shows, or that gives a normal."""
    shown = [material.attributes for material in materials]
    if not any(shown):
        return None
    for material in materials:
        tilts = (part for part in members(material.bsdf) if isinstance(part, Bump | NormalMap))
        if attribute := next((each for part in tilts for each in own_textures(part) if isinstance(each, MeshAttribute)), None):
            return f"material {material.name!r}: the attribute {attribute.name!r} is no height and gives no normals"
    for where, shape in singles(shapes):
        known = shape.attributes if isinstance(shape, Mesh) else {}
        for which in materials_of(shape):
            for name in sorted(shown[which] - known.keys()):
                who = f"the mesh {shape.name!r}" if isinstance(shape, Mesh) else f"a {type(shape).__name__.lower()}"
                return f"{where}: material {materials[which].name!r} shows the attribute {name!r}, which {who} does not have"
    return None


def _media(node: Located, context: SceneReader) -> tuple[HomogeneousMedium, ...]:
    """Media by names of the user's own, which the context learns before the camera and the shapes are read."""
    media = by_name(MEDIUM, "media").read(node, context)
    context.media += media
    return tuple(media.values())


def _materials(node: Located, context: SceneReader) -> None:
    """Materials by names of the user's own, which the context's table learns before the shapes are read."""
    if node.value is not None and not isinstance(node.value, dict):
        raise node.refuse("must be a mapping from names to materials")
    context.table.declare(node.value or {}, context)


def _scene(given: Given, context: SceneReader) -> Scene:
    camera, shapes, lights = given["camera"], given["shapes"] or [], given["lights"] or []
    media = given["media"] or ()
    shader = {"name": "volumetric_path_tracer"} if media else None  # others do not see media
    return assembled(context, given["name"] or context.name, camera, shapes, lights, shader, media)


def assembled(
    context: SceneReader,
    name: str,
    camera: Camera,
    shapes: Sequence[Shape],
    lights: Sequence[Light],
    shader: Mapping[str, Any] | None = None,
    media: tuple[HomogeneousMedium, ...] = (),
) -> Scene:
    """The scene of what has been read, with the materials and warnings of the context. Raises `SceneError`."""
    materials = context.table.materials
    check_attributes(context, shapes)
    return Scene(
        name=name,
        camera=camera,
        materials=tuple(materials),
        shapes=tuple(shapes),
        lights=tuple(lights),
        content_hash=content_hash(camera, materials, shapes, lights, media),
        source=context.source,
        warnings=tuple(scene_warnings(context, shapes, lights)),
        shader=shader,
        media=media,
    )


def scene_warnings(context: SceneReader, shapes: Sequence[Shape], lights: Sequence[Light]) -> list[str]:
    """A sentence each for what is legal but rarely meant."""
    warnings = list(dict.fromkeys(context.warnings))
    if not shapes:
        warnings.append("the scene is empty: it has no shapes")
    emit = (emitting(shape, context.table.materials) for shape in shapes if not isinstance(shape, Instance))
    if not lights and not any(emit):
        warnings.append("the scene has no light: images that need light will be black")
    if context.degenerate == 1:
        warnings.append("1 triangle has no area: it is never hit")
    elif context.degenerate:
        warnings.append(f"{context.degenerate} triangles have no area: they are never hit")
    return warnings


MEDIA = ContextKind(_media, by_name(MEDIUM, "media").schema())
MATERIALS = ContextKind(_materials, by_name(MATERIAL, "materials").schema())
SCENE = Record(
    "A scene.",
    {
        "raybench_scene": Key(integer(FORMAT, FORMAT), "Version of the format."),
        "name": Key(TEXT, "Title of the scene, by default the name of its file.", None),
        "media": Key(MEDIA, "Media by names of your own.", None),
        "camera": Key(CAMERA, "The camera."),
        "textures": Key(TEXTURES, "Textures by names of your own.", None),
        "materials": Key(MATERIALS, "Materials by names of your own.", None),
        "groups": Key(GROUPS, "Shapes that instances show, by names of your own: no planes, lights and instances.", None),
        "shapes": Key(list_of(SHAPE, "shapes"), "Shapes. One whose material emits is an area light.", None),
        "lights": Key(list_of(LIGHTS, "lights"), "Lights other than area lights.", None),
    },
    _scene,
)


def scene_schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of scene files: every key with its type, default, unit and meaning, for editors and
    for the documentation. It is no stricter than `load_scene`, which has the last word."""
    schema = {**SCENE.schema(), "title": "raybench scene"}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
