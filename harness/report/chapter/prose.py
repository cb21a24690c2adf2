"""A chapter written by hand, in Markdown, whose numbers and claims are checked against the results.

    {{speedup("gears", "numba bvh", "embree")}}      is replaced by the value, `1.33 (1.11 to 1.59)`
    {{claim faster("gears", "numba bvh", "embree")}}   is left out of the text if it holds, and an error if not
    {{table accelerators}}, {{figure threads}}       on a line of its own: as the experiment's section has it
    {{usual path_tracer, 2 threads}}                 on a line of its own: what phrases leave open

Expressions are calls of what `facts` offers, numbers, texts, lists, comparisons, `and`, `or`, `not` and the four operations.
Of Markdown there are headings, paragraphs and lists.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from engines.errors import ConfigError, suggestion
from harness.analysis import Analysis
from harness.report.chapter.document import Chapter, FigurePart, Listing, Paragraph, Part, Section, TablePart
from harness.report.chapter.facts import Facts, Verdicts
from harness.report.chapter.words import interval
from harness.report.tables.model import number_text
from harness.statistics import Estimate, Ratio

CODE = re.compile(r"\{\{(.+?)\}\}", re.DOTALL)
BLOCK = re.compile(r"\{\{(table|figure|usual) ([^{}]+)\}\}")
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
NO_NUMBER = number_text(float("nan"))
OPERATORS: Mapping[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Eq: operator.eq,
    ast.Not: operator.not_,
    ast.USub: operator.neg,
}


class Disagreement(ConfigError):
    """Prose that claims or asks what the results do not give: `problems`, each with its file, line and sentence."""

    def __init__(self, file: Path, problems: Sequence[str]) -> None:
        self.problems = problems
        super().__init__(f"{file}: {len(problems)} of its statements do not stand on the results; the first: {problems[0]}")


def chapter(file: Path, analyses: Sequence[Analysis], sections: Sequence[Section]) -> Chapter:
    """The chapter of a file of prose; tables and figures are those of `sections`.

    Raises Disagreement with every claim that does not hold, its sentence and the numbers, and all that is not understood.
    """
    try:
        text = COMMENT.sub(lambda found: "\n" * found[0].count("\n"), file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: cannot be read: {error}") from error
    usual = [word.strip() for kind, words in BLOCK.findall(text) if kind == "usual" for word in words.split(",")]
    checked = _Checked(file, Facts(analyses, usual).vocabulary(), {_key(p): p for s in sections for p in _parts(s)})
    made = Chapter(file.stem, [])
    line = 1
    for block in re.split(r"(\n\s*\n)", text):
        if block.strip():
            _add(made, block.strip("\n"), line, checked)
        line += block.count("\n")
    if checked.problems:
        raise Disagreement(file, checked.problems)
    return made


def _add(made: Chapter, block: str, line: int, checked: _Checked) -> None:
    """Adds a heading, a list, a paragraph, a table or a figure to the end of the chapter."""
    heading = re.fullmatch(r"(#+) (.+)", block)
    if heading and len(heading[1]) == 1:
        made.title = heading[2]
        return
    if heading:
        inner = len(heading[1]) > 2 and made.sections
        (made.sections[-1].sections if inner else made.sections).append(Section(heading[2]))
        return
    part = checked.part(block, line)
    if part is None:
        return
    if not made.sections:
        made.sections.append(Section("Introduction"))
    last = made.sections[-1].sections[-1] if made.sections[-1].sections else made.sections[-1]
    last.parts.append(part)


def _key(part: Part) -> tuple[str, str]:
    if isinstance(part, TablePart):
        return "table", part.table.name
    return ("figure", part.plot.name) if isinstance(part, FigurePart) else ("", "")


def _parts(section: Section) -> Iterator[Part]:
    yield from section.parts
    for below in section.sections:
        yield from _parts(below)


class _Checked:
    """Turns blocks of text into parts, and collects what is wrong with them."""

    def __init__(self, file: Path, vocabulary: Mapping[str, Callable[..., Any]], parts: Mapping[Any, Part]) -> None:
        self._file, self._vocabulary, self._known = file, vocabulary, parts
        self.problems: list[str] = []

    def part(self, block: str, line: int) -> Part | None:
        named = BLOCK.fullmatch(block.strip())
        if named and named[1] == "usual":
            return None
        if named:
            found = self._known.get((named[1], named[2].strip()))
            if found is None:
                names = [name for kind, name in self._known if kind == named[1]]
                self._wrong(line, block, f"the results have no {named[1]} {named[2]!r}: {suggestion(named[2], names)}")
            return found
        if block.startswith("- "):
            items = re.split(r"\n(?=- )", block)
            starts = [line + sum(item.count("\n") + 1 for item in items[:i]) for i in range(len(items))]
            return Listing([self._filled(item[2:], start) for item, start in zip(items, starts, strict=True)])
        return Paragraph([self._filled(block, line)])

    def _filled(self, text: str, line: int) -> str:
        """The text with values in the place of expressions, in one line."""
        filled = CODE.sub(lambda found: self._value(found, text, line + text.count("\n", 0, found.start())), text)
        return " ".join(filled.split())

    def _value(self, found: re.Match[str], text: str, line: int) -> str:
        code = " ".join(found[1].split())
        claim = code.startswith("claim ")
        expression = code.removeprefix("claim ")
        sentence = _sentence(text, found.start())
        asked: list[str] = []
        try:
            value = self._evaluate(ast.parse(expression, mode="eval").body, asked)
            shown = "" if claim else as_text(value)
            if claim and not value:
                self._wrong(line, sentence, f"the results do not say that {expression}: {'; '.join(asked)}")
            elif NO_NUMBER in shown:
                self._wrong(line, sentence, f"the results have no number for {expression}: {'; '.join(asked)}")
            return shown
        except SyntaxError:
            self._wrong(line, sentence, f"{expression}: is no expression")
        except (ConfigError, TypeError, ValueError, ZeroDivisionError) as error:
            self._wrong(line, sentence, f"{expression}: {error}")
        return ""

    def _wrong(self, line: int, sentence: str, problem: str) -> None:
        self.problems.append(f'{self._file}:{line}: "{sentence}": {problem}')

    def _evaluate(self, node: ast.AST, asked: list[str]) -> Any:
        """The value of an expression; each call is noted in `asked` with what it gave."""
        if isinstance(node, ast.Constant) and isinstance(node.value, (int, float, str)):
            return node.value
        if isinstance(node, (ast.List, ast.Tuple)):
            return [self._evaluate(each, asked) for each in node.elts]
        if isinstance(node, ast.BoolOp):
            values = [self._evaluate(each, asked) for each in node.values]
            return all(values) if isinstance(node.op, ast.And) else any(values)
        if isinstance(node, ast.UnaryOp) and type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](_plain(self._evaluate(node.operand, asked)))
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](*(_number(self._evaluate(each, asked)) for each in (node.left, node.right)))
        if isinstance(node, ast.Compare) and all(type(op) in OPERATORS for op in node.ops):
            values = [_number(self._evaluate(each, asked)) for each in (node.left, *node.comparators)]
            return all(OPERATORS[type(op)](*pair) for op, pair in zip(node.ops, pairwise(values), strict=True))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            if node.func.id not in self._vocabulary:
                raise ConfigError(f"{node.func.id} is unknown: {suggestion(node.func.id, self._vocabulary)}")
            value = self._vocabulary[node.func.id](*(self._evaluate(each, asked) for each in node.args))
            asked.append(f"{ast.unparse(node)} is {as_text(value)}")
            return value
        raise ConfigError(f"{ast.unparse(node)} is no call, number, text, list or comparison")


def _plain(value: Any) -> Any:
    return bool(value) if isinstance(value, Verdicts) else _number(value)


def _number(value: Any) -> Any:
    return value[0] if isinstance(value, (Estimate, Ratio)) else value


def as_text(value: Any) -> str:
    """Values as prose has them; of a list of ratios the least and the greatest, of verdicts what was found instead."""
    if isinstance(value, Verdicts):
        return ", ".join(f"{ratio.verdict} on {where}, {interval(ratio)}" for where, ratio in value.ratios.items())
    if isinstance(value, (Estimate, Ratio)):
        return interval(value)
    if isinstance(value, list):
        ends = [number_text(end(_number(one) for one in value)) for end in (min, max)]
        return " to ".join(dict.fromkeys(ends))
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    return number_text(value) if isinstance(value, float) else str(value)


def _sentence(text: str, at: int) -> str:
    """The sentence of `text` around a position, without its code."""
    begins = max((found.end() for found in re.finditer(r"[.:?!]\s+(?![^{]*\}\})", text[:at])), default=0)
    ends = re.search(r"[.?!](\s|$)", CODE.sub(lambda code: " " * len(code[0]), text)[at:])
    return " ".join(CODE.sub("...", text[begins : at + ends.end() if ends else len(text)]).replace("...", "…").split())
