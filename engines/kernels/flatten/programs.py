"""Programs of materials: how wrappers and textures (docs/transport.md) lead to a model and its parameters at a hit.

A program is a tree of nodes. Its leaves are models of `engines.kernels.flatten.materials`, some of whose parameters are looked
up in textures. A material without wrappers and textures has none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.flatten import palettes
from engines.kernels.flatten.lookups import Lookup, Table
from engines.kernels.flatten.materials import leaf_features, model_of, parameters_of, transmittance_of
from engines.kernels.rows import LeafRow, LookupRow, MaterialRow, NodeRow, TextureRow
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    ImageTexture,
    Mask,
    Material,
    MeshAttribute,
    Mixture,
    NormalMap,
    Sides,
    Texture,
    Triple,
)
from engines.scene.bsdf_tree import leaves, transmits

LEAF, SIDES, MASK, BLEND, BUMP, NORMAL_MAP = range(6)
"""Those from BUMP on tilt the shading normal."""
WRAPPERS: dict[type, int] = {Sides: SIDES, Mask: MASK, Blend: BLEND, Bump: BUMP, NormalMap: NORMAL_MAP}
"""The node of each wrapper."""
IMAGE, CHECKERBOARD, VERTEX_ATTRIBUTE, FACE_ATTRIBUTE = range(4)
"""Those from VERTEX_ATTRIBUTE on are attributes of meshes."""
REPEAT, CLAMP, MIRROR = range(3)
WRAPS = {"repeat": REPEAT, "clamp": CLAMP, "mirror": MIRROR}
NONE = -1
PREFETCHED = 4
"""Images of a program whose texels are prefetched."""
THROUGH = 1
"""Stands for the second part of a bump or normal map whose models let light through."""
_BLACK = Mixture()


class Parts(NamedTuple):
    """What a wrapper leads to, in the order of a node's fields, and the texture or number that it reads."""

    of: tuple[Any, ...]
    value: Any = 0.0
    scale: float = 0.0


def parts(wrapper: Any) -> Parts:
    """The parts of a wrapper; a side that has no BSDF is black."""
    match wrapper:
        case Sides(front, back):
            return Parts((front or _BLACK, back or _BLACK))
        case Mask(opacity, of):
            return Parts((of,), opacity)
        case Blend(weight, a, b):
            return Parts((a, b), weight)
        case Bump(height, scale, of):
            return Parts((of,), height, scale)
        case NormalMap(map, of):
            return Parts((of,), map)
    raise TypeError(f"{type(wrapper).__name__} is no wrapper")


def leaves_in(material: Material) -> list[Any]:
    """Where the wrappers of a material lead; its BSDF itself, where that is none."""
    return [leaf or _BLACK for leaf in leaves(material.as_bsdf)]


def plain_emission(material: Material) -> Triple:
    """What a material emits before its texture is looked up."""
    return (1.0, 1.0, 1.0) if isinstance(material.emission, Texture) and material.emits else material.mean_emission


def _is_textured(leaf: Any) -> bool:
    return any(isinstance(value, Lookup) for value in parameters_of(leaf))


