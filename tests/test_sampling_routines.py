"""What engines draw when they sample light, seen through a shader plugin: directions are distributed as their pdf says.

The plugin shows the direction of the light sample, or its pdf, in place of a colour; with one seed both show the same
samples. A pixel is a sample: 65,536 of one point. Chi-square tests hold p > 1e-4 each; seeds are fixed.
"""

import math

import numpy as np
import pytest
from scipy import stats

import engines
from engines import Settings
from engines.plugin import Shader, Vec3, const, finish, inline, select
from engines.scene import EnvironmentLight, Material, Mesh, Perspective, Plane, Scene, Sphere, Triangle

ENGINES = ["numpy", "numba"]
SIDE = 256
POINT = np.zeros(3)
IMAGE = np.random.default_rng(0).random((6, 12, 3)) ** 4


@inline
def _direction(si, light, bsdf, draws, path, options):
    zero = const(0.0, si.t)
    return finish(si.t, light.wi, Vec3(zero, zero, zero))


@inline
def _density(si, light, bsdf, draws, path, options):
    zero, far = const(0.0, si.t), const(1e30, si.t)
    distance = select(light.distance < far, light.distance, zero)
    return finish(si.t, Vec3(light.pdf, distance, zero), Vec3(zero, zero, zero))


def _numpy(show):
    """The path tracer's choice of one light out of all, as docs/transport.md has it."""

    def shade(context, origins, directions, pixels, sample):
        seen = context.trace(origins, directions)
        u0, u1, choice = (context.draw(pixels, sample, 2 + k) for k in range(3))
        scaled = choice * context.light_count
        chosen = np.minimum(scaled.astype(int), context.light_count - 1)
        out = np.zeros((len(pixels), 3))
        for j in range(context.light_count):
            lanes = np.flatnonzero(chosen == j)
            wi, distance, _, pdf = context.sample_light(
                j, seen.point[lanes], seen.normal[lanes], u0[lanes], u1[lanes], scaled[lanes] - j
            )
            out[lanes] = show(wi, np.where(np.isinf(distance), 0.0, distance), pdf / context.light_count)
        return out

    return shade


DIRECTION = Shader("direction", _direction, _numpy(lambda wi, distance, pdf: wi))
DENSITY = Shader("density", _density, _numpy(lambda wi, distance, pdf: np.stack([pdf, distance, distance], -1)))


def sampled(engine, shapes, lights=()):
    """(n, 3) directions, (n,) distances, 0 for the environment, and (n,) pdfs of samples of the origin, whose normal is +y."""
    view = Perspective((2e-6, 4e-6, 1e-6), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1e-4, "y", (SIDE, SIDE))
    floor, materials = (Plane((0, 0, 0), (0, 1, 0), 0), (Material("floor", (0.5,) * 3), Material("lamp", emission=(1,) * 3)))
    scene = Scene("one point", view, materials, (floor, *shapes), tuple(lights), "")
    seen = []
    for shader in (DIRECTION, DENSITY):
        settings = Settings(shader=shader, sampler="random", seed=11, precision="float64")
        film = engines.engine(engine).prepare(scene, settings).render(1)
        seen.append(film.mean().reshape(-1, 3))
    return seen[0], seen[1][:, 1], seen[1][:, 0]


def uniform_p(*values, cells=16):
    """The chi-square p value of (n,) arrays being independent and uniform in [0, 1)."""
    index = sum((np.clip((v * cells).astype(int), 0, cells - 1)) * cells**k for k, v in enumerate(values))
    return stats.chisquare(np.bincount(index, minlength=cells ** len(values))).pvalue


def turn(x, y):
    return np.arctan2(y, x) / (2 * np.pi) % 1.0


A, B, C = np.array([(-1.0, 1.5, -1.0), (1.0, 1.5, -1.0), (0.0, 1.2, 1.0)])


def unit_square_of(points, a, b, c):
    """Barycentric coordinates unfolded: uniform over the unit square where points are uniform over the triangle."""
    v, w = np.linalg.lstsq(np.stack([b - a, c - a], 1), (points - a).T, rcond=None)[0]
    assert v.min() > -1e-9 and w.min() > -1e-9 and (v + w).max() < 1 + 1e-9
    return (v + w) ** 2, w / (v + w)


