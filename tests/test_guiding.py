"""Path guiding by an SD-tree: the mean stays, densities are those of the samples, and the jitted engines learn and guide as the
NumPy engine does.
"""

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import engines
from engines import Settings
from engines.numpy_reference.guiding import cell_and_pdf, leaf_at, sample_direction
from engines.scene import Disk, Material, Mesh, Perspective, Scene, Sphere
from engines.sd_tree import COUNT, HIGH, LOW, Training, planted, refined
from tests import test_features_agree, test_null_lobes
from tests.chance import LEVEL
from tests.test_light_samplers import every_light

RNG = np.random.default_rng(5)


def path_tracer(**options):
    return {"name": "path_tracer", "guiding": "sd_tree", "spatial_threshold": 200, **options}


def prepared(engine, scene, shader=None, **settings) -> Any:
    settings = {"shader": path_tracer() if shader is None else shader, "seed": 5, "threads": 1, **settings}
    return engines.engine(engine).prepare(scene, Settings(**settings))


def box_room():
    """A closed room: the lamp shines at the ceiling, so all light that the camera sees is scattered there first."""
    corners = np.array(list(itertools.product((-1.0, 1.0), (-1.0, 1.0), (0.0, 2.0))))
    faces = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
        (1, 5, 7),
        (1, 7, 3),
    ]
    room = Mesh(corners, np.array(faces, np.int32), np.zeros(12, np.int32))
    shapes = (
        room,
        Disk((0.6, 0.6, 1.5), (0.0, 0.0, 1.0), 0.05, 1),
        Disk((0.6, 0.6, 1.48), (0.0, 0.0, 1.0), 0.25, 2),
        Sphere((-0.4, 0.3, 0.3), 0.3, 2),
    )
    materials = (
        Material("wall", kd=(0.6, 0.6, 0.6)),
        Material("lamp", emission=(90.0, 80.0, 70.0)),
        Material("dark", kd=(0.3, 0.3, 0.3)),
    )
    view = Perspective((-0.9, -0.9, 1.0), (0.3, 0.3, 0.6), (0.0, 0.0, 1.0), 60.0, "y", (24, 24))
    return Scene("box room", view, materials, shapes, (), "")


def everything(shapes_and_bsdfs):
    shapes, bsdfs, lights = shapes_and_bsdfs
    materials = (*(Material(f"m{k}", bsdf=bsdf) for k, bsdf in enumerate(bsdfs)), test_features_agree.LAMP)
    return Scene("features", test_features_agree.CAMERA, materials, tuple(shapes), tuple(lights), "")


def random_tree(rng, iterations=3):
    """A tree that has learned from records all over it, of very different light."""
    tree = planted([((-1.0, 0.0, 2.0), (1.0, 3.0, 2.5)), ((0.0, 0.0, 0.0), (0.5, 0.5, 4.0))])
    for _ in range(iterations):
        totals = tree.empty_totals()
        cells = rng.choice(np.flatnonzero(tree.quarters.reshape(-1) < 0), 20_000)
        np.add.at(totals.reshape(-1, 3), (cells, LOW), (rng.random(cells.size) ** 20 * 2**31).astype(np.int64))
        np.add.at(totals.reshape(-1, 3), (cells, COUNT), 1)
        tree = refined(tree, totals, 3000, 0.02)
    return tree


# ---- the tree ----------------------------------------------------------------------------------------------------------


def test_a_refined_tree_is_whole_and_keeps_its_light():
    tree = random_tree(RNG)
    assert tree.leaves == 8
    assert sorted(-1 - tree.halves[tree.halves < 0]) == list(range(tree.leaves))
    assert sorted(tree.quarters[tree.quarters >= 0]) == list(range(tree.leaves, len(tree.quarters)))
    assert np.allclose(tree.densities.mean(axis=1), 1.0)
    totals = tree.empty_totals()
    leaf_cells = tree.quarters < 0
    totals[..., LOW][leaf_cells], totals[..., HIGH][leaf_cells], totals[..., COUNT][leaf_cells] = 5, 3, 1
    finer = refined(tree, totals, 10**9, 0.02)

    # as all cells have the same light, the share of a root's quarter is its share of cells
    def cells_below(tree, node, quarter):
        child = tree.quarters[node, quarter]
        return 1 if child < 0 else sum(cells_below(tree, child, k) for k in range(4))

    for leaf in range(tree.leaves):
        count = np.array([cells_below(tree, leaf, k) for k in range(4)])
        assert np.allclose(finer.densities[leaf], 4.0 * count / count.sum())
    assert finer.leaves == tree.leaves