class Programs:
    """The programs of the materials in use, `used`; those of `on_uvs` are met on meshes that have texture coordinates.
    `attribute_rows` gives the values of an attribute."""

    def __init__(
        self,
        materials: tuple[Material, ...],
        used: Iterable[int],
        on_uvs: Iterable[int],
        attribute_rows: Callable[[MeshAttribute], NDArray[np.float32]],
    ) -> None:
        self._attribute_rows = attribute_rows
        self.materials = materials
        self.used = [int(index) for index in used]
        self.on_uvs = {int(index) for index in on_uvs}
        self.nodes: list[list[float]] = []
        self.leaves: list[list[float]] = []
        self.lookups: list[list[float]] = []
        self.textures: list[list[float]] = []
        self.pixels: list[NDArray[Any]] = []
        """Of each texture, in the order of `textures`, float32 or as `palettes.indexed` gives them; empty of those that have
        none."""
        self.tables: list[float] = [1]
        """Those of all BSDFs, one behind the other, after how many numbers they are."""
        self._places: dict[Table, int] = {}
        self._kept: dict[int, tuple[Any, int]] = {}
        self._images: dict[int | str, NDArray[Any]] = {}
        self.first = np.full(max(len(materials), 1), NONE, np.int32)
        for index in self.used:
            if self._wanted(index):
                self.first[index] = self._node(materials[index].as_bsdf)
        self._looks_up = len(self.textures) > 0
        self.emission_textures = np.full(len(self.first), NONE, np.int32)
        for index in self.used:
            if isinstance(materials[index].emission, Texture):
                self.emission_textures[index] = self.texture(materials[index].emission)

    def _wanted(self, index: int) -> bool:
        """Whether a material has a program: it has wrappers or textures, or is anisotropic along texture coordinates."""
        leaf = self.materials[index].as_bsdf
        if type(leaf) in WRAPPERS or _is_textured(leaf):
            return True
        return index in self.on_uvs and leaf_features([leaf]).get("tangents", False)

    # ---- nodes -------------------------------------------------------------------------------------------------------

    def _node(self, bsdf: Any) -> int:
        """The index of the node of a wrapper or leaf. One that stands in several places has one node."""
        if id(bsdf) in self._kept:
            return self._kept[id(bsdf)][1]
        if type(bsdf) in WRAPPERS:
            found = parts(bsdf)
            texture = NONE if isinstance(found.value, int | float) else self.texture(found.value)
            value = found.scale if texture >= 0 else float(found.value)
            first, second = [*map(self._node, found.of), NONE][:2]
            if isinstance(bsdf, Bump | NormalMap) and transmits(bsdf):
                second = THROUGH
            row = NodeRow.packed(kind=WRAPPERS[type(bsdf)], first=first, second=second, texture=texture, value=value)
        else:
            row = self._leaf(bsdf)
        self.nodes.append(row)
        self._kept[id(bsdf)] = bsdf, len(self.nodes) - 1
        return len(self.nodes) - 1

    def _leaf(self, leaf: Any) -> list[float]:
        first = len(self.lookups)
        for parameter, value in enumerate(parameters_of(leaf)):
            if isinstance(value, Lookup):
                texture = self.texture(value.texture)
                row = LookupRow.packed(
                    parameter=parameter, texture=texture, channel=value.channel, low=value.low, high=value.high
                )
                self.lookups.append(row)
        self.leaves.append(LeafRow.packed(bsdf=self._constants(leaf)))
        n, kind = len(self.lookups) - first, model_of(leaf)
        return NodeRow.packed(kind=LEAF, first=kind, second=len(self.leaves) - 1, texture=first, value=n)

    def _constants(self, leaf: Any) -> list[float]:
        """The parameters of a leaf, 0 where they are looked up."""
        return [self._constant(value) for value in parameters_of(leaf)]

    def _constant(self, value: float | Lookup | Table) -> float:
        if isinstance(value, Table):
            if value not in self._places:
                self._places[value] = len(self.tables)
                self.tables += value.numbers
                self.tables[0] = len(self.tables)
            return self._places[value]
        return 0.0 if isinstance(value, Lookup) else value

    # ---- textures ----------------------------------------------------------------------------------------------------

    def texture(self, texture: Texture) -> int:
        """The index of a texture, which has one wherever it is used."""
        if id(texture) in self._kept:
            return self._kept[id(texture)][1]
        pixels = np.zeros(0, np.float32)
        if isinstance(texture, Checkerboard):
            row = TextureRow.packed(kind=CHECKERBOARD, to_uv=texture.to_uv, a=texture.a, b=texture.b)
        elif isinstance(texture, MeshAttribute):
            kind = FACE_ATTRIBUTE if texture.of_faces else VERTEX_ATTRIBUTE
            row = TextureRow.packed(kind=kind, a=(texture.scale,) * 3)
            if texture.name not in self._images:
                self._images[texture.name] = self._attribute_rows(texture)
            pixels = self._images[texture.name]
        else:
            pixels = self._pixels(texture)
            height, width, channels = texture.pixels.shape
            row = TextureRow.packed(
                kind=IMAGE,
                width=width,
                height=height,
                channels=channels,
                nearest=texture.filter == "nearest",
                wrap=WRAPS[texture.wrap],
                to_uv=texture.to_uv,
                indexed=pixels.dtype == np.uint8,
            )
        self.textures.append(row)
        self.pixels.append(pixels)
        self._kept[id(texture)] = texture, len(self.textures) - 1
        return len(self.textures) - 1

    def _pixels(self, texture: ImageTexture) -> NDArray[Any]:
        """Indexed where it has few different numbers; else the scene's own memory where it can be read as it is."""
        found = self._images.get(id(texture.pixels))
        if found is None:
            image = np.ascontiguousarray(texture.pixels, np.float32)
            small = palettes.indexed(image)
            found = self._images[id(texture.pixels)] = image if small is None else small
        return found

    @property
    def texture_bytes(self) -> int:
        """Of all images and attributes."""
        return sum(pixels.nbytes for pixels in self._images.values())

    # ---- what the scene gets of them ---------------------------------------------------------------------------------

    def __bool__(self) -> bool:
        return bool((self.first >= 0).any())

    def material_rows(self) -> NDArray[np.float64]:
        """(n, numbers of a row) of all materials, at least one row. A material of a program has its first leaf there."""
        rows = np.zeros((max(len(self.materials), 1), MaterialRow.size))
        for row, material in zip(rows, self.materials, strict=False):
            leaf = leaves_in(material)[0]
            row[:] = MaterialRow.packed(
                bsdf=self._constants(leaf),
                emission=plain_emission(material),
                two_sided=material.two_sided,
                model=model_of(leaf),
            )
        return rows

    def images(self) -> NDArray[np.int32]:
        """(n, PREFETCHED) of all materials, at least one row: images that the program may read, NONE after them."""
        found = np.full((len(self.first), PREFETCHED), NONE, np.int32)
        for row, first in zip(found, self.first, strict=True):
            if first >= 0:
                own = [texture for texture in dict.fromkeys(self._textures_of(first)) if self.textures[texture][0] == IMAGE]
                row[: len(own)] = own[:PREFETCHED]
        return found

    def _textures_of(self, node: int) -> list[int]:
        """Those of a node and of all that it leads to."""
        kind, first, second, texture, value = (int(number) for number in self.nodes[node])
        if kind == LEAF:
            column = [*LookupRow.fields].index("texture")
            return [int(row[column]) for row in self.lookups[texture : texture + value]]
        parts = [first, second] if kind in (SIDES, BLEND) else [first]
        return [texture] * (texture >= 0) + [found for part in parts for found in self._textures_of(part)]

    def _blends(self, node: int) -> int:
        """Blends around each other in a node, counted along their first parts."""
        kind, first, second, _, _ = (int(number) for number in self.nodes[node])
        if kind == LEAF:
            return 0
        inner = [self._blends(part) for part in ([first, second] if kind in (SIDES, BLEND) else [first])]
        return max(inner[0] + 1, inner[1]) if kind == BLEND else max(inner)

    def features(self) -> dict[str, Any]:
        """The features that the materials in use bring."""
        used = [self.materials[index] for index in self.used]
        kinds = {row[0] for row in self.nodes}
        found = leaf_features(leaf for material in used for leaf in leaves_in(material))
        return {
            **found,
            "emission": any(material.emits for material in used),
            "programs": bool(self),
            "textures": self._looks_up,
            "attributes": any(row[0] >= VERTEX_ATTRIBUTE for row in self.textures),
            "textured_emission": bool((self.emission_textures >= 0).any()),
            "uvs": any(self.first[index] >= 0 for index in self.on_uvs),
            "choices": bool(kinds & {MASK, BLEND}),
            "masks": MASK in kinds,
            "null_lobes": MASK in kinds or any(map(transmittance_of, found["bsdfs"])),
            "blends": max((self._blends(first) for first in self.first.tolist() if first >= 0), default=0),
            "tilts": bool(kinds & {BUMP, NORMAL_MAP}),
        }
