"""glTF files as scenes: the file, meshes, nodes, cameras and lights."""

import numpy as np
import pytest

import engines
from engines.errors import SceneError
from engines.scene import DirectionalLight, EnvironmentLight, Orthographic, Perspective, PointLight, SpotLight
from engines.scene.gltf.document import Document
from tests.gltf_file import CORNERS, SQUARE, GltfFile


def loaded(folder, file):
    return engines.load_scene(file.write(folder))


def triangles(shape):
    """(m, 3, 3) corners of the faces."""
    return shape.vertices[shape.faces]


def pointing(shape):
    """(m, 3) normals of the faces by their winding."""
    corners = triangles(shape)
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


# ---- the file --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["glb", "embedded", "beside"])
def test_every_form_of_file_is_the_same_scene(tmp_path, way):
    file = GltfFile()
    whole = loaded(tmp_path, file)
    if way == "beside":
        (tmp_path / "a b.bin").write_bytes(file.data)
    name = tmp_path / ("m.glb" if way == "glb" else "m.gltf")
    if way != "glb":
        name.write_text(file.gltf("a%20b.bin" if way == "beside" else ""))
    scene = engines.load_scene(name)
    assert scene.content_hash == whole.content_hash and scene.warnings == () and scene.name == "m"
    np.testing.assert_array_equal(triangles(scene.shapes[0]), np.array(SQUARE, float)[CORNERS].reshape(2, 3, 3))


def test_a_file_without_camera_and_lights_is_framed_under_the_sky_of_mesh_files(tmp_path):
    obj = "".join(f"v {x} {y} {z}\n" for x, y, z in SQUARE) + "f 1 2 3\nf 1 3 4\n"
    (tmp_path / "m.obj").write_text(obj)
    mesh, scene = engines.load_scene(tmp_path / "m.obj"), loaded(tmp_path, GltfFile())
    assert scene.camera == mesh.camera and scene.lights[1] == mesh.lights[1]
    assert scene.lights[0].radiance == mesh.lights[0].radiance and len(scene.lights) == 2
    film = engines.engine("numpy").prepare(scene, engines.Settings(16, 12, sampler="random")).render(4)
    assert len(np.unique(film.mean().round(2))) > 1 and film.bad_samples == 0


# ---- meshes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_indices_of_all_types_are_read(tmp_path, dtype):
    file = GltfFile()
    file.primitive["indices"] = file.accessor([2, 1, 0], dtype)
    np.testing.assert_array_equal(triangles(loaded(tmp_path, file).shapes[0])[0], np.array(SQUARE)[[2, 1, 0]])


@pytest.mark.parametrize(
    ("mode", "indices", "faces"),
    [(4, None, [[0, 1, 2]]), (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]), (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]])],
)
def test_lists_strips_and_fans_keep_their_winding(tmp_path, mode, indices, faces):
    file = GltfFile()
    file.primitive["mode"] = mode
    if indices is None:
        del file.primitive["indices"]
        file.primitive["attributes"] = {"POSITION": file.accessor(SQUARE[:3])}
    else:
        file.primitive["indices"] = file.accessor(indices, "u1")
    (shape,) = loaded(tmp_path, file).shapes
    np.testing.assert_array_equal(triangles(shape), np.array(SQUARE)[faces])
    assert (pointing(shape)[:, 2] > 0).all()


