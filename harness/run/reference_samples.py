"""Whether the references of an experiment have samples enough for its smallest target: said by `plan`, and by `run`."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from engines.errors import ConfigError
from harness.config import Quality
from harness.metrics import Reference, as_error, metric_title
from harness.plan.references import PlannedReference
from harness.run.progress import duration
from harness.run.references import is_final, pilot_in
from harness.statistics.reference_noise import SAMPLES_KNOWN, TAILS, samples_needed
from harness.store.reference_files import META, film_in, meta_of

SAME = ("width", "height", "shader", "sampler")
"""Keys of a spec in which references of one image, each sample as noisy, agree."""


class Sufficiency(NamedTuple):
    """`enough` is None where it is not known; `message` is a clause for people."""

    enough: bool | None
    message: str


def sufficiency(planned: PlannedReference, root: Path, quality: Quality) -> Sufficiency:
    """Compares a reference's samples with those that its noise asks for at the smallest target.

    The noise is known from the reference itself, finished or not, or from another one of the same image; nothing is rendered.
    """
    if quality.targets is None:
        return Sufficiency(None, "samples needed: not known before the targets, which are chosen from the first results")
    title = metric_title(quality.name)
    if quality.metric not in SAMPLES_KNOWN:
        return Sufficiency(None, f"samples needed: not known for {title}; every time to quality is checked against its halves")
    target = min(as_error(quality.metric, each) for each in quality.targets)
    pilot, spp = pilot_of(planned, root), spp_of(planned, root)
    if pilot is None and spp is None:
        most = duration(planned.max_seconds)
        return Sufficiency(None, f"as many samples as the target {target:g} in {title} needs, in at most about {most}")
    if pilot is None:
        return Sufficiency(None, f"samples needed for the target {target:g} in {title}: not known before its first replicates")
    needed = samples_needed(pilot, target, quality.epsilon if quality.metric == "relmse" else None)
    if spp is None:
        return Sufficiency(
            None, f"the target {target:g} in {title} needs about {needed:,} samples, {_time(planned, root, needed)}"
        )
    if needed <= spp:
        return Sufficiency(True, f"enough samples: the target {target:g} in {title} needs about {needed:,}")
    by = "reference.spp" if planned.until is None else "reference.max_time"
    return Sufficiency(
        False,
        f"too few samples: the target {target:g} in {title} needs about {needed:,}, and {by} allows {spp:,}; times that its "
        "noise affects are flagged",
    )


def pilot_of(planned: PlannedReference, root: Path) -> Reference | None:
    """The image's reference with the most samples so far, from the cache; None where none has two replicates."""
    found: tuple[int, Path] | None = None
    for path in sorted(planned.folder(root).parent.glob(f"*/{META}")):
        try:
            meta = meta_of(path.parent)
        except ConfigError:
            continue
        spec, spp = meta.spec.preimage, meta.done * meta.spec.replicate_spp
        same = all(spec.get(key) == planned.spec[key] for key in SAME)
        if same and meta.done >= 2 and (found is None or spp > found[0]):
            found = spp, path.parent
    if found is None:
        return None
    try:
        film = film_in(found[1], meta_of(found[1]))
    except ConfigError:
        return None
    return pilot_in(film, found[0] // film.spp)


def _time(planned: PlannedReference, root: Path, needed: int) -> str:
    """How long a reference of so many samples takes, as far as that is known."""
    try:
        meta = meta_of(planned.folder(root))
    except ConfigError:
        return f"in at most about {duration(planned.max_seconds)}"
    seconds = meta.seconds * max(TAILS * needed, planned.spp) / (meta.done * meta.spec.replicate_spp)
    return f"about {duration(min(planned.max_seconds, seconds))} in all"


def spp_of(planned: PlannedReference, root: Path) -> int | None:
    """Samples per pixel of a reference; None where they are as many as it needs, and it is not finished or will be extended."""
    if planned.until is None:
        return planned.spp
    try:
        meta = meta_of(planned.folder(root))
    except ConfigError:
        return None
    return meta.done * meta.spec.replicate_spp if is_final(planned, meta) else None
