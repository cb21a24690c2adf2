"""Meshes from files: OBJ with MTL, PLY and STL keep their faces in order; what cannot be used is refused by name."""

from __future__ import annotations

import struct
import time

import numpy as np
import pytest
import trimesh

import engines
from engines.errors import SceneError

TETRA = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
TETRA_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 1.5 0\n"


def scene(folder, file="m.obj", material="m", **options):
    data = {
        "raybench_scene": 1,
        "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]},
        "materials": {"m": {"kd": 0.5}},
        "shapes": [{"mesh": {"file": file, **options}} | ({"material": material} if material else {})],
    }
    return engines.scene_from(data, folder=folder)


def obj(folder, text, **options):
    (folder / "m.obj").write_bytes(text if isinstance(text, bytes) else text.encode())
    return scene(folder, **options).shapes[0]


def test_polygons_become_fans_in_the_order_of_the_file(tmp_path):
    mesh = obj(tmp_path, CORNERS + "f 1 2 3 4 5\nf 1 2 3\nf 1 2 3 4\n")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 1, 2], [0, 1, 2], [0, 2, 3]]
    assert mesh.vertices.shape == (5, 3) and mesh.normals is None


def test_negative_indices_count_from_where_they_stand(tmp_path):
    mesh = obj(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nv 6 5 5\nf -5 -1 -2\nf 1 2 -1\n")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 4, 3], [0, 1, 4]]


@pytest.mark.parametrize("form", ["{}", "{}/1", "{}/1/1", "{}//1", "{}/"])
def test_every_form_of_corner_is_read(tmp_path, form):
    text = CORNERS + "vt 0 0\nvn 0 0 1\nf " + " ".join(form.format(i) for i in (1, 2, 3, 4)) + "\n"
    assert obj(tmp_path, text).faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_crlf_tabs_comments_colours_weights_and_continuations_are_read(tmp_path):
    text = "# c\r\nv\t0 0 0 1\r\nv 1 0 0 # x\r\n  v 0 1 0 .5 .5 .5\r\ng a\r\ns off\r\nf 1 2 \\\r\n3 # end\r\nl 1 2\r\n"
    assert obj(tmp_path, text).faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nf 1 2 3\n", r"m\.obj:2: vertex 2: there are 1"),
        (CORNERS + "f 1 2 0\n", r"m\.obj:6: vertex 0: there are 5, counted from 1"),
        (CORNERS + "f 1 2 -6\n", r"m\.obj:6: vertex -6: there are 5"),
        ("f -1 -2 -3\n" + CORNERS, r"m\.obj:1: vertex -1"),
        (CORNERS + "f 1 2\n", r"m\.obj:6: a face wants at least three corners"),
        (CORNERS + "f 1 2 x\n", r"m\.obj:6: '1 2 x': not a list of corners"),
        (CORNERS + "f 1/1/1/1 2/1/1/1 3/1/1/1\n", r"m\.obj:6: .*not a list of corners"),
        (CORNERS + "vn 0 0 1\nf 1//1 2//x 3//1\n", r"m\.obj:7: .*not a list of corners"),
        (CORNERS + "f 1 2 /3\n", r"m\.obj:6: '1 2 /3': not a list of corners"),
        (CORNERS + "f 1 2 99999999999999999999999\n", r"m\.obj:6: .*not a list of corners"),
        ("v 0 0\nf 1 1 1\n", r"m\.obj:1: '0 0': three numbers are expected"),
        ("v 0 0 zero\nf 1 1 1\n", r"m\.obj:1: '0 0 zero': three numbers are expected"),
        ("v 0 nan 0\nf 1 1 1\n", r"m\.obj:1: '0 nan 0': finite numbers are expected"),
        ("v 0 0 0\nv 0 0 1e999\nf 1 1 1\n", r"m\.obj:2: '0 0 1e999': finite numbers are expected"),
        (CORNERS, "not an OBJ file with faces"),
        ("hello world\n", "not an OBJ file with faces"),
        ("", "is empty"),
        (" \n\n", "is empty"),
        (b"\x00\x01\x02\xff", "binary data"),
    ],
)
def test_wrong_obj_files_are_refused_with_the_line(tmp_path, text, message):
    with pytest.raises(SceneError, match=message) as caught:
        obj(tmp_path, text)
    assert str(caught.value).startswith("shapes[0].mesh.file")


