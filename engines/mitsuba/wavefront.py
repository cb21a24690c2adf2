"""Passes of the JIT-compiled variant: one kernel in which every pixel is a lane that takes sample after sample.

A lane's sampler goes on from call to call, so that it does not matter how samples are split into calls, and the
film's sums, squares and halves are made where the samples are. Samplers with a pattern take a launch for each sample,
which adds some 10 ms. With eight samples a pixel of cornell_box, 512 x 512,
this takes 0.97 times as long as `mitsuba.render`, whose film holds the means alone.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

from engines.film import Film
from engines.mitsuba.seeds import seed_of
from engines.mitsuba.shaders import SHADERS
from engines.mitsuba.stage import Stage

LAUNCH_SAMPLES = 1 << 20
"""Samples of the first launch; the others take about `LAUNCH_SECONDS`, or `RECORDINGS` times as long as recording one."""
LAUNCH_SECONDS, RECORDINGS = 0.5, 20.0
"""Recording costs some 10 ms, and seconds where surfaces are many; in a launch neither `stop` nor an interrupt is heard."""


class Wavefront:
    """The state of a render: sums of the samples so far, and where the sampler stands."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._radiance = SHADERS[stage.settings.shader.name](stage)
        self._pixels = stage.size[0] * stage.size[1]
        self._endless = stage.settings.sampler.name in ("random", "independent")
        self._period = int(stage.camera.sampler().sample_count())  # as Mitsuba rounds it
        self._recording_seconds, self._seconds_per_sample = 0.0, 0.0
        self.restart()

    def restart(self) -> None:
        """Back to before the first sample."""
        self.done = 0
        self._sampler: Any = None
        self._sums = self._zeros()

    def _zeros(self) -> tuple[Any, ...]:
        mi, dr = self._stage.mi, self._stage.dr
        zeros = *(dr.zeros(mi.Vector3d, self._pixels) for _ in range(3)), dr.zeros(mi.UInt32, self._pixels)
        dr.make_opaque(zeros)  # known constants would make a kernel of their own
        return zeros

    def step(self) -> int:
        """Samples a pixel for the next launch."""
        if not self._seconds_per_sample:
            return max(1, LAUNCH_SAMPLES // self._pixels)
        return max(1, int(max(LAUNCH_SECONDS, RECORDINGS * self._recording_seconds) / self._seconds_per_sample))

    def compile(self) -> None:
        """Compiles the two kernels of `render`, for a sampler fresh from its seed and for one that goes on.

        They run without taking a sample, or where the sampler has a pattern, with its first two.
        """
        count = 0 if self._endless else 1
        sampler, sums = self._launch(self._seeded(0), self._zeros(), 0, count)
        self._launch(sampler, sums, count, count)

    def render(self, samples: int) -> bool:
        """Adds samples to every pixel, and says so."""
        while samples > 0:
            pattern, place = (0, self.done) if self._endless else divmod(self.done, self._period)
            if place == 0:
                self._sampler = self._seeded(pattern)
            now = samples if self._endless else 1
            self._sampler, self._sums = self._launch(self._sampler, self._sums, self.done, now)
            self.done += now
            samples -= now
        return True

    def fill(self, film: Film) -> None:
        """Copies what has been gathered to the film."""
        for array, sums in zip((film.sums, film.squares, film.even_sums), self._sums, strict=False):
            for channel in range(3):
                array[..., channel] = sums[channel].numpy().reshape(array.shape[:2])
        film.counts[...] = self.done
        film.bad_samples = int(self._sums[3].numpy().sum())

    def _seeded(self, pattern: int) -> Any:
        sampler = self._stage.camera.sampler().clone()
        sampler.set_samples_per_wavefront(1)
        seed = seed_of(self._stage.settings.seed, pattern)
        sampler.seed(self._stage.dr.opaque(self._stage.mi.UInt32, seed), self._pixels)  # not part of the kernel
        sampler.schedule_state()
        return sampler

    def _launch(self, sampler: Any, sums: tuple[Any, ...], first: int, count: int) -> tuple[Any, tuple[Any, ...]]:
        """Takes `count` samples a pixel, of index `first` and on, and waits until they are there."""
        begin = perf_counter()
        mi, dr, (width, height) = self._stage.mi, self._stage.dr, self._stage.size
        camera, aperture = self._stage.camera, mi.Point2f(0.5)
        first, last = dr.opaque(mi.UInt32, first), dr.opaque(mi.UInt32, first + count)
        lane = dr.arange(mi.UInt32, self._pixels)
        corner, size = mi.Vector2f(lane % width, lane // width), mi.Vector2f(width, height)

        def go_on(index: Any, *state: Any) -> Any:
            return index < last

        def step(index: Any, sampler: Any, sums: Any, squares: Any, evens: Any, bad: Any) -> Any:
            place = (corner + sampler.next_2d()) / size
            ray, weight = camera.sample_ray_differential(0.0, 0.5, place, aperture)
            colour = weight * self._radiance(sampler, ray)
            good = dr.all(dr.isfinite(colour))
            sample = mi.Vector3d(dr.select(good, mi.Color3f(colour), 0.0))
            even = dr.select((index & 1) == 0, sample, 0.0)
            bad = bad + dr.select(good, mi.UInt32(0), 1)
            return index + 1, sampler, sums + sample, squares + sample * sample, evens + even, bad

        labels = ("index", "sampler", "sums", "squares", "evens", "bad")
        if self._endless:
            _, sampler, *gathered = dr.while_loop((first, sampler, *sums), go_on, step, labels=labels)
        else:  # where a sampler stands in its pattern does not survive a recorded loop
            _, sampler, *gathered = step(first, sampler, *sums)
            sampler.advance()
        sampler.schedule_state()
        recorded = perf_counter()
        dr.eval(gathered)
        dr.sync_thread()
        self._recording_seconds = recorded - begin
        self._seconds_per_sample = (perf_counter() - recorded) / count if count else 0.0
        return sampler, tuple(gathered)
