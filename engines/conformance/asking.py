"""Claims about what an engine says: its name, what it accepts, what it refuses and how, its counters."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from engines.choices import SAMPLERS as KNOWN_SAMPLERS
from engines.choices import SHADERS as KNOWN_SHADERS
from engines.choices import Option
from engines.conformance.stage import ROOM, TRIANGLES, plane, rectangle, scene, sphere
from engines.conformance.subject import BASE, SAMPLERS, Broken, Subject, expect
from engines.errors import ConfigError, UnknownName, Unsupported
from engines.interface import Engine, FullPattern, HasPatterns, Renderer, Settings
from engines.scene import Scene

COUNTERS = ("build_seconds", "compile_seconds", "accelerator_bytes", "bad_samples")


def the_engine_says_what_it_is(subject: Subject) -> None:
    """An engine has a name, a version, and accelerators whose options are described."""
    engine = subject.engine
    for name in ("name", "version"):
        expect(isinstance(getattr(engine, name), str) and getattr(engine, name), f"{name} = {getattr(engine, name)!r}")
    for accelerator, options in engine.accelerators().items():
        expect(accelerator and isinstance(accelerator, str), f"an accelerator is called {accelerator!r}")
        for key, option in options.items():
            where = f"accelerator {accelerator}, option {key}"
            expect(isinstance(option, Option), f"{where}: a {type(option).__name__}, not an engines.choices.Option")
            expected = option.check(option.default)
            expect(expected is None, f"{where}: the default {option.default!r} must be {expected}")


def _unknown(subject: Subject) -> Iterator[tuple[dict[str, Any], str]]:
    """Settings with a wrong name, and the name that is meant."""
    yield {"shader": "path_tracr"}, "path_tracer"
    yield {"sampler": "soboll"}, "sobol"
    yield {"shader": {"name": "path_tracer", "max_dept": 3}}, "max_depth"
    yield {"sampler": {"name": "constant", "valu": 0.5}}, "value"
    for name, options in subject.engine.accelerators().items():
        yield {"accelerator": name + "x"}, name
        for option in options:
            yield {"accelerator": {"name": name, option + "x": 1}}, option


def unknown_names_are_refused(subject: Subject) -> None:
    """An unknown shader, sampler, accelerator or option raises UnknownName, from why_not as from prepare."""
    held, accepted = subject.easiest
    for wrong, meant in _unknown(subject):
        settings = Settings(**{**BASE, **accepted, **wrong})
        _expect_raised(subject.engine, held, settings, wrong, UnknownName, meant)


def values_out_of_range_are_refused(subject: Subject) -> None:
    """A value outside its option's range raises ConfigError, which names the option, from why_not as from prepare."""
    held, accepted = subject.easiest
    for wrong, meant in (
        ({"shader": {"name": "path_tracer", "max_depth": 0}}, "max_depth"),
        ({"sampler": {"name": "constant", "value": 1.0}}, "value"),
        ({"shader": 7}, "shader"),
    ):
        settings = Settings(**{**BASE, **accepted, **wrong})
        _expect_raised(subject.engine, held, settings, wrong, ConfigError, meant)


def _expect_raised(engine: Engine, held: Scene, settings: Settings, wrong: Any, kind: type[Exception], meant: str) -> None:
    """`prepare` and `why_not` raise `kind` with `meant` in its message."""
    for name, call in (("prepare", engine.prepare), ("why_not", engine.why_not)):
        try:
            answer = call(held, settings)
        except kind as error:
            expect(meant in str(error), f"{wrong}: the message of {name} does not name {meant!r}: {error}")
        except Exception as error:
            raise Broken(f"{wrong}: {name} raised {type(error).__name__}, expected {kind.__name__}: {error}") from error
        else:
            raise Broken(f"{wrong}: {name} answers {answer!r}, expected {kind.__name__}")


def _demands(subject: Subject) -> Iterator[tuple[str, Scene, dict[str, Any]]]:
    """Scenes and settings, each asking for one thing more than the plainest."""
    shapes = {
        "a sphere": sphere(),
        "a plane": plane((0, 0, 0), (0, 1, 0)),
        "a mesh": rectangle((-1, 1), (0, 2), 0),
        "a mirror": rectangle((-1, 1), (0, 2), 0, "mirror"),
        "glass": rectangle((-1, 1), (0, 2), 0, "glass"),
        "an emitter": rectangle((-1, 1), (0, 2), 0, "lamp"),
    }
    lights: dict[str, dict[str, Any]] = {
        "a point light": {"point": {"position": [0, 3, 2], "intensity": 3}},
        "a directional light": {"directional": {"direction": [0, -1, -1], "irradiance": 1}},
        "an environment": {"environment": {"radiance": 1}},
    }
    plain = dict(subject.easiest[1])
    for what, shape in shapes.items():
        yield what, scene([shape]), plain
    for what, light in lights.items():
        yield what, scene([shapes["a mesh"]], [light]), plain
    yield "nothing at all", scene([]), plain
    for held in (ROOM, TRIANGLES):
        for shader in KNOWN_SHADERS:
            yield f"shader {shader}", held, {**plain, "shader": shader}
        for sampler in KNOWN_SAMPLERS:
            yield f"sampler {sampler}", held, {**plain, "sampler": sampler}
        for accelerator in ("auto", *subject.engine.accelerators()):
            yield f"accelerator {accelerator}", held, {**plain, "accelerator": accelerator}
        for precision in ("float32", "float64"):
            yield f"precision {precision}", held, {**plain, "precision": precision}


