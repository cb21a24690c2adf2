"""Accelerators of the numba engine: each builds its arrays into the world and makes the two stages that walk them."""
