"""The clock: what is on it, when it stops, and what it costs."""

import threading
import time
from itertools import pairwise

import fake_engines
import numpy as np
import pytest

from engines.interface import FullPattern, Settings
from engines.scene import scene_from
from engines.schema.yaml_file import parse_yaml
from harness.config.sections import exact_root
from harness.measure import clock
from harness.measure.contention import Disturbance
from harness.measure.schedule import Schedule, checkpoints, shortened
from tests.harness import sweeping

SCENE = scene_from(parse_yaml(sweeping.SCENE).plain())


def schedule(**changes):
    return Schedule(**{"ratio": 2.0, "start": 1, "max_spp": 64, "max_time_seconds": 100.0, **changes})


def renderer(engine=fake_engines.Steady, **settings):
    return engine().prepare(SCENE, Settings(**{"width": 4, "height": 4, **settings}))


@pytest.fixture
def fake_time(monkeypatch):
    """A clock of its own for the harness and for `time.sleep` in this thread: what is slept takes exactly that long, and
    nothing else."""
    sleep, thread = time.sleep, threading.current_thread()

    class Clock:
        now = 0.0

        def sleep(self, seconds):
            if threading.current_thread() is thread:
                self.now += seconds
            else:
                sleep(seconds)

    made = Clock()
    monkeypatch.setattr(clock, "perf_counter", lambda: made.now)
    monkeypatch.setattr(time, "sleep", made.sleep)
    return made


def points(made, wanted, estimate=1e-6):
    return list(clock.timed_points(made, wanted, estimate, Disturbance()))


@pytest.mark.parametrize(
    ("ratio", "start", "max_spp", "expected"),
    [
        (2.0, 1, 16, [1, 2, 4, 8, 16]),
        (2.0, 1, 10, [1, 2, 4, 8, 10]),
        (2**0.5, 1, 16, [1, 2, 3, 4, 6, 8, 12, 16]),
        (2**0.5, 3, 50, [3, 4, 6, 9, 12, 18, 24, 36, 48, 50]),
        (1.1, 1, 5, [1, 2, 3, 4, 5]),
        (4.0, 16, 100, [16, 64, 100]),
        (2.0, 64, 8, [8]),
        (2.0, 1, 1, [1]),
    ],
)
def test_checkpoints_are_geometric_rise_strictly_and_end_with_max_spp(ratio, start, max_spp, expected):
    assert list(checkpoints(schedule(ratio=ratio, start=start, max_spp=max_spp))) == expected


@pytest.mark.parametrize("written", [1.4142, 1.41421, 1.4142135623730951])
def test_a_written_root_of_two_hits_every_power_of_two(written):
    ratio = exact_root(written)
    found = set(checkpoints(schedule(ratio=ratio, max_spp=2**30)))
    assert {2**k for k in range(31)} <= found
    assert exact_root(1.5) == 1.5 and exact_root(3.0) == 3.0


@pytest.mark.parametrize(
    ("wanted", "done", "seconds", "per_spp", "expected"),
    [
        (8, 4, 1.0, 0.1, 8),  # well within
        (64, 32, 9.0, 0.3, 64),  # 18.6 of 10: the last pass may overshoot
        (128, 32, 9.0, 0.3, 35),  # 37.8 of 10: shortened to what fits
        (64, 32, 9.9, 0.9, 32),  # nothing fits any more: stop
        (64, 0, 0.0, 1.0, 10),  # the first pass is shortened too
        (64, 0, 0.0, 50.0, 1),  # but one sample is rendered always
    ],
)
def test_a_pass_that_would_overshoot_wildly_is_shortened(wanted, done, seconds, per_spp, expected):
    assert shortened(wanted, done, seconds, per_spp, 10.0) == expected


def test_points_are_cumulative_and_the_film_holds_what_they_say():
    made = renderer()
    found = points(made, schedule(max_spp=16))
    assert [point.spp for point in found] == [1, 2, 4, 8, 16]
    assert all(later.seconds > earlier.seconds for earlier, later in pairwise(found))
    assert found[-1].rays == 16 * 16 and made.film.spp == 16


def test_what_happens_between_passes_is_off_the_clock(fake_time):
    made = renderer(fake_engines.Phased)
    start = fake_time.now
    found = []
    for point in clock.timed_points(made, schedule(max_spp=8), 1e-6, Disturbance()):
        found.append(point.seconds)
        time.sleep(0.1)  # metrics, image files, progress
    assert found[-1] == pytest.approx(8 * 0.02)
    assert fake_time.now - start == pytest.approx(found[-1] + 4 * 0.1)


def test_rendering_stops_after_the_checkpoint_that_passes_the_budget(fake_time):
    found = points(renderer(fake_engines.Phased), schedule(max_time_seconds=0.1))
    assert found[-1].seconds >= 0.1 and found[-2].seconds < 0.1


