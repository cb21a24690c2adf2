"""The command line, from the application itself: every command with its arguments and options."""

import typer

from docs._ext.markdown import code, paragraphs, plain, table
from harness.cli import app


def text() -> str:
    """A section a command."""
    group = typer.main.get_command(app)
    parts = [plain(group.help), plain(group.epilog)]
    shown = {name: command for name, command in group.commands.items() if not command.hidden}
    for name, command in {**shown, "render dahlquist": group.commands["dahlquist"]}.items():
        arguments = [each for each in command.params if each.param_type_name == "argument"]
        options = [each for each in command.params if each.param_type_name == "option"]
        words = ["raybench", name, *map(_argument, arguments), *(["[OPTIONS]"] if options else [])]
        parts.append(f"## raybench {name}\n\n{plain(command.help)}\n\n```text\n{' '.join(words)}\n```")
        for head, params in (("Argument", arguments), ("Option", options)):
            if params:
                parts.append(table((head, "Meaning", "Default"), map(_row, params)))
    return paragraphs(parts)


def _argument(param) -> str:
    word = (param.metavar or param.name).upper().removesuffix("...") + ("..." if param.nargs != 1 else "")
    return word if param.required else f"[{word}]"


def _row(param) -> tuple[str, str, str]:
    """Name, meaning and default. A default that is no value is given in words, as `show_default`."""
    meaning, default = param.help or "", param.show_default if isinstance(param.show_default, str) else ""
    if not default and not getattr(param, "is_flag", False):
        default = "required" if param.required else "" if param.default is None else str(param.default)
    if param.param_type_name == "argument":
        return code(_argument(param)), plain(meaning), plain(default)
    value = "" if param.is_flag else " " + (param.metavar or param.name.upper())
    names = [*param.opts[:-1], param.opts[-1] + value, *param.secondary_opts]
    return ", ".join(map(code, names)), plain(meaning), plain(default)
