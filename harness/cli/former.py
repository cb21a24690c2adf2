"""Former commands and options, which scripts may still have: their words as those of the commands that replace them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

OPTIONS = {"--output": "--out", "--engines": "--engine"}
"""Former options of all commands, and what they are called now."""
_FLAGS = (
    *("-h", "--help", "--json", "--same-seeds", "--allow-imports", "--allow-commands", "--allow-outside"),
    *("--no-reflections", "--no-probe", "--interlaced", "--exact", "--redraw"),
)
_SHORT = ("-o", "-D")
_TRACE = {
    "--max-time": "--time",
    **{f"--{key}": f"--set=ray_sets.{key}" for key in ("count", "batch", "bounces", "checked", "hard")},
    **{f"--{key}": f"--set={key}" for key in ("seed", "baseline")},
}
"""Options of `trace`, and those of `race` in their place."""


def renamed(word: str) -> str:
    """A word of the command line, a former option under its present name, with a line on stderr."""
    name, equals, value = word.partition("=")
    if name not in OPTIONS:
        return word
    _note(f"{name} is now {OPTIONS[name]}")
    return f"{OPTIONS[name]}{equals}{value}"


def translated(words: Sequence[str]) -> list[str]:
    """The words of a command line, from the command on; those of a former command as the present ones, with a line on stderr.

    Raises `ConfigError`."""
    import shlex

    if not words or words[0] not in COMMANDS:
        return [*words]
    now = COMMANDS[words[0]]([renamed(word) for word in words[1:]])
    _note(f"`raybench {words[0]}` is now `raybench {shlex.join(now)}`")
    return now


def _note(text: str) -> None:
    import typer

    typer.echo(f"raybench: note: {text}", err=True)


def _pairs(words: Sequence[str]) -> Iterator[tuple[str, str | None]]:
    """Options with their values, which flags have not; an argument is the value of the option ''."""
    rest = iter(words)
    for word in rest:
        name, equals, value = word.partition("=")
        if not word.startswith("-"):
            yield "", word
        elif word in _FLAGS:
            yield word, None
        elif word.startswith(_SHORT) and len(word) > 2:
            yield word[:2], word[2:]
        else:
            yield (name, value) if equals else (word, next(rest, None))


def _dahlquist(words: Sequence[str]) -> list[str]:
    """With an option that the program alone has, so that it is drawn and not the scene of its name."""
    calls = [] if "--calls" in {name for name, _ in _pairs(words)} else ["--calls", "1"]
    return ["render", "dahlquist", *calls, *words]


def _equivalence(words: Sequence[str]) -> list[str]:
    """The first engine is the one that the others are compared with."""
    now = ["verify"]
    for name, value in _pairs(words):
        if name == "--engine" and value is not None:
            first, _, others = value.partition(",")
            now += ["--against", first, *(["--engine", others] if others else [])]
        else:
            now += [name or "--scene", *([] if value is None else [value])]
    return now


def _trace(words: Sequence[str]) -> list[str]:
    now, given = ["race"], {name for name, _ in _pairs(words)}
    for name, value in _pairs(words):
        option, key = _TRACE.get(name, name).partition("=")[::2]
        now += [*([option] if option else []), *([] if value is None else [f"{key}={value}" if key else value])]
    now += [] if "--rays" in given else ["--rays", "all"]
    return now + ([] if {"-o", "--out", "-h", "--help"} & given else ["--out", "results/trace"])


def _export(words: Sequence[str]) -> list[str]:
    """The format is told by the suffix of the file."""
    from engines.peers.export import file_of

    form = next((value for name, value in _pairs(words) if name == "--to"), None)
    stem = next((Path(value or "").stem for name, value in _pairs(words) if not name), "scene")
    now = ["convert"]
    for name, value in _pairs(words):
        if name in ("-o", "--out") and form is not None and value is not None:
            now += [name, str(file_of(form, value, stem))]
        elif name != "--to":
            now += [*([name] if name else []), *([] if value is None else [value])]
    return now


COMMANDS: dict[str, Callable[[list[str]], list[str]]] = {
    "reference": lambda words: ["run", *words, "--only", "references"],
    "dahlquist": _dahlquist,
    "rescore": lambda words: ["report", "--rescore", *words],
    "calibrate": lambda words: ["report", "--calibrate", *words],
    "merge": lambda words: ["archive", *words],
    "equivalence": _equivalence,
    "trace": _trace,
    "schema": lambda words: ["list", *([] if words[:1] in (["-h"], ["--help"]) else ["--schema"]), *(words or ["experiment"])],
    "export": _export,
    "import": lambda words: ["convert", *words],
}
"""Of each former command, the words of the present one from those behind its name."""
