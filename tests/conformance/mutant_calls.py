"""Engines that mind neither other threads nor the size of the camera."""

import time

from engines.conformance import concurrency
from engines.film import Film
from tests.conformance.mutants import breaks
from tests.conformance.small_engine import Renderer


class Watched(Renderer):
    """Knows whether it renders, and whether a ray comes from outside."""

    inside = False

    def samples(self):
        self.inside = True
        try:
            return super().samples()
        finally:
            self.inside = False

    @property
    def busy(self):
        return self.guard._exclusive.locked() and not self.inside


@breaks(concurrency.rays_beside_a_render_are_answered_as_alone)
class OtherAnswersBesideARender(Watched):
    def trace(self, *rays):
        return super().trace(*rays) if not self.busy else super().trace(*(array + 1 for array in rays))

    def samples(self):  # slow enough for rays to find it between two passes
        time.sleep(0.02)
        return super().samples()


@breaks(concurrency.rays_beside_a_render_are_answered_as_alone)
class FailsBesideARender(Watched):
    def occluded(self, *rays):
        if self.busy:
            raise ValueError("the memory is taken")
        return super().occluded(*rays)

    def samples(self):
        time.sleep(0.02)
        return super().samples()


@breaks(concurrency.rays_beside_a_render_are_answered_as_alone)
class HangsBesideARender(Watched):
    def trace(self, *rays):
        while self.busy:
            time.sleep(0.01)
            self.inside = False
        return super().trace(*rays)

    def samples(self):
        time.sleep(0.02)
        return super().samples()


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
