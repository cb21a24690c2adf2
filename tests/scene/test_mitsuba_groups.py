"""Shapes that stand for others in Mitsuba's files: `merge`, and `instance` of a `shapegroup`."""

import time

import pytest

from engines.scene import Instance, Sides, Sphere, flattened, groups_of
from engines.scene.mitsuba_xml import groups
from tests.scene.mitsuba_files import LAMP, SUN, radiance, refusal, scene

BALL = '<shape type="sphere"/>'
GROUP = '<shape type="shapegroup" id="g">{}</shape>'
COPY = '<shape type="instance"><ref id="g"/><transform name="to_world">{}</transform></shape>'


def test_the_shapes_of_a_merge_stand_in_its_place(tmp_path):
    found = scene(
        tmp_path, f'<shape type="merge"><bsdf type="conductor"/>{BALL}<shape type="merge">{BALL}</shape></shape>{LAMP}'
    )
    assert [type(shape) for shape in found.shapes] == [Sphere, Sphere]
    assert any("a BSDF of a merge is not used" in warning for warning in found.warnings)
    placed = f'<shape type="merge"><transform name="to_world"><scale value="2"/></transform>{BALL}</shape>'
    assert "a merge has no to_world" in refusal(tmp_path, placed)


def test_a_group_is_seen_through_its_instances_alone_after_its_own_transforms(tmp_path):
    inner = '<shape type="sphere"><transform name="to_world"><translate x="1"/></transform></shape>'
    group = GROUP.format(f'<shape type="merge">{inner}</shape><transform name="to_world"><scale value="9"/></transform>')
    body = group + COPY.format('<scale value="2"/>') + COPY.format('<translate y="1"/>')
    found = scene(tmp_path, body + LAMP)
    first, second = found.shapes
    assert isinstance(first, Instance) and first.group is second.group and first.group.name == "g"
    assert [(shape.center, shape.radius) for shape in first.group.shapes] == [((1.0, 0.0, 0.0), 1.0)]
    assert first.matrix.tolist() == [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0]] and second.matrix[:, 3].tolist() == [0, 1, 0]
    copies = flattened(found).shapes
    assert [(shape.center, shape.radius) for shape in copies] == [((2.0, 0.0, 0.0), 2.0), ((1.0, 1.0, 0.0), 1.0)]
    assert any("to_world of a shapegroup has no effect" in warning for warning in found.warnings)
    assert not scene(tmp_path, GROUP.format(BALL) + LAMP).shapes


def test_a_mirrored_instance_keeps_the_front_and_a_mirrored_shape_does_not(tmp_path):
    """A face of a mesh without normals, one-sided, under light from above: n is M^-T n of an instance."""
    (tmp_path / "m.obj").write_text("v -1 -1 0\nv 1 -1 0\nv 0 2 0\nf 1 2 3\n", encoding="ascii")
    for flat in ("true", "false"):
        shape = f'<shape type="obj"><string name="filename" value="m.obj"/><boolean name="face_normals" value="{flat}"/>'
        shape += '<transform name="to_world"><scale x="{}"/></transform></shape>'
        mirror = COPY.format('<scale x="-1"/>')
        assert radiance(tmp_path, GROUP.format(shape.format(1)) + mirror + SUN) == pytest.approx([0.5] * 3)
        assert radiance(tmp_path, shape.format(-1) + SUN) == pytest.approx([0.0] * 3)
        assert radiance(tmp_path, GROUP.format(shape.format(-1)) + mirror + SUN) == pytest.approx([0.0] * 3)
    ball = scene(
        tmp_path, GROUP.format('<shape type="sphere"><bsdf type="conductor"/></shape>') + COPY.format('<scale x="-1"/>') + LAMP
    )
    (member,) = ball.shapes[0].group.shapes
    assert isinstance(member, Sphere) and ball.materials[0].bsdf.back is None and isinstance(ball.materials[0].bsdf, Sides)


