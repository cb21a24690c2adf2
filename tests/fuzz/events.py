"""Results folders: damaged `events.jsonl` and `manifest.json`, read as `raybench report` reads them, plots aside."""

from __future__ import annotations

import json
import tempfile
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from harness.analysis import analyse
from harness.report.html.assembly import report_html
from harness.report.tables import write_tables
from harness.store.results import load_results
from tests.fuzz.mutate import mutated_bytes, mutated_text, mutated_tree
from tests.harness.synthetic import Size, write_folder

BESIDES = [
    {"event": "environment", "env_id": "env0", "preimage": {"cpu": "a CPU", "usable_cores": 2, "python": "3.12"}},
    {
        "event": "certificate",
        "reference_id": "r",
        "certificate_id": "c",
        "verdict": "impossible",
        "message": "no planes",
        "engine": "numpy",
        "reference_engine": "embree",
        "lineage": "raybench-numpy",
        "reference_lineage": "raybench-kernels",
        "width": 4,
        "height": 4,
        "spp": 64,
        "scene": "cornell_box",
    },
]
"""Events that the synthetic folder lacks."""


@cache
def whole() -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Events and manifest of a small folder: one scene, two seeds, no images."""
    with tempfile.TemporaryDirectory() as name:
        folder = write_folder(Path(name) / "run", Size(4, 4), seeds=2, with_images=False, threads=(1,))
        events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
        manifest = json.loads((folder / "manifest.json").read_text())
    return [*BESIDES, *(event for event in events if event.get("scene") != "two_spheres")], manifest


def write(random: Random, folder: Path) -> None:
    """A folder with both files, one of them damaged."""
    events, manifest = whole()
    damage_manifest = random.random() < 0.2
    content, name = (manifest, "manifest.json") if damage_manifest else (events, "events.jsonl")
    way = random.randrange(4)
    if way < 2:
        content = mutated_tree(random, content)
    text = json.dumps(content, indent=1) if damage_manifest else _lines(content)
    data = text.encode()
    if way == 2:
        data = mutated_text(random, text).encode()
    elif way == 3:
        data = mutated_bytes(random, data)
    (folder / "events.jsonl").write_text(_lines(events))
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (folder / name).write_bytes(data)


def _lines(events: list[Any]) -> str:
    return "".join(json.dumps(event) + "\n" for event in events)


def read(folder: Path) -> None:
    """Everything that `raybench report` makes of them but the plots."""
    analysis = analyse(load_results(folder))
    report_html(analysis, write_tables(analysis, folder), [])
