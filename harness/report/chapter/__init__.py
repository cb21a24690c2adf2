"""A chapter about results: `raybench report FOLDER... --chapter DIR`, with prose of one's own by `--prose FILE`.

Each results folder gives one section of tables and figures, in the order given; its experiment's name says which module makes
it (`WRITERS`, anything else is `chapter.experiment`). A writer is a function `section(analysis, plots) -> Section`, which saves
its figures with `figures.finished` and returns text as `chapter.document` has it. Prose chooses among those tables and
figures, and its claims are checked: `chapter.prose`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from engines.errors import ConfigError
from harness.analysis import Analysis, analyse
from harness.report.chapter import dahlquist, experiment
from harness.report.chapter.document import Chapter, Section, html, latex, markdown
from harness.report.plots.figures import style
from harness.report.plots.style import FORMATS
from harness.store.atomic import write_text
from harness.store.results import load_results

__all__ = ["write_chapter"]

TITLE = "Results"
WRITERS: dict[str, Callable[[Analysis, Path], Section]] = {"dahlquist": dahlquist.section}


def write_chapter(folders: Sequence[Path], target: Path, prose: Path | None = None) -> list[Path]:
    """Writes chapter.md, chapter.tex, chapter.html and plots/ into `target`; returns the three texts.

    Raises ConfigError where a folder has no results, and where `prose` claims what they do not say.
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
    chapter = Chapter(TITLE, sections)
    if prose is not None:
        from harness.report.chapter.prose import chapter as written

        chapter = written(prose, analyses, sections)
    texts = {"chapter.md": markdown(chapter), "chapter.tex": latex(chapter), "chapter.html": html(chapter)}
    for name, text in texts.items():
        write_text(target / name, text)
    return [target / name for name in texts]


def _section(analysis: Analysis, plots: Path) -> Section:
    return WRITERS.get(analysis.results.config.name, experiment.section)(analysis, plots)
