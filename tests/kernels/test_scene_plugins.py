"""Light and BSDF plugins in the jitted engines: they give the image of the built-in that does the same."""

import math
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import Settings, UnknownName
from engines.kernels.lane.bsdf.interface import ALL, SPECULAR_REFLECTION
from engines.numpy_reference.vectors import cosine_hemisphere
from engines.numpy_reference.vectors import dot as dot_rows
from engines.plugin import (
    BSDF,
    BSDFSample,
    LaneBSDF,
    Light,
    LightSample,
    Spectrum,
    Vec3,
    const,
    cosine_direction,
    cosine_pdf,
    dot,
    inline,
    reflect,
    select,
    select3,
)
from engines.scene import CustomBSDF, EnvironmentLight, Material, Plane


@inline
def _bulb(light, p, normal, u0, u1):
    x, y, z = light.parameters[:3]
    to, one = Vec3(x, y, z) - p, const(1.0, x)
    square = dot(to, to)
    distance = np.sqrt(square)
    return LightSample(to * (one / distance), distance, light.color * (one / square), one)


BULB = Light("bulb", _bulb, options={"position": (0, 0, 0), "color": (1, 1, 1)}, positions=("position",))


@inline
def _evaluate(parameters, si, wi):
    return Spectrum(Vec3(parameters[0], parameters[1], parameters[2]), cosine_pdf(si.normal, wi))


@inline
def _pdf(parameters, si, wi):
    share = parameters[0] / (parameters[0] + parameters[3])
    return share * cosine_pdf(si.normal, wi)


@inline
def _sample(parameters, si, u_lobe, u0, u1, lobes):
    zero, one = const(0.0, u0), const(1.0, u0)
    kd, ks = Vec3(parameters[0], parameters[1], parameters[2]), Vec3(parameters[3], parameters[4], parameters[5])
    share = parameters[0] / (parameters[0] + parameters[3])
    alone = lobes == SPECULAR_REFLECTION
    mirror = alone | ((lobes == ALL) & (u_lobe >= share))
    wi = select3(mirror, reflect(si.direction, si.normal), cosine_direction(si.normal, u0, u1))
    scale = select(alone, one, one / select(mirror, one - share, share))
    pdf = select(mirror, const(math.inf, zero), share * cosine_pdf(si.normal, wi))
    return BSDFSample(wi, Spectrum(select3(mirror, ks, kd), scale), pdf, False, True)


@inline
def _albedos(parameters, si):
    kd = Vec3(parameters[0], parameters[1], parameters[2])
    return kd, kd


VARNISH = BSDF(
    "varnish",
    LaneBSDF(_evaluate, _pdf, _sample, _albedos),
    options={"kd": (0, 0, 0), "ks": (0, 0, 0)},
    specular_reflection=True,
)


def _image(scene, **settings):
    renderer = engines.engine("numba").prepare(scene, Settings(48, 36, seed=3, sampler="sobol", **settings))
    return renderer.render(4).mean()


def _scene(material, light, x=0.0):
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [x, 1, 5], "target": [x, 0, 0]},
            "materials": {"varnish": material},
            "shapes": [
                {"sphere": {"center": [x, 0, 0], "radius": 1}, "material": "varnish"},
                {"sphere": {"center": [x + 1.5, -0.5, 1], "radius": 0.5}, "material": "varnish"},
            ],
            "lights": [light, {"environment": {"radiance": 0.2}}],
        }
    )


def _point(plugin, x=0.0):
    if plugin:
        return {"plugin": {"type": BULB, "position": [x + 2, 3, 2], "color": 30}}
    return {"point": {"position": [x + 2, 3, 2], "intensity": 30}}


def test_a_position_that_is_no_option_is_refused():
    with pytest.raises(UnknownName, match="option among the positions of the light 'lamp' 'place': did you mean 'places'"):
        Light("lamp", _bulb, options={"places": (0, 0, 0)}, positions=("place",))


@pytest.mark.parametrize("shader", ["path_tracer", "whitted"])
def test_a_bsdf_plugin_of_two_lobes_gives_the_image_of_kd_and_ks(shader):
    """The same random numbers choose the lobe and the direction. Whitted's rule asks for the mirror alone."""
    lobes = {"kd": 0.5, "ks": 0.25}
    own = _image(_scene({"plugin": {"type": VARNISH, **lobes}}, _point(True)), shader=shader)
    built_in = _image(_scene(lobes, _point(False)), shader=shader)
    assert np.allclose(own, built_in, rtol=1e-9) and built_in.mean() > 0.05


def test_the_specular_lobe_that_a_plugin_does_not_announce_is_not_asked_for():
    quiet = BSDF("quiet", VARNISH.jitted, options=VARNISH.options)
    own, built_in = (
        _image(_scene({"plugin": {"type": plugin, "kd": 0.5, "ks": ks}}, _point(False)), shader="whitted")
        for plugin, ks in ((quiet, 0.25), (VARNISH, 0.0))
    )
    assert np.array_equal(own, built_in)