def test_missing_and_unknown_files_are_refused(tmp_path):
    with pytest.raises(SceneError, match=r"shapes\[0\].mesh.file = 'no.obj': no such file: looked in"):
        scene(tmp_path, "no.obj")
    (tmp_path / "m.fbx").write_text("x")
    with pytest.raises(SceneError, match=r"unknown kind of mesh file: known: .obj, .ply, .stl"):
        scene(tmp_path, "m.fbx")
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(SceneError, match="is not a regular file but a folder"):
        scene(tmp_path, "folder.obj")


def test_normals_are_used_only_when_smooth(tmp_path):
    text = CORNERS + "vn 0 0 2\nvn 1 0 1\nf 1//1 2//1 3//2\nf 1//1 3//2 4//-2\nf 2//2 3//2 5//1\n"
    assert obj(tmp_path, text).normals is None
    mesh = obj(tmp_path, text, smooth=True)
    flat = obj(tmp_path, text)
    assert np.array_equal(mesh.vertices[mesh.faces], flat.vertices[flat.faces])
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1)
    expected = np.array([[0, 0, 1], [0.5**0.5, 0, 0.5**0.5]])[[[0, 0, 1], [0, 1, 0], [1, 1, 0]]]
    assert np.allclose(mesh.normals[mesh.faces], expected)


def test_smooth_without_normals_in_the_file_makes_them_from_the_faces(tmp_path):
    sphere = trimesh.creation.icosphere(3)
    sphere.export(tmp_path / "m.stl")
    sphere.export(tmp_path / "m.ply", vertex_normal=False)
    mesh = scene(tmp_path, "m.ply", smooth=True, translate=[1, 2, 3]).shapes[0]
    assert (np.einsum("ij,ij->i", mesh.normals, mesh.vertices - [1, 2, 3]) > 0.999).all()
    assert scene(tmp_path, "m.stl", smooth=True).shapes[0].normals is not None


def test_normals_follow_an_uneven_scale(tmp_path):
    text = "v 0 0 0\nv 1 0 1\nv 0 1 0\nvn -1 0 1\nf 1//1 2//1 3//1\n"
    mesh = obj(tmp_path, text, smooth=True, scale=[2, 1, 1])
    edge = mesh.vertices[mesh.faces[0, 1]] - mesh.vertices[mesh.faces[0, 0]]
    assert np.allclose(mesh.normals @ edge, 0) and np.allclose(np.linalg.norm(mesh.normals, axis=1), 1)


MTL = """\
newmtl plain
Kd 0.5 0.25 0.125
Ks 0.4 0.4 0.4
Ni 1.5
illum 2
newmtl mirror
Kd 0.1 0.1 0.1
Ks 0.8 0.8 0.8
illum 3
newmtl clear
Kd 0.2 0.2 0.2
Tf 1 0.5 0.5
d 0.25
Ni 1.33
illum 4
newmtl lamp
Kd 0 0 0
Ke 17 12 4
newmtl glass
Kd 0 0 0
Ks 1 1 1
Tf 1 1 1
Tr 1
Ni 1.5
illum 7
newmtl bright
Kd 0.8 0.8 0.8
Ks 0.8 0.4 0.4
illum 3
map_Kd wood.png
newmtl never used
Kd 2 2 2
"""
NAMES = ("lamp", "plain", "mirror", "clear", "glass", "bright")


def with_mtl(folder, mtl=MTL, names=NAMES, head="mtllib m.mtl\n"):
    (folder / "m.mtl").write_text(mtl)
    (folder / "m.obj").write_text(head + CORNERS + "".join(f"usemtl {name}\nf 1 2 3\nf 1 3 4\n" for name in names))
    return scene(folder, material=None)


