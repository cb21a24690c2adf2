"""Embree's C library, found inside the installed embreex package, and the few calls that build a scene."""

from __future__ import annotations

import ctypes
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import Unsupported
from engines.packages import install

# rtcore_common.h, rtcore_buffer.h, rtcore_geometry.h, rtcore_scene.h of Embree 4
_INDEX_BUFFER, _VERTEX_BUFFER = 0, 1
_UINT3, _FLOAT3 = 0x5003, 0x9003
_TRIANGLES, _USER, _INSTANCE = 0, 120, 121
_ROWS = 0x9134  # of a matrix, 3 x 4 float32
_ROBUST, _FILTER_IN_ARGUMENTS = 1 << 2, 1 << 3
QUALITIES = {"low": 0, "medium": 1, "high": 2}
_VERSION_MAJOR, _VERSION_MINOR = 1, 2
VERSION = (4, 4)
"""The version whose structures `packet` and `callbacks` lay out by hand (RTCHit has grown between minor versions)."""

_PROTOTYPES: dict[str, tuple[Any, list[Any]]] = {
    "rtcNewDevice": (ctypes.c_void_p, [ctypes.c_char_p]),
    "rtcReleaseDevice": (None, [ctypes.c_void_p]),
    "rtcGetDeviceError": (ctypes.c_int, [ctypes.c_void_p]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [ctypes.c_void_p, ctypes.c_int]),
    "rtcSetDeviceMemoryMonitorFunction": (None, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]),
    "rtcNewScene": (ctypes.c_void_p, [ctypes.c_void_p]),
    "rtcReleaseScene": (None, [ctypes.c_void_p]),
    "rtcSetSceneFlags": (None, [ctypes.c_void_p, ctypes.c_int]),
    "rtcSetSceneBuildQuality": (None, [ctypes.c_void_p, ctypes.c_int]),
    "rtcJoinCommitScene": (None, [ctypes.c_void_p]),
    "rtcNewGeometry": (ctypes.c_void_p, [ctypes.c_void_p, ctypes.c_int]),
    "rtcReleaseGeometry": (None, [ctypes.c_void_p]),
    "rtcCommitGeometry": (None, [ctypes.c_void_p]),
    "rtcAttachGeometryByID": (None, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint]),
    "rtcSetNewGeometryBuffer": (
        ctypes.c_void_p,
        [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint, ctypes.c_int, ctypes.c_size_t, ctypes.c_size_t],
    ),
    "rtcSetGeometryUserPrimitiveCount": (None, [ctypes.c_void_p, ctypes.c_uint]),
    "rtcSetGeometryUserData": (None, [ctypes.c_void_p, ctypes.c_void_p]),
    "rtcSetGeometryInstancedScene": (None, [ctypes.c_void_p, ctypes.c_void_p]),
    "rtcSetGeometryTransform": (None, [ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p]),
    "rtcSetGeometryBoundsFunction": (None, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]),
    "rtcSetGeometryIntersectFunction": (None, [ctypes.c_void_p, ctypes.c_void_p]),
    "rtcSetGeometryOccludedFunction": (None, [ctypes.c_void_p, ctypes.c_void_p]),
}
_MEMORY_MONITOR = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_bool)


@cache
def library() -> ctypes.CDLL:
    """Embree itself. Raises `Unsupported` where the embreex package is missing or keeps its library elsewhere."""
    try:
        files = metadata.files("embreex") or []
    except metadata.PackageNotFoundError as error:
        raise Unsupported(f"the engine embree needs the package embreex: {install('embreex>=4.4')}") from error
    found = sorted(str(file.locate()) for file in files if file.name.startswith("libembree4") and ".so" in file.name)
    found += sorted(str(file.locate()) for file in files if file.name.startswith(("embree4", "libembree4.")))
    for path in found:
        if Path(path).exists():
            return _opened(path)
    version = metadata.version("embreex")
    raise Unsupported(
        f"the installed embreex {version} holds no libembree4: raybench calls Embree 4 directly; embreex 4.4 ships it"
    )


