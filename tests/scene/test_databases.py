"""The families of Haines' databases, the teapot and the stadium: as many primitives as published, in the right places."""

from __future__ import annotations

import numpy as np
import pytest

from engines.scene import Mesh, SphereSet
from engines.scene.geometry import face_normals
from engines.scene.procedural.gears import FACES_PER_GEAR
from engines.scene.procedural.teapot import patches
from tests.scene.generated import is_closed, shape, signed_volume


def test_the_recommended_sizes_have_the_published_numbers_of_primitives():
    """Haines' README: balls 7381, gears 64, mount 8192 + 4, rings 4200 + 4200, tetra 4096; lattice 2197 + 6084."""
    assert len(shape(name="sphereflake", level=4).radii) == 7381
    assert len(shape(name="gears", level=4).faces) == 64 * FACES_PER_GEAR
    assert len(shape(name="mount", level=6).faces) == 8192
    assert len(shape(name="tetra", level=6).faces) == 4096
    for name, level, rods, joints in (("rings", 7, 4200, 4200), ("lattice", 12, 6084, 2197), ("tree", 11, 4095, 4095)):
        assert len(shape(name=name, level=level, sides=3).faces) == 2 * 3 * rods
        assert len(shape(name=name, level=level, part="joints").radii) == joints


def test_a_tetra_is_made_of_closed_regular_tetrahedra_inside_its_sphere():
    mesh = shape(name="tetra", level=3, center=[1, 2, 3], radius=2)
    assert is_closed(mesh) and len(mesh.faces) == 64
    side = 2 * (8 / 3) ** 0.5 / 4  # of a tetrahedron in a sphere of radius 2, halved twice
    corners = mesh.vertices[mesh.faces]
    assert np.allclose(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2), side)
    assert signed_volume(mesh) == pytest.approx(16 * side**3 / (6 * 2**0.5))
    assert np.linalg.norm(mesh.vertices - [1, 2, 3], axis=1).max() == pytest.approx(2)


def test_a_mount_moves_middles_and_leaves_what_was_there():
    coarse, fine = (shape(name="mount", level=level, size=4, height=1, seed=3).vertices for level in (3, 4))
    assert np.allclose(coarse.reshape(9, 9, 3), fine.reshape(17, 17, 3)[::2, ::2])
    one = shape(name="mount", level=1, size=4, height=1, seed=3).vertices.reshape(3, 3, 3)
    assert (one[::2, ::2, 1] == 0).all() and 0 < np.abs(one[:, :, 1]).max() <= 1
    assert not np.array_equal(fine, shape(name="mount", level=4, size=4, height=1, seed=4).vertices)
    mesh = shape(name="mount", level=5)
    assert (face_normals(mesh.vertices, mesh.faces)[:, 1] > 0).all()


def test_gears_are_closed_and_mesh_without_touching():
    mesh = shape(name="gears", level=2, radius=0.5)
    assert isinstance(mesh, Mesh) and is_closed(mesh) and signed_volume(mesh) > 0
    gears = mesh.vertices.reshape(8, -1, 3)
    middles = gears[:, 0, :2]
    for one, other in ((0, 2), (0, 4)):  # neighbours along y and x
        assert np.linalg.norm(middles[one] - middles[other]) == pytest.approx(1)
        outline = gears[other, 2:146, :2] - middles[one]
        reach = np.linalg.norm(outline, axis=1)
        assert reach.min() < np.linalg.norm(gears[one, 2:146, :2] - middles[one], axis=1).max(), "they do not mesh"
        assert not _inside(outline, gears[one, 2:146, :2] - middles[one]).any(), "they touch"


def _inside(points, outline):
    """Which points lie in a polygon: the number of its edges to the right of each is odd."""
    a, b = outline[None], np.roll(outline, -1, axis=0)[None]
    x, y = points.T[..., None]
    crosses = (a[..., 1] > y) != (b[..., 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[..., 0] + (y - a[..., 1]) * (b[..., 0] - a[..., 0]) / (b[..., 1] - a[..., 1])
    return ((crosses & (x < at)).sum(axis=1) % 2).astype(bool)


def test_a_ball_of_rings_joins_the_middles_of_the_edges_of_a_dodecahedron_once_each():
    joints = shape(name="rings", level=1, part="joints", radius=2, rod=0.05)
    assert isinstance(joints, SphereSet) and np.allclose(np.linalg.norm(joints.centers, axis=1), 2)
    distances = np.linalg.norm(joints.centers[:, None] - joints.centers, axis=2) + 9 * np.eye(30)
    golden = (1 + 5**0.5) / 2
    assert np.allclose(distances.min(axis=1), 2 / golden) and ((np.isclose(distances, 2 / golden)).sum(axis=1) == 4).all()
    pentagons = joints.centers.reshape(6, 5, 3)
    edges = np.linalg.norm(pentagons - np.roll(pentagons, 1, axis=1), axis=2)
    assert np.allclose(edges, 4 * np.sin(np.pi / 5)), "five corners on a great circle"


@pytest.mark.parametrize(("name", "options"), [("rings", {"level": 2}), ("lattice", {"level": 2}), ("tree", {"level": 4})])
def test_every_rod_ends_in_a_joint_that_covers_it(name, options):
    joints, rods = (shape(name=name, part=part, sides=5, **options) for part in ("joints", "rods"))
    ends = rods.vertices.reshape(-1, 2, 5, 3)
    middles, radii = ends.mean(axis=2), np.linalg.norm(ends - ends.mean(axis=2, keepdims=True), axis=3).max(axis=2)
    for side in (0, 1):
        apart = np.linalg.norm(middles[:, side, None] - joints.centers, axis=2)
        nearest = apart.argmin(axis=1)
        covered = (apart.min(axis=1) < 1e-9) & (radii[:, side] <= joints.radii[nearest] * (1 + 1e-9))
        assert covered.sum() == len(middles) - (name == "tree" and side == 0), "all but the foot of a trunk"
    a, b, c = rods.vertices[rods.faces].transpose(1, 0, 2)
    axis = np.repeat(middles.mean(axis=1), 10, axis=0)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - axis) > 0).all(), "front outwards"


