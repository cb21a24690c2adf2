"""Certificates: an engine of another lineage makes the same images as the reference's, or does not.

Both render a few images under seeds that the reference has not, and `statistics.equivalence` bounds their difference: a
reference is certified where image mean and tiles lie within the margins. Engines that draw the same random numbers share
their noise, which cancels. The verdict lies beside the reference as `certificate-<engine>.json`; it belongs to that reference
and that version of the other engine alone. What the other engine can afford is planned in `plan.certifiers`.
"""

from __future__ import annotations

import re
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from engines.errors import ConfigError
from harness.hashing import digest
from harness.measure import machine
from harness.measure.pool import WorkerFailed
from harness.plan.certifiers import smaller
from harness.plan.references import REPLICATES, PlannedReference
from harness.run.references import Images, Report, held, replicates
from harness.settings import CellSettings
from harness.statistics import equivalence
from harness.statistics.equivalence import Array
from harness.store import read_json, validation, write_json
from harness.store.records import Certificate

SEEDS_AWAY = 1 << 20
"""The first seed, from the reference's: what is compared is no part of it."""
ALPHA = 1e-3
"""Rate at which an equal image is called different: a reference is judged once, and a sweep has several."""
MOST_SECONDS, FEWEST = 60.0, 3
"""After so many seconds of the certifier's no replicate is begun, once there are that many."""


def path_of(planned: PlannedReference, root: Path) -> Path:
    assert planned.certifier is not None
    return planned.folder(root) / f"certificate-{re.sub('[^A-Za-z0-9_-]+', '-', planned.certifier.engine)}.json"


def spec_of(planned: PlannedReference) -> dict[str, Any]:
    """What a certificate is about, as plain data."""
    certifier = planned.certifier
    assert certifier is not None
    return {
        "reference_id": planned.reference_id,
        "reference_lineage": planned.lineage,
        "engine": certifier.engine,
        "engine_version": certifier.version,
        "lineage": certifier.lineage,
        "factor": certifier.factor,
        "settings": {key: value for key, value in certifier.settings.describe().items() if key != "threads"},
        "replicates": REPLICATES,
        "replicate_spp": certifier.spp,
        "margins": list(planned.margins),
        "alpha": ALPHA,
    }


def existing(planned: PlannedReference, root: Path) -> Certificate | None:
    """The certificate that is there and still answers its spec."""
    path = path_of(planned, root)
    if not path.exists():
        return None
    try:
        found = read_json(path)
        if isinstance(found, dict) and found.get("certificate_id") != digest(spec_of(planned)):
            return None
        certificate = validation.event(found, str(path))
        if not isinstance(certificate, Certificate):
            raise ConfigError(f"{path}: event = {certificate.event!r}: a certificate is expected")
    except (OSError, ConfigError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}: remove it to make it anew") from error
    return certificate


def make(planned: PlannedReference, root: Path, pool: Images, report: Report) -> Certificate:
    """Renders, compares, writes the certificate and returns it. Raises `WorkerFailed`.

    An engine that cannot render the scene is no failure: the verdict is then "impossible". While another process works on the
    same reference this one waits.
    """
    with held(planned, root):
        return existing(planned, root) or _made(planned, root, pool, report)


def _made(planned: PlannedReference, root: Path, pool: Images, report: Report) -> Certificate:
    certifier, spec = planned.certifier, spec_of(planned)
    assert certifier is not None
    spp, compared = REPLICATES * certifier.spp, {}
    if not certifier.why_not:
        theirs = _images(planned, certifier.engine, certifier.settings, certifier.spp, REPLICATES, pool, report)
        ours = _images(
            planned, planned.spec["engine"], smaller(planned.settings, certifier.factor), certifier.spp, len(theirs), pool
        )
        theirs = theirs[: len(ours)]  # time may have allowed fewer of ours
        compared = asdict(equivalence(ours, theirs, planned.margins, ALPHA))
        spp = len(theirs) * certifier.spp
    certificate = Certificate(
        **{**spec, "margins": tuple(planned.margins), "verdict": "impossible", **compared},
        certificate_id=digest(spec),
        scene=planned.scene.name,
        reference_engine=planned.spec["engine"],
        spp=spp,
        width=certifier.settings.width,
        height=certifier.settings.height,
        message=certifier.why_not or "",
        time=datetime.now(UTC).isoformat(timespec="seconds"),
    )
    write_json(path_of(planned, root), {**certificate.model_dump(), "machine": machine.provenance()})
    return certificate


def _images(
    planned: PlannedReference,
    engine: str,
    settings: CellSettings,
    spp: int,
    count: int,
    pool: Images,
    report: Report = lambda done, count: None,
) -> list[Array]:
    """Up to `count` images (h, w, 3), as many as the time allows."""
    first, begun = planned.spec["seed"] + SEEDS_AWAY, monotonic()
    found: list[Array] = []
    report(0, count)
    for film, _ in replicates(planned, range(first, first + count), pool, engine, settings, spp):
        image = film.mean()
        pixels = int((~np.isfinite(image).all(axis=2)).sum())
        if film.bad_samples or pixels:
            bad = f"{pixels} pixels" if pixels else f"{film.bad_samples} samples"
            seed = first + len(found)
            raise WorkerFailed(f"{engine}, seed {seed}: {bad} are NaN or infinite: finite radiance is expected")
        found.append(image)
        report(len(found), count)
        if monotonic() - begun > MOST_SECONDS and len(found) >= FEWEST:
            break
    return found
