"""`raybench dahlquist` writes frames and animations, and says what it cannot do."""

import hashlib
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from engines.errors import RaybenchError
from engines.packages import install_extra
from harness.cli import app
from tests.needs import needs


def command(*arguments):
    return CliRunner().invoke(app, ["dahlquist", *map(str, arguments)], catch_exceptions=True)


@pytest.mark.parametrize(
    ("words", "frames"),
    [
        ("", True),
        ("-o x.png", True),
        ("--engine=numpy --size=8x8 --output=x.png", True),
        ("-o x", True),
        ("--calls 2 -o x.exr", True),  # refused by the program's command, which has this option
        ("-o x.exr", False),
        ("-ox.exr", False),
        ("--out=x.jpg", False),
        ("--engine=embree", False),
        ("--engine embree", False),
        ("--spp=4", False),
    ],
)
def test_render_dahlquist_draws_frames_of_the_program_where_all_words_are_its(words, frames, monkeypatch):
    called = []
    monkeypatch.setattr("harness.cli.dahlquist.draw", lambda request: called.append(True))
    monkeypatch.setattr("harness.cli.render.render", lambda request: called.append(False))
    done = CliRunner().invoke(app, ["render", "dahlquist", *words.split()])
    assert (done.exit_code, called) == (0, [frames]), done.output
    assert "`raybench dahlquist` is now" not in done.output


def test_the_frame_is_written_with_its_flag(tmp_path):
    file = tmp_path / "frame.png"
    done = command("--size", "320x480", "--calls", 1, "--time-elapsed", 3000, "--engine", "numpy", "-o", file)
    assert done.exit_code == 0, done.output
    pixels = np.asarray(Image.open(file))
    assert hashlib.sha256(pixels.tobytes()).hexdigest() == "9e7888d91d13ba37f761a29e50b0dc2278280c29a1e6587132b55d3fbbef39f3"
    assert "million primary rays/s" in done.output


def test_options_reach_the_frame(tmp_path):
    Image.fromarray(np.full((4, 4, 3), 77, np.uint8)).save(tmp_path / "grey.png")
    frames = set()
    choices = ["--no-reflections", "--no-probe", "--interlaced", "--redraw", ("--probe", "smooth")]
    choices += [(f"--{kind}-image", tmp_path / "grey.png") for kind in ("probe", "background")]
    for choice in choices:
        words = choice if isinstance(choice, tuple) else (choice,)
        done = command("--size", "64x64", "--engine", "numpy", *words, "-o", tmp_path / "frame.png")
        assert done.exit_code == 0, done.output
        frames.add(np.asarray(Image.open(tmp_path / "frame.png")).tobytes())
    assert len(frames) == len(choices)


def test_an_animation_is_a_folder_or_a_gif_of_consecutive_calls(tmp_path):
    animated = ("--size", "48x48", "--engine", "numpy", "--calls", 3, "--animate", 4, "--time-elapsed", 20000)
    assert command(*animated, "-o", tmp_path / "frames").exit_code == 0
    files = sorted((tmp_path / "frames").iterdir())
    assert [file.name for file in files] == [f"frame_{call:05d}.png" for call in (3, 4, 5, 6)]
    alone = command("--size", "48x48", "--engine", "numpy", "--calls", 5, "--time-elapsed", 20000, "-o", tmp_path / "5.png")
    assert alone.exit_code == 0
    assert np.array_equal(np.asarray(Image.open(tmp_path / "5.png")), np.asarray(Image.open(files[2])))
    assert command(*animated, "-o", tmp_path / "movie.gif").exit_code == 0
    with Image.open(tmp_path / "movie.gif") as movie:
        assert (movie.n_frames, movie.size) == (4, (48, 48))


@needs("ffmpeg")
def test_an_mp4_is_written_where_an_encoder_is_installed(tmp_path):
    import imageio_ffmpeg

    file = tmp_path / "movie.mp4"
    done = command("--size", "47x33", "--engine", "numpy", "--animate", 5, "-o", file)
    assert done.exit_code == 0, done.output
    frames, _ = imageio_ffmpeg.count_frames_and_secs(str(file))
    assert frames == 5


def test_an_mp4_that_the_encoder_does_not_write_is_an_error(tmp_path, monkeypatch):
    """Whatever the encoder is: this one swallows the frames."""

    def write_frames(path, size, **options):
        while True:
            yield

    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", SimpleNamespace(write_frames=write_frames))
    done = command("--size", "16x16", "--engine", "numpy", "--animate", 2, "-o", tmp_path / "movie.mp4")
    assert isinstance(done.exception, RaybenchError) and "the encoder failed" in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_without_an_encoder_the_message_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    done = command("--size", "16x16", "--engine", "numpy", "--animate", 2, "-o", tmp_path / "movie.mp4")
    assert isinstance(done.exception, RaybenchError)
    assert install_extra("video") in str(done.exception)
    assert not (tmp_path / "movie.mp4").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--size", "10"], "--size 10: width and height are expected"),
        (["--calls", "0"], "--calls 0"),
        (["--animate", "0", "-o", "x.gif"], "--animate 0"),
        (["--probe", "chequer"], "did you mean 'checker'"),
        (["--engine", "nunba"], "did you mean 'numba'"),
        (["-o", "frame.jpg"], "must end in .png"),
        (["--animate", "2", "-o", "movie.avi"], "must end in .gif or .mp4"),
        (["-o", "nowhere/frame.png"], "the folder nowhere does not exist"),
        (["--probe-image", "nowhere.png"], "nowhere.png: cannot be read"),
        (["--threads", "0"], "--threads 0"),
    ],
)
def test_what_is_wrong_is_said(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = command(*arguments)
    assert isinstance(done.exception, RaybenchError)
    assert words in str(done.exception)
