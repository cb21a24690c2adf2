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
    return _choices("Shader", SHADERS)


def samplers() -> str:
    return _choices("Sampler", SAMPLERS)


def accelerators() -> str:
    found = _by_engines("Accelerator", lambda made: made.accelerators())
    return paragraphs(f"### {', '.join(names)}\n\n{shown}" for shown, names in found.items())


def tone_mappers() -> str:
    return ", ".join(map(code, TONE_MAPPERS)) + "."


def _choices(kind: str, choices) -> str:
    """The choices of all engines, then those that single engines bring."""
    found = _by_engines(kind, lambda made: getattr(made, f"{kind.lower()}s", dict)())
    return paragraphs(
        [_options(kind, choices), *(f"Also in {', '.join(map(code, names))}:\n\n{shown}" for shown, names in found.items())]
    )


def _by_engines(kind: str, choices_of) -> dict[str, list[str]]:
    """Tables of what engines offer, each with the engines that offer it."""
    found: dict[str, list[str]] = {}
    for name in engine_names():
        if choices := choices_of(engine(name)):
            found.setdefault(_options(kind, choices), []).append(name)
    return found


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
