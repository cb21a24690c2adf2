"""A cold start shares what is to be compiled with a fork, and needs nothing of it."""

import os
import time

import numpy as np
import pytest

import engines
from engines.kernels import driver
from engines.kernels.compile import code_cache, second_process


@pytest.fixture(autouse=True)
def children(monkeypatch):
    """The forks of a test, on a machine that is said to have a free core."""
    fork, made = os.fork, []
    monkeypatch.setattr(second_process, "_second_core_is_free", lambda: True)
    monkeypatch.setattr(os, "fork", lambda: made.append(fork()) or made[-1])
    return made


def compiling(folder, number, elsewhere=lambda: None):
    """A job that takes 0.05 s and leaves the process's number in a file, which stands for code on disk; in the second
    process `elsewhere` is called before."""
    file, here = folder / str(number), os.getpid()

    def job():
        if file.exists():
            return
        if code_cache.is_loading_only():
            raise code_cache.NotOnDisk
        if os.getpid() != here:
            elsewhere()
        time.sleep(0.05)
        file.write_text(str(os.getpid()))

    return job


def have_ended(children):
    """Whether there was a fork, and all of them have been waited for."""
    for child in children:
        with pytest.raises(ChildProcessError):
            os.waitpid(child, os.WNOHANG)
    return bool(children)


def test_two_processes_share_the_jobs_and_each_is_done_once(tmp_path, children):
    second_process.compile_jobs([compiling(tmp_path, k) for k in range(6)])
    done_by = [int((tmp_path / str(k)).read_text()) for k in range(6)]
    assert len(set(done_by)) == 2 and os.getpid() in done_by
    assert have_ended(children)


def test_nothing_is_forked_where_all_is_on_disk(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "fork")
    for k in range(6):
        (tmp_path / str(k)).touch()
    second_process.compile_jobs([compiling(tmp_path, k) for k in range(6)])


@pytest.mark.parametrize("elsewhere", [lambda: os._exit(1), lambda: 1 / 0, lambda: time.sleep(60)])
def test_a_second_process_that_fails_or_hangs_is_ended_and_its_job_left(tmp_path, monkeypatch, children, elsewhere):
    monkeypatch.setattr(second_process, "PATIENCE", 0.1)
    since = time.monotonic()
    second_process.compile_jobs([compiling(tmp_path, k, elsewhere) for k in range(4)])
    assert time.monotonic() - since < 20
    assert {int(file.read_text()) for file in tmp_path.iterdir()} == {os.getpid()}
    assert len(list(tmp_path.iterdir())) >= 3
    assert have_ended(children)


def test_what_a_job_raises_here_is_raised(tmp_path, children):
    def broken():
        if code_cache.is_loading_only():
            raise code_cache.NotOnDisk
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        second_process.compile_jobs([broken, broken, broken, broken])
    assert have_ended(children)


@pytest.mark.parametrize("shader", ["path_tracer", "whitted", "albedo"])
def test_the_driver_is_compiled_ahead_for_the_types_that_renders_use(shader):
    """Else a cold start would compile it twice."""
    settings = engines.Settings(8, 8, precision="float32", shader=shader)
    renderer = engines.engine("numba").prepare(engines.load_scene("furnace"), settings)
    renderer.render(1)
    assert len(driver.driver(np.float32).signatures) == 1