def test_the_teapot_has_the_published_patches():
    """290 different points: 306 less four that no patch uses and the twelve of the lower rim that are written twice."""
    points = patches()
    assert points.shape == (32, 4, 4, 3)
    assert len(np.unique(np.round(points.reshape(-1, 3), 9) + 0.0, axis=0)) == 290
    assert points.reshape(-1, 3).min(axis=0).tolist() == [-3, -2, 0]
    assert points.reshape(-1, 3).max(axis=0).tolist() == [3.525, 2, 3.15]


@pytest.mark.parametrize(("first", "volume"), [(24, 0.229), (28, 0.399)], ids=["handle", "spout"])
def test_handle_and_spout_face_outwards(first, volume):
    """The corners of the control nets, as quadrangles, enclose a volume seen from their middle, if a coarse one."""
    nets = patches()[first : first + 4]
    nets = nets - nets.reshape(-1, 3).mean(axis=0)
    a, b, c, d = nets[:, :-1, :-1], nets[:, 1:, :-1], nets[:, 1:, 1:], nets[:, :-1, 1:]
    found = (np.cross(a, b) * c + np.cross(a, c) * d).sum() / 6
    assert 0.5 * volume < found < 4 * volume


def test_the_teapot_is_symmetric_and_faces_outwards_and_its_patches_share_their_edges():
    mesh = shape(name="teapot", segments=6, height=3.15)
    assert mesh.vertices.min(axis=0) == pytest.approx([-3, 0, -2]) and mesh.vertices[:, 1].max() == pytest.approx(3.15)
    assert 3.42 < mesh.vertices[:, 0].max() < 3.44
    mirrored = mesh.vertices * [1, 1, -1]
    apart = np.linalg.norm(mesh.vertices[:, None] - mirrored, axis=2).min(axis=1)
    assert apart.max() < 1e-9
    edges = np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    directed = {tuple(edge) for edge in edges.tolist()}
    assert len(directed) == len(edges), "two faces run along an edge in one direction"
    rims = [edge for edge in directed if edge[::-1] not in directed]
    assert len(rims) == 4 * 6 * 2 + 4 * 2 * 6, "the rim, the lid, and two ends each of handle and spout are open"
    middles, normals = mesh.vertices[mesh.faces].mean(axis=1), face_normals(mesh.vertices, mesh.faces)
    body = (np.abs(middles[:, 1] - 1) < 0.6) & (np.hypot(middles[:, 0], middles[:, 2]) < 2.01) & (middles[:, 0] < 1.5)
    assert (np.einsum("ij,ij->i", normals, middles * [1, 0, 1])[body] > 0).mean() > 0.95


def test_a_stadium_rises_outwards_and_leaves_its_field_free():
    mesh = shape(name="stadium", tiers=3, segments=8, size=30, rise=1, depth=2, center=[0, 5, 0])
    assert len(mesh.faces) == 4 * 3 * 8
    x, y, z = mesh.vertices.T
    assert (np.hypot(x / 15, z / 10) >= 1 - 1e-12).all() and (y.min(), y.max()) == (5, 8)
    corners = mesh.vertices[mesh.faces]
    normals = face_normals(mesh.vertices, mesh.faces)
    level = np.ptp(corners[..., 1], axis=1) < 1e-12
    assert level.sum() == len(mesh.faces) / 2 and (normals[level, 1] > 0).all()
    assert (np.einsum("ij,ij->i", normals, corners.mean(axis=1) * [1, 0, 1])[~level] < 0).all()


@pytest.mark.parametrize(("option", "wrong"), [("part", "rungs"), ("level", 0), ("rod", 0.9), ("sides", 2)], ids=str)
def test_options_out_of_range_are_refused(option, wrong):
    from engines.errors import SceneError

    with pytest.raises(SceneError, match=option):
        shape(**{"name": "lattice", option: wrong})
