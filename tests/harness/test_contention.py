"""Contention: by the run queue where the kernel counts waits, else by the processor time of a contestant's blocks."""

import json
import os
import subprocess
import sys
import time

import pytest

from harness.measure import contention, run_queue
from harness.measure.contention import CPU_TIME, RUN_QUEUE, judged
from harness.measure.run_queue import EndedThreads, readable, thread_waits
from harness.run.contended import contended_by_cpu_time
from harness.store.records import Machine
from tests.harness import sweeping
from tests.needs import needs

MILLISECOND = 10**6


@pytest.fixture
def machine(monkeypatch):
    """Sets what the kernel counts: seconds of the machine, and nanoseconds that threads waited."""
    now = {"sample": contention.Sample(0.0, 0.0, 0.0, 0), "waits": {}}
    monkeypatch.setattr(contention, "sample", lambda: now["sample"])
    monkeypatch.setattr(contention, "own_waits", lambda: now["waits"])
    monkeypatch.setattr(contention, "usable_cores", lambda: [0, 1])
    return now


def disturbed(machine, before, after, steal=0.0, wall=1.0, others=0.0, own=1.0):
    """The report of a timed call of `wall` seconds."""
    found = contention.Disturbance()
    machine["sample"], machine["waits"] = contention.Sample(10.0, 1.0, 3.0, 4), before
    found.start()
    machine["sample"], machine["waits"] = contention.Sample(10.0 + own + others, 1.0 + steal, 3.0 + own, 6), after
    found.stop(wall)
    return found


@pytest.mark.parametrize(
    ("waits", "steal", "threads", "expected"),
    [
        ({1: 40, 2: 0}, 0.0, 1, False),  # 40 of 1000 ms
        ({1: 60, 2: 0}, 0.0, 1, True),
        ({1: 60, 2: 30}, 0.0, 2, False),  # 90 of 2000 ms
        ({1: 60, 2: 60}, 0.0, 2, True),
        ({1: 30, 2: 0}, 0.03, 1, True),  # stolen time is added
        ({1: 0, 2: 0}, 0.06, 1, True),
        ({1: 10, 7: 55}, 0.0, 1, True),  # a thread that began during the call
    ],
)
def test_waits_and_stolen_time_are_held_against_wall_time_times_threads(machine, waits, steal, threads, expected):
    before = {1: 500 * MILLISECOND, 2: 700 * MILLISECOND}
    after = {thread: before.get(thread, 0) + wait * MILLISECOND for thread, wait in waits.items()}
    report = judged(disturbed(machine, before, after, steal).report(), threads)
    assert (report["contended"], report["contention_rule"]) == (expected, RUN_QUEUE)
    assert report["run_queue_seconds"] == pytest.approx(1e-3 * sum(waits.values()))
    assert report["steal_seconds"] == steal and report["involuntary_switches"] == 2


def test_a_wait_as_short_as_the_start_of_threads_disturbs_no_cell_however_short(machine):
    for wait, expected in ((3 * MILLISECOND, False), (5 * MILLISECOND, True)):
        assert judged(disturbed(machine, {1: 0}, {1: wait}, wall=0.01).report(), 2)["contended"] == expected


def test_work_of_others_alone_disturbs_nobody(machine):
    report = judged(disturbed(machine, {1: 0}, {1: 0}, others=1.0).report(), 1)
    assert report["other_cpu_seconds"] == 1.0 and report["cpu_seconds"] == 1.0 and not report["contended"]


def test_threads_that_ended_are_counted_by_whoever_saw_them(machine):
    report = disturbed(machine, {1: 0, 2: 0}, {1: 0}).report()
    assert not judged(report, 1)["contended"] and judged(report, 1, ended=0.06)["contended"]


@pytest.mark.parametrize(("after", "threads"), [(None, 1), ({1: 900 * MILLISECOND}, 3)])
def test_without_waits_or_with_more_threads_than_cores_the_blocks_decide_later(machine, after, threads):
    report = judged(disturbed(machine, {1: 0}, after).report(), threads)
    assert (report["contended"], report["contention_rule"]) == (False, CPU_TIME)
    assert report["run_queue_seconds"] == (None if after is None else 0.9)


def test_what_an_engine_writes_in_place_of_a_report_is_no_mishap(machine):
    for report in ({}, {"run_queue_seconds": "x", "timed_seconds": [1]}, {"run_queue_seconds": None}):
        assert judged(report, 1)["contention_rule"] == CPU_TIME


