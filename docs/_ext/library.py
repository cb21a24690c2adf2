"""The index of the library, the functions of plugins that only a compiler can call, and the claims of conformance."""

import importlib
import inspect
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import engines.plugin
from docs._ext.markdown import code, paragraphs, summary, table
from engines.conformance import CLAIMS

ROOT = Path(engines.__file__).resolve().parents[1]
API = ROOT / "docs" / "reference" / "api"
MODULE = re.compile(r"automodule:: ([\w.]+)\n(?: +:members:(.*)\n)?")
FIRST = re.compile(r"(?<=[a-z)`]\.) (?=[A-Z`(])")
"""Between the sentences of a paragraph."""
PACKAGES = {"engines": "", "harness": "", "harness.verify": "read_results"}
"""Packages with public names, and which of their names are public; empty: all."""


def index() -> str:
    """A table of the packages' names, and one of those on each page of the API."""
    parts = ["## Packages", _names(PACKAGES.items())]
    for page in re.findall(r"^\w+$", (API / "index.md").read_text("utf-8"), re.MULTILINE):
        text = (API / f"{page}.md").read_text("utf-8")
        parts += [f"## {text[2:].splitlines()[0]}", f"With signatures and members: [{page}](api/{page}.md)."]
        parts += [_names(MODULE.findall(text))]
    return paragraphs(parts)


def plugin_functions() -> str:
    """Directives for what Sphinx takes for data: jitted functions and intrinsics."""
    named = {name: getattr(engines.plugin, name) for name in engines.plugin.__all__}
    found = [name for name, each in named.items() if not inspect.isclass(each) and not inspect.isroutine(each)]
    return "```{eval-rst}\n" + "\n".join(f".. autofunction:: engines.plugin.{name}" for name in found) + "\n```"


def claims() -> str:
    """What the conformance suite holds of every engine."""
    return table(("Claim", "What must hold"), [(code(claim.__name__), summary(claim)) for claim in CLAIMS])


def public(module, chosen: Iterable[str] = ()) -> Iterator[tuple[str, type]]:
    """Classes and functions of a module: those chosen, else those of `__all__`, else those that it defines."""
    defined = [name for name, found in vars(module).items() if getattr(found, "__module__", "") == module.__name__]
    for name in chosen or getattr(module, "__all__", defined):
        found = getattr(module, name)
        if not name.startswith("_") and callable(found) and found.__module__.startswith(("engines", "harness")):
            yield name, found


def _names(modules: Iterable[tuple[str, str]]) -> str:
    """Name, first sentence and file of what modules, with the names that a page chooses of each, offer."""
    rows = []
    for name, chosen in modules:
        for key, found in public(importlib.import_module(name), re.findall(r"\w+", chosen)):
            file = Path(sys.modules[found.__module__].__file__).resolve().relative_to(ROOT).as_posix()
            rows.append((code(f"{name}.{key}"), FIRST.split(summary(found))[0], f"[{file}](../../{file})"))
    return table(("Name", "What it is", "File"), rows)
