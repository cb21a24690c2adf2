"""Plugins of a scene file: code of the user's, named `module:attribute` and imported only where that is allowed."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from engines.errors import UnknownName, suggestion
from engines.imports import imported
from engines.schema import fields
from engines.schema.yaml_file import Located


def load_plugin(named: Located, what: str, allow_imports: bool, folder: Path, known: Collection[str] = ()) -> Any:
    """The plugin that a scene in `folder` names here; from Python `named` may hold the plugin itself. A class is called.

    `known` are the names of what is built in, for the message about a name without a colon.
    """
    plugin: Any = named.value
    if isinstance(plugin, (dict, list, bool, int, float, bytes, type(None))):
        raise named.refuse("must be text")
    if isinstance(plugin, str):
        if ":" not in plugin:
            built_in = f"unknown {what}: {suggestion(plugin, known)}, or" if known else "must be"
            raise named.refuse(f"{built_in} module:attribute")
        if not allow_imports:
            raise named.refuse("imports code: pass --allow-imports (from Python: allow_imports=True) to permit it")
        plugin = _load_attribute(named, folder)
    return plugin() if isinstance(plugin, type) else plugin


def _load_attribute(named: Located, folder: Path) -> Any:
    try:
        return imported(named.value, folder)
    except (Exception, SystemExit) as problem:
        raise named.refuse(f"cannot be imported: {problem}") from problem


@dataclass(frozen=True, slots=True)
class PluginKind:
    """A light or BSDF plugin with its options: `make(plugin, options)` is the part of the scene."""

    what: str
    meaning: str
    make: Callable[[Any, Mapping[str, Any]], Any]

    def read(self, node: Located, context: Any = None) -> Any:
        """The part. The context is a `SceneReader`."""
        if not isinstance(node.value, dict):
            raise node.refuse(f"must be a mapping with a type, module:attribute, and the options of that {self.what}")
        if "type" not in node.value:
            raise node.refuse_key("type", "is missing: module:attribute of a plugin is expected")
        named = node.value["type"]
        plugin = load_plugin(named, self.what, context.allow_imports, context.place.folder)
        if not isinstance(getattr(plugin, "options", None), Mapping):
            raise named.refuse(f"is no {self.what} plugin: it has no `options`, a mapping from names to defaults")
        return self.make(plugin, read_options(node, plugin, ("type",)))

    def schema(self) -> dict[str, Any]:
        """Any mapping with a type."""
        named = {"type": "string", "pattern": ":", "description": "The plugin. Its options stand beside this key."}
        return {"type": "object", "required": ["type"], "properties": {"type": named}, "description": self.meaning}


def all_options(what: str, plugin: Any, options: Mapping[str, Any]) -> dict[str, Any]:
    """A float or three for every option of a plugin, in its order: that of `options`, or the default.

    Raises `UnknownName` for options that the plugin does not have; `what` it is stands in the message.
    """
    known = plugin.options
    for name in options:
        if name not in known:
            raise UnknownName(f"option of the {what} {plugin.name!r}", name, known)
    values = {name: options.get(name, default) for name, default in known.items()}
    return {name: tuple(map(float, x)) if np.ndim(x) else float(x) for name, x in values.items()}


def read_options(node: Located, plugin: Any, others: Collection[str]) -> dict[str, Any]:
    """The options of a plugin that a mapping has, beside the keys `others`."""
    known, options = plugin.options, {}
    for key, child in node.value.items():
        if key not in others:
            if key not in known:
                raise node.unknown_key(key, (*others, *known))
            options[key] = _option(child, known[key])
    return options


def _option(node: Located, default: Any) -> Any:
    """A number; three where the default is three, for which one number may stand."""
    if not isinstance(default, tuple | list):
        return fields.number(node)
    return (fields.number(node),) * 3 if isinstance(node.value, int | float) else fields.triple(node)
