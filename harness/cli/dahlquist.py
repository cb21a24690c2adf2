"""`raybench render dahlquist`: a frame, or an animation, of Dahlquist's ray tracer."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines import dahlquist
from engines.errors import ConfigError, UnknownName
from engines.image import write_image
from engines.packages import install_extra
from harness.cli.outputs import check_file, check_folder
from harness.console import consoles
from harness.measure import machine

MOVIES = (".gif", ".mp4")
MAX_CALLS = 10_000_000


class Request(NamedTuple):
    """The command line."""

    size: tuple[int, int]
    calls: int
    time_elapsed: int
    reflections: bool
    environment: bool
    interlaced: bool
    exact: bool
    redraw: bool
    probe: str
    probe_image: Path | None
    background_image: Path | None
    engine: str
    threads: int | None
    animate: int | None
    frames_per_second: float
    output: Path


def draw(request: Request) -> None:
    """Makes the frame calls and writes the last frame, or with `animate` that one and those that follow."""
    _check(request)
    tracer = _tracer(request)
    seconds: list[float] = []

    def call() -> NDArray[np.uint8]:
        if request.redraw:
            tracer.redraw_background()
        start = perf_counter()
        frame = tracer.call(request.time_elapsed)
        seconds.append(perf_counter() - start)
        return frame

    for _ in range(request.calls - 1):
        call()
    if request.animate is None:
        write_image(request.output, call())
    else:
        _write_movie(request.output, (call() for _ in range(request.animate)), request)
    _print_summary(request, tracer.frame, seconds)


def _print_summary(request: Request, frame: NDArray[np.uint8], seconds: list[float]) -> None:
    height, width, _ = frame.shape
    warm = seconds[1:] or seconds  # the first call compiles
    rays = width * height / (2 if request.interlaced else 1)
    speed = f"median {median(warm) * 1e3:.3g} ms a call, {rays / median(warm) / 1e6:.3g} million primary rays/s"
    words = f"{width}x{height}, {len(seconds)} calls: {speed} -> {request.output}"
    consoles()[1].print(words, markup=False, soft_wrap=True)


def _check(request: Request) -> None:
    """Refuses before drawing what could only fail after it."""
    limits = {"--calls": (request.calls, 1, MAX_CALLS), "--time-elapsed": (request.time_elapsed, 0, 2**31 - 1)}
    if request.animate is not None:
        limits["--animate"] = (request.animate, 1, MAX_CALLS)
    if request.threads is not None:
        limits["--threads"] = (request.threads, 1, 1024)
    for name, (value, low, high) in limits.items():
        if not low <= value <= high:
            raise ConfigError(f"{name} {value}: must be in [{low}, {high}]")
    if request.probe not in dahlquist.PROBES:
        raise UnknownName("probe", request.probe, dahlquist.PROBES)
    if not 0.1 <= request.frames_per_second <= 100:
        raise ConfigError(f"--fps {request.frames_per_second:g}: must be in [0.1, 100]")
    if request.animate is None:
        check_file(request.output, (".png",))
    elif not request.output.suffix:
        check_folder(request.output)
    elif check_file(request.output, MOVIES) == ".mp4":
        _encoder(request.output)


def _tracer(request: Request) -> dahlquist.Tracer:
    probe = dahlquist.read_picture(request.probe_image) if request.probe_image else dahlquist.PROBES[request.probe]()
    return dahlquist.Tracer(
        *request.size,
        engine=request.engine,
        threads=request.threads or len(machine.usable_cores()),
        reflections=request.reflections,
        environment=request.environment,
        interlaced=request.interlaced,
        exact=request.exact,
        probe=probe,
        background=dahlquist.read_picture(request.background_image) if request.background_image else None,
    )


# ---- animations ------------------------------------------------------------------------------------------------------


def _write_movie(output: Path, frames: Iterator[NDArray[np.uint8]], request: Request) -> None:
    suffix = output.suffix.lower()
    if suffix == ".gif":
        _write_gif(output, frames, request.frames_per_second)
    elif suffix == ".mp4":
        _write_mp4(output, frames, request.frames_per_second)
    else:
        output.mkdir(exist_ok=True)
        for number, frame in enumerate(frames, request.calls):
            write_image(output / f"frame_{number:05d}.png", frame)


def _write_gif(output: Path, frames: Iterator[NDArray[np.uint8]], frames_per_second: float) -> None:
    from PIL import Image

    first = _page(next(frames)).quantize(256, Image.Quantize.MEDIANCUT)
    pages = (_page(frame).quantize(palette=first) for frame in frames)
    duration = max(20, round(100 / frames_per_second) * 10)  # GIF counts in 10 ms; players slow down below 20
    try:
        first.save(output, save_all=True, append_images=pages, duration=duration, loop=0)
    except OSError as problem:
        raise ConfigError(f"-o {output}: cannot be written: {problem.strerror or problem}") from problem


def _page(frame: NDArray[np.uint8]) -> Any:
    from PIL import Image

    return Image.fromarray(np.ascontiguousarray(frame[:, :, :3]))


def _encoder(output: Path) -> Any:
    try:
        import imageio_ffmpeg  # pyright: ignore[reportMissingImports]  # the extra `video`
    except ImportError:
        raise ConfigError(
            f"-o {output}: no video encoder is installed: {install_extra('video')}, or write a .gif or a folder"
        ) from None
    return imageio_ffmpeg


def _write_mp4(output: Path, frames: Iterator[NDArray[np.uint8]], frames_per_second: float) -> None:
    first = _even(next(frames))
    height, width, _ = first.shape
    options = {"fps": frames_per_second, "quality": 8, "macro_block_size": 2, "ffmpeg_log_level": "error"}
    part = output.with_name(f".{output.name}.part.mp4")
    writer = _encoder(output).write_frames(str(part), (width, height), **options)
    try:
        writer.send(None)
        writer.send(first)
        for frame in frames:
            writer.send(_even(frame))
        writer.close()
        part.replace(output)  # a short movie's failure shows in this alone: the encoder leaves no file
    except OSError as problem:
        raise ConfigError(f"-o {output}: the encoder failed: {str(problem).strip().splitlines()[-1]}") from problem
    finally:
        writer.close()
        part.unlink(missing_ok=True)


def _even(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Red, green and blue with an even number of rows and columns, as encoders want: the last one twice where they are odd."""
    height, width, _ = frame.shape
    return np.pad(frame[:, :, :3], ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
