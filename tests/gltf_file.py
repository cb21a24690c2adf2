"""Small glTF files, written by the tests themselves."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
"""Its uvs are those of an image whose lower edge lies along x."""
UVS = [[0, 1], [1, 1], [1, 0], [0, 0]]
CORNERS = [0, 1, 2, 0, 2, 3]


class GltfFile:
    """JSON `tree`, whose mesh 0 is a square of 1 m in the plane z = 0 that faces +z, and the bytes of its buffer."""

    def __init__(self, **attributes: Any) -> None:
        """`attributes` of the square, beside POSITION and TEXCOORD_0, are indices of accessors."""
        self.data = b""
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}
        self.tree |= {"nodes": [{"mesh": 0}], "accessors": [], "bufferViews": []}
        own = {"POSITION": self.accessor(SQUARE), "TEXCOORD_0": self.accessor(UVS)}
        self.primitive: dict[str, Any] = {"attributes": own | attributes, "indices": self.accessor(CORNERS, "u2")}
        self.tree["meshes"] = [{"primitives": [self.primitive]}]

    def view(self, data: bytes, **keys: Any) -> int:
        """The index of a new buffer view."""
        self.data += b"\0" * (-len(self.data) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **keys})
        self.data += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, rows: Any, dtype: str = "f4", **keys: Any) -> int:
        """The index of a new accessor with these rows of numbers."""
        array = np.array(rows, f"<{dtype}")
        array = array.reshape(len(array), -1)
        item = {"bufferView": self.view(array.tobytes()), "componentType": CODES[dtype], "count": len(array)}
        self.tree["accessors"].append({**item, "type": TYPES[array.shape[1]], **keys})
        return len(self.tree["accessors"]) - 1

    def add(self, kind: str, **item: Any) -> int:
        """The index of a new item of a list of the tree."""
        self.tree.setdefault(kind, []).append(item)
        return len(self.tree[kind]) - 1

    def image(self, texels: Any) -> dict[str, int]:
        """A texture with these (h, w, c) bytes, as materials name it; its image is a PNG within the buffer."""
        import io

        from PIL import Image

        buffer = io.BytesIO()
        Image.fromarray(np.array(texels, np.uint8)).save(buffer, "PNG")
        source = self.add("images", bufferView=self.view(buffer.getvalue()), mimeType="image/png")
        return {"index": self.add("textures", source=source)}

    def material(self, extensions: dict[str, Any] | None = None, **keys: Any) -> None:
        """Gives the square a material of these keys."""
        self.primitive["material"] = self.add("materials", name="paint", extensions=extensions or {}, **keys)

    def glb(self) -> bytes:
        """A binary file."""
        text = json.dumps({**self.tree, "buffers": [{"byteLength": len(self.data)}]}).encode()
        text += b" " * (-len(text) % 4)
        binary = self.data + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def gltf(self, uri: str = "") -> str:
        """A text file, with a data URI or the name of a file of the buffer."""
        uri = uri or "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        return json.dumps({**self.tree, "buffers": [{"byteLength": len(self.data), "uri": uri}]})

    def write(self, folder: Path) -> Path:
        """A `.glb` in the folder."""
        (folder / "m.glb").write_bytes(self.glb())
        return folder / "m.glb"
