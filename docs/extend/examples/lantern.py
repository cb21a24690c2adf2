"""lantern.py: a renderer with a Python API, for the adapter of docs/extend/engine.md."""

import numpy as np


def render(corners, colors, eye, right, up, forward, window, width, height, samples, seed):
    random, total = np.random.default_rng(seed), 0.0
    low_x, high_x, low_y, high_y = window
    for _ in range(samples):
        y, x = random.random((2, height, width)) + np.mgrid[:height, :width]
        x, y = low_x + x / width * (high_x - low_x), high_y - y / height * (high_y - low_y)
        towards = forward + x[..., None] * right + y[..., None] * up
        nearest, image = np.full((height, width), np.inf), np.zeros((height, width, 3))
        for (a, b, c), color in zip(corners, colors, strict=True):
            p, q = np.cross(towards, c - a), np.cross(eye - a, b - a)
            with np.errstate(all="ignore"):
                u, v, t = np.stack([p @ (eye - a), towards @ q, np.full(x.shape, q @ (c - a))]) / (p @ (b - a))
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < nearest)
            nearest[hit], image[hit] = t[hit], color
        total = total + image
    return total / samples