def test_a_light_plugin_moves_with_a_scene_that_lies_far_from_the_origin():
    """In float32 geometry is moved next to the origin: a light that was left behind would be 10 km away."""
    images = [
        _image(_scene({"kd": 0.5}, _point(plugin, 1e4), 1e4), shader="path_tracer", precision="float32")
        for plugin in (True, False)
    ]
    assert np.allclose(*images, rtol=1e-5) and images[0].mean() > 0.05


@inline
def _broken_light(light, p, normal, u0, u1):
    nan = const(math.nan, u0)
    return LightSample(Vec3(nan, nan, nan), nan, Vec3(nan, nan, nan), const(1.0, u0))


@inline
def _broken_sample(parameters, si, u_lobe, u0, u1, lobes):
    nan = const(math.nan, u0)
    wi = select3(u0 < const(0.5, u0), Vec3(nan, nan, nan), si.normal)
    return BSDFSample(wi, Spectrum(Vec3(nan, u0, u0), u0), nan, False, True)


def test_numbers_that_are_not_finite_are_counted_and_lead_to_no_memory_of_others():
    """With an environment's image, whose texels are found by direction."""
    bsdf = BSDF("broken", LaneBSDF(_evaluate, _pdf, _broken_sample, _albedos), options=VARNISH.options)
    scene = _scene({"plugin": {"type": bsdf, "kd": 0.5}}, {"plugin": {"type": Light("broken", _broken_light)}})
    sky = EnvironmentLight((1.0, 1.0, 1.0), np.linspace(0, 1, 96).reshape(4, 8, 3))
    scene = replace(scene, lights=(scene.lights[0], sky))
    film = engines.engine("numba").prepare(scene, Settings(24, 16, shader="path_tracer", sampler="sobol")).render(8)
    assert np.isfinite(film.mean()).all() and film.bad_samples > 0


# ---- light that passes through ---------------------------------------------------------------------------------------


@inline
def _paper_value(parameters, si, wi):
    cos = dot(si.normal, wi)
    color = Vec3(parameters[0], parameters[0], parameters[0]), Vec3(parameters[1], parameters[1], parameters[1])
    return Spectrum(select3(cos > const(0.0, cos), *color), abs(cos) * const(1 / math.pi, cos))


@inline
def _paper_pdf(parameters, si, wi):
    return abs(dot(si.normal, wi)) * const(0.5 / math.pi, si.t)


@inline
def _paper_sample(parameters, si, u_lobe, u0, u1, lobes):
    through = u_lobe < const(0.5, u0)
    wi = cosine_direction(si.normal, u0, u1)
    pdf = _paper_pdf(parameters, si, wi)
    wi = select3(through, -wi, wi)
    share = const(2.0, u0) * select(through, parameters[1], parameters[0])
    return BSDFSample(wi, Spectrum(Vec3(share, share, share), const(1.0, u0)), pdf, through, True)


@inline
def _paper_albedos(parameters, si):
    white = Vec3(parameters[0], parameters[0], parameters[0])
    return white, white


class Paper:
    """Lambertian on both sides: a share `r` is reflected, and `t` transmitted."""

    def evaluate(self, options, at, wi):
        return np.repeat(np.where(dot_rows(at.normal, wi) > 0, options["r"], options["t"])[None] / np.pi, 3, axis=0)

    def pdf(self, options, at, wi):
        return np.abs(dot_rows(at.normal, wi)) / (2 * np.pi)

    def sample(self, options, at, uc, u0, u1, lobes):
        above = cosine_hemisphere(at.normal, u0, u1)
        wi = np.where(uc < 0.5, -above, above)
        return (wi, np.repeat(2 * np.where(uc < 0.5, options["t"], options["r"])[None], 3, axis=0), self.pdf(options, at, wi))

    def albedos(self, options):
        return (options["r"],) * 3, (options["r"],) * 3


PAPER = BSDF(
    "paper", LaneBSDF(_paper_value, _paper_pdf, _paper_sample, _paper_albedos), Paper(), {"r": 0.3, "t": 0.6}, transmission=True
)


def _lampshade(plugin):
    """A sheet behind two balls, lit from its far side."""
    scene = _scene({"kd": 0.5, "ks": 0.25}, {"point": {"position": [0.3, 2, -3], "intensity": 40}})
    materials = *scene.materials, Material("paper", bsdf=CustomBSDF(plugin, {"r": 0.3, "t": 0.6}))
    return replace(scene, materials=materials, shapes=(*scene.shapes, Plane((0.0, 0.0, -1.5), (0.0, 0.0, 1.0), 1)))


@pytest.mark.parametrize("shader", ["path_tracer", "whitted"])
def test_light_passes_through_a_plugin_that_says_so(shader):
    """The engines agree, and the sheet is bright where it would be dark."""
    chosen = Settings(24, 18, shader=shader, seed=3, sampler="sobol", precision="float64")
    images = []
    for engine, plugin in (("numba", PAPER), ("numpy", PAPER), ("numpy", replace(PAPER, transmission=False))):
        images.append(engines.engine(engine).prepare(_lampshade(plugin), chosen).render(2).mean())
    assert np.allclose(images[0], images[1], rtol=1e-9)
    assert images[0].mean() > 1.5 * images[2].mean()
