"""Cameras: the stage that begins a sample with its ray."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels import block as at
from engines.kernels.jit import LANES, compile_stage, fetch, get, inline, pointer, put, put_int, select, table
from engines.kernels.vector import Vec3, unit
from engines.kernels.world import CAMERA
from engines.scene.model import CustomCamera, Orthographic, Perspective, PerspectiveArctan

KINDS: dict[type, int] = {Perspective: 0, Orthographic: 1, PerspectiveArctan: 2}
PERSPECTIVE, ORTHOGRAPHIC, ARCTAN = KINDS.values()
CAMERA_REALS = 20
"""eye 3, forward 3, right 3 (scaled by the half width), up 3 (by the half height), width, height, and for the arctan map
the angles of the half width and of the half height; right and up are then unit vectors."""


def parameters(camera: Any, width: int, height: int, center: NDArray[np.float64]) -> NDArray[np.float64]:
    """The numbers (20,) that the camera's stage reads."""
    row = np.zeros(CAMERA_REALS)
    row[12:14] = width, height
    if isinstance(camera, CustomCamera):
        row[:3] = -center
        return row
    forward = _unit(np.subtract(camera.target, camera.eye))
    right = _unit(np.cross(forward, camera.up))
    aspect = width / height
    if isinstance(camera, Orthographic):
        half = (aspect * camera.height / 2, camera.height / 2)
    else:
        angle = math.radians(camera.fov) / 2
        size = math.tan(angle) if isinstance(camera, Perspective) else angle
        half = (aspect * size, size) if camera.fov_axis == "y" else (size, size / aspect)
    if isinstance(camera, PerspectiveArctan):
        row[14:16], half = half, (1.0, 1.0)
    row[:12] = np.concatenate(
        [np.subtract(camera.eye, center), forward, half[0] * right, half[1] * np.cross(right, forward)]
    )
    return row


def _unit(v: NDArray[np.float64]) -> NDArray[np.float64]:
    return v / np.linalg.norm(v)


@inline
def _arctan(x):
    """The polynomial of `PerspectiveArctan`."""
    size = abs(x)
    near = select(size > 1.0, 1.0 / size, size)
    value = near * (math.pi / 4 + (1.0 - near) * (0.2447 + 0.0663 * near))
    value = select(size > 1.0, math.pi / 2 - value, value)
    return select(x < 0.0, -value, value)


@inline
def _put_path(lanes, lane, origin, direction, real):
    """A fresh path along the camera's ray."""
    zero, one = real(0), real(1)
    at.put3(lanes, at.ORIGIN, lane, Vec3(real(origin.x), real(origin.y), real(origin.z)))
    at.put3(lanes, at.DIRECTION, lane, Vec3(real(direction.x), real(direction.y), real(direction.z)))
    at.put3(lanes, at.THROUGHPUT, lane, Vec3(one, one, one))
    at.put3(lanes, at.RADIANCE, lane, Vec3(zero, zero, zero))
    put(lanes, at.T, lane, real(math.inf))
    put(lanes, at.PDF, lane, real(math.inf))
    put(lanes, at.COS_PDF, lane, zero)
    put_int(lanes, at.ALIVE, lane, 1)
    put_int(lanes, at.LEFT, lane, -1)
    put_int(lanes, at.HELD, lane, -1)
    put_int(lanes, at.DEPTH, lane, 1)
    put_int(lanes, at.LIGHT, lane, 0)
    put_int(lanes, at.STACK, lane, 0)
    put_int(lanes, at.DIMENSION, lane, 2)


def _make(kind: int, real: Any) -> Any:
    def begin(block, world):
        lanes = pointer(block, real)
        camera = table(world, CAMERA, np.float64)
        eye = Vec3(fetch(camera, 0), fetch(camera, 1), fetch(camera, 2))
        forward = Vec3(fetch(camera, 3), fetch(camera, 4), fetch(camera, 5))
        right = Vec3(fetch(camera, 6), fetch(camera, 7), fetch(camera, 8))
        up = Vec3(fetch(camera, 9), fetch(camera, 10), fetch(camera, 11))
        width, height = fetch(camera, 12), fetch(camera, 13)
        for lane in range(np.uint64(LANES)):
            x = np.float64(get(lanes, at.COLUMN, lane)) + np.float64(get(lanes, at.DRAW, lane))
            y = np.float64(get(lanes, at.ROW, lane)) + np.float64(get(lanes, at.DRAW + 1, lane))
            across, upwards = 2.0 * x / width - 1.0, 1.0 - 2.0 * y / height
            if kind == ARCTAN:
                across, upwards = _arctan(across * fetch(camera, 14)), _arctan(upwards * fetch(camera, 15))
            shift = right * across + up * upwards
            origin, ray = (eye + shift, forward) if kind == ORTHOGRAPHIC else (eye, unit(forward + shift))
            _put_path(lanes, lane, origin, ray, real)

    return begin


@cache
def stage(camera_type: type, real: Any) -> Any:
    """The stage of a built-in camera."""
    return compile_stage(_make(KINDS[camera_type], real))


def _make_plugin(function: Any, options: tuple[float, ...], real: Any) -> Any:
    def begin(block, world):
        lanes = pointer(block, real)
        camera = table(world, CAMERA, np.float64)
        width, height = fetch(camera, 12), fetch(camera, 13)
        for lane in range(np.uint64(LANES)):
            x = np.float64(get(lanes, at.COLUMN, lane)) + np.float64(get(lanes, at.DRAW, lane))
            y = np.float64(get(lanes, at.ROW, lane)) + np.float64(get(lanes, at.DRAW + 1, lane))
            o = function(x, y, width, height, options)
            origin = Vec3(o[0] + fetch(camera, 0), o[1] + fetch(camera, 1), o[2] + fetch(camera, 2))
            _put_path(lanes, lane, origin, unit(Vec3(o[3], o[4], o[5])), real)

    return begin


@cache
def plugin_stage(function: Any, options: tuple[float, ...], real: Any) -> Any:
    """The stage of a camera plugin: an `@njit` function (x, y, width, height, options) -> (ox, oy, oz, dx, dy, dz)."""
    return compile_stage(_make_plugin(function, options, real), on_disk=False)
