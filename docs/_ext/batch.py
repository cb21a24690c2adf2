"""The fields of a ray batch, and which modules write them, read from the sources."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import engines
from docs._ext.markdown import code, table
from engines.kernels.layout import RayBatch

ROOT = Path(engines.__file__).parent
PLACES = ("kernels/driver.py", "kernels/queries.py", "kernels/stages", "numba_cpu/accel", "embree")
BATCHES = ("rays", "walk", "batch")
"""Names of a batch in the sources."""


def fields() -> str:
    """The fields of the batch in their order, in a row those that the same modules write."""
    found, rows = writers(), list[tuple[str, str]]()
    for by, several in groupby(paths(), key=lambda path: ", ".join(sorted(found[path]))):
        rows.append((", ".join(map(code, several)), by.replace("kernels/stages/", "")))
    return table(("Fields", "Written by"), rows)


def paths() -> list[str]:
    """All fields, such as "t"; of records the parts, such as "hit.point"."""
    parts = {name: [f"{name}.{part}" for part in field.parts] for name, field in RayBatch.fields.items()}
    return [path for name, several in parts.items() for path in several or [name]]


def writers() -> dict[str, set[str]]:
    """Of each field of the batch the modules that store it: by name, or by a string that says where rows are copied to."""
    found: dict[str, set[str]] = defaultdict(set)
    every = paths()
    for place in PLACES:
        for path in [ROOT / place] if place.endswith(".py") else sorted((ROOT / place).glob("*.py")):
            written = _written(ast.parse(path.read_text("utf-8")))
            for field in every:
                if any(field == name or field.startswith(f"{name}.") or name.startswith(f"{field}.") for name in written):
                    found[field].add(path.relative_to(ROOT).with_suffix("").as_posix())
    return found


def _written(tree: ast.Module) -> set[str]:
    """Names of fields, of records, and other names, that a module stores to."""
    nodes = list(ast.walk(tree))
    read = {id(each) for node in nodes for each in _read(node)}
    texts = (node for node in nodes if isinstance(node, ast.Constant) and id(node) not in read)
    named = {text.value for text in texts if isinstance(text.value, str)}
    return named | {_field(target) for node in nodes for target in _targets(node)} | set(_through_parameters(nodes))


def _read(node: ast.AST) -> list[ast.expr]:
    """Strings that name what is read: a column of a row, the field that holds which row is copied."""
    if isinstance(node, ast.Subscript):
        return [node.slice]
    return node.args[:1] if isinstance(node, ast.Call) and _name(node.func) == "make_load_rows" else []


def _targets(node: ast.AST) -> list[ast.expr]:
    """What a statement stores to, item by item."""
    if not isinstance(node, ast.Assign):
        return []
    targets = [part for target in node.targets for part in (target.elts if isinstance(target, ast.Tuple) else [target])]
    return [target.value for target in targets if isinstance(target, ast.Subscript)]


def _through_parameters(nodes: list[ast.AST]) -> Iterator[str]:
    """Fields that are given to a function of the same module, which stores to its parameter."""
    functions = {node.name: node for node in nodes if isinstance(node, ast.FunctionDef)}
    for call in nodes:
        function = functions.get(_name(call.func)) if isinstance(call, ast.Call) else None
        if function is None:
            continue
        stored = {_name(target) for node in ast.walk(function) for target in _targets(node)}
        for parameter, given in zip(function.args.args, call.args, strict=False):
            if parameter.arg in stored:
                yield _field(given)


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else ""


def _field(node: ast.expr) -> str:
    """The path of a field, "hit.point" of `rays.hit.point`; empty for what is no field."""
    names: list[str] = []
    while isinstance(node, ast.Attribute):
        names, node = [node.attr, *names], node.value
    return ".".join(names) if _name(node) in BATCHES else ""
