"""Attributes of meshes: what files and mappings give, what a shape must have, and what depends on them."""

import json
from dataclasses import replace

import numpy as np
import pytest

import engines
from engines import SceneError, Settings
from engines.errors import Unsupported
from engines.scene import Bump, Diffuse, Material, Mesh, MeshAttribute, NormalMap, Plastic, Scene, Sphere, scene_schema
from engines.scene.attributes import of_copies
from engines.scene.content import content_hash
from engines.scene.formats.ply import parse_ply, write_ply
from engines.scene.textures import largest, mean_color, tinted
from tests.needs import marks_of
from tests.scene.mitsuba_files import LAMP, SUN, radiance, refusal, scene
from tests.scene.test_uvs import packed, serialized

CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
COLORS = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
CAMERA = {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]}


def ply(vertex="", rows=("", "", ""), face="", row=""):
    """A triangle as text: further properties of vertices and faces, and their numbers."""
    vertex, face = ("".join(f"property {each}\n" for each in properties.split(", ") if each) for properties in (vertex, face))
    corners = "".join(f"{x} {y} {z} {more}\n" for (x, y, z), more in zip(CORNERS, rows, strict=True))
    return (
        f"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{vertex}"
        f"element face 1\nproperty list uchar int vertex_indices\n{face}end_header\n{corners}3 0 1 2 {row}\n"
    )


RGB = "float r, float g, float b"
RED_GREEN_BLUE = ("1 0 0", "0 1 0", "0 0 1")
NAMES = {
    "float r, float g, float b": {"vertex_color": COLORS},
    "double red, double green, double blue": {"vertex_color": COLORS},
    "float b, float g, float r": {"vertex_color": [row[::-1] for row in COLORS]},
    "float foo_r, float foo_g, float foo_b": {"vertex_foo_color": COLORS},
    "float foo_x, float foo_y, float foo_z": {"vertex_foo": COLORS},
    "float a_b_0, float a_b_1, float a_b_2": {"vertex_a_b": COLORS},
    "float foo_1, float foo_2, float foo_3": {"vertex_foo": COLORS},
    "float foo_0, float bar_0, float baz": {"vertex_foo": [(1,), (0,), (0,)], "vertex_bar": [(0,), (1,), (0,)]},
    "float foo_g, float foo_r, float foo_b": {},
    "float foo_0, float foo_r, float bar": {},
    "float foo_0, float bar, float foo_r": {"vertex_foo": [(1,), (0,), (0,)]},
    "float u, float v, float w": {},
}


def numbers(found):
    return {
        name: values if isinstance(values, str) else [tuple(row) for row in values.tolist()] for name, values in found.items()
    }


@pytest.mark.parametrize("properties", NAMES)
def test_attributes_of_a_ply_have_mitsubas_names(properties):
    assert numbers(parse_ply(ply(properties, RED_GREEN_BLUE).encode()).attributes) == NAMES[properties]
    faces = numbers(parse_ply(ply(face=properties, row="1 0 0").encode()).attributes)
    assert faces == {name.replace("vertex", "face"): rows[:1] for name, rows in NAMES[properties].items()}


