"""Image files (PNG, JPEG, TIFF, BMP, WebP, EXR), damaged or under a suffix that is not theirs."""

from __future__ import annotations

import io
import struct
import tempfile
import zlib
from functools import cache
from pathlib import Path
from random import Random

import numpy as np
import yaml
from PIL import Image as Pillow

import engines
from engines.errors import SceneError
from engines.image import SUFFIXES, read_bitmap, read_film_layers, read_image, read_provenance
from tests.fuzz.mutate import mutated_bytes
from tests.fuzz.scenes import TREE

SAVED = [
    ("png", "RGB", {}),
    ("png", "P", {}),
    ("png", "I;16", {}),
    ("png", "1", {}),
    ("png", "RGBA", {}),
    ("jpg", "RGB", {}),
    ("jpg", "CMYK", {}),
    ("jpg", "L", {"progressive": True}),
    ("tif", "RGB", {}),
    ("tif", "RGB", {"compression": "tiff_lzw"}),
    ("tif", "1", {"compression": "group4"}),
    ("tif", "RGB", {"compression": "jpeg"}),
    ("tif", "RGBA", {"compression": "tiff_adobe_deflate"}),
    ("tif", "F", {}),
    ("bmp", "RGB", {}),
    ("bmp", "P", {}),
    ("webp", "RGB", {}),
    ("webp", "RGBA", {"lossless": True}),
]
FOREIGN = ("gif", "ppm", "ico", "tga", "eps", "pdf", "pcx", "im", "dds", "jp2")
"""What Pillow could read besides, some of it by starting a program."""


@cache
def files() -> dict[str, list[bytes]]:
    """Whole files by suffix, a few of each."""
    gradient = np.linspace(0, 255, 24 * 20 * 3).reshape(24, 20, 3).astype(np.uint8)
    picture = Pillow.fromarray(gradient)
    found: dict[str, list[bytes]] = {".exr": _exr_files(gradient / 255.0)}
    for suffix, mode, options in SAVED:
        found.setdefault(f".{suffix}", []).append(_saved(picture.convert("L" if mode == "I;16" else mode), suffix, options))
    flat = np.full((24, 20, 4), (128, 64, 32, 129), np.uint8).tobytes()
    runs = b"".join(bytes((2, 2, 0, 20)) + bytes((128 + 20, value)) * 4 for value in range(24))
    found[".hdr"] = [b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 24 +X 20\n" + body for body in (flat, runs)]
    found["foreign"] = [_saved(picture, suffix, {}) for suffix in FOREIGN]
    found[".tiff"], found[".jpeg"] = found[".tif"], found[".jpg"]
    return found


def _saved(picture: Pillow.Image, suffix: str, options: dict) -> bytes:
    buffer = io.BytesIO()
    picture.save(buffer, Pillow.registered_extensions()[f".{suffix}"], **options)
    return buffer.getvalue()


def _exr_files(image: np.ndarray) -> list[bytes]:
    import OpenEXR

    film = engines.Film(20, 24)
    for scale in (1.0, 2.0):
        film.add(image * scale)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.exr"
        film.save(path, {"seed": 1})
        found = [path.read_bytes()]
        half = image.astype(np.float16)
        for compression in ("NO", "RLE", "ZIPS", "PIZ", "PXR24", "B44", "DWAA"):
            header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
            OpenEXR.File(header, {"RGB": half}).write(str(path))
            found.append(path.read_bytes())
        parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"RGB": half}, name) for name in ("a", "b")]
        OpenEXR.File(parts).write(str(path))
        return [*found, path.read_bytes()]


def _with_right_sums(content: bytes) -> bytes:
    """A PNG whose chunks' checksums fit again, so that damage gets past them."""
    found, at = bytearray(content[:8]), 8
    while at + 12 <= len(content):
        (length,) = struct.unpack(">I", content[at : at + 4])
        chunk = content[at + 4 : at + 8 + length]
        found += content[at : at + 4] + chunk + struct.pack(">I", zlib.crc32(chunk))
        at += 12 + length
    return bytes(found)


def write(random: Random, folder: Path) -> None:
    """A folder with one image and a scene `s.yaml` that has it as its sky and as a texture."""
    suffix = random.choice(list(files()))
    content = random.choice(files()[suffix])
    if suffix != "foreign" or random.random() < 0.5:
        content = mutated_bytes(random, content)
    if suffix == ".png" and random.random() < 0.7:
        content = _with_right_sums(content)
    if suffix == "foreign" or random.random() < 0.1:
        suffix = random.choice(SUFFIXES)
    (folder / f"a{suffix}").write_bytes(content)
    sky = {"environment": {"image": f"a{suffix}"}}
    texture = TREE["textures"] | {"map": TREE["textures"]["map"] | {"image": f"a{suffix}"}}
    (folder / "s.yaml").write_text(yaml.safe_dump(TREE | {"shapes": [], "lights": [sky], "textures": texture}))


def read(folder: Path) -> None:
    """Reads the image in every way there is; an image that one way takes may be refused by another."""
    (path,) = folder.glob("a.*")
    if path.suffix == ".hdr":
        engines.load_scene(folder / "s.yaml")
        return
    for look in (read_provenance, read_bitmap, read_film_layers):
        try:
            look(path)
        except SceneError as error:
            assert path.name in str(error)
    image = read_image(path)
    assert image.dtype == np.float64 and image.ndim == 3 and image.shape[2] == 3
    engines.load_scene(folder / "s.yaml")
