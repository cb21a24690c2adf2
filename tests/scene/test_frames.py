"""Frames of normals and views: right-handed, of length 1, and where conventions put them."""

import numpy as np
import pytest

from engines.scene.frames import facing, local_frame, look_at, mitsuba_frame, tangents

NORMALS = [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (0.6, 0.0, -0.8), (0.48, 0.64, 0.6), (-0.8, 0.6, 0.0)]


@pytest.mark.parametrize("frame", [tangents, local_frame, mitsuba_frame])
@pytest.mark.parametrize("normal", NORMALS)
def test_two_tangents_and_the_normal_are_a_rotation(frame, normal):
    matrix = np.stack([*frame(np.array(normal)), normal])
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1)


def test_conventions_differ_below_the_horizon_alone():
    for normal in NORMALS:
        same = np.array_equal(local_frame(normal), mitsuba_frame(normal))
        assert same == (not -0.7 <= normal[2] < 0.0)
    assert not np.array_equal(local_frame((0.8, 0.0, -0.6)), mitsuba_frame((0.8, 0.0, -0.6)))


def test_what_faces_along_a_normal_is_placed_and_scaled():
    matrix = facing((1.0, 2.0, 3.0), (0.6, 0.0, -0.8), 2.0, 5.0)
    np.testing.assert_allclose(matrix @ [0, 0, 0, 1], [1, 2, 3, 1])
    np.testing.assert_allclose(matrix @ [0, 0, 1, 0], [3, 0, -4, 0])
    np.testing.assert_allclose(np.linalg.norm(matrix[:3, :2], axis=0), 2)


def test_a_view_has_its_target_ahead_and_left_at_x():
    matrix = look_at((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 3.0, 0.0))
    np.testing.assert_array_equal(matrix[:3].T, [[-1, 0, 0], [0, 1, 0], [0, 0, -1], [0, 0, 5]])
