"""Pages whose text is in the code: a line `<!-- generated: NAME -->` of a page becomes what `MAKERS[NAME]` returns."""

import re
from functools import partial
from pathlib import Path

import batch
import columns
import command_line
import library
import names
import reports
import schemas

MAKERS = {
    "batch": batch.fields,
    "command line": command_line.text,
    "columns": columns.text,
    "experiment": schemas.experiment,
    "scene": schemas.scene,
    "library": library.names,
    "claims": library.claims,
    "plugin functions": library.plugin_functions,
    "engines": names.engines,
    "shaders": names.shaders,
    "samplers": names.samplers,
    "accelerators": names.accelerators,
    "tone mappers": names.tone_mappers,
    "reports": reports.links,
    "report of the race": partial(reports.links, "renderers"),
    "chapter": partial(reports.links, "chapter"),
}

MARK = re.compile(r"<!-- generated: (.*?) -->")


def fill(app, page, source):
    """Replaces the marks of a page."""
    source[0] = MARK.sub(lambda mark: MAKERS[mark[1]](), source[0])


def outdated(app, env, added, changed, removed):
    """Pages with marks, which are read anew in each build: Sphinx does not see that the code has changed."""
    return [page for page in env.found_docs if MARK.search(Path(env.doc2path(page)).read_text("utf-8"))]


def setup(app):
    app.connect("env-get-outdated", outdated)
    app.connect("source-read", fill)
    app.connect("build-finished", reports.write)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
