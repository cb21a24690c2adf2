"""What each shape of a Mitsuba file becomes: its place, its front, its normals."""

import math

import numpy as np
import pytest

from engines.scene import Bump, Cylinder, Dielectric, Diffuse, Disk, ImageTexture, Mesh, Sides, Sphere
from engines.scene.mitsuba_xml.bsdfs import turned
from tests.scene.mitsuba_files import LAMP, scene, shape

MIRROR = '<transform name="to_world"><scale x="-1"/></transform>'
FLIP = '<boolean name="flip_normals" value="true"/>'


def front(mesh):
    """The unit normal of the first face."""
    a, b, c = mesh.vertices[mesh.faces[0]]
    normal = np.cross(b - a, c - a)
    return normal / np.linalg.norm(normal)


def test_rectangles_face_their_normal_whatever_the_transform(tmp_path):
    plain = shape(tmp_path, '<shape type="rectangle"/>')
    assert isinstance(plain, Mesh) and plain.normals is None
    assert front(plain) == pytest.approx([0, 0, 1])
    assert plain.uvs[np.lexsort(plain.vertices.T)].tolist() == [[0, 0], [0, 1], [1, 0], [1, 1]] or len(plain.uvs) == 4
    assert front(shape(tmp_path, f'<shape type="rectangle">{MIRROR}</shape>')) == pytest.approx([0, 0, 1])
    assert front(shape(tmp_path, f'<shape type="rectangle">{MIRROR}{FLIP}</shape>')) == pytest.approx([0, 0, -1])


@pytest.mark.parametrize("more", ["", MIRROR, FLIP, MIRROR + FLIP])
def test_cubes_face_outwards_unless_they_are_flipped(tmp_path, more):
    found = shape(tmp_path, f'<shape type="cube">{more}</shape>')
    assert len(found.faces) == 12 and found.normals is None
    corners = found.vertices[found.faces]
    outwards = np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0])
    assert (outwards < 0).all() if FLIP in more else (outwards > 0).all()


def test_spheres(tmp_path):
    place = '<transform name="to_world"><rotate value="0 0 1" angle="30"/><scale value="2"/><translate x="1"/></transform>'
    xml = f'<shape type="sphere"><float name="radius" value="0.5"/><point name="center" value="1 0 0"/>{place}</shape>'
    found = shape(tmp_path, xml)
    assert isinstance(found, Sphere) and found.radius == pytest.approx(1.0)
    assert found.center == pytest.approx((1 + 2 * math.cos(math.pi / 6), 2 * math.sin(math.pi / 6), 0.0))


def test_spheres_that_are_inside_out_exchange_the_sides_of_their_material(tmp_path):
    for more in (MIRROR, FLIP):
        found = scene(tmp_path, f'<shape type="sphere">{more}<bsdf type="diffuse"/></shape>{LAMP}')
        assert found.materials[0].bsdf == Sides(None, Diffuse())
    glass = '<bsdf type="dielectric"><float name="int_ior" value="2"/><float name="ext_ior" value="1"/></bsdf>'
    found = scene(tmp_path, f'<shape type="sphere">{FLIP}{glass}</shape>{LAMP}')
    assert found.materials[0].bsdf == Dielectric(0.5)
    found = scene(tmp_path, f'<shape type="sphere">{MIRROR}{FLIP}{glass}</shape>{LAMP}')
    assert found.materials[0].bsdf == Dielectric(2.0)
    height = ImageTexture(np.ones((2, 2, 1), np.float32))
    assert turned(Bump(height, 2.0, Dielectric(2.0))) == Bump(height, -2.0, Dielectric(0.5))  # it has one front
    assert turned(Bump(height, 2.0, Diffuse())).scale == 2.0  # each side has its own
    found = scene(tmp_path, f'<shape type="sphere">{FLIP}<emitter type="area"/></shape>')
    assert isinstance(found.shapes[0], Mesh) and any("emits inwards" in warning for warning in found.warnings)


