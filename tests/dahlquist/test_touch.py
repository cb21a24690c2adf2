"""Spheres are dragged by fingers and glide back."""

import numpy as np
import pytest

from engines.dahlquist import Tracer
from engines.dahlquist.animation import FOCAL, START

SIZE = 200
TOP = 4
"""A sphere that is in front of others, and whose target is far from the middle."""


def pixel_of(centre):
    """Where a point is seen, in pixels from the upper left corner."""
    return SIZE * (0.5 + FOCAL * centre[1] / centre[0]), SIZE * (0.5 + FOCAL * centre[2] / centre[0])


@pytest.fixture
def tracer():
    made = Tracer(SIZE, 2 * SIZE, engine="numpy")
    made.call(0)
    return made


def test_nothing_is_found_before_the_first_call():
    assert Tracer(SIZE, SIZE, engine="numpy").touch(*pixel_of(START[0])) == -1


def test_a_finger_finds_the_sphere_that_is_seen_there(tracer):
    found = [tracer.touch(*pixel_of(centre), finger=k) for k, centre in enumerate(tracer.animation.centres)]
    assert found == [0, 1, 2, 3, 4]
    assert tracer.touch(SIZE - 1, 2 * SIZE - 1) == -1


def test_a_held_sphere_follows_the_finger_less_the_pull_of_its_target(tracer):
    tracer.touch(*pixel_of(tracer.animation.centres[TOP]))
    tracer.move(20, 30)
    depth = float(tracer.animation.centres[TOP, 0])
    finger = np.array([depth, (20 / SIZE - 0.5) / 2.6 * depth, (30 / SIZE - 0.5) / 2.6 * depth])
    tracer.call(0)
    target = np.array([880.0, 60.0, 320.0])
    assert tracer.animation.centres[TOP] == pytest.approx(0.91 * finger + 0.09 * target, rel=1e-5)


def test_a_held_sphere_is_drawn_under_the_finger(tracer):
    tracer.touch(*pixel_of(tracer.animation.centres[TOP]))
    for _ in range(3):
        tracer.move(30, 300)
        tracer.call(0)
    assert tracer.touch(30, 300, finger=1) == TOP


def test_a_sphere_that_is_let_go_glides_back(tracer):
    still = Tracer(SIZE, 2 * SIZE, engine="numpy")
    still.call(0)
    tracer.touch(*pixel_of(tracer.animation.centres[TOP]))
    tracer.move(20, 30)
    apart = []
    for _ in range(4):
        tracer.call(0)
        still.call(0)
        tracer.release()
        apart.append(np.linalg.norm(tracer.animation.centres[TOP] - still.animation.centres[TOP]))
    assert apart[0] > 50
    assert np.divide(apart[1:], apart[:-1]) == pytest.approx(0.91, abs=1e-3)
    assert np.array_equal(tracer.animation.centres[:TOP], still.animation.centres[:TOP])
