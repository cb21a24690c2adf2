"""Passes of the JIT-compiled variant: every lane of a launch is one sample of one pixel, as in `mitsuba.render`.

The samples of a pixel lie side by side, and neighbouring pixels next, so that the lanes of a vector follow similar paths. A
second kernel adds them to the film's sums, squares and even sums, in the order of their indices: the film does not depend
on how samples are split into calls. `python -m tests.benchmarks.adapter_overhead` compares the time that this takes with that
of `mitsuba.render`.
"""

from __future__ import annotations

from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.film import Film
from engines.peers.mitsuba.shaders import SHADERS
from engines.peers.mitsuba.stage import Stage
from engines.peers.mitsuba.streams import seed_of, stream_sampler

FIRST_LANES = 1 << 20
"""Of the first launch of independent samples; the others take about `LAUNCH_SECONDS`, or `RECORDINGS` times as long as
recording one."""
MOST_LANES = 1 << 22
"""Of a launch, where a pixel needs no more: the radiance of its samples, 12 bytes per lane, stays in memory until added."""
LAUNCH_SECONDS, RECORDINGS = 1.0, 50.0
"""Recording costs milliseconds, and seconds where surfaces are many; in a launch neither `stop` nor an interrupt is heard."""
LANES_OF_A_VECTOR = 16
"""At most. A part of a pattern costs least in whole vectors, for the lanes of its other samples idle."""


STRIP_ROWS = 4
"""Independent samples are launched along columns of so many rows: a vector then covers four pixels by four, or fewer."""


class Band(NamedTuple):
    """Consecutive pixels that are launched together."""

    first: int
    pixels: int


class Sums(NamedTuple):
    """Of a band: `sums`, `squares` and `evens` as the film has them, 3 x pixels, and bad samples of each pixel."""

    sums: Any
    squares: Any
    evens: Any
    bad: Any


