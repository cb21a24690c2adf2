"""Wavefront MTL text as materials of ours.

Kd -> kd. Ks -> ks only where `illum` is 3, 5 or 7 (a mirror by ray tracing): elsewhere Ks is the colour of a highlight.
d < 1 (or Tr > 0) -> kt = Tf (1 - d), and kd is scaled by d; Ni -> ior where light is refracted or Fresnel holds.
illum 5 and 7 -> fresnel. Ke -> emission, as it stands. Materials that would return more light than they get are scaled
down, with a warning.

Where Pr (roughness), Pm (metallic), map_Pr or map_Pm stand, the material is `principled`: Kd -> base_color, 1 - d ->
spec_trans, Ni -> eta, by default 1.5; Ks, Tf and illum count no more, nor does a number beside its map.

map_Kd -> kd or base_color, times Kd unless that is 0. map_d -> the opacity of a mask, from the image's alpha where it has one;
d counts no more. map_Pr and map_Pm -> the textures of roughness and metallic. norm -> a normal map. Of their options -s, -o
and -clamp count. Other maps, and images that cannot be read, are left out with a warning.
"""

from __future__ import annotations

import math
from codecs import BOM_UTF8
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from engines.errors import SceneError
from engines.input_files import open_regular, unreadable
from engines.scene.bsdf import Bsdf, Mask, NormalMap
from engines.scene.materials import ENERGY_TOLERANCE, Material
from engines.scene.models import Mixture, Principled
from engines.scene.textures import ImageTexture, Texture, largest, tinted
from engines.scene.triple import BLACK, WHITE, Triple, product, triple
from engines.schema.yaml_file import Located

MIRRORS = (3, 5, 7)
FRESNEL = (5, 7)
MAX_BYTES = 16 * 2**20
MOST_ETA = 100.0
_COLORS = ("kd", "ks", "tf", "ke")
_NUMBERS = ("d", "tr", "ni", "illum", "pr", "pm")

MAPS = ("map_kd", "map_d", "map_pr", "map_pm", "norm")
OTHER_MAPS = ("map_", "bump", "disp", "decal", "refl")
"""How the keys of other maps begin."""
OPTIONS = {
    "-s": 3,
    "-o": 3,
    "-t": 3,
    "-mm": 2,
    "-blendu": 1,
    "-blendv": 1,
    "-cc": 1,
    "-clamp": 1,
    "-texres": 1,
    "-bm": 1,
    "-boost": 1,
    "-imfchan": 1,
    "-type": 1,
}
"""Options of maps, and how many words each has at most; those of three numbers may have fewer."""


@dataclass(slots=True)
class Raw:
    """The statements of a material: colours, numbers, and what follows the keys of maps."""

    colors: dict[str, Triple] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    maps: dict[str, str] = field(default_factory=dict)
    left_out: dict[str, None] = field(default_factory=dict)


def read_mtl(file: Path, node: Located, context: Any) -> tuple[dict[str, Material], list[tuple[str, str]]]:
    """Materials by name, and what to warn about: (name of the material, sentence). `context` is a `SceneReader`.

    Raises `SceneError` with the file and the line of what is wrong."""
    try:
        with open_regular(file) as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as problem:
        raise node.refuse(f"its MTL {file} {unreadable(problem)}") from problem
    if b"\0" in data or len(data) > MAX_BYTES:
        raise node.refuse(f"its MTL {file} is not an MTL file: it holds binary data or passes 16 MiB")
    raw: dict[str, Raw] = {}
    name, current = "", None
    lines = data.removeprefix(BOM_UTF8).decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    for number, line in enumerate(lines, 1):
        parts = line.split("#", 1)[0].split()
        if len(parts) < 2:
            continue
        key = parts[0].lower()
        if key == "newmtl":
            name = line.split(None, 1)[1].strip()
            current = raw.setdefault(name, Raw())
        elif current is not None and key in MAPS:
            current.maps[key] = line.split(None, 1)[1].strip()
        elif current is not None and key.startswith(OTHER_MAPS):
            current.left_out[parts[0]] = None
        elif key in _COLORS or key in _NUMBERS:
            if current is None:
                raise _wrong(node, file, number, f"{parts[0]} stands before the first newmtl")
            values = _values(node, file, number, key, parts[1:])
            if key in _NUMBERS:
                current.numbers[key] = values[0]
            else:
                current.colors[key] = triple(values * 3 if len(values) == 1 else values)
    warnings: list[tuple[str, str]] = []
    materials: dict[str, Material] = {}
    for name, statements in raw.items():
        notes = [f"{file.name}: {key} is not read: material {name!r}" for key in statements.left_out]
        images = {key: _image(node, context, file, name, key, text, notes) for key, text in statements.maps.items()}
        materials[name], warning = _material(name, statements, {k: v for k, v in images.items() if v}, file)
        warnings += [(name, text) for text in (*notes, *warning)]
    return materials, warnings


def _wrong(node: Located, file: Path, line: int, expected: str) -> SceneError:
    return SceneError(f"{node.where}: {file}:{line}: {expected}")


