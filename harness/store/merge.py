"""One results folder from those of several machines. Machines stay apart: in names, in panels, under a banner.

A cell's id is a hash of its spec, not of where it was measured: merged cells get ids of both, and keep their own as
`measured_as`. The merged folder holds copies of images and references, and stands on its own.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from harness import store
from harness.hashing import digest
from harness.store import atomic, reference_files
from harness.store.results import Results, load_results, settings_of
from harness.store.validation import FORMAT_VERSION

Owned = tuple[Results, Mapping[str, Any]]


def merge(folders: Sequence[Path], out: Path) -> dict[str, int]:
    """Writes manifest, events, images and references into the empty folder `out`; measured cells by environment id.

    Raises `ConfigError` where metrics differ, or where one configuration was measured under different conditions
    (budget, engine version) on one machine.
    """
    if out.exists() and any(path.name != store.LOCK for path in out.iterdir()):
        raise ConfigError(f"{out}: is not empty: --out must be a new folder")
    sources = [load_results(folder) for folder in folders]
    for source in sources[1:]:
        if source.metric != sources[0].metric:
            raise ConfigError(
                f"{source.folder}: its metric is {source.metric}, that of {sources[0].folder} {sources[0].metric}: "
                "results of different metrics cannot stand in one report"
            )
    cells = _cells(sources)
    _refuse_mixtures(cells.values())
    try:
        _write(sources, list(cells.values()), out)
    except BaseException:
        _empty(out)  # half a merged folder would pass for a whole one
        raise
    counts: dict[str, int] = {}
    for _, cell in cells.values():
        counts[str(cell.get("env_id"))] = counts.get(str(cell.get("env_id")), 0) + (cell["state"] == "done")
    return counts


def _write(sources: Sequence[Results], cells: Sequence[Owned], out: Path) -> None:
    with store.Events(out) as events:
        for event in _preamble(sources, out):
            events.append(event)
        for source, cell in cells:
            events.append(_copied(source, cell, out))
    store.write_json(out / store.MANIFEST, _manifest(sources, [_new_id(cell) for _, cell in cells]))


def _empty(out: Path) -> None:
    for path in out.iterdir() if out.is_dir() else ():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif path.name != store.LOCK:
            path.unlink(missing_ok=True)


def _cells(sources: Sequence[Results]) -> dict[str, Owned]:
    """Every cell once, by its new id; of a cell that two folders have from one machine the younger."""
    found: dict[str, Owned] = {}
    for source in sources:
        for cell in source.cells:
            known = found.get(_new_id(cell))
            if known is None or str(cell.get("time")) > str(known[1].get("time")):
                found[_new_id(cell)] = source, cell
    return found


def _new_id(cell: Mapping[str, Any]) -> str:
    return digest([cell["cell_id"], str(cell.get("env_id"))])


def _refuse_mixtures(cells: Any) -> None:
    seen: dict[Any, Owned] = {}
    for source, cell in cells:
        other, twin = seen.setdefault((settings_of(cell), cell.get("block")), (source, cell))
        if twin is not cell:
            mine, theirs = cell.get("spec") or {}, twin.get("spec") or {}
            differing = sorted(key for key in {*mine, *theirs} if mine.get(key) != theirs.get(key))
            raise ConfigError(
                f"{source.folder} and {other.folder}: {cell['scene']} {cell['engine']}, block {cell.get('block')}, was "
                f"measured on one machine under different conditions ({', '.join(differing) or 'cell ids'})"
            )


def _preamble(sources: Sequence[Results], out: Path) -> list[dict[str, Any]]:
    """The events that are no cells: runs, environments, targets, references."""
    found: dict[str, dict[str, Any]] = {}
    for source in sources:
        for event in store.read_events(source.folder):
            if event["event"] in ("run", "environment", "certificate", "verify_job"):
                found.setdefault(json.dumps(event, sort_keys=True), event)
    targets = sorted({target for source in sources for target in source.targets}, reverse=True)
    known: dict[str, dict[str, Any]] = {}
    for source in sources:
        for reference_id, event in source.references.items():
            if reference_id not in known:
                reference_files.carry(source.folder, event, out, small=False)
                known[reference_id] = {key: value for key, value in event.items() if key != "folder"}
    goals = {"event": "targets", "metric": sources[0].metric, "targets": targets}
    return [*found.values(), goals, *known.values()]


def _copied(source: Results, cell: Mapping[str, Any], out: Path) -> dict[str, Any]:
    """The cell's event under its new id, its images copied."""
    points = []
    for point in cell.get("points") or []:
        image = store.image_path(_new_id(cell), point["spp"]) if point["image"] else None
        if image is not None and (taken := store.image_file(source.folder, point["image"])).is_file():
            with atomic.replacing(out / image, durable=False) as file:
                file.write(taken.read_bytes())
        points.append({**point, "image": image})
    return {**cell, "cell_id": _new_id(cell), "measured_as": cell["cell_id"], "points": points}


def _manifest(sources: Sequence[Results], cell_ids: list[str]) -> dict[str, Any]:
    """A manifest that holds those of all folders; its own config is the first one's."""
    first = sources[0].manifest
    return {
        "raybench_results": FORMAT_VERSION,
        "name": str(first.get("name") or sources[0].folder.name),
        "config": first.get("config") or {},
        "cell_ids": cell_ids,
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "merged": [{"folder": source.folder.name, **source.manifest} for source in sources],
    }
