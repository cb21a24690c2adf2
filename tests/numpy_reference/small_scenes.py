"""Scenes of a few shapes, built without files, and what the reference makes of them."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np

from engines.interface import Settings
from engines.numpy_reference import Engine
from engines.scene import Material, Mesh, Perspective, Scene, Sphere

EPS = 2.0**-52
AHEAD = Perspective((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 40.0, "y", (8, 8))


def grey(level):
    return (float(level),) * 3


def material(kd=0.0, ks=0.0, kt=0.0, emission=0.0, **more):
    return Material("m", grey(kd), grey(ks), grey(kt), emission=grey(emission), **more)


GLASS = material(ks=1, kt=1, ior=1.5, fresnel=True)
GLASS_REFLECTANCE = (
    (0, 0.04),
    (30, 0.04152262597582152),
    (45, 0.05023991101223595),
    (60, 0.08918671280221274),
    (75, 0.2530605629903197),
    (80, 0.3877043546914725),
    (89, 0.9041849497801886),
)
"""Of glass from outside: degrees and Fresnel's reflectance."""


def henyey_greenstein(g, u):
    """Cosines and sines of angles that numbers in [0, 1) choose, by the inversion in 60 digits, and pdfs per solid angle."""
    with localcontext() as context:
        context.prec = 60
        g, found = Decimal(float(g)), []
        for x in map(Decimal, np.asarray(u, np.float64).tolist()):
            root = (1 - g * g) / (1 - g + 2 * g * x)
            cosine = (1 + g * g - root * root) / (2 * g)
            found.append((cosine, (1 - cosine * cosine).sqrt(), (1 - g * g) / root**3))
        cosine, sine, pdf = np.array(found, np.float64).T
    return cosine, sine, pdf / (4.0 * np.pi)


def scene(shapes=(), materials=(), lights=(), camera=AHEAD):
    return Scene("test", camera, tuple(materials) or (material(kd=0.5),), tuple(shapes), tuple(lights), "")


def point_view(eye, target, side=1, up=(0.0, 1.0, 0.0)):
    """A camera so narrow that all of its side * side pixels see one point: replicates of one pixel."""
    return Perspective(eye, target, up, 0.01, "y", (side, side))


def renderer(given, **settings):
    return Engine().prepare(given, Settings(**{"sampler": "random", **settings}))


def image(given, shader, spp=1, **settings):
    """(height, width) red channel of the mean; the film must hold no bad sample."""
    film = renderer(given, shader=shader, **settings).render(spp)
    assert film.bad_samples == 0
    return film.mean()[:, :, 0]


def exact(given, shader):
    """(3,) the colour along the one ray through the middle of the image."""
    film = renderer(given, shader=shader, sampler={"name": "constant", "value": 0.5}, width=1, height=1).render(1)
    assert film.bad_samples == 0
    return film.mean()[0, 0]


def tracer(*shapes, accelerator="none"):
    return renderer(scene(shapes), accelerator=accelerator)


def path_tracer(max_depth=2, direct="mis", rr_depth=1_000_000):
    return {"name": "path_tracer", "max_depth": max_depth, "direct": direct, "rr_depth": rr_depth}


def whitted(max_depth=6, ambient=0.0):
    return {"name": "whitted", "max_depth": max_depth, "ambient": ambient}


def z_score(replicates, truth, largest_error=2e-3):
    """Of independent estimates against their true mean; the standard error must be small enough to tell. Estimators
    without variance are held to 1e-12."""
    error = max(replicates.std(ddof=1) / np.sqrt(replicates.size), 1e-12)
    assert error < largest_error, error
    return (replicates.mean() - truth) / error


def triangle_soup(count, size, seed=0):
    rng = np.random.default_rng(seed)
    vertices = rng.random((count, 1, 3)) + size * (rng.random((count, 3, 3)) - 0.5)
    return mesh(vertices.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def mesh(vertices, faces, **more):
    faces = np.asarray(faces, np.int32)
    return Mesh(np.asarray(vertices, np.float64), faces, np.zeros(len(faces), np.int32), **more)


def sphere_mesh(rings, center=(0.0, 0.0, 0.0), radius=1.0, smooth=False):
    """A closed sphere of 2 * rings * (rings - 1) * 2 triangles, counter-clockwise from outside."""
    theta, phi = np.linspace(0.0, np.pi, rings + 1)[1:-1], np.linspace(0.0, 2 * np.pi, 2 * rings, endpoint=False)
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    out = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    out = np.concatenate([out, [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]])
    row, column = np.meshgrid(np.arange(rings - 2), np.arange(2 * rings), indexing="ij")
    after = (column + 1) % (2 * rings)
    a, b = row * 2 * rings + column, row * 2 * rings + after
    c, d = a + 2 * rings, b + 2 * rings
    top, bottom, k = len(out) - 2, len(out) - 1, np.arange(2 * rings)
    last = (rings - 2) * 2 * rings
    faces = [
        np.stack([a, b, d], -1).reshape(-1, 3),
        np.stack([a, d, c], -1).reshape(-1, 3),
        np.stack([np.full_like(k, top), (k + 1) % (2 * rings), k], -1),
        np.stack([np.full_like(k, bottom), last + k, last + (k + 1) % (2 * rings)], -1),
    ]
    return mesh(np.asarray(center) + radius * out, np.concatenate(faces), normals=out if smooth else None)


def box_mesh(low=(-1.0, -1.0, -1.0), high=(1.0, 1.0, 1.0)):
    """Twelve triangles, counter-clockwise from outside."""
    corners = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    return mesh(corners, [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])


def rays_around(count, reach=2.0, seed=1):
    rng = np.random.default_rng(seed)
    return reach * (2.0 * rng.random((count, 3)) - 1.0), rng.normal(size=(count, 3))


def unit_rows(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def unit_sphere(index=0):
    return Sphere((0.0, 0.0, 0.0), 1.0, index)
