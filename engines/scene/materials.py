"""Materials of a scene file, and the table that gives them their indices."""

from __future__ import annotations

from dataclasses import dataclass, field

from engines.scene import fields
from engines.scene.metals import METALS
from engines.scene.model import BLACK, WHITE, Conductor, Material, Triple
from engines.scene.yaml_file import Located

KEYS = ("kd", "ks", "kt", "ior", "fresnel", "conductor", "emission", "two_sided")
LOBES = KEYS[:5]
SMOOTHEST = 1e-4
"""The least roughness above 0, as in Mitsuba."""
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
    if "conductor" in given:
        for key in LOBES:
            if key in given:
                raise node.refuse_key(key, f"either conductor, or {', '.join(LOBES)}")
    kd, ks, kt = (fields.color(given[key], 1.0) if key in given else BLACK for key in ("kd", "ks", "kt"))
    material = Material(
        name=name, kd=kd, ks=ks, kt=kt,
        ior=fields.positive(given["ior"]) if "ior" in given else 1.0,
        fresnel=fields.boolean(given["fresnel"]) if "fresnel" in given else False,
        emission=fields.color(given["emission"]) if "emission" in given else BLACK,
        two_sided=fields.boolean(given["two_sided"]) if "two_sided" in given else False,
        bsdf=read_conductor(given["conductor"]) if "conductor" in given else None,
    )  # fmt: skip
    for channel, total in zip(("red", "green", "blue"), energy(material), strict=True):
        if total > 1.0 + ENERGY_TOLERANCE:
            sum_of = "kd + max(ks, kt)" if material.fresnel else "kd + ks + kt"
            raise node.refuse(f"{sum_of} = {total:g} in {channel}: must not exceed 1")
    return material


def read_conductor(node: Located) -> Conductor:
    given = fields.mapping(node, ("metal", "eta", "k", "reflectance", "alpha", "distribution", "specular_reflectance"))
    ways = [way for way in (("metal",), ("eta", "k"), ("reflectance",)) if any(key in given for key in way)]
    if len(ways) != 1:
        raise node.refuse("needs metal, eta and k, or reflectance: one of the three")
    for key in ways[0]:
        if key not in given:
            raise node.refuse_key(key, "is missing")
    if "distribution" in given:
        fields.one_of(given["distribution"], ("ggx",), "distribution")
    scale = WHITE
    if "specular_reflectance" in given:
        if "reflectance" in given:
            raise node.refuse_key("specular_reflectance", "either reflectance, or specular_reflectance beside metal or eta, k")
        scale = fields.color(given["specular_reflectance"], 1.0)
    if "metal" in given:
        eta, k = METALS[fields.one_of(given["metal"], METALS, "metal")]
    elif "eta" in given:
        eta, k = fields.color(given["eta"]), fields.color(given["k"])
    else:
        eta, k, scale = BLACK, WHITE, fields.color(given["reflectance"], 1.0)  # Fresnel reflectance 1
    return Conductor(eta, k, _alpha(given["alpha"]) if "alpha" in given else (0.0, 0.0), scale)


def _alpha(node: Located) -> tuple[float, float]:
    """A number, or [along the first tangent, along the second]: both 0, or both in [SMOOTHEST, 1]."""
    several = isinstance(node.value, list)
    if several and len(node.value) != 2:
        raise node.refuse("must be a number, or two")
    found = [fields.number(item) for item in (node.value if several else [node])]
    if any(found):
        for item in node.value if several else [node]:
            if not SMOOTHEST <= item.value <= 1.0:
                raise item.refuse(f"must lie in [{SMOOTHEST:g}, 1], or be 0 for a smooth surface")
    return found[0], found[-1]


def energy(material: Material) -> Triple:
    """The share of light that the surface returns at most, a channel."""
    r, g, b = (
        d + (max(s, t) if material.fresnel else s + t)
        for d, s, t in zip(material.kd, material.ks, material.kt, strict=True)
    )
    return r, g, b
