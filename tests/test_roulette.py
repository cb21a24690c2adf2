"""Russian roulette in glass: a path inside is worth eta^2 of its throughput, as in pbrt and Mitsuba (docs/transport.md).

Rays pass a pane of two faces at a right angle, and see a sky of 1 behind it. Glass of reflectance 0 ends a path with the
probability F = 0.04 at each face, and roulette lets it go on with 0.95, inside as outside. So a sample is 0.95^-k with the
probability (1 - F)^2 0.95^k, where k faces play, and else 0.
"""

import numpy as np
import pytest

import engines
from engines import Settings
from engines.scene import Dielectric, EnvironmentLight, Material, Mesh, Mixture, Perspective, Principled, Scene
from tests.needs import needs

SIDE, FACES, INDEX = 64, 2, 1.5
FRESNEL = ((INDEX - 1) / (INDEX + 1)) ** 2
VIEW = Perspective((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.01, "y", (SIDE, SIDE))
OURS = [("numpy", "float64"), ("embreex_batch", "float64"), ("numba", "float32"), ("numba", "float64"), ("embree", "float32")]
SMOOTH = Dielectric(INDEX, (0.0, 0.0), (0.0,) * 3, (1.0,) * 3)


def pane(bsdf):
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    front, back = (np.column_stack([square, np.full(4, z)]) for z in (0.5, -0.5))
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]], np.int32)
    mesh = Mesh(np.concatenate([front, back]), faces, np.zeros(4, np.int32))
    sky = EnvironmentLight(radiance=(1.0, 1.0, 1.0))
    return Scene("pane", VIEW, (Material("glass", bsdf=bsdf),), (mesh,), (sky,), "")


def samples(bsdf, engine, precision, rr_depth):
    """(n,) one sample of each pixel."""
    shader = {"name": "path_tracer", "max_depth": 6, "rr_depth": rr_depth}
    settings = Settings(shader=shader, sampler="random", precision=precision, seed=7)
    return engines.engine(engine).prepare(pane(bsdf), settings).render(1).mean()[..., 0].ravel()


def assert_pass(seen, rr_depth, passes):
    """`passes` is the share of paths that pass both faces without roulette; fails by chance once in 10^5 times."""
    plays = max(0, FACES + 1 - rr_depth)
    share = passes * 0.95**plays
    assert np.allclose(seen[seen > 0], 0.95**-plays, rtol=2e-5)
    assert abs((seen > 0).mean() - share) < 4.5 * np.sqrt(share * (1 - share) / seen.size)


@pytest.mark.parametrize("rr_depth", [1, 2, 3])
@pytest.mark.parametrize(("engine", "precision"), OURS)
def test_paths_in_glass_survive_as_those_outside(engine, precision, rr_depth):
    assert_pass(samples(SMOOTH, engine, precision, rr_depth), rr_depth, (1 - FRESNEL) ** 2)


@needs("mitsuba-scalar")
@pytest.mark.parametrize("rr_depth", [1, 2, 3])
def test_mitsuba_counts_segments_and_scales_as_ours(rr_depth):
    assert_pass(samples(SMOOTH, "mitsuba_scalar", None, rr_depth), rr_depth, (1 - FRESNEL) ** 2)


@pytest.mark.parametrize(("engine", "precision"), [("numpy", "float64"), ("numba", "float64")])
def test_refraction_by_kt_scales_alike(engine, precision):
    assert_pass(samples(Mixture(kt=(1.0, 1.0, 1.0), ior=INDEX), engine, precision, 1), 1, 1.0)


@pytest.mark.parametrize(
    "bsdf",
    [
        Dielectric(INDEX, (0.3, 0.2), (1.0,) * 3, (0.9, 0.8, 0.7)),
        Principled(roughness=0.4, anisotropic=0.3, spec_trans=0.8, eta=INDEX),
    ],
    ids=["rough", "principled"],
)
def test_rough_glass_is_as_bright_with_roulette_as_without(bsdf):
    """And pixel by pixel the same in both implementations, whose frames agree where some model is anisotropic."""
    images = [samples(bsdf, engine, "float64", 1) for engine in ("numpy", "numba")]
    assert np.allclose(*images, atol=1e-9)
    with_roulette, without = (samples(bsdf, "numba", "float64", rr_depth) for rr_depth in (1, 6))
    error = np.sqrt((with_roulette.var() + without.var()) / without.size)
    assert abs(with_roulette.mean() - without.mean()) < 4.5 * error
