"""Transforms: the children of a `transform` element as one matrix, and what is asked of matrices."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from engines.scene.frames import LARGEST, Matrix, look_at
from engines.scene.mitsuba_xml.document import Element

UNIT = 1e-5
"""By how much the length of an axis may differ from 1: it is written with few digits."""
RIGID = 1e-4
"""By how much columns may differ in length and from a right angle, relative: matrices are written with few digits."""


def numbers(element: Element, attribute: str, counts: tuple[int, ...]) -> list[float]:
    """The numbers of an attribute, separated by commas or spaces; as many as one of `counts`."""
    text = element.required(attribute)
    words = [word for word in re.split(r"[,\s]+", text) if word] if len(text) < 1000 else []
    try:
        values = [number(word) for word in words]
    except ValueError:
        values = []
    if len(values) not in counts:
        expected = "a finite number" if counts == (1,) else f"{' or '.join(map(str, counts))} finite numbers"
        raise element.refuse(f'{attribute} = "{text[:80]}": must be {expected}')
    return values


LARGEST_NUMBER = 3.4e38
"""About that of float32, in which Mitsuba computes."""


def number(text: str) -> float:
    """A finite number in the limits of float32. Raises `ValueError`."""
    value = float(text)
    if not abs(value) <= LARGEST_NUMBER or "_" in text:
        raise ValueError
    return value


def matrix(element: Element) -> Matrix:
    """The matrix of a `transform` element: its children apply one after the other."""
    product = np.eye(4)
    for child in element.children:
        make = _STEPS.get(child.tag.lower())
        if make is None:
            raise child.refuse(f"unknown transform: known: {', '.join(_STEPS)}")
        with np.errstate(over="ignore", invalid="ignore"):
            product = make(child) @ product
        if not (np.abs(product) < LARGEST).all():
            raise child.refuse("the transform leaves the range of numbers")
    return product


def _xyz(element: Element, default: float) -> NDArray[np.float64]:
    """`value` with one number or three, or `x`, `y` and `z`."""
    if "value" in element.attributes:
        values = numbers(element, "value", (1, 3))
        return np.array(values * 3 if len(values) == 1 else values)
    return np.array([numbers(element, axis, (1,))[0] if axis in element.attributes else default for axis in "xyz"])


def _translate(element: Element) -> Matrix:
    translation = np.eye(4)
    translation[:3, 3] = _xyz(element, 0.0)
    return translation


def _scale(element: Element) -> Matrix:
    return np.diag([*_xyz(element, 1.0), 1.0])


def _rotate(element: Element) -> Matrix:
    axis = _xyz(element, 0.0)
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise element.refuse("the axis of a rotation must not be zero")
    angle = math.radians(numbers(element, "angle", (1,))[0])
    as_given = has_odd_axis(element) and not element.source.old
    x, y, z = axis if as_given else axis / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation = np.eye(4)
    if as_given:
        cos, sin = math.cos(angle), math.sin(angle)
        rotation[:3, :3] = cos * np.eye(3) + sin * cross + (1.0 - cos) * np.outer(axis, axis)
    else:
        rotation[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return rotation


def has_odd_axis(element: Element) -> bool:
    """Whether the axis of a `rotate` element has another length than 1, which Mitsuba 3 does not make it."""
    return abs(float(np.linalg.norm(_xyz(element, 0.0))) - 1.0) > UNIT


def _matrix(element: Element) -> Matrix:
    values = numbers(element, "value", (9, 16))
    rows = np.eye(4)
    if len(values) == 9:
        rows[:3, :3] = np.reshape(values, (3, 3))
        return rows
    rows[:] = np.reshape(values, (4, 4))
    if rows[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise element.refuse("the last row of a matrix must be 0 0 0 1: projections are not supported")
    return rows


def _look_at(element: Element) -> Matrix:
    origin, target = (np.array(numbers(element, name, (3,))) for name in ("origin", "target"))
    up = np.array(numbers(element, "up", (3,))) if "up" in element.attributes else np.array([0.0, 1.0, 0.0])
    forward = target - origin
    if not forward.any():
        raise element.refuse("target must differ from origin")
    across = np.linalg.norm(np.cross(up, forward / np.linalg.norm(forward)))
    if across <= 1e-9 * max(float(np.linalg.norm(up)), 1e-300):
        raise element.refuse("up must not be parallel to the direction of view")
    return look_at(origin, target, up)


_STEPS: dict[str, Callable[[Element], Matrix]] = {
    "translate": _translate,
    "scale": _scale,
    "rotate": _rotate,
    "matrix": _matrix,
    "lookat": _look_at,
}


def similarity(linear: Matrix) -> float | None:
    """The scale of a linear part (3, 3) that keeps shapes: a rotation or reflection times one number. Else None."""
    lengths = np.linalg.norm(linear, axis=0)
    scale = float(lengths.mean())
    if scale <= 0.0:
        return None
    gram = linear.T @ linear / scale**2
    return scale if np.abs(gram - np.eye(3)).max() <= RIGID else None
