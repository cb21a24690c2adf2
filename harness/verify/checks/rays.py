"""Invalid rays, directions of any length, and the ends of the interval of t."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator

import numpy as np

from engines.scene import Plane
from harness.trace import oracle
from harness.verify.case import Measurement, Section, measurement
from harness.verify.scenes import box, sphere
from harness.verify.subject import Subject
from harness.verify.tolerances import NONE_WRONG, Tolerance

SECTION = Section("rays", each_accelerator=True)
SHAPES = (Plane((0.0, -1.5, 0.0), (0.0, 1.0, 0.0), 0), sphere(), box((2, -1, -1), (3, 1, 1)))
NAN, INF = np.nan, np.inf
BAD = [
    ((NAN, 0, 5), (0, 0, -1), INF),
    ((0, INF, 5), (0, 0, -1), INF),
    ((0, 0, 5), (0, 0, 0), INF),
    ((0, 0, 5), (0, NAN, -1), INF),
    ((0, 0, 5), (0, 0, -INF), INF),
    ((0, 0, 5), (0, 0, -1), NAN),
    ((0, 0, 5), (0, 0, -1), -1.0),
    ((0, 0, 5), (0, 0, -1), 0.0),
    ((0, 0, 5), (0, 0, -1), -INF),
]


@SECTION.case(
    "R1",
    "Rays that are not finite, have direction zero or end before they start miss, and change no other ray.",
    NONE_WRONG,
    "engines.interface",
)
def nonsense(subject: Subject) -> Iterator[Measurement]:
    origins, directions, reach = (np.array(column, float) for column in zip(*BAD, strict=True))
    good = [(0.0, 0.0, 5.0)], [(0.0, 0.0, -1.0)]
    origins, directions = np.append(origins, good[0], axis=0), np.append(directions, good[1], axis=0)
    reach = np.append(reach, INF)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer = subject.tracer(*SHAPES)
        hits, dark = renderer.trace(origins, directions, reach), renderer.occluded(origins, directions, reach)
    yield measurement(np.append(np.isfinite(hits.t[:-1]) | (hits.shape[:-1] >= 0), hits.t[-1] != 4.0), "trace")
    yield measurement(np.append(dark[:-1], not dark[-1]), "occluded")


@SECTION.case(
    "R2", "Directions of length 1e-30 and 1e30 give the same hits as unit directions.", Tolerance("relative", 1e-10, 1e-5)
)
def any_length(subject: Subject) -> Iterator[Measurement]:
    rng, n = np.random.default_rng(1), subject.count(2000)
    origins, directions = subject.cast(rng.uniform(-2, 2, (n, 3))), subject.cast(rng.normal(size=(n, 3)))
    renderer = subject.tracer(sphere())
    for length in (1e-30, 1e30):
        scaled = subject.cast(directions * length)
        hits = renderer.trace(origins, scaled)
        near, far = (root.astype(float) for root in oracle.sphere_roots((0, 0, 0), 1.0, origins, scaled))
        t = np.where(near > 0, near, np.where(far > 0, far, INF))
        with np.errstate(invalid="ignore"):
            chord = (far - near) * np.linalg.norm(scaled, axis=1)
        clear = np.isinf(near) | (chord > 1e-2)  # tangents may go either way
        traced, both = hits.t[clear], np.isfinite(hits.t[clear]) & np.isfinite(t[clear])
        errors = np.where(np.isfinite(traced) == np.isfinite(t[clear]), 0.0, INF)
        errors[both] = np.abs(traced[both] / t[clear][both] - 1)
        yield measurement(errors, f"length {length:.0e}")


@SECTION.case("R3", "The interval of t is open at t_max, for trace and occluded.", NONE_WRONG, "engines.interface")
def open_interval(subject: Subject) -> Iterator[Measurement]:
    renderer = subject.tracer(*SHAPES)
    ray = [(0.0, 0.0, 5.0)], [(0.0, 0.0, -2.0)]
    wrong = []
    for reach, hit in ((2.0, False), (2.00001, True), (1.99999, False), (INF, True)):
        t = renderer.trace(*ray, reach).t[0]
        wrong += [(t == 2.0) != hit, bool(renderer.occluded(*ray, reach)[0]) != hit]
    yield measurement(wrong)


@SECTION.case("R4", "Empty arrays of rays and scenes without shapes are accepted.", NONE_WRONG)
def nothing(subject: Subject) -> Iterator[Measurement]:
    none = np.zeros((0, 3))
    full, empty = subject.tracer(*SHAPES), subject.tracer()
    yield measurement(
        [
            full.trace(none, none).t.shape != (0,),
            full.occluded(none, none).shape != (0,),
            not np.isinf(empty.trace([(0, 0, 0)], [(0, 0, 1)]).t).all(),
            empty.occluded([(0, 0, 0)], [(0, 0, 1)]).any(),
        ]
    )


@SECTION.case(
    "R5",
    "NaN among the rays does not make tracing more than 2.5 times slower.",
    Tolerance("relative", 2.5, 2.5),
    full_only=True,
)
def no_slowdown(subject: Subject) -> Iterator[Measurement]:
    rng = np.random.default_rng(5)
    origins, directions = rng.uniform(-2, 2, (40_000, 3)), rng.normal(size=(40_000, 3))
    bad = origins.copy()
    bad[::2] = NAN
    renderer = subject.tracer(*SHAPES)
    seconds = [[], []]
    for _ in range(5):
        for kind, start in enumerate((origins, bad)):
            since = time.perf_counter()
            renderer.trace(start, directions)
            seconds[kind].append(time.perf_counter() - since)
    yield measurement(min(seconds[1]) / min(seconds[0]))
