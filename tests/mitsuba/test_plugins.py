"""Integrators, BSDFs and samplers for Mitsuba, written in Python: the module registers them, and raybench races them."""

import sys

import numpy as np
import pytest

import engines
from engines import Settings, Unsupported
from engines.choices import Choice
from engines.errors import ConfigError
from engines.peers.mitsuba import Engine, ScalarEngine
from harness.settings import plugin_or_choice
from harness.source_hashes import plugin_codes
from tests.needs import needs

pytestmark = needs("mitsuba-llvm")

CODE = '''
import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import ADIntegrator

def light_along(scene, sampler, ray, active, max_depth, scale):
    """By BSDF samples alone."""
    ray, active = mi.Ray3f(ray), mi.Bool(active)
    light, weight, depth = mi.Spectrum(0.0), mi.Spectrum(scale), mi.UInt32(0)

    def step(light, weight, depth, ray, active):
        si = scene.ray_intersect(ray, active)
        emitter = si.emitter(scene, active)
        if emitter is not None:
            light = light + dr.select(active, weight * emitter.eval(si, active), 0.0)
        active = active & si.is_valid() & (depth + 1 < max_depth)
        if isinstance(active, bool) and not active:
            return light, weight, depth, ray, active
        u, v = sampler.next_1d(active), sampler.next_2d(active)
        sample, value = si.bsdf(ray).sample(mi.BSDFContext(), si, u, v, active)
        weight = weight * value
        active = active & (dr.max(weight) > 0.0)
        return light, weight, depth + 1, si.spawn_ray(si.to_world(sample.wo)), active

    state = light, weight, depth, ray, active
    return dr.while_loop(state, lambda *state: state[-1], step)[0]

class Plain(mi.SamplingIntegrator):
    def __init__(self, props):
        super().__init__(props)
        self.max_depth, self.scale = props.get("max_depth", 6), props.get("scale", 1.0)

    def sample(self, scene, sampler, ray, medium=None, active=True):
        return light_along(scene, sampler, ray, active, self.max_depth, self.scale), True, []

class Differentiable(ADIntegrator):
    def sample(self, mode, scene, sampler, ray, depth, δL, δaovs, state_in, active, **_):
        light = light_along(scene, sampler, ray, active, self.max_depth, 1.0)
        return light, active, [], None

class Images(Plain):
    """One that says in its images how many samples it was asked for."""

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True):
        return 0.0 * super().render(scene, sensor, seed, spp, develop, evaluate) + spp

class Grey(mi.BSDF):
    """Diffuse, of albedo one half."""

    def __init__(self, props):
        super().__init__(props)
        self.m_components = [mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide]
        self.m_flags = self.m_components[0]

    def sample(self, ctx, si, sample1, sample2, active=True):
        bs, front = mi.BSDFSample3f(), active & (mi.Frame3f.cos_theta(si.wi) > 0)
        bs.wo = mi.warp.square_to_cosine_hemisphere(sample2)
        bs.pdf, bs.eta = mi.warp.square_to_cosine_hemisphere_pdf(bs.wo), 1.0
        bs.sampled_type, bs.sampled_component = mi.UInt32(+mi.BSDFFlags.DiffuseReflection), mi.UInt32(0)
        return bs, dr.select(front & (bs.pdf > 0), mi.Spectrum(0.5), 0.0)

    def eval(self, ctx, si, wo, active=True):
        above = active & (mi.Frame3f.cos_theta(si.wi) > 0) & (mi.Frame3f.cos_theta(wo) > 0)
        return dr.select(above, mi.Spectrum(0.5 / dr.pi) * mi.Frame3f.cos_theta(wo), 0.0)

    def pdf(self, ctx, si, wo, active=True):
        above = active & (mi.Frame3f.cos_theta(si.wi) > 0) & (mi.Frame3f.cos_theta(wo) > 0)
        return dr.select(above, mi.warp.square_to_cosine_hemisphere_pdf(wo), 0.0)

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

class Half(mi.Sampler):
    """Every number is one half."""

    def __init__(self, props):
        super().__init__(props)
        self.count = props.get("sample_count", 4)

    def clone(self):
        props = mi.Properties()
        props["sample_count"] = self.count
        return Half(props)

    fork = clone

    def sample_count(self):
        return self.count

    def next_1d(self, active=True):
        return mi.Float(0.5)

    def next_2d(self, active=True):
        return mi.Point2f(0.5)

def register():
    mi.register_integrator("plain", lambda props: Plain(props))
    mi.register_integrator("differentiable", lambda props: Differentiable(props))
    mi.register_integrator("images", lambda props: Images(props))
    mi.register_bsdf("grey", lambda props: Grey(props))
    mi.register_sampler("half", lambda props: Half(props))

def another():
    mi.register_integrator("plain", lambda props: Images(props))

def elsewhere():
    mi.set_variant("scalar_rgb")

def broken():
    raise ValueError("no such table:\\n    row 3\\n")
'''
SCENE = """\
<scene version="3.0.0">
  <default name="side" value="8"/>
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, 1, 6" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="$side"/><integer name="height" value="$side"/></film>
  </sensor>
  <shape type="sphere"><float name="radius" value="1"/><bsdf type="{bsdf}"/></shape>
  <emitter type="constant"/>
</scene>
"""
SIZE = {"width": 16, "height": 16}


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    (folder / "own_mitsuba.py").write_text(CODE)
    sys.path.insert(0, str(folder))
    yield "own_mitsuba"
    sys.path.remove(str(folder))


