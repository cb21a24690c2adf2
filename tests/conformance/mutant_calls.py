"""Engines that mind neither other threads nor the size of the camera."""

import threading
import time

from engines.conformance import concurrency
from engines.film import Film
from tests.conformance.mutants import breaks
from tests.conformance.small_engine import Renderer


class Watched(Renderer):
    """Knows whether another thread renders."""

    renders_in = None

    def render(self, spp, on_pass=None):
        self.renders_in = threading.get_ident()
        try:
            return super().render(spp, on_pass)
        finally:
            self.renders_in = None

    @property
    def beside(self):
        return self.renders_in not in (None, threading.get_ident())


@breaks(concurrency.rays_beside_a_render_are_answered_as_alone)
class OtherAnswersBesideARender(Watched):
    def trace(self, *rays):
        return super().trace(*rays) if not self.beside else super().trace(*(array + 1 for array in rays))


@breaks(concurrency.rays_beside_a_render_are_answered_as_alone)
class FailsBesideARender(Watched):
    def occluded(self, *rays):
        if self.beside:
            raise ValueError("the memory is taken")
        return super().occluded(*rays)


@breaks(concurrency.rays_beside_a_render_are_answered_as_alone)
class WaitsForTheEndOfTheRender(Watched):
    def trace(self, *rays):
        while self.beside:
            time.sleep(0.01)
        return super().trace(*rays)


@breaks(concurrency.a_render_is_not_disturbed)
class UpdatesAtAnyTime(Renderer):
    def update(self, camera=None, shapes=None):
        self.camera, self.shapes = camera or self.camera, shapes or self.shapes


@breaks(concurrency.a_render_is_not_disturbed)
class RendersTwice(Renderer):
    def render(self, spp, on_pass=None):
        self.stopped = False
        for _ in range(spp):
            self.film.add(self.samples())
            self.done += 1
            if on_pass:
                on_pass(self.film)
            if self.stopped:
                break
        return self.film


@breaks(concurrency.update_takes_the_size_of_the_camera)
class KeepsItsSize(Renderer):
    def update(self, camera=None, shapes=None):
        width, height = self.film.width, self.film.height
        super().update(camera, shapes)
        self._film = Film(width, height)


@breaks(concurrency.update_takes_the_size_of_the_camera)
class TheCameraDecides(Renderer):
    def update(self, camera=None, shapes=None):
        super().update(camera, shapes)
        if camera is not None:
            self._film = Film(*camera.resolution)
