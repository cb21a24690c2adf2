"""Results folders that somebody has tampered with: a whole one, ways to change it, and everything that reads it."""

from __future__ import annotations

import contextlib
import copy
import io
import json
import random
import shutil
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from engines.errors import RaybenchError
from harness import store

WRONG = (
    None,
    True,
    False,
    -1,
    0,
    1,
    3,
    -1.5,
    0.5,
    1e-300,
    1e300,
    float("nan"),
    float("inf"),
    2**70,
    "",
    "x",
    "0",
    "../../..",
    "/etc/passwd",
    "a/../b",
    "images",
    "a\x00b",
    "\ud800",
    [],
    {},
    [1],
    ["x"],
    {"name": "x"},
    {"x": [None]},
    [[[[[[]]]]]],
)
"""What is put in place of a value."""


def write_whole(folder: Path) -> Path:
    """A small results folder in which every kind of event stands."""
    from harness.analysis import analyse, archived_verdicts
    from harness.store.events import line_of
    from harness.store.results import load_results
    from tests.harness.synthetic import Size, write_folder

    write_folder(folder, Size(16, 12), seeds=2, threads=(1,))
    lines = [json.loads(line) for line in (folder / store.EVENTS).read_text().splitlines()]
    kept = [event for event in lines if event["event"] != "cell" or _is_kept(event)]
    for point in (point for event in kept for point in event.get("points", []) if point["spp"] not in (4, 64)):
        point["image"] = None
    named = {point["image"] for event in kept for point in event.get("points", [])}
    for images in folder.glob("images/*"):
        for image in images.iterdir():
            if str(image.relative_to(folder)) not in named:
                image.unlink()
        if not any(images.iterdir()):
            images.rmdir()
    cell = next(event for event in kept if event["event"] == "cell")
    reference = next(event for event in kept if event["event"] == "reference")
    verdict = {
        "difference": 1e-4,
        "low": -1e-3,
        "high": 1e-3,
        "image_bound": 1e-3,
        "tile_bound": 0.02,
        "worst_tile": [0, 0],
        "image_margin": 0.005,
        "tile_margin": 0.05,
        "same_pixels": 0.1,
        "verdict": "equivalent",
        "alpha": 1e-3,
    }
    finding = {
        "engine": "numba",
        "version": "1",
        "precision": "float64",
        "tracing": "float64",
        "accelerator": "bvh",
        "section": "stability",
        "case": "sphere-distance",
        "description": "?",
        "source": "here",
        "parameter": "t, 1e3",
        "count": 100,
        "error": 1e-9,
        "unit": "1",
        "tolerance": 1e-6,
        "outcome": "pass",
        "median_ulp": 0.5,
        "p999_ulp": 1.0,
        "worst_ulp": 2.0,
        "seconds": 0.1,
        "note": "",
        "median_error": 1e-10,
    }
    kept += [
        {"event": "environment", "env_id": "env0", "preimage": {"cpu": "One", "usable_cores": 2, "libraries": {"a": "1"}}},
        {"event": "start", "cell_id": cell["cell_id"], "time": "2026-01-01"},
        {
            "event": "certificate",
            "certificate_id": "c0",
            "reference_id": reference["reference_id"],
            "engine": "numpy",
            "scene": "cornell_box",
            "spp": 64,
            "message": "",
            "lineage": "raybench-numpy",
            "reference_lineage": "raybench-kernels",
            "width": 16,
            "height": 12,
            **verdict,
        },
        {
            "event": "verify_job",
            "verify_job_id": "x0",
            "spec": {"case": "sphere-distance"},
            "env_id": "env0",
            "state": "done",
            "message": "",
            "results": [finding],
            "wall_seconds": 1.0,
            "time": "2026-01-01",
        },
    ]
    write_events(folder, kept)
    manifest = json.loads((folder / store.MANIFEST).read_text())
    ids = [event["cell_id"] for event in kept if event["event"] == "cell"]
    include = [{"scene": name, "engine": "numba"} for name in ("cornell_box", "two_spheres")]
    manifest |= {"name": "synthetic", "cell_ids": ids, "verify_job_ids": ["x0"]}
    manifest["config"] |= {"include": include, "baseline": "numba"}
    (folder / store.MANIFEST).write_text(json.dumps(manifest))
    write_events(folder, [*kept, json.loads(line_of(archived_verdicts.archived(analyse(load_results(folder)))))])
    return folder


