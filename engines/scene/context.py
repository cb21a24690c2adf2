"""What the readers of a scene file share: its materials, its place, and what it should warn about."""

from __future__ import annotations

from dataclasses import dataclass, field

from engines.scene.files import Place
from engines.scene.materials import Material
from engines.schema import fields
from engines.schema.yaml_file import Located


@dataclass(slots=True)
class MaterialTable:
    """Materials in the order of their indices; `names` are those of the scene file (MTL materials are not in it)."""

    materials: list[Material] = field(default_factory=list)
    names: dict[str, int] = field(default_factory=dict)

    def add(self, material: Material) -> int:
        """Appends a material and returns its index."""
        self.materials.append(material)
        return len(self.materials) - 1

    def index(self, node: Located) -> int:
        """The index of the material that a scene file names here."""
        return self.names[fields.one_of(node, self.names, "material")]


@dataclass(slots=True)
class SceneReader:
    """The state of reading one scene: `name` is that of a scene without a title, `source` its file.

    `material` is the index of the material of the shape being read, None where a mesh file brings its own. `degenerate`
    counts triangles without area.
    """

    place: Place
    name: str = "scene"
    source: str = ""
    allow_imports: bool = False
    table: MaterialTable = field(default_factory=MaterialTable)
    material: int | None = None
    degenerate: int = 0
    warnings: list[str] = field(default_factory=list)
