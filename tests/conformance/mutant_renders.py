"""Engines that fill the film wrongly, or at the wrong time."""

import time
from dataclasses import replace

import numpy as np

from engines.conformance import rendering
from engines.film import Film
from tests.conformance.mutants import breaks
from tests.conformance.small_engine import Renderer


@breaks(rendering.film_has_the_size_asked_for)
class SceneDecides(Renderer):
    def __init__(self, scene, settings):
        super().__init__(scene, replace(settings, width=None, height=None))


@breaks(rendering.render_adds_to_the_film)
class OneSampleShort(Renderer):
    def render(self, spp, on_pass=None):
        return super().render(max(spp - 1, 1), on_pass)


@breaks(rendering.render_adds_to_the_film)
class NotANumber(Renderer):
    def samples(self):
        return super().samples() * np.where(self.random().random((self.film.counts.size, 1)) < 0.1, np.nan, 1)


@breaks(rendering.render_adds_to_the_film)
class AnotherFilm(Renderer):
    def render(self, spp, on_pass=None):
        super().render(spp, on_pass)
        return Film(self.film.width, self.film.height)


@breaks(rendering.the_parts_of_the_film_belong_together)
class SquaresOfMeans(Renderer):
    def render(self, spp, on_pass=None):
        film = super().render(spp, on_pass)
        film.squares[...] = film.sums**2 / film.counts[:, :, None]
        return film


@breaks(rendering.the_parts_of_the_film_belong_together)
class HalvesExchanged(Renderer):
    def render(self, spp, on_pass=None):
        film = super().render(spp, on_pass)
        film.even_sums[...] = film.sums - film.even_sums
        return film


@breaks(rendering.the_parts_of_the_film_belong_together)
class Black(Renderer):
    def samples(self):
        return 0 * super().samples()


@breaks(rendering.warm_up_leaves_the_film_untouched)
class WarmUpRenders(Renderer):
    def warm_up(self):
        self.render(1)


@breaks(rendering.warm_up_leaves_the_film_untouched)
class WarmUpAdvances(Renderer):
    def warm_up(self):
        self.done += 1


@breaks(rendering.warm_up_leaves_the_film_untouched)
class WarmUpClears(Renderer):
    def warm_up(self):
        self.film.clear()


@breaks(rendering.a_split_render_is_the_same)
class CallsStartAnew(Renderer):
    def render(self, spp, on_pass=None):
        self.done = 0
        return super().render(spp, on_pass)


@breaks(rendering.threads_change_nothing)
class ThreadsDraw(Renderer):
    def random(self):
        return np.random.default_rng([self.settings.seed, self.done, self.settings.threads])


@breaks(rendering.threads_change_nothing)
class ThreadsRound(Renderer):
    def samples(self):
        return super().samples() * (1 + 4e-16 * (self.settings.threads > 2))


@breaks(rendering.seeds_matter)
class Unseeded(Renderer):
    def random(self):
        return np.random.default_rng(self.done)


@breaks(rendering.seeds_matter)
class HalfASeed(Renderer):
    def random(self):
        return np.random.default_rng([self.settings.seed % 2**32, self.done])


@breaks(rendering.seeds_matter, rendering.a_split_render_is_the_same)
class TrulyRandom(Renderer):
    def random(self):
        return np.random.default_rng()


@breaks(rendering.on_pass_sees_the_film_grow)
class SilentPasses(Renderer):
    def render(self, spp, on_pass=None):
        return super().render(spp)


@breaks(rendering.on_pass_sees_the_film_grow)
class LatePasses(Renderer):
    def render(self, spp, on_pass=None):
        if on_pass:
            on_pass(self.film)
        return super().render(spp)


@breaks(rendering.stop_in_a_callback_ends_the_render, rendering.stop_from_a_thread_ends_the_render)
class DeafToStop(Renderer):
    def stop(self):
        pass


@breaks(rendering.stop_in_a_callback_ends_the_render, rendering.stop_from_a_thread_ends_the_render)
class StopForgets(Renderer):
    def stop(self):
        super().stop()
        self.film.clear()


@breaks(rendering.stop_from_a_thread_ends_the_render)
class StopsLate(Renderer):
    def render(self, spp, on_pass=None):
        film = super().render(spp, on_pass)
        time.sleep(0.3)
        return film


@breaks(rendering.stop_at_rest_does_nothing)
class StopIsKept(Renderer):
    def render(self, spp, on_pass=None):
        return self.film if self.stopped else super().render(spp, on_pass)


@breaks(rendering.update_of_the_camera_starts_anew, rendering.update_of_the_shapes_starts_anew)
class UpdateKeepsTheFilm(Renderer):
    def update(self, camera=None, shapes=None):
        self.camera, self.shapes = camera or self.camera, shapes or self.shapes


@breaks(rendering.update_of_the_camera_starts_anew, rendering.update_of_the_shapes_starts_anew)
class UpdateOnlyClears(Renderer):
    def update(self, camera=None, shapes=None):
        super().update()


@breaks(rendering.update_of_the_camera_starts_anew)
class UpdateGoesOnDrawing(Renderer):
    def update(self, camera=None, shapes=None):
        done = self.done
        super().update(camera, shapes)
        self.done = done


@breaks(rendering.update_of_the_shapes_starts_anew)
class OldShapesStay(Renderer):
    def update(self, camera=None, shapes=None):
        super().update(camera, (*self.shapes, *shapes) if shapes else None)