def _is_kept(event: dict[str, Any]) -> bool:
    return event["sampler"]["name"] == "random" and (event["scene"] == "cornell_box" or event["engine"] != "numpy")


def write_events(folder: Path, events: list[Any]) -> None:
    (folder / store.EVENTS).write_text("".join(json.dumps(event) + "\n" for event in events))


# --- changes --------------------------------------------------------------------------------------------------------


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """(container, key) of everything inside a tree of lists and mappings."""
    for key in list(value) if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], (dict, list)):
            yield from places(value[key])


def changed(tree: Any, draw: random.Random) -> Any:
    """A copy of a JSON tree with one thing in it changed."""
    made = copy.deepcopy(tree)
    spots = list(places(made))
    container, key = draw.choice(spots)
    kind = draw.choice(["wrong", "wrong", "wrong", "delete", "swap", "rename", "scale"])
    if kind == "delete":
        del container[key]
    elif kind == "swap":
        other, place = draw.choice(spots)
        container[key] = copy.deepcopy(other[place])
    elif kind == "rename" and isinstance(container, dict):
        container[f"{key}x"] = container.pop(key)
    elif kind == "scale" and isinstance(container[key], (int, float)):
        container[key] = draw.choice([-1, 0, 1000, 1e-9]) * container[key]
    else:
        container[key] = copy.deepcopy(draw.choice(WRONG))
    return made


def mutate(folder: Path, draw: random.Random) -> str:
    """Changes a folder's events or manifest in place; what was done, in words."""
    events = [json.loads(line) for line in (folder / store.EVENTS).read_text().splitlines()]
    if draw.random() < 0.2:
        path = folder / store.MANIFEST
        path.write_text(json.dumps(changed(json.loads(path.read_text()), draw)))
        return "manifest"
    # Kinds of events are drawn first: there are many more cells than others.
    kind = draw.choice(sorted({event["event"] for event in events}))
    index = draw.choice([i for i, event in enumerate(events) if event["event"] == kind])
    did = draw.choice(["change"] * 17 + ["twice", "gone", "first"])
    if did == "change":
        events[index] = changed(events[index], draw)
    elif did == "twice":
        events.insert(index, copy.deepcopy(events[index]))
    elif did == "gone":
        del events[index]
    else:
        events.insert(0, events.pop(index))
    write_events(folder, events)
    return f"{kind} {did}"


# --- readers --------------------------------------------------------------------------------------------------------


def report(folder: Path, other: Path, scratch: Path) -> None:
    from harness.analysis import analyse
    from harness.report.html.assembly import report_html
    from harness.report.tables import write_tables
    from harness.store.results import load_results

    analysis = analyse(load_results(folder))
    report_html(analysis, write_tables(analysis, folder), []).encode()


def status(folder: Path, other: Path, scratch: Path) -> None:
    from harness.cli import experiments

    with contextlib.redirect_stdout(io.StringIO()):
        experiments.status(folder)


def compare(folder: Path, other: Path, scratch: Path) -> None:
    from harness.cli import results

    with contextlib.redirect_stdout(io.StringIO()):
        results.compare([other], [folder], True, scratch / "changes.csv", None)


def merge(folder: Path, other: Path, scratch: Path) -> None:
    from harness.store.merge import merge as merged

    merged([folder, other], scratch / "merged")


def archive(folder: Path, other: Path, scratch: Path) -> None:
    from harness.report.archive import archive as archived

    archived(folder, scratch / "archived")


def rescore(folder: Path, other: Path, scratch: Path) -> None:
    from harness.run.rescore import rescore as again

    again(folder)


READERS: tuple[Callable[[Path, Path, Path], None], ...] = (report, status, compare, merge, archive, rescore)
"""`rescore` comes last: it changes the folder."""


def outcomes(whole: Path, work: Path, seed: int, readers: Any = READERS) -> Iterator[tuple[str, str, str]]:
    """(what was changed, who read it, the refusal or nothing) of one mutant. What no refusal is comes out."""
    folder, scratch = work / "mutant", work / "scratch"
    for place in (folder, scratch):
        shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(whole, folder)
    scratch.mkdir()
    did = mutate(folder, random.Random(seed))
    for reader in readers:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                reader(folder, whole, scratch)
                said = ""
            except RaybenchError as error:
                said = str(error)
            except Exception as error:
                error.add_note(f"seed {seed}: {did}, read by {reader.__name__}")
                raise
        yield did, reader.__name__, said
