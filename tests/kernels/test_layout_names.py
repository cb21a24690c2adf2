"""Layouts of one name in two modules are two types."""

import numpy as np

from engines.dahlquist import numba_rays
from engines.kernels import layout
from engines.kernels.compile.jit import kernel

ours, theirs = layout.ray_batch, numba_rays.ray_batch


@kernel
def distances(address):
    return ours(address, np.float32).t[0], theirs(address, np.float32).distance[0]


def test_layouts_of_one_name_stay_apart():
    assert layout.RayBatch.__name__ == numba_rays.RayBatch.__name__
    numbers = np.arange(layout.RayBatch.size * layout.LANES, dtype=np.float32)
    first = layout.RayBatch.fields["t"].first, numba_rays.RayBatch.fields["distance"].first
    assert distances(numbers.ctypes.data) == tuple(layout.LANES * k for k in first)
