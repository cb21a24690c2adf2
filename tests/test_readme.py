"""The README tells the truth: what it shows runs, from a copy of the folder that a reader would stand in.

In the order of the page: a block whose fence says `python NAME.py` or `yaml NAME.yaml` becomes that file; all other
`python` blocks run in one process, sharing their names, unless the fence says `no-run`; other `yaml` blocks are parsed;
lines that start with `$ ` in a block marked `console run` are then run and must exit with 0.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

import engines

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(r"^```(?P<info>[a-z][^\n]*)\n(?P<body>.*?)^```\s*$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    language: str
    words: tuple[str, ...]
    """What the fence says after the language."""
    body: str
    line: int
    """Line of the page on which the body starts, from 1."""

    @property
    def file(self) -> str | None:
        return next((word for word in self.words if "." in word), None)


def blocks(page: str) -> list[Block]:
    """The fenced blocks of a Markdown page that name a language."""
    found = []
    for match in FENCE.finditer(page):
        language, *words = match["info"].split()
        found.append(Block(language, tuple(words), match["body"], page.count("\n", 0, match.start("body")) + 1))
    return found


def story(page: list[Block]) -> str:
    """All python blocks as one program whose line numbers are the page's."""
    program = ""
    for block in page:
        if block.language == "python" and block.file is None and "no-run" not in block.words:
            program += "\n" * (block.line - 1 - program.count("\n")) + block.body
    return program


def run(command: list[str], folder: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{shlex.join(command)[:200]}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"


PAGE = blocks((ROOT / "README.md").read_text()) if (ROOT / "README.md").exists() else []


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder with the project's scenes and configs, and the files that the page shows."""
    made = tmp_path_factory.mktemp("readme")
    for name in ("scenes", "configs"):
        (made / name).symlink_to(ROOT / name)
    for block in PAGE:
        if block.file is not None:
            assert Path(block.file).name == block.file, f"README.md:{block.line}: a plain file name is wanted"
            (made / block.file).write_text(block.body)
    return made


def test_the_page_shows_python():
    assert story(PAGE).strip(), "README.md has no python block that runs"


def test_the_python_of_the_page_runs(folder):
    (folder / "readme_page.py").write_text(story(PAGE))
    run([sys.executable, "readme_page.py"], folder)


@pytest.mark.parametrize("block", [b for b in PAGE if b.language == "yaml"], ids=lambda b: f"line {b.line}")
def test_the_yaml_of_the_page_is_well_formed_and_its_scenes_load(block):
    read = yaml.safe_load(block.body)
    assert read is not None
    if isinstance(read, dict) and "raybench_scene" in read:
        assert engines.scene_from(read).shapes


COMMANDS = [
    (block.line + number, line[2:])
    for block in PAGE
    if block.language == "console" and "run" in block.words
    for number, line in enumerate(block.body.splitlines())
    if line.startswith("$ ")
]


@pytest.mark.parametrize(("line", "command"), COMMANDS)
def test_the_commands_of_the_page_succeed(line, command, folder):
    program, *arguments = shlex.split(command)
    ours = {"raybench": [sys.executable, "-m", "harness"], "python": [sys.executable]}
    run([*ours.get(program, [program]), *arguments], folder)


def test_blocks_are_found_with_their_lines_and_marks():
    page = "a\n```python\nx = 1\n```\n\n```yaml my.yaml\na: 1\n```\n"
    page += "```python no-run\n1 / 0\n```\n```python\nassert x\n```\n"
    found = blocks(page)
    assert [(block.language, block.file, block.line) for block in found] == [
        ("python", None, 3),
        ("yaml", "my.yaml", 7),
        ("python", None, 10),
        ("python", None, 13),
    ]
    assert story(found) == "\n\nx = 1\n" + "\n" * 9 + "assert x\n"
