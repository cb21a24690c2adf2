"""Vertex normals that a file gives in part, that are zeros, or that cancel: each face has its own normal there.

Mitsuba 3.9.1 gives no right values for them: it refuses zeros in OBJ files, shows black for them in PLY files, and reads memory
that nothing has been written to where some corners have none. The values are those of Lambert's cosine law.
"""

import math

import numpy as np
import pytest

import engines
from tests.scene.mitsuba_files import SUN, radiance, scene

CORNERS = "v -1 -1 0\nv 1 -1 0\nv 0 2 0\n"
NAMED = '<shape type="obj"><string name="filename" value="m.obj"/>{}<bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>'
TWO_SIDED = NAMED.format("")


def obj(folder, text):
    (folder / "m.obj").write_text(text, encoding="ascii")


def notes(found):
    return [warning for warning in found.warnings if "no vertex normal" in warning]


@pytest.mark.parametrize("face", ["1//1 2//1 3//1", "1//0 2//0 3//0", "1 2 3"])
def test_faces_without_usable_normals_are_flat(face, tmp_path):
    obj(tmp_path, f"{CORNERS}vn 0 0 0\nf {face}\n")
    assert radiance(tmp_path, TWO_SIDED + SUN) == pytest.approx([0.5] * 3)


def test_a_corner_without_a_normal_has_that_of_its_face(tmp_path):
    """At the centre the first corner has half the weight, with the normal (0, 0, 1), and the others have (0.6, 0, 0.8)."""
    obj(tmp_path, "v -2 0 0\nv 2 -2 0\nv 2 2 0\nvn 0.6 0 0.8\nf 1 2//1 3//1\n")
    tilted = np.array([0.3, 0.0, 0.9])
    assert radiance(tmp_path, TWO_SIDED + SUN) == pytest.approx([0.5 * tilted[2] / np.linalg.norm(tilted)] * 3)
    assert len(notes(scene(tmp_path, TWO_SIDED + SUN))) == 1


def test_normals_that_the_file_gives_are_kept_beside_faces_that_have_none(tmp_path):
    obj(tmp_path, "v -2 0 0\nv 0 -2 0\nv 0 2 0\nv 2 0 1\nvn 0.6 0 0.8\nf 1//1 2//1 3//1\nf 2 4 3\n")
    assert radiance(tmp_path, TWO_SIDED + SUN, (-0.5, 0)) == pytest.approx([0.4] * 3)
    slope = 1.0 / math.sqrt(1.25)
    assert radiance(tmp_path, TWO_SIDED + SUN, (0.5, 0)) == pytest.approx([0.5 * slope] * 3)
    (said,) = notes(scene(tmp_path, TWO_SIDED + SUN))
    assert said.endswith(
        "3 corners of triangles have no vertex normal, or normals that cancel: the normal of the triangle is taken there"
    )


def test_a_sheet_whose_sides_share_their_vertices_is_flat(tmp_path):
    obj(tmp_path, f"{CORNERS}f 1 2 3\nf 1 3 2\n")
    assert radiance(tmp_path, TWO_SIDED + SUN) == pytest.approx([0.5] * 3)
    found = scene(tmp_path, TWO_SIDED + SUN).shapes[0]
    assert found.normals[found.faces][:, :, 2].tolist() == [[1.0] * 3, [-1.0] * 3]


@pytest.mark.parametrize(("flip", "front"), [("", 1.0), ('<boolean name="flip_normals" value="true"/>', -1.0)])
def test_what_is_replaced_turns_with_the_shape(flip, front, tmp_path):
    obj(tmp_path, f"{CORNERS}vn 0 0 0\nf 1//1 2//1 3//1\n")
    found = scene(tmp_path, NAMED.format(flip) + SUN).shapes[0]
    assert (found.normals[found.faces][:, :, 2] == front).all()


def test_a_ply_file_with_zero_normals_is_flat(tmp_path):
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    rows = "-1 -1 0 0 0 0\n1 -1 0 0 0 0\n0 2 0 0 0 0\n"
    head = f"ply\nformat ascii 1.0\nelement vertex 3\n{names}element face 1\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    (tmp_path / "m.ply").write_text(f"{head}{rows}3 0 1 2\n", encoding="ascii")
    assert radiance(tmp_path, TWO_SIDED.replace("obj", "ply") + SUN) == pytest.approx([0.5] * 3)


SHEET = {"vertices": [[-1, -1, 0], [1, -1, 0], [0, 2, 0]], "faces": [[0, 1, 2], [0, 2, 1]]}


@pytest.mark.parametrize(("mesh", "fronts"), [({"file": "m.obj"}, [1.0]), (SHEET, [1.0, -1.0])])
def test_scenes_in_yaml_do_the_same(mesh, fronts, tmp_path):
    obj(tmp_path, f"{CORNERS}vn 0 0 0\nf 1//1 2//1 3//1\n")
    found = engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
            "materials": {"grey": {"kd": 0.5}},
            "shapes": [{"mesh": {**mesh, "smooth": True, "scale": 2}, "material": "grey"}],
        },
        folder=tmp_path,
    )
    made = found.shapes[0]
    assert made.normals[made.faces][:, :, 2].tolist() == [[z] * 3 for z in fronts] and len(notes(found)) == 1
