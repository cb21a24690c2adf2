"""Texture coordinates and transforms of meshes, and the maps of MTL files."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

import engines
from engines.errors import SceneError
from engines.scene import ImageTexture, Mask, Mixture, NormalMap, Principled
from engines.scene.geometry import face_normals

CAMERA = {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]}
MATERIALS = {
    "textured": {"diffuse": {"reflectance": "t"}},
    "plain": {"kd": 0.5},
    "brushed": {"conductor": {"metal": "Au", "alpha": [0.1, 0.2]}},
}
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def load(folder, mesh, material="textured", warnings=False):
    shape = {"mesh": mesh} | ({} if material is None else {"material": material})
    scene = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": CAMERA,
            "textures": {"t": {"checkerboard": {}}},
            "materials": MATERIALS,
            "shapes": [shape],
        },
        folder=folder,
    )
    return (scene.shapes[0], scene.warnings) if warnings else scene.shapes[0]


def corners(mesh):
    """(m, 3, 5): point and texture coordinates of each corner."""
    return np.concatenate([mesh.vertices, mesh.uvs], axis=1)[mesh.faces]


def test_vertices_of_an_obj_are_split_at_seams_and_v_is_turned_over(tmp_path):
    text = SQUARE + "vt 0 0\nvt 1 0.25\nvt 1 1\nvt 0.5\nf 1/1 2/2 3/3\nf -4/-1 -2/-2 -1/-4\n"
    (tmp_path / "m.obj").write_text(text)
    mesh = load(tmp_path, {"file": "m.obj"})
    assert len(mesh.vertices) == 5
    expected = [[[0, 0, 0, 0, 1], [1, 0, 0, 1, 0.75], [1, 1, 0, 1, 0]], [[0, 0, 0, 0.5, 1], [1, 1, 0, 1, 0], [0, 1, 0, 0, 1]]]
    assert np.array_equal(corners(mesh), expected)
    for material in ("plain", None):
        (tmp_path / "m.mtl").write_text("newmtl a\nKd 1 1 1\n")
        (tmp_path / "m.obj").write_text("mtllib m.mtl\nusemtl a\n" + text)
        plain = load(tmp_path, {"file": "m.obj"}, material)
        assert plain.uvs is None and len(plain.vertices) == 4, "a scene pays for texture coordinates where they are looked at"
    assert load(tmp_path, {"file": "m.obj"}, "brushed").uvs is not None


def test_smooth_normals_do_not_see_seams(tmp_path):
    roof = "v 0 0 0\nv 1 0 0\nv 1 1 1\nv 0 1 1\nv 1 2 0\nv 0 2 0\n"
    faces = "f 1/1 2/1 3/{a}\nf 1/1 3/{a} 4/{a}\nf 4/{b} 3/{b} 5/1\nf 4/{b} 5/1 6/1\n"
    (tmp_path / "m.obj").write_text(roof + "vt 0 0\nvt 0 1\nvt 1 1\n" + faces.format(a=2, b=3))
    seam, whole = (
        load(tmp_path, {"file": "m.obj", "smooth": True}),
        load(tmp_path, {"file": "m.obj", "smooth": True}, "plain"),
    )
    assert len(seam.vertices) == 8 and len(whole.vertices) == 6
    assert np.allclose(seam.normals[seam.faces], whole.normals[whole.faces], atol=1e-15)
    (tmp_path / "m.obj").write_text(roof + "vt 0 0\nvt 1 1\nvn 0 0 2\nvn 0 1 0\nf 1/1/1 2/2/1 3/1/2\nf 1/2/1 3/1/1 4/2/2\n")
    both = load(tmp_path, {"file": "m.obj", "smooth": True})
    assert both.normals[both.faces][:, :, 2].tolist() == [[1, 1, 0], [1, 1, 0]] and both.uvs[both.faces][1].tolist() == [
        [1, 0],
        [0, 1],
        [1, 0],
    ]


def test_corners_without_texture_coordinates_have_zero_and_wrong_ones_are_refused(tmp_path):
    (tmp_path / "m.obj").write_text(SQUARE + "vt 1 0\nf 1/1 2/1 3/1\nf 1 3 4\n")
    mesh = load(tmp_path, {"file": "m.obj"})
    assert corners(mesh)[1, :, 3:].tolist() == [[0, 0]] * 3 and corners(mesh)[0, :, 3:].tolist() == [[1, 1]] * 3
    for wrong, message in (
        ("vt a b\nf 1/1 2/1 3/1", "m.obj:5: 'a b': numbers are expected"),
        ("vt 0 0\nf 1/2 2/1 3/1", "m.obj:6: texture coordinate 2: there are 1, counted from 1"),
    ):
        (tmp_path / "m.obj").write_text(SQUARE + wrong + "\n")
        with pytest.raises(SceneError, match=message):
            load(tmp_path, {"file": "m.obj"})
        assert len(load(tmp_path, {"file": "m.obj"}, "plain").faces) == 1
    (tmp_path / "m.obj").write_text(SQUARE + "vt nan 0\nf 1/1 2/1 3/1\n")
    mesh, warnings = load(tmp_path, {"file": "m.obj"}, warnings=True)
    assert not mesh.uvs.any()
    assert "m.obj: 3 texture coordinates are infinite or not a number: they are taken as (0, 0)" in warnings


@pytest.mark.parametrize("names", ["u v", "s t", "texture_u texture_v"])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_ply_keeps_its_texture_coordinates(tmp_path, names, form):
    rows = [(0, 0, 0, 0.5, 0.25), (1, 0, 0, 1, 0), (0, 1, 0, 0, 1)]
    u, v = names.split()
    head = f"ply\nformat {form} 1.0\nelement vertex 3\n" + "".join(f"property float {n}\n" for n in ("x", "y", "z", u, v))
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    if form == "ascii":
        body = ("\n".join(" ".join(map(str, row)) for row in rows) + "\n3 0 1 2\n").encode()
    else:
        body = b"".join(struct.pack("<5f", *row) for row in rows) + struct.pack("<B3i", 3, 0, 1, 2)
    (tmp_path / "m.ply").write_bytes(head.encode() + body)
    assert np.array_equal(corners(load(tmp_path, {"file": "m.ply"}))[0], rows)


def packed(version, double, vertices, faces, normals=None, uvs=None, colors=False):
    flags = (normals is not None) + 2 * (uvs is not None) + 8 * colors + (0x2000 if double else 0x1000)
    number, name = "<f8" if double else "<f4", b"na\xc3\xafve\0" if version == 4 else b""
    body = struct.pack("<I", flags) + name + struct.pack("<QQ", len(vertices), len(faces))
    for part in (vertices, normals, uvs, np.ones((len(vertices), 3)) if colors else None):
        body += b"" if part is None else np.asarray(part).astype(number).tobytes()
    return struct.pack("<HH", 0x041C, version) + zlib.compress(body + np.asarray(faces).astype("<u4").tobytes())


def serialized(version, *meshes):
    starts = np.cumsum([0, *map(len, meshes)])[:-1]
    table = starts.astype("<u8" if version == 4 else "<u4").tobytes() + struct.pack("<I", len(meshes))
    return b"".join(meshes) + table


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("double", [False, True])
def test_serialized_files_of_every_form(tmp_path, version, double):
    points, faces, uvs = np.eye(3), [[0, 1, 2]], np.array([[0, 0.5], [1, 0], [0.25, 1]])
    first = packed(version, double, points, faces, colors=True)
    second = packed(version, double, points * 2, [[0, 2, 1]], [[0, 0, 2]] * 3, uvs)
    (tmp_path / "m.serialized").write_bytes(serialized(version, first, second))
    mesh = load(tmp_path, {"file": "m.serialized", "shape_index": 1, "smooth": True})
    assert np.array_equal(mesh.vertices, points * 2) and mesh.faces.tolist() == [[0, 2, 1]]
    assert np.array_equal(mesh.uvs, uvs) and mesh.normals.tolist() == [[0, 0, 1]] * 3
    assert load(tmp_path, {"file": "m.serialized"}).uvs is None
    with pytest.raises(SceneError, match="has 2 meshes, counted from 0: there is no mesh 2"):
        load(tmp_path, {"file": "m.serialized", "shape_index": 2})


def test_damaged_serialized_files_are_refused_and_never_unpacked_beyond_what_they_say(tmp_path):
    good, head = packed(4, True, np.eye(3), [[0, 1, 2]]), struct.pack("<HH", 0x041C, 3)
    cases = {
        "is cut short": good[:-8],
        "a mesh does not begin": b"x" + good,
        "version 7: known: 3, 4": good[:2] + b"\7\0" + good[4:],
        "its compressed data are damaged": good[:6] + b"\xff\xff" + good[8:],
        "has a face with a vertex outside": packed(4, True, np.eye(3), [[0, 1, 3]]),
        "less than 2147483648 of each are read": head + zlib.compress(struct.pack("<IQQ", 1, 2**40, 1)),
        "GiB|memory|cut short": head + zlib.compress(struct.pack("<IQQ", 1, 2**30, 2**30)),
        "has no faces": packed(3, True, np.eye(3), np.zeros((0, 3))),
        "has no end": struct.pack("<HH", 0x041C, 4) + zlib.compress(struct.pack("<I", 0) + b"x" * (1 << 20)),
    }
    for message, data in cases.items():
        (tmp_path / "m.serialized").write_bytes(data)
        with pytest.raises(SceneError, match=message) as refused:
            load(tmp_path, {"file": "m.serialized"})
        assert "\n" not in str(refused.value)


def test_texture_coordinates_may_be_listed_and_their_lack_is_warned_about(tmp_path):
    listed = {"vertices": np.eye(3), "faces": [[0, 1, 2]]}
    assert load(tmp_path, {**listed, "uvs": [[0, 1], [2, 3], [4, 5]]}).uvs.tolist() == [[0, 1], [2, 3], [4, 5]]
    mesh, warnings = load(tmp_path, listed, warnings=True)
    assert mesh.uvs is None and any(text.startswith("inline mesh has no texture coordinates: ") for text in warnings)
    assert not any("texture" in text for text in load(tmp_path, listed, "brushed", warnings=True)[1])
    for wrong, message in (([[0, 1]], r"uvs: 1 pairs for 3 vertices"), ([[0, 1, 2]], r"uvs\[0\]: must be two numbers")):
        with pytest.raises(SceneError, match=message):
            load(tmp_path, {**listed, "uvs": wrong})


def test_a_transform_takes_normals_by_its_inverse_transpose_and_keeps_the_front(tmp_path):
    (tmp_path / "m.obj").write_text("v 1 0 0\nv 0 1 0\nv 0 0 1\nvn 1 1 1\nf 1//1 2//1 3//1\n")
    for matrix in (np.diag([2.0, 1.0, 1.0]), np.diag([-2.0, 1.0, 1.0]), np.array([[0.0, 1, 0], [1, 0, 0], [0.5, 0, 3]])):
        mesh = load(tmp_path, {"file": "m.obj", "transform": matrix, "smooth": True}, "plain")
        assert np.allclose(mesh.vertices, np.eye(3) @ matrix.T)
        a, b, c = mesh.vertices[mesh.faces[0]]
        expected = np.linalg.inv(matrix).T @ np.ones(3)
        assert np.allclose(mesh.normals, expected / np.linalg.norm(expected))
        assert np.cross(b - a, c - a) @ expected > 0.0, "the geometric normal is on the side of the shading normal"
    moved = load(tmp_path, {"file": "m.obj", "transform": [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]}, "plain")
    assert np.array_equal(moved.vertices, np.eye(3) + np.array([1, 2, 3]))
    for wrong, message in (
        (np.zeros((3, 3)), "must not be singular"),
        ([[1, 0], [0, 1]], "must be a matrix of 3 x 3, 3 x 4 or 4 x 4"),
        ([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]], "must be affine"),
    ):
        with pytest.raises(SceneError, match=message):
            load(tmp_path, {"file": "m.obj", "transform": wrong}, "plain")
    with pytest.raises(SceneError, match="scale: either transform, or scale and translate"):
        load(tmp_path, {"file": "m.obj", "transform": np.eye(3), "scale": 2}, "plain")


def test_an_mtl_with_roughness_and_metal_is_principled(tmp_path):
    Image.fromarray(np.full((2, 2, 3), (255, 128, 0), np.uint8)).save(tmp_path / "wood.png")
    Image.fromarray(np.full((2, 2), 51, np.uint8)).save(tmp_path / "holes.png")
    (tmp_path / "m.mtl").write_text(
        "newmtl brass\nKd 0.9 0.7 0.2\nKs 1 1 1\nKe 0 0 1\nPr 0.3\nPm 1\nNi 1.45\nillum 3\n"
        "newmtl gel\nKd 0.5 0.5 2\nPr 3\nd 0.25\nNi 1\n"
        "newmtl board\nKd 0.5 0.5 0.5\nPm 0\nmap_Kd wood.png\nmap_d holes.png\nnorm wood.png\n"
        "Pr 0.1\nmap_Pr holes.png\nmap_Ps x.png\n"
        "newmtl plate\nKd 0.5 0.5 0.5\nmap_Pm holes.png\n"
    )
    uses = "".join(f"usemtl {name}\nf 1/1 2/2 3/3\n" for name in ("brass", "gel", "board", "plate"))
    (tmp_path / "m.obj").write_text("mtllib m.mtl\n" + SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\n" + uses)
    given = {"raybench_scene": 1, "camera": CAMERA, "shapes": [{"mesh": {"file": "m.obj"}}]}
    scene = engines.scene_from(given, folder=tmp_path)
    brass, gel, board, plate = scene.materials
    assert brass.bsdf == Principled((0.9, 0.7, 0.2), 0.3, metallic=1.0, eta=1.45) and brass.emission == (0, 0, 1)
    assert gel.bsdf == Principled((0.25, 0.25, 1.0), 1.0, eta=1.001, spec_trans=0.75)
    paint = board.bsdf.of.of
    assert isinstance(board.bsdf, Mask) and isinstance(board.bsdf.of, NormalMap) and paint.eta == 1.5
    for image in (paint.roughness, plate.bsdf.metallic):
        assert isinstance(image, ImageTexture) and np.allclose(image.pixels, 0.2), "numbers, not colours, and no tint of Pr"
    assert plate.bsdf.roughness == 0.5 and paint.metallic == 0.0
    assert isinstance(paint.base_color, ImageTexture) and paint.base_color.pixels[0, 0, 0] == 0.5 and paint.spec_trans == 0.0
    assert "m.mtl: material 'gel' returns 2 of its light: scaled down to 1" in scene.warnings
    assert "m.mtl: map_Ps is not read: material 'board'" in scene.warnings


def test_maps_of_an_mtl(tmp_path):
    (tmp_path / "maps").mkdir()
    wood = np.full((2, 2, 3), (255, 128, 0), np.uint8)
    Image.fromarray(wood).save(tmp_path / "maps" / "my wood.png")
    Image.fromarray(np.dstack([wood, [[0, 51], [102, 255]]]).astype(np.uint8)).save(tmp_path / "maps" / "leaf.png")
    (tmp_path / "maps" / "m.mtl").write_text(
        "newmtl wood\nKd 0.5 0.5 0.5\nKe 1 2 3\nmap_Kd -s 2 4 1 -o 0.25 0.5 -clamp on my wood.png\nmap_Ks x.png\n"
        "newmtl leaf\nmap_Kd my wood.png\nmap_d leaf.png\nd 0.5\nnewmtl bumpy\nKd 1 1 1\nnorm leaf.png\nbump b.png\n"
        "newmtl gone\nKd 0.25 0.25 0.25\nmap_Kd gone.png\nnewmtl outside\nmap_Kd ../../x.png\n"
    )
    names = ("wood", "leaf", "bumpy", "gone", "outside")
    uses = "".join(f"usemtl {name}\nf 1/1 2/2 3/3\n" for name in names)
    (tmp_path / "m.obj").write_text("mtllib maps/m.mtl\n" + SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\n" + uses)
    shapes = [{"mesh": {"file": "m.obj"}}]
    scene = engines.scene_from({"raybench_scene": 1, "camera": CAMERA, "shapes": shapes}, folder=tmp_path)
    wood, leaf, bumpy, gone, outside = scene.materials
    assert scene.shapes[0].uvs is not None and wood.emission == (1, 2, 3)
    assert isinstance(wood.bsdf, Mixture) and isinstance(wood.bsdf.kd, ImageTexture) and wood.bsdf.kd.wrap == "clamp"
    assert np.allclose(wood.bsdf.kd.pixels[0, 0], (0.5, 0.5 * ((128 / 255 + 0.055) / 1.055) ** 2.4, 0), rtol=1e-6)
    assert wood.bsdf.kd.to_uv == (2, 0, 0.25, 0, 4, 1 - 4 - 0.5), "v of an MTL counts upwards"
    assert isinstance(leaf.bsdf, Mask) and np.allclose(leaf.bsdf.opacity.pixels[:, :, 0], [[0, 0.2], [0.4, 1]])
    assert leaf.bsdf.of.kd.pixels.max() == 1.0, "neither Kd, which is missing, nor d darkens it"
    assert isinstance(bumpy.bsdf, NormalMap) and np.allclose(bumpy.bsdf.map.pixels[0, 0], (1, 128 / 255, 0))
    assert gone.bsdf is None and gone.kd == (0.25,) * 3 and outside.bsdf is None
    for start in (
        "m.mtl: map_Ks is not read: material 'wood'",
        "m.mtl: bump is not read: material 'bumpy'",
        "m.mtl: map_kd of material 'gone' is left out: ",
        "m.mtl: map_kd of material 'outside' is left out: ",
    ):
        assert sum(text.startswith(start) for text in scene.warnings) == 1


@pytest.mark.parametrize(
    "shape",
    [
        {"name": "rectangle", "corner": [0, 0, 0], "edge1": [2, 0, 0], "edge2": [0, 3, 0]},
        {"name": "box"},
        {"name": "terrain", "cells": 4},
        {"name": "mount", "level": 2},
        {"name": "torus_knot", "segments": 40, "sides": 5},
        {"name": "teapot", "segments": 2},
    ],
)
def test_procedural_shapes_have_texture_coordinates_where_a_texture_asks(shape):
    def made(material):
        return engines.scene_from(
            {
                "raybench_scene": 1,
                "camera": CAMERA,
                "textures": {"t": {"checkerboard": {}}},
                "materials": MATERIALS,
                "shapes": [{"procedural": shape, "material": material}],
            }
        ).shapes[0]

    plain, textured = made("plain"), made("textured")
    assert plain.uvs is None and np.array_equal(plain.vertices[plain.faces], textured.vertices[textured.faces])
    assert (textured.uvs.min(), textured.uvs.max()) == (0.0, 1.0)
    uvs, points = textured.uvs[textured.faces], textured.vertices[textured.faces]
    (u1, v1), (u2, v2) = (uvs[:, corner].T - uvs[:, 0].T for corner in (1, 2))
    assert (u1 * v2 < u2 * v1).all(), "seen from the front no picture is mirrored"
    if shape["name"] == "box":
        walls = np.abs(face_normals(textured.vertices, textured.faces)[:, 1]) < 1e-9
        assert walls.sum() == 8 and np.array_equal(uvs[walls][:, :, 1], (1 - points[walls][:, :, 1]) / 2)