def test_a_fan_of_triangles_has_the_attributes_of_its_polygon():
    text = ply(face="float r, float g, float b").replace("element face 1", "element face 2").partition("end_header")[0]
    text = (
        text.replace("element vertex 3", "element vertex 5")
        + "end_header\n"
        + "0 0 0\n" * 5
        + "4 0 1 2 3 1 0 0\n3 0 1 4 0 1 0\n"
    )
    assert parse_ply(text.encode()).attributes["face_color"].tolist() == [[1, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_triangles_of_a_polygon_have_its_material():
    text = ply(face="int material").replace("element vertex 3", "element vertex 4").replace("element face 1", "element face 2")
    text = text.partition("end_header")[0] + "end_header\n" + "0 0 0\n" * 4 + "4 0 1 2 3 7\n3 0 1 3 8\n"
    assert parse_ply(text.encode()).face_materials.tolist() == [7, 7, 8]


def test_a_property_named_twice_is_refused():
    with pytest.raises(ValueError, match="has the property 'r' of vertex twice"):
        parse_ply(ply("float r, float r, float b", RED_GREEN_BLUE).encode())


def test_a_name_that_is_no_text_is_refused():
    with pytest.raises(SceneError, match="attribute 1: must begin with vertex_"):
        Mesh(np.array(CORNERS, float), np.array([[0, 1, 2]]), np.zeros(1, int), attributes={1: COLORS})


@pytest.mark.parametrize("exact", [False, True])
def test_written_attributes_come_back(tmp_path, exact):
    random = np.random.default_rng(1)
    names = ["color", "foo", "foo_color", "a_b", "color_color"]
    given = {f"vertex_{name}": random.random((3, 3)).astype(np.float32) for name in names}
    given |= {
        "vertex_one": random.random((3, 1)).astype(np.float32),
        "vertex_one_color": random.random((3, 1)).astype(np.float32),
    }
    given |= {name.replace("vertex", "face"): values[:1] for name, values in given.items()}
    write_ply(tmp_path / "m.ply", np.array(CORNERS, float), np.array([[0, 1, 2]]), exact=exact, attributes=given)
    found = parse_ply((tmp_path / "m.ply").read_bytes()).attributes
    assert found.keys() == given.keys()
    assert all(np.array_equal(found[name], given[name]) for name in given)


def mapping(mesh, attribute="vertex_color", **more):
    textures = {"tint": {"attribute": attribute, **more}}
    materials = {"painted": {"diffuse": {"reflectance": "tint"}}}
    shapes = [{**(mesh if "sphere" in mesh else {"mesh": mesh}), "material": "painted"}]
    return {"raybench_scene": 1, "camera": CAMERA, "textures": textures, "materials": materials, "shapes": shapes}


def loaded(tmp_path, text, attribute="vertex_color", **more):
    (tmp_path / "m.ply").write_text(text, encoding="ascii")
    return engines.scene_from(mapping({"file": "m.ply"}, attribute, **more), folder=tmp_path)


def listed(**attributes):
    return {"vertices": CORNERS, "faces": [[0, 1, 2]], "attributes": attributes}


def test_a_ply_gives_a_mesh_the_attributes_that_its_material_shows(tmp_path):
    found = loaded(tmp_path, ply(RGB, RED_GREEN_BLUE, "float heat_0", "0.5"), scale=0.5)
    (mesh,) = found.shapes
    assert numbers(mesh.attributes) == {"vertex_color": COLORS} and mesh.attributes["vertex_color"].dtype == np.float32
    assert found.materials[0].bsdf == Diffuse(MeshAttribute("vertex_color", 0.5)) and mesh.uvs is None
    assert not any("texture coordinates" in warning for warning in found.warnings)
    assert numbers(loaded(tmp_path, ply(face="float heat_0", row="0.5"), "face_heat").shapes[0].attributes) == {
        "face_heat": [(0.5,)]
    }


def test_a_serialized_file_gives_its_vertex_colours(tmp_path):
    file = serialized(4, packed(4, False, CORNERS, [[0, 1, 2]], colors=True))
    (tmp_path / "m.serialized").write_bytes(file)
    (mesh,) = engines.scene_from(mapping({"file": "m.serialized"}), folder=tmp_path).shapes
    assert numbers(mesh.attributes) == {"vertex_color": [(1, 1, 1)] * 3}


def test_listed_attributes_may_be_lists_or_arrays():
    for rows in (COLORS, np.array(COLORS, np.uint8), np.array(COLORS, float)):
        (mesh,) = engines.scene_from(mapping(listed(vertex_color=rows))).shapes
        assert numbers(mesh.attributes) == {"vertex_color": COLORS} and not mesh.attributes["vertex_color"].flags.writeable


def test_a_mesh_from_python_copies_what_can_be_written_to():
    given = np.array(COLORS, np.float32)
    mesh = Mesh(
        np.array(CORNERS, float), np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32), attributes={"vertex_color": given}
    )
    given[:] = 0
    assert numbers(mesh.attributes) == {"vertex_color": COLORS}
    with pytest.raises(ValueError, match="read-only"):
        mesh.attributes["vertex_color"][0, 0] = 1
    assert replace(mesh, name="other").attributes["vertex_color"] is mesh.attributes["vertex_color"]


def test_copies_of_vertices_keep_their_attributes():
    found = of_copies({"vertex_a": np.eye(3, dtype=np.float32), "face_a": np.ones((1, 1), np.float32)}, np.array([2, 0]))
    assert found["vertex_a"].tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], [1, 0, 0]] and len(found["face_a"]) == 1


