"""Engines, shaders, samplers, accelerators and tone mappers: what the registry and the tables of options say."""

import json

from docs._ext.markdown import code, paragraphs, plain, summary, table
from engines import engine, engine_names
from engines.choices import SAMPLERS, SHADERS
from engines.tonemap import TONE_MAPPERS


def engines() -> str:
    """Every engine that comes with raybench, by the first paragraph of its class."""
    rows = []
    for name in engine_names():
        made = engine(name)
        made = getattr(made, "local", made)  # of an engine in a process of its own, its own class
        rows.append((code(name), summary(made)))
    return table(("Engine", "What it is"), rows)


def shaders() -> str:
    return paragraphs([_options("Shader", SHADERS), _of_engines("Shader", "Also in {}:")])


def samplers() -> str:
    return paragraphs([_options("Sampler", SAMPLERS), _of_engines("Sampler", "Also in {}:")])


def accelerators() -> str:
    return _of_engines("Accelerator", "### {}")


def tone_mappers() -> str:
    return ", ".join(map(code, TONE_MAPPERS)) + "."


def _of_engines(kind: str, head: str) -> str:
    """What single engines bring: a table for those that bring the same, below their names."""
    found: dict[str, list[str]] = {}
    for name in engine_names():
        if choices := getattr(engine(name), f"{kind.lower()}s", dict)():
            found.setdefault(_options(kind, choices), []).append(name)
    return paragraphs(f"{head.format(', '.join(names))}\n\n{shown}" for shown, names in found.items())


def _options(kind: str, choices) -> str:
    rows = []
    for name, options in choices.items():
        shown = code(name)
        for key, option in options.items():
            values = plain(option.check(object()) or "").replace("True", "true").replace("False", "false")
            rows.append((shown, code(key), code(json.dumps(option.default)), plain(option.meaning), values))
            shown = ""
        if not options:
            rows.append((shown, "no option", "", "", ""))
    return table((kind, "Option", "Default", "Meaning", "Values"), rows)
