"""An edited engine is another request: what it was measured with is outdated, and what has not changed is resumed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import engines
from engines import source_files
from engines.errors import ConfigError
from harness import config, source_hashes, store
from harness.plan import planner
from harness.run import sweep
from tests.harness import sweeping

ENGINE = """\
from fake_engines import Steady
import {module}_helper

class Mine(Steady):
    name = "mine"
"""
SCRIPT = """\
#!/usr/bin/env python3
import struct, sys
import grey_level
spp, seed, width, height = map(int, sys.argv[1:5])
values = [grey_level.LEVEL + 0.01 * (seed % 7)] * (3 * width * height)
with open(sys.argv[5], "wb") as file:
    file.write(f"PF\\n{width} {height}\\n-1.0\\n".encode() + struct.pack(f"<{len(values)}f", *values))
"""
DESCRIPTION = """\
raybench_renderer: 1
name: greyish
version: "1"
command: [./grey.py, "{spp}", "{seed}", "{width}", "{height}", "{image}", "{scene}"]
threads: 1
image: pfm
shaders: [path_tracer]
"""


@pytest.fixture
def mine(tmp_path, monkeypatch, request):
    """A folder with an engine in a module of its own and a helper beside it, that can be imported here and by workers."""
    module = f"mine_{abs(hash(request.node.nodeid))}"
    (tmp_path / f"{module}.py").write_text(ENGINE.format(module=module))
    (tmp_path / f"{module}_helper.py").write_text("LEVEL = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ["PYTHONPATH"]]))
    text = sweeping.EXPERIMENT.replace("fake_engines:Other", f"{module}:Mine").replace("repeats: 2", "repeats: 1")
    yield tmp_path, module, sweeping.write(tmp_path, text)
    sys.modules.pop(module, None)


def states(folder):
    found = store.latest_cells(store.read_events(folder)).values()
    return sorted((event.engine, event.state) for event in found)


def test_an_unchanged_engine_is_resumed_and_an_edited_one_measured_again(mine):
    folder, module, path = mine
    assert sweeping.run(path, folder / "out")[0].measured == 2
    assert sweeping.run(path, folder / "out")[0].measured == 0
    with (folder / f"{module}.py").open("a") as file:
        file.write("# faster\n")
    assert sweeping.run(path, folder / "out")[0].measured == 1
    assert states(folder / "out") == [("mine", "done"), ("mine", "outdated"), ("steady", "done")]
    (folder / f"{module}_helper.py").write_text("LEVEL = 2\n")
    assert sweeping.run(path, folder / "out")[0].measured == 1, "what it imports from beside it counts"
    (folder / f"{module}_helper.py").write_text("LEVEL = 1\n")
    assert sweeping.run(path, folder / "out")[0].measured == 0, "the first edit's results count again"


def test_an_engine_that_is_edited_while_the_run_goes_is_noticed(mine):
    folder, module, path = mine
    made = planner.make(config.load(path), allow_imports=True)
    (folder / f"{module}_helper.py").write_text("LEVEL = 3\n")
    with store.locked(folder / "out"):
        outcome = sweep.run(made, folder / "out", sweep.Options(allow_imports=True), sweeping.Quiet())
    assert outcome.states == {"done": 1, "failed": 1}
    assert outcome.failures[0][1].message == "the engine's code has changed since the run began: run again"


def test_a_reference_goes_by_the_code_of_its_engine_and_by_no_other(mine):
    folder, module, path = mine

    def reference_ids(engine):
        return set(planner.make(config.load(path, [f"reference.engine={engine}"]), allow_imports=True).references)

    before = reference_ids(f"{module}:Mine"), reference_ids("numpy")
    (folder / f"{module}_helper.py").write_text("LEVEL = 3\n")
    after = reference_ids(f"{module}:Mine"), reference_ids("numpy")
    assert not before[0] & after[0] and before[1] == after[1]


def test_a_renderers_script_is_part_of_its_cells(tmp_path):
    (tmp_path / "grey.py").write_text(SCRIPT)
    (tmp_path / "grey.py").chmod(0o755)
    (tmp_path / "grey_level.py").write_text("LEVEL = 0.5\n")
    (tmp_path / "grey.yaml").write_text(DESCRIPTION)
    text = sweeping.EXPERIMENT.replace("'fake_engines:Other'", "grey.yaml").replace("repeats: 2", "repeats: 1")
    path, out = sweeping.write(tmp_path, text + "sampler: random\n"), tmp_path / "out"

    def measured():
        made = planner.make(config.load(path), allow_imports=True, allow_commands=True)
        options = sweep.Options(allow_imports=True, allow_commands=True)
        outcome = sweep.run(made, out, options, sweeping.Quiet())
        assert not outcome.failures
        return outcome.measured

    assert [measured(), measured()] == [2, 0]
    (tmp_path / "grey.py").write_text(SCRIPT + "# and more\n")
    assert [measured(), measured()] == [1, 0]
    (tmp_path / "grey_level.py").write_text("LEVEL = 0.6\n")
    assert [measured(), measured()] == [1, 0], "what the script imports from beside it counts"
    assert states(out) == [("greyish", "done"), ("greyish", "outdated"), ("greyish", "outdated"), ("steady", "done")]


def test_the_files_that_a_description_names_are_found(tmp_path):
    for name in ("run", "scene_tool.py", "setup.sh", "unnamed.py"):
        (tmp_path / name).write_text("#!/bin/sh\n")
    words = f'[./run, {tmp_path}/scene_tool.py, "--setup={tmp_path}/setup.sh", unnamed.py, {tmp_path}/gone, "{{spp}}'
    (tmp_path / "it.yaml").write_text(DESCRIPTION.replace('[./grey.py, "{spp}', words))
    engine = engines.engine(str(tmp_path / "it.yaml"))
    named = engine.source_files()  # type: ignore[attr-defined]
    assert [file.name for file in named] == ["run", "scene_tool.py", "setup.sh"]
    (tmp_path / "it.yaml").write_text(DESCRIPTION.replace("./grey.py", "sh"))
    assert engines.engine(str(tmp_path / "it.yaml")).source_files() == []  # type: ignore[attr-defined]


# --- what is hashed ---------------------------------------------------------------------------------------------------


def package(folder: Path, name: str = "lantern") -> Path:
    """A package with an inner one, a native library, and things that are no code."""
    for path, text in {
        "__init__.py": "from lantern.inner import deep",
        "inner/__init__.py": "",
        "inner/deep.py": "import beside\n",
        "core.so": "machine code",
        "inner/__pycache__/deep.pyc": "compiled",
        ".git/hook.py": "",
        "notes.txt": "words",
    }.items():
        (folder / name / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / name / path).write_text(text)
    (folder / "beside.py").write_text("import beside_it, os\nfrom beside_them.part import thing\n")
    (folder / "beside_it.py").write_text("")
    (folder / "beside_them").mkdir()
    (folder / "beside_them" / "__init__.py").write_text("")
    (folder / "beside_them" / "part.py").write_text("thing = 1")
    (folder / "stranger.py").write_text("")
    return folder / name / "inner" / "deep.py"


def hashed(module):
    return [name for name, _ in source_files.code_files([module])]


LANTERN = ["lantern/__init__.py", "lantern/core.so", "lantern/inner/__init__.py", "lantern/inner/deep.py"]


def test_the_code_of_a_package_is_all_of_it_and_what_it_imports_from_beside_it(tmp_path):
    beside = ["beside.py", "beside_it.py", "beside_them/__init__.py", "beside_them/part.py"]
    assert hashed(package(tmp_path)) == beside + LANTERN


def test_the_code_of_an_installed_package_is_its_own_alone(tmp_path):
    assert hashed(package(tmp_path / "site-packages")) == LANTERN


def test_the_code_of_a_module_that_is_no_package_is_its_file_alone(tmp_path):
    package(tmp_path)
    assert hashed(tmp_path / "stranger.py") == ["stranger.py"]
    assert hashed(tmp_path / "lantern" / "inner" / "deep.py") == hashed(tmp_path / "lantern" / "__init__.py")


@pytest.mark.parametrize("name", LANTERN)
def test_every_file_of_code_changes_the_hash_and_its_place_does_not(tmp_path, name):
    module = package(tmp_path / "here")
    before = source_files.digest(source_files.code_files([module]))
    assert source_files.digest(source_files.code_files([package(tmp_path / "there")])) == before
    (tmp_path / "here/lantern/notes.txt").write_text("other words")
    assert source_files.digest(source_files.code_files([module])) == before
    (tmp_path / "here" / name).write_text("print(1)")
    assert source_files.digest(source_files.code_files([module])) != before


@pytest.fixture
def own_copy(tmp_path):
    """A copy of `engines`, to be edited, and the function that hashes the code of one of its engines."""
    copy = shutil.copytree(source_files.OWN, tmp_path / "engines", ignore=shutil.ignore_patterns("__pycache__"))
    return copy, lambda name: source_files.digest(
        source_files.own_engine_files(type(getattr(engines.engine(name), "local", engines.engine(name))).__module__, copy)
    )


def test_the_code_of_an_own_engine_is_its_part_of_the_package_and_what_that_imports(own_copy):
    copy, code = own_copy
    names = ("numpy", "numba", "embree", "mitsuba", "luxcore", "cycles")
    before = {name: code(name) for name in names}
    assert before["numba"] == source_hashes.engine_code(engines.engine("numba"), "numba")
    for file, changed in {
        "kernels/layout.py": {"numba", "embree"},
        "film.py": set(names),
        "scene/shapes.py": set(names),
        "peers/isolated/server.py": set(names),
        "processes/child.py": set(names),
        "peers/adapters/geometry.py": {"luxcore", "cycles", "mitsuba"},
        "sobol_numbers.py": {"numpy", "numba", "embree"},
        "numpy_reference/bsdf/__init__.py": {"numpy"},
        "peers/cycles/geometry.py": {"cycles"},
        "peers/mitsuba/nodes.py": {"mitsuba"},
    }.items():
        text = (copy / file).read_text()
        (copy / file).write_text(text + "# edited\n")
        assert {name for name in names if code(name) != before[name]} == changed, file
        (copy / file).write_text(text)


def test_all_that_an_own_engine_loads_is_part_of_its_code():
    """Asked of a process that renders: what was imported from `engines`, by whatever way, is hashed."""
    program = """
