"""Bounding boxes of shapes."""

import numpy as np
import pytest

from engines.scene import Disk, Mesh, Plane, Sphere, SphereSet, Triangle

VERTICES = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [9, 9, 9]])
"""No face has the last one."""


@pytest.mark.parametrize(
    ("shape", "low", "high"),
    [
        (Sphere((1.0, 2.0, 3.0), 0.5, 0), (0.5, 1.5, 2.5), (1.5, 2.5, 3.5)),
        (Triangle((0.0, 5.0, 2.0), (1.0, -1.0, 2.0), (0.5, 0.0, 2.0), 0), (0, -1, 2), (1, 5, 2)),
        (Disk((1.0, 1.0, 1.0), (0.0, 1.0, 0.0), 2.0, 0), (-1, 1, -1), (3, 1, 3)),
        (Disk((0.0, 0.0, 0.0), (0.6, 0.8, 0.0), 1.0, 0), (-0.8, -0.6, -1), (0.8, 0.6, 1)),
        (SphereSet(np.array([[0.0, 0, 0], [5, 0, 0]]), np.array([1.0, 2.0]), 0), (-1, -2, -2), (7, 2, 2)),
        (Mesh(VERTICES, np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32)), (0, 0, 0), (1, 2, 0)),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, tuple) else "",
)
def test_the_box_is_tight(shape, low, high):
    assert np.allclose(shape.bounds(), [low, high], atol=1e-15)


def test_what_has_no_end_or_no_face_has_no_box():
    assert Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0).bounds() is None
    assert Mesh(VERTICES, np.zeros((0, 3), np.int32), np.zeros(0, np.int32)).bounds() is None