LISTED = {
    "color": ({"color": COLORS}, "attribute 'color': must begin with vertex_ or face_"),
    "too few": ({"vertex_color": COLORS[:2]}, "attribute 'vertex_color': int64 array (2, 3): must be 3 rows of 1 or 3 numbers"),
    "of faces": ({"face_color": COLORS}, "attribute 'face_color': int64 array (3, 3): must be 1 rows of 1 or 3 numbers"),
    "pairs": ({"vertex_color": [[0, 1]] * 3}, "(3, 2): must be 3 rows of 1 or 3 numbers"),
    "uneven": ({"vertex_color": [[0, 1], [0], [1]]}, "attributes.vertex_color: must be rows of 1 or 3 numbers"),
    "words": ({"vertex_color": ["red"] * 3}, "array (3,): must be 3 rows of 1 or 3 numbers"),
    "above 1": ({"vertex_color": [[0, 1, 1.5]] * 3}, "attribute 'vertex_color': must lie in [0, 1]"),
    "nan": ({"vertex_color": [[0, 1, np.nan]] * 3}, "attribute 'vertex_color': must lie in [0, 1]"),
}


@pytest.mark.parametrize("case", LISTED)
def test_wrong_attributes_are_refused_in_one_line(case):
    attributes, said = LISTED[case]
    with pytest.raises(SceneError) as refused:
        engines.scene_from(mapping(listed(**attributes)))
    assert said in str(refused.value) and "shapes[0].mesh.attributes" in str(refused.value) and "\n" not in str(refused.value)


