"""Writes what the reports of the committed archives say, as plain text: `python -m tests.archived_reports OUT`.

Run it before and after a change that should alter no number, and compare the two folders with `diff -r`.
"""

from __future__ import annotations

import html
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ARCHIVES = ("baseline", "renderers", "dissertation", "dahlquist")
_INVISIBLE = re.compile(r"<(script|style|svg)\b.*?</\1>", re.DOTALL)
_TAG = re.compile(r"<[^>]*>")


def text_of(page: str) -> str:
    """The words and numbers of an HTML page, a line an element; scripts, styles and drawings are left out."""
    words = html.unescape(_TAG.sub("\n", _INVISIBLE.sub("", page)))
    return "\n".join(line.strip() for line in words.splitlines() if line.strip()) + "\n"


def write(archive: str, out: Path) -> None:
    """The tables (csv, md), the winners and the report's text of one archive."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / archive
        shutil.copytree(ROOT / "results" / archive, copy)
        for old in (*copy.glob("*.csv"), *copy.glob("tables/*")):
            old.unlink()
        command = [sys.executable, "-m", "harness", "report", str(copy), "--references", str(copy / "references")]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        for path in sorted((*copy.glob("*.csv"), *copy.glob("*.txt"), *copy.glob("tables/*"))):
            shutil.copy(path, out / path.name)
        (out / "report.txt").write_text(text_of((copy / "report.html").read_text()).replace(str(copy), archive))


if __name__ == "__main__":
    for each in ARCHIVES:
        write(each, Path(sys.argv[1]) / each)