def test_ellipsoids_and_turned_textured_spheres_are_made_of_triangles(tmp_path):
    stretched = '<transform name="to_world"><scale x="2" y="1" z="0.5"/></transform>'
    found = scene(tmp_path, f'<shape type="sphere">{stretched}</shape>{LAMP}')
    mesh = found.shapes[0]
    assert isinstance(mesh, Mesh) and any("ellipsoid" in warning for warning in found.warnings)
    assert np.sum((mesh.vertices / [2.0, 1.0, 0.5]) ** 2, axis=1) == pytest.approx(1.0)
    wanted = mesh.vertices / np.array([2.0, 1.0, 0.5]) ** 2
    assert mesh.normals == pytest.approx(wanted / np.linalg.norm(wanted, axis=1, keepdims=True))
    board = '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>'
    turned = '<transform name="to_world"><rotate x="1" angle="90"/></transform>'
    assert isinstance(shape(tmp_path, f'<shape type="sphere">{board}</shape>'), Sphere)
    assert isinstance(shape(tmp_path, f'<shape type="sphere">{turned}{board}</shape>'), Mesh)


def test_disks(tmp_path):
    place = '<transform name="to_world"><scale value="2"/><rotate x="1" angle="90"/><translate z="1"/></transform>'
    found = shape(tmp_path, f'<shape type="disk">{place}</shape>')
    assert isinstance(found, Disk) and found.radius == pytest.approx(2.0)
    assert found.center == (0.0, 0.0, 1.0) and found.normal == pytest.approx((0.0, -1.0, 0.0))
    assert shape(tmp_path, f'<shape type="disk">{FLIP}</shape>').normal == (0.0, 0.0, -1.0)
    oval = shape(tmp_path, '<shape type="disk"><transform name="to_world"><scale x="2"/></transform></shape>')
    assert isinstance(oval, Mesh) and front(oval) == pytest.approx([0, 0, 1])
    assert np.abs(oval.vertices[:, 0]).max() == 2.0


def test_cylinders(tmp_path):
    ends = '<point name="p0" value="0 0 1"/><point name="p1" x="0" y="2" z="1"/><float name="radius" value="0.5"/>'
    place = '<transform name="to_world"><scale value="2"/></transform>'
    found = shape(tmp_path, f'<shape type="cylinder">{ends}{place}</shape>')
    assert isinstance(found, Cylinder) and found.radius == pytest.approx(1.0)
    assert found.p0 == pytest.approx((0.0, 0.0, 2.0)) and found.p1 == pytest.approx((0.0, 4.0, 2.0))
    sheared = '<transform name="to_world"><scale x="2"/></transform>'
    assert isinstance(shape(tmp_path, f'<shape type="cylinder">{sheared}</shape>'), Mesh)
    found = scene(tmp_path, f'<shape type="cylinder">{FLIP}</shape>{LAMP}')
    assert found.materials[0].bsdf == Sides(None, Diffuse())


OBJ = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
vt 0.25 0.25
f 1 2 3
f 1 3 4
f 1 5 2
"""


def test_files_without_normals_are_smooth_by_angle_unless_face_normals(tmp_path):
    (tmp_path / "m.obj").write_text(OBJ, encoding="ascii")
    named = '<string name="filename" value="m.obj"/>'
    flat = shape(tmp_path, f'<shape type="obj">{named}<boolean name="face_normals" value="true"/></shape>')
    assert flat.normals is None and len(flat.faces) == 3
    smooth = shape(tmp_path, f'<shape type="obj">{named}</shape>')
    corner = np.flatnonzero((smooth.vertices == 0).all(axis=1))
    # a right angle between (0, 0, 1) and (0, 1, 0): half and half
    assert smooth.normals[corner[0]] == pytest.approx([0.0, math.sqrt(0.5), math.sqrt(0.5)])
    turned = shape(tmp_path, f'<shape type="obj">{named}{FLIP}</shape>')
    assert turned.normals[corner[0]] == pytest.approx([0.0, -math.sqrt(0.5), -math.sqrt(0.5)])
    assert front(turned) == pytest.approx([0, 0, -1])


def test_stored_normals_say_which_side_is_the_front(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 -1\nf 1//1 2//1 3//1\n"
    (tmp_path / "m.obj").write_text(text, encoding="ascii")
    named = '<string name="filename" value="m.obj"/>'
    found = shape(tmp_path, f'<shape type="obj">{named}</shape>')
    assert front(found) == pytest.approx([0, 0, -1]) and found.normals[0] == pytest.approx([0, 0, -1])
    found = shape(tmp_path, f'<shape type="obj">{named}{MIRROR}</shape>')
    assert front(found) == pytest.approx([0, 0, -1])
    found = shape(tmp_path, f'<shape type="obj">{named}{MIRROR}<boolean name="face_normals" value="true"/></shape>')
    assert front(found) == pytest.approx([0, 0, -1])  # a mirror image of a face towards +z
