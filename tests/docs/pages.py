"""The pages, and how a reader follows one from top to bottom."""

import re
import shutil
from pathlib import Path

from tests import forked
from tests.docs.blocks import ROOT, blocks
from tests.docs.story import environment, main

FRONT = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
"""Pages beside the site."""
PAGES = [*FRONT, *sorted((ROOT / "docs").glob("[!_]*/**/*.md")), *sorted((ROOT / "docs").glob("*.md"))]
TEXT = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PAGES}
RUN = [name for name, text in TEXT.items() if any(block.runs for block in blocks(text))]
"""Pages on which something runs."""
EXAMPLE = re.compile(r"^```\{literalinclude\} (examples/\w+\.py)$", re.MULTILINE)
"""A file that a page shows; it lies beside what runs."""


def follow(page: str, folder: Path) -> None:
    """Runs what a page shows, in `folder`, which has what a reader of the page has."""
    for name in EXAMPLE.findall(TEXT[page]):
        shutil.copy((ROOT / page).parent / name, folder)
    for name in ("scenes", "configs"):
        (folder / name).symlink_to(ROOT / name)
    if "results/baseline" in TEXT[page]:
        shutil.copytree(ROOT / "results/baseline", folder / "results/baseline")
    said = folder / ".said"
    story = forked.Forked(main, [ROOT / page], folder, environment(folder), stderr=said)
    assert story.wait() == 0, said.read_text()[-8000:]
