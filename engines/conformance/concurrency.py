"""Claims about calls from several threads, and about an update that asks for another size."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from engines.conformance.rendering import ENDLESS, PATIENCE_SECONDS, expect_same, sums
from engines.conformance.stage import scene
from engines.conformance.subject import Declined, Subject, expect
from engines.errors import Unsupported
from engines.interface import Renderer

RAYS = 257
HANG_SECONDS = 120.0
"""After so long a call counts as one that does not return."""
PASS_SECONDS = 5.0
"""After so long a render without a pass is taken to be under way: one by another program is one long pass."""


@contextlib.contextmanager
def _rendering(renderer: Renderer) -> Iterator[None]:
    """A render without an end in another thread; behind the block it is ended, and seen to end."""
    passed, given_up, failures = threading.Event(), threading.Event(), []

    def look(film: Any) -> None:
        passed.set()
        expect(not given_up.is_set(), "nobody waits for this render any more")

    def run() -> None:
        try:
            renderer.render(ENDLESS, on_pass=look)
        except BaseException as error:
            failures.append(error)

    renderer.warm_up()
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        passed.wait(PASS_SECONDS)
        thread.join(0.1)
        expect(not failures, f"the render failed: {failures}")
        if not thread.is_alive():
            raise Declined(f"{ENDLESS:,} samples per pixel are rendered at once: nothing can be called meanwhile")
        yield
    finally:
        renderer.stop()
        thread.join(PATIENCE_SECONDS)
        given_up.set()
    expect(not thread.is_alive(), f"render still runs {PATIENCE_SECONDS:g} s after stop()")
    expect(not failures, f"the render failed: {failures}")


def _within_time(call: Callable[[], Any], name: str) -> Any:
    """What `call` returns or raises, from a thread of its own; `Broken` where it does neither."""
    results: list[Any] = []

    def run() -> None:
        try:
            results.append(call())
        except BaseException as error:
            results.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(HANG_SECONDS)
    expect(results, f"{name} while a render runs did not return in {HANG_SECONDS:g} s")
    return results[0]


def rays_beside_a_render_are_answered_as_alone(subject: Subject) -> None:
    """trace and occluded while a render runs answer as they do alone, or raise RuntimeError; the image is unharmed."""
    renderer = subject.usual()
    generator = np.random.default_rng(3)
    rays = generator.uniform((-1, 0, 3), (1, 2, 5), (RAYS, 3)), generator.normal(size=(RAYS, 3))
    try:
        alone = {"trace": renderer.trace(*rays).t, "occluded": renderer.occluded(*rays)}
    except Unsupported as reason:
        raise Declined(str(reason)) from reason
    calls: dict[str, Callable[[], Any]] = {
        "trace": lambda: renderer.trace(*rays).t,
        "occluded": lambda: renderer.occluded(*rays),
    }
    with _rendering(renderer):
        for name, call in (*calls.items(), *calls.items()):
            answer = _within_time(call, name)
            if isinstance(answer, RuntimeError):
                continue
            expect(not isinstance(answer, BaseException), f"{name} raised {answer!r} while a render ran")
            expect(np.array_equal(answer, alone[name]), f"{name} gave other answers while a render ran")
    _expect_unharmed(subject, renderer)


def _expect_unharmed(subject: Subject, renderer: Renderer) -> None:
    """The pixels that hold as many samples as the least are those of a render that nobody disturbed."""
    counts = np.asarray(renderer.film.counts)
    done = int(counts.min())
    if not 0 < done < 2000:
        return  # too many to render again
    undisturbed = subject.usual()
    for _ in range(done):  # by passes, as it was disturbed
        undisturbed.render(1)
    here = counts == done
    same = (undisturbed.film.sums == renderer.film.sums)[here].all()
    expect(same, "the image of a render beside which rays were traced is not that of one left alone")


def a_render_is_not_disturbed(subject: Subject) -> None:
    """render, warm_up and update while a render runs raise RuntimeError, from another thread and from on_pass."""
    renderer, (held, _) = subject.usual(), subject.easiest
    calls: dict[str, Callable[[], Any]] = {
        "render": lambda: renderer.render(1),
        "warm_up": renderer.warm_up,
        "update(camera)": lambda: renderer.update(camera=held.camera),
        "update(shapes)": lambda: renderer.update(shapes=held.shapes),
    }
    with _rendering(renderer):
        for name, call in calls.items():
            answer = _within_time(call, name)
            refused = isinstance(answer, (RuntimeError, Unsupported))
            expect(refused, f"{name} while a render ran: {answer!r}, expected RuntimeError")
    inside: dict[str, Any] = {}

    def look(film: Any) -> None:
        for name, call in calls.items():
            try:
                inside[name] = call()
            except (RuntimeError, Unsupported):
                continue

    renderer.render(1, on_pass=look)
    expect(not inside, f"{', '.join(inside)} from on_pass went ahead, expected RuntimeError")
    before = renderer.film.spp
    expect(renderer.render(1).spp == before + 1, "the renderer does not render after it has refused calls")


def update_takes_the_size_of_the_camera(subject: Subject) -> None:
    """After update(camera) the film has the settings' size, or else the new camera's, and its image."""
    held, accepted = subject.easiest
    camera = scene([], eye=[0.5, 1.5, 4.5], resolution=[10, 6]).camera
    for size, expected in (({"width": None, "height": None}, (10, 6)), ({"width": 7, "height": 5}, (7, 5))):
        renderer = subject.usual(**size)
        renderer.render(1)
        try:
            renderer.update(camera=camera)
        except Unsupported as reason:
            raise Declined(str(reason)) from reason
        film = renderer.render(2)
        found = film.width, film.height
        expect(found == expected, f"after update(camera) the film is {found[0]}x{found[1]}, expected {expected}")
        moved = replace(held, camera=camera, content_hash=held.content_hash + " from a small window")
        prepared = subject.renderer(moved, **{**accepted, **size}).render(2)
        expect_same(sums(prepared), sums(film), "prepared with the camera, and updated")


CLAIMS = (rays_beside_a_render_are_answered_as_alone, a_render_is_not_disturbed, update_takes_the_size_of_the_camera)
