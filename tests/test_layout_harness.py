"""The inner floors of the harness, read from the sources as in `test_layout`."""

import pytest

from tests.test_layout import MODULES, imports, part_of, targets

ROOMS = ("harness.view", "harness.verify", "harness.report.chapter")
"""What stands above the core: none imports another, and nothing of the core imports them."""
LAYERS = (
    ("harness", "harness.__main__"),
    ("harness.cli",),
    ROOMS,
    ("harness.report",),
    ("harness.run",),
    ("harness.analysis",),
    ("harness.plan",),
    ("harness.store",),
    ("harness.measure",),
    ("harness.trace",),
    ("harness.config",),
    ("harness.statistics",),
    ("harness.metrics", "harness.check_results", "harness.suites"),
    ("harness.source_hashes", "harness.hashing", "harness.processes", "harness.settings", "harness.console"),
)
"""The floors of the harness, the top one first: a module imports from its own floor and from those below."""


PUBLIC = {
    *("harness.check_results", "harness.console", "harness.metrics", "harness.processes", "harness.settings"),
    *("harness.suites",),
    *("harness.config", "harness.config.paths", "harness.config.settings"),
    *("harness.measure.clock", "harness.measure.contention", "harness.measure.machine", "harness.measure.messages"),
    *("harness.measure.pool", "harness.measure.requests", "harness.measure.schedule", "harness.trace.oracle"),
    *("harness.store", "harness.store.atomic", "harness.store.confined", "harness.store.records", "harness.store.results"),
    *("harness.plan.cells", "harness.plan.planner", "harness.run.progress", "harness.run.recorder", "harness.run.sweep"),
    *("harness.statistics", "harness.statistics.convergence", "harness.statistics.equivalence"),
    *(
        "harness.analysis",
        "harness.analysis.comparisons",
        "harness.analysis.equivalence",
        "harness.analysis.frames",
        "harness.analysis.races",
    ),
    *("harness.report", "harness.report.html.assembly", "harness.report.plots", "harness.report.plots.curves"),
    *("harness.report.plots.chart", "harness.report.plots.figures", "harness.report.plots.style"),
    *("harness.report.tables", "harness.report.tables.evidence", "harness.report.tables.model"),
}
"""What of the core the rooms may use: the names of these modules that do not begin with an underscore."""


def layer_of(module: str) -> int | None:
    """The number of the floor that a module of the harness stands on: that of the longest name that is a prefix."""
    floors = {part: floor for floor, parts in enumerate(LAYERS) for part in parts}
    found = [part for part in floors if module == part or (module.startswith(part + ".") and part != "harness")]
    return floors[max(found, key=len)] if found else None


def imports_upwards(name: str, source: str, is_package: bool = False) -> list[str]:
    """One line for every import of `source`, as module `name` of the harness, from a floor above its own."""
    own, upwards = layer_of(name), []
    if own is None:
        return [f"{name} stands on no floor of LAYERS"]
    for line, module, names in imports(name, source, is_package):
        for target in sorted(targets(module, names)) if module.partition(".")[0] == "harness" else []:
            floor = layer_of(target)
            if floor is not None and floor < own:
                upwards.append(f"{name}:{line} imports {target}: {LAYERS[own]} may import {LAYERS[own + 1 :]}")
    return upwards


def room_of(module: str) -> str:
    """The room that a module belongs to, or nothing."""
    return next((room for room in ROOMS if module == room or module.startswith(room + ".")), "")


def beyond_public(name: str, source: str, is_package: bool = False) -> list[str]:
    """One line for every import of `source`, as module `name` of a room, of what is neither its own nor public."""
    reached = [
        (line, target, any(each.startswith("_") for each in names))
        for line, module, names in imports(name, source, is_package)
        for target in (sorted(targets(module, names)) if module.partition(".")[0] == "harness" else [])
        if room_of(target) != room_of(name)
    ]
    return [f"{name}:{line} imports {target}" for line, target, private in reached if private or target not in PUBLIC]


def test_rooms_use_the_core_by_its_public_names():
    found = {name: beyond_public(name, p.read_text(), p.name == "__init__.py") for name, p in MODULES.items() if room_of(name)}
    assert [line for lines in found.values() for line in lines] == []
    assert set(MODULES) >= PUBLIC and not any(room_of(module) for module in PUBLIC)


@pytest.mark.parametrize(
    "line",
    [
        "from harness.verify.suite import CASES",
        "from harness.report.chapter import Facts",
        "from harness.cli.outputs import check_file",
        "from harness.plan.patterns import x",
        "from harness.store.results import _torn",
        "import harness.run.references",
    ],
)
def test_an_import_of_what_is_not_public_is_seen(line):
    assert beyond_public("harness.view.menu", line) != []
    assert beyond_public("harness.view.menu", "from harness.view import server\nfrom harness.store import make_out") == []


def test_the_harness_imports_downwards():
    ours = {name: path for name, path in MODULES.items() if part_of(name) == "harness"}
    found = [imports_upwards(name, path.read_text(), path.name == "__init__.py") for name, path in ours.items()]
    assert [line for lines in found for line in lines] == []
    assert set(range(len(LAYERS))) == {layer_of(name) for name in ours}


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("harness.statistics.bias", "from harness.store.results import Results"),
        ("harness.metrics", "from harness.statistics import bias"),
        ("harness.measure.worker", "def f():\n    from harness.run.sweep import run"),
        ("harness.measure.worker", "from harness import store"),
        ("harness.store.merge", "import harness.analysis.verdicts"),
        ("harness.config.experiment", "if TYPE_CHECKING:\n    from harness.plan.cells import Cell"),
        ("harness.report.tables.model", "from harness.verify.commands.output import table"),
        ("harness.nowhere", ""),
    ],
)
def test_an_import_from_a_floor_above_is_seen(name, line):
    assert imports_upwards(name, line) != []
