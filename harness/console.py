"""What commands share: where they print."""

from __future__ import annotations

import os

from rich.console import Console

WIDTH_WITHOUT_TERMINAL = 160
BROKEN_PIPE = 141
"""As of a program that SIGPIPE ended."""


class _Console(Console):
    """A console whose reader may go away, as that of `raybench list | head -1` does."""

    def on_broken_pipe(self) -> None:
        """Ends the program as a shell expects it; rich's exit code 1 would say that a cell failed."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())
        raise SystemExit(BROKEN_PIPE)


def consoles() -> tuple[Console, Console]:
    """(stdout, stderr); what is not a terminal has room for wide tables."""
    made = [_Console(stderr=stderr, highlight=False) for stderr in (False, True)]
    for console in made:
        if not console.is_terminal:
            console.width = WIDTH_WITHOUT_TERMINAL
    return made[0], made[1]