import sys
import engines, engines.source_files as source_files
from pathlib import Path
name = sys.argv[1]
renderer = engines.engine(name).prepare(engines.load_scene("cornell_box"), engines.Settings(
    width=8, height=8, shader="whitted", sampler="random"))
renderer.render(1)
engine = engines.engine(name)
hashed = {file for _, file in source_files.own_engine_files(type(engine).__module__)}
modules = [module for each, module in sys.modules.items() if each.split(".")[0] == "engines"]
loaded = {Path(module.__file__) for module in modules if module.__file__}
print(sorted(str(file) for file in loaded - hashed))
"""
    for name in ("numpy", "embree", "numba"):
        done = subprocess.run([sys.executable, "-c", program, name], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout.strip()) == (0, "[]"), done.stdout + done.stderr


def test_an_engine_may_name_files_of_its_own(tmp_path, monkeypatch):
    import fake_engines

    (tmp_path / "kernel.cl").write_text("1")
    plain = source_hashes.engine_code(fake_engines.Steady(), "fake_engines:Steady")
    monkeypatch.setattr(fake_engines.Steady, "source_files", lambda self: [tmp_path / "kernel.cl"], raising=False)
    first = source_hashes.engine_code(fake_engines.Steady(), "fake_engines:Steady")
    (tmp_path / "kernel.cl").write_text("2")
    assert len({plain, first, source_hashes.engine_code(fake_engines.Steady(), "fake_engines:Steady")}) == 3
    monkeypatch.setattr(fake_engines.Steady, "source_files", lambda self: 1 / 0, raising=False)
    with pytest.raises(ConfigError, match="steady: source_files failed: ZeroDivisionError"):
        source_hashes.engine_code(fake_engines.Steady(), "fake_engines:Steady")
