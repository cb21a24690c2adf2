"""Local frames of unit vectors."""

import numpy as np

from engines.numpy_reference.vectors import dot, frame, unit


def test_the_local_frame_is_orthonormal_for_every_normal():
    """The last two are those for which an older construction fails (Duff et al. 2017)."""
    normals = np.concatenate(
        [
            np.random.default_rng(1).normal(size=(20_000, 3)),
            np.eye(3),
            -np.eye(3),
            [(0.00038527316, 0.00038460016, -0.99999988079), (-0.00019813581, -0.00008946839, -0.99999988079)],
        ]
    )
    n = unit(normals.T)
    t1, t2 = frame(n)
    for defect in (dot(t1, t2), dot(t1, n), dot(t2, n), dot(t1, t1) - 1.0, dot(t2, t2) - 1.0):
        assert np.abs(defect).max() < 1e-10
