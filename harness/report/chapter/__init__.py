"""A chapter about results: `raybench report FOLDER... --chapter DIR`, or a text of one's own by a script.

Each results folder gives one section of tables and figures, in the order given; its experiment's name says which module makes
it (`WRITERS`, anything else is `chapter.experiment`). A writer is a function `section(analysis, plots) -> Section`, which saves
its figures with `figures.finished` and returns text as `chapter.document` has it. A script gives `write_chapter` a function
that makes another chapter of these sections: `template.filled` fills in a text, and `facts.Facts` says what results say, for
its numbers and for assertions on its claims. results/dissertation/chapter.py is one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from engines.errors import ConfigError
from harness.analysis import Analysis, analyse
from harness.report.chapter import dahlquist, experiment
from harness.report.chapter.document import Chapter, Section, html, latex, markdown
from harness.report.chapter.facts import Facts
from harness.report.chapter.template import filled
from harness.report.plots.figures import style
from harness.report.plots.style import FORMATS
from harness.store.atomic import write_text
from harness.store.results import load_results

TITLE = "Results"
WRITERS: dict[str, Callable[[Analysis, Path], Section]] = {"dahlquist": dahlquist.section}


Compose = Callable[[Sequence[Analysis], Sequence[Section]], Chapter]


def write_chapter(folders: Sequence[Path], target: Path, compose: Compose | None = None) -> list[Path]:
    """Writes chapter.md, chapter.tex, chapter.html and plots/ into `target`; returns the three texts.

    `compose` makes the chapter of the analyses and sections of the folders; without it the sections follow each other. Raises
    `ConfigError` where a folder has no results, and what `compose` raises.
    """
    if not folders:
        raise ConfigError("a chapter needs a results folder")
    analyses = [analyse(load_results(folder)) for folder in folders]
    plots = target / "plots"
    plots.mkdir(parents=True, exist_ok=True)
    for old in [path for suffix in FORMATS for path in plots.glob(f"*.{suffix}")]:
        old.unlink()
    with style():
        sections = [_section(analysis, plots) for analysis in analyses]
    chapter = compose(analyses, sections) if compose else Chapter(TITLE, sections)
    texts = {"chapter.md": markdown(chapter), "chapter.tex": latex(chapter), "chapter.html": html(chapter)}
    for name, text in texts.items():
        write_text(target / name, text)
    return [target / name for name in texts]


def _section(analysis: Analysis, plots: Path) -> Section:
    return WRITERS.get(analysis.results.config.name, experiment.section)(analysis, plots)
