"""The JSON schema of scene files: every key, its type, default and meaning. For editors, and for the documentation."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any

from engines.scene.cameras import DEFAULT_RESOLUTION, LARGEST_SIDE
from engines.scene.materials import KEYS as MATERIAL_KEYS
from engines.scene.metals import METALS
from engines.scene.model import BLACK, Material
from engines.scene.procedural import GENERATORS

_NUMBER = {"type": "number"}
_POSITIVE = {"type": "number", "exclusiveMinimum": 0}
_SWITCH = {"type": "boolean"}
_TEXT = {"type": "string"}
_POINT = {"type": "array", "items": _NUMBER, "minItems": 3, "maxItems": 3}
_ROWS = {"type": "array", "items": _POINT, "minItems": 1}


def scene_schema() -> dict[str, Any]:
    """A draft 2020-12 schema. It is no stricter than `load_scene`, which has the last word."""
    found = _object({
        "raybench_scene": ({"const": 1}, "Version of the format."),
        "name": (_TEXT, "A title. Default: the file's name."),
        "camera": (_camera(), "Where the scene is seen from."),
        "materials": ({"type": ["object", "null"], "additionalProperties": _material()}, "By names of your own."),
        "shapes": ({"type": ["array", "null"], "items": _shape()}, "What is there. One whose material emits is a light."),
        "lights": ({"type": ["array", "null"], "items": _light()}, "Lights that are no shapes."),
    }, ("raybench_scene", "camera"))  # fmt: skip
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "raybench scene", **found}


def _object(keys: dict[str, tuple[Any, ...]], required: tuple[str, ...] = ()) -> dict[str, Any]:
    """An object of keys that are (schema, meaning) or (schema, meaning, default)."""
    properties = {}
    for name, (schema, meaning, *default) in keys.items():
        properties[name] = {**schema, "description": meaning, **({"default": default[0]} if default else {})}
    found: dict[str, Any] = {"type": "object", "additionalProperties": False, "properties": properties}
    return {**found, "required": list(required)} if required else found


def _colour(high: float | None = None) -> dict[str, Any]:
    channel = {"type": "number", "minimum": 0, **({"maximum": high} if high else {})}
    return {"anyOf": [channel, {"type": "array", "items": channel, "minItems": 3, "maxItems": 3}]}


def _camera() -> dict[str, Any]:
    side = {"type": "integer", "minimum": 1, "maximum": LARGEST_SIDE}
    size = {"type": "array", "items": side, "minItems": 2, "maxItems": 2}
    frame = {
        "eye": (_POINT, "Where it stands, in metres."),
        "target": (_POINT, "What it looks at."),
        "up": (_POINT, "What is up in the image.", [0, 1, 0]),
        "resolution": (size, "[width, height] in pixels.", list(DEFAULT_RESOLUTION)),
    }
    angle = {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 180}
    pinhole = {
        **frame,
        "fov": (angle, "Full angle of view, in degrees.", 40),
        "fov_axis": ({"enum": ["x", "y"]}, "Whether the angle is that of the width or of the height.", "y"),
    }
    window = {**frame, "height": (_POSITIVE, "Of the window that it looks through, in metres.")}
    kinds = {
        "perspective": (pinhole, "A pinhole.", ("eye", "target")),
        "perspective_arctan": (pinhole, "MobileRT's camera, which bends lines a little.", ("eye", "target")),
        "orthographic": (window, "Parallel rays.", ("eye", "target", "height")),
    }
    known = []
    for kind, (keys, meaning, required) in kinds.items():
        typed = {"type": ({"const": kind}, "The kind of camera."), **keys}
        known.append({**_object(typed, ("type", *required)), "description": meaning})
    custom = {
        "type": "object", "required": ["type"], "properties": {"type": {"type": "string", "pattern": ":"}},
        "description": "A plugin, module:attribute, with options of its own; loaded with --allow-imports alone.",
    }  # fmt: skip
    return {"anyOf": [*known, custom]}


def _material() -> dict[str, Any]:
    share = _colour(1)
    keys = {
        "kd": (share, "Diffuse (Lambertian) albedo."),
        "ks": (share, "What a mirror reflects."),
        "kt": (share, "What is refracted into the shape."),
        "ior": (_POSITIVE, "Index of refraction, relative to the outside."),
        "fresnel": (_SWITCH, "Whether angles decide between mirror (ks) and refraction (kt), as in glass."),
        "conductor": (_conductor(), "A metal, instead of the keys above."),
        "emission": (_colour(), "Radiance of the front side, W/(sr m²)."),
        "two_sided": (_SWITCH, "Whether it emits from both sides."),
    }
    assert set(keys) == set(MATERIAL_KEYS)
    defaults = {field.name: field.default for field in fields(Material) if field.default is not MISSING}
    plain = {name: [0 if defaults[name] == BLACK else defaults[name]] if name in defaults else [] for name in keys}
    return _object({name: (*told, *plain[name]) for name, told in keys.items()})


def _conductor() -> dict[str, Any]:
    alpha = {"type": "number", "minimum": 0, "maximum": 1}
    return _object({
        "metal": ({"enum": [*METALS]}, "A metal by name; or eta and k; or reflectance."),
        "eta": (_colour(), "Index of refraction."),
        "k": (_colour(), "Extinction coefficient."),
        "reflectance": (_colour(1), "Of a perfect mirror."),
        "alpha": ({"anyOf": [alpha, {"type": "array", "items": alpha, "minItems": 2, "maxItems": 2}]}, "Roughness.", 0),
        "distribution": ({"enum": ["ggx"]}, "Of the microfacets.", "ggx"),
        "specular_reflectance": (_colour(1), "A factor.", 1),
    })


def _shape() -> dict[str, Any]:
    named = (_TEXT, "One of `materials`; a mesh from an OBJ file may leave it to the file.")
    mesh = {
        "file": (_TEXT, "An .obj, .ply or .stl file, relative to the scene's folder."),
        "vertices": (_ROWS, "Instead of a file: points, in metres."),
        "faces": (_ROWS, "Instead of a file: three indices of vertices each, counter-clockwise from the front."),
        "scale": ({"anyOf": [_POSITIVE, _POINT]}, "A factor, or one an axis.", 1),
        "translate": (_POINT, "Added after scaling, in metres.", [0, 0, 0]),
        "smooth": (_SWITCH, "Whether normals are interpolated: the file's, or else means of the faces'.", False),
    }
    kinds = {
        "sphere": _whole({"center": (_POINT, "In metres."), "radius": (_POSITIVE, "In metres.")}),
        "disk": _whole({
            "center": (_POINT, "In metres."), "normal": (_POINT, "To the front; of any length."),
            "radius": (_POSITIVE, "In metres."),
        }),
        "plane": _whole({"point": (_POINT, "Any point on it."), "normal": (_POINT, "To the front; of any length.")}),
        "triangle": _whole({key: (_POINT, "A corner; counter-clockwise from the front.") for key in "abc"}),
        "mesh": _object(mesh),
        "procedural": {"anyOf": [_procedural(name) for name in GENERATORS]},
    }
    told = (
        "A ball.", "A flat disk.",
        "Infinite. One that emits is no sampled light.", "One triangle.", "Many triangles.", "By name.",
    )  # fmt: skip
    bodies = {kind: (body, meaning) for (kind, body), meaning in zip(kinds.items(), told, strict=True)}
    return {"anyOf": [_object({kind: bodies[kind], "material": named}, (kind,)) for kind in kinds]}


def _whole(keys: dict[str, tuple[Any, ...]]) -> dict[str, Any]:
    return _object(keys, tuple(keys))


def _procedural(name: str) -> dict[str, Any]:
    generator = GENERATORS[name]
    keys: dict[str, tuple[Any, ...]] = {"name": ({"const": name}, "Which.")}
    for key, option in generator.options.items():
        keys[key] = ({}, option.meaning, *([] if option.default is ... else [option.default]))
    required = ("name", *(key for key, option in generator.options.items() if option.default is ...))
    return {**_object(keys, required), "description": " ".join((generator.make.__doc__ or "").split("\n\n")[0].split())}


def _light() -> dict[str, Any]:
    falloff = {"enum": ["inverse_square", "none"]}
    angle = {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 180}
    kinds = {
        "point": (_object({
            "position": (_POINT, "In metres."), "intensity": (_colour(), "W/sr."),
            "falloff": (falloff, "none acts everywhere as at a distance of 1 m.", "inverse_square"),
        }, ("position", "intensity")), "A point."),
        "spot": (_object({
            "position": (_POINT, "In metres."), "target": (_POINT, "A point on its axis."),
            "direction": (_POINT, "Instead of a target: of its axis, of any length."),
            "intensity": (_colour(), "W/sr, within beam_width of the axis."), "cutoff": (angle, "Half angle.", 20),
            "beam_width": (angle, "Half angle; default 3/4 of cutoff."),
        }, ("position", "intensity")), "A cone."),
        "directional": (_object({
            "direction": (_POINT, "In which its light travels; of any length."),
            "irradiance": (_colour(), "On a surface that faces it, W/m²."),
        }, ("direction", "irradiance")), "Parallel light, as from the sun."),
        "environment": (_object({
            "radiance": (_colour(), "W/(sr m²); with an image, a factor.", 1),
            "image": (_TEXT, "A latitude-longitude image, .exr or 8-bit, +y up, relative to the scene's folder."),
        }), "Light from infinity, all around. Needs radiance, image, or both."),
    }  # fmt: skip
    return {"anyOf": [_object({kind: told}, (kind,)) for kind, told in kinds.items()]}
