"""The text of a table as csv, Markdown, LaTeX and HTML, and that of its cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Any

from harness.analysis.columns import Column, Table

INFINITE_AND_ZERO = {"estimate": ("not reached", "0"), "ratio": ("baseline never", "never"), "break_even": ("never", "at once")}
"""Kinds with an interval: the words for infinity and for zero."""
ROUNDING = 1e-9
"""A share below this says nothing but that numbers were rounded: texts give it as a bound."""


def csv_text(table: Table) -> str:
    """Full precision, one line of headings; empty where nothing is known, `inf` where a target was not reached."""
    return table.frame.to_csv(index=False, lineterminator="\n")


def markdown_text(table: Table) -> str:
    """A GitHub table under its title and note."""
    return f"### {table.title}\n\n{table.note}\n\n{markdown_rows(table)}"


def markdown_rows(table: Table) -> str:
    """A GitHub table alone."""
    lines = ["| " + " | ".join(column.heading for column in table.columns) + " |"]
    lines.append("|" + "|".join(" --- " if column.kind == "text" else " ---: " for column in table.columns) + "|")
    for row in table.rows:
        cells = [cell_text(column, row.get(column.name)) for column in table.columns]
        lines.append("| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def latex_text(table: Table) -> str:
    """A booktabs tabular in a table float; needs \\usepackage{booktabs}."""
    lines = [
        "\\begin{table}",
        f"\\caption{{{latex_escape(table.title)}. {latex_escape(table.note)}}}",
        f"\\label{{tab:{table.name.replace('_', '-')}}}",
        latex_tabular(table, "\\toprule", "\\midrule", "\\bottomrule") + "\\end{table}",
    ]
    return "\n".join(lines) + "\n"


def latex_tabular(table: Table, top: str = "\\hline", middle: str = "\\hline", bottom: str = "\\hline") -> str:
    """A tabular alone, with its rules; by default it needs no package."""
    shape = "".join("l" if column.kind == "text" else "r" for column in table.columns)
    rows = [[cell_text(column, row.get(column.name)) for column in table.columns] for row in table.rows]
    head, *body = (
        " & ".join(map(latex_escape, cells)) + " \\\\" for cells in ([column.heading for column in table.columns], *rows)
    )
    return "\n".join([f"\\begin{{tabular}}{{{shape}}}", top, head, middle, *body, bottom, "\\end{tabular}"]) + "\n"


def html_rows(table: Table) -> str:
    """An HTML table under its note as a caption, without styles; a cell that shows nothing has the reason as its tooltip."""
    lines = ["<table>", f"<caption>{escape(table.note)}</caption>"]
    lines.append("<tr>" + "".join(f'<th scope="col">{escape(column.heading)}</th>' for column in table.columns) + "</tr>")
    for row in table.rows:
        first, *rest = (escape(cell_text(column, row.get(column.name))) for column in table.columns)
        whys = (row.get("blank", {}).get(column.name) for column in table.columns[1:])
        cells = (
            f'<td title="{escape(why)}">{cell}</td>' if why else f"<td>{cell}</td>"
            for cell, why in zip(rest, whys, strict=True)
        )
        lines.append(f'<tr><th scope="row">{first}</th>' + "".join(cells) + "</tr>")
    return "\n".join([*lines, "</table>"]) + "\n"


def cell_text(column: Column, value: Any) -> str:
    """What a reader sees in a cell; `–` for what is not known."""
    if value is None or value == "":
        return "–"
    if column.kind in INFINITE_AND_ZERO:
        return estimate_text(value, *INFINITE_AND_ZERO[column.kind])
    if column.kind == "exact":
        return f"{value:g}"
    if column.kind == "percent":
        if 0 < value < ROUNDING:
            return f"< {number_text(100 * ROUNDING)} %"
        return "–" if math.isnan(value) else f"{number_text(100 * value)} %"
    if column.kind == "number":
        return number_text(value)
    return str(value)


def number_text(value: float) -> str:
    """Three significant digits, thousands as 12.3k, millions as 4.56M, tiny ones as 1.2e-05."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    size = abs(value)
    for limit, divisor, suffix in ((999.5e6, 1e9, "G"), (999.5e3, 1e6, "M"), (9995.0, 1e3, "k")):
        if size >= limit:
            return f"{_digits(value / divisor)}{suffix}"
    if size < 9995.0 and value == round(value):
        return str(round(value))
    return f"{value:.2e}" if size < 1e-3 else _digits(value)


def estimate_text(estimate: tuple[float, ...], infinite: str = "not reached", zero: str = "0") -> str:
    """`0.98 [0.95, 1.02]`; without an interval the value alone; `> 3.1` or `< 3.1` where that alone is known."""
    value, low, high = estimate[:3]
    if math.isnan(value):
        return "–"
    if low == 0 and value < math.inf and 0 < high < math.inf:
        return f"< {number_text(high)}"
    text = infinite if math.isinf(value) else zero if value == 0 else number_text(value)
    if math.isnan(low) or math.isnan(high) or low == high:
        return text
    if math.isinf(value):
        return f"> {number_text(low)}" if low > 0 else text
    closing = ")" if math.isinf(high) else "]"
    return f"{text} [{number_text(low)}, {number_text(high)}{closing}"


def reached_text(row: Any) -> str:
    """`5/5`, of a row of `Analysis.by_target`: seeds that reached the target; `5/5 ≤` says that some times are upper bounds."""
    return f"{row.reached}/{row.seeds}{' ≤' if row.at_first else ''}"


def some(names: Sequence[str], most: int) -> str:
    """The first names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def sort_value(value: Any) -> float | str:
    """What a column is sorted by: the value of an estimate; what is unknown or was not reached is infinite."""
    if isinstance(value, tuple):
        value = value[0]
    if isinstance(value, (int, float)):
        return math.inf if math.isnan(value) else float(value)
    return math.inf if value is None else str(value)


def latex_escape(text: str) -> str:
    """Plain text for LaTeX."""
    table = {
        "\\": r"\textbackslash{}",
        "&": r"\&",
        "%": r"\%",
        "$": r"\$",
        "#": r"\#",
        "_": r"\_",
        "{": r"\{",
        "}": r"\}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "–": "--",
        "∞": r"$\infty$",
        "≤": r"$\le$",
        "ε": r"$\varepsilon$",
        "×": r"$\times$",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
    }
    return "".join(table.get(letter, letter) for letter in text)


def _digits(value: float) -> str:
    """Three significant digits of a value that is not zero, without an exponent."""
    rounded = float(f"{value:.3g}")  # 0.09997 is 0.100, not 0.1000
    decimals = max(2 - math.floor(math.log10(abs(rounded))), 0)
    return f"{value:.{decimals}f}"
