"""The command line, `raybench` and `python -m harness`: `commands` has names and help, the other modules do the work."""

from harness.cli.commands import app, main
