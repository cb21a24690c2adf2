"""Processes and their channels: what is received is a message or a clear error, within the deadline; none is left behind."""

import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
import pytest

from engines.processes import BadMessage, Channel, Closed, Process, pickled, records, status_in_words
from engines.processes.channel import HEAD, MARK, framed
from engines.processes.process import REMEMBERED
from tests.needs import needs

ROOT = Path(__file__).resolve().parents[2]
MIB = 1 << 20
PATIENCE = 60.0


class TooLate(Exception):
    pass


def give_up():
    raise TooLate


def started(function, *arguments, **options):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return Process(f"tests.processes.children:{function}", *arguments, environment=environment, **options)


def is_gone(pid):
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        try:
            if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.02)
    return False


@pytest.fixture
def ends():
    both = [Channel(each, most_bytes=MIB) for each in socket.socketpair()]
    yield both
    for each in both:
        each.close()


# --- messages -------------------------------------------------------------------------------------------------------


def test_arrays_numbers_and_descriptors_go_through(ends, tmp_path):
    ours, theirs = ends
    large, fields = np.arange(20_000.0), np.zeros(3, [("a", "f4"), ("b", "i4")])
    with (tmp_path / "file").open("w+b") as file:
        file.write(b"shared")
        file.flush()
        pickled.send(ours, {"large": large, "one": np.float32(1.5), "fields": fields}, file.fileno())
    found = pickled.receive(theirs)
    assert np.array_equal(found["large"], large) and found["one"] == 1.5 and found["fields"].dtype == fields.dtype
    descriptor = theirs.receive_descriptor()
    assert os.pread(descriptor, 9, 0) == b"shared" and not os.get_inheritable(descriptor)
    os.close(descriptor)


def test_a_channel_whose_other_end_is_closed_says_so(ends):
    ours, theirs = ends
    theirs.close()
    with pytest.raises(Closed):
        ours.receive()
    with pytest.raises(Closed):
        ours.send(b"hello")


@pytest.mark.parametrize("sent", [b"", b"ra", framed(b"a message")[:-1], HEAD.pack(MARK, 3, 0)])
def test_a_message_that_does_not_come_to_its_end_is_waited_for_until_the_deadline(ends, sent):
    ours, theirs = ends
    ours.socket.sendall(sent)
    with pytest.raises(TooLate):
        theirs.receive(give_up)


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (b"pass 1 of 4\nand more", "it wrote 'pass 1 of 4' where messages are sent"),
        (b"r\n", "it wrote 'r' where messages are sent"),
        (b"\xff" * 4096, "engines may print to stdout only"),
        (framed(b"x" * (MIB + 1))[:4096], "it sent a message of more than 1 MiB: 'xxx"),
        (HEAD.pack(MARK, 1, 0) + struct.pack("<Q", 1 << 60), "buffers of more than 1 MiB together"),
        (HEAD.pack(MARK, 1 << 31, 80) + b"x" * 80, "it sent a message of more than 1 MiB"),
    ],
)
def test_what_is_no_message_is_refused_at_once(ends, sent, words):
    ours, theirs = ends
    ours.socket.sendall(sent)
    with pytest.raises(BadMessage) as refused:
        theirs.receive(give_up)
    assert words in str(refused.value) and len(str(refused.value)) < 200


def test_a_message_of_the_largest_size_is_received(ends):
    ours, theirs = ends
    sender = threading.Thread(target=ours.send, args=[b"x" * MIB])
    sender.start()
    assert theirs.receive().data == b"x" * MIB
    sender.join()


class Spot(NamedTuple):
    spp: records.Count
    seconds: records.Seconds
    note: records.Text = ""


class Stop(NamedTuple):
    pass


def test_a_record_comes_back_as_it_was():
    for record in (Spot(3, 0.5, "x"), Spot(1, 0), Stop()):
        assert records.decoded(records.encoded(record), (Spot, Stop)) == record
    with pytest.raises(BadMessage, match="where messages are sent"):
        records.decoded(records.encoded(Stop()), [Spot])


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ('{"type": "spot", "spp": 1}', "its message 'spot' has seconds = None: a finite number from 0 on is expected"),
        ('{"type": "spot", "spp": true, "seconds": 1}', "spp = True: an integer above 0 is expected"),
        ('{"type": "spot", "spp": 1, "seconds": NaN}', "seconds = nan: a finite number from 0 on is expected"),
        ('{"type": "spot", "spp": 1, "seconds": 1, "note": null}', "note = None: text is expected"),
        ('{"type": "spot", "spp": 1, "seconds": 1, "rays": 2}', "has 'rays': spp, seconds, note are expected"),
    ],
)
def test_a_record_whose_fields_are_wrong_is_refused(message, words):
    with pytest.raises(BadMessage) as refused:
        records.decoded(message.encode(), (Spot, Stop))
    assert words in str(refused.value)


