"""Rays and shapes: distances, and what is there. One module a shape."""
