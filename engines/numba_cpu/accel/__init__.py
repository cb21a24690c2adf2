"""Accelerators of the numba engine: each binds its arrays to the scene and makes the two stages that walk them."""