@pytest.mark.parametrize("engine", ENGINES)
def test_triangles_are_sampled_uniformly_by_area(engine):
    wi, distance, pdf = sampled(engine, [Triangle(tuple(A), tuple(B), tuple(C), 1)])
    assert uniform_p(*unit_square_of(wi * distance[:, None], A, B, C)) > 1e-4
    normal = np.cross(B - A, C - A)
    area = np.linalg.norm(normal) / 2
    cosine = np.abs(wi @ normal) / np.linalg.norm(normal)
    assert np.allclose(pdf, distance**2 / (cosine * area), rtol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_faces_of_a_mesh_are_chosen_by_area(engine):
    """Three triangles of areas 1 : 2 : 5 in a plane: counts, and places in each."""
    vertices = np.array([(0, 2, 0), (0, 2, 1), (1, 2, 0), (0, 2, -2), (-2, 2, 0), (0, 2, 2.5)]) + np.array([0.1, 0, 0.2])
    faces = np.array([(0, 2, 1), (0, 3, 2), (0, 5, 4)], np.int32)
    mesh = Mesh(vertices, faces, np.ones(3, np.int32))
    wi, distance, pdf = sampled(engine, [mesh])
    points, corners = wi * distance[:, None], vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert areas.tolist() == [0.5, 1.0, 2.5]
    x, z = points[:, 0] - 0.1, points[:, 2] - 0.2
    face = np.where(x < 0, 2, np.where(z < 0, 1, 0))
    counts = np.bincount(face, minlength=3)
    assert stats.chisquare(counts, len(points) * areas / areas.sum()).pvalue > 1e-4
    for k in range(3):
        assert uniform_p(*unit_square_of(points[face == k], *corners[k]), cells=8) > 1e-4
    assert np.allclose(pdf, distance**2 / (np.abs(wi[:, 1]) * areas.sum()), rtol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("center", [(0.4, 1.0, 0.2), (3.0, 20.0, -7.0), (0.0, 0.5001, 0.0)], ids=["near", "far", "touching"])
def test_spheres_are_sampled_uniformly_over_their_cone(engine, center):
    wi, distance, pdf = sampled(engine, [Sphere(center, 0.5, 1)])
    away = math.dist(center, (0, 0, 0))
    axis, spread = np.array(center) / away, 1 - math.sqrt(1 - (0.5 / away) ** 2)
    across = np.cross(axis, (1.0, 0.3, -0.2))
    across /= np.linalg.norm(across)
    drop = (1 - wi @ axis) / spread
    assert drop.min() > -1e-6 and drop.max() < 1 + 1e-6
    assert uniform_p(drop, turn(wi @ across, wi @ np.cross(axis, across))) > 1e-4
    assert np.allclose(pdf, 1 / (2 * np.pi * spread), rtol=1e-6)
    on = np.linalg.norm(wi * distance[:, None] - center, axis=1)
    assert np.allclose(on, 0.5, atol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("center", [(0.1, 0.3, 0.2), (0.0, 0.50001, 0.0)], ids=["inside", "closer than a cone allows"])
def test_spheres_are_sampled_uniformly_over_their_surface_from_inside(engine, center):
    wi, distance, pdf = sampled(engine, [Sphere(center, 0.5, 1)])
    out = (wi * distance[:, None] - center) / 0.5
    assert np.allclose(np.linalg.norm(out, axis=1), 1, atol=1e-9)
    assert uniform_p((1 - out[:, 2]) / 2, turn(out[:, 0], out[:, 1])) > 1e-4
    cosine = np.abs(np.einsum("ij,ij->i", wi, out))
    some = cosine > 1e-4
    assert np.allclose(pdf[some], (distance**2 / (cosine * np.pi))[some], rtol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_hemisphere_is_sampled_by_its_cosine(engine):
    """A constant environment, and every diffuse reflection, use it: cos^2 and the turn are uniform."""
    wi, _, pdf = sampled(engine, [], [EnvironmentLight((0.5, 0.4, 0.3))])
    assert uniform_p(wi[:, 1] ** 2, turn(wi[:, 0], wi[:, 2])) > 1e-4
    assert np.allclose(pdf, wi[:, 1] / np.pi, rtol=1e-6, atol=1e-12)


def texel_weights(image):
    """Mean over rgb and over 3 x 3 texels, times the sine of the row: docs/transport.md once more."""
    height, width = image.shape[:2]
    grey = image.mean(axis=2)
    smooth = [
        [
            np.mean([grey[min(max(i + di, 0), height - 1), (j + dj) % width] for di in (-1, 0, 1) for dj in (-1, 0, 1)])
            for j in range(width)
        ]
        for i in range(height)
    ]
    return np.array(smooth) * np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None]


@pytest.mark.parametrize("engine", ENGINES)
def test_images_of_the_sky_are_sampled_by_texel(engine):
    wi, _, pdf = sampled(engine, [], [EnvironmentLight((1.0, 1.0, 1.0), IMAGE)])
    height, width = IMAGE.shape[:2]
    u, v = turn(-wi[:, 2], wi[:, 0]), np.arccos(np.clip(wi[:, 1], -1, 1)) / np.pi
    column, row = np.minimum((u * width).astype(int), width - 1), np.minimum((v * height).astype(int), height - 1)
    weights = texel_weights(IMAGE)
    share = weights / weights.sum()
    counts = np.bincount(row * width + column, minlength=width * height)
    assert stats.chisquare(counts, len(wi) * share.reshape(-1)).pvalue > 1e-4
    assert uniform_p(u * width % 1, v * height % 1) > 1e-4
    inner = np.abs(v * height - np.round(v * height)) > 1e-9
    expected = share[row, column] * width * height / (2 * np.pi**2 * np.sin(np.pi * v))
    assert np.allclose(pdf[inner], expected[inner], rtol=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_every_light_is_chosen_as_often_and_its_pdf_counts_that(engine):
    """Three spheres, a triangle and an environment: a fifth each; the rest of the draw still samples faces uniformly."""
    spheres = [Sphere((x, 3.0, 0.0), 0.2, 1) for x in (-2.0, 0.0, 2.0)]
    lamp = Triangle((-0.5, 1.0, 4.0), (0.5, 1.0, 4.0), (0.0, 2.0, 4.0), 1)
    wi, distance, pdf = sampled(engine, [*spheres, lamp], [EnvironmentLight((0.5, 0.4, 0.3))])
    points = wi * distance[:, None]
    found = np.array(
        [distance == 0, *(np.linalg.norm(points - b.center, axis=1) < 0.201 for b in spheres), np.abs(points[:, 2] - 4) < 1e-6]
    )
    assert (found.sum(axis=0) == 1).all()
    assert stats.chisquare(found.sum(axis=1)).pvalue > 1e-4
    escaped = found[0]
    assert np.allclose(pdf[escaped], wi[escaped, 1] / np.pi / 5, rtol=1e-6, atol=1e-12)
    away = math.hypot(2.0, 3.0)
    assert np.allclose(pdf[found[1]], 1 / (2 * np.pi * (1 - math.sqrt(1 - (0.2 / away) ** 2))) / 5, rtol=1e-6)


def _integral(density, rows=400, columns=400):
    """Of density(directions (n, 3)) over the sphere, by the middle of even cells in cos and turn."""
    z, phi = -1 + 2 * (np.arange(rows) + 0.5) / rows, 2 * np.pi * (np.arange(columns) + 0.5) / columns
    z, phi = (grid.ravel() for grid in np.meshgrid(z, phi))
    ring = np.sqrt(1 - z * z)
    return 4 * np.pi * density(np.stack([ring * np.cos(phi), ring * np.sin(phi), z], -1)).mean()


def test_the_pdfs_that_the_engines_agree_with_integrate_to_one():
    """The expressions above, over all directions; edges of lights cost the quadrature a part in a thousand."""
    normal = np.cross(B - A, C - A)

    def triangle(w):
        matrix = np.stack([B - A, C - A], 1)
        t = (A @ normal) / (w @ normal)
        v, u = np.linalg.lstsq(matrix, (w * t[:, None] - A).T, rcond=None)[0]
        inside = (t > 0) & (u >= 0) & (v >= 0) & (u + v <= 1)
        return np.where(inside, t**2 / (np.abs(w @ normal) / 2), 0.0)

    def sphere_pdf(w):  # from inside: the one point in the direction
        center = np.array((0.1, 0.3, 0.2))
        b = w @ center
        t = b + np.sqrt(b * b - center @ center + 0.25)
        cosine = np.abs(np.einsum("ij,ij->i", w, (w * t[:, None] - center) / 0.5))
        return t**2 / (cosine * np.pi)

    weights = texel_weights(IMAGE)
    assert abs(_integral(triangle) - 1) < 2e-3
    assert abs(_integral(sphere_pdf) - 1) < 1e-3
    assert abs(_integral(lambda w: np.maximum(w[:, 1], 0) / np.pi) - 1) < 1e-3
    v = (np.arange(6000) + 0.5) / 6000
    rows = weights.sum(axis=1)[(v * 6).astype(int)] / weights.sum() * 6  # 2 pi^2 sin / (2 pi^2 sin) cancels
    assert abs(rows.mean() - 1) < 1e-12