def _opened(path: str) -> ctypes.CDLL:
    import embreex.rtcore  # noqa: F401  (loads what the library depends on)

    try:
        opened = ctypes.CDLL(path)
        for name, (result, arguments) in _PROTOTYPES.items():
            function = getattr(opened, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise Unsupported(f"{Path(path).name} of the installed embreex cannot be used: {error}") from error
    found = _version(opened)
    if found != VERSION:
        raise Unsupported(
            "{} of the installed embreex is Embree {}.{}: raybench relies on the memory layout of {}.{}".format(
                Path(path).name, *found, *VERSION
            )
        )
    return opened


def _version(embree: ctypes.CDLL) -> tuple[int, int]:
    """Major and minor version, as the device reports it."""
    device = embree.rtcNewDevice(b"threads=1,user_threads=1,set_affinity=0")
    found = tuple(embree.rtcGetDeviceProperty(device, part) for part in (_VERSION_MAJOR, _VERSION_MINOR))
    embree.rtcReleaseDevice(device)
    return found


def address(name: str) -> int:
    """The address of one of Embree's functions."""
    return ctypes.cast(getattr(library(), name), ctypes.c_void_p).value or 0


class Device:
    """A device and its scenes: trees over geometries."""

    def __init__(self, threads: int) -> None:
        self._embree, self._threads = library(), threads
        # User threads fill the device: oneTBB's own workers would go on spinning after a build, beside the rendering.
        settings = f"threads={threads},user_threads={threads},set_affinity=0"
        self._device = self._embree.rtcNewDevice(settings.encode())
        if not self._device:
            raise Unsupported(f"Embree cannot make a device (error {self._embree.rtcGetDeviceError(None)})")
        self._scenes: list[int] = []
        used = self._used = Counter()

        def count(_: Any, amount: int, __: bool) -> bool:  # not a method: Embree's memory would wait for the cyclic collector
            used["bytes"] += amount
            return True

        self._monitor = _MEMORY_MONITOR(count)
        self._embree.rtcSetDeviceMemoryMonitorFunction(self._device, self._monitor, None)

    @property
    def bytes(self) -> int:
        """Memory that Embree holds for this device."""
        return self._used["bytes"]

    def triangles(self, vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> int:
        """A geometry of Embree's own: copies (n, 3) vertices and (m, 3) faces."""
        geometry = self._embree.rtcNewGeometry(self._device, _TRIANGLES)
        for buffer, form, array in (
            (_VERTEX_BUFFER, _FLOAT3, np.ascontiguousarray(vertices, np.float32)),
            (_INDEX_BUFFER, _UINT3, np.ascontiguousarray(faces, np.uint32)),
        ):
            memory = self._embree.rtcSetNewGeometryBuffer(geometry, buffer, 0, form, 12, len(array))
            ctypes.memmove(memory, array.ctypes.data, array.nbytes)
        return geometry

    def by_callback(self, count: int, bounds: int, intersect: int, occluded: int) -> int:
        """A geometry of `count` primitives, given the addresses of the three callbacks."""
        geometry = self._embree.rtcNewGeometry(self._device, _USER)
        self._embree.rtcSetGeometryUserPrimitiveCount(geometry, count)
        self._embree.rtcSetGeometryBoundsFunction(geometry, bounds, None)
        self._embree.rtcSetGeometryIntersectFunction(geometry, intersect)
        self._embree.rtcSetGeometryOccludedFunction(geometry, occluded)
        return geometry

    def instance(self, scene: int, matrix: NDArray[np.float32]) -> int:
        """A geometry that shows a scene of this device, placed by `matrix` (3, 4)."""
        geometry = self._embree.rtcNewGeometry(self._device, _INSTANCE)
        self._embree.rtcSetGeometryInstancedScene(geometry, scene)
        self._embree.rtcSetGeometryTransform(geometry, 0, _ROWS, np.ascontiguousarray(matrix, np.float32).ctypes.data)
        return geometry

    def scene(self, geometries: Mapping[int, int], user_data: int, quality: str, robust: bool, in_threads: bool = True) -> int:
        """Builds a tree over geometries (number -> geometry), which are given up to it, in this thread or in all of the device;
        returns the scene's handle. Raises `Unsupported` when Embree reports an error."""
        scene = self._embree.rtcNewScene(self._device)
        self._scenes.append(scene)
        self._embree.rtcSetSceneFlags(scene, _FILTER_IN_ARGUMENTS | (_ROBUST if robust else 0))
        self._embree.rtcSetSceneBuildQuality(scene, QUALITIES[quality])
        for number, geometry in geometries.items():
            self._embree.rtcSetGeometryUserData(geometry, user_data)
            self._embree.rtcCommitGeometry(geometry)
            self._embree.rtcAttachGeometryByID(scene, geometry, number)
            self._embree.rtcReleaseGeometry(geometry)
        if in_threads and self._threads > 1:
            with ThreadPoolExecutor(self._threads) as pool:
                list(pool.map(self._embree.rtcJoinCommitScene, [scene] * self._threads))
        else:
            self._embree.rtcJoinCommitScene(scene)
        error = self._embree.rtcGetDeviceError(self._device)
        if error:
            raise Unsupported(f"Embree cannot build this scene (error {error})")
        return scene

    def __del__(self) -> None:
        for scene in getattr(self, "_scenes", []):
            self._embree.rtcReleaseScene(scene)
        if getattr(self, "_device", None):
            release: Callable[[int], None] = self._embree.rtcReleaseDevice
            self._embree.rtcSetDeviceMemoryMonitorFunction(self._device, None, None)
            release(self._device)
