"""A tiny adapter: the NumPy engine as a renderer that returns images."""

from types import MappingProxyType

import engines
from engines import Settings
from engines.peers.adapters import AdapterEngine, ImageRenderer, derive_seed
from engines.scene import Diffuse, Mesh, Mixture, Perspective, PointLight, Triangle


class Renderer(ImageRenderer):
    def build(self, scene, settings):
        self.translated = scene

    def image(self, spp, offset, seed):
        options = {"shader": self.settings.shader, "sampler": self.settings.sampler, "seed": derive_seed(seed, offset)}
        inner = engines.engine("numpy").prepare(self.translated, Settings(self.film.width, self.film.height, **options))
        return inner.render(spp).mean()


class SampleBySample(Renderer):
    samples_a_pass = 1


class Engine(AdapterEngine):
    name, lineage, precision = "tiny", "raybench-numpy", "float64"
    renderer = SampleBySample
    shapes, cameras, lights = (Mesh, Triangle), (Perspective,), (PointLight,)
    materials = (Mixture, Diffuse)
    two_sided = True
    takes_shaders = MappingProxyType({"path_tracer": {"direct": ("mis",), "rr_depth": range(4, 100)}, "albedo": {}})
    takes_samplers = MappingProxyType({"random": {}, "sobol": {}})


class ByCalls(Engine):
    renderer = Renderer
    two_sided = False
