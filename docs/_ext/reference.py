"""What pages have from the code. `python -m docs._ext.reference` (make reference) writes it between the marks of a page:

    <!-- generated: NAME -->
    what MAKERS[NAME] returns
    <!-- end -->

A mark without an end is filled in the site alone: see `reports`.
"""

import inspect
import os
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path
from unittest import mock

from docs._ext import batch, columns, command_line, library, names, schemas
from engines import registry
from engines.peers import external

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("docs/*.md"), *ROOT.glob("docs/[!_]*/**/*.md")])
MARK = re.compile(r"(<!-- generated: ([\w ]+) -->\n)((?:(?!<!-- ).)*<!-- end -->)?", re.DOTALL)
"""A mark, its name, and the text up to its end where it has one."""

MAKERS = {
    "command line": command_line.text,
    "experiment": schemas.experiment,
    "scene": schemas.scene,
    "renderer": partial(inspect.getdoc, external),
    "engines": names.engines,
    "shaders": names.shaders,
    "samplers": names.samplers,
    "accelerators": names.accelerators,
    "tone mappers": names.tone_mappers,
    "columns": columns.text,
    "library": library.index,
    "plugin functions": library.plugin_functions,
    "claims": library.claims,
    "batch": batch.fields,
}


def filled(page: str) -> str:
    """The text of a page, with what is between its marks made anew."""
    with _engines_of_the_repository():
        return MARK.sub(lambda mark: f"{mark[1]}\n{MAKERS[mark[2]]().strip()}\n\n<!-- end -->" if mark[3] else mark[0], page)


@contextmanager
def _engines_of_the_repository() -> Iterator[None]:
    """Within, the engines are those of pyproject.toml: neither plugins nor Pythons of engines change what is written."""
    named = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"][registry.GROUP]
    points = [EntryPoint(name, place, registry.GROUP) for name, place in named.items()]
    set_here = {name: value for name, value in os.environ.items() if not re.fullmatch(r"RAYBENCH_.*_PYTHON", name)}
    with mock.patch.object(registry, "entry_points", lambda group: points), mock.patch.dict(os.environ, set_here, clear=True):
        yield


if __name__ == "__main__":
    for path in PAGES:
        before = path.read_text("utf-8")
        if (after := filled(before)) != before:
            path.write_text(after, "utf-8")
            print(f"written: {path.relative_to(ROOT)}")
