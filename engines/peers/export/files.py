"""The meshes and images that lie beside an exported scene."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.image import write_image
from engines.scene.attributes import Attributes
from engines.scene.formats.ply import write_ply

Array = NDArray[Any]


def numbers(values: Iterable[float]) -> str:
    """Each in the fewest digits that read back as the same double."""
    return " ".join(repr(float(value)) for value in values)


class Beside:
    """Writes into the folder `<name>_files` beside `path`; names are relative to the folder of `path`."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent / f"{path.stem}_files"
        self.meshes = 0

    def mesh(
        self,
        name: str,
        vertices: Array,
        faces: Array,
        normals: Array | None = None,
        uvs: Array | None = None,
        attributes: Attributes | None = None,
    ) -> str:
        """A binary PLY file; `name` does not matter."""
        self.folder.mkdir(exist_ok=True)
        file = self.folder / f"mesh_{self.meshes}.ply"
        self.meshes += 1
        write_ply(file, vertices, faces, normals, uvs, attributes=attributes)
        return f"{self.folder.name}/{file.name}"

    def image(self, name: str, image: Array) -> dict[str, Any]:
        """An EXR file, of three equal channels where the image has one."""
        self.folder.mkdir(exist_ok=True)
        write_image(self.folder / f"{name}.exr", np.repeat(image, 3, axis=2) if image.shape[2] == 1 else image, {})
        return {"filename": f"{self.folder.name}/{name}.exr"}