def block(cell_id, cpu, wall=1.0, others=0.0, rule=CPU_TIME):
    figures = {"cpu_seconds": cpu, "timed_seconds": wall, "other_cpu_seconds": others, "contention_rule": rule}
    return {cell_id: Machine(**figures)}


@pytest.mark.parametrize(
    ("slow", "expected"),
    [
        (block("slow", 0.9, others=0.05), True),  # half of what is lacking
        (block("slow", 0.9, others=0.04), False),  # others did not work: the contestant waited for something else
        (block("slow", 0.96, others=1.0), False),  # within 95 %
        (block("slow", 1.8, 2.0, others=0.2), True),  # a longer block: shares are compared
        (block("slow", 0.4, 0.5, others=0.5), False),  # below half a second nothing is said
        (block("slow", 0.9, others=1.0, rule=RUN_QUEUE), False),  # the run queue has judged it
    ],
)
def test_blocks_that_lack_processor_time_which_others_had_are_contended(slow, expected):
    assert contended_by_cpu_time(block("best", 1.0) | slow) == ({"slow"} if expected else set())


# --- what the parent sees -------------------------------------------------------------------------------------------


def test_waits_of_threads_that_end_in_a_call_are_those_seen_in_it(monkeypatch):
    """Threads 1 and 2 end in the call from 10 to 20; 3 was alive after it and has ended since; 4 lives; 5 ended before it."""
    seen = [
        (5.0, {1: 100, 3: 100, 4: 0, 5: 80}),
        (9.0, {1: 150, 3: 100, 4: 0, 5: 90}),
        (12.0, {1: 400, 2: 20, 3: 300, 4: 500}),
        (19.0, {2: 70, 3: 300, 4: 700}),
        (21.0, {4: 900}),
    ]
    threads, moments = EndedThreads(), iter(seen)
    found = {}

    def monotonic():
        now, waits = next(moments)
        found["waits"] = {thread: wait * MILLISECOND for thread, wait in waits.items()}
        return now

    monkeypatch.setattr(run_queue, "monotonic", monotonic)
    monkeypatch.setattr(run_queue, "thread_waits", lambda pids: found["waits"])
    for _ in range(4):
        threads.look([1])
    assert threads.waited([1], 10.0, 20.0, alive=[3, 4]) == pytest.approx(1e-3 * (400 - 150 + 70))
    moments = iter([(30.0, {4: 1200}), (31.0, {})])
    threads.look([1])
    assert threads.waited([1], 25.0, 30.5, alive=[]) == pytest.approx(1e-3 * (1200 - 900)), "from the last look on"


def test_own_threads_and_those_of_ended_processes():
    ended = subprocess.Popen(["true"])
    ended.wait()
    found = thread_waits([os.getpid(), ended.pid])
    assert (found is None) == (not readable())
    assert found is None or os.getpid() in found


# --- for real -------------------------------------------------------------------------------------------------------

CONTENDED = """
import json, os, subprocess, sys
from pathlib import Path

import fake_engines
from engines.choices import Choice
from engines.scene import load_scene
from harness.config.settings import SceneFile
from harness.measure.pool import Pool
from harness.measure.requests import CellRequest
from harness.measure.schedule import Schedule
from harness.settings import CellSettings

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # children inherit it: two that work share a processor
busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
settings = CellSettings(Choice("none"), "float64", 1, Choice("path_tracer"), Choice("random"), 4, 4)
schedule = Schedule(ratio=2.0, start=1, max_spp=2, max_time_seconds=9.0)
scene = SceneFile("ball", sys.argv[1])
request = CellRequest(scene, load_scene(scene.path).content_hash, settings, 1, 2, schedule)
try:
    with Pool(True, Path(sys.argv[2])) as pool:
        print(json.dumps([m.message for m in pool.cell("fake_engines:Burning", request, 120.0)][-1].machine))
finally:
    busy.kill()
"""


@needs("run-queue")
def test_a_cell_beside_a_busy_process_on_its_processor_is_contended_even_where_its_threads_have_ended(tmp_path):
    sweeping.write(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", CONTENDED, str(tmp_path / "ball.yaml"), str(tmp_path / "log")],
        capture_output=True,
        text=True,
        env=sweeping.environment(),
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["contended"] and found["contention_rule"] == RUN_QUEUE
    assert found["run_queue_seconds"] > 0.05 * found["timed_seconds"] and found["cpu_seconds"] >= 1.0


def test_processor_time_is_counted_in_fine_steps():
    """Far below the ticks of 10 ms in which the kernel gives times of processes."""
    before = contention.sample().own
    end = time.process_time() + 0.002
    while time.process_time() < end:
        pass
    assert contention.sample().own - before > 0.0015