def test_mtl_materials_become_ours(tmp_path):
    found = with_mtl(tmp_path)
    mesh = found.shapes[0]
    by_name = {material.name: material for material in found.materials}
    assert [found.materials[i].name for i in mesh.materials] == [name for name in NAMES for _ in range(2)]
    plain, mirror, clear, glass = (by_name[name] for name in ("plain", "mirror", "clear", "glass"))
    assert plain.kd == (0.5, 0.25, 0.125) and plain.ks == plain.kt == (0, 0, 0) and plain.ior == 1.0
    assert mirror.kd == (0.1,) * 3 and mirror.ks == (0.8,) * 3
    assert clear.kd == (0.05,) * 3 and clear.kt == (0.75, 0.375, 0.375) and clear.ior == 1.33 and not clear.fresnel
    assert by_name["lamp"].emission == (17, 12, 4) and not by_name["lamp"].two_sided
    assert glass.fresnel and glass.ks == glass.kt == (1, 1, 1) and glass.ior == 1.5 and glass.kd == (0, 0, 0)
    bright = by_name["bright"]
    assert bright.kd == (0.5,) * 3 and bright.ks == (0.5, 0.25, 0.25)


def test_mtl_warnings_name_the_materials_that_are_used(tmp_path):
    warnings = with_mtl(tmp_path).warnings
    assert "m.mtl: material 'bright' returns 1.6 of its light: scaled down to 1" in warnings
    assert any(text.startswith("m.mtl: map_kd of material 'bright' is left out: ") for text in warnings)
    assert not any("never used" in warning for warning in warnings)


def test_a_named_material_replaces_those_of_the_file(tmp_path):
    with_mtl(tmp_path)
    (tmp_path / "m.mtl").unlink()
    found = scene(tmp_path)
    assert set(found.shapes[0].materials.tolist()) == {0}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mtl": "newmtl a\nKd 1 x 1\n", "names": ["a"]}, r"m\.mtl:2: kd 1 x 1: numbers are expected"),
        ({"mtl": "newmtl a\nKd 1 1\n", "names": ["a"]}, r"m\.mtl:2: kd 1 1: one or three numbers"),
        ({"mtl": "newmtl a\nKd -1 1 1\n", "names": ["a"]}, r"m\.mtl:2: .* at least 0"),
        ({"mtl": "newmtl a\nKe nan 1 1\n", "names": ["a"]}, r"m\.mtl:2: .*finite"),
        ({"mtl": "Kd 1 1 1\n", "names": ["a"]}, r"m\.mtl:1: Kd stands before the first newmtl"),
        ({"mtl": "\0", "names": ["a"]}, "not an MTL file"),
        ({"names": ["unknown"]}, r"uses material 'unknown', which is not in m\.mtl"),
        ({"head": ""}, "names no MTL file: name a material beside 'mesh'"),
        ({"head": "mtllib no.mtl\n"}, "no such file"),
        ({"head": "mtllib ../no.mtl\n"}, "lies outside"),
        ({"head": "mtllib m.mtl\n" + CORNERS + "f 1 2 3\n"}, "has faces before its first usemtl"),
    ],
)
def test_wrong_mtl_files_are_refused(tmp_path, change, message):
    with pytest.raises(SceneError, match=message) as caught:
        with_mtl(tmp_path, **change)
    assert str(caught.value).startswith("shapes[0].mesh.file")


