"""Frames of the port against those of the original, and against each other.

The hashes are those of the original's frames, built natively with optimisation and without fused multiply-add.
"""

import hashlib
from typing import NamedTuple

import numpy as np
import pytest

from engines import dahlquist
from engines.dahlquist import Tracer
from engines.errors import ConfigError, UnknownName

ENGINES = dahlquist.ENGINES


class Golden(NamedTuple):
    """A frame of the original: the size, the calls so far, the time given to each, what differs from the defaults."""

    width: int
    height: int
    calls: int
    time_elapsed: int
    options: dict
    sha256: str


DARK = {"environment": False}
FLAT = {"reflections": False}
SMOOTH = {"probe": dahlquist.smooth_probe()}
GOLDEN = [
    Golden(320, 480, 1, 3000, {}, "9e7888d91d13ba37f761a29e50b0dc2278280c29a1e6587132b55d3fbbef39f3"),
    Golden(320, 480, 11, 3000, {}, "326a14be7746340a27a051c8991e93994261fada06f35dd662639fc95d9f0ae6"),
    Golden(320, 480, 11, 3000, DARK, "bd5e043e64a6c9df2891b22e7a2de01dc47ee4b0d37707c924992e67a834eadb"),
    Golden(320, 480, 11, 3000, FLAT, "f05ea1e7ea8efc294d5d14aa67c9c71217ece90aed8867eaff40ed7622a56f85"),
    Golden(320, 480, 11, 3000, DARK | FLAT, "1a540484b99a28f23e1bad4d4ee4542ae196d1ab9324b909623ff9acd0c8219b"),
    Golden(320, 480, 101, 3000, {}, "adffcc6af478c18f3bb1ffedd2a39d546661396e89c5c561feda747073cba391"),
    Golden(320, 480, 2, 264, {}, "3f2b49f5f7c30506b778805ab3e306ba6a954e4e80ebcb0ef6680e188b7b1474"),
    Golden(640, 640, 11, 3000, {}, "e2c20a556c326038e19f6a049cad1335efac0bbbd8136f1c7a24e303c17aac9d"),
    Golden(640, 640, 2, 3000, {"interlaced": True}, "00edf79ea9a8ded3fa95a9cb2d276ce705c56898eaddb3e1562732398c707d5c"),
    Golden(640, 640, 11, 3000, SMOOTH, "1d8ad1f662b725c2c69af1170dcd7950ae7a858379539aa548075d6ee940962e"),
]


def sha256(frame):
    return hashlib.sha256(frame.tobytes()).hexdigest()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    "golden", GOLDEN, ids=lambda g: f"{g.width}x{g.height}-{g.calls}-{g.time_elapsed}-{'-'.join(g.options)}"
)
def test_the_frame_is_the_originals(golden, engine):
    tracer = Tracer(golden.width, golden.height, engine=engine, threads=2, **golden.options)
    first = golden.calls if engine == "numba" else 2
    for _ in range(golden.calls - first):
        tracer.animation.step(golden.time_elapsed)
    for _ in range(min(first, golden.calls)):
        tracer.call(golden.time_elapsed)
    assert sha256(tracer.frame) == golden.sha256


@pytest.mark.parametrize(("width", "height"), [(1, 1), (37, 50), (700, 530), (90, 31)])
@pytest.mark.parametrize("options", [{}, {"exact": True}, {"interlaced": True}], ids=str)
def test_engines_and_threads_draw_the_same_frame(width, height, options):
    frames = []
    for engine, threads in (("numpy", 1), ("numba", 1), ("numba", 3)):
        tracer = Tracer(width, height, engine=engine, threads=threads, **options)
        tracer.call(90_000)
        frames.append(tracer.call(90_000))
    assert np.array_equal(frames[0], frames[1])
    assert np.array_equal(frames[0], frames[2])


def test_pictures_of_other_sizes_are_stretched_alike():
    random = np.random.default_rng(1)
    pictures = {
        "probe": random.integers(0, 256, (31, 64, 3), np.uint8),
        "background": random.integers(0, 256, (40, 17, 3), np.uint8),
    }
    frames = [Tracer(100, 130, engine=engine, **pictures).call(3000) for engine in ENGINES]
    assert np.array_equal(*frames)


def test_without_the_area_hierarchy_only_rims_change():
    """The boxes cut off 0 to 36 of 409,600 pixels in the original."""
    boxed, exact = (Tracer(640, 640, exact=exact) for exact in (False, True))
    changed = []
    for _ in range(6):
        before, after = boxed.call(30_000), exact.call(30_000)
        changed.append(int((before != after).any(axis=2).sum()))
        assert (after[..., 3][before[..., 3] == dahlquist.SPHERE] == dahlquist.SPHERE).all()
    assert 0 < max(changed) <= 36


def test_the_background_is_drawn_once_and_anew_when_asked():
    tracer = Tracer(64, 64)
    fresh = tracer.call(3000).copy()
    place = tuple(np.argwhere(fresh[..., 3] == dahlquist.BACKGROUND)[0])
    tracer.frame[place] = (1, 2, 3, dahlquist.BACKGROUND)
    assert tracer.call(0)[place].tolist() == [1, 2, 3, dahlquist.BACKGROUND]
    tracer.redraw_background()
    assert np.array_equal(tracer.call(0)[place], fresh[place])
    tracer.environment = False
    assert tracer.call(0)[place].tolist() == [10, 10, 15, dahlquist.BACKGROUND]


def test_an_interlaced_call_draws_every_other_row():
    tracer = Tracer(32, 32, interlaced=True)
    rows = tracer.call(3000)[:, :, 3]
    assert (rows[0::2] == 255).all()
    assert (rows[1::2] >= dahlquist.BACKGROUND).all()
    assert (tracer.frame[0::2, :, :3] == 0).all()
    assert tracer.frame[1::2, :, :3].any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"width": 0}, "0x32"),
        ({"width": 1 << 20, "height": 1 << 20}, "67108864"),
        ({"probe": np.zeros((4, 4), np.uint8)}, "probe"),
        ({"background": np.zeros((4, 4, 3))}, "background: float64"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options, words):
    with pytest.raises(ConfigError, match=words):
        Tracer(**({"width": 32, "height": 32} | options))


def test_an_unknown_engine_is_refused():
    with pytest.raises(UnknownName, match="numba, numpy"):
        Tracer(8, 8, engine="cuda")
