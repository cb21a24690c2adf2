"""Claims about `render` and what surrounds it: the film, passes, threads, seeds, stopping and updating."""

from __future__ import annotations

import contextlib
import threading
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.conformance.stage import CAMERA, rectangle, scene
from engines.conformance.subject import BASE, Declined, Subject, expect
from engines.errors import Unsupported
from engines.film import Film
from engines.interface import Renderer

ENDLESS = 10_000_000
"""Samples per pixel that no engine finishes while a test looks on."""
STOP_SECONDS = 0.2
PATIENCE_SECONDS = 20.0

Sums = dict[str, NDArray[Any]]


def sums(film: Film) -> Sums:
    """A copy of all that a film has gathered."""
    return {name: np.array(getattr(film, name)) for name in ("sums", "squares", "even_sums", "counts")}


def differences(one: NDArray[Any], other: NDArray[Any]) -> int:
    """How many values differ; NaN, which says that a value is unknown, is the same as NaN."""
    return int(((one != other) & ~(np.isnan(one) & np.isnan(other))).sum())


def expect_same(one: Sums, other: Sums, what: str) -> None:
    """Every value of two films is the same."""
    for name, array in one.items():
        different = differences(array, other[name])
        expect(different == 0, f"{what}: {different} of {array.size} values of film.{name} differ")


def _untouched(film: Film) -> bool:
    return not any(array.any() for array in sums(film).values())


def film_has_the_size_asked_for(subject: Subject) -> None:
    """The film has the settings' size, or else the scene's, and starts empty."""
    width, height = CAMERA["resolution"]
    for changes, size in (({"width": 5, "height": 3}, (5, 3)), ({"width": None, "height": None}, (width, height))):
        film = subject.usual(**changes).film
        expect(isinstance(film, Film), f"renderer.film is a {type(film).__name__}, not an engines.Film")
        expect((film.width, film.height) == size, f"film of {film.width}x{film.height}, expected {size[0]}x{size[1]}")
        expect(film.mean().shape == (size[1], size[0], 3), f"film.mean() has shape {film.mean().shape}")
        expect(_untouched(film), "the film is not empty before the first render")


def render_adds_to_the_film(subject: Subject) -> None:
    """render(n) adds n finite samples to every pixel of the film, and returns it."""
    renderer, total = subject.usual(), 0
    for spp in (1, 2):
        film, total = renderer.render(spp), total + spp
        expect(
            (film.counts == total).all(), f"after {total} samples film.counts run {film.counts.min()} to {film.counts.max()}"
        )
        expect_same(sums(film), sums(renderer.film), "the film returned and renderer.film")
    image = film.mean()
    expect(np.isfinite(image).all(), "film.mean() is not finite")
    expect(np.isfinite(film.variance_of_mean()).all(), "film.variance_of_mean() is not finite")
    expect(image.min() >= 0, f"film.mean() goes down to {image.min()}")
    expect(film.bad_samples == 0, f"{film.bad_samples} bad samples")


def the_parts_of_the_film_belong_together(subject: Subject) -> None:
    """The squares are of the same samples as the sums, and the even half holds samples 0, 2, ..."""
    renderer = subject.usual()
    first = sums(renderer.render(1))
    expect(first["sums"].any(), "the image is black")
    expect(np.allclose(first["squares"], first["sums"] ** 2, rtol=1e-5), "after one sample, squares are not sums squared")
    expect(np.array_equal(first["even_sums"], first["sums"]), "after one sample, even_sums are not the sums")
    second = sums(renderer.render(1))
    expect(np.array_equal(second["even_sums"], first["sums"]), "sample 1 went into even_sums")
    samples = second["sums"] - first["sums"]
    both = first["squares"] + samples**2
    expect(np.allclose(second["squares"], both, rtol=1e-5, atol=1e-9), "after two samples, squares are not theirs")


