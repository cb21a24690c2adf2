"""OBJ files of many materials and libraries are read in linear time, and every message has the line of the file."""

from __future__ import annotations

import time

import numpy as np
import pytest

import engines
from engines.errors import SceneError

CPU_SECONDS = 40.0
"""Most that this process may compute: quadratic reading took more than a minute, linear reading takes one or two seconds."""
CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def scene(folder, text, material="m"):
    (folder / "m.obj").write_text(text, newline="")
    shape = {"mesh": {"file": "m.obj"}} | ({"material": material} if material else {})
    camera = {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]}
    data = {"raybench_scene": 1, "camera": camera, "materials": {"m": {"kd": 0.5}}, "shapes": [shape]}
    return engines.scene_from(data, folder=folder)


def refusal(folder, text, material="m"):
    with pytest.raises(SceneError) as caught:
        scene(folder, text, material)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500
    return str(caught.value)


def test_two_hundred_thousand_materials_are_read_in_linear_time(tmp_path):
    count, start = 200_000, time.process_time()
    text = "mtllib m.mtl\n" + CORNERS + "".join(f"usemtl n{index}\nf 1 2 3\n" for index in range(count))
    assert len(scene(tmp_path, text).shapes[0].faces) == count
    (tmp_path / "m.mtl").write_text("newmtl other\nKd 0 0 0\n")
    assert "uses material 'n0', which is not in m.mtl" in refusal(tmp_path, text, material=None)
    assert time.process_time() - start < CPU_SECONDS


def test_materials_that_all_differ_are_hashed_and_warned_about_in_linear_time(tmp_path):
    count, start = 40_000, time.process_time()
    (tmp_path / "m.mtl").write_text("".join(f"newmtl n{i}\nKd 0.5 0.5 {i / count:.6f}\nmap_Kd x.png\n" for i in range(count)))
    text = "mtllib m.mtl\n" + CORNERS + "".join(f"usemtl n{index}\nf 1 2 3\n" for index in range(count))
    found = scene(tmp_path, text, material=None)
    assert np.unique(found.shapes[0].materials).size == count and len(found.warnings) == count + 1
    assert time.process_time() - start < CPU_SECONDS


def test_the_hash_of_a_mesh_does_not_depend_on_materials_of_the_same_value_being_one(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 0.5 0.5 0.5\nnewmtl b\nKd 0.5 0.5 0.5\nnewmtl c\nKd 0.5 0.5 0.25\n")
    one, two, other = (
        scene(tmp_path, f"mtllib m.mtl\n{CORNERS}usemtl a\nf 1 2 3\nusemtl {name}\nf 1 3 2\n", None).content_hash
        for name in "abc"
    )
    assert one == two != other


@pytest.mark.parametrize("material", ["m", None])
def test_a_hundred_and_fifty_thousand_libraries_are_read_or_refused_in_linear_time(tmp_path, material):
    start = time.process_time()
    text = "".join(f"mtllib x{index}.mtl\n" for index in range(150_000)) + CORNERS + "usemtl a\nf 1 2 3\n"
    if material:
        assert len(scene(tmp_path, text).shapes[0].faces) == 1
    else:
        assert "names 150000 MTL files: at most 1000 are read" in refusal(tmp_path, text, material)
    assert time.process_time() - start < CPU_SECONDS


def test_many_libraries_are_listed_in_one_short_message(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl a\n")
    spelled = [f"{'./' * index}m.mtl" for index in range(900)]
    text = "".join(f"mtllib {name}\n" for name in spelled) + CORNERS + "usemtl b\nf 1 2 3\n"
    assert "and 895 more" in refusal(tmp_path, text, None)
    assert "names 'no.mtl': no such file" in refusal(tmp_path, "mtllib no.mtl\n" + CORNERS + "usemtl b\nf 1 2 3\n", None)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("text", "line"),
    [
        (CORNERS + "f 1 2 \\\n3\nf 1 2 9\n", 6),
        (CORNERS + "f 1 \\\n2 \\\n3\nf 1 2 3\nf 1 2 x\n", 8),
        (CORNERS + "f 1 2 3\nf 1 \\\n2 \\\n9\nf 1 2 3\n", 5),
        ("v 0 \\\n0 0\nv 1 0 \\\n0\nv 0 1\nf 1 2 3\n", 5),
        ("v 0 \\\n0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", 4),
        (CORNERS + "g \\\na\\\nb\n\nf 1 2\\", 8),
        (CORNERS + "f 1 2 \\\n3\nf -1 -2 -4\n", 6),
    ],
)
def test_lines_are_counted_as_the_file_has_them_after_continuations(tmp_path, text, line, end):
    assert f"m.obj:{line}: " in refusal(tmp_path, text.replace("\n", end))


def test_negative_indices_and_materials_are_right_after_continuations(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n")
    text = CORNERS.replace("v 1 0 0", "v 1 \\\n 0 0") + "mtllib m.mtl\n"
    text += "usemtl \\\na\nf -3 \\\n-2 -1\nv 5 5 5\nusemtl b\nf -1 -2 -3\n"
    found = scene(tmp_path, text, None)
    assert found.shapes[0].faces.tolist() == [[0, 1, 2], [3, 2, 1]]
    assert [found.materials[index].name for index in found.shapes[0].materials] == ["a", "b"]
