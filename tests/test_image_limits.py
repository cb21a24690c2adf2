"""Small files that would unpack to gigabytes are refused from their headers, and what is read takes bounded memory."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image as Pillow

from engines.image import MAX_CHANNELS, MAX_PIXELS, SMALL_PIXELS
from tests.needs import needs

LITTLE, MUCH = 128, 1536
"""MiB: for a refusal, and for the largest image of a small file (0.75 GiB of float64)."""


def png(width: int, height: int) -> bytes:
    """A black image of one bit a pixel."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(bytes((width // 8 + 1) * height), 9)
    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def jpeg(path: Path, width: int, height: int) -> None:
    Pillow.new("L", (16, 24)).save(path)
    path.write_bytes(path.read_bytes().replace(struct.pack(">HH", 24, 16), struct.pack(">HH", height, width), 1))


def tiff(width: int, height: int, tile: int) -> bytes:
    """Grey and deflated, with tiles of `tile` x `tile` of which one is there."""
    data = zlib.compress(bytes(1000))
    entries = {256: width, 257: height, 258: 8, 259: 8, 262: 1, 277: 1, 322: tile, 323: tile, 324: 134, 325: len(data)}
    packed = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(entries.items()))
    return b"II*\0" + struct.pack("<IH", 8, len(entries)) + packed + struct.pack("<I", 0) + data


def bmp(width: int, height: int) -> bytes:
    """Run-length encoded, without a run."""
    head = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, 1, 0, 0, 0, 256, 0)
    return b"BM" + struct.pack("<IHHI", 1080, 0, 0, 1078) + head + bytes(1024) + b"\0\1"


def webp(width: int, height: int) -> bytes:
    """An extended header alone, and pixels of a smaller image."""
    canvas = b"".join(struct.pack("<I", size - 1)[:3] for size in (width, height))
    extended = b"VP8X" + struct.pack("<I", 10) + bytes(4) + canvas
    return b"RIFF" + struct.pack("<I", len(extended) + 4) + b"WEBP" + extended


def windowed(path: Path, window: tuple[int, int, int, int], channels: int = 1) -> None:
    """An EXR that says that its pixels lie in another window than they do."""
    pixels = {f"c{index}": np.zeros((8, 8), np.float16) for index in range(channels - 1)} | {"Y": np.zeros((8, 8), np.float16)}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, pixels).write(str(path))
    data = bytearray(path.read_bytes())
    at = data.index(b"dataWindow\0box2i\0") + 21
    data[at : at + 16] = struct.pack("<iiii", *window)
    path.write_bytes(data)


READ = """
import json, sys, time
import numpy, OpenEXR, PIL.Image
import engines
from engines import image
def peak(): return int([l for l in open("/proc/self/status") if l.startswith("VmHWM")][0].split()[1]) / 1024
before = peak()
sky = {"raybench_scene": 1, "camera": {"type": "perspective", "eye": [0, 1, 5], "target": [0, 1, 0]}}
for name in sys.argv[1:]:
    readers = [image.read_image, image.read_provenance,
               lambda name: engines.scene_from(sky | {"lights": [{"environment": {"image": name}}]})]
    said = []
    for read in readers:
        try: said.append(str(getattr(read(name), "shape", "read")))
        except engines.SceneError as error: said.append(str(error))
    print(json.dumps([name, said, peak() - before]), flush=True)
"""


def read(folder: Path, *names: str) -> list[tuple[str, list[str], float]]:
    """(name, what `read_image`, `read_provenance` and a scene said, MiB taken so far), all in one new process."""
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(root)!r})\n{READ}", *names],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]


@needs("linux")
def test_images_too_large_for_their_files_are_refused_before_they_are_decoded(tmp_path):
    wide, high = 16_384, MAX_PIXELS // 16_384
    (tmp_path / "a.png").write_bytes(png(wide, high))
    (tmp_path / "b.png").write_bytes(png(2**31 - 1, 1))
    jpeg(tmp_path / "a.jpg", 12_000, 12_000)
    Pillow.new("1", (wide, high)).save(tmp_path / "a.tif", compression="group4")
    (tmp_path / "tile.tif").write_bytes(tiff(8, 8, 30_000))
    (tmp_path / "a.bmp").write_bytes(bmp(wide, high))
    (tmp_path / "a.webp").write_bytes(webp(2**24 - 1, 200))
    windowed(tmp_path / "a.exr", (0, 0, wide - 1, high - 1))
    windowed(tmp_path / "b.exr", (-(2**31), -(2**31), 2**31 - 1, 2**31 - 1))
    windowed(tmp_path / "many.exr", (0, 0, 8191, 4095), channels=MAX_CHANNELS + 1)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert max(path.stat().st_size for path in tmp_path.iterdir()) < 2_000_000
    for name, (image, provenance, scene), mebibytes in read(tmp_path, *names):
        assert image.startswith(f"{name}: ") and name in scene
        assert name in provenance or provenance == "read"
        assert mebibytes < LITTLE, f"{name} took {mebibytes} MiB"


@needs("linux", "memory")
def test_the_largest_image_of_a_small_file_takes_bounded_memory(tmp_path):
    wide, high = 8192, SMALL_PIXELS // 8192
    (tmp_path / "a.png").write_bytes(png(wide, high))
    ((_, (image, _, scene), mebibytes),) = read(tmp_path, "a.png")
    assert image == f"({high}, {wide}, 3)" and scene == "read" and mebibytes < MUCH


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.bmp"])
def test_one_pixel_more_than_the_limit_is_refused(tmp_path, name):
    high = SMALL_PIXELS // 8192 + 1
    (tmp_path / "a.png").write_bytes(png(8192, high))
    (tmp_path / "a.bmp").write_bytes(bmp(8192, high))
    windowed(tmp_path / "a.exr", (0, 0, 8191, high - 1))
    ((_, (image, _, _), _),) = read(tmp_path, name)
    assert image == f"{name}: has 8192 x {high} pixels: at most {SMALL_PIXELS} are read from a file of its size"
