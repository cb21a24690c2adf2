"""Cameras: the stage that begins a sample with its ray."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.values import const
from engines.kernels.integrators.interface import Path
from engines.kernels.lane import camera as lane_camera
from engines.kernels.lane.vector import Vec3, dot, to_real, unit
from engines.kernels.layout import CAMERA_DIMENSIONS, LANES, ray_batch, scene_table
from engines.kernels.rows import CameraRow
from engines.scene import CustomCamera, Orthographic, Perspective, PerspectiveArctan, ThinLens
from engines.scene.support import option_numbers

RAYS: dict[type, Any] = {
    Perspective: lane_camera.perspective,
    Orthographic: lane_camera.orthographic,
    PerspectiveArctan: lane_camera.perspective_arctan,
    ThinLens: lane_camera.thin_lens,
}


def clips(camera: Any) -> bool:
    """Whether a camera's rays start beyond it, or end."""
    return not isinstance(camera, (CustomCamera, PerspectiveArctan)) and camera.clip != (0.0, math.inf)


def has_eye(camera: Any) -> bool:
    """Whether all rays of a camera start at one point, `CameraRow.eye`."""
    return isinstance(camera, PerspectiveArctan) or (isinstance(camera, Perspective) and camera.clip[0] == 0.0)


def parameters(camera: Any, width: int, height: int, center: NDArray[np.float64]) -> NDArray[np.float64]:
    """The row (1, n) of `SceneTable.camera`. A plugin's rays start where it says, moved by `eye`."""
    size = {"width": width, "height": height}
    if isinstance(camera, CustomCamera):
        return np.array([CameraRow.packed(eye=-center, **size)])
    forward = _unit(np.subtract(camera.target, camera.eye))
    right = _unit(np.cross(forward, camera.up))
    up = np.cross(right, forward)
    aspect, angles = width / height, (0.0, 0.0)
    if isinstance(camera, Orthographic):
        across, high = camera.window(aspect)
        half = (across / 2, high / 2)
    else:
        angle = math.radians(camera.fov) / 2
        extent = angle if isinstance(camera, PerspectiveArctan) else math.tan(angle)
        half = (aspect * extent, extent) if camera.fov_axis == "y" else (extent, extent / aspect)
    if isinstance(camera, PerspectiveArctan):
        angles, half = half, (1.0, 1.0)
        view: dict[str, Any] = {"middle_x": 1.0, "middle_y": 1.0}
    else:
        view = {
            "middle_x": 1.0 + 2.0 * camera.principal_point[0],
            "middle_y": 1.0 + 2.0 * camera.principal_point[1],
            "near": camera.clip[0],
            "far": camera.clip[1],
        }
        right = -right if camera.mirror else right
    if isinstance(camera, ThinLens):
        aperture = {"lens_right": camera.aperture_radius * right, "lens_up": camera.aperture_radius * up}
        view |= {**aperture, "focus_distance": camera.focus_distance}
    row = CameraRow.packed(
        eye=np.subtract(camera.eye, center),
        forward=forward,
        right=half[0] * right,
        up=half[1] * up,
        half_angle_x=angles[0],
        half_angle_y=angles[1],
        **size,
        **view,
    )
    return np.array([row])


def _unit(v: NDArray[np.float64]) -> NDArray[np.float64]:
    return v / np.linalg.norm(v)


@cache
def _on_image(ray: Any) -> Any:
    """The function (camera, x, y, draw, lane) -> (origin, direction) of pixels, from the top left, of a built-in camera."""

    @inline
    def of_pixel(camera, x, y, draw, lane):
        return ray(camera, 2.0 * x / camera.width - camera.middle_x, camera.middle_y - 2.0 * y / camera.height)

    @inline
    def through_lens(camera, x, y, draw, lane):
        across, up = 2.0 * x / camera.width - camera.middle_x, camera.middle_y - 2.0 * y / camera.height
        return ray(camera, across, up, np.float64(draw[2, lane]), np.float64(draw[3, lane]))

    return through_lens if ray is lane_camera.thin_lens else of_pixel


@cache
def _of_plugin(function: Any, options: tuple[float, ...]) -> Any:
    """The same of a plugin's function (x, y, width, height, options) -> (ox, oy, oz, dx, dy, dz)."""

    @inline
    def of_pixel(camera, x, y, draw, lane):
        o = function(x, y, camera.width, camera.height, options)
        eye = camera.eye  # in float64, as what the function gives is from here on
        direction = Vec3(const(o[3], eye.x), const(o[4], eye.x), const(o[5], eye.x))
        return Vec3(o[0] + eye.x, o[1] + eye.y, o[2] + eye.z), direction

    return of_pixel


def _make(ray: Any, normalised: bool, clipped: bool, real: Any) -> Any:
    zero, one, infinite = real(0), real(1), real(math.inf)

    def begin(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        camera = scene.camera[0]
        for lane in range(np.uint64(LANES)):
            x = np.float64(rays.pixel_x[lane]) + np.float64(rays.draw[0, lane])
            y = np.float64(rays.pixel_y[lane]) + np.float64(rays.draw[1, lane])
            origin, direction = ray(camera, x, y, rays.draw, lane)
            if normalised:
                direction = unit(direction)
            end = infinite
            if clipped:
                slope = 1.0 / dot(direction, camera.forward)
                origin = origin + direction * (camera.near * slope)
                end = real((camera.far - camera.near) * slope)
            rays.origin[lane] = to_real(origin, real)
            rays.direction[lane] = to_real(direction, real)
            rays.path[lane] = Path(Vec3(one, one, one), 1, infinite, one)
            rays.radiance[lane] = Vec3(zero, zero, zero)
            rays.t[lane] = end
            rays.cosine_pdf[lane] = zero
            rays.alive[lane] = True
            rays.origin_primitive[lane] = -1
            rays.waiting[lane] = 0
            rays.dimension[lane] = CAMERA_DIMENSIONS

    return begin


def stage(camera: Any, real: Any) -> Any:
    """The stage of a camera of the scene's model."""
    if isinstance(camera, CustomCamera):
        options = tuple(option_numbers(camera.options))
        return _stage(_of_plugin(camera.plugin.jitted, options), True, False, real)
    # an orthographic camera's direction is unit as it is, and must not be rounded once more
    return _stage(_on_image(RAYS[type(camera)]), not isinstance(camera, Orthographic), clips(camera), real)


@cache
def _stage(ray: Any, normalised: bool, clipped: bool, real: Any) -> Any:
    return compile_stage(_make(ray, normalised, clipped, real))
