"""The YAML file of a renderer, read strictly: a `Description`, or a refusal with file, line and what is expected."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from engines.choices import SAMPLERS, SHADERS, Choice, Option, resolve
from engines.errors import ConfigError, RaybenchError, suggestion
from engines.peers.external.scenes import FORMATS
from engines.schema import fields
from engines.schema.yaml_file import Located, read_yaml

IMAGE_FORMATS = ("exr", "pfm")
UNITS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0}
ALWAYS = ("scene", "image", "folder", "spp", "seed", "threads", "width", "height", "precision", "shader", "sampler")
MUST_OCCUR = ("scene", "image", "spp", "seed")
KEYS = (
    "raybench_renderer",
    "name",
    "version",
    "lineage",
    "command",
    "scene_format",
    "image",
    "time",
    "shaders",
    "samplers",
    "precision",
    "threads",
    "environment",
)
_PIECE = re.compile(r"\{\{|\}\}|\{([^{}]*)\}|[{}]")
"""What a word may hold: a brace that is written twice, a placeholder, or a brace that stands alone."""
REQUIRED = ("raybench_renderer", "name", "version", "command", "shaders")


@dataclass(frozen=True, slots=True)
class Description:
    """What a file says. `time` is None for the process's own; `digest` is of the file's bytes.

    `lineage` is the name where the file has none.
    """

    file: Path
    digest: str
    name: str
    version: str
    command: Sequence[str]
    environment: Mapping[str, str]
    shaders: Mapping[str, Choice]
    samplers: Mapping[str, Choice]
    passed: frozenset[str]
    scene_format: str = "raybench"
    image: str = "exr"
    time: re.Pattern[str] | None = None
    precision: str = "float32"
    threads: int | None = None
    lineage: str = ""


def read(path: str | Path) -> Description:
    """The description in a file. Raises `ConfigError`."""
    file = Path(path)
    root = read_yaml(path, ConfigError)
    given = fields.mapping(root, KEYS, REQUIRED)
    fields.integer(given["raybench_renderer"], 1, 1)
    command = _words(given["command"])
    environment = _environment(given["environment"]) if "environment" in given else {}
    shaders, samplers = (
        _choices(given[kinds], kind, table) if kinds in given else {"random": Choice("random")}
        for kinds, kind, table in (("shaders", "shader", SHADERS), ("samplers", "sampler", SAMPLERS))
    )
    known = [*ALWAYS, *_options("shader", shaders), *_options("sampler", samplers)]
    texts = [(word, given["command"]) for word in command]
    texts += [(value, given["environment"]) for value in environment.values()]
    passed = frozenset(name for text, node in texts for name in placeholders(text, known, node))
    for name in MUST_OCCUR:
        if name not in passed:
            raise given["command"].refuse(f"{{{name}}} must occur in it")
    threads = fields.integer(given["threads"], 1, 1024) if "threads" in given else None
    if threads is None and "threads" not in passed:
        raise given["command"].refuse("{threads} must occur in it, or the key 'threads' say how many it always takes")
    return Description(
        file=file,
        digest=hashlib.sha256(file.read_bytes()).hexdigest()[:8],
        name=_name(given["name"]),
        version=str(given["version"].value),
        command=command,
        environment=environment,
        shaders=shaders,
        samplers=samplers,
        passed=passed,
        threads=threads,
        lineage=_line(given["lineage"] if "lineage" in given else given["name"]),
        time=_time(given["time"]) if "time" in given else None,
        **{
            key: fields.one_of(given[key], values, what)
            for key, values, what in (
                ("scene_format", FORMATS, "scene format"),
                ("image", IMAGE_FORMATS, "image format"),
                ("precision", ("float32", "float64"), "precision"),
            )
            if key in given
        },
    )


def _name(node: Located) -> str:
    name = fields.text(node)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9._-]*", name):
        raise node.refuse("must be letters, digits, '.', '_' and '-', and start with a letter")
    return name


def _line(node: Located) -> str:
    if not fields.text(node).isprintable():
        raise node.refuse("must be a line of text")
    return node.value


def _words(node: Located) -> list[str]:
    if not isinstance(node.value, list) or not node.value:
        raise node.refuse("a list of words is expected: no shell splits or expands them")
    return [_word(child) for child in node.value]


def _word(node: Located) -> str:
    if isinstance(node.value, (dict, list, bool)) or node.value is None or "\0" in str(node.value):
        raise node.refuse("must be text")
    return str(node.value)


def _environment(node: Located) -> dict[str, str]:
    if not isinstance(node.value, dict):
        raise node.refuse("must be a mapping from names to values")
    for key in node.value:
        if not key or "=" in key or "\0" in key:
            raise node.refuse_key(key, "is no name of a variable")
    return {key: _word(child) for key, child in node.value.items()}


def _choices(node: Located, kind: str, table: Mapping[str, Mapping[str, Option]]) -> dict[str, Choice]:
    choices: dict[str, Choice] = {}
    for child in fields.items(node, f"{kind}s"):
        try:
            choice = resolve(kind, child.plain(), table)
        except RaybenchError as error:
            raise ConfigError(f"{child.where}: {error}") from error
        choices[choice.name] = choice
    if not choices:
        raise node.refuse(f"at least one {kind} is expected")
    return choices


def _options(kind: str, choices: Mapping[str, Choice]) -> list[str]:
    return [f"{kind}.{option}" for choice in choices.values() for option in choice.options]


def _time(node: Located) -> re.Pattern[str] | None:
    if node.value == "process":
        return None
    if not isinstance(node.value, dict):
        raise node.refuse("must be process, or {pattern: ...}")
    pattern = fields.mapping(node, ("pattern",), ("pattern",))["pattern"]
    try:
        compiled = re.compile(fields.text(pattern))
    except re.error as error:
        raise pattern.refuse(f"is no regular expression: {error}") from error
    if not compiled.groupindex or not set(compiled.groupindex) <= set(UNITS):
        raise pattern.refuse(f"groups named by their unit are expected, as (?P<s>[0-9.]+): {', '.join(UNITS)}")
    return compiled


# ---- words with placeholders: `spp={spp}`; `{{` and `}}` are braces


def placeholders(text: str, known: Iterable[str], node: Located) -> Iterator[str]:
    """The names used in `text`; raises what `node` refuses where one is unknown or a brace stands alone."""
    known = list(known)
    for piece in _PIECE.finditer(text):
        if piece[0] in ("{", "}"):
            raise node.refuse(f"{text!r}: a brace stands alone; {{{{ and }}}} are braces")
        if piece[1] is not None:
            if piece[1] not in known:
                raise node.refuse(f"{text!r}: unknown placeholder {{{piece[1]}}}: {suggestion(piece[1], known)}")
            yield piece[1]


def filled(text: str, values: Mapping[str, object]) -> str:
    """`text` with every placeholder replaced; a value that is missing raises KeyError."""
    braces = {"{{": "{", "}}": "}"}
    return _PIECE.sub(lambda piece: braces.get(piece[0]) or str(values[piece[1]]), text)
