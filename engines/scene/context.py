"""What the readers of a scene file share: its materials, its place, and what it should warn about."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from engines.scene.bsdf import MAX_DEPTH, Bsdf
from engines.scene.files import Place
from engines.scene.materials import MATERIAL, Material
from engines.scene.textures import Images, Texture
from engines.schema import fields
from engines.schema.yaml_file import Located


@dataclass(slots=True)
class MaterialTable:
    """Materials in the order of their indices; `names` are those of the scene file (MTL materials are not in it).

    A material may name one that stands after it: `nodes` are those of the file, `read` those that have been read, `reading`
    the names of those that are being read, each for the one before, and `depth` counts wrappers on the way. `asked` says how
    often `add_named` has met a name.
    """

    materials: list[Material] = field(default_factory=list)
    names: dict[str, int] = field(default_factory=dict)
    nodes: Mapping[str, Located] = field(default_factory=dict)
    read: dict[str, Material] = field(default_factory=dict)
    reading: list[str] = field(default_factory=list)
    depth: int = 0
    asked: dict[str, int] = field(default_factory=dict)

    def declare(self, nodes: Mapping[str, Located], context: SceneReader) -> None:
        """Reads the materials of a scene file, in the order of which they get their indices."""
        self.nodes = nodes
        for name, node in nodes.items():
            self.names[name] = self.add(self._named(name, node, context))

    def bsdf(self, node: Located, context: SceneReader) -> Bsdf:
        """The BSDF of the material that is named or written at `node`, inside another material."""
        if not isinstance(node.value, (str, dict)):
            raise node.refuse("must be the name of a material, or a mapping with its keys")
        if self.depth >= MAX_DEPTH:
            raise node.refuse(f"stands inside {MAX_DEPTH} others: more are not possible")
        self.depth += 1
        if isinstance(node.value, str):
            material = self._named(fields.one_of(node, self.nodes, "material"), node, context)
        else:
            material = MATERIAL.read(node, context)
        self.depth -= 1
        if material.emits:
            raise node.refuse("emits: emission stands beside the outermost material")
        return material.as_bsdf

    def _named(self, name: str, node: Located, context: SceneReader) -> Material:
        if name in self.reading:
            chain = " -> ".join([*self.reading[self.reading.index(name) :], name])
            raise node.refuse(f"a material that is inside itself: {chain}")
        if name not in self.read:
            self.reading.append(name)
            self.read[name] = MATERIAL.read(self.nodes[name], context)
            self.reading.pop()
        return self.read[name]

    def add(self, material: Material) -> int:
        """Appends a material and returns its index."""
        self.materials.append(material)
        return len(self.materials) - 1

    def add_named(self, material: Material) -> int:
        """Like `add`, with a number behind the name where another material has it."""
        unique = material.name
        while unique in self.asked:
            self.asked[material.name] += 1
            unique = f"{material.name}_{self.asked[material.name]}"
        self.asked[unique] = 1
        return self.add(replace(material, name=unique))

    def index(self, node: Located) -> int:
        """The index of the material that a scene file names here."""
        return self.names[fields.one_of(node, self.names, "material")]


@dataclass(slots=True)
class SceneReader:
    """The state of reading one scene: `name` is that of a scene without a title, `source` its file, `textures` by name,
    `media` the names of media in their order.

    `material` is the index of the material of the shape being read, None where a mesh file brings its own
    or its faces have one of `face_materials` each. `degenerate`
    counts triangles without area. `groups` are those that instances may show, `group` is the name of the one being read, empty
    outside of groups, and `instances` counts instances.
    """

    place: Place
    name: str = "scene"
    source: str = ""
    allow_imports: bool = False
    textures: dict[str, Texture] = field(default_factory=dict)
    images: Images = field(default_factory=Images)
    table: MaterialTable = field(default_factory=MaterialTable)
    media: list[str] = field(default_factory=list)
    material: int | None = None
    face_materials: list[int] = field(default_factory=list)
    degenerate: int = 0
    groups: dict[str, Any] = field(default_factory=dict)
    group: str = ""
    instances: int = 0
    warnings: list[str] = field(default_factory=list)
