"""Every option `-o`: what cannot be written is refused in one sentence, before a scene is read or anything is drawn."""

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from engines.errors import ConfigError
from harness.cli.commands import app

COMMANDS = {
    "render": ("render cornell_box", ".png"),
    "dahlquist": ("dahlquist --probe-image no_image.png", ".png"),
    "animate": ("dahlquist --animate 2 --probe-image no_image.png", ".gif"),
    "compare": ("compare no_results no_results", ".csv"),
}
FAULTS = {
    "image.xyz": "must end in",
    "folder{}": "is a folder; a file is expected",
    "nowhere/file{}": "the folder nowhere does not exist",
    "taken/file{}": "the folder taken does not exist",
}


def refusal(command: str, output: str) -> str:
    error = CliRunner().invoke(app, [*command.split(), "-o", output]).exception
    assert isinstance(error, ConfigError), error
    return str(error)


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").touch()
    for suffix in (".png", ".gif", ".csv", ".pbrt"):
        (tmp_path / f"folder{suffix}").mkdir()
    return tmp_path


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", COMMANDS)
def test_an_output_that_cannot_be_written_is_refused_first(name, fault, place, monkeypatch):
    command, suffix = COMMANDS[name]
    if name == "render":
        monkeypatch.setattr("harness.cli.render.load_scene", None)
    before = sorted(place.rglob("*"))
    output = fault.format(suffix)
    assert refusal(command, output).startswith(f"-o {output}: {FAULTS[fault]}")
    assert sorted(place.rglob("*")) == before


@pytest.mark.parametrize("name", ["render cornell_box", "dahlquist", "compare a b"])
def test_a_file_without_a_suffix_is_refused(name, place):
    assert "must end in" in refusal(name, "file")


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("taken", "taken: must end in .pbrt, or be a folder"),
        ("taken/a.pbrt", "taken/a.pbrt: cannot be written"),
        ("a.xml", "a.xml: must end in .pbrt, or be a folder"),
    ],
)
def test_export_refuses_what_it_cannot_write(output, message, place):
    assert refusal("export cornell_box --to pbrt", output).startswith(message)


@pytest.mark.parametrize(("output", "written"), [("A.PBRT", "A.PBRT"), ("folder.pbrt", "folder.pbrt/cornell_box.pbrt")])
def test_export_takes_suffixes_in_upper_case_and_folders_with_one(output, written, place):
    done = CliRunner().invoke(app, ["export", "cornell_box", "--to", "pbrt", "-o", output])
    assert done.exit_code == 0, done.output
    assert (place / written).read_text().startswith("Scale -1 1 1")


@pytest.mark.parametrize(
    ("scene", "output"),
    [
        ("scene.yaml", "scene.yaml"),
        ("scene.yaml", "."),
        ("link/scene.yaml", "."),
        ("a.xml", "a.xml"),
        ("a.xml", "folder.pbrt/../a.xml"),
        ("meshes/m.ply", "."),
    ],
)
def test_convert_does_not_write_over_the_scene_that_it_reads(scene, output, place):
    (place / "meshes").mkdir()
    (place / "link").symlink_to(place)
    for name in ("scene.yaml", "a.xml", "meshes/m.ply"):
        (place / name).write_text("mine")
    found = scene.removeprefix("link/")  # links are followed
    assert f"the scene to convert reads {found}: another file or folder is expected" in refusal(f"convert {scene}", output)
    assert (place / scene).read_text() == "mine"


def test_convert_does_not_write_over_the_meshes_that_the_scene_reads(place):
    (place / "meshes").mkdir()
    (place / "meshes" / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (place / "room.yaml").write_text(
        "raybench_scene: 1\ncamera: {type: perspective, eye: [0, 0, 3], target: [0, 0, 0], fov: 40}\n"
        "materials: {m: {kd: 0.5}}\nshapes: [{mesh: {file: meshes/m.obj}, material: m}]\n"
    )
    assert "the scene to convert reads meshes/m.obj" in refusal("convert room.yaml", ".")
    assert [file.name for file in (place / "meshes").iterdir()] == ["m.obj"]


@pytest.mark.parametrize("suffix", [".JPG", ".jpeg", ".PNG", ".bmp", ".tif", ".webp"])
def test_render_writes_an_image_of_the_format_of_its_suffix(suffix, place):
    arguments = ["render", "cornell_box", "--engine", "numpy", "--spp", "1", "--size", "8x6", "--shader", "albedo"]
    done = CliRunner().invoke(app, [*arguments, "-o", f"x{suffix}"])
    assert done.exit_code == 0, done.output
    with Image.open(place / f"x{suffix}") as image:
        assert image.size == (8, 6) and image.format == Image.registered_extensions()[suffix.lower()]


def test_an_exposure_brightens_the_image_by_its_stops(place):
    arguments = ["render", "cornell_box", "--engine", "numpy", "--spp", "1", "--size", "8x6", "--tone-mapper", "linear"]
    values = []
    for name, more in (("dark.png", []), ("bright.png", ["--exposure", "1"])):
        done = CliRunner().invoke(app, [*arguments, "--shader", "albedo", *more, "-o", name])
        assert done.exit_code == 0, done.output
        values.append(np.asarray(Image.open(name)).astype(int))
    dark, bright = values
    assert dark.max() > 0 and np.abs(bright - np.minimum(2 * dark, 255)).max() <= 1
