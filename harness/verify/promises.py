"""What an engine promises, by the precision in which it traces: one table, read by the battery, tests and docs.

The unit of a promise says what the number bounds:

- `relative`: |found - exact| / |exact|, the worst of all;  `eps`: |found - exact| in machine epsilons of the tracing
  precision, coordinates being about 1;  `eps/cos`: the same times the cosine at the hit
- `wrong`: how many rays, pixels or samples are wrong (the sum);  `share`: the share of them that are
- `absolute`: |found - exact| of a radiance;  `z`: |mean - truth| in standard errors;  `p`: the smallest p value, which
  must lie *above* what is allowed

`None` where a precision cannot keep a case: it is measured and shown, and its verdict is "not promised". A mapping
gives each parameter its own number.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

Limit = float | None | Mapping[str, float | None]

TRACING = {"embree": "float32"}
"""Engines that trace in another precision than they shade in. A third party's says so by `tracing_precision`."""


def tracing_precision(engine: Any, precision: str) -> str:
    """The precision in which rays meet shapes: it sets the tolerances."""
    return getattr(engine, "tracing_precision", None) or TRACING.get(engine.name, precision)


OWN: dict[tuple[str, str], dict[str, float]] = {
    ("embree", "float64"): {"T15": 0, "T18": 0},
    ("numba", "float32"): {"T3": 0, "T11": 0, "T13": 0},
}
"""What an engine promises in a precision beyond what all that trace in it do: (engine, precision) -> case -> limit.

In float64 embree scales scenes to about 1 before Embree sees them, and confirms every hit in float64. Ties are broken by
numba's own trees in either precision."""


class Promise(NamedTuple):
    """Limits for engines that trace in float64 and in float32, and why they differ where they do."""

    unit: str
    float64: Limit
    float32: Limit
    why: str = ""

    def limit(self, tracing: str, parameter: str) -> float | None:
        """The number for a precision and a parameter; None: not promised."""
        limit = self.float64 if tracing == "float64" else self.float32
        return limit.get(parameter) if isinstance(limit, Mapping) else limit


NEVER = Promise("wrong", 0, 0)
ROUNDING, LARGEST_Z = {"float64": 1e-12, "float32": 1e-5}, 4.5
"""What rounding may do to an image without noise, and what a mean may be off in standard errors."""
Z = Promise("z", LARGEST_Z, LARGEST_Z, "over 32 replicates a false alarm has probability 9e-5 a test; seeds are fixed")
EXACT = Promise("absolute", ROUNDING["float64"], ROUNDING["float32"])
TIES = Promise("wrong", 0, None, "embree may answer with either of two hits at exactly one distance")

