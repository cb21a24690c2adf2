"""A chapter as plain parts, and the three texts made of them: Markdown, LaTeX and HTML.

A section is written once, as `Paragraph`, `Listing`, `TablePart` and `FigurePart`. Words are plain text: what a
language needs escaped is escaped here. Figures lie as files beside the texts; the HTML one holds them and needs no other
file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

from harness.report.plots import Picture
from harness.report.tables import Table, cell_text
from harness.report.tables.model import latex_escape, latex_text, markdown_text


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Sentences; each is whole, with its full stop."""

    sentences: Sequence[str]


@dataclass(frozen=True, slots=True)
class Listing:
    """One sentence an item."""

    items: Sequence[str]


@dataclass(frozen=True, slots=True)
class TablePart:
    table: Table


@dataclass(frozen=True, slots=True)
class FigurePart:
    """A plot already saved as `plots/<name>.{svg,png,pdf}` beside the chapter."""

    plot: Picture


Part = Paragraph | Listing | TablePart | FigurePart


@dataclass
class Section:
    """A heading with its parts and, one level below, further sections."""

    title: str
    parts: list[Part] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)


@dataclass
class Chapter:
    title: str
    sections: list[Section]


def markdown(chapter: Chapter) -> str:
    """GitHub's Markdown; figures are the png files."""
    return "\n".join([f"# {chapter.title}", *(_markdown_section(section, 2) for section in chapter.sections)])


def _markdown_section(section: Section, level: int) -> str:
    blocks = [f"\n{'#' * level} {section.title}\n", *(_markdown_part(part, level + 1) for part in section.parts)]
    return "\n".join([*blocks, *(_markdown_section(below, level + 1) for below in section.sections)])


def _markdown_part(part: Part, level: int) -> str:
    if isinstance(part, Paragraph):
        return _markdown_escape(" ".join(part.sentences)) + "\n"
    if isinstance(part, Listing):
        return "\n".join(f"- {_markdown_escape(item)}" for item in part.items) + "\n"
    if isinstance(part, TablePart):
        return "#" * (level - 3) + markdown_text(part.table)
    return f"![{part.plot.description}](plots/{part.plot.name}.png)\n\n*{_markdown_escape(part.plot.title)}*\n"


def _markdown_escape(text: str) -> str:
    return "".join("\\" + letter if letter in "\\*_<`" else letter for letter in text)


_PREAMBLE = r"""\documentclass{report}
\usepackage[utf8]{inputenc}
\usepackage[T1]{fontenc}
\usepackage[margin=2.5cm]{geometry}
\usepackage{array,booktabs,graphicx,float}
\graphicspath{{plots/}}
\begin{document}
"""


_FITTING = r"\resizebox{\ifdim\width>\textwidth\textwidth\else\width\fi}"
"""What follows keeps its size, or shrinks to the width of the text."""
_PROSE = r">{\raggedright\arraybackslash}p{%.2f\textwidth}"
"""A column whose words wrap."""


def latex(chapter: Chapter) -> str:
    """A report of one chapter; figures are the pdf files."""
    body = "\n".join([f"\\chapter{{{latex_escape(chapter.title)}}}", *(_latex_section(s, 0) for s in chapter.sections)])
    return f"{_PREAMBLE}{body}\n\\end{{document}}\n"


def _latex_section(section: Section, level: int) -> str:
    head = f"\n\\{'sub' * level}section{{{latex_escape(section.title)}}}\n"
    parts = [_latex_part(part) for part in section.parts]
    return "\n".join([head, *parts, *(_latex_section(below, min(level + 1, 2)) for below in section.sections)])


