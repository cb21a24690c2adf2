"""Mesh files (OBJ, MTL, PLY, STL), damaged or under a suffix that is not theirs."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from random import Random

import numpy as np
import trimesh
import yaml

import engines
from tests.fuzz.mutate import mutated_bytes, mutated_text
from tests.fuzz.scenes import IMAGE, TREE


def _exported(kind: str, **options: str) -> bytes:
    found = trimesh.creation.icosphere(1).export(file_type=kind, **options)
    return found if isinstance(found, bytes) else found.encode()


def _serialized() -> bytes:
    """One mesh of version 4: double precision, normals and texture coordinates."""
    numbers = np.linspace(0.0, 1.0, 3 * (3 + 3 + 2)).tobytes()
    body = struct.pack("<I", 0x2003) + b"name\0" + struct.pack("<QQ", 3, 1) + numbers + struct.pack("<3I", 0, 1, 2)
    return struct.pack("<HH", 0x041C, 4) + zlib.compress(body) + struct.pack("<QI", 0, 1)


OBJ = b"mtllib m.mtl\n" + _exported("obj") + b"\nusemtl a\nvn 0 0 1\nf 1//1 2//1 \\\n-1//-1 4//1\nusemtl b\nf 1/1 2/1 3/1\n"
FILES = {
    "m.obj": OBJ,
    "m.mtl": b"newmtl a\nKd 0.5 0.4 0.3\nmap_d -s 2 2 -o 1 wood.png\nKs 0.1 0.1 0.1\nillum 3\nmap_Kd wood.png\n"
    b"newmtl b\nKe 17 12 4\nNi 1.5\nillum 7\n",
    "m.ply": _exported("ply"),
    "ascii.ply": _exported("ply", encoding="ascii"),
    "m.serialized": _serialized(),
    "m.stl": _exported("stl"),
    "ascii.stl": _exported("stl_ascii"),
}
TEXTS = ("m.obj", "m.mtl", "ascii.ply", "ascii.stl")


def write(random: Random, folder: Path) -> None:
    """A folder with a mesh, its MTL where it is an OBJ, and a scene `s.yaml` that names the mesh."""
    name = random.choice(list(FILES))
    content = FILES[name]
    if name in TEXTS and random.random() < 0.5:
        content = mutated_text(random, content.decode()).encode()
    else:
        content = mutated_bytes(random, content)
    if random.random() < 0.1:
        name = "m" + random.choice((".obj", ".ply", ".stl", ".serialized"))
    for kept in ("m.obj", "m.mtl"):
        (folder / kept).write_bytes(FILES[kept])
    for image in ("wood.png", "t.png"):
        (folder / image).write_bytes(IMAGE)
    (folder / name).write_bytes(content)
    mesh = {"file": "m.obj" if name == "m.mtl" else name, "smooth": random.random() < 0.5}
    own_materials = name == "m.mtl" or (name == "m.obj" and random.random() < 0.5)
    shape = {"mesh": mesh} | ({} if own_materials else {"material": random.choice(("m", "paint"))})
    (folder / "s.yaml").write_text(yaml.safe_dump(TREE | {"shapes": [shape]}))


def read(folder: Path) -> None:
    """Loads; every face must have its vertices and every number be finite."""
    (mesh,) = engines.load_scene(folder / "s.yaml").shapes
    assert np.isfinite(mesh.vertices).all() and mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)
    assert mesh.normals is None or np.isfinite(mesh.normals).all()
    assert mesh.uvs is None or (len(mesh.uvs) == len(mesh.vertices) and np.isfinite(mesh.uvs).all())