class Wavefront:
    """The state of a render: sums of the samples so far."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._radiance = SHADERS[stage.settings.shader.name](stage)
        pixels = stage.size[0] * stage.size[1]
        independent = stage.settings.sampler.name in ("random", "independent")
        self._pattern = 0 if independent else int(stage.camera.sampler().sample_count())  # as Mitsuba rounds it
        size = max(1, MOST_LANES // self._pattern) if self._pattern else pixels
        self._bands = [Band(first, min(size, pixels - first)) for first in range(0, pixels, size)]
        self._recording_seconds, self._seconds_per_sample = 0.0, 0.0
        self._cancelled = False
        self.done = 0
        self._sums = [self._zeros(band.pixels) for band in self._bands]

    def _zeros(self, pixels: int) -> Sums:
        mi, dr = self._stage.mi, self._stage.dr
        sums, squares, evens = (dr.zeros(mi.Float64, 3 * pixels) for _ in range(3))
        zeros = Sums(sums, squares, evens, dr.zeros(mi.UInt32, pixels))
        dr.make_opaque(*zeros)  # known constants would make a kernel of their own
        return zeros

    def step(self, left: int, seen: bool) -> int:
        """Samples per pixel for the next pass, at most `left`. `seen`: its film is shown, so that it should come soon."""
        if self._pattern:
            place = self.done % self._pattern
            part = LANES_OF_A_VECTOR - place % LANES_OF_A_VECTOR if seen else self._pattern
            return min(left, part, self._pattern - place)
        if seen:
            return 1
        pixels = self._bands[0].pixels
        samples = FIRST_LANES // pixels
        if self._seconds_per_sample:
            samples = int(max(LAUNCH_SECONDS, RECORDINGS * self._recording_seconds) / self._seconds_per_sample)
        samples = max(1, min(samples, MOST_LANES // pixels))
        return left if left <= samples * 3 // 2 else samples

    def compile(self) -> None:
        """Compiles the kernels of `render`, by two samples of a few pixels."""
        band = Band(0, min(STRIP_ROWS, self._bands[0].pixels))
        self._launch(band, self._zeros(band.pixels), 0, min(2, self._pattern or 2))

    def render(self, samples: int) -> bool:
        """Adds samples to every pixel; False where `cancel` ended that, between patterns or within one, which is dropped."""
        self._cancelled = False
        while samples > 0:
            now = min(samples, self._pattern - self.done % self._pattern) if self._pattern else samples
            sums = []
            for band, before in zip(self._bands, self._sums, strict=True):
                if self._cancelled and sums:
                    return False
                sums.append(self._launch(band, before, self.done, now))
            self._sums = sums
            self.done += now
            samples -= now
        return True

    def cancel(self) -> None:
        """Ends a running pass between two of its launches, from another thread."""
        self._cancelled = True

    def fill(self, film: Film) -> None:
        """Gives the film what has been gathered. Its arrays are then the memory that the next launch reads."""
        shape = film.sums.shape
        parts = [[array.numpy() for array in sums] for sums in self._sums]
        sums, squares, evens, bad = (_joined(list(arrays)) for arrays in zip(*parts, strict=True))
        film.sums, film.squares, film.even_sums = (array.reshape(shape) for array in (sums, squares, evens))
        film.counts[...] = self.done
        film.bad_samples = int(bad.sum())

    def _launch(self, band: Band, sums: Sums, first: int, count: int) -> Sums:
        """Takes `count` samples per pixel, of index `first` and on, and waits until they are there."""
        dr = self._stage.dr
        wall, processor = perf_counter(), process_time()
        colour, lanes, place = self._traced(band, first, count)
        recorded = perf_counter() - wall
        dr.eval(colour)
        again = perf_counter()
        added = self._added(sums, colour, lanes, place, first, count)
        recorded += perf_counter() - again
        dr.eval(*added)
        dr.sync_thread()
        wall, processor = perf_counter() - wall, process_time() - processor
        self._recording_seconds = recorded
        # other processes stretch the wall clock, and launches should not be shorter for it
        self._seconds_per_sample = max(1e-9, min(wall, processor / self._stage.settings.threads) / count)
        return added

    def _traced(self, band: Band, first: int, count: int) -> tuple[Any, int, int]:
        """The radiance of samples, `lanes` a pixel, and of which lane is the first: (colour, lanes, place)."""
        mi, dr, (width, height) = self._stage.mi, self._stage.dr, self._stage.size
        place, lanes = (first % self._pattern, self._pattern) if self._pattern else (0, count)
        lane = dr.arange(mi.UInt32, band.pixels * lanes)
        per_pixel = dr.opaque(mi.UInt32, lanes)
        pixel = mi.UInt32((mi.Float64(lane) + 0.5) / mi.Float64(per_pixel))  # exact below 2^32, and vectors divide so
        sample = lane - pixel * per_pixel
        pixel += dr.opaque(mi.UInt32, band.first)
        x, y = (pixel % width, pixel // width) if self._pattern else self._from_strips(pixel)
        sampler = self._sampler(band, first, pixel, sample)
        active = mi.Bool(True)
        if self._pattern:
            active = (sample >= dr.opaque(mi.UInt32, place)) & (sample < dr.opaque(mi.UInt32, place + count))
        position = (mi.Vector2f(x, y) + sampler.next_2d(active)) / mi.Vector2f(width, height)
        camera = self._stage.camera
        aperture = sampler.next_2d(active) if camera.needs_aperture_sample() else mi.Point2f(0.5)
        ray, weight = camera.sample_ray_differential(0.0, 0.5, position, aperture, active)
        return mi.Color3f(weight * self._radiance(sampler, ray, active)), lanes, place

    def _from_strips(self, index: Any) -> tuple[Any, Any]:
        """Column and row of the pixels of an index that runs along columns of `STRIP_ROWS` rows."""
        mi, dr, (width, height) = self._stage.mi, self._stage.dr, self._stage.size
        top = index // (STRIP_ROWS * width) * STRIP_ROWS
        rows = dr.minimum(height - top, STRIP_ROWS)
        within = index - top * width
        column = mi.UInt32((mi.Float(within) + 0.5) / mi.Float(rows))  # exact below 2^22
        return column, top + within - column * rows

    def _in_strips(self, pixel: Any) -> Any:
        """The inverse of `_from_strips`, of y * width + x."""
        dr, (width, height) = self._stage.dr, self._stage.size
        x, y = pixel % width, pixel // width
        top = y // STRIP_ROWS * STRIP_ROWS
        return top * width + x * dr.minimum(height - top, STRIP_ROWS) + y - top

    def _sampler(self, band: Band, first: int, pixel: Any, sample: Any) -> Any:
        mi, dr, seed = self._stage.mi, self._stage.dr, self._stage.settings.seed
        if not self._pattern:
            return stream_sampler(mi, dr, seed, pixel, sample + dr.opaque(mi.UInt32, first))
        sampler = self._stage.camera.sampler().clone()
        sampler.set_samples_per_wavefront(self._pattern)
        part = first // self._pattern * len(self._bands) + self._bands_before(band)
        sampler.seed(dr.opaque(mi.UInt32, seed_of(seed, part)), band.pixels * self._pattern)
        return sampler

    def _bands_before(self, band: Band) -> int:
        return band.first // self._bands[0].pixels

    def _added(self, before: Sums, colour: Any, lanes: int, place: int, first: int, count: int) -> Sums:
        """`before` with samples added, in the order of their indices."""
        mi, dr = self._stage.mi, self._stage.dr
        pixel = dr.arange(mi.UInt32, len(before.bad))
        launched = pixel if self._pattern else self._in_strips(pixel)
        begin = launched * dr.opaque(mi.UInt32, lanes) + dr.opaque(mi.UInt32, place)
        parity, end = dr.opaque(mi.UInt32, first & 1), dr.opaque(mi.UInt32, count)

        def go_on(index: Any, *state: Any) -> Any:
            return index < end

        def step(index: Any, sums: Any, squares: Any, evens: Any, bad: Any) -> Any:
            radiance = dr.gather(mi.Color3f, colour, begin + index)
            good = dr.all(dr.isfinite(radiance))
            sample = mi.Vector3d(dr.select(good, radiance, 0.0))
            even = dr.select(((index ^ parity) & 1) == 0, sample, 0.0)
            bad = bad + dr.select(good, mi.UInt32(0), 1)
            return index + 1, sums + sample, squares + sample * sample, evens + even, bad

        held = [dr.gather(mi.Vector3d, array, pixel) for array in before[:3]]
        labels = ("index", "sums", "squares", "evens", "bad")
        _, *gathered, bad = dr.while_loop((mi.UInt32(0), *held, before.bad), go_on, step, labels=labels)
        sums, squares, evens = map(dr.ravel, gathered)
        return Sums(sums, squares, evens, bad)


def _joined(parts: list[NDArray[Any]]) -> NDArray[Any]:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)