def _latex_part(part: Part) -> str:
    if isinstance(part, Paragraph):
        return latex_escape(" ".join(part.sentences)) + "\n"
    if isinstance(part, Listing):
        items = "\n".join(f"\\item {latex_escape(item)}" for item in part.items)
        return f"\\begin{{itemize}}\n{items}\n\\end{{itemize}}\n"
    if isinstance(part, TablePart):
        floating = latex_text(part.table).replace("\\begin{table}", "\\begin{table}[H]\\centering")
        rest = len(part.table.columns) - 1
        if rest and all(column.kind == "text" for column in part.table.columns):
            return floating.replace("{l" + "l" * rest + "}", f"{{l*{{{rest}}}{{{_PROSE % (0.7 / rest)}}}}}")
        fitting = f"{_FITTING}{{!}}{{\\begin{{tabular}}"
        return floating.replace("\\begin{tabular}", fitting).replace("\\end{tabular}", "\\end{tabular}}")
    return (
        f"\\begin{{figure}}[H]\\centering\n\\includegraphics[width=\\textwidth]{{{part.plot.name}.pdf}}\n"
        f"\\caption{{{latex_escape(part.plot.title)}}}\n\\end{{figure}}\n"
    )


_STYLE = """
:root { color-scheme: light dark; --ink: #222; --faint: #777; --grid: #ccc; --paper: #fff; }
@media screen and (prefers-color-scheme: dark) {
  :root { --ink: #e6e6e6; --faint: #9a9a9a; --grid: #444; --paper: #16181b; }
}
body { font: 16px/1.55 Georgia, 'Times New Roman', serif; max-width: 70rem; margin: 2rem auto; padding: 0 1.2rem;
       color: var(--ink); background: var(--paper); }
h1, h2, h3, h4 { font-family: system-ui, sans-serif; line-height: 1.25; }
p, li { max-width: 52rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font: 12px/1.4 system-ui, sans-serif; font-variant-numeric: tabular-nums; }
th { border-top: 2px solid; border-bottom: 1px solid; }
td, th { padding: .2rem .4rem; text-align: right; white-space: nowrap; }
td.text, th.text { text-align: left; white-space: normal; }
tbody tr:last-child td { border-bottom: 2px solid; }
figure { margin: 1.2rem 0; }
figure img { width: 100%; min-width: 34rem; height: auto; background: #fff; }
figcaption { font: 13px/1.4 system-ui, sans-serif; max-width: 60rem; margin: .4rem 0; }
"""


def html(chapter: Chapter) -> str:
    """One page with the figures inside it."""
    body = "\n".join(_html_section(section, 2) for section in chapter.sections)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(chapter.title)}</title>'
        f"<style>{_STYLE}</style></head>\n<body><h1>{escape(chapter.title)}</h1>\n{body}\n</body></html>\n"
    )


def _html_section(section: Section, level: int) -> str:
    parts = [_html_part(part) for part in section.parts]
    below = [_html_section(inner, min(level + 1, 6)) for inner in section.sections]
    return "\n".join([f"<h{level}>{escape(section.title)}</h{level}>", *parts, *below])


def _html_part(part: Part) -> str:
    if isinstance(part, Paragraph):
        return f"<p>{escape(' '.join(part.sentences))}</p>"
    if isinstance(part, Listing):
        return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in part.items) + "</ul>"
    if isinstance(part, TablePart):
        return _html_table(part.table)
    from harness.report.html.assembly import svg_address

    alt = escape(f"{part.plot.title}. {part.plot.description}")
    drawing = f'<img src="{svg_address(part.plot.svg)}" alt="{alt}">'
    return f'<figure><div class="wide">{drawing}</div><figcaption>{escape(part.plot.title)}</figcaption></figure>'


def _html_table(table: Table) -> str:
    kinds = ["text" if column.kind == "text" else "number" for column in table.columns]
    head = "".join(
        f'<th class="{kind}" title="{escape(column.meaning)}">{escape(column.heading)}</th>'
        for kind, column in zip(kinds, table.columns, strict=True)
    )
    rows = [
        "".join(
            f'<td class="{kind}">{escape(cell_text(column, row.get(column.name)))}</td>'
            for kind, column in zip(kinds, table.columns, strict=True)
        )
        for row in table.rows
    ]
    lines = "".join(f"<tr>{row}</tr>\n" for row in rows)
    caption = f"<figcaption><b>{escape(table.title)}.</b> {escape(table.note)}</figcaption>"
    body = f"<table><thead><tr>{head}</tr></thead>\n<tbody>{lines}</tbody></table>"
    return f'<figure>{caption}<div class="wide" tabindex="0">{body}</div></figure>'
