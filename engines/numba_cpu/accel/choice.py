"""What `accelerator: auto` of numba takes: the list or the tree, whichever the counts of the scene predict to be faster.

The costs are nanoseconds per ray beyond those of an empty scene. The constants were fitted by `python -m
tests.benchmarks.list_or_tree`, which prints them anew, on an AMD EPYC with AVX-512 (Zen 5). Only their ratios matter to the
choice. Planes cost the same in both, and are left out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from engines.scene import Mesh, Plane, Scene, Sphere, SphereSet, Triangle, counted


class Counts(NamedTuple):
    """Bounded primitives by kind; `analytic` are those with a formula besides spheres (disks, cylinders)."""

    triangles: int
    spheres: int
    analytic: int


class Costs(NamedTuple):
    """Nanoseconds per ray. In the list: of each primitive. In the tree: at all; for each doubling of the number of
    primitives; and for each doubling in addition where all are spheres, where all are analytic shapes (else in proportion
    to their share), and where there are several kinds."""

    triangle: float
    sphere: float
    analytic: float
    tree: float
    doubling: float
    of_spheres: float
    of_analytic: float
    of_several: float


COSTS = {
    "float32": Costs(0.63, 1.76, 1.10, 12.9, 11.1, 7.99, 18.66, 4.37),
    "float64": Costs(1.13, 1.63, 0.76, 14.6, 12.94, 3.99, 3.36, 12.3),
}


def counts_of(scene: Scene) -> Counts:
    """How many primitives of each kind the scene shows."""
    triangles = spheres = analytic = 0
    for shape, times in counted(scene.shapes):
        if isinstance(shape, (Mesh, Triangle)):
            triangles += times * (len(shape.faces) if isinstance(shape, Mesh) else 1)
        elif isinstance(shape, (Sphere, SphereSet)):
            spheres += times * (len(shape.radii) if isinstance(shape, SphereSet) else 1)
        elif not isinstance(shape, Plane):
            analytic += times
    return Counts(triangles, spheres, analytic)


def predicted(counts: Counts, costs: Costs) -> tuple[float, float]:
    """What a ray costs with the list and with the tree, nanoseconds."""
    n = sum(counts)
    of_list = counts.triangles * costs.triangle + counts.spheres * costs.sphere + counts.analytic * costs.analytic
    if n == 0:
        return of_list, costs.tree
    doubling = costs.doubling + (counts.spheres * costs.of_spheres + counts.analytic * costs.of_analytic) / n
    doubling += costs.of_several if sum(count > 0 for count in counts) > 1 else 0.0
    return of_list, costs.tree + doubling * math.log2(n)


def choose(scene: Scene, precision: str) -> tuple[str, str]:
    """The name of the faster accelerator by prediction, `none` or `bvh`, and in a few words why."""
    counts = counts_of(scene)
    of_list, of_tree = predicted(counts, COSTS[precision])
    kinds = "triangles", "spheres", "disks and cylinders"
    named = [f"{n:,} {kind}" for n, kind in zip(counts, kinds, strict=True) if n]
    why = f"{', '.join(named) or 'no bounded shapes'}; predicted ns per ray: none {of_list:,.0f}, bvh {of_tree:,.0f}"
    return "none" if of_list <= of_tree else "bvh", why