def why_not_and_prepare_agree(subject: Subject) -> None:
    """Where why_not answers None prepare works, and renders unless quick; else it raises Unsupported in those words."""
    for what, demanded, changes in _demands(subject):
        held, settings = subject.given(demanded), Settings(**{**BASE, **changes})
        reason = subject.engine.why_not(held, settings)
        try:
            renderer = subject.engine.prepare(held, settings)
        except Unsupported as refusal:
            expect(reason is not None, f"{what}: why_not answers None, prepare raises Unsupported: {refusal}")
            expect(str(refusal) == reason, f"{what}: why_not answers {reason!r}, prepare raises {str(refusal)!r}")
            expect(reason and "\n" not in reason, f"{what}: why_not answers {reason!r}, expected a sentence")
            continue
        expect(reason is None, f"{what}: why_not answers {reason!r}, yet prepare works")
        if not subject.quick:
            film = renderer.render(1)
            expect(np.isfinite(film.mean()).all(), f"{what}: the image is not finite")
            expect(film.bad_samples == 0, f"{what}: {film.bad_samples} bad samples")


def counters_count(subject: Subject) -> None:
    """The counters are there and finite; rays, where they are counted, are those of render, trace and occluded."""
    renderer = subject.usual()
    renderer.warm_up()
    before = dict(renderer.counters())
    for name in COUNTERS:
        expect(name in before, f"counters() lacks {name}")
    for name in {*COUNTERS, "rays"} & {*before}:
        expect(math.isfinite(before[name]) and before[name] >= 0, f"counters()[{name!r}] = {before[name]!r}")
    film = renderer.render(2)
    after = renderer.counters()
    expect(after["bad_samples"] == film.bad_samples, "counters()['bad_samples'] is not film.bad_samples")
    seconds = before["compile_seconds"], after["compile_seconds"]
    expect(seconds[1] >= seconds[0], f"compile_seconds fell from {seconds[0]} to {seconds[1]}")
    if "rays" in before:
        _count_rays(renderer, before["rays"], 2 * film.width * film.height)


def _count_rays(renderer: Renderer, before: float, samples: int) -> None:
    rendered = renderer.counters()["rays"]
    expect(before == 0, f"counters()['rays'] = {before} after warm_up, which is no work that was asked for")
    expect(rendered >= samples, f"{samples} samples were rendered, yet counters()['rays'] grew by {rendered}")
    origins, directions = np.zeros((7, 3)), np.eye(7, 3) + 0.1
    directions[-1] = 0.0  # no ray
    for call in (renderer.trace, renderer.occluded):
        try:
            call(origins, directions)
        except Unsupported:
            continue
        counted, rendered = renderer.counters()["rays"] - rendered, renderer.counters()["rays"]
        expect(counted == 6, f"6 rays and one without a direction were traced, and counters()['rays'] grew by {counted}")


def whole_patterns_are_as_large_as_asked(subject: Subject) -> None:
    """Where an engine has full_pattern, it gives None, or a pattern of at least spp samples and never fewer as spp rises."""
    engine = subject.engine
    if not isinstance(engine, HasPatterns):
        return
    for given in subject.listed.get("sampler", SAMPLERS):
        sampler = {"name": given} if isinstance(given, str) else dict(given)
        last = 0
        for spp in (1, 3, 4, 100, 1000):
            found = engine.full_pattern(sampler, spp)
            seen = f"full_pattern({sampler}, {spp}) is {found!r}"
            expect(found is None or isinstance(found, FullPattern), seen)
            if found is None:
                expect(last == 0, f"{seen}, after a pattern of {last} samples")
                continue
            expect(found.spp >= max(spp, last), f"{seen}: at least {max(spp, last)} samples are expected")
            again = engine.full_pattern(found.sampler, found.spp)
            expect(again == found, f"{seen}, but asked for its own sampler and samples it gives {again!r}")
            last = found.spp


CLAIMS = (
    the_engine_says_what_it_is,
    unknown_names_are_refused,
    values_out_of_range_are_refused,
    why_not_and_prepare_agree,
    counters_count,
    whole_patterns_are_as_large_as_asked,
)
