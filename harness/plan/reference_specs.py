"""The references of an experiment: which engine makes each, with which settings and how many samples, and what certifies it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from engines.choices import SAMPLERS, Choice, resolve
from engines.registry import lineage_of
from engines.scene import Scene
from harness.config import SCHEMA_VERSION, Experiment
from harness.config.sections import AUTOMATIC, REFERENCE_ENGINE
from harness.config.settings import SceneFile
from harness.measure.machine import usable_cores
from harness.metrics import as_error
from harness.plan import answers, certifiers
from harness.plan.cells import Cell, flow
from harness.plan.loaded import Loaded
from harness.plan.references import Certifier, PlannedReference
from harness.settings import CellSettings
from harness.source_hashes import plugin_codes
from harness.statistics.reference_noise import SAMPLES_KNOWN

DEFAULT_SPP = 8192
"""Of a reference where neither the config nor its targets say how many, and the most that its certifier renders."""


def reference_of(
    experiment: Experiment, file: SceneFile, scene: Scene, settings: CellSettings, known: Loaded
) -> tuple[PlannedReference | None, str | None]:
    """The reference of a scene, shader and size; or why no engine that may can make it. Where the default engine cannot, the
    only one of the experiment that can does."""
    name = known.reference_engine
    planned, why_not = _reference_by(name, experiment, file, scene, settings, known)
    if planned is None:
        reasons = [f"no reference by {name}: {why_not}"]
        able: list[PlannedReference] = []
        for other in known.in_its_place:
            found, why_not = None, _may_not_replace(other, experiment, known)
            if not why_not:
                found, why_not = _reference_by(other, experiment, file, scene, settings, known)
            if found is None:
                reasons.append(f"no reference by {other}: {why_not}")
            else:
                able.append(found)
        if len(able) > 1:
            names = " and ".join(each.spec["engine"] for each in able)
            reasons.append(f"{names} can make it: reference.engine must name one")
        if len(able) != 1:
            return None, "; ".join(reasons)
        (planned,) = able
    return replace(planned, certifier=_certifier(experiment, scene, planned, known)), None


def _may_not_replace(name: str, experiment: Experiment, known: Loaded) -> str | None:
    """Why an engine that the config does not name for references makes none, whatever the scene."""
    engine, given = known.engines[name], experiment.reference
    if not answers.resolves(engine, given.accelerator):
        return f"it has no accelerator {flow(given.accelerator)}"
    if given.certify in known.engines and lineage_of(known.engines[given.certify]) == lineage_of(engine):
        return f"it is of the lineage of {given.certify}, which certifies"
    return None


def _reference_by(
    name: str, experiment: Experiment, file: SceneFile, scene: Scene, settings: CellSettings, known: Loaded
) -> tuple[PlannedReference | None, str | None]:
    """The reference by an engine, not yet certified; or why it cannot make it. A sampler that no config names may be
    independent numbers, too."""
    given = experiment.reference
    engine = known.engines[name]
    settings = replace(
        settings,
        precision=given.precision or "float64",
        threads=1,
        sampler=given.sampler,
        shader=known.completed("shader", given.shader or settings.shader),
        accelerator=answers.resolved(engine, given.accelerator),
    )
    if given.precision is None:
        settings = replace(settings, precision=answers.precision(engine, scene, settings, known.allow_imports))
    why_not = answers.why_not(engine, scene, settings, known.allow_imports)
    if why_not and given.engine is None and name != REFERENCE_ENGINE:
        settings = replace(settings, sampler=resolve("sampler", "random", SAMPLERS))
        why_not = answers.why_not(engine, scene, settings, known.allow_imports)
    if why_not:
        return None, why_not
    until = _until(experiment)
    if given.spp is None and until is None:
        given = replace(given, spp=DEFAULT_SPP)
    each, count = given.replicates
    plain = settings.describe()
    spec = {
        "schema": SCHEMA_VERSION,
        "scene": scene.identity,
        "engine": name,
        "engine_version": str(engine.version),
        "replicate_spp": each,
        "replicates": count,
        **({"until": until} if given.spp is None else {}),
        "seed": given.seed,
        **{key: value for key, value in plain.items() if key != "threads"},
    }
    spec["code"] = {"engine": known.code(name), **plugin_codes(plain)}
    settings = replace(settings, threads=given.threads or len(usable_cores()))
    margins = experiment.equivalence.margins
    return PlannedReference(file, scene.identity, spec, settings, lineage_of(engine), margins=margins), None


def _until(experiment: Experiment) -> dict[str, Any] | None:
    """What decides the samples of a reference whose number is not given; None where no formula does."""
    quality, most = experiment.quality, experiment.reference.max_time_seconds
    if quality.targets is None or quality.metric not in SAMPLES_KNOWN:
        return None
    return {
        "metric": quality.metric,
        "epsilon": quality.epsilon if quality.metric == "relmse" else None,
        "target": min(as_error(quality.metric, target) for target in quality.targets),
        **({} if most is None else {"max_seconds": most}),
    }


def by_id(experiment: Experiment, found: Iterable[tuple[Cell, PlannedReference | None]]) -> dict[str, PlannedReference]:
    """The references by id, each with the time that it may take: that of the config, else that of its cells."""
    references: dict[str, PlannedReference] = {}
    for cell, wanted in found:
        if wanted is not None:
            before = references.get(wanted.reference_id)
            seconds = cell.budget.max_time_seconds * experiment.repeats + (before.max_seconds if before else 0.0)
            references[wanted.reference_id] = replace(wanted, max_seconds=seconds)
    given = experiment.reference.max_time_seconds
    return {key: each if given is None else replace(each, max_seconds=given) for key, each in references.items()}


def _certifier(experiment: Experiment, scene: Scene, wanted: PlannedReference, known: Loaded) -> Certifier | None:
    """The engine that the config names, or the first able one of another lineage."""
    name, width, height = experiment.reference.certify, wanted.spec["width"], wanted.spec["height"]
    if name is None:
        return None
    if name == AUTOMATIC:
        names = certifiers.candidates(width, height)
        return certifiers.first_able(names, wanted.lineage, lambda name: _as_certifier(name, scene, wanted, known))
    engine, by = known.engines[name], wanted.spec["engine"]
    where = f"{experiment.source} reference.certify"
    certifiers.refuse_own_lineage(where, engine, name, known.engines[by], by)
    return _as_certifier(name, scene, wanted, known)


def _as_certifier(name: str, scene: Scene, wanted: PlannedReference, known: Loaded) -> Certifier | None:
    """How an engine would certify: its own accelerator and precision; None where it cannot be loaded."""
    engine = known.candidate(name)
    if engine is None:
        return None
    lineage = lineage_of(engine)
    spp = DEFAULT_SPP if wanted.until else wanted.spp
    share = certifiers.share(lineage, wanted.spec["width"], wanted.spec["height"], spp)
    given = certifiers.smaller(wanted.settings, share.factor)
    given = replace(given, accelerator=answers.resolved(engine, Choice("auto")))
    why_not: str | None = None
    for sampler in (given.sampler, *certifiers.samplers(share.spp)):
        given = replace(given, sampler=sampler)
        given = replace(given, precision=answers.precision(engine, scene, given, known.allow_imports))
        why_not = answers.why_not(engine, scene, given, known.allow_imports)
        if why_not is None:
            break
    return Certifier(name, lineage, f"{engine.version}+{known.code(name)[:8]}", given, share.spp, share.factor, why_not)