def warm_up_leaves_the_film_untouched(subject: Subject) -> None:
    """warm_up changes neither an empty film, nor a filled one, nor the image that follows."""
    cold, warm = subject.usual(), subject.usual()
    warm.warm_up()
    expect(_untouched(warm.film), "the film is not empty after warm_up")
    filled = sums(warm.render(2))
    warm.warm_up()
    expect_same(filled, sums(warm.film), "before and after warm_up")
    expect_same(sums(cold.render(2)), filled, "without and with warm_up")


def a_split_render_is_the_same(subject: Subject) -> None:
    """However render's samples are split into calls, no bit of the film changes."""
    whole, split = subject.usual(), subject.usual()
    for spp in (1, 3, 2):
        split.render(spp)
    expect_same(sums(whole.render(6)), sums(split.film), "6 samples at once and as 1 + 3 + 2")


def threads_change_nothing(subject: Subject) -> None:
    """1, 2 and 4 threads give the same film, bit for bit."""
    size = {"width": 41, "height": 37}
    one = sums(subject.usual(threads=1, **size).render(3))
    for threads in (2, 4):
        expect_same(one, sums(subject.usual(threads=threads, **size).render(3)), f"1 and {threads} threads")


def seeds_matter(subject: Subject) -> None:
    """A seed gives one image and every other seed another; all 64 bits count."""
    seed = BASE["seed"]  # of eight samples: a few that are drawn anew may come out alike in so small an image
    one = sums(subject.usual(sampler="random", seed=seed).render(8))
    expect_same(one, sums(subject.usual(sampler="random", seed=seed).render(8)), "two renders with one seed")
    for other in (seed + 1, seed + 2**40):
        image = sums(subject.usual(sampler="random", seed=other).render(8))
        expect(differences(one["sums"], image["sums"]), f"seeds {seed} and {other} give the same image")


def on_pass_sees_the_film_grow(subject: Subject) -> None:
    """on_pass is called with the film after every pass, the last time when all samples are in."""
    seen: list[int] = []

    def note(film: Film) -> None:
        expect(isinstance(film, Film), f"on_pass was given a {type(film).__name__}, not the film")
        seen.append(film.spp)

    subject.usual().render(4, on_pass=note)
    expect(seen, "on_pass was never called")
    expect(seen == sorted(seen), f"on_pass saw {seen} samples per pixel")
    expect(seen[-1] == 4, f"the last pass showed {seen[-1]} samples of 4")


def stop_in_a_callback_ends_the_render(subject: Subject) -> None:
    """stop() from on_pass ends the render, keeps what is done, and the next render goes on from there."""
    renderer, passes = subject.usual(), []

    def halt(film: Film) -> None:
        passes.append(film.spp)
        renderer.stop()
        expect(len(passes) < 100, "stop() from on_pass did not end the render")

    renderer.render(ENDLESS, on_pass=halt)
    done = renderer.film.counts.copy()
    expect(done.min() > 0, "what was done before stop() is lost")
    renderer.render(2)
    expect((renderer.film.counts == done + 2).all(), "a render after stop() did not add its samples to every pixel")
    expect(np.isfinite(renderer.film.mean()).all(), "the film is not finite after stop()")


def stop_from_a_thread_ends_the_render(subject: Subject) -> None:
    """stop() from another thread makes render return within 0.2 s and keeps what is done."""
    tries: list[float] = []
    while len(tries) < 3 and (not tries or tries[-1] > STOP_SECONDS):  # a busy machine may be to blame for one
        tries.append(_stop_seconds(subject))
    expect(tries[-1] <= STOP_SECONDS, f"render returned {min(tries):.2f} s after stop(), not within {STOP_SECONDS} s")


