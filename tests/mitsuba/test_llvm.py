"""Which LLVM Mitsuba compiles with: the user's, else a young enough one of the system, else the wheel's; no other is loaded."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from engines.errors import Unsupported
from engines.packages import install_extra
from engines.peers.mitsuba import llvm
from tests.needs import needs

ROOT = Path(__file__).resolve().parents[2]
LINE = "\t{name} (libc6,x86-64) => /lib/x86_64-linux-gnu/{name}\n"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Gives this machine other libraries: names in the loader's cache, files in LD_LIBRARY_PATH, the wheel or not."""
    monkeypatch.setattr(llvm.sys, "platform", "linux")
    monkeypatch.setattr(llvm.platform, "machine", lambda: "x86_64")

    def libraries(cached=(), beside=(), wheel=True, named=None):
        llvm._system.cache_clear()
        listing = "".join(LINE.format(name=name) for name in ("libm.so.6", *cached))
        (tmp_path / "ldconfig").write_text(
            f"#!/bin/sh\ncat <<'END'\n{listing}\tlibLLVM.so.29 (libc6) => /lib32/libLLVM.so.29\nEND\n"
        )
        (tmp_path / "ldconfig").chmod(0o755)
        for name in beside:
            (tmp_path / name).touch()
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
        monkeypatch.setenv("LD_LIBRARY_PATH", f":{tmp_path}")
        monkeypatch.setattr(llvm, "_of_wheel", lambda: "/env/lib/libLLVM.so.23.1" if wheel else None)
        monkeypatch.delenv(llvm.VARIABLE, raising=False)
        if named is not None:
            monkeypatch.setenv(llvm.VARIABLE, named)

    yield libraries
    llvm._system.cache_clear()


@pytest.mark.parametrize(
    ("cached", "taken"),
    [
        ([], "/env/lib/libLLVM.so.23.1"),
        (["libLLVM-15.so.1", "libLLVM-14.so"], "/env/lib/libLLVM.so.23.1"),
        (["libLLVM-15.so.1", "libLLVM-17.so.1"], "libLLVM-17.so.1"),
        (["libLLVM.so.19.1", "libLLVM-9.so"], "libLLVM.so.19.1"),
    ],
)
def test_a_system_one_of_17_or_later_comes_before_the_wheel_and_an_older_one_does_not(machine, cached, taken):
    machine(cached)
    assert Path(llvm.find()).name == Path(taken).name


def test_the_folders_of_the_loader_count_and_a_link_has_the_version_of_its_file(machine, tmp_path):
    machine(["libLLVM.so.18.1"], beside=["libLLVM-20.so"])
    assert llvm.find() == str(tmp_path / "libLLVM-20.so")
    (tmp_path / "libLLVM.so.21.1").touch()
    (tmp_path / "libLLVM-20.so").rename(tmp_path / "libLLVM-19.so")
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.21.1")
    llvm._system.cache_clear()
    assert Path(llvm.find()).resolve().name == "libLLVM.so.21.1"


def test_the_users_own_comes_first_whatever_it_is_and_there_is_no_other_where_it_is_missing(machine, tmp_path):
    machine(["libLLVM.so.19.1"], beside=["libLLVM-16.so"], named=str(tmp_path / "libLLVM-16.so"))
    assert llvm.find() == str(tmp_path / "libLLVM-16.so")
    machine(["libLLVM.so.19.1"], named="libLLVM-18.so.1")
    assert llvm.find() == "libLLVM-18.so.1", "a name is for the loader to find"
    machine(["libLLVM.so.19.1"], named="/nowhere/libLLVM.so")
    with pytest.raises(Unsupported, match=r"^[^\n]*/nowhere/libLLVM\.so does not exist: unset DRJIT_LIBLLVM_PATH, [^\n]*$"):
        llvm.find()


@pytest.mark.parametrize(("cached", "found"), [([], "none was found"), (["libLLVM-15.so.1"], "only 15 was found")])
def test_without_any_the_message_says_what_was_found_and_how_to_have_one(machine, cached, found):
    machine(cached, wheel=False)
    with pytest.raises(Unsupported) as raised:
        llvm.find()
    assert f"LLVM 17 or later, and {found}: {install_extra('mitsuba')};" in str(raised.value)


def test_the_variable_is_set_for_the_moment_of_the_import_only(machine):
    machine(["libLLVM.so.19.1"])
    with llvm.chosen():
        assert os.environ[llvm.VARIABLE].endswith("libLLVM.so.19.1")
    assert llvm.VARIABLE not in os.environ
    machine(wheel=False)
    with llvm.chosen():
        assert llvm.VARIABLE not in os.environ


def test_the_extra_asks_for_the_wheel_where_there_is_one():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    (line,) = (line for line in extras["mitsuba"] if line.startswith(llvm.WHEEL))
    assert line.partition(";")[2].strip() == "sys_platform == 'linux' and platform_machine == 'x86_64'"


LOADED = """
import os, engines
from engines.peers.mitsuba import library, llvm
scene = engines.scene_from({
    "raybench_scene": 1, "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
    "materials": {"grey": {"kd": 1}}, "lights": [{"environment": {"radiance": 1}}],
    "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}],
})
settings = engines.Settings(4, 4, sampler="random", precision="float32")
before = os.environ.get(llvm.VARIABLE)
for name in ("mitsuba", "mitsuba_scalar"):
    engine = engines.engine(name)
    print(engine.why_not(scene, settings) or f"{engine.prepare(scene, settings).render(4).mean().mean():.1f}")
assert os.environ.get(llvm.VARIABLE) == before
print(*{os.path.realpath(line.split()[-1]) for line in open("/proc/self/maps") if "libLLVM" in line})
"""


def rendered(named):
    environment = {key: value for key, value in os.environ.items() if key != llvm.VARIABLE} | named
    program = [sys.executable, "-c", LOADED]
    done = subprocess.run(program, capture_output=True, text=True, env=environment, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@needs("mitsuba-llvm", "linux")
def test_the_one_that_was_chosen_is_loaded_and_no_other():
    named = {llvm.VARIABLE: os.environ[llvm.VARIABLE]} if llvm.VARIABLE in os.environ else {}
    *images, loaded = rendered(named)
    assert images == ["1.0", "1.0"] and loaded == os.path.realpath(llvm.find())


@needs("mitsuba-scalar", "linux")
@pytest.mark.parametrize("content", [None, "no library"])
def test_a_library_of_the_users_that_cannot_be_loaded_is_named_and_scalar_mitsuba_renders(tmp_path, content):
    if content:
        (tmp_path / "libLLVM.so").write_text(content)
    reason, image, loaded = rendered({llvm.VARIABLE: str(tmp_path / "libLLVM.so")})
    assert reason.startswith("Mitsuba's llvm_ad_rgb needs LLVM 17 or later, and ") and str(tmp_path) in reason
    assert image == "1.0" and loaded == ""
