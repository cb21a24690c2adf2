"""The original's frame calls: animation, drags, interlacing, and a background that is drawn once."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from engines.dahlquist import area_hierarchy, numpy_frame
from engines.dahlquist.animation import RADII, Animation
from engines.dahlquist.frame import SPHERE, Frame, Pictures, View
from engines.dahlquist.pictures import Picture, checker_probe, formula_background
from engines.errors import ConfigError, UnknownName

ENGINES = ("numba", "numpy")
MAX_PIXELS = 1 << 26
MAX_TEXELS = 1 << 26


class Painter(Protocol):
    """What draws the rows of one call."""

    def draw(self, frame: Frame, view: View) -> None: ...


class Tracer:
    """A window `width` by `height` pixels. `frame` (height, width, 4) uint8 is its bitmap: red, green, blue and a flag, 255
    where a ball is, 254 where the background is. `reflections` may be changed between calls; `environment` too, which has
    the background drawn anew. With `exact` primary rays try every ball, not those alone whose box they are in.

    `probe` and `background` are (h, w, 3) uint8. Raises `ConfigError` for pictures and sizes that cannot be used.
    """

    def __init__(
        self,
        width: int,
        height: int,
        *,
        engine: str = "numba",
        threads: int = 1,
        reflections: bool = True,
        environment: bool = True,
        interlaced: bool = False,
        exact: bool = False,
        probe: Picture | None = None,
        background: Picture | None = None,
    ) -> None:
        if min(width, height) < 1 or width * height > MAX_PIXELS:
            raise ConfigError(f"size {width}x{height}: from 1x1 up to {MAX_PIXELS} pixels is expected")
        pictures = Pictures(
            _checked("probe", checker_probe() if probe is None else probe),
            _checked("background", formula_background() if background is None else background),
        )
        self.frame: Frame = np.zeros((height, width, 4), np.uint8)
        self.animation = Animation()
        self.reflections = reflections
        self.interlaced = interlaced
        self.exact = exact
        self._environment = environment
        self._painter = _painter(engine, width, height, pictures, threads)
        self._calls = 0
        self._clear = True
        self._boxes: np.ndarray | None = None
        self._held: dict[int, tuple[int, float, float]] = {}

    @property
    def environment(self) -> bool:
        """Whether there are a probe and a background."""
        return self._environment

    @environment.setter
    def environment(self, on: bool) -> None:
        self._environment = on
        self._clear = True

    def redraw_background(self) -> None:
        """Has the next call draw the background again."""
        self._clear = True

    def call(self, time_elapsed: int) -> Frame:
        """One frame call: balls that are held go to their fingers, time goes on, the frame is drawn. Returns `frame`, which
        the next call draws over."""
        for ball, x, y in self._held.values():
            self.animation.drag(ball, x, y, self.frame.shape[1])
        self._calls += 1
        self.animation.step(time_elapsed)
        if self._clear:
            self.frame.view("<u4")[:] = SPHERE << 24  # black; one number a pixel is ten times as fast as four
            self._clear = False
        centres = self.animation.centres
        self._boxes = np.tile(area_hierarchy.EVERYWHERE, (len(RADII), 1)) if self.exact else area_hierarchy.boxes(centres)
        row_step = 2 if self.interlaced else 1
        view = View(centres, self._boxes, self._environment, self.reflections, -self._calls % row_step, row_step)
        self._painter.draw(self.frame, view)
        return self.frame

    # ---- touch -------------------------------------------------------------------------------------------------------

    def touch(self, x: float, y: float, finger: int = 0) -> int:
        """Puts a finger on pixel (x, y) and holds the ball there; returns its index, or -1 where there is none (as there is
        before the first call)."""
        if self._boxes is None:
            return numpy_frame.MISS
        ball = numpy_frame.pick(x, y, self.frame.shape[1], self.animation.centres, self._boxes)
        if ball != numpy_frame.MISS:
            self._held[finger] = ball, x, y
        return ball

    def move(self, x: float, y: float, finger: int = 0) -> None:
        """Moves a finger; the ball that it holds follows in each call, and is pulled back a little towards its target."""
        if finger in self._held:
            self._held[finger] = self._held[finger][0], x, y

    def release(self, finger: int = 0) -> None:
        """Takes a finger away; its ball glides back."""
        self._held.pop(finger, None)


def _painter(engine: str, width: int, height: int, pictures: Pictures, threads: int) -> Painter:
    if engine == "numpy":
        return numpy_frame.Painter(width, height, pictures, threads)
    if engine != "numba":
        raise UnknownName("engine", engine, ENGINES)
    from engines.dahlquist import numba_frame

    return numba_frame.Painter(width, height, pictures, threads)


def _checked(name: str, picture: Picture) -> Picture:
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8 or not 0 < picture.size <= 3 * MAX_TEXELS:
        raise ConfigError(
            f"{name}: {picture.dtype} of shape {picture.shape}: "
            f"(height, width, 3) uint8 of up to {MAX_TEXELS} texels is expected"
        )
    return picture
