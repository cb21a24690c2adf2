"""BSDFs that wrap others: which of them a ray meets, by the walk of docs/transport.md, "Wrappers"."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, get_args

import numpy as np

from engines.numpy_reference.interaction import SurfaceInteraction, Wrapped
from engines.numpy_reference.textures import NumberParameter
from engines.numpy_reference.tilts import tilted
from engines.numpy_reference.vectors import Array, Indices, Mask
from engines.scene import Blend, Bsdf, Bump, Mixture, NormalMap, Sides, Texture, Wrapper
from engines.scene import Mask as MaskWrapper
from engines.scene.bsdf_tree import transmits

_WRAPPERS: tuple[type, ...] = get_args(Wrapper)
_TEXTURES: tuple[type, ...] = get_args(Texture)
_BLACK = Mixture()


class Wrappers:
    """The BSDFs of m materials, taken apart: a node for each wrapper and each of the `leaves`, which are no wrappers.

    `any` says whether there are wrappers, `masks` whether masks are among them; `placed` (m,) which materials need texture
    coordinates.
    """

    def __init__(self, bsdfs: Sequence[Bsdf]) -> None:
        self._nodes: list[Any] = []
        self._number: dict[int, int] = {}
        self._root = np.array([self._enter(bsdf) for bsdf in bsdfs], np.int64)
        self.leaves = [node for node in self._nodes if not isinstance(node, _WRAPPERS)]
        wraps = np.array([isinstance(node, _WRAPPERS) for node in self._nodes], bool)
        self.any = bool(wraps.any())
        self.masks = any(isinstance(node, MaskWrapper) for node in self._nodes)
        self._leaf = np.where(wraps, -1, np.cumsum(~wraps) - 1)
        self._of_material = self._leaf[self._root]
        self._parts = np.array([self._numbers(node) for node in self._nodes], np.int64).reshape(-1, 2).T
        self._share = NumberParameter([_share(node) for node in self._nodes])
        self._transmits = [transmits(node) for node in self._nodes]
        self.placed: Mask = np.array([_needs_coordinates(bsdf) for bsdf in bsdfs], bool)

    def leaf(self, material: Indices) -> Indices:
        """(n,) numbers of the leaves that materials without wrappers are; -1 for the others."""
        return self._of_material[material]

    def walk(self, at: SurfaceInteraction, u: Array) -> tuple[SurfaceInteraction, Array]:
        """The points, seen as their leaves see them, and what the choices have left of the numbers `u` (n,) in [0, 1)."""
        walk = _Walk(at, u)
        node = self._root[at.material]
        while (self._leaf[node] < 0).any():
            here = node.copy()
            for number in np.unique(here[self._leaf[here] < 0]):
                wrapper, lanes = self._nodes[number], np.flatnonzero(here == number)
                first, second = self._parts[:, number]
                if isinstance(wrapper, Sides):
                    node[lanes] = np.where(at.front[lanes], first, second)
                elif isinstance(wrapper, Blend):
                    node[lanes] = np.where(walk.chosen(lanes, self._share(here[lanes], at.take(lanes))), second, first)
                else:
                    node[lanes] = first
                    if isinstance(wrapper, MaskWrapper):
                        walk.mask(lanes, self._share(here[lanes], at.take(lanes)))
                    else:
                        walk.tilt(lanes, wrapper, self._transmits[number])
        return walk.ended(self._leaf[node])

    def transmittance(self, at: SurfaceInteraction, of_leaf: Callable[[SurfaceInteraction], Array]) -> Array:
        """(3, n) the transmittance of surfaces, given that of leaves (docs/transport.md, "Null lobes")."""
        nowhere, opaque = np.full(at.front.size, -1), np.ones(at.front.size)
        unwalked = at._replace(wrapped=Wrapped(nowhere, opaque, opaque < 1.0, at.normal, at.normal))
        found, root = np.empty(at.wo.shape), self._root[at.material]
        for number in np.unique(root):
            lanes = np.flatnonzero(root == number)
            found[:, lanes] = self._passed(number, unwalked.take(lanes), of_leaf)
        return found

    def _passed(self, number: int, at: SurfaceInteraction, of_leaf: Callable[[SurfaceInteraction], Array]) -> Array:
        """(3, n) the same of one node, at points as the wrappers around it have left them."""
        bsdf, parts = self._nodes[number], self._parts[:, number]
        assert at.wrapped is not None
        if self._leaf[number] >= 0:
            return of_leaf(at._replace(wrapped=at.wrapped._replace(leaf=np.full(at.front.size, self._leaf[number]))))
        if isinstance(bsdf, Bump | NormalMap):
            tilt = tilted(bsdf, at, self._transmits[number])
            innermost = np.where(tilt.scatters & at.wrapped.innermost.any(axis=0), at.normal, 0.0)
            frame = {"normal": tilt.normal, "dp_du": tilt.dp_du, "dp_dv": tilt.dp_dv}
            return self._passed(parts[0], at._replace(**frame, wrapped=at.wrapped._replace(innermost=innermost)), of_leaf)
        first = self._passed(parts[0], at, of_leaf)
        if isinstance(bsdf, Sides):
            return np.where(at.front, first, self._passed(parts[1], at, of_leaf))
        share = self._share(np.full(at.front.size, number), at)
        if isinstance(bsdf, Blend):
            return (1.0 - share) * first + share * self._passed(parts[1], at, of_leaf)
        return 1.0 - share * (1.0 - first)

    def _enter(self, bsdf: Any) -> int:
        """The number of a node, whose parts have theirs. One that stands in several places has one."""
        if id(bsdf) not in self._number:
            for part in _parts(bsdf):
                self._enter(part)
            self._number[id(bsdf)] = len(self._nodes)
            self._nodes.append(bsdf)
        return self._number[id(bsdf)]

    def _numbers(self, bsdf: Any) -> tuple[int, int]:
        """Of the first and the last part, -1 of a leaf."""
        numbers = [self._number[id(part)] for part in _parts(bsdf)] or [-1]
        return numbers[0], numbers[-1]


class _Walk:
    """The state of n points on their way to a leaf."""

    def __init__(self, at: SurfaceInteraction, u: Array) -> None:
        self._at, self._u = at, u.copy()
        self._opacity, self._passing, self._black = np.ones(u.size), np.zeros(u.size, bool), np.zeros(u.size, bool)
        self._normal, self._dp_du, self._innermost = at.normal.copy(), at.dp_du.copy(), at.normal.copy()
        self._dp_dv = np.zeros_like(at.normal) if at.dp_dv is None else at.dp_dv.copy()

    def chosen(self, lanes: Indices, share: Array) -> Mask:
        """Whether `u` chooses what has this share; the rest of `u` is kept."""
        u = self._u[lanes]
        found = u < share
        with np.errstate(divide="ignore", invalid="ignore"):
            self._u[lanes] = np.where(found, u / share, (u - share) / (1.0 - share))
        return found

    def mask(self, lanes: Indices, opacity: Array) -> None:
        self._opacity[lanes] *= opacity
        undecided = np.flatnonzero(~self._passing[lanes])
        lanes = lanes[undecided]
        self._passing[lanes] = ~self.chosen(lanes, opacity[undecided])

    def tilt(self, lanes: Indices, wrapper: Bump | NormalMap, transmits: bool) -> None:
        before = self._at._replace(normal=self._normal, dp_du=self._dp_du, dp_dv=self._dp_dv).take(lanes)
        after = tilted(wrapper, before, transmits)
        self._black[lanes] |= ~after.scatters
        self._innermost[:, lanes] = before.normal
        self._normal[:, lanes], self._dp_du[:, lanes], self._dp_dv[:, lanes] = after[:3]

    def ended(self, leaf: Indices) -> tuple[SurfaceInteraction, Array]:
        innermost = np.where(self._black, 0.0, self._innermost)
        state = Wrapped(leaf, self._opacity, self._passing, self._at.normal, innermost)
        return self._at._replace(normal=self._normal, dp_du=self._dp_du, wrapped=state), self._u


def _parts(bsdf: Any) -> tuple[Any, ...]:
    """What a wrapper may lead to, nothing for a leaf. A side without a BSDF is black."""
    if isinstance(bsdf, Sides):
        return bsdf.front or _BLACK, bsdf.back or _BLACK
    if isinstance(bsdf, Blend):
        return bsdf.a, bsdf.b
    return (bsdf.of,) if isinstance(bsdf, _WRAPPERS) else ()


def _share(bsdf: Any) -> Any:
    """The number that a wrapper compares `u` with, 0 where there is none."""
    return bsdf.opacity if isinstance(bsdf, MaskWrapper) else bsdf.weight if isinstance(bsdf, Blend) else 0.0


def _needs_coordinates(value: Any) -> bool:
    """Whether a BSDF is a wrapper, or has textures anywhere in it."""
    if isinstance(value, (*_WRAPPERS, *_TEXTURES)):
        return True
    if isinstance(value, tuple):
        return any(map(_needs_coordinates, value))
    return is_dataclass(value) and any(_needs_coordinates(getattr(value, field.name)) for field in fields(value))