def test_interleaved_sparse_and_quantised_positions_are_read(tmp_path):
    plain = triangles(loaded(tmp_path, GltfFile()).shapes[0])
    mixed = GltfFile()
    view = mixed.view(np.hstack([np.array(SQUARE, "<f4"), np.full((4, 2), 9.0, "<f4")]).tobytes(), byteStride=20)
    item = {"bufferView": view, "componentType": 5126, "count": 4, "type": "VEC3"}
    mixed.primitive["attributes"]["POSITION"] = mixed.add("accessors", **item)
    np.testing.assert_array_equal(triangles(loaded(tmp_path, mixed).shapes[0]), plain)
    quantised = GltfFile()
    quantised.primitive["attributes"]["POSITION"] = quantised.accessor(np.array(SQUARE) * 127, "i1", normalized=True)
    np.testing.assert_array_equal(triangles(loaded(tmp_path, quantised).shapes[0]), plain)
    whole = GltfFile()
    whole.primitive["attributes"]["POSITION"] = whole.accessor(np.array(SQUARE) * 3, "u2")
    whole.tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    np.testing.assert_array_equal(triangles(loaded(tmp_path, whole).shapes[0]), 3 * plain)
    sparse = GltfFile()
    values, where = (sparse.view(np.array(rows).tobytes()) for rows in (np.array([[5, 6, 7]], "<f4"), np.array([2], "<u2")))
    changes = {"count": 1, "indices": {"bufferView": where, "componentType": 5123}, "values": {"bufferView": values}}
    sparse.tree["accessors"][0]["sparse"] = changes
    found = triangles(loaded(tmp_path, sparse).shapes[0])
    np.testing.assert_array_equal(found[0], [[0, 0, 0], [1, 0, 0], [5, 6, 7]])


def test_a_mesh_is_smooth_only_where_it_has_normals(tmp_path):
    assert loaded(tmp_path, GltfFile()).shapes[0].normals is None
    file = GltfFile()
    file.primitive["attributes"]["NORMAL"] = file.accessor([[0, 3, 4]] * 4)
    np.testing.assert_allclose(loaded(tmp_path, file).shapes[0].normals, [[0, 0.6, 0.8]] * 4)


def test_points_and_lines_are_left_out_with_a_note(tmp_path):
    file = GltfFile()
    file.tree["meshes"][0]["primitives"].append({**file.primitive, "mode": 1})
    scene = loaded(tmp_path, file)
    assert len(scene.shapes) == 1 and scene.warnings == ("mesh 'mesh_0': points and lines are left out",)
    file.tree["meshes"][0]["primitives"] = [{**file.primitive, "mode": 0}]
    with pytest.raises(SceneError, match=r"m\.glb: holds no triangles that its scene shows"):
        loaded(tmp_path, file)


# ---- nodes -----------------------------------------------------------------------------------------------------------


def test_nodes_place_meshes_by_matrix_or_translation_rotation_and_scale(tmp_path):
    file = GltfFile()
    half = np.sqrt(0.5)
    turned = {"translation": [10, 0, 0], "rotation": [0, 0, half, half], "scale": [2, 3, 1]}  # 90 degrees about z
    matrix = [0, 2, 0, 0, -3, 0, 0, 0, 0, 0, 1, 0, 10, 0, 0, 1]
    file.tree["nodes"] = [{"translation": [0, 0, 5], "children": [1, 2]}, {"mesh": 0, **turned}, {"mesh": 0, "matrix": matrix}]
    first, second = loaded(tmp_path, file).shapes
    np.testing.assert_allclose(triangles(first)[0], [[10, 0, 5], [10, 2, 5], [7, 2, 5]], atol=1e-12)
    np.testing.assert_allclose(triangles(first), triangles(second), atol=1e-12)


def test_a_transform_that_mirrors_keeps_the_front_and_stretching_tilts_normals(tmp_path):
    file = GltfFile()
    file.primitive["attributes"]["NORMAL"] = file.accessor([[0.6, 0, 0.8]] * 4)
    file.tree["nodes"] = [{"mesh": 0, "scale": [-2, 1, 1]}]
    (shape,) = loaded(tmp_path, file).shapes
    assert (pointing(shape)[:, 2] > 0).all()
    expected = np.array([-0.3, 0, 0.8]) / np.hypot(0.3, 0.8)
    np.testing.assert_allclose(shape.normals, [expected] * 4)


def test_a_mesh_of_several_nodes_and_gpu_instances_is_there_as_often(tmp_path):
    file = GltfFile()
    shifts = file.accessor([[0, 0, 1], [0, 0, 2], [0, 0, 3]])
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": shifts}}}
    file.tree["nodes"] = [{"mesh": 0}, {"mesh": 0, "scale": [1, 1, 10], "extensions": instances}]
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    assert [shape.vertices[0, 2] for shape in loaded(tmp_path, file).shapes] == [0, 10, 20, 30]


