"""What the importer makes of a file is what Mitsuba loads of it: camera rays, hits with their fronts and uvs, light."""

import numpy as np
import pytest

from engines.numpy_reference.camera import camera_rays
from engines.scene import EnvironmentLight, Mesh
from tests.mitsuba.peer import mi
from tests.needs import needs
from tests.scene.mitsuba_files import LAMP, scene, written

pytestmark = [needs("mitsuba-scalar"), pytest.mark.usefixtures("scalar_rgb")]

FILM = '<film type="hdrfilm"><integer name="width" value="30"/><integer name="height" value="20"/></film>'
PLACE = '<transform name="{}"><lookat origin="1,2,3" target="0,0.5,0" up="0.1,1,0"/></transform>'
SENSORS = {
    "perspective": '<float name="fov" value="50"/>',
    "perspective y": '<float name="fov" value="50"/><string name="fov_axis" value="y"/>',
    "perspective diagonal": '<float name="fov" value="50"/><string name="fov_axis" value="diagonal"/>',
    "perspective smaller": '<float name="fov" value="50"/><string name="fov_axis" value="smaller"/>',
    "perspective 35mm": '<string name="focal_length" value="35mm"/>',
    "perspective shifted": '<float name="principal_point_offset_x" value="0.2"/>'
    '<float name="principal_point_offset_y" value="-0.1"/>',
    "thinlens": '<float name="aperture_radius" value="0.5"/><float name="focus_distance" value="3"/>',
    "orthographic": "",
}
MIRRORED = '<transform name="to_world"><scale x="-1"/><lookat origin="1,2,3" target="0,0.5,0" up="0.1,1,0"/></transform>'


CROP = {"crop_offset_x": 18, "crop_offset_y": 3, "crop_width": 7, "crop_height": 11}
CROP_XML = "".join(f'<integer name="{name}" value="{side}"/>' for name, side in CROP.items())
CROPPED = FILM.replace("</film>", f"{CROP_XML}</film>")


@pytest.mark.parametrize(("film", "width", "height"), [(FILM, 30, 20), (CROPPED, 7, 11)], ids=["whole", "cropped"])
@pytest.mark.parametrize("name", [*SENSORS, "perspective mirrored"])
def test_camera_rays(tmp_path, name, film, width, height):
    more = SENSORS.get(name)
    place = MIRRORED if more is None else PLACE.format("to_world")
    xml = f'<sensor type="{name.split()[0]}">{place}{more or ""}{film}</sensor>'
    camera = scene(tmp_path, f'<shape type="sphere"/>{LAMP}', sensor=xml).camera
    sensor = mi.load_string(xml.replace("<sensor", '<sensor version="3.0.0"', 1))
    x, y = np.array([[0.1, 0.98, 0.5], [0.05, 0.025, 0.95]]) * [[width], [height]]
    origins, directions = camera_rays(camera, x, y, width, height)
    for i in range(3):
        ray, _ = sensor.sample_ray(0.0, 0.0, mi.Point2f(x[i] / width, y[i] / height), mi.Point2f(0.5, 0.5))
        assert directions[:, i] == pytest.approx(np.array(ray.d), abs=2e-6)
        # Mitsuba's rays begin at the near plane
        offset = np.array(ray.o) - origins[:, i]
        assert np.cross(offset, directions[:, i]) == pytest.approx(np.zeros(3), abs=2e-6)


MOVED = '<rotate x="1" angle="30"/><translate x=".1"/></transform>'
TRANSFORMS = {
    "nothing": "",
    "rotation": f'<transform name="to_world"><rotate value="0 1 0" angle="40"/>{MOVED}',
    "mirror": f'<transform name="to_world"><scale x="-1.3" y="1.3" z="1.3"/>{MOVED}',
}
FLIP = '<boolean name="flip_normals" value="true"/>'
BOARD = '<bsdf type="twosided"><bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf></bsdf>'
OBJ = "v -1 -1 0\nv 1 -1 0\nv 1 1 .5\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 .5\n{1}f 1/1{0} 2/2{0} 3/3{0} 4/4{0}\n"


