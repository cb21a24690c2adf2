"""The fields of a ray batch, and which modules write them, read from the sources."""

import ast
from collections import defaultdict
from pathlib import Path

from markdown import code, table

import engines
from engines.kernels.layout import RayBatch

ROOT = Path(engines.__file__).parent
PLACES = ("kernels/driver.py", "kernels/queries.py", "kernels/stages", "numba_cpu/accel", "embree")


def fields() -> str:
    """A row for each field of the batch: its parts, and who writes it."""
    found = writers()
    rows = []
    for name, field in RayBatch.fields.items():
        rows.append((code(name), ", ".join(map(code, field.parts)), ", ".join(map(code, sorted(found[name])))))
    return table(("Field", "Parts", "Written by"), rows)


def writers() -> dict[str, set[str]]:
    """Of each field of the batch the modules that store it: by name, or by a string that says where rows are copied to."""
    found: dict[str, set[str]] = defaultdict(set)
    for place in PLACES:
        for path in [ROOT / place] if place.endswith(".py") else sorted((ROOT / place).glob("*.py")):
            nodes = list(ast.walk(ast.parse(path.read_text("utf-8"))))
            names = {_field(target) for node in nodes for target in _targets(node)}
            names |= {str(node.value).partition(".")[0] for node in nodes if isinstance(node, ast.Constant)}
            for name in names & RayBatch.fields.keys():
                found[name].add(path.relative_to(ROOT).with_suffix("").as_posix())
    return found


def _targets(node: ast.AST) -> list[ast.expr]:
    """What a statement stores to, item by item."""
    if not isinstance(node, ast.Assign):
        return []
    return [part for target in node.targets for part in (target.elts if isinstance(target, ast.Tuple) else [target])]


def _field(target: ast.expr) -> str:
    """The field of the batch of `rays.hit.point[lane]`: "hit"; empty for other targets."""
    names = []
    while isinstance(target, ast.Subscript | ast.Attribute):
        names += [target.attr] if isinstance(target, ast.Attribute) else []
        target = target.value
    return names[-1] if names and isinstance(target, ast.Name) and target.id in ("rays", "walk", "batch") else ""