def test_leaves_are_halved_at_the_threshold_and_quarters_divided_by_their_light():
    tree, totals = planted([]), planted([]).empty_totals()
    totals[0, :, COUNT], totals[0, :, LOW] = 500, (1, 1, 1, 97)
    assert refined(tree, totals, 2000, 0.5).leaves == 1
    finer = refined(tree, totals, 1999, 0.5)
    assert finer.leaves == 2
    # of 97 shares a quarter is 24.25, below one half
    assert (finer.quarters[:2] >= 0).tolist() == [[False, False, False, True]] * 2
    assert (finer.quarters[2:] < 0).all()
    assert np.allclose(finer.densities[0], [0.04, 0.04, 0.04, 3.88])
    assert np.allclose(finer.densities[2], 1.0)


def test_points_are_found_in_the_halves_in_which_they_lie():
    tree = random_tree(RNG)
    points = RNG.uniform(-0.2, 1.2, (3, 4000)) * tree.size[:, None] + tree.corner[:, None]
    low, high = np.full((3, tree.leaves), np.inf), np.full((3, tree.leaves), -np.inf)
    stack = [(tree.root, tree.corner, tree.corner + tree.size, 0)]
    while stack:
        node, a, b, axis = stack.pop()
        if node < 0:
            low[:, -1 - node], high[:, -1 - node] = a, b
            continue
        middle = (a[axis] + b[axis]) / 2
        for half, (c, d) in enumerate(((a[axis], middle), (middle, b[axis]))):
            a2, b2 = a.copy(), b.copy()
            a2[axis], b2[axis] = c, d
            stack.append((int(tree.halves[node, half]), a2, b2, (axis + 1) % 3))
    inside = np.clip(points, tree.corner[:, None], (tree.corner + tree.size)[:, None])
    leaf = leaf_at(tree, points)
    assert (inside >= low[:, leaf] - 1e-12).all() and (inside <= high[:, leaf] + 1e-12).all()


def test_directions_have_the_density_that_is_said_of_them():
    """Numbers on a grid: of n directions each cell has its share, but for the cells of the grid that its edges cross. And the
    density of a sample is that which is found at its direction."""
    tree, n = random_tree(RNG), 1024
    u0, u1 = ((grid.ravel() + 0.5) / n for grid in np.meshgrid(np.arange(n), np.arange(n)))
    for leaf in range(0, tree.leaves, 3):
        leaves = np.full(n * n, leaf)
        wi = sample_direction(tree, leaves, u0, u1)
        assert np.allclose((wi**2).sum(axis=0), 1.0)
        cell, pdf = cell_and_pdf(tree, leaves, wi)
        found, share = np.bincount(cell, minlength=tree.quarters.size) / (n * n), np.zeros(tree.quarters.size)
        area, stack = np.ones(tree.quarters.size), [(leaf, 1.0, 1.0)]
        while stack:
            inner, size, density = stack.pop()
            for k in range(4):
                below, here = int(tree.quarters[inner, k]), density * tree.densities[inner, k]
                if below >= 0:
                    stack.append((below, size / 4, here))
                else:
                    area[4 * inner + k], share[4 * inner + k] = size / 4, here * size / 4
        assert share.sum() == pytest.approx(1.0)
        assert np.abs(found - share).max() < 8 / n
        lanes = found > 0
        assert np.allclose(pdf[np.unique(cell, return_index=True)[1]], (share / area)[lanes] / (4 * math.pi))


def test_iterations_end_when_samples_have_doubled():
    training = Training([], 4000, 0.01)
    ends = []
    for _ in range(5):
        ends.append((training.end, training.guides))
        training.advance()
    assert ends == [(1, False), (2, False), (4, True), (8, True), (16, True)]
    training.restart()
    assert (training.end, training.tree.leaves, len(training.tree.quarters)) == (1, 1, 1)


# ---- films -------------------------------------------------------------------------------------------------------------


def scenes():
    """Scenes of every light and of every model under every wrapper, with options of the path tracer."""
    return {
        "every light": (every_light(), {"light_sampler": "bvh", "light_candidates": 2}),
        "box room": (box_room(), {"max_depth": 9, "rr_depth": 2}),
        "null lobes": (
            test_null_lobes._everything(),
            {"transparent_shadows": True, "hide_emitters": True, "bsdf_fraction": 0.3},
        ),
    }