@pytest.mark.parametrize("transform", TRANSFORMS)
@pytest.mark.parametrize(
    "kind", ["rectangle", "cube", "disk", "sphere", "cylinder", "obj", "obj with normals", "obj with faces"]
)
def test_hits_have_the_same_front_and_texture_coordinates(tmp_path, kind, transform):
    (tmp_path / "m.obj").write_text(OBJ.format(*(("/1", "vn 0 0 -1\n") if "normals" in kind else ("", ""))), encoding="ascii")
    more = f'<string name="filename" value="{tmp_path / "m.obj"}"/>' if kind.startswith("obj") else ""
    more += '<boolean name="face_normals" value="true"/>' if "faces" in kind else ""
    random = np.random.default_rng(1)
    compared = 0
    for flip in ("", FLIP):
        xml = f'<shape type="{kind.split()[0]}">{TRANSFORMS[transform]}{flip}{more}{BOARD}</shape>'
        mesh = scene(tmp_path, xml + LAMP).shapes[0]
        if not isinstance(mesh, Mesh):
            continue  # of a shape with a formula the side is in its material, and its hits are tested elsewhere
        native = mi.load_file(str(written(tmp_path, xml + LAMP)))
        for _ in range(60):
            origin = random.normal(size=3)
            origin *= 4.0 / np.linalg.norm(origin)
            direction = 0.4 * random.normal(size=3) - origin
            direction /= np.linalg.norm(direction)
            wanted, found = native.ray_intersect(mi.Ray3f(origin, direction)), hit(mesh, origin, direction)
            if found is None or not wanted.is_valid() or abs(found[1] @ direction) < 0.5:
                continue  # at grazing angles chords and arcs lie far apart
            compared += 1
            distance, normal, uv, along_u = found
            assert distance == pytest.approx(wanted.t, abs=2e-3)
            assert np.dot(normal, np.array(wanted.sh_frame.n)) > 0.0
            apart = np.abs(uv - np.array(wanted.uv))
            assert np.minimum(apart, 1.0 - apart) == pytest.approx([0.0, 0.0], abs=0.02)
            tangent = np.array(wanted.dp_du)
            assert along_u @ tangent / np.linalg.norm(tangent) > 0.99
    assert compared > 20 or (kind, transform) == ("sphere", "nothing")


def hit(mesh, origin, direction):
    """Distance, normal of the winding, texture coordinates, and the direction in which u grows, of the closest hit; or None."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    p = np.cross(direction, c - a)
    with np.errstate(all="ignore"):
        inverse = 1.0 / np.einsum("ij,ij->i", b - a, p)
        u = np.einsum("ij,ij->i", origin - a, p) * inverse
        q = np.cross(origin - a, b - a)
        v, t = q @ direction * inverse, np.einsum("ij,ij->i", c - a, q) * inverse
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
    if not inside.any():
        return None
    face = np.flatnonzero(inside)[np.argmin(t[inside])]
    uvs = mesh.uvs[mesh.faces[face]]
    (u1, v1), (u2, v2) = uvs[1] - uvs[0], uvs[2] - uvs[0]
    along_u = (v2 * (b - a)[face] - v1 * (c - a)[face]) / (u1 * v2 - v1 * u2)
    normal = np.cross((b - a)[face], (c - a)[face])
    uv = uvs[0] + u[face] * (uvs[1] - uvs[0]) + v[face] * (uvs[2] - uvs[0])
    return t[face], normal / np.linalg.norm(normal), uv, along_u / np.linalg.norm(along_u)


def test_a_baked_sky_has_the_light_of_mitsubas(tmp_path):
    parameters = '<float name="turbidity" value="4"/><vector name="sun_direction" x="0.3" y="0.4" z="0.8"/>'
    xml = f'<emitter type="sunsky">{parameters}</emitter>'
    found = scene(tmp_path, f'<shape type="sphere"/>{xml}')
    (sky,) = found.lights
    assert isinstance(sky, EnvironmentLight) and sky.rows == "poles"
    height, width = sky.image.shape[:2]
    theta = np.pi * np.arange(height) / (height - 1)
    weights = np.sin(theta)[:, None, None] * 2.0 * np.pi / width * np.pi / (height - 1)
    total = (sky.image * weights).sum(axis=(0, 1))
    native = mi.load_dict(
        {
            "type": "scene",
            "sky": mi.load_string(xml.replace("<emitter", '<emitter version="3.0.0"')),
            "ball": {"type": "sphere"},
        }
    ).environment()
    at, random = mi.SurfaceInteraction3f(), np.random.default_rng(2)
    drawn = [native.sample_direction(at, mi.Point2f(*random.random(2)))[1] for _ in range(20_000)]
    assert total == pytest.approx(np.mean(drawn, axis=0), rel=0.01)
    row, column = np.unravel_index(sky.image.sum(axis=2).argmax(), (height, width))
    u, v = 2.0 * np.pi * (column + 0.5) / width, np.pi * row / (height - 1)
    sun = np.array([0.3, 0.4, 0.8]) / np.linalg.norm([0.3, 0.4, 0.8])
    assert sun @ [np.sin(v) * np.sin(u), np.cos(v), -np.sin(v) * np.cos(u)] > np.cos(np.radians(0.4))


def test_sampled_spectra_are_those_that_mitsuba_evaluates(tmp_path):
    for text in ("400:0.1, 500:0.2, 600:0.3, 700:0.1", "380:0.9 780:0.2"):
        xml = f'<bsdf type="diffuse"><spectrum name="reflectance" value="{text}"/></bsdf>'
        made = scene(tmp_path, f'<shape type="sphere"><bsdf type="twosided">{xml}</bsdf></shape>{LAMP}')
        native = mi.traverse(mi.load_string(xml.replace("<bsdf", '<bsdf version="3.0.0"')))["reflectance.value"]
        assert made.materials[0].bsdf.reflectance == pytest.approx(np.array(native), rel=3e-3)