def test_a_wild_prediction_ends_with_one_shortened_pass(fake_time):
    found = points(renderer(fake_engines.Phased), schedule(ratio=100.0, max_spp=10**6, max_time_seconds=0.11))
    assert [point.spp for point in found] == [1, 5]


def test_phases_add_up_to_what_was_waited_for(fake_time):
    engine = fake_engines.Phased()
    _, build, compilation = clock.prepare(engine, SCENE, Settings(width=4, height=4))
    assert build == pytest.approx(0.05) and compilation == pytest.approx(0.1)
    assert build + compilation == pytest.approx(fake_time.now)


def test_compilation_inside_prepare_is_compilation(fake_time):
    class Eager(fake_engines.Steady):
        def prepare(self, scene, settings):
            made = fake_engines.FakeRenderer(self, scene, settings)
            time.sleep(0.06)
            made.compile_seconds = 0.04
            return made

    _, build, compilation = clock.prepare(Eager(), SCENE, Settings(width=4, height=4))
    assert build == pytest.approx(0.02) and compilation == pytest.approx(0.04)


def test_the_clock_itself_costs_less_than_a_percent_of_a_short_pass(monkeypatch):
    """Passes of 5 ms of arithmetic, on the clock and in a bare loop, in turn; the fastest of 60 are compared, by the CPU
    time of this process."""
    monkeypatch.setattr(clock, "perf_counter", time.process_time)

    class Busy:
        film = renderer().film

        def render(self, spp):
            numbers = np.arange(20_000.0)
            for _ in range(150 * spp):
                np.sqrt(numbers, out=numbers)
            return self.film

    busy, disturbance = Busy(), Disturbance()
    busy.render(4)
    clocked, bare = [], []
    for _ in range(60):
        clocked.append(clock.timed_call(busy.render, 1, disturbance)[1])
        start = time.process_time()
        busy.render(1)
        bare.append(time.process_time() - start)
    # The clock's own cost is far below the noise of a shared machine: an empty pass shows it, and so does the fastest.
    empty = min(clock.timed_call(lambda spp: busy.film, 1, disturbance)[1] for _ in range(200))
    assert empty < 0.01 * min(bare)
    assert min(clocked) < 1.1 * min(bare)


def test_the_collector_rests_only_while_the_clock_runs():
    import gc

    seen = []
    clock.timed_call(lambda spp: seen.append(gc.isenabled()) or renderer().film, 1, Disturbance())
    with pytest.raises(ZeroDivisionError):
        clock.timed_call(lambda spp: 1 // 0, 1, Disturbance())
    assert seen == [False] and gc.isenabled()


def test_whole_patterns_are_rendered_anew_and_timed_alone(fake_time):
    """Sixteen samples take 0.32 s, which is above the budget; what building and compiling take is not on the clock."""
    patterns = [FullPattern(n, {"name": "stratified", "strata": n}) for n in (4, 16, 64)]
    asked = []

    def settings(pattern):
        asked.append(pattern.sampler)
        return Settings(width=4, height=4, sampler=dict(pattern.sampler))

    made = list(clock.pattern_points(fake_engines.Phased(), SCENE, settings, patterns, 0.3, 1e-6, Disturbance()))
    assert [(point.spp, point.film.spp, point.rays) for point in made] == [(4, 4, 64), (16, 16, 256)]
    assert [point.seconds for point in made] == [pytest.approx(0.08), pytest.approx(0.32)]
    assert asked == [pattern.sampler for pattern in patterns[:2]]


def test_building_the_next_pattern_is_asked_for_and_what_follows_a_pattern_is_not(monkeypatch):
    """Other threads work 5 s while a renderer is prepared, and 1 s after each pattern."""
    worked = [0.0]
    monkeypatch.setattr("harness.measure.contention.other_threads", lambda: worked[0])

    class Builds(fake_engines.Steady):
        def prepare(self, scene, settings):
            worked[0] += 5.0
            return super().prepare(scene, settings)

    patterns = [FullPattern(n, {"name": "stratified", "strata": n}) for n in (4, 16, 64)]
    settings, disturbance = Settings(width=4, height=4), Disturbance()
    for _ in clock.pattern_points(Builds(), SCENE, lambda _: settings, patterns, 9.0, 1e-6, disturbance):
        worked[0] += 1.0
    disturbance.rest()
    assert disturbance.off_clock == 3.0


def test_a_pattern_that_would_overshoot_wildly_is_left_out_but_the_first_is_rendered(fake_time):
    patterns = [FullPattern(n, {"name": "stratified", "strata": n}) for n in (4, 64)]
    settings = Settings(width=4, height=4)
    made = clock.pattern_points(fake_engines.Phased(), SCENE, lambda _: settings, patterns, 0.1, 1.0, Disturbance())
    assert [point.spp for point in made] == [4]
