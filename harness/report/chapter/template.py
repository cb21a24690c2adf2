"""A chapter from a template: Markdown in which Jinja2 puts in values, and tables and figures stand by their names.

    On gears numba's tree is {{ speedup("gears", "numba bvh", "embree") }} times as fast as Embree.

    [table accelerators]

    [figure threads]

Tables and figures are those of the experiments' sections, each on a line of its own. Of Markdown there are headings,
paragraphs and lists.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError

from engines.errors import ConfigError, suggestion
from harness.report.chapter.document import Chapter, FigurePart, Listing, Paragraph, Part, Section, TablePart
from harness.report.chapter.texts import interval
from harness.report.tables.model import number_text
from harness.statistics import Estimate

BLOCK = re.compile(r"\[(table|figure) ([^\]]+)\]")
NO_NUMBER = number_text(float("nan"))


def filled(file: Path, values: Mapping[str, Any], sections: Sequence[Section]) -> Chapter:
    """The chapter of a template. `values` are what it may name: numbers, texts and functions.

    Raises `ConfigError`, with file and line, for a template that cannot be read, what it names and is not there, and a value
    that is no number.
    """
    environment = Environment(loader=FileSystemLoader(file.parent), undefined=StrictUndefined, finalize=_text)
    try:
        text = environment.get_template(file.name).render(values)
    except (OSError, TemplateError, ConfigError, TypeError, ValueError, ZeroDivisionError) as error:
        raise ConfigError(f"{file}{_line(error, file)}: {error}") from error
    parts = {_key(part): part for section in sections for part in _parts(section)}
    made = Chapter(file.stem, [])
    for block in re.split(r"\n\s*\n", text):
        if block.strip():
            _add(made, block.strip(), parts, file)
    return made


def _line(error: BaseException, file: Path) -> str:
    """The line of the template that an error comes from, as `:12`."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(file)]
    line = getattr(error, "lineno", None) or (lines[-1] if lines else None)
    return f":{line}" if line else ""


def _text(value: Any) -> str:
    """A value as a text has it: numbers with an interval where they have one."""
    if isinstance(value, Estimate):
        value = interval(value)
    elif isinstance(value, int) and not isinstance(value, bool):
        value = f"{value:,}"
    shown = number_text(value) if isinstance(value, float) else str(value)
    if NO_NUMBER in shown:
        raise ConfigError("the results have no number for it")
    return shown


def _add(made: Chapter, block: str, parts: Mapping[tuple[str, str], Part], file: Path) -> None:
    """Adds a heading, a list, a paragraph, a table or a figure to the end of the chapter."""
    heading = re.fullmatch(r"(#+) (.+)", block)
    if heading and len(heading[1]) == 1:
        made.title = heading[2]
        return
    if heading:
        inner = len(heading[1]) > 2 and made.sections
        (made.sections[-1].sections if inner else made.sections).append(Section(heading[2]))
        return
    if not made.sections:
        made.sections.append(Section("Introduction"))
    last = made.sections[-1].sections[-1] if made.sections[-1].sections else made.sections[-1]
    last.parts.append(_part(block, parts, file))


def _part(block: str, parts: Mapping[tuple[str, str], Part], file: Path) -> Part:
    named = BLOCK.fullmatch(block)
    if named:
        kind, name = named.groups()
        if (kind, name) not in parts:
            known = suggestion(name, [name for other, name in parts if other == kind])
            raise ConfigError(f"{file}: the results have no {kind} {name!r}: {known}")
        return parts[kind, name]
    if block.startswith("- "):
        return Listing([" ".join(item[2:].split()) for item in re.split(r"\n(?=- )", block)])
    return Paragraph([" ".join(block.split())])


def _key(part: Part) -> tuple[str, str]:
    if isinstance(part, TablePart):
        return "table", part.table.name
    return ("figure", part.plot.name) if isinstance(part, FigurePart) else ("", "")


def _parts(section: Section) -> Iterator[Part]:
    yield from section.parts
    for below in section.sections:
        yield from _parts(below)
