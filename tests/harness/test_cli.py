"""The command line, as a shell sees it: exit codes, messages without tracebacks, files."""

import json
import os
import shlex
import subprocess
import sys
from importlib.metadata import version
from io import StringIO
from types import SimpleNamespace

import pytest
from rich.console import Console
from typer.testing import CliRunner

from engines.choices import Choice
from engines.image import read_film_layers, read_provenance
from harness.cli import app, former
from harness.measure.machine import usable_cores
from harness.run import progress
from harness.settings import CellSettings
from tests.harness import sweeping
from tests.harness.sweeping import raybench
from tests.needs import needs

VERBS = (
    "race",
    "run",
    "plan",
    "status",
    "report",
    "compare",
    "figure",
    "archive",
    "render",
    "view",
    "convert",
    "verify",
    "list",
)
FORMER = {
    "reference quick -o a --set repeats=2": "run quick -o a --set repeats=2 --only references",
    "rescore a --set quality.epsilon=0.1": "report --rescore a --set quality.epsilon=0.1",
    "calibrate a": "report --calibrate a",
    "merge a b --out=c": "archive a b --out=c",
    "equivalence --same-seeds box --engines=a,b:c": "verify --same-seeds --scene box --against a --engine b:c",
    "trace box --count 9 --max-time=1s --json -Da=2": "race box --set ray_sets.count=9 --time 1s --json -D a=2 --rays all "
    "--out results/trace",
    "trace a b --rays camera -o c --seed 3": "race a b --rays camera -o c --set seed=3",
    "dahlquist --calls 3": "render dahlquist --calls 3",
    "dahlquist -o a.png": "render dahlquist --calls 1 -o a.png",
    "schema": "list --schema experiment",
    "schema scene": "list --schema scene",
    "export box --to pbrt -o folder --spp 4": "convert box -o folder/box.pbrt --spp 4",
    "import box.xml -o folder": "convert box.xml -o folder",
}


def ended(done, code):
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    return done.stdout + done.stderr


def test_help_names_every_verb_and_the_exit_codes():
    said = subprocess.run(
        [sys.executable, "-m", "harness", "--help"], env=sweeping.environment(), capture_output=True, text=True, check=True
    ).stdout
    assert all(f"│ {verb} " in said for verb in VERBS) and "Exit codes" in said
    assert not any(f"│ {verb} " in said for verb in former.COMMANDS)


def test_former_commands_and_options_work_and_name_the_new_ones():
    assert {words.split()[0] for words in FORMER} == {*former.COMMANDS}
    for words, now in FORMER.items():
        assert shlex.join(former.translated(words.split())) == now
    for verb in former.COMMANDS:
        done = CliRunner().invoke(app, [verb, "-h"])
        assert done.exit_code == 0 and f"note: `raybench {verb}` is now `raybench " in done.stderr
    done = CliRunner().invoke(app, ["compare", "--output=here.jpg", "a", "b"])
    assert "--output is now --out" in done.stderr and "-o here.jpg: must end in" in str(done.exception)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself_and_flags_have_no_type(verb):
    said = ended(raybench(verb, "-h", COLUMNS="80"), 0)
    assert "<bool>" not in said and "--help" in said


def test_help_has_groups_and_the_version_is_the_package_s():
    said = ended(raybench("-h", COLUMNS="80"), 0)
    assert (
        all(f"─ {group} ─" in said for group in ("Experiments", "Images and scenes", "Results")) and "─ Commands ─" not in said
    )
    assert ended(raybench("--version"), 0) == f"raybench {version('raybench')}\n"


def test_the_shell_completes_commands_and_the_names_of_scenes():
    def completed(line):
        return raybench(_RAYBENCH_COMPLETE="complete_bash", COMP_WORDS=line, COMP_CWORD=str(line.count(" "))).stdout

    assert completed("raybench pla").split() == ["plan"]
    assert "cornell_box" in completed("raybench render corn").split()
    assert completed("raybench list --schema sc").split() == ["scene"]
    assert completed("raybench race cornell_box --engine numpy,numb").split() == ["numpy,numba"]
    assert completed("raybench verify --against numba --shader path").split() == ["path_tracer"]


