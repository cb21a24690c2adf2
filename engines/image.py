"""Image files: films and arrays to OpenEXR (float32) or 8-bit formats, and back to linear float64.

EXR holds linear radiance in R, G, B, for a film also the layers `variance` (of the mean), `half0` and `half1`, and the
provenance as JSON in the header attribute `raybench`. PNG holds it in a text chunk of that name; the other formats have
no room for it. 8-bit files are sRGB-encoded. Files appear whole or not at all.
"""

from __future__ import annotations

import io
import json
import os
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.errors import ConfigError, SceneError, suggestion
from engines.input_files import open_regular, unreadable
from engines.memory import lacking_memory
from engines.tonemap import to_bitmap

Image = NDArray[np.float64]
FilePath = str | PathLike[str]

ATTRIBUTE = "raybench"
LAYERS = ("variance", "half0", "half1")
FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".bmp": "BMP", ".tif": "TIFF", ".tiff": "TIFF", ".webp": "WEBP"}
BITMAPS = tuple(FORMATS)
SUFFIXES = (".exr", *BITMAPS)
PILLOW_FORMATS = tuple(dict.fromkeys(FORMATS.values()))
"""Pillow goes by content, not by name, and starts a program for some formats (Ghostscript for EPS): it may try these alone."""
MAX_PIXELS = 1 << 27
"""Largest image that is read, 16384 x 8192: 3 GiB in float64."""
SMALL_PIXELS = 1 << 25
"""Largest image, 8192 x 4096, of a file that has fewer bytes than pixels: more is not unpacked from next to nothing."""
BYTES_PER_PIXEL = 32
"""Memory at the height of reading: float64 beside what the decoder gave."""
TILE_WIDTH, TILE_HEIGHT = 322, 323
"""Tags of a TIFF."""
MAX_CHANNELS = 16
"""Channels of an EXR, over all its parts, for each pixel of the limits above; a film of ours has twelve."""


class FilmLayers(NamedTuple):
    """What a film puts into an EXR: four images (h, w, 3), float64 with the precision of float32."""

    mean: Image
    variance: Image
    half0: Image
    half1: Image


# --- writing --------------------------------------------------------------------------------------------------------


def write_film_layers(path: FilePath, layers: FilmLayers, provenance: Mapping[str, Any] | None = None) -> None:
    """Writes a film to an `.exr` file. Raises `ConfigError`."""
    images = {"RGB": layers.mean, **{name: getattr(layers, name) for name in LAYERS}}
    write_channels(path, images, provenance or {})


def write_image(path: FilePath, array: ArrayLike, provenance: Mapping[str, Any] | None = None) -> None:
    """Writes (h, w, 3) linear radiance, or (h, w, 3) uint8 as it is to a bitmap, (h, w, 4) uint8 with alpha to a PNG. Raises
    `ConfigError`."""
    image = np.asarray(array)
    channels = (3, 4) if image.dtype == np.uint8 and _suffix(path) == ".png" else (3,)
    if image.ndim != 3 or image.shape[2] not in channels or 0 in image.shape:
        raise ConfigError(f"{os.fspath(path)}: an image of shape (height, width, 3) is expected, not {image.shape}")
    if _suffix(path) == ".exr":
        write_channels(path, {"RGB": image}, provenance or {})
    else:
        _write_bitmap(path, image if image.dtype == np.uint8 else to_bitmap(image), provenance or {})


def png_bytes(bitmap: NDArray[np.uint8], provenance: Mapping[str, Any] | None = None) -> bytes:
    """A bitmap (h, w, 3) uint8, or (h, w, 4) with alpha, as the bytes of a PNG file."""
    from PIL.PngImagePlugin import PngInfo

    text = PngInfo()
    if provenance:
        text.add_text(ATTRIBUTE, _json(provenance))
    return _encoded(bitmap, "PNG", pnginfo=text)