FILES = {
    "integers": ("uchar red, uchar green, uchar blue", "255 0 0", "has integers, where floats in [0, 1] are expected"),
    "alpha": (f"{RGB}, float a", "1 0 0 1", "has 4 numbers, where 1 or 3 are expected"),
    "above 1": (RGB, "255 0 0", "must lie in [0, 1]"),
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_is_refused_for_attributes_that_are_shown_alone(tmp_path, case):
    properties, row, said = FILES[case]
    with pytest.raises(SceneError) as refused:
        loaded(tmp_path, ply(properties, (row,) * 3))
    assert f"m.ply': attribute 'vertex_color': {said}" in str(refused.value) and "\n" not in str(refused.value)
    unread = loaded(tmp_path, ply(f"{properties}, float heat_0", (f"{row} 0.5",) * 3), "vertex_heat")
    assert unread.shapes[0].attributes.keys() == {"vertex_heat"}


def test_a_shape_that_lacks_the_attribute_is_refused_by_material_attribute_and_shape(tmp_path):
    said = "shapes[0]: material 'painted' shows the attribute 'vertex_color', which {} does not have"
    for mesh, who in ((listed(), "the mesh 'inline mesh'"), ({"sphere": {"center": [0, 0, 0], "radius": 1}}, "a sphere")):
        with pytest.raises(SceneError) as refused:
            engines.scene_from(mapping(mesh))
        assert str(refused.value).endswith(said.format(who))
    with pytest.raises(SceneError, match=r"which the mesh 'm\.ply' does not have"):
        loaded(tmp_path, ply())


@pytest.mark.parametrize(
    "engine", ["numpy", "numba", "embree", pytest.param("mitsuba_scalar", marks=marks_of("mitsuba_scalar"))]
)
def test_engines_decline_a_scene_from_python_that_lacks_one(engine):
    camera = engines.scene_from(mapping(listed(vertex_color=COLORS))).camera
    held = Scene("s", camera, (Material("m", bsdf=Diffuse(MeshAttribute("vertex_color"))),), (Sphere((0, 0, 0), 1, 0),), (), "")
    why = engines.engine(engine).why_not(held, Settings(sampler="random"))
    assert why is not None
    assert why.endswith("material 'm' shows the attribute 'vertex_color', which a sphere does not have")


def test_bumps_and_normal_maps_take_no_attributes():
    for wrapper, said in (
        ({"bump": {"height": "tint", "of": {}}}, "has no slope"),
        ({"normal_map": {"map": "tint", "of": {}}}, "no normals"),
    ):
        with pytest.raises(SceneError, match=said):
            engines.scene_from({**mapping(listed(vertex_color=COLORS)), "materials": {"painted": wrapper}})
    texture, base = MeshAttribute("vertex_color"), engines.scene_from(mapping(listed(vertex_color=COLORS)))
    for bsdf in (Bump(texture, 1.0, Diffuse()), NormalMap(texture, Diffuse())):
        held = replace(base, materials=(Material("m", bsdf=bsdf),))
        with pytest.raises(Unsupported, match="'vertex_color' is no height and gives no normals"):
            engines.engine("numpy").prepare(held, Settings())


@pytest.mark.parametrize(
    ("texture", "said"),
    [
        ({"attribute": "color"}, "tint.attribute = 'color': must begin with vertex_ or face_"),
        ({"attribute": "vertex_"}, "must begin with vertex_ or face_"),
        ({"attribute": "vertex_two words"}, "and go on with letters, digits and _"),
        ({"attribute": "vertex_color", "scale": -1}, "tint.scale = -1: must lie in [0, inf]"),
        ({"attribute": "vertex_color", "offset": [0, 0]}, "tint.offset: unknown key"),
    ],
)
def test_wrong_textures_are_refused(texture, said):
    with pytest.raises(SceneError) as refused:
        engines.scene_from({**mapping(listed(vertex_color=COLORS)), "textures": {"tint": texture}})
    assert said in str(refused.value)


def test_bounds_hold_for_all_that_meshes_may_have():
    assert largest(MeshAttribute("vertex_a", 0.25)) == (0.25,) * 3 and largest(MeshAttribute("vertex_a", 4.0)) == (1.0,) * 3
    assert mean_color(MeshAttribute("vertex_a", 4.0)) == (2.0,) * 3
    assert tinted(MeshAttribute("vertex_a", 4.0), (0.5,) * 3) == MeshAttribute("vertex_a", 2.0)
    assert not Material("m", bsdf=Plastic(MeshAttribute("vertex_a"))).uses_uvs
    assert (
        not Material("m", emission=MeshAttribute("vertex_a")).uses_uvs
        and Material("m", emission=MeshAttribute("vertex_a")).emits
    )


def test_attributes_count_where_a_material_shows_them():
    base = engines.scene_from(mapping(listed(vertex_color=COLORS)))

    def hashed(texture, **attributes):
        mesh = replace(base.shapes[0], attributes={name: np.array(rows) for name, rows in attributes.items()})
        return content_hash(base.camera, [Material("m", bsdf=Diffuse(texture))], [mesh], [])

    shown = MeshAttribute("vertex_color")
    first = hashed(shown, vertex_color=COLORS)
    assert hashed(shown, vertex_color=COLORS, vertex_other=COLORS) == first
    others = [
        hashed(shown, vertex_color=COLORS[::-1]),
        hashed(MeshAttribute("vertex_color", 0.5), vertex_color=COLORS),
        hashed(MeshAttribute("vertex_other"), vertex_other=COLORS),
        hashed((0.5,) * 3),
    ]
    assert len({first, *others}) == 5 and hashed((0.5,) * 3, vertex_color=COLORS) == others[-1]


def test_the_schema_of_scenes_is_json():
    assert "Infinity" not in json.dumps(scene_schema())


def test_a_lamp_of_scale_0_comes_back(tmp_path):
    given = mapping(listed(vertex_color=COLORS), scale=0)
    given["materials"]["painted"] |= {"emission": "tint"}
    base = engines.scene_from(given)
    assert engines.load_scene(engines.save_scene(base, tmp_path)).content_hash == base.content_hash


def test_a_written_scene_comes_back_with_its_attributes(tmp_path):
    faces = {"face_color": [[0.1, 0.2, 0.7]], "vertex_heat": np.random.default_rng(3).random((3, 1))}
    given = mapping(listed(vertex_color=np.random.default_rng(2).random((3, 3)), **faces), scale=0.75)
    given["textures"] |= {"face": {"attribute": "face_color"}, "heat": {"attribute": "vertex_heat"}}
    given["materials"]["painted"] = {"blend": {"weight": "heat", "a": {"kd": "tint"}, "b": {"kd": "face"}}}
    base = engines.scene_from(given)
    again = engines.load_scene(engines.save_scene(base, tmp_path))
    assert again.content_hash == base.content_hash and again.materials[0].bsdf == base.materials[0].bsdf
    assert numbers(again.shapes[0].attributes) == numbers(base.shapes[0].attributes)


# ---- Mitsuba's XML ---------------------------------------------------------------------------------------------------


def shape_with(texture, kind="ply", more=""):
    return f'<shape type="{kind}"><string name="filename" value="m.{kind}"/>{more}<bsdf type="diffuse">{texture}</bsdf></shape>'


def named(name="vertex_color", more="", kind="mesh_attribute"):
    return f'<texture type="{kind}" name="reflectance"><string name="name" value="{name}"/>{more}</texture>'


def test_red_green_and_blue_vertices_mix_by_the_weights_of_the_place(tmp_path):
    (tmp_path / "m.ply").write_text(ply(RGB, RED_GREEN_BLUE, RGB, "0.1 0.2 0.3"), encoding="ascii")
    assert radiance(tmp_path, shape_with(named()) + SUN, (0.25, 0.5)) == pytest.approx([0.25, 0.25, 0.5], abs=1e-4)
    halved = named(more='<float name="scale" value="0.5"/>')
    assert radiance(tmp_path, shape_with(halved) + SUN, (0.25, 0.5)) == pytest.approx([0.125, 0.125, 0.25], abs=1e-4)
    assert radiance(tmp_path, shape_with(named("face_color")) + SUN, (0.25, 0.5)) == pytest.approx([0.1, 0.2, 0.3], abs=1e-4)
    old = '<texture type="vertexcolors" name="reflectance"/>'
    assert radiance(tmp_path, shape_with(old) + SUN, (0.25, 0.5)) == pytest.approx([0.25, 0.25, 0.5], abs=1e-4)
    scaled = f'<texture type="scale" name="reflectance"><float name="scale" value="0.5"/>{named()}</texture>'
    assert radiance(tmp_path, shape_with(scaled) + SUN, (0.25, 0.5)) == pytest.approx([0.125, 0.125, 0.25], abs=1e-4)


def test_a_smooth_mesh_some_of_whose_normals_cancel_keeps_its_attributes(tmp_path):
    rows = ("0 0 0 1 0 0", "0 0 1 0 1 0", "0 0 1 0 0 1")
    (tmp_path / "m.ply").write_text(ply(f"float nx, float ny, float nz, {RGB}", rows), encoding="ascii")
    assert radiance(tmp_path, shape_with(named()) + SUN, (0.25, 0.5)) == pytest.approx([0.25, 0.25, 0.5], abs=1e-4)


def test_an_area_emitter_shows_an_attribute(tmp_path):
    (tmp_path / "m.ply").write_text(ply(RGB, RED_GREEN_BLUE), encoding="ascii")
    light = named(more='<float name="scale" value="8"/>').replace("reflectance", "radiance")
    body = f'<shape type="ply"><string name="filename" value="m.ply"/><emitter type="area">{light}</emitter></shape>'
    assert radiance(tmp_path, body, (0.25, 0.5)) == pytest.approx([2, 2, 4], abs=1e-3)


def test_what_lacks_an_attribute_is_refused_with_its_name(tmp_path):
    (tmp_path / "m.ply").write_text(ply(), encoding="ascii")
    assert "shows the attribute 'vertex_color', which the file does not have" in refusal(tmp_path, shape_with(named()) + LAMP)
    round_one = f'<shape type="sphere"><bsdf type="diffuse">{named()}</bsdf></shape>{LAMP}'
    assert "shows the attribute 'vertex_color', which a sphere does not have" in refusal(tmp_path, round_one)
    assert "must begin with vertex_ or face_" in refusal(tmp_path, shape_with(named("color")) + LAMP)
    (tmp_path / "m.ply").write_text(ply(RGB, RED_GREEN_BLUE), encoding="ascii")
    tilted = shape_with(named()).replace('"diffuse">', '"bumpmap">').replace("</bsdf>", '<bsdf type="diffuse"/></bsdf>')
    assert "an image is expected" in refusal(tmp_path, tilted + LAMP)
    coloured = f'<texture type="scale" name="reflectance"><rgb name="scale" value="1 0 0"/>{named()}</texture>'
    assert "by a number, not by a colour" in refusal(tmp_path, shape_with(coloured) + LAMP)
    assert scene(tmp_path, shape_with(named()) + LAMP).shapes[0].attributes.keys() == {"vertex_color"}