@pytest.mark.parametrize("file", ["m.ply", "ascii.ply", "m.stl", "ascii.stl", "m.obj"])
def test_every_format_keeps_vertices_and_faces(tmp_path, file):
    mesh = trimesh.Trimesh(TETRA, TETRA_FACES, process=False)
    kind = file.split(".")[1]
    if file == "ascii.ply":
        data = mesh.export(file_type="ply", encoding="ascii")
    else:
        data = mesh.export(file_type="stl_ascii" if file == "ascii.stl" else kind)
    (tmp_path / file).write_bytes(data if isinstance(data, bytes) else data.encode())
    found = scene(tmp_path, file).shapes[0]
    assert np.allclose(found.vertices[found.faces], TETRA[TETRA_FACES]) and found.faces.dtype == np.int32
    if kind != "stl":
        assert np.array_equal(found.faces, TETRA_FACES)
    else:
        with pytest.raises(SceneError, match=r"a .stl file has no materials: name one beside 'mesh'"):
            scene(tmp_path, file, material=None)


PLY_HEAD = """ply
format ascii 1.0
element vertex 5
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
1 1 0
0 1 0
0.5 1.5 0
"""


def test_polygons_of_ply_files_become_fans(tmp_path):
    (tmp_path / "m.ply").write_text(PLY_HEAD + "4 0 1 2 3\n4 0 2 3 4\n")
    assert scene(tmp_path, "m.ply").shapes[0].faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 2, 3], [0, 3, 4]]
    (tmp_path / "m.ply").write_text(PLY_HEAD + "5 0 1 2 3 4\n5 0 1 2 3 4\n")
    assert len(scene(tmp_path, "m.ply").shapes[0].faces) == 6
    (tmp_path / "m.ply").write_text(PLY_HEAD + "3 0 1 2\n4 0 2 3 4\n")
    assert scene(tmp_path, "m.ply").shapes[0].faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    (tmp_path / "m.ply").write_text(PLY_HEAD + "4 0 2 3 4\n3 0 1 2\n")
    assert scene(tmp_path, "m.ply").shapes[0].faces.tolist() == [[0, 2, 3], [0, 3, 4], [0, 1, 2]]
    (tmp_path / "m.ply").write_text(PLY_HEAD + "3 0 1 2\n5 0 1 2 3 4\n")
    assert len(scene(tmp_path, "m.ply").shapes[0].faces) == 4


def test_binary_ply_files_of_mixed_polygons_become_fans(tmp_path):
    head = PLY_HEAD.split("0 0 0\n", maxsplit=1)[0].replace("ascii", "binary_little_endian").encode()
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 1.5, 0]], "<f4").tobytes()
    faces = struct.pack("<B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 3)
    (tmp_path / "m.ply").write_bytes(head + vertices + faces)
    assert scene(tmp_path, "m.ply").shapes[0].faces.tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3]]
    for damaged in (faces[:-1], faces + b"\0", struct.pack("<B3iB4i", 3, 0, 1, 2, 5, 0, 1, 2, 3)):
        (tmp_path / "m.ply").write_bytes(head + vertices + damaged)
        with pytest.raises(SceneError, match=r"is not a usable PLY file: (it is cut short|more data follow)"):
            scene(tmp_path, "m.ply")