def write_channels(path: FilePath, layers: Mapping[str, NDArray[Any]], provenance: Mapping[str, Any] | None = None) -> None:
    """Writes an EXR of channels (h, w), or of groups of channels (h, w, 3) such as "RGB": half floats where the array holds
    them, float32 elsewhere. Raises `ConfigError`."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if provenance:
        header[ATTRIBUTE] = _json(provenance)
    with np.errstate(over="ignore"):
        channels = {
            name: np.ascontiguousarray(image, np.float16 if image.dtype == np.float16 else np.float32)
            for name, image in layers.items()
        }
    _replace(path, lambda temporary: OpenEXR.File(header, channels).write(str(temporary)))


def _write_bitmap(path: FilePath, bitmap: NDArray[np.uint8], provenance: Mapping[str, Any]) -> None:
    suffix = _suffix(path)
    if suffix == ".png":
        data = png_bytes(bitmap, provenance)
    else:
        options = {"JPEG": {"quality": 95}, "WEBP": {"lossless": True}}.get(FORMATS[suffix], {})
        data = _encoded(bitmap, FORMATS[suffix], **options)
    _replace(path, lambda temporary: temporary.write_bytes(data))


def _encoded(bitmap: NDArray[np.uint8], name: str, **options: Any) -> bytes:
    from PIL import Image as Pillow

    buffer = io.BytesIO()
    Pillow.fromarray(np.ascontiguousarray(bitmap, np.uint8)).save(buffer, name, **options)
    return buffer.getvalue()


def _replace(path: FilePath, write: Callable[[Path], Any]) -> None:
    """Writes beside `path` and renames, so that a reader sees the old file or the new one."""
    target = Path(path)
    if not target.parent.is_dir():
        raise ConfigError(f"{target}: there is no folder {target.parent}")
    if target.is_dir():
        raise ConfigError(f"{target}: is a folder: the name of a file is expected")
    temporary = target.with_name(f".{target.name[:100]}.{uuid.uuid4().hex}.tmp")
    try:
        write(temporary)
        temporary.replace(target)
    except (OSError, RuntimeError) as problem:
        raise ConfigError(f"{target}: cannot be written: {getattr(problem, 'strerror', None) or problem}") from problem
    finally:
        temporary.unlink(missing_ok=True)


def _suffix(path: FilePath) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise ConfigError(f"{os.fspath(path)}: unknown image format {suffix!r}: {suggestion(suffix, SUFFIXES)}")
    return suffix


def _json(provenance: Mapping[str, Any]) -> str:
    return json.dumps(dict(provenance), default=str)


# --- reading --------------------------------------------------------------------------------------------------------


def read_image(path: FilePath) -> Image:
    """(h, w, 3) linear float64 of an EXR (R, G, B, or grey Y) or of an 8-bit file, decoded from sRGB.

    Raises `SceneError` naming the file when it is missing, no regular file, unreadable, corrupt, too large (known from
    its header, before anything is decoded) or of an unknown format.
    """
    file = readable(path)
    if file.suffix.lower() == ".exr":
        return _rgb(file, exr_channels(file), "")
    return decoded_srgb(_bitmap(file))


def read_bitmap(path: FilePath) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 of an 8-bit file, as they are. Raises `SceneError` like `read_image`."""
    file = readable(path)
    if file.suffix.lower() == ".exr":
        raise SceneError(f"{file}: an 8-bit image is expected: one of {', '.join(BITMAPS)}")
    return _bitmap(file)


def read_film_layers(path: FilePath) -> FilmLayers:
    """The layers of an EXR that `write_film_layers` wrote. Raises `SceneError` where one is missing."""
    file = readable(path)
    if file.suffix.lower() != ".exr":
        raise SceneError(f"{file}: only .exr files have layers")
    channels = exr_channels(file)
    return FilmLayers(_rgb(file, channels, ""), *(_rgb(file, channels, f"{layer}.") for layer in LAYERS))


def read_provenance(path: FilePath) -> dict[str, Any]:
    """The provenance of an EXR or PNG file of ours; empty where there is none."""
    file = readable(path)
    if file.suffix.lower() == ".exr":
        text = _opened_exr(file, header_only=True).header().get(ATTRIBUTE)
    else:
        with opened_bitmap(file) as image:
            text = image.info.get(ATTRIBUTE)  # `text` would decode the pixels
    try:
        found = json.loads(text) if isinstance(text, str) else {}
    except ValueError as problem:
        raise SceneError(f"{file}: its provenance is not JSON: {problem}") from problem
    return found if isinstance(found, dict) else {}


def readable(path: FilePath, suffixes: Sequence[str] = SUFFIXES) -> Path:
    """The path of a regular file that is not empty and has one of these suffixes. Raises `SceneError`."""
    file = Path(path)
    if file.suffix.lower() not in suffixes:
        raise SceneError(f"{file}: unknown image format {file.suffix!r}: {suggestion(file.suffix, suffixes)}")
    try:
        with open_regular(file) as stream:
            empty = not stream.read(1)
    except (OSError, ValueError) as problem:
        raise SceneError(f"{file}: {unreadable(problem)}") from problem
    if empty:
        raise SceneError(f"{file}: is empty")
    return file


