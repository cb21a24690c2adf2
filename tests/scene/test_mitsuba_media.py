"""Media of Mitsuba's files: what is read of them, which sides of shapes have them, and what is refused."""

import math

import numpy as np
import pytest

import engines
from engines.scene import HomogeneousMedium, Null, Orthographic, Perspective, flattened
from tests.scene.mitsuba_files import LAMP, SENSOR, refusal, scene, written

FOG = '<medium type="homogeneous" id="fog"/>'


def media(tmp_path, xml, version="3.0.0"):
    """The one medium, of a sphere."""
    found = scene(tmp_path, f'<shape type="sphere">{xml}<bsdf type="null"/></shape>{LAMP}', version)
    (medium,) = found.media
    return medium


def homogeneous(body, name="interior"):
    return f'<medium type="homogeneous" name="{name}" id="m">{body}</medium>'


@pytest.mark.parametrize(
    ("body", "sigma_t", "albedo", "g"),
    [
        ("", (1.0,) * 3, (0.75,) * 3, 0.0),
        ('<phase type="hg"/>', (1.0,) * 3, (0.75,) * 3, 0.8),
        ('<phase type="isotropic"/><float name="albedo" value="0.2"/>', (1.0,) * 3, (0.2,) * 3, 0.0),
        (
            '<rgb name="sigma_t" value="0.25,0.5,1"/><float name="scale" value="4"/><rgb name="albedo" value="0.95,0.8,0.5"/>'
            '<phase type="hg"><float name="g" value="-0.6"/></phase>',
            (1.0, 2.0, 4.0),
            (0.95, 0.8, 0.5),
            -0.6,
        ),
        (
            '<volume type="constvolume" name="sigma_t"><rgb name="value" value="1,0,3"/></volume>',
            (1.0, 0.0, 3.0),
            (0.75,) * 3,
            0.0,
        ),
        ('<boolean name="has_spectral_extinction" value="false"/>', (1.0,) * 3, (0.75,) * 3, 0.0),
        ('<boolean name="sample_emitters" value="true"/>', (1.0,) * 3, (0.75,) * 3, 0.0),
    ],
)
def test_homogeneous_media_are_read(tmp_path, body, sigma_t, albedo, g):
    assert media(tmp_path, homogeneous(body)) == HomogeneousMedium("m", sigma_t, albedo, g)


def test_the_coefficients_of_older_files_are_scattering_and_absorption(tmp_path):
    body = '<rgb name="sigmaS" value="1,0,3"/><rgb name="sigmaA" value="1,0,1"/><float name="scale" value="2"/>'
    assert media(tmp_path, homogeneous(body), "0.6.0") == HomogeneousMedium("m", (4.0, 0.0, 8.0), (0.5, 0.0, 0.75))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("", "both sigma_t and albedo"),
        ('<rgb name="sigmaT" value="1,2,3"/>', "both sigma_t and albedo"),
        ('<rgb name="sigmaA" value="1,2,3"/>', "both sigma_s and sigma_a"),
    ],
)
def test_coefficients_that_older_files_take_from_a_preset_are_refused(tmp_path, body, said):
    message = refusal(tmp_path, f'<shape type="sphere">{homogeneous(body)}</shape>{LAMP}', "0.6.0")
    assert said in message and "Skin1" in message


def test_a_medium_that_samples_no_emitters_is_noted(tmp_path):
    for value, noted in (("true", False), ("false", True)):
        body = homogeneous(f'<boolean name="sample_emitters" value="{value}"/>')
        found = scene(tmp_path, f'<shape type="sphere">{body}</shape>{LAMP}')
        assert any("sample_emitters" in warning for warning in found.warnings) == noted


def test_a_medium_without_a_bsdf_has_a_clear_boundary_in_older_files(tmp_path):
    body = homogeneous('<float name="sigmaT" value="1"/><float name="albedo" value="0.5"/>')
    for version, clear in (("0.6.0", True), ("3.0.0", False)):
        found = scene(tmp_path, f'<shape type="sphere">{body}</shape>{LAMP}', version)
        assert (found.materials[0].bsdf == Null()) == clear


def test_several_shapes_share_a_medium_and_unused_ones_are_left_aside(tmp_path):
    shapes = [f'<shape type="sphere"><ref name="{side}" id="fog"/></shape>' for side in ("interior", "exterior")]
    found = scene(tmp_path, FOG + '<medium type="heterogeneous" id="smoke"/>' + "".join(shapes) + LAMP)
    assert [medium.name for medium in found.media] == ["fog"]
    assert [(shape.interior, shape.exterior) for shape in found.shapes] == [(0, None), (None, 0)]


def test_a_medium_of_another_name_is_not_used(tmp_path):
    found = scene(tmp_path, f'<shape type="sphere">{homogeneous("", "inside")}</shape>{LAMP}')
    assert not found.media
    assert not found.shapes[0].is_boundary
    assert any("interior or its exterior" in warning for warning in found.warnings)