def test_a_ply_file_may_hold_more_than_a_mesh(tmp_path):
    """Other elements and properties, in either order of bytes and as text, are read over."""
    head = "ply\r\nformat {} 1.0\r\ncomment x\r\nelement camera 2\r\nproperty list uchar float view\r\nproperty uint id\r\n"
    head += "element vertex 3\r\nproperty uchar red\r\nproperty double z\r\nproperty float y\r\nproperty int x\r\n"
    head += "element face 1\r\nproperty list int float texcoord\r\nproperty list uint8 uint16 vertex_index\r\n"
    head += "element edge 0\r\nproperty list uchar int ends\r\nend_header\r\n"
    text = "1 0.5 7\r\n0 7\r\n255 3 2 1\r\n0 6 5 4\r\n9 9 8 7\r\n2 0.25 0.5 3 0 1 2\r\n"
    contents = [head.format("ascii").encode() + text.encode()]
    for order, name in (("<", "binary_little_endian"), (">", "binary_big_endian")):
        rows = struct.pack(f"{order}BfIBI", 1, 0.5, 7, 0, 7)
        for row in ((255, 3, 2, 1), (0, 6, 5, 4), (9, 9, 8, 7)):
            rows += struct.pack(f"{order}Bdfi", *row)
        contents.append(head.format(name).encode() + rows + struct.pack(f"{order}iffB3H", 2, 0.25, 0.5, 3, 0, 1, 2))
    for content in contents:
        (tmp_path / "m.ply").write_bytes(content)
        mesh = scene(tmp_path, "m.ply").shapes[0]
        assert mesh.vertices.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]] and mesh.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("m.ply", b""),
        ("m.ply", b"ply\n"),
        ("m.ply", b"garbage" * 100),
        ("m.ply", bytes(range(256)) * 4),
        ("m.ply", PLY_HEAD.encode()),
        ("m.ply", (PLY_HEAD + "3 0 1 9\n3 0 1 2\n").encode()),
        ("m.ply", (PLY_HEAD + "3 0 1 -1\n3 0 1 2\n").encode()),
        ("m.ply", (PLY_HEAD.replace("1 1 0", "1 nan 0") + "3 0 1 2\n3 0 1 2\n").encode()),
        ("m.ply", PLY_HEAD.replace("vertex 5", "vertex 5000000000").encode()),
        ("m.ply", (PLY_HEAD + "3 0 1 2\n3 0 1 2\n3 0 1 2\n").encode()),
        ("m.ply", (PLY_HEAD + "3 0 1 2\n3 0 1 1.5\n").encode()),
        ("m.ply", (PLY_HEAD + "3 0 1 2\n3 0 1 two\n").encode()),
        ("m.ply", (PLY_HEAD.replace("ascii", "text") + "3 0 1 2\n3 0 1 2\n").encode()),
        ("m.ply", (PLY_HEAD.replace("float z", "real z") + "3 0 1 2\n3 0 1 2\n").encode()),
        ("m.ply", (PLY_HEAD.replace("float z", "float w") + "3 0 1 2\n3 0 1 2\n").encode()),
        ("m.ply", (PLY_HEAD.replace("end_header\n", "") + "3 0 1 2\n3 0 1 2\n").encode()),
        ("m.stl", b"solid x\nendsolid x\n"),
        ("m.stl", b"solid x\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"),
        ("m.stl", b"solid x\nvertex 0 0\nvertex 1 0 0 0\nvertex 0 1 0\nendsolid x\n"),
        ("m.stl", b"solid x\nvertex 0 0 0\nvertex 1 0 0\nendsolid x\n"),
        ("m.stl", b"\0" * 84),
        ("m.stl", b"\xff" * 134),
        (
            "m.stl",
            b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 zero\nvertex 1 0 0\nvertex 0 1 0\n"
            b"endloop\nendfacet\nendsolid x\n",
        ),
    ],
)
def test_wrong_ply_and_stl_files_are_refused_by_name(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match=rf"shapes\[0\].mesh.file = '{name}'"):
        scene(tmp_path, name)


def test_a_ply_does_not_open_the_textures_it_names(tmp_path):
    text = PLY_HEAD.replace("element vertex", "comment TextureFile ../../etc/passwd\nelement vertex")
    (tmp_path / "m.ply").write_text(text + "3 0 1 2\n3 0 2 3\n")
    assert len(scene(tmp_path, "m.ply").shapes[0].faces) == 2


def test_a_hundred_thousand_faces_load_quickly(tmp_path):
    index = np.arange(224 * 224).reshape(224, 224) + 1
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    vertices = np.random.default_rng(1).random((224 * 224, 3))
    text = "".join(f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in vertices.tolist())
    text += "".join(f"f {a} {b} {c} {d}\n" for a, b, c, d in quads.tolist())
    (tmp_path / "m.obj").write_text(text)
    start = time.process_time()
    mesh = scene(tmp_path).shapes[0]
    assert len(mesh.faces) == 2 * 223 * 223 and time.process_time() - start < 10.0
    assert np.allclose(mesh.vertices, vertices, atol=1e-9)
