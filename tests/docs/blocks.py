"""The fenced blocks of a page, and what their fences may say. Rules for whoever writes a page in docs/ or the README:

Every fence names a language. What stands on a page runs, in the order of the page, in an empty folder that has `scenes/`
and `configs/` (and, where the page names it, a copy of `results/baseline`); all python blocks of a page share their names.

    ```python                         runs
    ```python my_shader.py            becomes that file, before anything runs; import it, or name it `my_shader:Shader`
    ```yaml box.yaml                  becomes that file, and must load: as a scene, an experiment or a renderer's file
    ```xml box.xml                    becomes that file
    ```yaml scene                     a piece of a scene: keys that a scene needs and the piece lacks are filled in,
                                      and a material `grey`
    ```yaml experiment                a piece of an experiment, likewise
    ```yaml                           whole: must load by its `raybench_scene`, `raybench_experiment` or `raybench_renderer`
    ```console                        lines that start with `$ ` run in a shell and must exit with 0; a line that ends with
                                      a backslash goes on, two spaces and # start a comment
    ```console exit 1                 ... must exit with 1
    ```console with --size 48x32      ... with these words added to each command in the tests alone
    ```python no-run: needs a GPU     does not run; the reason is expected. For every language.
    ```text                           output, or a drawing; also json, csv, xml, latex, c, html, ini

Lines of a console block below a command are its output, or some of it: each must be printed, in that order. Any number
stands for any other, any white space for any other, and a line `...` (or `...` within a line) for whatever there is.
A python block that is followed by a ```text printed block must print that, by the same rules.
A page that shows a file by ```{literalinclude} examples/NAME.py has that file in the folder.

The tests of all pages together may take a minute on two cores with nothing compiled: use images of 48x32 and 2 samples a
pixel (`with --size 48x32 --spp 2`, `with --set repeats=1 --set remeasure=0 --set reference.certify=null`: beside other tests
every cell is disturbed), few pages that compile a shader of
their own, and else `path_tracer` with `sobol` and the default precision. A page is a test: short pages run side by side.
"""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r"^(?P<ticks>```+)(?P<info>[^\n`]*)\n(?P<body>.*?)^(?P=ticks)[ \t]*$", re.MULTILINE | re.DOTALL)
RUN = ("python", "yaml", "console")
SHOWN = ("text", "json", "csv", "xml", "latex", "c", "html", "ini")


class Block(NamedTuple):
    language: str
    words: tuple[str, ...]
    """What the fence says after the language."""
    body: str
    line: int
    """Line of the page on which the body starts, from 1."""

    @property
    def runs(self) -> bool:
        return self.language in RUN and not (self.words and self.words[0].startswith("no-run"))

    @property
    def file(self) -> str | None:
        """The file that a block of one word with a dot becomes."""
        is_file = self.language in ("python", "yaml", "xml") and len(self.words) == 1 and "." in self.words[0]
        return self.words[0] if is_file else None


class Command(NamedTuple):
    line: int
    text: str
    """As the page has it, on one line."""
    output: tuple[str, ...]
    """The lines that must be printed."""


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a Markdown page; MyST's directives are none."""
    found = []
    for match in FENCE.finditer(page):
        if match["info"].startswith("{"):
            continue
        language, *words = match["info"].split() or [""]
        found.append(Block(language, tuple(words), match["body"], page.count("\n", 0, match.start("body")) + 1))
    return found


def commands(block: Block) -> list[Command]:
    """The commands of a console block, each with the output that the page shows."""
    found: list[Command] = []
    lines = iter(enumerate(block.body.splitlines(), block.line))
    for number, line in lines:
        if line.startswith("$ "):
            text = line[2:]
            while text.endswith("\\"):
                text = text[:-1] + next(lines)[1].strip().removeprefix("> ")
            found.append(Command(number, text, ()))
        elif found and line.strip():
            found[-1] = found[-1]._replace(output=(*found[-1].output, line))
    return found


def mistakes(block: Block) -> list[str]:
    """What is wrong with a fence."""
    if block.language not in (*RUN, *SHOWN):
        return [f"the language {block.language!r} is none of {', '.join((*RUN, *SHOWN))}"]
    if block.words and block.words[0].startswith("no-run"):
        return [] if block.words[0] == "no-run:" and len(block.words) > 2 else ["no-run: wants a reason"]
    if block.language == "console":
        return [] if commands(block) else ["no line starts with '$ '"]
    allowed = {"python": (), "yaml": ("scene", "experiment"), "text": ("printed",)}.get(block.language, ())
    understood = not block.words or block.file or block.words[0] in allowed
    return [] if understood else [f"what is {' '.join(block.words)!r}?"]


NUMBER = r"[-+]?(?:\d[\d,]*\.?\d*|\.\d+)(?:e[-+]?\d+)?"


def missing(shown: tuple[str, ...], printed: str) -> str | None:
    """The first line of `shown` that was not printed below the one before it; None where all were."""
    at = 0
    for line in shown:
        if line.strip() == "...":
            continue
        pattern = r"[^\n]*?".join(_line(part) for part in line.strip().split("..."))
        found = re.compile(rf"^[ \t]*{pattern}[ \t]*$", re.MULTILINE).search(printed, at)
        if found is None:
            return line
        at = found.end()
    return None


def _line(part: str) -> str:
    """A pattern for a piece of a line, in which numbers and white space are free."""
    pieces = re.split(rf"({NUMBER}|\s+)", part)
    free = [r"[ \t]+" if piece.isspace() else NUMBER for piece in pieces[1::2]]
    return "".join(word for pair in zip(map(re.escape, pieces[::2]), [*free, ""], strict=True) for word in pair)