@contextmanager
def decoding(file: Path) -> Iterator[None]:
    """Turns whatever a decoder raises inside the block into a `SceneError` naming the file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except SceneError:
        raise
    except MemoryError as problem:
        raise SceneError(f"{file}: is not a usable image: decoding it takes more memory than there is") from problem
    except Exception as problem:
        raise SceneError(f"{file}: is not a usable image: {problem or type(problem).__name__}") from problem


def _opened_exr(file: Path, header_only: bool) -> Any:
    import OpenEXR

    with decoding(file):
        return OpenEXR.File(str(file), separate_channels=True, header_only=header_only)


def exr_channels(file: Path) -> dict[str, NDArray[Any]]:
    """The channels of an EXR by name, each (h, w). Raises `SceneError`."""
    import OpenEXR

    limit, samples = most_pixels(file), 0
    with decoding(file):
        parts = _opened_exr(file, header_only=True).parts
        for part in parts:
            if part.type() not in (OpenEXR.scanlineimage, OpenEXR.tiledimage):
                raise SceneError(f"{file}: holds deep data: an EXR of one value for each pixel and channel is expected")
            (left, top), (right, bottom) = part.header["dataWindow"]
            width, height = int(right) - int(left) + 1, int(bottom) - int(top) + 1
            check_size(file, width, height, limit)
            samples += width * height * len(part.header["channels"])
        if samples > MAX_CHANNELS * limit:
            raise SceneError(f"{file}: has {samples} values: at most {MAX_CHANNELS * limit} are read from a file of its size")
        _check_memory(file, 4.0 * samples)
        opened = _opened_exr(file, header_only=False)
        if len(opened.parts) != len(parts):  # a part that cannot be decoded is left out
            raise SceneError(f"{file}: is not a usable image: its pixels are damaged or cut short")
        return {name: channel.pixels for name, channel in opened.channels().items()}


def _rgb(file: Path, channels: Mapping[str, NDArray[Any]], prefix: str) -> Image:
    names = [prefix + channel for channel in "RGB"]
    if prefix == "" and "Y" in channels and "R" not in channels:
        names = ["Y"] * 3
    missing = [name for name in names if name not in channels]
    if missing:
        raise SceneError(f"{file}: channel {missing[0]!r} is missing: it has {', '.join(sorted(channels))}"[:500])
    with decoding(file):
        return np.stack([channels[name] for name in names], axis=2, dtype=np.float64, casting="safe")


@contextmanager
def opened_bitmap(file: Path, formats: tuple[str, ...] = PILLOW_FORMATS, data: bytes | None = None) -> Iterator[Any]:
    """Pillow's image of a file of one of these formats, or of `data` within it; its header is read, its pixels are not."""
    from PIL import Image as Pillow
    from PIL import UnidentifiedImageError

    try:
        with decoding(file), _stream(file, data) as stream, Pillow.open(stream, formats=formats) as image:
            yield image
    except SceneError as problem:
        if isinstance(problem.__cause__, Pillow.DecompressionBombError):
            raise SceneError(f"{file}: has more pixels than the {MAX_PIXELS} that are read of any file") from problem
        if isinstance(problem.__cause__, UnidentifiedImageError):
            expected = ", ".join(formats)
            raise SceneError(f"{file}: is not a usable image: the content of one of {expected} is expected") from problem
        raise


def _stream(file: Path, data: bytes | None) -> BinaryIO:
    return open_regular(file) if data is None else io.BytesIO(data)


def _bitmap(file: Path) -> NDArray[np.uint8]:
    with opened_bitmap(file) as image:
        check_bitmap(file, image)
        return np.asarray(image.convert("RGB"))


def check_bitmap(file: Path, image: Any, size: int | None = None) -> None:
    """Refuses an image of Pillow's by its header; it has `size` bytes, or those of the file. Raises `SceneError`."""
    width, height = image.size
    check_size(file, width, height, most_pixels(file, size))
    tags = getattr(image, "tag_v2", {})
    if TILE_WIDTH in tags and TILE_HEIGHT in tags:  # a TIFF's tiles may be larger than the image, and are decoded whole
        check_size(file, tags[TILE_WIDTH], tags[TILE_HEIGHT], SMALL_PIXELS)


def decoded_srgb(bitmap: NDArray[np.uint8]) -> Image:
    """Linear values of sRGB-encoded ones."""
    x = np.arange(256) / 255.0
    linear = np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
    return linear[bitmap]


def most_pixels(file: Path, size: int | None = None) -> int:
    """How many pixels a file of its size, or of `size` bytes, may have."""
    return min(MAX_PIXELS, max(SMALL_PIXELS, file.stat().st_size if size is None else size))


def check_size(file: Path, width: int, height: int, most: int) -> None:
    """Refuses an image of more than `most` pixels, or of more than memory holds. Raises `SceneError`."""
    if not 0 < width * height <= most:
        raise SceneError(f"{file}: has {width} x {height} pixels: at most {most} are read from a file of its size")
    _check_memory(file, float(width) * height * BYTES_PER_PIXEL)


def _check_memory(file: Path, needed: float) -> None:
    if lacks := lacking_memory(needed):
        raise SceneError(f"{file}: reading it {lacks}")
