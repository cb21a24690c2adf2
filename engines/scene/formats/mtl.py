"""Wavefront MTL text as materials of ours.

Kd -> kd. Ks -> ks only where `illum` is 3, 5 or 7 (a mirror by ray tracing): elsewhere Ks is the colour of a highlight.
d < 1 (or Tr > 0) -> kt = Tf (1 - d), and kd is scaled by d; Ni -> ior where light is refracted or Fresnel holds.
illum 5 and 7 -> fresnel. Ke -> emission, as it stands. Materials that would return more light than they get are scaled
down, with a warning; textures are not read, with a warning.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from engines.errors import SceneError
from engines.input_files import open_regular, unreadable
from engines.scene.materials import ENERGY_TOLERANCE, Material
from engines.scene.triple import BLACK, Triple
from engines.schema.yaml_file import Located

MIRRORS = (3, 5, 7)
FRESNEL = (5, 7)
MAX_BYTES = 16 * 2**20
_COLORS = ("kd", "ks", "tf", "ke")
_NUMBERS = ("d", "tr", "ni", "illum")

Raw = dict[str, Triple | float]


def read_mtl(file: Path, node: Located) -> tuple[dict[str, Material], list[tuple[str, str]]]:
    """Materials by name, and what to warn about: (name of the material, sentence).

    Raises `SceneError` with the file and the line of what is wrong."""
    try:
        with open_regular(file) as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as problem:
        raise node.refuse(f"its MTL {file} {unreadable(problem)}") from problem
    if b"\0" in data or len(data) > MAX_BYTES:
        raise node.refuse(f"its MTL {file} is not an MTL file: it holds binary data or passes 16 MiB")
    raw: dict[str, Raw] = {}
    textured: dict[str, None] = {}
    name, current = "", None
    lines = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    for number, line in enumerate(lines, 1):
        parts = line.split("#", 1)[0].split()
        if len(parts) < 2:
            continue
        key = parts[0].lower()
        if key == "newmtl":
            name = line.split(None, 1)[1].strip()
            current = raw.setdefault(name, {})
        elif key.startswith("map_kd") and current is not None:
            textured[name] = None
        elif key in _COLORS or key in _NUMBERS:
            if current is None:
                raise _wrong(node, file, number, f"{parts[0]} stands before the first newmtl")
            current[key] = _value(node, file, number, key, parts[1:])
    warnings = [(name, f"{file.name}: textures are not read: material {name!r}") for name in textured]
    materials: dict[str, Material] = {}
    for name, values in raw.items():
        materials[name], warning = _material(name, values, file)
        warnings += [(name, text) for text in warning]
    return materials, warnings


def _wrong(node: Located, file: Path, line: int, wanted: str) -> SceneError:
    return SceneError(f"{node.where}: {file}:{line}: {wanted}")


def _value(node: Located, file: Path, line: int, key: str, parts: list[str]) -> Triple | float:
    shown = f"{key} {' '.join(parts)[:80]}"
    try:
        numbers = [float(part) for part in parts if part != "-halo"]
    except ValueError:
        raise _wrong(node, file, line, f"{shown}: numbers are wanted") from None
    if not numbers or not all(map(math.isfinite, numbers)) or min(numbers) < 0.0:
        raise _wrong(node, file, line, f"{shown}: finite numbers of at least 0 are wanted")
    if key in _NUMBERS:
        return numbers[0]
    if len(numbers) not in (1, 3):
        raise _wrong(node, file, line, f"{shown}: one or three numbers are wanted")
    r, g, b = numbers * 3 if len(numbers) == 1 else numbers
    return r, g, b


def _material(name: str, values: Raw, file: Path) -> tuple[Material, list[str]]:
    """The material of the raw values, and a warning where it had to be scaled."""

    def color(key: str, default: Triple) -> Triple:
        found = values.get(key, default)
        assert isinstance(found, tuple)
        return found

    def value(key: str, default: float) -> float:
        found = values.get(key, default)
        assert not isinstance(found, tuple)
        return found

    illum = value("illum", 2.0)
    opacity = min(value("d", 1.0 - min(value("tr", 0.0), 1.0)), 1.0)
    fresnel = illum in FRESNEL
    material = Material(
        name=name,
        kd=_scaled(color("kd", BLACK), opacity),
        ks=color("ks", BLACK) if illum in MIRRORS else BLACK,
        kt=_scaled(color("tf", (1.0, 1.0, 1.0)), 1.0 - opacity),
        ior=(value("ni", 1.0) or 1.0) if fresnel or opacity < 1.0 else 1.0,
        fresnel=fresnel,
        emission=color("ke", BLACK),
    )
    most = max(material.energy)
    if most <= 1.0 + ENERGY_TOLERANCE:
        return material, []
    kd, ks, kt = (_scaled(color, 1 / most) for color in (material.kd, material.ks, material.kt))
    material = replace(material, kd=kd, ks=ks, kt=kt)
    return material, [f"{file.name}: material {name!r} returns {most:.3g} of its light: scaled down to 1"]


def _scaled(color: Triple, factor: float) -> Triple:
    r, g, b = color
    return r * factor, g * factor, b * factor