def test_a_skin_places_vertices_by_its_joints_and_not_by_the_node(tmp_path):
    file = GltfFile()
    file.primitive["attributes"]["JOINTS_0"] = file.accessor([[0, 1, 0, 0]] * 4, "u1")
    file.primitive["attributes"]["WEIGHTS_0"] = file.accessor([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0]])
    back = np.eye(4)
    back[3, 0] = -1.0  # column-major: x - 1
    file.tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": file.accessor([np.eye(4).ravel(), back.ravel()])}]
    file.tree["nodes"] = [{"mesh": 0, "skin": 0, "translation": [99, 0, 0]}, {}, {"translation": [1, 0, 4]}]
    file.tree["scenes"] = [{"nodes": [0, 1, 2]}]
    scene = loaded(tmp_path, file)
    np.testing.assert_allclose(scene.shapes[0].vertices, [[0, 0, 0], [1, 0, 2], [1, 1, 4], [0, 1, 4]])
    assert scene.warnings == ("skin 'skin_0': it is shown in the pose of its nodes",)


def skinned(file, weights, *joints):
    """Gives the square these weights (4, 4), and a skin of nodes with these transforms."""
    file.primitive["attributes"]["JOINTS_0"] = file.accessor([[0, 1, 0, 0]] * 4, "u1")
    file.primitive["attributes"]["WEIGHTS_0"] = file.accessor(weights)
    file.tree["skins"] = [{"joints": list(range(1, len(joints) + 1))}]
    file.tree["nodes"] = [{"mesh": 0, "skin": 0}, *joints]
    file.tree["scenes"] = [{"nodes": list(range(len(joints) + 1))}]


def test_a_skin_that_mirrors_keeps_the_front_and_stretching_tilts_normals(tmp_path):
    file = GltfFile()
    file.primitive["attributes"]["NORMAL"] = file.accessor([[0.6, 0, 0.8]] * 4)
    skinned(file, [[1, 0, 0, 0]] * 4, {"scale": [-2, 1, 1]}, {})
    scene = loaded(tmp_path, file)
    assert (pointing(scene.shapes[0])[:, 2] > 0).all()
    np.testing.assert_allclose(scene.shapes[0].normals, [np.array([-0.3, 0, 0.8]) / np.hypot(0.3, 0.8)] * 4)
    assert scene.warnings == ("skin 'skin_0': it is shown in the pose of its nodes",)


def test_weights_of_a_skin_are_shares_of_their_sum_and_none_leave_a_vertex_where_it_is(tmp_path):
    file = GltfFile()
    skinned(file, [[2, 0, 0, 0], [1, 1, 0, 0], [0.1, 0.3, 0, 0], [0, 0, 0, 0]], {}, {"translation": [0, 0, 4]})
    np.testing.assert_allclose(loaded(tmp_path, file).shapes[0].vertices[:, 2], [0, 2, 3, 0], atol=1e-6)
    np.testing.assert_allclose(loaded(tmp_path, file).shapes[0].vertices[:, :2], np.array(SQUARE)[:, :2], atol=1e-6)


def test_a_skin_of_many_nodes_is_read_once(tmp_path, monkeypatch):
    read, array = [], Document.array

    def counted(document, node, *types, **keys):
        read.append(node.path[-1])
        return array(document, node, *types, **keys)

    monkeypatch.setattr(Document, "array", counted)
    file = GltfFile()
    skinned(file, [[1, 0, 0, 0]] * 4, {}, {})
    file.tree["skins"][0]["inverseBindMatrices"] = file.accessor([np.eye(4).ravel()] * 2)
    file.tree["nodes"] += [{"mesh": 0, "skin": 0}] * 5
    file.tree["scenes"] = [{"nodes": list(range(8))}]
    assert len(loaded(tmp_path, file).shapes) == 6 and read.count("inverseBindMatrices") == 1


