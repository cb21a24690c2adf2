"""Loading a scene takes work in proportion to the length of each list in it.

Work is counted in Python's own instructions, so that the tests do not depend on the machine: from equal steps in length the
count grows by equal amounts, and by more and more where something looks through a list for each of its members.
"""

import json
import os
import sys
from dataclasses import replace

import pytest

import engines
from engines.scene.context import MaterialTable
from tests.scene.mitsuba_files import written

MODULES = os.path.dirname(engines.__file__) + os.sep
STEP = 12
SHARE = 0.01
"""Of a step's work, by which the next step's may differ: an instruction for each pair of members gives more."""
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def instructions(load):
    """How many instructions of raybench's modules run."""
    count = 0

    def traced(frame, event, argument):
        nonlocal count
        if event == "call":
            if not frame.f_code.co_filename.startswith(MODULES):
                return None
            frame.f_trace_opcodes, frame.f_trace_lines = True, False
        elif event == "opcode":
            count += 1
        return traced

    before = sys.gettrace()
    sys.settrace(traced)
    try:
        load()
    finally:
        sys.settrace(before)
    return count


def assert_grows_evenly(load):
    """`load(n)` is a function that loads a list of that length."""
    load(STEP)()  # what is imported and remembered at first
    work = [instructions(load(length)) for length in (2 * STEP, 3 * STEP, 4 * STEP)]
    first, second = work[1] - work[0], work[2] - work[1]
    assert first > 0 and abs(second - first) <= SHARE * first, work


def diffuse(i, more=""):
    return f'<bsdf type="diffuse" {more}><rgb name="reflectance" value="0.{100 + i}"/></bsdf>'


def each(text):
    """The texts of a list; `@` stands for the number of the member."""
    return lambda n: "".join(text.replace("@", str(100 + i)) for i in range(n))


BOARD = '<texture type="checkerboard" name="reflectance"><rgb name="color0" value="0.@"/></texture>'
XML = {
    "materials": lambda n: "".join(f'<shape type="sphere">{diffuse(i)}</shape>' for i in range(n)),
    "materials of meshes": lambda n: "".join(f'<shape type="rectangle">{diffuse(i)}</shape>' for i in range(n)),
    "references": lambda n: "".join(
        f'{diffuse(i, f"""id="m{100 + i}" """)}<shape type="sphere"><ref id="m{100 + i}"/></shape>' for i in range(n)
    ),
    "aliases": lambda n: diffuse(0, 'id="a"') + each('<alias id="a" as="b@"/>')(n) + '<shape type="sphere"/>',
    "textures": each(f'<shape type="rectangle"><bsdf type="diffuse">{BOARD}</bsdf></shape>'),
    "files": each('<shape type="obj"><string name="filename" value="m.obj"/></shape>'),
    "lights": each('<emitter type="point"><point name="position" x="@" y="0" z="0"/></emitter>'),
    "area lights": each('<shape type="sphere"><emitter type="area"><rgb name="radiance" value="@"/></emitter></shape>'),
    "defaults": each('<default name="p@" value="@"/><shape type="sphere"><float name="radius" value="$p@"/></shape>'),
    "includes": each('<include filename="i.xml"/>'),
    "steps": lambda n: '<shape type="sphere"><transform name="to_world">' + '<translate x="1"/>' * n + "</transform></shape>",
    "merged shapes": lambda n: f'<shape type="merge">{XML["materials"](n)}</shape>',
    "members": lambda n: (
        f'<shape type="shapegroup" id="g">{XML["materials"](n)}</shape><shape type="instance"><ref id="g"/></shape>'
    ),
    "instances": lambda n: (
        '<shape type="shapegroup" id="g"><shape type="obj"><string name="filename" value="m.obj"/></shape>'
        "</shape>" + each('<shape type="instance"><ref id="g"/></shape>')(n)
    ),
    "what is not read": each('<shape type="sphere"><float name="odd" value="@"/></shape>\n'),
}


@pytest.mark.parametrize("what", XML)
def test_work_grows_evenly_with_the_lists_of_an_xml_file(what, tmp_path):
    (tmp_path / "m.obj").write_text(TRIANGLE, encoding="ascii")
    (tmp_path / "i.xml").write_text('<scene version="3.0.0"><shape type="sphere"/></scene>', encoding="ascii")

    def load(n):
        file = written(tmp_path, XML[what](n))
        return lambda: engines.load_scene(file)

    assert_grows_evenly(load)


CAMERA = {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]}
MESH = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]], "uvs": [[0, 0], [1, 0], [0, 1]]}


def _named(count, make):
    return {f"n{100 + i}": make(100 + i) for i in range(count)}


def _shapes(count, shape):
    return [{**shape, "material": f"n{100 + i}"} for i in range(count)]


SPHERE = {"sphere": {"center": [0, 0, 0], "radius": 1}}
YAML = {
    "materials": lambda n: {"materials": _named(n, lambda i: {"kd": i / 1000}), "shapes": _shapes(n, SPHERE)},
    "meshes": lambda n: {"materials": _named(n, lambda i: {"kd": i / 1000}), "shapes": _shapes(n, {"mesh": MESH})},
    "textures": lambda n: {
        "textures": {f"t{100 + i}": {"checkerboard": {"a": i / 1000}} for i in range(n)},
        "materials": _named(n, lambda i: {"diffuse": {"reflectance": f"t{i}"}}),
        "shapes": _shapes(n, {"mesh": MESH}),
    },
    "wrappers": lambda n: {
        "materials": {"a": {"kd": 0.5}, **_named(n, lambda i: {"mask": {"opacity": i / 1000, "of": "a"}})},
        "shapes": _shapes(n, SPHERE),
    },
    "lights": lambda n: {"lights": [{"point": {"position": [100 + i, 0, 0], "intensity": 1}} for i in range(n)]},
    "spheres": lambda n: {
        "materials": {"a": {"kd": 0.5}},
        "shapes": [{"spheres": {"centers": [[100 + i, 0, 0] for i in range(n)], "radii": [1] * n}, "material": "a"}],
    },
}


@pytest.mark.parametrize("what", YAML)
def test_work_grows_evenly_with_the_lists_of_a_yaml_file(what, tmp_path):
    def load(n):
        file = tmp_path / f"{n}.yaml"
        file.write_text(json.dumps({"raybench_scene": 1, "camera": CAMERA, **YAML[what](n)}), encoding="ascii")
        return lambda: engines.load_scene(file)

    assert_grows_evenly(load)


def test_the_count_tells_a_list_that_is_looked_through_for_each_member(tmp_path, monkeypatch):
    def slow(table, material):
        alike = [each for each in table.materials if each.name.rpartition("_")[0] == material.name]
        return table.add(replace(material, name=f"{material.name}_{len(alike)}"))

    monkeypatch.setattr(MaterialTable, "add_named", compiled_in_engines(slow))
    with pytest.raises(AssertionError):
        test_work_grows_evenly_with_the_lists_of_an_xml_file("materials", tmp_path)


def compiled_in_engines(function):
    """The function, as if it stood in a module of raybench's: only their instructions count."""

    def renamed(code):
        constants = tuple(renamed(each) if hasattr(each, "co_code") else each for each in code.co_consts)
        return code.replace(co_filename=f"{MODULES}slow.py", co_consts=constants)

    function.__code__ = renamed(function.__code__)
    return function
