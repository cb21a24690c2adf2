"""Surfaces that a curve sweeps: of revolution (lathe), along a curve (tube), and sideways (sheet)."""

from __future__ import annotations

import math

import numpy as np

from engines.scene.geometry import unit_rows
from engines.scene.procedural.generator import BYTES_PER_FACE, Faces, generator, grid_faces
from engines.scene.procedural.pieces import (
    PLACED,
    Array,
    Patch,
    curve,
    joined,
    lengths,
    placed,
    points_of,
    seamless_normals,
    tangents_of,
)
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import BOOLEAN, NUMBER, POINT, POSITIVE, Kind, integer
from engines.schema.yaml_file import Located


def lathe(profile: Array, segments: int, spans: int, center: Triple, tilt: float, rotate_y: float) -> Faces:
    """A surface of revolution about its y axis: a smooth curve through points (radius, height), turned around.

    A point that is written twice in succession is an edge; between two edges alone the curve is straight. The outside is the
    front where the curve goes upwards. Texture coordinate u goes around, v down along the curve.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    cos[-1], sin[-1] = cos[0], sin[0]
    runs = [curve(run, spans if len(run) > 2 else 1) for run in _runs(profile)]
    whole, start, patches = sum(lengths(run)[-1] for run in runs), 0.0, []
    for run in runs:
        radius, height = np.maximum(run[:, 0], 0.0)[None], run[:, 1][None]
        points = np.stack([radius * cos, np.broadcast_to(height, (segments + 1, len(run))), -radius * sin], axis=2)
        along = tangents_of(run)
        out, up = along[:, 1][None], -along[:, 0][None]
        normals = np.stack([out * cos, np.broadcast_to(up, points.shape[:2]), -out * sin], axis=2)
        v = 1.0 - (start + lengths(run)) / whole
        uvs = np.stack(np.broadcast_arrays((angle / (2.0 * np.pi))[:, None], v[None]), axis=2)
        faces = grid_faces(segments, len(run) - 1)
        patches.append(Patch(points.reshape(-1, 3), normals.reshape(-1, 3), uvs.reshape(-1, 2), faces))
        start += lengths(run)[-1]
    return placed(joined(patches, "lathe"), tilt, rotate_y, center)


def _runs(profile: Array) -> list[Array]:
    """The profile cut where a point stands twice."""
    edges = np.flatnonzero((np.diff(profile, axis=0) == 0.0).all(axis=1)) + 1
    return [run for run in np.split(profile, edges) if len(run) > 1]


def _profile(node: Located) -> Array:
    profile = points_of(2, 2).reader(node)
    if (profile[:, 0] < 0.0).any():
        raise node.refuse("radii must not be less than 0")
    if not _runs(profile):
        raise node.refuse("must have two points in succession that differ")
    return profile


def tube(
    points: Array,
    radius: float,
    end_radius: float | None,
    closed: bool,
    spans: int,
    sides: int,
    center: Triple,
    tilt: float,
    rotate_y: float,
) -> Faces:
    """A round tube along a smooth curve through points, with flat ends.

    Its radius goes from `radius` to `end_radius`. Texture coordinate u goes along the tube, v around.
    """
    path = curve(points, spans, closed)
    along = tangents_of(path, closed)
    first = _transported(along)
    if closed:
        first = _untwisted(first, along)
        path, along, first = (np.concatenate([each, each[:1]]) for each in (path, along, first))
    other = np.cross(first, along)
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    cos, sin = np.cos(angle)[None, :, None], np.sin(angle)[None, :, None]
    cos[:, -1], sin[:, -1] = cos[:, 0], sin[:, 0]
    ring = cos * first[:, None] + sin * other[:, None]
    share = lengths(path) / lengths(path)[-1]
    radii = radius + (0.0 if closed or end_radius is None else end_radius - radius) * share
    around = path[:, None] + radii[:, None, None] * ring
    uvs = np.stack(np.broadcast_arrays(share[:, None], (angle / (2.0 * np.pi))[None]), axis=2).reshape(-1, 2)
    faces = grid_faces(len(path) - 1, sides)
    patches = [Patch(around.reshape(-1, 3), ring.reshape(-1, 3), uvs, faces)]
    for end, sign in () if closed else ((0, -1.0), (-1, 1.0)):
        rim = [np.broadcast_to(path[end], around[end].shape), around[end]]
        disk = np.concatenate(rim[:: int(-sign)])
        normals = np.broadcast_to(sign * along[end], disk.shape)
        patches.append(Patch(disk, normals, np.zeros((len(disk), 2)), grid_faces(1, sides)))
    return placed(joined(patches, "tube"), tilt, rotate_y, center)


def _transported(along: Array) -> Array:
    """(n, 3) unit vectors across the tangents, each the one before turned as little as possible."""
    first = np.empty_like(along)
    across = np.eye(3)[np.abs(along[0]).argmin()]
    for place, tangent in enumerate(along):
        across = across - tangent * (across @ tangent)
        across = across / np.linalg.norm(across)
        first[place] = across
    return first


def _untwisted(first: Array, along: Array) -> Array:
    """Frames of a closed curve, turned evenly so that the last meets the first."""
    last = first[-1] - along[0] * (first[-1] @ along[0])
    angle = math.atan2(np.cross(last, first[0]) @ along[0], last @ first[0])
    turn = angle * np.arange(len(first))[:, None] / len(first)
    return np.cos(turn) * first + np.sin(turn) * np.cross(along, first)


def _apart(node: Located) -> Array:
    points = points_of(3, 2).reader(node)
    if (np.diff(points, axis=0) == 0.0).all(axis=1).any():
        raise node.refuse("two points in succession must differ")
    return points


def sheet(
    points: Array,
    across: Triple,
    folds: float,
    depth: float,
    ripple: float,
    spans: int,
    columns: int,
    seed: int,
    center: Triple,
    tilt: float,
    rotate_y: float,
) -> Faces:
    """Cloth or paper: a smooth curve through points, swept along the vector `across` to both sides.

    It waves `folds` times from side to side, by `depth` to either side, unevenly by `ripple`. Texture coordinate u goes across,
    v along the curve; its front is across x curve, reversed.
    """
    path = curve(points, spans)
    share = (lengths(path) / lengths(path)[-1])[:, None]
    side = np.linspace(0.0, 1.0, columns + 1)[None, :]
    random = np.random.default_rng(seed)
    phase = np.zeros((len(path), columns + 1))
    for harmonic in range(1, 5):
        a, b, c = random.uniform(-1.0, 1.0, 3)
        phase += ripple * (a * np.sin(2 * np.pi * harmonic * side + 6 * b) + c * share * np.cos(5 * harmonic * side)) / harmonic
    wave = depth * np.sin(2 * np.pi * folds * side + phase) * (1.0 + 0.5 * ripple * np.cos(7 * side + 3 * share + phase))
    normals = unit_rows(np.cross(tangents_of(path), np.array(across)))
    flat = path[:, None] + (side - 0.5)[:, :, None] * np.array(across)
    points = (flat + wave[:, :, None] * normals[:, None]).reshape(-1, 3)
    uvs = np.stack(np.broadcast_arrays(side, share), axis=2).reshape(-1, 2)
    faces = grid_faces(len(path) - 1, columns)
    patch = Patch(points, seamless_normals(points, faces), uvs, faces)
    return placed(joined([patch], "sheet"), tilt, rotate_y, center)


_SPANS = Key(integer(1, 1 << 16), "Pieces of the curve between two points.", 8)

GENERATORS = {
    "lathe": generator(
        lathe,
        {
            "profile": Key(
                Kind(_profile, points_of(2, 2).json),
                "Points [radius, height] of the curve; one written twice is an edge.",
                unit="metres",
            ),
            "segments": Key(integer(3, 1 << 16), "Segments around the axis.", 48),
            "spans": _SPANS,
            **PLACED,
        },
        lambda options: 2.0 * BYTES_PER_FACE * len(options["profile"]) * options["spans"] * options["segments"],
    ),
    "tube": generator(
        tube,
        {
            "points": Key(Kind(_apart, points_of(3, 2).json), "Points that the middle of the tube passes.", unit="metres"),
            "radius": Key(POSITIVE, "Radius of the tube.", 0.02, unit="metres"),
            "end_radius": Key(POSITIVE, "Radius at the last point, by default the same.", None, unit="metres"),
            "closed": Key(BOOLEAN, "Whether it goes on from the last point to the first.", False),
            "spans": _SPANS,
            "sides": Key(integer(3, 1 << 16), "Sides around the tube.", 16),
            **PLACED,
        },
        lambda options: 2.0 * BYTES_PER_FACE * len(options["points"]) * options["spans"] * options["sides"],
    ),
    "sheet": generator(
        sheet,
        {
            "points": Key(Kind(_apart, points_of(3, 2).json), "Points of the curve in its middle.", unit="metres"),
            "across": Key(POINT, "Vector from one side to the other.", unit="metres"),
            "folds": Key(NUMBER, "Waves from side to side.", 0.0),
            "depth": Key(NUMBER, "Height of the waves.", 0.0, unit="metres"),
            "ripple": Key(NUMBER, "How uneven the waves are.", 0.0),
            "spans": _SPANS,
            "columns": Key(integer(1, 1 << 16), "Columns from side to side.", 16),
            "seed": Key(integer(0, 2**32 - 1), "Seed of the random numbers.", 0),
            **PLACED,
        },
        lambda options: 3.0 * BYTES_PER_FACE * len(options["points"]) * options["spans"] * options["columns"],
    ),
}