@pytest.mark.parametrize("width", [80, 200])
def test_progress_shows_counts_time_left_and_samples_whole_at_any_width(width):
    chosen = {"shader": Choice("path_tracer"), "sampler": Choice("sobol"), "accelerator": Choice("bvh")}
    out, settings = StringIO(), CellSettings(**chosen, precision="float32", threads=16, width=8, height=8)
    cell = SimpleNamespace(scene=SimpleNamespace(name="a_long_scene"), engine_name="numba", settings=settings, seed=1, label="")
    with progress.Terminal(Console(file=out, force_terminal=True, width=width, color_system=None)) as terminal:
        terminal.cell(cell, 12, 340, 4000.0)
        terminal.point(256, 3.2, 0.1)
    drawn = out.getvalue().rpartition("\r\x1b[2K")[0].rpartition("\r\x1b[2K")[2]
    assert "12/340 at most 1 h 6 min left: 256 spp in 3 s, a_long_scene" in drawn and len(drawn) <= width


def test_nothing_heavy_is_imported_for_help():
    script = "import sys, harness.cli; print([m for m in ('numpy', 'numba', 'engines') if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", script], env=sweeping.environment(), capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "quikc"], "unknown experiment 'quikc': did you mean 'quick'?"),
        (["run", "no/such.yaml"], "experiment 'no/such.yaml': there is no such file"),
        (["run", "quick", "--set", "repeets=2"], "--set repeets: unknown key: did you mean 'repeats'?"),
        (["run", "quick", "--retry", "failed"], "Got unexpected extra argument"),
        (["run", "quick", "--frsh"], "--fresh"),
        (["run"], "Missing argument"),
        (["rum"], "run"),
        (["render", "cornel_box"], "unknown scene 'cornel_box': did you mean 'cornell_box'?"),
        (["render", "cornell_box", "--engine", "numpie"], "unknown engine 'numpie': did you mean 'numpy'?"),
        (["render", "cornell_box", "--shader", "path_tracr"], "did you mean 'path_tracer'?"),
        (["render", "cornell_box", "--shader", "{name: path_tracer, max_dept: 3}"], "did you mean 'max_depth'?"),
        (["render", "cornell_box", "--shader", "{name: path_tracer, max_depth: 0}"], "must be an integer in [1,"),
        (["render", "cornell_box", "--shader", "{max_depth: 3}"], "a name, or {name: ..., option: value}, is expected"),
        (["render", "cornell_box", "--shader", "my:shader"], "run with --allow-imports if you trust it"),
        (["render", "cornell_box", "--engine", "my:engine"], "run with --allow-imports if you trust it"),
        (["render", "cornell_box", "--size", "16"], "--size 16: width and height are expected, as 256x192"),
        (
            ["plan", "quick", "--set", "resolution=16"],
            "resolution = 16: width and height are expected, as 256x192 or [256, 192]",
        ),
        (["render", "cornell_box", "--spp", "1e3"], "'--spp': '1e3': must be an integer"),
        (["view", "--port", "70000"], "'--port': 70000: must be at most 65535"),
        (["render", "cornell_box", "--size", "100000x4"], "settings.width = 100000: must be an integer in [1, 65536]"),
        (["render", "cornell_box", "--size", "0x4"], "settings.width = 0: must be an integer in [1, 65536]"),
        (["render", "cornell_box", "--spp", "0"], "--spp 0: must be in [1,"),
        (["render", "cornell_box", "--spp", "many"], "Invalid value for '--spp'"),
        (["render", "cornell_box", "--threads", "0"], "settings.threads = 0"),
        (["render", "cornell_box", "--seed", "-1"], "settings.seed = -1"),
        (["render", "cornell_box", "--precision", "half"], "settings.precision = 'half'"),
        (["render", "cornell_box", "--tone-mapper", "acse"], "unknown tone mapper 'acse': did you mean 'aces'?"),
        (["render", "cornell_box", "--tone-mapper", "my:curve"], "run with --allow-imports if you trust it"),
        (["render", "cornell_box", "--tone-mapper", "math:no", "--allow-imports"], "math:no: cannot be imported"),
        (["render", "cornell_box", "--tone-mapper", "math:pi", "--allow-imports"], "a callable from array to array"),
        (["render", "cornell_box", "--tone-mapper", "math:sqrt", "--allow-imports"], "math:sqrt: fails: TypeError"),
        (["render", "cornell_box", "-o", "image.bmpp"], "must end in .exr, .png, .jpg, .jpeg, .bmp, .tif, .tiff or .webp"),
        (["render", "cornell_box", "-o", "no/folder/a.exr"], "the folder no/folder does not exist"),
        (["render", "cornell_box", "--engine", "numpy", "--precision", "float32"], "computes in float64 only"),
        (["equivalence", "cornell_box", "--engines", "numpy,numba", "--spp", "-1"], "Invalid value for '--spp'"),
        (["verify", "--scene", "gears"], "--scene: is for images, with --against ENGINE"),
        (["verify", "-D", "side=2"], "-D: is for images, with --against ENGINE"),
        (["verify", "--engine", "numpy", "--against", "numpy", "--quick"], "--quick: is for checks, without --against"),
        (["report", "nowhere"], "nowhere: no events.jsonl is there"),
        (["status", "nowhere"], "nowhere: no events.jsonl is there"),
        (["compare", "nowhere", "neither"], "nowhere: no events.jsonl is there"),
    ],
)
def test_wrong_input_is_one_message_and_exit_code_2(arguments, message, tmp_path):
    said = ended(raybench(*arguments, cwd=tmp_path), 2)
    assert message in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "quick", "--out", "taken"], "is a file"),
        (["plan", "quick", "--out", "taken"], "is a file"),
        (["plan", "quick", "--references", "taken"], "is a file"),
        (["merge", "nowhere", "--out", "taken"], "is a file"),
        (["dahlquist", "--animate", "2", "-o", "taken"], "-o taken: is a file; a folder is expected"),
    ],
)
def test_a_file_in_place_of_a_folder_is_refused_before_any_work(arguments, message, tmp_path):
    (tmp_path / "taken").touch()
    (tmp_path / "folder.png").mkdir()
    assert message in " ".join(ended(raybench(*arguments, cwd=tmp_path), 2).split())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.png", "taken"]


