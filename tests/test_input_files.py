"""What a scene or a command names is opened only where it is a regular file, and starts no program, whatever it holds."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from engines.input_files import NotRegularFile, open_regular, unreadable
from engines.memory import lacking_memory
from tests import forked
from tests.gltf_file import GltfFile

HANG_SECONDS = 120
SCENE = {
    "raybench_scene": 1,
    "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]},
    "materials": {"m": {"kd": 0.5}},
}
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"
EPS = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n%%EndComments\nshowpage\n%%EOF\n"


def python(script: str, *words: str | Path, folder: Path, **environment: str) -> str:
    """The standard output of a script that must end by itself."""
    done = subprocess.run(
        [sys.executable, "-c", script, *map(str, words)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=HANG_SECONDS,
        stdin=subprocess.DEVNULL,
        check=False,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[1]), **environment},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def place(kind: str, path: Path) -> None:
    """Puts something at `path` that is no regular file."""
    if kind == "FIFO":
        os.mkfifo(path)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(str(path))
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to("/dev/zero")


@pytest.mark.parametrize("kind", ["FIFO", "socket", "folder", "device"])
def test_only_regular_files_are_opened_and_nothing_waits(tmp_path_factory, kind):
    folder = tmp_path_factory.mktemp("f")  # short: the name of a socket has a hundred characters
    place(kind, folder / "x")
    with pytest.raises(NotRegularFile) as caught:
        open_regular(folder / "x")
    assert unreadable(caught.value) == f"is not a regular file but a {kind}"
    (folder / "link").symlink_to("x")
    with pytest.raises(NotRegularFile):
        open_regular(folder / "link")


def test_a_fifo_that_takes_the_place_of_a_file_does_not_block(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("x")
    regular = os.stat(tmp_path / "a")
    os.mkfifo(tmp_path / "b")
    monkeypatch.setattr(os, "stat", lambda path: regular)
    with pytest.raises(NotRegularFile):
        open_regular(tmp_path / "b")


def test_regular_files_are_read_and_others_refused_as_open_does(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    with open_regular(tmp_path / "a") as file:
        assert file.read() == b"abc"
    with pytest.raises(FileNotFoundError) as caught:
        open_regular(tmp_path / "b")
    assert unreadable(caught.value) == "cannot be read: No such file or directory"


def test_reading_reserves_no_more_than_the_file_holds(tmp_path):
    (tmp_path / "a").write_bytes(b"abcdef")
    script = """
import resource
from engines.input_files import open_regular
with open_regular("a") as file:
    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    print(file.read(2), file.read(1 << 40), file.read(1 << 40), file.seek(1), file.read(), file.seek(9), file.read(1))
"""
    assert python(script, folder=tmp_path).strip() == "b'ab' b'cdef' b'' 1 b'bcdef' 9 b''"


READERS = """
import json, os, sys
import engines
from engines import image
from engines.errors import RaybenchError
from harness import config
def load(**more):
    return lambda: engines.scene_from(json.loads(sys.argv[1]) | more, allow_outside=True)
mesh = lambda name: load(shapes=[{"mesh": {"file": name}, "material": "m"}])
ways = {
    "x.yaml": [lambda: engines.load_scene("x.yaml"), lambda: config.load("./x.yaml"), lambda: engines.engine("x.yaml")],
    "x.obj": [mesh("x.obj")], "x.ply": [mesh("x.ply")], "x.stl": [mesh("x.stl")],
    "x.mtl": [load(shapes=[{"mesh": {"file": "names_x.obj"}}])],
    "x.glb": [lambda: engines.load_scene("x.glb")], "x.bin": [lambda: engines.load_scene("names_x.gltf")],
}
for name in ("x.png", "x.exr", "x.tif"):
    ways[name] = [load(lights=[{"environment": {"image": name}}])]
    ways[name] += [lambda name=name, read=read: read(name) for read in (image.read_image, image.read_provenance)]
for kind in os.listdir():
    os.chdir(kind)
    for name, readers in ways.items():
        for read in readers:
            try:
                read()
                print(json.dumps([kind, name, "was read"]))
            except RaybenchError as error:
                print(json.dumps([kind, name, str(error)]))
    os.chdir("..")
"""


def test_all_that_a_scene_names_must_be_a_regular_file(tmp_path_factory):
    """Scene, experiment, renderer's file, meshes, MTL, glTF, buffer, images: one line each with the name, and no waiting."""
    folder = tmp_path_factory.mktemp("f")
    for kind in ("FIFO", "folder", "socket"):
        (folder / kind).mkdir()
        for name in ("x.yaml", "x.obj", "x.ply", "x.stl", "x.mtl", "x.glb", "x.bin", "x.png", "x.exr", "x.tif"):
            place(kind, folder / kind / name)
        (folder / kind / "names_x.obj").write_text("mtllib x.mtl\n" + OBJ)
        (folder / kind / "names_x.gltf").write_text(GltfFile().gltf("x.bin"))
    lines = python(READERS, json.dumps(SCENE), folder=folder).splitlines()
    assert len(lines) == 3 * 18
    for line in lines:
        kind, name, message = json.loads(line)
        assert name in message and f"is not a regular file but a {kind}" in message and "\n" not in message