def _values(node: Located, file: Path, line: int, key: str, parts: list[str]) -> list[float]:
    shown = f"{key} {' '.join(parts)[:80]}"
    try:
        numbers = [float(part) for part in parts if part != "-halo"]
    except ValueError:
        raise _wrong(node, file, line, f"{shown}: numbers are expected") from None
    if not numbers or not all(map(math.isfinite, numbers)) or min(numbers) < 0.0:
        raise _wrong(node, file, line, f"{shown}: finite numbers of at least 0 are expected")
    if key in _COLORS and len(numbers) not in (1, 3):
        raise _wrong(node, file, line, f"{shown}: one or three numbers are expected")
    return numbers


def _image(
    node: Located, context: Any, file: Path, material: str, key: str, text: str, notes: list[str]
) -> ImageTexture | None:
    """The texture of a map; None with a note where it cannot be read."""
    words, options = text.split(), {}
    while words and words[0] in OPTIONS:
        count = OPTIONS[words[0]]
        if count == 3:
            count = next((i for i, word in enumerate(words[1:4]) if not _is_number(word)), 3)
        options[words[0]] = words[1 : 1 + count]
        words = words[1 + count :]
    name = " ".join(words).replace("\\", "/")
    try:
        path = context.place.find(node, name, file.parent)
        alpha = key == "map_d" and context.images.read(path).shape[2] in (2, 4)
        context.images.read(path)
        pixels = context.images.linear(path, None if key == "map_kd" else False, "a" if alpha else "")
    except SceneError as problem:
        notes.append(f"{file.name}: {key} of material {material!r} is left out: {problem}")
        return None
    (a, b), (c, d) = (_numbers(options.get(key, []), default) for key, default in (("-s", 1.0), ("-o", 0.0)))
    wrap = "clamp" if options.get("-clamp") == ["on"] else "repeat"
    return ImageTexture(pixels, wrap=wrap, to_uv=(a, 0.0, c, 0.0, b, 1.0 - b - d), name=Path(name).stem)


def _is_number(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _numbers(words: list[str], default: float) -> tuple[float, float]:
    """Of u and of v, which counts upwards in an MTL."""
    factors = [*map(float, words), default, default]
    return factors[0], factors[1] if len(words) > 1 else default


def _material(name: str, raw: Raw, images: dict[str, Texture], file: Path) -> tuple[Material, list[str]]:
    """The material of the statements, and a warning where it had to be scaled."""
    color, value = raw.colors.get, raw.numbers.get
    illum = value("illum", 2.0)
    opacity = 1.0 if "map_d" in images else min(value("d", 1.0 - min(value("tr", 0.0), 1.0)), 1.0)
    fresnel = illum in FRESNEL
    kd, image = color("kd", BLACK), images.get("map_kd")
    tint = kd if image is None or kd != BLACK else WHITE
    if image is not None:
        kd = product(tint, largest(image))
    if {"pr", "pm"} & raw.numbers.keys() or {"map_pr", "map_pm"} & images.keys():
        factor = min(1.0, 1.0 / (max(kd) or 1.0))
        tint = product(tint, factor)
        passing = 1.0 - opacity
        bsdf = Principled(
            tint if image is None else image if tint == WHITE else tinted(image, tint),
            images.get("map_pr", min(value("pr", 0.5), 1.0)),
            metallic=images.get("map_pm", min(value("pm", 0.0), 1.0)),
            eta=min(max(value("ni", 1.5), 1.001 if passing else 1.0), MOST_ETA),
            spec_trans=passing,
        )
        notes = [_scaled_down(file, name, max(kd))] if factor < 1.0 else []
        return Material(name, emission=color("ke", BLACK), bsdf=_wrapped(bsdf, images)), notes
    material = Material(
        name=name,
        kd=product(kd, opacity),
        ks=color("ks", BLACK) if illum in MIRRORS else BLACK,
        kt=product(color("tf", WHITE), 1.0 - opacity),
        ior=(value("ni", 1.0) or 1.0) if fresnel or opacity < 1.0 else 1.0,
        fresnel=fresnel,
        emission=color("ke", BLACK),
    )
    most, notes = max(material.energy), []
    factor = 1.0
    if most > 1.0 + ENERGY_TOLERANCE:
        factor = 1 / most
        kd, ks, kt = (product(color, factor) for color in (material.kd, material.ks, material.kt))
        material = replace(material, kd=kd, ks=ks, kt=kt)
        notes = [_scaled_down(file, name, most)]
    return _with_images(material, images, product(tint, opacity * factor)), notes


def _with_images(material: Material, images: dict[str, Texture], tint: Triple) -> Material:
    """The material with an image times `tint` as its kd, with a normal map, and with holes, as far as there are images."""
    if not images:
        return material
    kd = material.kd
    if "map_kd" in images:
        kd = images["map_kd"] if tint == WHITE else tinted(images["map_kd"], tint)
    bsdf = Mixture(kd, material.ks, material.kt, material.ior, material.fresnel)
    return Material(material.name, emission=material.emission, bsdf=_wrapped(bsdf, images))


def _wrapped(bsdf: Bsdf, images: dict[str, Texture]) -> Bsdf:
    """The BSDF with a normal map and with holes, as far as there are images."""
    if "norm" in images:
        bsdf = NormalMap(images["norm"], bsdf)
    return Mask(images["map_d"], bsdf) if "map_d" in images else bsdf


def _scaled_down(file: Path, name: str, most: float) -> str:
    return f"{file.name}: material {name!r} returns {most:.3g} of its light: scaled down to 1"