@needs("unprivileged")
def test_render_refuses_a_folder_that_cannot_be_written_before_it_renders(tmp_path):
    tmp_path.chmod(0o500)
    said = ended(raybench("render", "cornell_box", "-o", tmp_path / "a.png", cwd=tmp_path), 2)
    assert "cannot be written to" in said and "built in" not in said


def test_a_broken_scene_is_one_message_and_exit_code_2(tmp_path):
    path = sweeping.write(tmp_path)
    (tmp_path / "ball.yaml").write_text(sweeping.SCENE.replace("radius: 1", "radius: -1"))
    said = ended(raybench("run", path, "--allow-imports", cwd=tmp_path), 2)
    assert "ball.yaml:5" in said and "radius" in said


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_render_writes_an_image_that_says_where_it_comes_from(tmp_path, suffix):
    out = tmp_path / f"a.{suffix}"
    arguments = ["--engine", "numpy", "--shader", "{name: path_tracer, max_depth: 3}", "--spp", "2", "--seed", "5"]
    said = ended(raybench("render", "cornell_box", *arguments, "--size", "16x12", "-o", out), 0)
    assert "16x12, 2 spp in" in said and "million paths/s" in said
    told = read_provenance(out)
    assert told["engine"] == "numpy" and told["spp"] == 2 and told["seed"] == 5
    assert told["settings"]["shader"]["max_depth"] == 3
    if suffix == "exr":
        assert read_film_layers(out).mean.shape == (12, 16, 3)