def test_a_command_line_names_no_fifo(tmp_path):
    os.mkfifo(tmp_path / "x.yaml")
    for command in (["render", "x.yaml"], ["plan", "x.yaml"], ["convert", "x.yaml", "-o", "a.pbrt"]):
        done = forked.raybench(command, tmp_path, os.environ, timeout=HANG_SECONDS)
        assert done.returncode == 2 and done.stderr.count("\n") == 1
        assert "x.yaml: is not a regular file but a FIFO" in done.stderr


def with_programs(folder: Path) -> str:
    """A PATH that leads to a Ghostscript alone, which leaves a file `started`."""
    (folder / "bin").mkdir()
    (folder / "bin" / "gs").write_text(f"#!/bin/sh\necho > '{folder}/started'\n")
    (folder / "bin" / "gs").chmod(0o755)
    return str(folder / "bin")


def test_an_eps_named_png_starts_no_program(tmp_path):
    (tmp_path / "a.png").write_bytes(EPS)
    path = with_programs(tmp_path)
    careless = "from PIL import Image\ntry: Image.open('a.png').load()\nexcept Exception: pass"
    python(careless, folder=tmp_path, PATH=path)
    assert (tmp_path / "started").exists(), "the trap is none: Pillow by itself starts no Ghostscript"
    (tmp_path / "started").unlink()
    script = """
from engines import errors, image
for read in (image.read_image, image.read_bitmap, image.read_provenance):
    try: read("a.png")
    except errors.SceneError as error: print(error)
"""
    wanted = "a.png: is not a usable image: the content of one of PNG, JPEG, BMP, TIFF, WEBP is expected"
    assert python(script, folder=tmp_path, PATH=path).splitlines() == [wanted] * 3
    assert not (tmp_path / "started").exists()


WATCHED = """
import json, os, sys
import engines, engines.image, PIL.Image, OpenEXR
PIL.Image.init()
from engines.errors import SceneError
opened, started = [], []
def hook(event, args):
    if event == "open" and isinstance(args[0], (str, bytes)):
        opened.append(os.path.realpath(os.fsdecode(args[0])))
    elif event in ("os.system", "subprocess.Popen", "os.posix_spawn", "os.exec", "os.fork", "os.spawn", "socket.connect"):
        started.append(event)
sys.addaudithook(hook)
for name in sys.argv[1:]:
    try: engines.load_scene(name)
    except SceneError: pass
print(json.dumps([opened, started]))
"""


def test_a_scene_starts_nothing_and_opens_only_what_it_names(tmp_path):
    """Commands and names of other files in OBJ, PLY, YAML and images are not followed; links that lead out are refused."""
    outside = tmp_path / "outside.obj"
    outside.write_text(OBJ)
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "link.obj").symlink_to(outside)
    (folder / "calls.obj").write_text("csh touch started\ncall ../outside.obj\nmtllib ../outside.mtl\nmaplib m\n" + OBJ)
    (folder / "a.obj").write_text("mtllib a.mtl\n" + OBJ)
    (folder / "a.mtl").write_text("newmtl a\nmap_Kd ../outside.png\n")
    header = "ply\nformat ascii 1.0\ncomment TextureFile ../outside.png\nelement vertex 3\nproperty float x\nproperty float y\n"
    header += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (folder / "a.ply").write_text(header + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    (folder / "a.png").write_bytes(EPS)
    for suffix, content in ((".jpg", b"%PDF-1.4\n"), (".tif", b"\xd7\xcd\xc6\x9a" + bytes(40)), (".exr", EPS)):
        (folder / f"a{suffix}").write_bytes(content)
    meshes = ("calls.obj", "a.obj", "a.ply", "link.obj", "../outside.obj", str(outside), "/dev/zero")
    things = [{"shapes": [{"mesh": {"file": mesh}, "material": "m"}]} for mesh in meshes]
    things += [{"shapes": [{"mesh": {"file": mesh}}]} for mesh in ("calls.obj", "a.obj")]
    things += [{"lights": [{"environment": {"image": f"a{suffix}"}}]} for suffix in (".png", ".jpg", ".tif", ".exr")]
    for index, thing in enumerate(things):
        (folder / f"{index}.yaml").write_text(yaml.safe_dump(SCENE | thing))
    for index, tag in enumerate(("!!python/object/apply:os.system [touch started]", "!include ../outside.obj")):
        (folder / f"tag{index}.yaml").write_text(f"raybench_scene: 1\nname: {tag}\n")
    (folder / "code.yaml").write_text("raybench_scene: 1\ncamera: {type: 'os:getcwd'}\n")
    opened, started = json.loads(python(WATCHED, *sorted(folder.glob("*.yaml")), folder=folder, PATH=with_programs(tmp_path)))
    assert started == [] and not (folder / "started").exists() and not (tmp_path / "started").exists()
    ours = {Path(path) for path in opened if Path(path).is_relative_to(tmp_path.resolve())}
    assert folder.resolve() / "a.mtl" in ours and folder.resolve() / "a.png" in ours, "nothing was watched"
    assert {path for path in ours if path.parent != folder.resolve()} == set()
    assert not any(path.startswith("/dev/") for path in opened if Path(path) not in ours)


def test_memory_that_this_process_may_not_take_is_lacking():
    assert lacking_memory(1.0) == ""
    assert "this machine has" in lacking_memory(1e18)
    script = """
import resource
from engines.memory import lacking_memory
resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
print(lacking_memory(2.0 ** 33), lacking_memory(2.0 ** 20) == "")
"""
    found = python(script, folder=Path.cwd())
    assert found.endswith("True\n") and ("this process may take" in found or "this machine has" in found)