LIT = '<shape type="sphere"><emitter type="area"/></shape>'


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (GROUP.format(GROUP.replace('id="g"', "").format(BALL)) + COPY.format(""), "no groups and no instances"),
        (
            GROUP.format(BALL) + GROUP.replace('"g"', '"h"').format(COPY.format("")) + COPY.format("").replace('"g"', '"h"'),
            "no groups and no instances",
        ),
        (GROUP.format(LIT) + COPY.format(""), "no emitter"),
        (GROUP.format(f'{BALL}<bsdf type="diffuse"/>') + COPY.format(""), "a shapegroup has no BSDF"),
        (GROUP.format(BALL) + COPY.format("").replace("<ref", '<bsdf type="diffuse"/><ref'), "an instance has no BSDF"),
        (GROUP.format(BALL) + COPY.format('<scale z="0"/>'), "not singular"),
        ('<shape type="sphere" id="g"/>' + COPY.format(""), "one shape, a shapegroup"),
        ('<shape type="merge" id="m"><ref id="m"/></shape>', "refers to itself"),
    ],
)
def test_what_mitsuba_does_not_allow_is_refused(body, said, tmp_path):
    assert said in refusal(tmp_path, body)


def test_the_number_of_instances_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(groups, "MAX_INSTANCES", 2)
    cubes = GROUP.format('<shape type="cube"/>') + COPY.format("") * 2
    assert len(scene(tmp_path, cubes + LAMP).shapes) == 2
    assert "more than 2 instances" in refusal(tmp_path, cubes + COPY.format(""))


def test_groups_within_groups_are_refused_at_once_however_deep_or_circular(tmp_path):
    deep = BALL
    for _ in range(20):
        deep = f'<shape type="shapegroup">{deep}</shape>'
    started = time.process_time()
    assert "no groups and no instances" in refusal(tmp_path, GROUP.format(deep) + COPY.format(""))
    assert "no groups and no instances" in refusal(tmp_path, GROUP.format('<ref id="g"/>') + COPY.format(""))
    assert "no groups and no instances" in refusal(tmp_path, GROUP.format(COPY.format("")) + COPY.format(""))
    circle = GROUP.format('<shape type="merge" id="m"><ref id="m"/></shape>')
    assert "refers to itself" in refusal(tmp_path, circle + COPY.format(""))
    assert time.process_time() - started < 1.0


def test_merges_within_merges_hold_a_bounded_number_of_shapes(tmp_path, monkeypatch):
    monkeypatch.setattr(groups, "MAX_MERGED", 500)
    first, many = BALL.replace("/>", ' id="m0"/>'), ""
    for level in range(1, 10):
        inner = f'<ref id="m{level - 1}"/>' * 10
        many += f'<shape type="merge" id="m{level}">{inner}</shape>'
    shown = COPY.format("").replace("<shape", '<shape id="m0"', 1)
    grouped, instances = first + many + GROUP.format('<ref id="m9"/>') + COPY.format(""), GROUP.format(BALL) + shown + many
    for body in (first + many, grouped, instances):
        assert "merges hold more than 500 shapes" in refusal(tmp_path, body)


def test_shapes_of_triangles_in_merges_are_repeated_a_bounded_number_of_times(tmp_path, monkeypatch):
    """A stretched sphere has 36,000 triangles, so that 200,000 of it in a small file would be hundreds of GB."""
    monkeypatch.setattr(groups, "MAX_REPEATED", 100_000)
    ball = BALL.replace("/>", ' id="m0"><transform name="to_world"><scale x="2"/></transform></shape>')
    ten = "".join(f'<shape type="merge" id="m{k}">' + f'<ref id="m{k - 1}"/>' * 10 + "</shape>" for k in range(1, 6))
    for body in (ball + ten, GROUP.format(ball + ten) + COPY.format("")):
        assert "merges repeat more than 100,000 triangles" in refusal(tmp_path, body)


def test_a_file_is_read_once_for_all_instances_of_its_group(tmp_path):
    (tmp_path / "m.obj").write_text("v -1 -1 0\nv 1 -1 0\nv 0 2 0\nf 1 2 3\n", encoding="ascii")
    group = GROUP.format('<shape type="obj"><string name="filename" value="m.obj"/></shape>')
    started = time.process_time()
    found = scene(tmp_path, group + COPY.format('<translate x="2"/>') * 2000 + LAMP)
    assert time.process_time() - started < 2.0  # 0.5 s alone
    assert len(found.shapes) == 2000 and len(groups_of(found.shapes)) == 1
