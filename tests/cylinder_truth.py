"""Where rays meet a cylinder, in 60 decimal digits."""

from decimal import Decimal, getcontext

import numpy as np

from engines.scene import Cylinder

TILTED = Cylinder((0.3, -0.2, 0.5), (1.1, 1.4, -0.9), 0.4, 0)


def truth(cylinder, origins, directions):
    """(n,) t of the nearest hit, by the quadratic equation in 60 decimal digits."""
    getcontext().prec = 60

    def dot(a, b):
        return sum(x * y for x, y in zip(a, b, strict=True))

    p0, p1 = ([Decimal(x) for x in end] for end in (cylinder.p0, cylinder.p1))
    axis = [b - a for a, b in zip(p0, p1, strict=True)]
    square, found = dot(axis, axis), []
    for origin, direction in zip(origins, directions, strict=True):
        o = [Decimal(float(x)) - e for x, e in zip(origin, p0, strict=True)]
        d = [Decimal(float(x)) for x in direction]
        h, k = dot(o, axis) / square, dot(d, axis) / square
        f, g = ([x - s * e for x, e in zip(v, axis, strict=True)] for v, s in ((o, h), (d, k)))
        a, b, c = dot(g, g), dot(f, g), dot(f, f) - Decimal(cylinder.radius) ** 2
        roots = []
        if a > 0 and b * b - a * c >= 0:
            root = (b * b - a * c).sqrt()
            roots = [t for t in ((-b - root) / a, (-b + root) / a) if t > 0 and 0 <= h + k * t <= 1]
        found.append(float(min(roots)) if roots else np.inf)
    return np.array(found)
