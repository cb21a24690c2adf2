"""Config files as they stand on disk, and `--set key.key=value`, which changes what one says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from engines.errors import ConfigError
from engines.schema.yaml_file import Located, Origin, parse_yaml, read_yaml
from harness.config import paths
from harness.config.kinds import mapping


@dataclass(frozen=True, slots=True)
class ConfigFile:
    """A file that was read: its tree, its place, and its name in messages."""

    root: Located
    path: Path
    name: str

    def overridden(self, overrides: Iterable[str]) -> Located:
        """The tree with `key.key=value` overrides applied, one after the other."""
        root = self.root
        for text in overrides:
            root = override(root, text)
        return root


def read_file(given: str | Path) -> ConfigFile:
    """The file of a path, or of a bare name in configs/. Raises `ConfigError`."""
    path = paths.find("configs", str(given))
    shown = paths.shown(path)
    return ConfigFile(read_yaml(path, ConfigError, shown), path, shown)


def top_level(root: Located) -> Located:
    """The top level of a file without the keys that begin with a dot, which are for anchors."""
    return replace(root, value={key: node for key, node in mapping(root).items() if not key.startswith(".")})


def override(root: Located, text: str) -> Located:
    """`root` with one `a.b=value` set; the value is YAML. A key that does not exist is made, and checked later."""
    key, equals, value = text.partition("=")
    steps = tuple(key.strip().split("."))
    if not equals or not all(steps):
        raise ConfigError(f"--set {text}: must look like budget.max_time=5s")
    parsed = parse_yaml(value, f"--set {key}", ConfigError)
    mapping(root)
    return _with(root, steps, parsed)


def _with(node: Located, steps: tuple[str, ...], value: Located) -> Located:
    children = dict(mapping(node))
    path = (*node.path, steps[0])
    if len(steps) == 1:
        children[steps[0]] = _moved(value, Origin("--set", ConfigError), path)
    else:
        inside = children.get(steps[0], Located({}, Origin("--set", ConfigError), path))
        children[steps[0]] = _with(inside, steps[1:], value)
    return replace(node, value=children)


def _moved(node: Located, origin: Origin, path: tuple[str | int, ...]) -> Located:
    value = node.value
    if isinstance(value, dict):
        value = {key: _moved(child, origin, (*path, key)) for key, child in value.items()}
    elif isinstance(value, list):
        value = [_moved(child, origin, (*path, index)) for index, child in enumerate(value)]
    return Located(value, origin, path)
