"""A disk that is full, a folder that cannot be written, a size that no machine holds: one line, exit code 2, nothing lost."""

import resource
import subprocess
import sys
import warnings

import pytest

from engines import memory
from engines.errors import ConfigError
from engines.film import Film
from harness import config, store
from harness.plan import planner
from harness.store import atomic
from harness.store.records import Start
from tests import forked
from tests.harness import sweeping

KIB = 1024


def ended(*arguments, folder, largest_file=None, **changes):
    """The command's exit code and stderr, under a limit of bytes a file."""
    done = forked.raybench(
        [*map(str, arguments)], folder, sweeping.environment(**changes), timeout=300, largest_file=largest_file
    )
    return done.returncode, done.stderr


def is_one_line(said):
    """Notes of progress may stand before it; the last line is the error, and no traceback is anywhere."""
    assert "Traceback" not in said and "Exception ignored" not in said, said
    last = said.strip().splitlines()[-1]
    assert last.startswith("raybench: "), said
    return last


@pytest.mark.parametrize("kib", [pytest.param(4, marks=pytest.mark.slow), 24])
def test_a_run_on_a_full_disk_ends_in_a_line_and_its_resume_in_the_rows_of_an_undisturbed_one(tmp_path, kib):
    path, out = sweeping.write(tmp_path, sweeping.EXPERIMENT.replace("images: none", "images: all")), tmp_path / "out"
    refs = {"RAYBENCH_REFERENCES": str(tmp_path / "refs")}
    command = ("run", path, "--allow-imports", "--out", out, "--set", "repeats=3")
    code, said = ended(*command, folder=tmp_path, largest_file=kib * KIB, **refs)
    assert code == 2 and "cannot be written: File too large" in is_one_line(said)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # not even a line cut short is left
        kept = store.latest_cells(store.read_events(out)) if (out / store.EVENTS).exists() else {}
    assert {event.state for event in kept.values()} <= {"done"}
    if kib == 24:
        assert 2 <= len(kept) < 7
    outcome, _ = sweeping.run(path, out, ["repeats=3"])
    assert set(outcome.states) == {"done"}
    sweeping.run(path, tmp_path / "undisturbed", ["repeats=3"])
    assert sweeping.rows(out) == sweeping.rows(tmp_path / "undisturbed")
    assert store.latest_cells(store.read_events(out)).items() >= kept.items(), "what was measured was not measured again"


def test_an_append_that_fails_leaves_no_half_line(tmp_path):
    event = Start(cell_id="a")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with store.Events(tmp_path) as events:
        events.append(event)
        size = (tmp_path / store.EVENTS).stat().st_size
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 10, before[1]))
        try:
            with pytest.raises(ConfigError, match=r"events\.jsonl: cannot be written: File too large"):
                events.append(event)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert (tmp_path / store.EVENTS).stat().st_size == size
        events.append(event)
    assert store.read_events(tmp_path) == [event, event]


@pytest.mark.parametrize("name", [store.MANIFEST, store.EVENTS, store.LOCK, "worker.log"])
def test_what_a_run_cannot_write_is_named(tmp_path, name):
    """A folder of that name is in the way, which stops root as well."""
    path, out = sweeping.write(tmp_path), tmp_path / "out"
    (out / name).mkdir(parents=True)
    code, said = ended("run", path, "--allow-imports", "--out", out, folder=tmp_path)
    assert code == 2 and str(out) in is_one_line(said)
    assert "Is a directory" in said or "not a regular file but a folder" in said


def test_a_manifest_that_may_not_be_replaced_is_named_and_nothing_is_lost(tmp_path, monkeypatch):
    path, out = sweeping.write(tmp_path), tmp_path / "out"
    sweeping.run(path, out, ["repeats=1"])
    before = {file.name: file.read_bytes() for file in out.iterdir()}

    def refused(source, target):
        raise PermissionError(13, "Permission denied", str(target))

    monkeypatch.setattr(atomic.os, "replace", refused)
    with pytest.raises(ConfigError, match=r"manifest\.json: cannot be written: Permission denied"):
        sweeping.run(path, out)
    monkeypatch.undo()
    assert {file.name: file.read_bytes() for file in out.iterdir()} | {store.LOCK: b""} == before | {store.LOCK: b""}
    assert sweeping.run(path, out)[0].states == {"done": 4}


