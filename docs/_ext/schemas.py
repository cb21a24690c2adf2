"""The keys of experiments and scenes, from their JSON schemas: values, defaults and meaning."""

import json

from docs._ext.markdown import code, paragraphs, plain, table
from engines.scene import scene_schema
from harness.config import experiment_schema
from harness.config.settings import SETTINGS

INSTEAD = "Instead of the keys above. "
LARGE = 2**31
"""Upper bounds from here on are left out."""


def experiment() -> str:
    """A table for the top level, one for settings, and one a section."""
    schema = experiment_schema()
    keys = schema["properties"]
    sections = {key: each for key, each in keys.items() if key not in ("matrix", "zip") and _inside(each)}
    top = {key: each for key, each in keys.items() if key not in SETTINGS}
    parts = ["## Top level", _keys({**schema, "properties": top})]
    settings = {key: keys[key] for key in SETTINGS}
    parts += ["## Settings", "At the top level for all cells, in `matrix` and `zip` as lists, in filters as conditions."]
    parts += [_keys({**schema, "properties": settings})]
    for name, each in sections.items():
        if name not in ("exclude", "include"):
            parts += [f"## {name}", plain(each["description"]), _keys(each.get("items", each))]
    return paragraphs(parts)


def scene() -> str:
    """A table for the file, and one for every kind of camera, texture, material, shape and light, and for media."""
    keys = scene_schema()["properties"]
    parts = ["## The file", _keys(scene_schema()), "## Cameras"]
    for camera in keys["camera"]["anyOf"]:
        parts += _kind(camera["properties"]["type"].get("const", "module:attribute"), camera, leave="type")
    parts += ["## Textures", "Each is `NAME: {...}`, with the keys of one of these kinds."]
    for body in keys["textures"]["additionalProperties"]["anyOf"]:
        parts += _kind(next(iter(body["properties"])), body)
        parts += [_keys(each) for each in body["properties"].values() if _inside(each)]
    material = keys["materials"]["additionalProperties"]
    parts += ["## Materials", "Each is `NAME: {...}`.", _keys(material)]
    for kind, body in material["properties"].items():
        if "properties" in body and kind != "plugin":
            parts += _kind(kind, body)
    parts += ["## Shapes", "Each is `{KIND: {...}, material: NAME}`, with one of these kinds."]
    shapes = dict(_kinds(keys["shapes"]))
    procedural = shapes.pop("procedural")["anyOf"]
    for kind, body in shapes.items():
        parts += _kind(kind, body)
    parts += ["## Procedural shapes", "Each is `{procedural: {name: NAME, ...}, material: NAME}`."]
    for body in procedural:
        parts += _kind(body["properties"]["name"]["const"], body, leave="name")
    parts += ["## Lights", "Each is `{KIND: {...}}`, with one of these kinds. Shapes whose material emits are lights, too."]
    for kind, body in _kinds(keys["lights"]):
        parts += _kind(kind, body)
    medium = keys["media"]["additionalProperties"]
    return paragraphs([*parts, "## Media", "Each is `NAME: {...}`.", plain(medium["description"]), _keys(medium)])


def _kind(name: str, body, leave: str = "") -> list[str]:
    """The section of a kind: what it is, and its keys."""
    return [f"### {name}", plain(body["description"].removeprefix(INSTEAD)), _keys(body, leave)]


def _kinds(schema):
    """Kind and body of shapes or lights."""
    for each in schema["items"]["anyOf"]:
        kind = next(iter(each["properties"]))
        yield kind, each["properties"][kind]


def _inside(schema) -> bool:
    return "properties" in schema or "properties" in schema.get("items", {})


def _keys(schema, leave: str = "") -> str:
    rows = []
    for key, each in schema["properties"].items():
        if key != leave:
            default = code(json.dumps(each["default"])) if "default" in each else ""
            default = "required" if key in schema.get("required", ()) else default.replace('"', "")
            default = _other_ways(schema, key) or default
            rows.append((code(key), plain(_values(each)), default, plain(each["description"])))
    return table(("Key", "Values", "Default", "Meaning"), rows) if rows else ""


def _other_ways(schema, key: str) -> str:
    """The keys of which a file gives one group, where `key` belongs to a group."""
    ways = [way["required"] for way in schema.get("oneOf", ())]
    others = [" and ".join(map(code, way)) for way in ways if key not in way]
    return f"required, or {' or '.join(others)}" if len(others) < len(ways) else ""


def _values(schema) -> str:
    """What may be written, in words."""
    if "title" in schema:
        return schema["title"]
    if "const" in schema:
        return json.dumps(schema["const"])
    if "enum" in schema:
        return ", ".join("null" if each is None else str(each) for each in schema["enum"])
    choices = [] if "properties" in schema else [_values(each) for each in schema.get("anyOf") or schema.get("oneOf") or ()]
    for count in ("two", "three"):
        if len(choices) > 1 and choices[1] == f"{count} of: {choices[0]}":
            choices[:2] = [f"{choices[0]}, or {count}"]
    if choices:
        return " or ".join(dict.fromkeys(choices))
    kind = schema.get("type", "")
    kinds = [each for each in ([kind] if isinstance(kind, str) else kind) if each != "null"]
    if "array" in kinds:
        return _list(schema)
    if "object" in kinds:
        return "a mapping"
    if "string" in kinds:
        pattern = schema.get("pattern", "")
        named = "module:attribute" if pattern == ":" else "module:attribute or a .yaml file" if "ya?ml" in pattern else "text"
        unit = "a time with its unit, as 20s, 5m" if "ms|s" in pattern else "a size with its unit, as 8 GiB"
        return unit if "ms|s" in pattern or "GiB" in pattern else named
    return f"{'true or false' if 'boolean' in kinds else kinds[0] if kinds else 'any'}{_range(schema)}"


def _list(schema) -> str:
    item = schema.get("items", {})
    count = {2: "two", 3: "three"}.get(schema.get("maxItems", 0))
    if "object" in item.get("type", "") or ("anyOf" in item and not count) or not item:
        return "a list of mappings"
    return f"{count} of: {_values(item)}" if count else f"a list of {_values(item)}"


def _range(schema) -> str:
    low, high = (schema.get(key, schema.get(f"exclusive{key.capitalize()}")) for key in ("minimum", "maximum"))
    high = None if high is not None and high >= LARGE else high
    if low is not None and high is not None:
        return f" in {'[' if 'minimum' in schema else '('}{_short(low)}, {_short(high)}{']' if 'maximum' in schema else ')'}"
    return "" if low is None else f" {'≥' if 'minimum' in schema else '>'} {_short(low)}"


def _short(number) -> str:
    return str(int(number) if number == int(number) else number)
