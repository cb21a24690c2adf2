"""Every accelerator finds the same hits on whatever triangles hypothesis thinks of.

Corners lie on a lattice, times a power of two of each triangle's own: many have no area, lie in one plane, in an axis'
plane or on one another, and sizes differ by up to 2^40. Rays start on the lattice, and go along it or at corners.
"""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from engines import Settings
from engines.registry import engine
from harness.verify.scenes import mesh, scene

NUMBERS = st.integers(-4, 4)
POINTS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
COMPONENTS = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, -2.0, 1e-40, -1e-40])
OPTIONS = settings(
    max_examples=25, deadline=None, derandomize=True, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
)


@st.composite
def triangles(draw, largest=20):
    """(n, 3, 3) corners: drawn one by one, then some of them again, and perhaps all of them pressed flat."""
    corners = np.array(draw(st.lists(st.tuples(POINTS, POINTS, POINTS), min_size=1, max_size=12)), float)
    sizes = st.integers(-largest, largest)
    corners *= 2.0 ** np.array(draw(st.lists(sizes, min_size=len(corners), max_size=len(corners))))[:, None, None]
    corners = corners[draw(st.lists(st.integers(0, len(corners) - 1), max_size=8)) + list(range(len(corners)))]
    axis = draw(st.sampled_from([None, 0, 1, 2]))
    if axis is not None:
        corners[:, :, axis] = draw(NUMBERS)
    return corners


def rays(draw, corners, n=32):
    """Origins and directions (2 n, 3): half along the lattice, half at corners."""
    origins = np.array(draw(st.lists(POINTS, min_size=2 * n, max_size=2 * n)), float) * 2.0 ** draw(st.integers(-3, 3))
    along = np.array(draw(st.lists(st.tuples(*[COMPONENTS] * 3), min_size=n, max_size=n)))
    points = corners.reshape(-1, 3)
    chosen = np.array(draw(st.lists(st.integers(0, len(points) - 1), min_size=n, max_size=n)))
    return origins, np.concatenate([along, points[chosen] - origins[n:]])


def _prepared(corners, name, accelerator):
    held = scene([mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))])
    return engine(name).prepare(held, Settings(accelerator=accelerator, precision="float64"))


@pytest.mark.parametrize(("name", "other"), [("numba", "grid"), ("numba", "bvh"), ("numpy", "bvh")])
@OPTIONS
@given(data=st.data())
def test_trees_and_grids_agree_with_brute_force(name, other, data):
    corners = data.draw(triangles())
    origins, directions = rays(data.draw, corners)
    every, tree = (_prepared(corners, name, accelerator) for accelerator in ("none", other))
    expected, found = every.trace(origins, directions), tree.trace(origins, directions)
    for field in ("t", "shape", "primitive", "normal", "u", "v"):
        assert np.array_equal(getattr(found, field), getattr(expected, field)), field
    dark = np.isfinite(expected.t)
    assert np.array_equal(every.occluded(origins, directions), dark)
    assert np.array_equal(tree.occluded(origins, directions), dark)


@OPTIONS
@given(data=st.data())
def test_embree_agrees_with_brute_force_except_at_edges(data):
    """Embree rounds directions to float32, so a ray at an outer edge may pass it; and of equal distances it takes any."""
    corners = data.draw(triangles(largest=0))
    origins, directions = rays(data.draw, corners)
    expected = _prepared(corners, "numba", "none").trace(origins, directions)
    renderer = _prepared(corners, "embree", "embree")
    found, dark = renderer.trace(origins, directions), renderer.occluded(origins, directions)
    inside = _inside(expected)
    assert np.allclose(found.t[inside], expected.t[inside], rtol=1e-12, atol=0)  # another of the faces in one plane
    assert dark[inside].all()
    assert not (np.isfinite(found.t) & np.isinf(expected.t)).any() and not (dark & np.isinf(expected.t)).any()


def _inside(hits):
    """Hits clearly inside their triangle."""
    margin = np.minimum(np.minimum(hits.u, hits.v), 1 - hits.u - hits.v)
    return np.isfinite(hits.t) & (margin > 1e-5)
