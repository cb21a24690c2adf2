"""Materials of a scene file, and the table that gives them their indices."""

from __future__ import annotations

from dataclasses import dataclass, field

from engines.scene import fields
from engines.scene.model import BLACK, Material, Triple
from engines.scene.yaml_file import Located

KEYS = ("kd", "ks", "kt", "ior", "fresnel", "emission", "two_sided")
ENERGY_TOLERANCE = 1e-9
"""By how much kd + ks + kt may pass 1, so that sums such as 0.6 + 0.3 + 0.1 are not refused for rounding."""


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


def read_materials(node: Located) -> MaterialTable:
    """The table of a `materials` mapping; null counts as an empty one."""
    table = MaterialTable()
    if node.value is None:
        return table
    if not isinstance(node.value, dict):
        raise node.refuse("must be a mapping from names to materials")
    for name, child in node.value.items():
        table.names[name] = table.add(read_material(name, child))
    return table


def read_material(name: str, node: Located) -> Material:
    given = fields.mapping(node, KEYS)
    kd, ks, kt = (fields.color(given[key], 1.0) if key in given else BLACK for key in ("kd", "ks", "kt"))
    material = Material(
        name=name, kd=kd, ks=ks, kt=kt,
        ior=fields.positive(given["ior"]) if "ior" in given else 1.0,
        fresnel=fields.boolean(given["fresnel"]) if "fresnel" in given else False,
        emission=fields.color(given["emission"]) if "emission" in given else BLACK,
        two_sided=fields.boolean(given["two_sided"]) if "two_sided" in given else False,
    )  # fmt: skip
    for channel, total in zip(("red", "green", "blue"), energy(material), strict=True):
        if total > 1.0 + ENERGY_TOLERANCE:
            sum_of = "kd + max(ks, kt)" if material.fresnel else "kd + ks + kt"
            raise node.refuse(f"{sum_of} = {total:g} in {channel}: must not exceed 1")
    return material


def energy(material: Material) -> Triple:
    """The share of light that the surface returns at most, a channel."""
    r, g, b = (
        d + (max(s, t) if material.fresnel else s + t)
        for d, s, t in zip(material.kd, material.ks, material.kt, strict=True)
    )
    return r, g, b