REFUSED = {
    "heterogeneous": ('<medium type="heterogeneous" name="interior"/>', ["heterogeneous", "use homogeneous"]),
    "negative": (homogeneous('<rgb name="sigma_t" value="1,-1,1"/>'), ["negative"]),
    "negative scale": (homogeneous('<float name="scale" value="-1"/>'), ["scale", "at least 0"]),
    "albedo": (homogeneous('<rgb name="albedo" value="1,1.5,1"/>'), ["albedo", "[0, 1]"]),
    "phase": (homogeneous('<phase type="rayleigh"/>'), ["rayleigh", "isotropic or hg"]),
    "two phases": (homogeneous('<phase type="hg"/><phase type="isotropic"/>'), ["second phase"]),
    "g": (homogeneous('<phase type="hg"><float name="g" value="1"/></phase>'), ["between -1 and 1"]),
    "volume": (homogeneous('<volume type="gridvolume" name="albedo"/>'), ["gridvolume", "vary in space"]),
    "preset": (homogeneous('<string name="material" value="skin1"/>'), ["skin1", "presets"]),
    "grey alone": (
        homogeneous('<rgb name="sigma_t" value="1,0.5,1"/><boolean name="has_spectral_extinction" value="false"/>'),
        ["has_spectral_extinction"],
    ),
    "twice": (homogeneous("") + '\n\n<ref name="interior" id="m"/>', ["s.xml:4 ", "second interior"]),
    "volume in itself": (
        homogeneous('<volume type="constvolume" name="sigma_t" id="v"><ref name="value" id="v"/></volume>'),
        ["has no use for volume"],
    ),
    "both pairs": (homogeneous('<rgb name="sigma_s" value="1,2,3"/><float name="albedo" value="0.5"/>'), ["not some of both"]),
    "scale": (homogeneous('<float name="sigma_t" value="1e30"/><float name="scale" value="1e30"/>'), ["at most 3.4e+38"]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_supported_is_refused(tmp_path, name):
    body, said = REFUSED[name]
    message = refusal(tmp_path, f'<shape type="sphere">{body}</shape>{LAMP}')
    assert all(word in message for word in said), message


# ---- sensors and integrators -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_a_sensor_in_a_medium_keeps_its_near_plane(tmp_path, kind):
    plain = SENSOR.replace("perspective", kind)
    if kind == "orthographic":
        plain = plain.replace('<float name="fov" value="40"/>', "")
    inside = plain.replace("</sensor>", '<ref name="medium" id="fog"/></sensor>')
    cameras = [scene(tmp_path, f'{FOG}<shape type="sphere"/>{LAMP}', sensor=sensor).camera for sensor in (plain, inside)]
    assert isinstance(cameras[0], Perspective | Orthographic)
    assert [camera.medium for camera in cameras] == [None, 0]
    assert [camera.clip for camera in cameras] == [(0.0, math.inf), (0.01, 1e4)]


def test_a_second_medium_of_a_sensor_is_refused_where_it_is_named(tmp_path):
    inside = SENSOR.replace("</sensor>", '<ref name="medium" id="fog"/>\n<ref name="medium" id="fog"/></sensor>')
    message = refusal(tmp_path, f'{FOG}<shape type="sphere"/>{LAMP}', sensor=inside)
    assert "s.xml:6 " in message and "second medium" in message


@pytest.mark.parametrize(
    ("integrator", "shader", "noted"),
    [
        ("volpath", {"name": "volumetric_path_tracer", "max_depth": 100_000, "rr_depth": 5}, False),
        ("volpathmis", {"name": "volumetric_path_tracer", "max_depth": 100_000, "rr_depth": 5}, True),
        ("path", {"name": "path_tracer", "max_depth": 100_000, "rr_depth": 5}, False),
    ],
)
def test_integrators_of_media_suggest_the_shader_of_media(tmp_path, integrator, shader, noted):
    body = f'<integrator type="{integrator}"/><shape type="sphere">{homogeneous("")}<bsdf type="null"/></shape>{LAMP}'
    found = scene(tmp_path, body)
    assert found.shader == shader
    assert any("integrator" in warning for warning in found.warnings) == noted


# ---- sides -------------------------------------------------------------------------------------------------------------

SHAPES = ("sphere", "cylinder", "disk", "rectangle", "cube", "obj", "ply faces")
MIRROR = '<scale x="-1"/>'
STRETCH = '<scale x="2"/>'


def of_kind(tmp_path, kind, flip, transform):
    """A shape of a file, or one of Mitsuba's, with an interior."""
    flipped = f'<boolean name="flip_normals" value="{str(flip).lower()}"/>'
    body = f'{flipped}<transform name="to_world">{transform}</transform><bsdf type="null"/>'
    if kind in ("obj", "ply faces"):
        normals = "vn 0 0 1\n" if kind == "obj" else ""
        ends = "//1" if kind == "obj" else ""
        (tmp_path / "m.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{normals}f 1{ends} 2{ends} 3{ends}\n")
        body = f'<string name="filename" value="m.obj"/>{body}'
        if not normals:
            body = f'<boolean name="face_normals" value="true"/>{body}'
        kind = "obj"
    return f'<shape type="{kind}"{{}}>{body}{{}}</shape>'


@pytest.mark.parametrize("transform", ["", MIRROR, STRETCH, MIRROR + STRETCH])
@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("kind", SHAPES)
def test_interiors_are_behind_mitsubas_geometric_normal(tmp_path, kind, flip, transform):
    """That of meshes is the winding after `to_world`, so that a mirror image has its interior in front, and so has that of a
    sphere; turned over by flip_normals. All these shapes face up or outwards before."""
    body = of_kind(tmp_path, kind, flip, transform).format("", homogeneous(""))
    (shape,) = scene(tmp_path, body + LAMP).shapes
    outwards = _faces_out(kind, shape)
    inside = shape.interior == 0 if outwards else shape.exterior == 0
    assert shape.is_boundary and {shape.interior, shape.exterior} == {0, None}
    exchanged = MIRROR in transform and kind not in ("disk", "cylinder")
    assert inside == (exchanged == flip)


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("kind", SHAPES)
def test_a_mirrored_instance_keeps_its_sides(tmp_path, kind, flip):
    group = f'<shape type="shapegroup" id="g">{of_kind(tmp_path, kind, flip, "").format("", homogeneous(""))}</shape>'
    instances = (
        f'<shape type="instance"><ref id="g"/><transform name="to_world">{to}</transform></shape>' for to in ("", MIRROR)
    )
    plain, mirrored = flattened(scene(tmp_path, group + "".join(instances) + LAMP)).shapes
    sides = [(shape.interior == 0) == _faces_out(kind, shape) for shape in (plain, mirrored)]
    assert sides[0] == sides[1] == (not flip)


def _faces_out(kind, shape):
    """Whether our front is outside, or above."""
    if hasattr(shape, "faces"):
        a, b, c = (shape.vertices[shape.faces[0, k]] for k in range(3))
        normal, out = (
            np.cross(b - a, c - a),
            (a + b + c) if kind in ("sphere", "cylinder", "cube") else np.array([0.0, 0.0, 1.0]),
        )
        if kind == "cylinder":
            out[2] = 0.0
        return normal @ out > 0.0
    return shape.normal[2] > 0.0 if kind == "disk" else True


def test_a_mesh_that_winds_both_ways_has_no_sides(tmp_path):
    """Its second face is against its normals; a third has no area, and does not count."""
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvn 0 0 1\n"
    for faces, good in (("f 1//1 2//1 3//1\nf 2//1 3//1 4//1\n", False), ("f 1//1 3//1 2//1\nf 1//1 1//1 2//1\n", True)):
        (tmp_path / "m.obj").write_text(vertices + faces)
        body = f'<shape type="obj"><string name="filename" value="m.obj"/>{homogeneous("")}</shape>{LAMP}'
        if good:
            assert scene(tmp_path, body).shapes[0].exterior == 0
        else:
            assert "wind the same way" in refusal(tmp_path, body)


@pytest.mark.parametrize("against", [1, 199])
def test_of_a_mesh_that_winds_almost_one_way_the_media_are_on_the_sides_of_most_faces(tmp_path, against):
    faces = ["f 2//1 1//1 3//1"] * against + ["f 1//1 2//1 3//1"] * (200 - against)
    (tmp_path / "m.obj").write_text("\n".join(["v 0 0 0", "v 1 0 0", "v 0 1 0", "vn 0 0 1", *faces, ""]))
    found = scene(tmp_path, f'<shape type="obj"><string name="filename" value="m.obj"/>{homogeneous("")}</shape>{LAMP}')
    (mesh,) = found.shapes
    assert (mesh.interior, mesh.exterior) == ((0, None) if against == 1 else (None, 0))
    assert any("1 of 200 faces wind against the others" in warning for warning in found.warnings)


def test_imported_media_are_in_the_content_hash_and_saved(tmp_path):
    body = f'<shape type="sphere">{homogeneous("")}<bsdf type="null"/></shape>{LAMP}'
    found = engines.load_scene(written(tmp_path, body))
    assert found.content_hash != scene(tmp_path, f'<shape type="sphere"><bsdf type="null"/></shape>{LAMP}').content_hash
    assert engines.load_scene(engines.save_scene(found, tmp_path / "saved")).content_hash == found.content_hash