def test_animations_and_morph_targets_are_at_rest_with_a_note(tmp_path):
    file = GltfFile()
    file.primitive["targets"] = [{"POSITION": 0}]
    file.tree["animations"] = [{"channels": [], "samplers": []}]
    notes = loaded(tmp_path, file).warnings
    assert "animations are not played" in notes[0] and "morph targets are not applied" in notes[1]


def test_the_default_scene_is_shown(tmp_path):
    file = GltfFile()
    file.tree |= {"scene": 1, "scenes": [{"nodes": [0]}, {"nodes": [1]}], "nodes": [{}, {"mesh": 0, "scale": [7, 7, 7]}]}
    assert loaded(tmp_path, file).shapes[0].vertices.max() == 7


def test_a_file_without_scenes_shows_all_of_its_nodes(tmp_path):
    file = GltfFile()
    del file.tree["scene"], file.tree["scenes"]
    file.tree["nodes"] = [{"mesh": 0}, {"children": [0], "scale": [3, 3, 3]}]
    scene = loaded(tmp_path, file)
    assert [shape.vertices.max() for shape in scene.shapes] == [3]
    assert scene.warnings == ("the scene: the file does not say what it shows: all nodes are shown",)


# ---- cameras and lights ----------------------------------------------------------------------------------------------


def test_the_first_camera_looks_along_minus_z_of_its_node(tmp_path):
    file = GltfFile()
    file.add("cameras", type="perspective", perspective={"yfov": np.pi / 3, "aspectRatio": 2.0, "znear": 0.1})
    file.tree["nodes"] += [{"camera": 0, "translation": [0.5, 0.5, 3]}]
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    camera = loaded(tmp_path, file).camera
    assert isinstance(camera, Perspective) and camera.resolution == (960, 480)
    assert camera.eye == (0.5, 0.5, 3.0) and camera.target == (0.5, 0.5, 0.0) and camera.up == (0, 1, 0)
    assert camera.fov == pytest.approx(60.0) and camera.fov_axis == "y"


def test_an_orthographic_camera_shows_twice_its_magnifications(tmp_path):
    file = GltfFile()
    file.add("cameras", type="orthographic", orthographic={"xmag": 2.0, "ymag": 1.0, "znear": 0, "zfar": 9})
    file.tree["nodes"] += [{"camera": 0, "translation": [0.5, 0.5, 3], "rotation": [0, 0, 1, 0]}]
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    camera = loaded(tmp_path, file).camera
    assert isinstance(camera, Orthographic) and camera.window() == (4.0, 2.0) and camera.up == pytest.approx((0, -1, 0))


def test_punctual_lights_take_the_place_of_the_sky(tmp_path):
    file = GltfFile()
    lights = [
        {"type": "point", "color": [1, 0.5, 0], "intensity": 8},
        {"type": "spot", "intensity": 2, "spot": {"innerConeAngle": np.pi / 6, "outerConeAngle": np.pi / 4}},
        {"type": "directional", "intensity": 3},
    ]
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    half = np.sqrt(0.5)
    place = {"translation": [1, 2, 3], "rotation": [-half, 0, 0, half], "scale": [5, 5, 5]}  # -z comes to lie along -y
    file.tree["nodes"] += [{**place, "extensions": {"KHR_lights_punctual": {"light": index}}} for index in range(3)]
    file.tree["scenes"] = [{"nodes": [0, 1, 2, 3]}]
    point, spot, sun = loaded(tmp_path, file).lights
    assert point == PointLight((1, 2, 3), (8, 4, 0))
    assert isinstance(spot, SpotLight) and (spot.cutoff, spot.beam_width) == (pytest.approx(45), pytest.approx(30))
    assert isinstance(sun, DirectionalLight) and sun.irradiance == (3, 3, 3)
    assert spot.direction == sun.direction == pytest.approx((0, -1, 0))


def test_what_emits_stands_under_the_sky_all_the_same(tmp_path):
    file = GltfFile()
    file.material(emissiveFactor=[1, 1, 1])
    assert [type(light) for light in loaded(tmp_path, file).lights] == [EnvironmentLight, DirectionalLight]