# --- processes ------------------------------------------------------------------------------------------------------


def test_what_a_process_prints_is_no_message_and_its_last_line_is_known(tmp_path, capfd):
    with (tmp_path / "log").open("ab") as log:
        process = started("echo", "--an", "argument", output=log)
    pickled.send(process.channels[0], 17)
    assert pickled.receive(process.channels[0]) == (["--an", "argument"], 17)
    assert process.ended(PATIENCE) == "ended with status 0"
    process.kill()
    assert (tmp_path / "log").read_text() == "to stdout\nto stderr\n\n"
    remembered = started("echo", output=REMEMBERED)
    pickled.send(remembered.channels[0], "")
    assert remembered.ended(PATIENCE) == "ended with status 0: to stderr"
    remembered.kill()
    assert capfd.readouterr().err == "to stdout\nto stderr\n\n"


@pytest.mark.parametrize(("status", "words"), [("3", "ended with status 3"), (f"-{signal.SIGSEGV:d}", "was killed by SIGSEGV")])
def test_the_end_of_a_process_is_told_with_its_last_words(status, words):
    process = started("end", status, output=REMEMBERED)
    with pytest.raises(Closed):
        process.channels[0].receive()
    assert process.ended(PATIENCE) == f"{words}: the last words"
    process.kill()
    assert status_in_words(-99) == "was killed by signal 99"


def test_a_process_that_closes_its_socket_and_goes_on_is_told_and_killed():
    process = started("close")
    with pytest.raises(Closed):
        process.channels[0].receive()
    assert process.ended(0.1) == "closed its socket and went on: it was killed"
    process.kill()
    assert not process.runs and is_gone(process.pid)


def test_a_process_that_another_has_started_has_no_end_of_its_channel_and_is_killed_with_it():
    process = started("start_another", "600")
    other = pickled.receive(process.channels[0])
    process.kill()
    assert is_gone(other)


def test_the_end_of_a_process_is_seen_though_one_that_it_has_started_goes_on():
    process = started("start_another", "0")
    other = pickled.receive(process.channels[0])
    try:
        with pytest.raises(Closed):
            process.channels[0].receive()
    finally:
        os.kill(other, signal.SIGKILL)
        process.kill()


def test_a_process_that_does_not_end_when_its_channels_are_closed_is_killed():
    process = started("write", "00")
    with pytest.raises(BadMessage):
        process.channels[0].receive()
    process.end(0.1)
    assert is_gone(process.pid)


PARENT = """
import sys, threading, time
from tests.processes.test_processes import started
made = []
start = lambda: made.append(started("write", "00"))
thread = threading.Thread(target=start)
thread.start() if sys.argv[1] == "thread" else start()
thread.is_alive() and thread.join()
made[0].channels[0]._wait(None)
print(made[0].pid, flush=True)
time.sleep(600)
"""


@needs("linux")
def test_a_process_ends_with_the_one_that_started_it():
    parent = subprocess.Popen([sys.executable, "-c", PARENT, "here"], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    assert psutil.Process(child).is_running()
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert is_gone(child)


@needs("linux")
def test_a_process_outlives_the_thread_that_started_it():
    parent = subprocess.Popen([sys.executable, "-c", PARENT, "thread"], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    time.sleep(0.2)
    assert psutil.Process(child).status() != psutil.STATUS_ZOMBIE
    parent.kill()
    parent.wait()
    parent.stdout.close()
    os.kill(child, signal.SIGKILL)


def test_a_python_that_is_none_is_refused_and_nothing_stays_open():
    before = psutil.Process().num_fds()
    with pytest.raises(OSError):
        started("echo", python="/nowhere/python", output=REMEMBERED)
    assert psutil.Process().num_fds() == before
