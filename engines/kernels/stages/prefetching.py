"""What the surface stage reads of the triangles hit is prefetched in scenes that are larger than a near cache."""

from __future__ import annotations

from typing import Any

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.records import address_of, prefetch
from engines.kernels.compile.values import keep_scalar, select
from engines.kernels.features import SceneFeatures, per_features
from engines.kernels.flatten.shapes import TRIANGLE
from engines.kernels.layout import LANES

NEAR_TRIANGLES = 4096
"""So many triangles are in a near cache; what is read of more is prefetched."""


@per_features
def make_prefetch(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene) that starts loading what the scene holds of the triangles hit. One thing leads to the
    next, and a lane alone would wait for each: here all sixteen wait at once."""
    mixed, smooth, uvs = (features.spheres or features.planes or len(features.analytic) > 0, features.smooth, features.uvs)
    vector = 3 * np.dtype(real).itemsize

    @inline
    def rows(rays, scene):
        for lane in range(np.uint64(LANES)):
            keep_scalar()
            index = max(np.int64(rays.primitive[lane]), 0)
            rays.kept_row[lane] = index
            prefetch(address_of(scene.primitives[index]))
            if not mixed:
                prefetch(address_of(scene.triangles[index]))

    @inline
    def triangles(rays, scene):
        for lane in range(np.uint64(LANES)):
            keep_scalar()
            row = scene.primitives[np.int64(rays.kept_row[lane])]
            index = select(row.shape == TRIANGLE, np.int64(row.index), np.int64(0))
            rays.kept_row[lane] = index
            prefetch(address_of(scene.triangles[index]))

    @inline
    def vertex(scene, index):
        prefetch(address_of(scene.vertices) + vector * np.int64(index))
        if smooth:
            prefetch(address_of(scene.vertex_normals) + vector * np.int64(index))
        if uvs:
            prefetch(address_of(scene.vertex_uvs[index]))

    @inline
    def prefetch_triangles(rays, scene):
        rows(rays, scene)
        if mixed:
            triangles(rays, scene)
        for lane in range(np.uint64(LANES)):
            keep_scalar()
            row = scene.triangles[np.int64(rays.kept_row[lane])]
            vertex(scene, row.a)
            vertex(scene, row.b)
            vertex(scene, row.c)

    return prefetch_triangles