def with_own_references(command, path, *more, cwd):
    """Other tests make references of the same image with more samples, from which noise would be estimated."""
    return raybench(command, path, "--allow-imports", *more, cwd=cwd, RAYBENCH_REFERENCES=str(cwd / "references"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    text = sweeping.EXPERIMENT.replace("'fake_engines:Other'", "'fake_engines:Other', 'fake_engines:Picky'")
    path = sweeping.write(folder, text)
    said = ended(with_own_references("plan", path, cwd=folder), 0)
    assert "samples needed for the target 0.1 in relMSE (ε = 0.01): not known before its first replicates" in said
    return path, folder, with_own_references("run", path, cwd=folder)


def test_run_writes_its_files_where_the_name_says(finished):
    _, folder, done = finished
    assert "4 done, 2 skipped" in (said := ended(done, 0))
    assert (folder / "results/small/winners.txt").read_text("utf-8") in done.stdout
    assert "Fastest to each target in relMSE (ε = 0.01)" in done.stdout and "ball to 0.1: " in done.stdout
    assert "reference of ball 12x8 64 spp: too few samples: the target 0.1 in relMSE (ε = 0.01) needs about" in said
    for name in ("manifest.json", "events.jsonl", "points.csv", "ttq.csv", "phases.csv", "report.html"):
        assert (folder / "results" / "small" / name).stat().st_size > 0
    manifest = json.loads((folder / "results" / "small" / "manifest.json").read_text())
    assert manifest["command"][:2] == ["raybench", "run"]
    assert [place.name for place in (folder / "results").iterdir()] == ["small"]


def test_the_second_run_touches_nothing(finished):
    path, folder, _ = finished
    files = [p for p in (folder / "results").rglob("*") if p.is_file() and p.name not in (".lock", "worker.log")]
    before = {p: p.stat().st_mtime_ns for p in files}
    said = ended(with_own_references("run", path, cwd=folder), 0)
    assert "4 done, 2 skipped" in said and "writing" not in said
    assert {p: p.stat().st_mtime_ns for p in files} == before


def test_plan_shows_states_reasons_and_time(finished):
    path, folder, _ = finished
    more = ["--set", "repeats=3", "--set", "aa_twin=false"]
    said = ended(with_own_references("plan", path, *more, cwd=folder), 0)
    assert "9 cells in 3 blocks: 4 done, 2 queued, 3 skipped" in said
    assert "it never feels like it" in said and "2 to measure:" in said and "as measured before" in said
    assert "reference of ball 12x8 64 spp" in said
    cores = len(usable_cores())
    assert ("no core is left for other work" in said) == (cores == 1)
    full = ended(with_own_references("plan", path, *more, "--set", f"threads={cores}", cwd=folder), 0)
    assert f"{cores} core{'s' if cores > 1 else ''}: no core is left for other work" in full
    assert "ready; too few samples: the target 0.1 in relMSE (ε = 0.01) needs about" in said
    easy = ended(with_own_references("plan", path, "--set", "quality.targets=[1.0]", cwd=folder), 0)
    assert "ready; enough samples: the target 1 in relMSE (ε = 0.01) needs about" in easy


def test_status_and_report_read_the_folder(finished):
    _, folder, _ = finished
    results = folder / "results" / "small"
    assert "small: 4 done, 2 skipped; not running." in ended(raybench("status", results), 0)
    (results / "report.html").unlink()
    ended(raybench("report", results), 0)
    assert (results / "report.html").exists()


def test_reference_renders_references_alone(tmp_path):
    path = sweeping.write(tmp_path)
    for words in ("made in", "ready in"):
        said = ended(
            raybench("run", "--only", "references", path, "--allow-imports", "--references", tmp_path / "refs", cwd=tmp_path), 0
        )
        assert f"{words} {tmp_path / 'refs'}" in said
    assert not (tmp_path / "results" / "small" / "events.jsonl").exists()


def test_a_failed_cell_makes_exit_code_1_and_is_named(tmp_path):
    path, out = sweeping.write(tmp_path, sweeping.EXPERIMENT.replace(":Other", ":Broken")), tmp_path / "out"
    out.mkdir()
    (out / "report.html").touch()
    os.utime(out / "report.html", (2**33, 2**33))  # a report younger than all results: none is written, which is slow
    said = ended(raybench("run", path, "--allow-imports", "--out", out, cwd=tmp_path), 1)
    assert "3 done, 1 failed" in said and "ValueError: the tree fell over" in said and "--retry measures these again" in said
    assert "failed: ball broken seed 2: ValueError" in ended(raybench("status", out), 0)


def test_list_names_everything():
    said = ended(raybench("list"), 0)
    names = ["numpy", "numba", "embree", "path_tracer", "max_depth", "sobol", "bvh", "cornell_box", "lantern", "quick", "aces"]
    assert [name for name in names if name not in said] == []


def test_the_schema_is_json():
    assert json.loads(ended(raybench("list", "--schema", "experiment"), 0))["title"] == "raybench experiment"


def test_a_closed_pipe_is_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "harness", "list"]
    environment = sweeping.environment()
    done = subprocess.run(command, env=environment, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert done.returncode == 141 and "Traceback" not in done.stderr