def _stop_seconds(subject: Subject) -> float:
    """Seconds from stop() to the end of render."""
    renderer, under_way, given_up = subject.usual(), threading.Event(), threading.Event()
    failed: list[Exception] = []

    def watch(film: Film) -> None:
        if film.spp >= 3:
            under_way.set()
        expect(not given_up.is_set(), "nobody waits for this render any more")

    def endless() -> None:
        try:
            renderer.render(ENDLESS, on_pass=watch)
        except Exception as error:
            failed.append(error)
            under_way.set()

    renderer.warm_up()
    thread = threading.Thread(target=endless, daemon=True)
    thread.start()
    started = under_way.wait(PATIENCE_SECONDS)
    done = renderer.film.spp
    since = time.perf_counter()
    renderer.stop()
    thread.join(PATIENCE_SECONDS)
    seconds = time.perf_counter() - since
    given_up.set()
    if failed:
        raise failed[0]
    expect(started, f"no 3 passes in {PATIENCE_SECONDS:g} s on a film of {renderer.film.width}x{renderer.film.height}")
    expect(not thread.is_alive(), f"render still runs {PATIENCE_SECONDS:g} s after stop()")
    expect(renderer.film.spp >= done, "what was done before stop() is lost")
    return seconds


def stop_at_rest_does_nothing(subject: Subject) -> None:
    """stop() while nothing renders does not end the next render."""
    renderer = subject.usual()
    renderer.stop()
    counts = renderer.render(2).counts
    expect((counts == 2).all(), f"after an idle stop(), render(2) added {counts.min()} samples")


def update_of_the_camera_starts_anew(subject: Subject) -> None:
    """update(camera) empties the film, and the image is that of a renderer prepared with that camera."""
    held, accepted = subject.easiest
    camera = scene([], eye=[0.5, 1.5, 4.5]).camera
    moved = replace(held, camera=camera, content_hash=held.content_hash + " from elsewhere", source="")
    renderer = subject.usual()
    before = sums(renderer.render(2))
    _update(renderer, camera=moved.camera)
    expect(_untouched(renderer.film), "the film is not empty after update(camera)")
    after = sums(renderer.render(2))
    expect(differences(before["sums"], after["sums"]), "the image is the same after update(camera)")
    expect_same(sums(subject.renderer(moved, **accepted).render(2)), after, "prepared with the camera, and updated")


def update_of_the_shapes_starts_anew(subject: Subject) -> None:
    """update(shapes) empties the film; rays and images then meet the new shapes alone."""
    near, far = (scene([rectangle((-9, 9), (-9, 9), z), rectangle((0, 1), (1, 2), z + 0.5, "lamp")]) for z in (0, -2))
    renderer = subject.renderer(near, **subject.easiest[1])
    before = sums(renderer.render(2))
    _update(renderer, shapes=far.shapes)
    expect(_untouched(renderer.film), "the film is not empty after update(shapes)")
    with contextlib.suppress(Declined):  # without single rays, images alone tell
        hits = renderer.trace([[-1, 0, 5]], [[0, 0, -1]])
        expect(np.isclose(hits.t[0], 7), f"a shape moved from t = 5 to t = 7 by update(shapes) is hit at {hits.t[0]}")
        expect(not renderer.occluded([[-1, 0, 5]], [[0, 0, -1]], 6.0)[0], "the old shape is still in the way of rays")
    after = sums(renderer.render(2))
    expect(differences(before["sums"], after["sums"]), "the image is the same after update(shapes)")
    anew = sums(subject.renderer(far, **subject.easiest[1]).render(2))
    close = np.isclose(anew["sums"], after["sums"], rtol=1e-3).all(axis=2).mean()
    expect(close > 0.98, f"only {close:.1%} of the pixels are those of a renderer prepared with these shapes")


def _update(renderer: Renderer, **changes: Any) -> None:
    try:
        renderer.update(**changes)
    except Unsupported as reason:
        raise Declined(str(reason)) from reason


CLAIMS = (
    film_has_the_size_asked_for,
    render_adds_to_the_film,
    the_parts_of_the_film_belong_together,
    warm_up_leaves_the_film_untouched,
    a_split_render_is_the_same,
    threads_change_nothing,
    seeds_matter,
    on_pass_sees_the_film_grow,
    stop_in_a_callback_ends_the_render,
    stop_from_a_thread_ends_the_render,
    stop_at_rest_does_nothing,
    update_of_the_camera_starts_anew,
    update_of_the_shapes_starts_anew,
)
