"""Reports of the results that lie in the repository, and the chapter about them, as pages of the site: reports/NAME.html.

A page links to them by a mark of `MARKS`, which is filled in the site alone, as every mark without an end is.
"""

import os
import shutil
import tempfile
from functools import partial
from pathlib import Path

from docs._ext.reference import MAKERS, MARK
from harness.report import write_derived
from harness.store import events_file

RESULTS = Path(__file__).resolve().parents[2] / "results"
REPORTS = {
    "baseline": "raybench's engines, accelerators, precisions and threads on small and large scenes (`configs/engines.yaml`)",
    "renderers": "raybench's engines, Mitsuba 3, LuxCoreRender and Cycles (`configs/renderers.yaml`)",
}
"""Folder of `results/` -> what it compares. A folder that is not there has no page."""
CHAPTER = RESULTS / "dissertation" / "chapter" / "chapter.html"
PAGES = REPORTS | {
    "chapter": "accelerators, shaders, samplers and threads on the dissertation's scenes (`configs/dissertation.yaml`)"
}


def links(*names: str) -> str:
    """A list of the reports (by default of all), as pages beside the one that shows it."""
    there = [name for name in names or PAGES if (CHAPTER.exists() if name == "chapter" else events_file(RESULTS / name))]
    lines = [f'<li><a href="reports/{name}.html">{name}</a>: {_html(PAGES[name])}</li>' for name in there]
    return "\n".join(["```{raw} html", "<ul>", *lines, "</ul>", "```"])


def _html(words: str) -> str:
    before, code, after = words.split("`")
    return f"{before}<code>{code}</code>{after}"


def write(app, exception) -> None:
    """Writes the pages, after a build without an error. Files of plots, which they do not show, are written only if
    RAYBENCH_PLOTS is set."""
    if exception is not None or app.builder.format != "html":
        return
    os.environ.setdefault("RAYBENCH_PLOTS", "none")
    target = Path(app.outdir) / "reports"
    target.mkdir(exist_ok=True)
    for name in REPORTS:
        events = events_file(RESULTS / name)
        if events:
            _write(RESULTS / name, target / f"{name}.html")
    if CHAPTER.exists():
        shutil.copyfile(CHAPTER, target / "chapter.html")


def _write(folder: Path, page: Path) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        copy = shutil.copytree(folder, Path(scratch, folder.name), ignore=shutil.ignore_patterns("plots", "tables"))
        shutil.copyfile(write_derived(copy), page)


MARKS = MAKERS | {"reports": links, "report of the race": partial(links, "renderers"), "chapter": partial(links, "chapter")}


def fill(app, page, source) -> None:
    """Fills the marks of a page that have no end."""
    source[0] = MARK.sub(lambda mark: mark[0] if mark[3] else MARKS[mark[2]]() + "\n", source[0])


def setup(app):
    app.connect("source-read", fill)
    app.connect("build-finished", write)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
