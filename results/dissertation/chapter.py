"""Writes the dissertation's missing chapter, chapter/chapter.{md,tex,html}: `make chapter-text`.

The text is prose.md. What it claims of the results is asserted here, in its order: a sentence that the results do not bear
out is an `AssertionError` with their numbers. `Facts` says how configurations are named.
"""

from collections.abc import Sequence
from pathlib import Path

from harness.analysis import Analysis
from harness.report.chapter import Chapter, Facts, Section, filled, write_chapter

HERE = Path(__file__).resolve().parent
USUAL = ("path_tracer", "sobol", "2 threads", "numba bvh")
"""What phrases leave open."""
MOBILERT = ["mobilert_cornell", "mobilert_cornell2", "mobilert_spheres", "mobilert_spheres2"]
LARGE = ["sphereflake", "gears", "teapot_stadium"]
FIVE = ["mobilert_spheres", "mobilert_spheres2", *LARGE]
"""All scenes but the two rooms."""
THREADS = [f"{scene}, {tree}" for tree in ("numba bvh", "embree") for scene in ("mobilert_cornell2", *LARGE)]
SHADED = ["mobilert_cornell2", "mobilert_spheres2", "sphereflake", "gears"]
PIXELS = 160 * 160
PORT = ["dahlquist, 1 thread", "dahlquist, 2 threads"]


def check_accelerators(facts: Facts) -> None:
    assert facts.fastest(MOBILERT, "numba brute force"), "brute force is the fastest on the four scenes of MobileRT"
    bvh = facts.speedup(LARGE, "numba bvh", "embree")
    assert bvh.better, f"numba's BVH is faster than Embree on the three large scenes: {bvh.verdicts}"
    bvh = facts.speedup(LARGE, "numba bvh", "numba grid")
    assert bvh.better, f"the grid is slower than the BVH on all three large scenes: {bvh.verdicts}"
    bvh = facts.speedup("teapot_stadium", "numba bvh", "numba grid")
    assert bvh.least > 50, f"on teapot_stadium a ray is tested against most of the triangles: {bvh}"

    numba, embree = facts.build("sphereflake"), facts.build("sphereflake, embree")
    assert embree.low < numba.high and numba.low < embree.high, f"on sphereflake builds overlap: {numba}, {embree}"
    for scene in ("teapot_stadium", "gears"):
        numba, embree = facts.build(scene), facts.build(f"{scene}, embree")
        assert embree.high < numba.low, f"on {scene} Embree is the faster builder: {numba}, {embree}"


def check_threads(facts: Facts) -> None:
    two = facts.speedup(THREADS, "2 threads", "1 thread")
    assert two.better, f"two threads are faster than one in all eight cases: {two.verdicts}"
    large = [f"{scene}, {tree}" for tree in ("numba bvh", "embree") for scene in ("sphereflake", "gears")]
    two = facts.speedup(large, "2 threads", "1 thread")
    assert two.least > 1.7, f"little is lost on the large scenes: {two.verdicts}"


def check_shaders(facts: Facts) -> None:
    for other in ("path_tracer", "whitted"):
        cheap = facts.speedup(SHADED, "no_shadows", other)
        assert cheap.better, f"no_shadows is the cheapest on all four scenes: {cheap.verdicts}"
    whitted = facts.speedup("mobilert_cornell2", "whitted", "path_tracer")
    assert whitted.better, f"on mobilert_cornell2 a path costs more than a tree of whitted's rays: {whitted.verdicts}"
    path = facts.speedup(["sphereflake", "gears"], "path_tracer", "whitted")
    assert path.better, f"on sphereflake and gears it is the other way round: {path.verdicts}"