@pytest.mark.parametrize("name", scenes())
@pytest.mark.parametrize("direct", ["mis", "light", "bsdf"])
def test_numba_in_float64_equals_the_reference(name, direct):
    """By films of 9 samples, of which 7 are guided, by a tree that has learned from 1, 2, 4 and 8."""
    scene, options = scenes()[name]
    reference = prepared("numpy", scene, path_tracer(direct=direct, **options))
    found = prepared("numba", scene, path_tracer(direct=direct, **options), precision="float64", accelerator="bvh")
    wanted, seen = reference.render(9).mean(), found.render(9).mean()
    training = reference._context.guide.training
    assert training.tree.leaves >= 2 and training.iteration == 4
    assert np.array_equal(training.tree.quarters, found._training.tree.quarters)
    difference = np.abs(seen - wanted).max(axis=2) / wanted.max()
    assert (difference < 1e-8).all(), np.argwhere(difference >= 1e-8)


@pytest.mark.parametrize(
    ("name", "sampler", "precision"),
    [*itertools.product(scenes(), ["random", "sobol"], ["float64"]), ("box room", "random", "float32")],
)
def test_the_mean_does_not_depend_on_guiding(name, sampler, precision):
    """By t of every block of 6 x 6 pixels, and of the image, over pairs of independent images, of numba, which in float64
    equals the reference here: by chance a scene fails once in 200,000 times, if means of so many samples are normal.
    `precision` is that of the guided image."""
    scene, options = scenes()[name]
    plain = {"name": "path_tracer", **{key: value for key, value in options.items() if key != "bsdf_fraction"}}
    settings, blocks = {"accelerator": "bvh", "sampler": sampler, "width": 24, "height": 24}, []
    for seed in range(24):
        sides = (plain, "float64"), (path_tracer(**options), precision)
        images = [
            prepared("numba", scene, shader, **settings, precision=real, seed=2 * seed + k).render(32).mean()
            for k, (shader, real) in enumerate(sides)
        ]
        blocks.append((images[1] - images[0]).mean(axis=2).reshape(4, 6, 4, 6).mean(axis=(1, 3)))
    found = np.column_stack([np.reshape(blocks, (len(blocks), -1)), np.mean(blocks, axis=(1, 2))])
    mean, error = found.mean(axis=0), found.std(axis=0, ddof=1) / math.sqrt(len(found))
    assert (np.abs(mean) <= stats.t.isf(LEVEL / 2 / len(mean), len(found) - 1) * error).all(), mean


@pytest.mark.parametrize("engine", ["numpy", "numba", "embree"])
def test_calls_threads_stops_and_restarts_change_no_bit(engine):
    scene = replace(box_room(), camera=replace(box_room().camera, resolution=(80, 40)))
    whole = prepared(engine, scene).render(9).mean()
    parts = prepared(engine, scene, threads=3)
    parts.warm_up()
    parts.render(1)
    parts.warm_up()
    parts.render(4, on_pass=lambda film: parts.stop() if film.spp == 3 else None)
    assert parts.film.spp == 3
    assert np.array_equal(parts.render(6).mean(), whole)
    parts.update(camera=scene.camera)
    assert np.array_equal(parts.render(9).mean(), whole)


@pytest.mark.parametrize("engine", ["numpy", "numba"])
def test_the_first_samples_are_those_of_the_plain_path_tracer(engine):
    plain, guided = (
        prepared(engine, box_room(), shader, precision="float64").render(2).mean() for shader in ("path_tracer", None)
    )
    assert np.abs(plain - guided).max() < 1e-12 * plain.max()


def test_where_a_lamp_shines_at_the_ceiling_guided_paths_go_there_and_the_variance_falls():
    """In twelve seeds the variance is 0.784 +- 0.006 times that of plain paths, and the density 11.7 +- 0.8 times the even
    one."""
    plain, guided = (
        prepared("numba", box_room(), shader, sampler="random", width=64, height=64)
        for shader in ("path_tracer", path_tracer(spatial_threshold=4000))
    )
    for renderer in (plain, guided):
        renderer.render(128)
    tree, rng, n = guided._training.tree, np.random.default_rng(1), 500
    point = np.full((3, n), [[-0.5], [-0.5], [0.001]])
    towards = np.stack([*rng.uniform(0.3, 0.9, (2, n)), np.full(n, 2.0)]) - point
    _, pdf = cell_and_pdf(tree, leaf_at(tree, point), towards / np.sqrt((towards**2).sum(axis=0)))
    assert pdf.mean() > 8.0 / (4.0 * math.pi)
    assert np.nanmean(guided.film.variance_of_mean()) < 0.85 * np.nanmean(plain.film.variance_of_mean())
