"""Jitted code that the numba and embree engines share: lanes in blocks of sixteen, driven through compiled stages."""
