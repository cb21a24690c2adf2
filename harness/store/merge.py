"""One results folder from those of several machines. Machines stay apart: in names, in panels, under a banner.

A cell's id is a hash of its spec, not of where it was measured: merged cells get ids of both, and keep their own as
`measured_as`. The merged folder holds copies of images and references, and stands on its own.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from engines.errors import ConfigError
from harness import store
from harness.hashing import digest
from harness.store import atomic, reference_files
from harness.store.events import line_of
from harness.store.records import (
    AnyCell,
    AnyEvent,
    Cell,
    Certificate,
    Environment,
    Manifest,
    Reference,
    Run,
    Targets,
    VerifyJob,
)
from harness.store.results import Results, load_results
from harness.store.validation import FORMAT_VERSION

Owned = tuple[Results, AnyCell]
KEPT = (Run, Environment, Certificate, VerifyJob)


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
    counts: Counter[str] = Counter()
    for _, cell in cells.values():
        counts[cell.env_id] += cell.state == "done"
    return dict(counts)


def _write(sources: Sequence[Results], cells: Sequence[Owned], out: Path) -> None:
    with store.Events(out) as events:
        for event in _preamble(sources, out):
            events.append(event)
        for source, cell in cells:
            events.append(_copied(source, cell, out))
    store.write_manifest(out, _manifest(sources, [_new_id(cell) for _, cell in cells]))


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
        for cell in source.all_cells:
            known = found.get(_new_id(cell))
            if known is None or cell.time > known[1].time:
                found[_new_id(cell)] = source, cell
    return found


def _new_id(cell: AnyCell) -> str:
    return digest([cell.cell_id, cell.env_id])


def _refuse_mixtures(cells: Iterable[Owned]) -> None:
    seen: dict[object, Owned] = {}
    for source, cell in cells:
        other, twin = seen.setdefault((cell.settings, cell.block), (source, cell))
        if twin is not cell:
            mine, theirs = cell.spec, twin.spec
            differing = sorted(key for key in {*mine, *theirs} if mine.get(key) != theirs.get(key))
            raise ConfigError(
                f"{source.folder} and {other.folder}: {cell.scene} {cell.engine}, block {cell.block}, was "
                f"measured on one machine under different conditions ({', '.join(differing) or 'cell ids'})"
            )


def _preamble(sources: Sequence[Results], out: Path) -> list[AnyEvent]:
    """The events that are no cells: runs, environments, targets, references."""
    found: dict[bytes, AnyEvent] = {}
    for source in sources:
        for event in store.read_events(source.folder):
            if isinstance(event, KEPT):
                found.setdefault(line_of(event), event)
    targets = tuple(sorted({target for source in sources for target in source.targets}, reverse=True))
    known: dict[str, Reference] = {}
    for source in sources:
        for reference_id, reference in source.references.items():
            if reference_id not in known:
                reference_files.carry(source.folder, reference, out, small=False)
                known[reference_id] = reference
    return [*found.values(), Targets(metric=sources[0].metric, targets=targets), *known.values()]


def _copied(source: Results, cell: AnyCell, out: Path) -> AnyCell:
    """The cell's event under its new id, its images copied."""
    if not isinstance(cell, Cell):
        return cell.replaced(cell_id=_new_id(cell), measured_as=cell.cell_id)
    points = []
    for point in cell.points:
        image = store.image_path(_new_id(cell), point.spp) if point.image else None
        if point.image and image and (taken := store.image_file(source.folder, point.image)).is_file():
            with atomic.replacing(out / image, durable=False) as file:
                file.write(taken.read_bytes())
        points.append(point.replaced(image=image))
    return cell.replaced(cell_id=_new_id(cell), measured_as=cell.cell_id, points=tuple(points))


def _manifest(sources: Sequence[Results], cell_ids: Sequence[str]) -> Manifest:
    """A manifest that holds those of all folders; its own config is the first one's."""
    first = sources[0].manifest
    return Manifest(
        raybench_results=FORMAT_VERSION,
        name=first.name or sources[0].folder.name,
        config=first.config,
        cell_ids=tuple(cell_ids),
        time=datetime.now(UTC).isoformat(timespec="seconds"),
        merged=tuple({"folder": source.folder.name, **source.manifest.model_dump(exclude_unset=True)} for source in sources),
    )