PROMISES: dict[str, Promise] = {
    # spheres
    "S1": Promise("relative", 4e-15, 1e-6),
    "S3": Promise("relative", {"R = 1e3": 1e-12, "R = 1e4": 1e-11, "R = 1e5": 1e-10, "R = 1e6": 1e-9}, 1e-6,
                  "spheres are solved in float64 in every engine; float32 formulas are 3 to 7 % wrong at 1e6"),
    "S4": Promise("relative", 1e-13, 1e-6),
    "S5": Promise("eps/cos", 8, 8),
    "S6": NEVER,
    "S7": Promise("relative", 4e-15, 1e-6),
    "S8": Promise("relative", 4e-15, 1e-6),
    "S10": Promise("absolute", 1e-4, 1e-4), "S11": Promise("relative", 4e-15, 1e-6),
    # triangles
    "T1": Promise("eps", 16, 16), "T2": NEVER,
    "T3": Promise("wrong", 0, None, "of rays aimed exactly at a vertex Embree's robust mode lets 5 in 10,000 through"),
    "T4": NEVER, "T5": NEVER, "T6": NEVER,
    "T8": Promise("wrong", 0, {"height 1e-02": 0, "height 1e-08": 0, "height 1e-16": 0, "height 1e-30": None,
                               "height 1e-44": None}, "float32 ends at 1e-38; products of edges end before"),
    "T10": NEVER, "T11": TIES, "T12": NEVER, "T13": TIES, "T14": NEVER,
    "T15": Promise("wrong", 0, {"scale 1e-20": None, "scale 1e-10": 0, "scale 1e+00": 0, "scale 1e+10": 0,
                                "scale 1e+18": None}, "squares and products of coordinates leave float32's range"),
    "T17": Promise("eps", 4, 4),
    "T18": Promise("wrong", 0, None, "a float32 test may claim a skinny triangle that the ray misses"),
    "cam": NEVER,
    # boxes, trees, rays
    "B1": NEVER, "B2": NEVER, "A1": NEVER, "A2": NEVER, "A7": NEVER, "A3": NEVER, "A4": NEVER, "A5": NEVER, "A6": NEVER,
    "R1": NEVER, "R2": Promise("relative", 1e-10, 1e-5), "R3": NEVER, "R4": NEVER,
    "R5": Promise("relative", 2.5, 2.5),
    # spawned rays
    "L1": Promise("wrong", 0, {f"scale {scale}, gap {gap}": 0 if gap in ("1e-01", "1e-02", "1e-03") else None
                               for scale in ("1e-04", "1e+00", "1e+03", "1e+06")
                               for gap in ("1e-01", "1e-02", "1e-03", "1e-04", "1e-05")},
                  "float32 offsets rays by 3e-5 of the largest coordinate"),
    "L2": NEVER,
    "L3": Promise("wrong", 0, None, "offset rays start inside the sphere within sqrt(2 r offset) of the contact"),
    "S9": NEVER, "T7": NEVER,
    # glass
    "D0": EXACT, "D1": Promise("absolute", 1e-9, 1e-3, "the sky is steep there: 1 a texel of 22 degrees"),
    # a reflected ray starts 256 eps deeper, so that k reflections make the impact b into b exp(-256 eps k): 2000 of them
    # make 0.72 into 0.677, and offsets that count the distance too take it below the critical 1 / 1.5; 0.97 stays above
    "D2": Promise("absolute", 0, {f"ior {ior}, impact {b}, {shader}": None if (b, shader) == (0.72, "path_tracer") else 0
                                  for b, ior in ((0.9, 1.5), (0.72, 1.5), (0.6, 2.4), (0.97, 1.1))
                                  for shader in ("path_tracer", "whitted")},
                  "each of 2000 reflections starts 256 eps deeper in the glass, until the ray gets out"),
    "D3": EXACT, "b": Promise("absolute", 1e-11, 1e-4, "hundreds of events"),
    # the ray inside starts d = 256 eps 5 m deeper, which moves cos(i) at its exit by d sin^2(i) / cos(i), and 1 - R, met
    # once, by |dR/dcos(i)| of that: to first order 1.16e-4, 1.07e-4 and 7.4e-5 at impact 0.9; below 1.1e-6 at 0.5
    "D5": Promise("absolute", 1e-12, {f"ior {ior}, impact {b}": 1e-5 + (grazing if b == 0.9 else 0)
                                      for ior, grazing in ((1.5, 1.16e-4), (1.33, 1.07e-4), (2.4, 7.5e-5))
                                      for b in (0.1, 0.5, 0.9)},
                  "rays start 256 eps off the glass; a grazing one then leaves it elsewhere"),
    "D6": EXACT, "D9": EXACT, "k": EXACT, "l": EXACT,
    # light
    "px": NEVER, "a": Promise("absolute", 1e-12, 1e-5),
    "a.mis": Z, "rr": Z, "rr2": Z, "c": EXACT, "c.sky": Z, "d": EXACT, "d.off": Z,
    "e": Z, "f": Z, "g": Z, "h": Z, "i": EXACT,
    "j": Promise("absolute", 1e-9, 1e-4, "rays that graze run 65,000 times the distance of the planes"),
    "m": NEVER, "sum": Z,
    # materials
    "wf": EXACT, "wf.glass": Promise("absolute", 1e-11, 1e-4, "hundreds of events"), "wf.z": Z, "energy": EXACT,
    "recip": EXACT, "recip.glass": EXACT,
    # stability
    "t/distance": Promise("relative", 1e-14,
                          {f"{shape}, distance 1e{power:+03d}": 1e-6 if power < 6 else None
                           for shape in ("sphere", "triangle") for power in range(9)},
                          "a float32 direction misses by 6e-8 of the distance"),
    "t/offset": Promise("relative", 1e-14, 1e-6),
    "t/radius": Promise("relative", {f"sphere, radius 1e{power:+03d}": max(1e-14, 1e-15 * 10.0**power)
                                     for power in range(-4, 7)}, 1e-6, "b2 - 4ac grows with the square of the radius"),
    "self/scale": NEVER,
    "leak/scale": Promise("wrong", 0, {f"gap {gap}, scale 1e{power:+03d}": 0 if gap == "1e-03" else None
                                       for gap in ("1e-03", "1e-05", "1e-07") for power in range(-6, 7, 2)},
                          "float32 offsets rays by 3e-5 of the largest coordinate"),
    # sampling
    "q.mean": Z, "q.slope": Promise("absolute", 0.15, 0.15), "q.edge": Promise("absolute", 0.15, 0.15),
}  # fmt: skip
