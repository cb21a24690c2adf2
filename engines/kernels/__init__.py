"""Jitted code that the numba and embree engines share: ray batches of sixteen lanes, driven through compiled stages."""