def shader(module, kind, function="register", **options):
    return {"name": "mitsuba", "type": kind, "plugin": f"{module}:{function}", **options}


def film(engine, scene, chosen, spp, sampler="random", **size):
    return engine.prepare(scene, Settings(**(size or SIZE), shader=chosen, sampler=sampler, seed=3)).render(spp)


def apart(film, other):
    """How many standard errors of their difference the image means are apart."""
    error = np.sqrt(sum(np.nansum(each.variance_of_mean()) for each in (film, other))) / film.sums.size
    return abs(film.mean().mean() - other.mean().mean()) / error


def test_an_integrator_in_python_has_the_mean_of_mitsubas_path_and_a_wrong_one_has_not(module):
    """At 4 standard errors: wrongly one time in sixteen thousand, three times."""
    scene = engines.load_scene("cornell_box")
    theirs = film(Engine(), scene, {"name": "path_tracer", "max_depth": 3}, 256)
    for kind in ("plain", "differentiable"):
        assert apart(film(Engine(), scene, shader(module, kind, max_depth=3), 1024), theirs) < 4.0, kind
    assert apart(film(ScalarEngine(), scene, shader(module, "plain", max_depth=3), 16), theirs) < 4.0
    assert apart(film(Engine(), scene, shader(module, "plain", max_depth=3, scale=1.2), 1024), theirs) > 4.0


def test_an_integrator_that_renders_images_is_called_once_a_render(module):
    scene = engines.load_scene("cornell_box")
    renderer = Engine().prepare(scene, Settings(**SIZE, shader=shader(module, "images"), sampler="random"))
    assert np.allclose(renderer.render(3).mean(), 3.0)
    assert np.allclose(renderer.render(5).mean(), (3 * 3 + 5 * 5) / 8)
    reason = Engine().why_not(scene, Settings(shader=shader(module, "images"), sampler="multijitter"))
    assert reason == "Mitsuba's images renders whole images, which raybench gives independent samples only"


def test_a_type_is_that_of_the_function_that_is_named_whatever_was_registered_since(module):
    scene = engines.load_scene("cornell_box")
    first = film(Engine(), scene, shader(module, "plain"), 2)
    assert np.allclose(film(Engine(), scene, shader(module, "plain", "another"), 2).mean(), 2.0)
    assert np.array_equal(film(Engine(), scene, shader(module, "plain"), 2).sums, first.sums)


def test_a_bsdf_of_ones_own_stands_in_mitsubas_own_file(module, tmp_path):
    """Mitsuba gets the file as it is; an albedo of one half is that of its diffuse BSDF."""
    images = []
    for bsdf in ("grey", "diffuse"):
        (tmp_path / f"{bsdf}.xml").write_text(SCENE.format(bsdf=bsdf))
        scene = engines.load_scene(tmp_path / f"{bsdf}.xml", natively=True)
        images.append(film(Engine(), scene, shader(module, "path", max_depth=4), 64, width=8, height=8))
    assert apart(*images) < 4.0


def test_a_sampler_of_ones_own_is_asked_for_every_number(module):
    """Rays through the centres of pixels, all alike: the image of the depth has no noise."""
    own = {"name": "mitsuba", "type": "half", "plugin": f"{module}:register", "sample_count": 4}
    rendered = film(Engine(), engines.load_scene("cornell_box"), "depth_map", 4, own)
    assert rendered.mean().max() > 0.1
    assert np.allclose(rendered.variance_of_mean(), 0.0, atol=1e-12)


def test_what_fails_is_told_in_one_sentence(module):
    scene = engines.load_scene("cornell_box")
    cases = {
        "register": ("nosuch", "shader mitsuba: .*nosuch"),
        "broken": ("plain", "own_mitsuba:broken: fails with llvm_ad_rgb: ValueError: no such table: row 3$"),
        "missing": ("plain", "own_mitsuba:missing: cannot be imported"),
    }
    for function, (kind, words) in cases.items():
        with pytest.raises(ConfigError, match=words):
            Engine().why_not(scene, Settings(sampler="random", shader=shader(module, kind, function)))
    with pytest.raises(ConfigError, match="unreferenced property"):
        Engine().why_not(scene, Settings(sampler="random", shader=shader(module, "plain", maxdepth=3)))
    with pytest.raises(Unsupported, match="sets Mitsuba's variant to scalar_rgb, and this engine has llvm_ad_rgb"):
        Engine().prepare(scene, Settings(sampler="random", shader=shader(module, "plain", "elsewhere")))


def test_the_module_is_imported_with_leave_only_and_its_source_is_part_of_the_code(module):
    given = Choice.of(shader(module, "plain"))
    with pytest.raises(ConfigError, match="own_mitsuba:register: names code to be imported; run with --allow-imports"):
        plugin_or_choice("shader", given, False)
    assert plugin_or_choice("shader", given, True) == given.describe()
    before = plugin_codes({"shader": given.describe()})
    assert list(before) == ["own_mitsuba:register"]
    file = next(folder for folder in sys.path if folder.endswith("own0"))
    with open(f"{file}/own_mitsuba.py", "a") as code:
        code.write("\n# changed\n")
    assert plugin_codes({"shader": given.describe()}) != before


def test_results_without_a_plugin_keep_their_identity():
    assert Choice.of({"name": "mitsuba", "type": "path", "plugin": None}).describe() == {"name": "mitsuba", "type": "path"}
