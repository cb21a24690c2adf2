"""Engines, shaders, samplers, accelerators and tone mappers: what the registry and the tables of options say."""

import inspect
import json

from markdown import code, plain, table

from engines import engine, engine_names
from engines.choices import SAMPLERS, SHADERS
from engines.tonemap import TONE_MAPPERS


def engines() -> str:
    """Every engine that comes with raybench, by the first paragraph of its class."""
    rows = []
    for name in engine_names():
        made = engine(name)
        made = getattr(made, "local", made)  # of an engine in a process of its own, its own class
        rows.append((code(name), plain((inspect.getdoc(made) or "").split("\n\n")[0])))
    return table(("Engine", "What it is"), rows)


def shaders() -> str:
    return _options("Shader", SHADERS)


def samplers() -> str:
    parts = [_options("Sampler", SAMPLERS)]
    for name in engine_names():
        own = getattr(engine(name), "samplers", dict)()
        if own:
            parts += [f"\n{code(name)} alone has\n", _options("Sampler", own)]
    return "\n".join(parts)


def accelerators() -> str:
    parts = []
    for name in engine_names():
        parts += [f"### {name}\n", _options("Accelerator", engine(name).accelerators())]
    return "\n".join(parts)


def tone_mappers() -> str:
    return ", ".join(map(code, TONE_MAPPERS)) + "."


def _options(kind: str, choices) -> str:
    rows = []
    for name, options in choices.items():
        shown = code(name)
        for key, option in options.items():
            values = plain(option.check(object()) or "").replace("True, False", "true, false")
            rows.append((shown, code(key), code(json.dumps(option.default)), plain(option.meaning), values))
            shown = ""
        if not options:
            rows.append((shown, "none", "", "", ""))
    return table((kind, "Option", "Default", "Meaning", "Values"), rows)