def check_samplers(facts: Facts) -> None:
    for other in ("random", "halton"):
        sobol = facts.error_ratio(FIVE, "sobol", other)
        assert sobol.better, f"sobol has a smaller error than {other} on the five scenes that are no rooms: {sobol.verdicts}"
    sobol = facts.time_ratio(FIVE, "sobol", "random")
    assert sobol.better, f"in time to a quality sobol is ahead of random on the same five scenes: {sobol.verdicts}"
    gains = {scene: facts.time_ratio(scene, "sobol", "random").least for scene in FIVE}
    assert min(gains, key=gains.__getitem__) == "mobilert_spheres2", f"sobol gains least on mobilert_spheres2: {gains}"
    assert max(gains, key=gains.__getitem__) == "teapot_stadium", f"sobol gains most on teapot_stadium: {gains}"
    sobol = facts.speedup(FIVE, "sobol", "random")
    assert sobol.least > 0.9, f"the samplers' own cost changes little: {sobol}"

    for one, other in (("random", "sobol"), ("sobol", "random")):
        times = facts.time_ratio("mobilert_cornell2", one, other)
        assert not times.better, f"on mobilert_cornell2 random and sobol are not separated: {times.verdicts}"
    errors = facts.error_ratio("mobilert_cornell2", "sobol", "random")
    assert errors.better, f"at equal samples sobol has a smaller error than random there: {errors.verdicts}"
    assert errors.greatest < 1.5, f"better points help little there: {errors}"


def check_fireflies(facts: Facts) -> None:
    share = facts.tail_share("mobilert_cornell", 64)
    assert share > 30, f"the worst pixels of mobilert_cornell hold much of the error: {share} %"
    original, control = facts.error("mobilert_cornell", 64), facts.error("cornell_lowered_light", 64)
    assert original.low > 10 * control.high, f"the control's error is far smaller: {original}, {control}"
    whitted = facts.error("mobilert_cornell, whitted", 64)
    assert whitted.high < 0.01, f"whitted, without diffuse bounces, has a small error: {whitted}"


def check_port(facts: Facts) -> None:
    for other in ("numba area_hierarchy", "numba brute force", "embree", "dahlquist brute force"):
        port = facts.speedup(PORT, "dahlquist area_hierarchy", other)
        assert port.better, f"the port with its area hierarchy is faster than {other}: {port.verdicts}"
    brute = facts.speedup("dahlquist, 1 thread", "dahlquist brute force", "numba brute force")
    assert brute.better, f"the accelerator explains only a part of the difference: {brute.verdicts}"
    hierarchy = facts.speedup("dahlquist, 1 thread", "numba area_hierarchy", "numba brute force")
    assert not hierarchy.better, f"in numba the area hierarchy gains nothing: {hierarchy.verdicts}"


def check_discussion(facts: Facts) -> None:
    for scene in LARGE:
        grid, embree = (f"{scene}, {name}" for name in ("numba grid", "embree"))
        for other in (scene, embree):
            builds = facts.build(grid), facts.build(other)
            assert builds[0].high < builds[1].low, f"on {scene} the grid is built soonest: {builds}"
        first = [facts.build(one).value + PIXELS / facts.speed(one).value for one in (grid, embree)]
        assert first[0] > first[1], f"on {scene} Embree takes less time for build and one sample together: {first} ms"
    for one, other in (("random", "sobol"), ("sobol", "random")):
        errors = facts.error_ratio("mobilert_cornell", one, other)
        assert not errors.better, f"on mobilert_cornell random and sobol are not separated: {errors.verdicts}"


CHECKS = (
    check_accelerators,
    check_threads,
    check_shaders,
    check_samplers,
    check_fireflies,
    check_port,
    check_discussion,
)


def compose(analyses: Sequence[Analysis], sections: Sequence[Section]) -> Chapter:
    """The chapter of prose.md, whose claims hold."""
    facts = Facts(analyses, USUAL)
    for check in CHECKS:
        check(facts)
    error = facts.error("mobilert_cornell", 64).value
    numba, embree = ((facts.build(one).value, PIXELS / facts.speed(one).value) for one in ("gears", "gears, embree"))
    functions = ("place", "primitives", "blocks", "cells", "contended", "persistent_spread", "build", "error", "tail_share")
    values = {
        **{name: getattr(facts, name) for name in (*functions, "speedup", "error_ratio", "time_ratio")},
        **{"MOBILERT": MOBILERT, "LARGE": LARGE, "FIVE": FIVE, "THREADS": THREADS},
        "break_even": round((numba[0] - embree[0]) / (embree[1] - numba[1])),
        "error_over_that_of_cornell2": error / facts.error("mobilert_cornell2", 64).value,
        "error_over_that_of_the_control": error / facts.error("cornell_lowered_light", 64).value,
    }
    return filled(HERE / "prose.md", values, sections)


def main() -> None:
    for written in write_chapter([HERE, HERE.parent / "dahlquist"], HERE / "chapter", compose):
        print(written)


if __name__ == "__main__":
    main()
