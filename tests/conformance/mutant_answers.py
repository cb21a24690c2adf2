"""Engines that say the wrong thing, or shade wrongly."""

from dataclasses import replace

import numpy as np

from engines.choices import Option
from engines.conformance import asking, light
from engines.errors import ConfigError, UnknownName, Unsupported
from engines.interface import FullPattern, Settings
from engines.scene import Perspective, PerspectiveArctan, Sphere
from tests.conformance.mutants import breaks
from tests.conformance.small_engine import Engine, Renderer


@breaks(asking.the_engine_says_what_it_is)
class Nameless(Engine):
    name = ""


@breaks(asking.the_engine_says_what_it_is)
class BadDefault(Engine):
    def accelerators(self):
        return {"none": {"chunk": Option(-1, "rays at a time", lambda value: "positive")}}


@breaks(asking.unknown_names_are_refused, asking.values_out_of_range_are_refused)
class Lenient(Engine):
    def prepare(self, scene, settings):
        try:
            return super().prepare(scene, settings)
        except (UnknownName, ConfigError):
            return self.renderer(scene, Settings(settings.width, settings.height))


@breaks(asking.unknown_names_are_refused)
class Vague(Engine):
    def prepare(self, scene, settings):
        try:
            return super().prepare(scene, settings)
        except UnknownName as error:
            raise UnknownName("name", error.found, []) from error


@breaks(asking.values_out_of_range_are_refused)
class WrongError(Engine):
    def prepare(self, scene, settings):
        try:
            return super().prepare(scene, settings)
        except ConfigError as error:
            raise ValueError(str(error)) from error


@breaks(asking.unknown_names_are_refused, asking.values_out_of_range_are_refused)
class Careless(Engine):
    def why_not(self, scene, settings):
        try:
            return super().why_not(scene, settings)
        except (UnknownName, ConfigError):
            return None

    def prepare(self, scene, settings):
        Engine().why_not(scene, settings)
        return super().prepare(scene, settings)


@breaks(asking.why_not_and_prepare_agree)
class Promising(Engine):
    def why_not(self, scene, settings):
        super().why_not(scene, settings)

    def prepare(self, scene, settings):
        return Engine().prepare(scene, settings)


@breaks(asking.why_not_and_prepare_agree)
class OtherWords(Engine):
    def prepare(self, scene, settings):
        try:
            return super().prepare(scene, settings)
        except Unsupported as reason:
            raise Unsupported("it cannot") from reason


@breaks(asking.why_not_and_prepare_agree)
class TooModest(Engine):
    def why_not(self, scene, settings):
        spheres = any(isinstance(shape, Sphere) for shape in scene.shapes)
        return "small has no spheres" if spheres else super().why_not(scene, settings)

    def prepare(self, scene, settings):
        return Engine().prepare(scene, settings)


@breaks(asking.counters_count)
class MissingCounter(Renderer):
    def counters(self):
        return {name: value for name, value in super().counters().items() if name != "accelerator_bytes"}


@breaks(asking.counters_count)
class RaysAreNotCounted(Renderer):
    def counters(self):
        return {**super().counters(), "rays": 0}


@breaks(light.the_furnace_is_uniform)
class TwoPerCentBrighter(Renderer):
    def response(self, hits):
        kd, emission = super().response(hits)
        return kd, emission * 1.02


@breaks(light.the_furnace_is_uniform)
class EmissionOnTheWrongSide(Renderer):
    def response(self, hits):
        return super().response(replace(hits, normal=-hits.normal))


@breaks(light.the_furnace_is_uniform)
class OneSegmentShort(Renderer):
    def __init__(self, scene, settings):
        super().__init__(scene, settings)
        if "max_depth" in self.shader.options:
            depth = max(self.shader.options["max_depth"] - 1, 1)
            self.shader = replace(self.shader, options={**self.shader.options, "max_depth": depth})


@breaks(light.a_point_light_falls_off_with_the_square)
class FallsOffLinearly(Renderer):
    def point_light(self, light, points, normals, kd):
        distance = np.linalg.norm(np.array(light.position) - points, axis=1, keepdims=True)
        return super().point_light(light, points, normals, kd) * distance


@breaks(light.what_is_in_shadow_is_black)
class NoShadows(Renderer):
    def occluded(self, origins, directions, t_max=np.inf):
        return np.zeros(len(np.asarray(origins)), bool)


@breaks(light.images_are_upright)
class UpsideDown(Renderer):
    def samples(self):
        height, width = self.film.counts.shape
        return super().samples().reshape(height, width, 3)[::-1].reshape(-1, 3)


@breaks(light.images_are_upright)
class Mirrored(Renderer):
    def samples(self):
        height, width = self.film.counts.shape
        return super().samples().reshape(height, width, 3)[:, ::-1].reshape(-1, 3)


@breaks(light.images_are_upright)
class BlueGreenRed(Renderer):
    def samples(self):
        return super().samples()[:, ::-1]


@breaks(light.cameras_show_what_lies_along_their_rays)
class PinholeForAll(Engine):
    """Takes a camera that maps angles for one that maps a plane."""

    def why_not(self, scene, settings):
        return super().why_not(replace(scene, camera=pinhole(scene.camera)), settings)

    def prepare(self, scene, settings):
        return self.renderer(replace(scene, camera=pinhole(scene.camera)), settings)


def pinhole(camera):
    if not isinstance(camera, PerspectiveArctan):
        return camera
    return Perspective(camera.eye, camera.target, camera.up, camera.fov, camera.fov_axis, camera.resolution)


@breaks(light.lossless_glass_is_invisible_in_a_furnace)
class BlackGlass(Engine):
    """Takes glass for a diffuse surface without albedo."""

    def why_not(self, scene, settings):
        plain = tuple(replace(material, ks=(0, 0, 0), kt=(0, 0, 0)) for material in scene.materials)
        return super().why_not(replace(scene, materials=plain), settings)


@breaks(asking.whole_patterns_are_as_large_as_asked)
class SmallPatterns(Engine):
    def full_pattern(self, sampler, spp):
        return FullPattern(max(1, spp - 1), sampler)


@breaks(asking.whole_patterns_are_as_large_as_asked)
class ForgetfulPatterns(Engine):
    def full_pattern(self, sampler, spp):
        return FullPattern(2 * spp, sampler)
