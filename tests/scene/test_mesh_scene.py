"""A mesh file is a scene by itself: framed, lit, with its own materials or in grey."""

import numpy as np
import pytest

import engines
from engines.errors import SceneError
from engines.peers.adapters import camera_frame

BOX = """v 10 0 5
v 14 0 5
v 14 1 5
v 10 1 5
v 10 0 6
v 14 0 6
v 14 1 6
v 10 1 6
{}f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""
PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
PLY += "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
STL = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 2 0 0\nvertex 0 2 1\nendloop\nendfacet\nendsolid a\n"


def written(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


def places(scene):
    """(n, 2) positions of the mesh's vertices in the image: 0 to 1 inside."""
    frame = camera_frame(scene, engines.Settings())
    rays = scene.shapes[0].vertices - np.array(scene.camera.eye)
    x, y, z = (rays @ np.array(axis) for axis in (frame.right, frame.up, frame.forward))
    low_x, high_x, low_y, high_y = frame.window
    return np.stack([(x / z - low_x) / (high_x - low_x), (y / z - low_y) / (high_y - low_y)], axis=1)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_the_mesh_fills_the_frame_whatever_its_size(tmp_path, scale):
    lines = [
        "v " + " ".join(f"{scale * float(x):g}" for x in line.split()[1:]) if line.startswith("v ") else line
        for line in BOX.format("").splitlines()
    ]
    found = places(engines.load_scene(written(tmp_path, "box.obj", "\n".join(lines))))
    assert (found > 0).all() and (found < 1).all()
    assert np.ptp(found, axis=0).max() > 0.8, "along one axis it nearly touches the frame"


def test_an_obj_has_the_materials_of_its_mtl(tmp_path):
    written(tmp_path, "paint.mtl", "newmtl red\nKd 0.7 0.1 0.1\n")
    scene = engines.load_scene(written(tmp_path, "box.obj", "mtllib paint.mtl\n" + BOX.format("usemtl red\n")))
    assert scene.materials[scene.shapes[0].materials[0]].kd == (0.7, 0.1, 0.1) and not scene.warnings


@pytest.mark.parametrize(
    ("head", "why"), [("", "names no MTL file"), ("mtllib gone.mtl\n", "names 'gone.mtl': no such file: looked in")]
)
def test_without_materials_it_is_grey_and_says_why(tmp_path, head, why):
    scene = engines.load_scene(written(tmp_path, "box.obj", head + BOX.format("usemtl red\n")))
    assert [material.name for material in scene.materials] == ["grey"]
    assert scene.warnings[0].startswith(f"the mesh is grey, for the file {why}")


@pytest.mark.parametrize(("name", "text", "up"), [("a.ply", PLY, (0, 1, 0)), ("a.stl", STL, (0, 0, 1))])
def test_ply_and_stl_are_shown_with_their_axis_upwards(tmp_path, name, text, up):
    scene = engines.load_scene(written(tmp_path, name, text))
    assert scene.camera.up == up and scene.name == "a"
    film = engines.engine("numpy").prepare(scene, engines.Settings(16, 12, sampler="random")).render(4)
    assert len(np.unique(film.mean().round(2))) > 1 and film.bad_samples == 0


def test_another_mesh_is_another_scene(tmp_path):
    one = engines.load_scene(written(tmp_path, "a.ply", PLY))
    other = engines.load_scene(written(tmp_path, "b.ply", PLY.replace("1 0 0", "2 0 0")))
    assert one.content_hash != other.content_hash
    assert engines.load_scene(written(tmp_path, "c.ply", PLY)).content_hash == one.content_hash


SPIKE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 1\n{}f 1{n} 2{n} 3{n}\nf 1{n} 2{n} 4{n}\n"
PLY_WITH_NORMALS = PLY.replace("float z\n", "float z\nproperty float nx\nproperty float ny\nproperty float nz\n")
for corner in ("0 0 0", "1 0 0", "0 1 0"):
    PLY_WITH_NORMALS = PLY_WITH_NORMALS.replace(f"\n{corner}\n", f"\n{corner} 0 0.6 0.8\n")


@pytest.mark.parametrize(
    ("name", "without", "given"),
    [("a.obj", SPIKE.format("", n=""), SPIKE.format("vn 0 0.6 0.8\n", n="//1")), ("a.ply", PLY, PLY_WITH_NORMALS)],
)
def test_a_mesh_is_smooth_only_where_its_file_has_normals(tmp_path, name, without, given):
    assert engines.load_scene(written(tmp_path, name, without)).shapes[0].normals is None
    normals = engines.load_scene(written(tmp_path, name, given)).shapes[0].normals
    np.testing.assert_allclose(normals, [[0, 0.6, 0.8]] * len(normals))


def test_what_is_no_mesh_is_refused_in_a_line(tmp_path):
    with pytest.raises(SceneError, match=r"bad.obj shapes\[0\].mesh.file: .*bad.obj:1: not an OBJ file with faces"):
        engines.load_scene(written(tmp_path, "bad.obj", "nonsense\n"))
    with pytest.raises(SceneError, match=r"gone\.obj: no such file"):
        engines.load_scene(tmp_path / "gone.obj")