@pytest.mark.parametrize(
    "command",
    [
        ("run", "small.yaml", "--allow-imports", "--out", "file/out"),
        ("run", "small.yaml", "--only", "references", "--allow-imports", "--references", "file/refs"),
        ("archive", "{folder}", "{folder}", "--out", "file/out"),
        ("archive", "{folder}", "--out", "file/out"),
        ("compare", "{folder}", "{folder}", "-o", "file/changes.csv"),
        ("render", "ball.yaml", "--engine", "numpy", "--spp", "1", "-o", "file/a.exr"),
        ("render", "dahlquist", "--engine", "numpy", "--size", "8x8", "-o", "file/a.png"),
        ("verify", "--engine", "numpy", "--quick", "--case", "cameras", "--out", "file/verify"),
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_a_folder_that_cannot_be_written_is_one_line(tmp_path, command):
    from tests.harness.synthetic import Size, write_folder

    sweeping.write(tmp_path)
    (tmp_path / "file").write_text("in the way")
    folder = tmp_path / "results"
    if "{folder}" in command:
        write_folder(folder, Size(16, 12), seeds=2, threads=(1,), with_images=False)
    words = [word.format(folder=folder) for word in command]
    code, said = ended(*words, folder=tmp_path)
    assert code == 2 and "file" in is_one_line(said)


@pytest.mark.parametrize("limit", [pytest.param(256, marks=pytest.mark.slow), 4 * KIB])
def test_a_report_on_a_full_disk_is_one_line_and_the_old_report_stays(tmp_path, limit):
    from tests.harness.synthetic import Size, write_folder

    folder = write_folder(tmp_path / "results", Size(16, 12), seeds=2, threads=(1,), with_images=False)
    (folder / "report.html").write_text("the old one")
    code, said = ended("report", folder, folder=tmp_path, largest_file=limit, MPLCONFIGDIR=str(tmp_path))
    assert code == 2 and "cannot be written: File too large" in is_one_line(said)
    assert (folder / "report.html").read_text() == "the old one"
    assert not list(folder.rglob("*.tmp"))


# --- sizes ----------------------------------------------------------------------------------------------------------

HUGE = "65536x65536"


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("render", "ball.yaml", "--engine", "numpy", "--spp", "1", "--size", HUGE, "-o", "a.exr"), "bytes of memory"),
        (("render", "dahlquist", "--size", HUGE, "-o", "a.png"), "67108864 pixels"),
        (("run", "small.yaml", "--allow-imports", "--set", "resolution=[65536, 65536]"), "bytes of memory"),
        (("plan", "small.yaml", "--allow-imports", "--set", "resolution=[65536, 65536]"), "bytes of memory"),
        (
            ("run", "small.yaml", "--only", "references", "--allow-imports", "--set", "resolution=[65536, 65536]"),
            "bytes of memory",
        ),
    ],
    ids=lambda part: part[0] if isinstance(part, tuple) else "",
)
def test_a_size_that_no_machine_holds_is_refused_with_bytes_and_limit(tmp_path, command, words):
    sweeping.write(tmp_path)
    code, said = ended(*command, folder=tmp_path)
    last = is_one_line(said)
    assert code == 2 and words in last and HUGE in last
    if "bytes" in words:
        assert str(memory.limit_bytes()) in last


def test_what_fits_is_not_refused(monkeypatch):
    monkeypatch.setattr(memory, "limit_bytes", lambda: 2**30)
    memory.require(2**30, "that")
    with pytest.raises(ConfigError, match=r"that: takes 1073741825 bytes of memory \(1 GiB\), and 1073741824"):
        memory.require(2**30 + 1, "that")
    with pytest.raises(ConfigError, match="a film of 8192x8192 pixels"):
        Film(8192, 8192)


def test_a_limit_of_the_process_counts():
    script = """
import resource
from engines import memory
resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))
print(memory.limit_bytes())
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=sweeping.environment(), capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str(2**30), done.stderr


def test_a_plan_names_the_file_whose_cells_do_not_fit(tmp_path, monkeypatch):
    path = sweeping.write(tmp_path)
    monkeypatch.setattr(memory, "limit_bytes", lambda: 2**30)
    with pytest.raises(ConfigError, match=r"small\.yaml resolution: a cell of 4096x2048 pixels: takes"):
        planner.make(config.load(path, ["resolution=[4096, 2048]"]), allow_imports=True)
