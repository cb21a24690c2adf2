"""Certificates: a second engine makes the reference's image anew, from other random numbers, and the two are compared.

The first replicates of the reference are rendered again, as many by the second engine under seeds of its own, and
`statistics.equivalence` judges. The verdict lies beside the reference as `certificate-<engine>.json`; it belongs to that
reference and that version of the second engine alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from engines.errors import ConfigError
from harness.hashing import digest
from harness.measure import machine
from harness.measure.pool import WorkerFailed
from harness.plan.references import PlannedReference
from harness.run.references import Images, Report, held, replicates
from harness.statistics import equivalence
from harness.store import read_json, validation, write_json

MOST_REPLICATES = 8
SEEDS_AWAY = 1 << 20
"""The second engine's first seed, from the reference's: engines that share kernels must not share samples."""
ALPHA = 1e-3
"""False alarms of each scale: a reference is judged once, and a sweep has several."""


def path_of(wanted: PlannedReference, root: Path) -> Path:
    assert wanted.certifier is not None
    return wanted.folder(root) / f"certificate-{re.sub('[^A-Za-z0-9_-]+', '-', wanted.certifier.engine)}.json"


def spec_of(wanted: PlannedReference) -> dict[str, Any]:
    """What a certificate is about, as plain data."""
    certifier = wanted.certifier
    assert certifier is not None
    return {
        "reference_id": wanted.reference_id, "engine": certifier.engine, "engine_version": certifier.version,
        "settings": {key: value for key, value in certifier.settings.items() if key != "threads"},
        "replicates": min(MOST_REPLICATES, wanted.spec["replicates"]), "alpha": ALPHA,
    }  # fmt: skip


def existing(wanted: PlannedReference, root: Path) -> dict[str, Any] | None:
    """The certificate that is there and still answers its spec, as an event."""
    path = path_of(wanted, root)
    if not path.exists():
        return None
    try:
        found = read_json(path)
        validation.event(found, str(path))
    except (OSError, ConfigError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}: remove it to make it anew") from error
    return found if found.get("certificate_id") == digest(spec_of(wanted)) else None


def make(wanted: PlannedReference, root: Path, pool: Images, report: Report) -> dict[str, Any]:
    """Renders, compares, writes the certificate and returns it as an event. Raises `WorkerFailed`.

    A second engine that cannot render the scene is no failure: the verdict is then "impossible". While another process
    works on the same reference this one waits.
    """
    with held(wanted, root):
        return existing(wanted, root) or _made(wanted, root, pool, report)


def _made(wanted: PlannedReference, root: Path, pool: Images, report: Report) -> dict[str, Any]:
    certifier, spec = wanted.certifier, spec_of(wanted)
    assert certifier is not None
    event: dict[str, Any] = {
        "event": "certificate", "certificate_id": digest(spec), **spec, "scene": wanted.scene_name,
        "reference_engine": wanted.spec["engine"], "spp": spec["replicates"] * wanted.spec["replicate_spp"],
        "message": certifier.why_not or "", "time": datetime.now(UTC).isoformat(timespec="seconds"),
    }  # fmt: skip
    if certifier.why_not:
        event["verdict"] = "impossible"
    else:
        count, seed = spec["replicates"], wanted.spec["seed"]
        ours = _images(replicates(wanted, range(seed, seed + count), pool), report, 0, count)
        again = range(seed + SEEDS_AWAY, seed + SEEDS_AWAY + count)
        theirs = _images(
            replicates(wanted, again, pool, certifier.engine, certifier.settings), report, count, count
        )
        event.update(asdict(equivalence(ours, theirs, alpha=ALPHA)))
    write_json(path_of(wanted, root), {**event, "machine": machine.provenance()})
    return event


def _images(films: Iterator[tuple[Any, float]], report: Report, before: int, count: int) -> np.ndarray:
    """(count, h, w, 3) finite images."""
    found = []
    report(before, 2 * count)
    for film, _ in films:
        found.append(film.mean())
        report(before + len(found), 2 * count)
    images = np.stack(found)
    if not np.isfinite(images).all():
        raise WorkerFailed("certificate: an engine's image is not finite")
    return images


def words(event: dict[str, Any]) -> str:
    """A certificate in a sentence."""
    by = f"{event['engine']} ({event['spp']} spp)"
    if event["verdict"] == "impossible":
        return f"not certified: {event['message']}"
    means = (
        f"image means differ by {100 * event['difference']:.2g} % [{100 * event['low']:.2g}, {100 * event['high']:.2g}]"
    )
    if event["verdict"] == "equivalent":
        return f"certified by {by}: {means}"
    if event["verdict"] == "different":
        return f"NOT certified: {by} makes another image: {means}"
    return f"not certified: {by} is inconclusive, more samples are needed: {means}"
