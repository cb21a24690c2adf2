"""glTF files that cannot be read, or lie: one line each, in bounded time and memory."""

import base64
import json
import os
import re
import struct
from time import perf_counter

import numpy as np
import pytest

import engines
from engines.errors import SceneError
from engines.input_files import files_opened
from engines.scene.gltf import document, meshes, textures
from tests.gltf_file import GltfFile


def loaded(folder, file):
    return engines.load_scene(file.write(folder))


def refused(folder, file, pattern):
    path = folder / "m.gltf"
    path.write_text(file if isinstance(file, str) else file.gltf())
    with pytest.raises(SceneError, match=pattern) as found:
        engines.load_scene(path)
    assert str(found.value).isprintable() and len(str(found.value)) < 1000


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("KHR_draco_mesh_compression", "decompress it"),
        ("EXT_meshopt_compression", "export it without compression"),
        ("KHR_texture_basisu", "convert its images to PNG"),
        ("ACME_unheard", "save it without"),
    ],
)
def test_an_extension_that_a_file_cannot_do_without_is_refused_with_a_remedy(tmp_path, name, remedy):
    file = GltfFile()
    file.tree["extensionsRequired"] = [name]
    refused(tmp_path, file, rf"m\.gltf extensionsRequired: '{name}' is not read: {remedy}")


def test_compressed_data_without_another_form_is_refused_and_with_one_read(tmp_path):
    file = GltfFile()
    file.primitive["extensions"] = {"KHR_draco_mesh_compression": {}}
    assert len(loaded(tmp_path, file).shapes) == 1
    del file.tree["accessors"][0]["bufferView"]
    refused(tmp_path, file, r"meshes\[0\]\.primitives\[0\]: is compressed with Draco, which is not read: decompress it")
    file = GltfFile()
    file.material(pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    file.tree["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}}]
    refused(tmp_path, file, r"textures\[0\]: is a KTX2 image, which is not read: convert its images to PNG")


def test_unknown_extensions_that_are_only_used_give_a_note(tmp_path):
    file = GltfFile()
    file.tree["extensionsUsed"] = ["KHR_materials_ior", "KHR_materials_iridescence\n", "KHR_materials_pbrSpecularGlossiness"]
    first, second = loaded(tmp_path, file).warnings
    assert first == r"extension 'KHR_materials_iridescence\n': not read"
    assert second.endswith("not read: convert its materials, such as with gltf-transform's metalrough")
    file.tree["extensionsUsed"] = file.tree["extensionsRequired"] = ["KHR_materials_variants"]
    assert loaded(tmp_path, file).warnings == ("extension 'KHR_materials_variants': not read: materials are those by default",)


def edited(path, value):
    """A text file with one value of its tree replaced."""
    tree = json.loads(GltfFile().gltf())
    node = tree
    for step in path[:-1]:
        node = node[step]
    node[path[-1]] = value
    return json.dumps(tree)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("buffers", 0, "byteLength"), 10**12, r"buffers\[0\]: byteLength is 1000000000000, and there are \d+ bytes"),
        (("bufferViews", 0, "byteLength"), 10**9, r"bufferViews\[0\]: ends at byte 1000000000 of a buffer of \d+"),
        (("bufferViews", 0, "byteOffset"), -1, r"bufferViews\[0\]\.byteOffset = -1: must be an integer in \[0, "),
        (("accessors", 0, "count"), 2**31 - 1, r"accessors\[0\]: 2147483647 elements end at byte \d+ of a buffer view of 48"),
        (("accessors", 0, "byteOffset"), 2**50, r"accessors\[0\]: 4 elements end at byte"),
        (("accessors", 0, "componentType"), 5124, r"accessors\[0\]\.componentType: 5124: must be one of 5120,"),
        (("accessors", 0), {"componentType": 5126, "count": 10**9, "type": "VEC3"}, r"more numbers than the buffers hold"),
        (("accessors", 2, "componentType"), 5126, r"accessors\[2\]\.componentType: 5126: must be one of 5121, 5123, 5125"),
        (("accessors", 2, "componentType"), 5125, r"accessors\[2\]: 6 elements end at byte 24"),
        (
            ("accessors", 0, "type"),
            json.loads("[" * 800 + "]" * 800),
            r"accessors\[0\]\.type: unknown type of accessor: known:",
        ),
        (("nodes", 0, "mesh"), 0.0, r"nodes\[0\]\.mesh = 0\.0: must be an integer"),
        (("nodes", 0, "mesh"), 7, r"nodes\[0\]\.mesh = 7: there are 1 meshes, counted from 0"),
        (("nodes", 0, "children"), [0], r"nodes\[0\]\.children\[0\] = 0: this node is its own ancestor, or has two parents"),
        (("nodes", 0, "matrix"), [1e999] * 16, r"nodes\[0\]\.matrix\[0\] = inf: must be finite"),
        (("nodes", 0, "scale"), [1e300, 1, 1], r"nodes\[0\]: its transform leaves the range of numbers"),
        (("nodes", 0, "rotation"), [0, 0, 0, 0], r"nodes\[0\]: a rotation must be a quaternion, and not 0"),
        (("scenes", 0, "nodes"), [0, 0], r"scenes\[0\]\.nodes\[1\] = 0: this node is its own ancestor, or has two parents"),
        (("asset", "version"), "1.0", r"is glTF '1\.0': version 2\.0 is read; save it as that"),
        (("buffers", 0, "uri"), "data:text/plain,hello", r"buffers\[0\]\.uri: is not a data URI in base64"),
        (("buffers", 0, "uri"), "data:;base64,AA=A", r"buffers\[0\]\.uri: is not a data URI in base64"),
        (("buffers", 0, "uri"), "../secret.bin", r"buffers\[0\]\.uri = '\.\./secret\.bin': lies outside the scene's folder"),
        (("buffers", 0, "uri"), "..%2Fsecret.bin", r"lies outside the scene's folder"),
        (("buffers", 0, "uri"), "/dev/zero", r"lies outside the scene's folder"),
        (("buffers", 0, "uri"), "gone.bin", r"buffers\[0\]\.uri = 'gone\.bin': no such file"),
        (("buffers", 0, "uri"), "fifo", r"buffers\[0\]\.uri = 'fifo': is not a regular file but a FIFO"),
        (("meshes", 0, "primitives"), "x", r"meshes\[0\]\.primitives = 'x': must be a list"),
    ],
)
def test_lies_and_wrong_values_are_refused_in_one_line(tmp_path, path, value, message):
    (tmp_path / "inner").mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(200))
    os.mkfifo(tmp_path / "inner" / "fifo")
    refused(tmp_path / "inner", edited(path, value), message)


def test_indices_and_numbers_out_of_range_are_refused(tmp_path):
    file = GltfFile()
    file.primitive["indices"] = file.accessor([0, 1, 4], "u2")
    refused(tmp_path, file, r"primitives\[0\]\.indices = 3: a corner is vertex 4 of 4")
    file.primitive["indices"] = file.accessor([0, 1, 2, 3], "u2")
    refused(tmp_path, file, r"primitives\[0\]: has 4 corners: three for each triangle are expected")
    file = GltfFile()
    file.primitive["attributes"]["POSITION"] = file.accessor([[0, 0, 0], [1, 0, np.inf], [1, 1, 0], [0, 1, 0]])
    refused(tmp_path, file, r"POSITION = 3: vertices must be finite")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda data: data[:10], "is cut short: a .glb has a header of 20 bytes"),
        (lambda data: data[:-4], r"is cut short: its header says \d+ bytes, and it has \d+"),
        (lambda data: data[:4] + struct.pack("<I", 1) + data[8:], r"is a \.glb of version 1"),
        (lambda data: data[:12] + struct.pack("<I", 2**32 - 1) + data[16:], r"a chunk at byte 12 says 4294967295 bytes"),
        (lambda data: data[:16] + b"BIN\0" + data[20:], "the first chunk of a .glb must be JSON"),
        (lambda data: data.replace(b'{"asset"', b"\xff\xff\xff\xff\xff\xff\xff\xff"), "is not a glTF file: 'utf-8' codec"),
    ],
)
def test_a_damaged_container_is_refused_in_one_line(tmp_path, damage, message):
    (tmp_path / "m.glb").write_bytes(damage(GltfFile().glb()))
    with pytest.raises(SceneError, match=rf"m\.glb: {message}"):
        engines.load_scene(tmp_path / "m.glb")


def test_a_thousand_nested_nodes_are_read_and_deep_json_is_refused(tmp_path):
    file = GltfFile()
    file.tree["nodes"] = [{"children": [index + 1], "translation": [0, 0, 1]} for index in range(1000)] + [{"mesh": 0}]
    assert loaded(tmp_path, file).shapes[0].vertices[0, 2] == 1000
    deep = '{"extras":' + "[" * 100_000 + "]" * 100_000 + "}"
    refused(tmp_path, deep, r"m\.gltf: is not a glTF file: nested too deeply")


def test_data_uris_of_a_gigabyte_are_refused_before_they_are_read(tmp_path):
    path = tmp_path / "m.gltf"
    with path.open("wb") as stream:
        stream.write(b'{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 1, "uri": "data:;base64,')
        stream.truncate(10**9)
    start = perf_counter()
    with pytest.raises(SceneError, match=r"m\.gltf: larger than 256 MiB: put its buffers into files, or write a \.glb"):
        engines.load_scene(path)
    assert perf_counter() - start < 1.0


def test_json_is_limited_beside_its_data_uris(tmp_path, monkeypatch):
    monkeypatch.setattr(document, "MAX_JSON", 2000)
    file = GltfFile()
    file.data += bytes(4000)
    (tmp_path / "m.gltf").write_text(file.gltf())
    assert len(engines.load_scene(tmp_path / "m.gltf").shapes) == 1
    file.tree["extras"] = "x" * 2000
    refused(tmp_path, file, r"has more than 0 MiB of JSON beside its data URIs")


def test_many_copies_of_little_data_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(meshes, "MAX_COPIED", 256)
    file = GltfFile()
    file.tree["nodes"] = [{"mesh": 0} for _ in range(20)]
    file.tree["scenes"] = [{"nodes": list(range(20))}]
    refused(tmp_path, file, r"nodes\[\d+\]\.mesh = 0: nodes show more than [\d,]+ triangles in all")


def test_images_of_many_pixels_in_few_bytes_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(textures, "MAX_PIXELS", 100)
    monkeypatch.setattr(textures, "PIXELS_PER_BYTE", 0)
    file = GltfFile()
    file.material(pbrMetallicRoughness={"baseColorTexture": file.image(np.zeros((8, 16, 3)))})
    refused(tmp_path, file, r"images\[0\]: with those before it has 128 pixels")


def test_a_damaged_image_is_refused_with_its_place(tmp_path):
    file = GltfFile()
    file.material(pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    file.tree |= {
        "textures": [{"source": 0}],
        "images": [{"uri": "data:image/png;base64," + base64.b64encode(b"x" * 50).decode()}],
    }
    refused(tmp_path, file, re.escape("m.gltf images[0]: is not a usable image: the content of one of PNG"))


def test_an_image_beside_the_file_is_read_from_its_folder_alone(tmp_path):
    from PIL import Image

    (tmp_path / "inner").mkdir()
    for folder in (tmp_path, tmp_path / "inner"):
        Image.fromarray(np.full((1, 1, 3), 255, np.uint8)).save(folder / "t.png")
    file = GltfFile()
    file.material(pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    file.tree |= {"textures": [{"source": 0}], "images": [{"uri": "t.png"}]}
    (material,) = loaded(tmp_path / "inner", file).materials
    assert material.bsdf.base_color.pixels.tolist() == [[[1, 1, 1]]]
    file.tree["images"] = [{"uri": "../t.png"}]
    refused(tmp_path / "inner", file, r"images\[0\]\.uri = '\.\./t\.png': lies outside the scene's folder")
    file.write(tmp_path / "inner")
    assert engines.load_scene(tmp_path / "inner" / "m.glb", allow_outside=True).shapes


@pytest.mark.parametrize("way", ["escaped", "unicode", "percent"])
def test_data_uris_are_read_however_json_and_uris_escape_them(tmp_path, way):
    file = GltfFile()
    file.data += b"\xff\xef\xfe\xfb" * 3  # with + and / in base64
    text = file.gltf()
    start = text.index("data:")
    uri = text[start : text.index('"', start)]
    kind, data = uri.split(",")
    assert "/" in data and "+" in data
    ways = {"escaped": uri.replace("/", r"\/"), "unicode": rf"\u0064{uri[1:]}"}
    ways["percent"] = f"{kind},{data.replace('+', '%2B').replace('/', '%2f').replace('=', '%3D')}"
    (tmp_path / "m.gltf").write_text(text.replace(uri, ways[way]))
    assert engines.load_scene(tmp_path / "m.gltf").content_hash == loaded(tmp_path, file).content_hash


@pytest.mark.parametrize("data", [r"\u0031" + "1" * 4300, ";base64,AA%41A", ";base64,AA AA"])
def test_what_is_no_base64_is_refused_and_not_skipped(tmp_path, data):
    text = edited(("buffers", 0, "uri"), "data:?").replace("data:?", f"data:{data}")
    refused(tmp_path, text, r"buffers\[0\]\.uri: is not a data URI in base64")


def test_a_file_that_several_buffers_name_is_read_once(tmp_path):
    tree = json.loads(GltfFile().gltf("m.bin"))
    tree["buffers"] *= 3
    for index, view in enumerate(tree["bufferViews"]):
        view["buffer"] = index
    (tmp_path / "m.bin").write_bytes(GltfFile().data)
    (tmp_path / "m.gltf").write_text(json.dumps(tree))
    with files_opened() as opened:
        engines.load_scene(tmp_path / "m.gltf")
    assert [path.name for path in opened] == ["m.gltf", "m.bin"]


def test_an_image_that_is_named_again_and_again_has_no_more_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr(textures, "MAX_PIXELS", 100)
    monkeypatch.setattr(textures, "PIXELS_PER_BYTE", 16)
    file = GltfFile()
    index = file.image(np.zeros((32, 32, 3)))["index"]
    primitives = file.tree["meshes"][0]["primitives"]
    for _ in range(20):
        file.material(pbrMetallicRoughness={"baseColorTexture": {"index": index}})
        primitives.append({**file.primitive})
        index = file.add("textures", source=file.add("images", **file.tree["images"][0]))
    assert len(file.tree["images"]) * 1024 > 16 * 1.1 * len(file.data)
    refused(tmp_path, file, r"images\[\d+\]: with those before it has \d+ pixels")


def test_meshes_without_triangles_count_and_primitives_count_as_they_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(meshes, "MAX_COPIED", 256)
    file = GltfFile()
    file.primitive["mode"] = 0
    file.tree["nodes"] = [{"mesh": 0} for _ in range(60)]
    file.tree["scenes"] = [{"nodes": list(range(60))}]
    refused(tmp_path, file, r"nodes\[\d+\]\.mesh = 0: nodes show more than [\d,]+ triangles in all")
    file = GltfFile()
    file.primitive["indices"] = file.accessor([0, 1, 2] * 300, "u1")
    file.tree["meshes"][0]["primitives"] *= 20
    refused(tmp_path, file, r"meshes\[0\]\.primitives\[\d+\]: nodes show more than [\d,]+ triangles in all")


def test_twenty_thousand_copies_of_a_small_mesh_are_not_too_many(tmp_path, monkeypatch):
    monkeypatch.setattr(meshes, "MAX_COPIED", meshes.MAX_COPIED // 100)
    file = GltfFile()
    shifts = file.accessor(np.arange(600).reshape(200, 3))
    file.tree["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": shifts}}}
    assert len(loaded(tmp_path, file).shapes) == 200


def test_a_light_is_named_by_an_index(tmp_path):
    file = GltfFile()
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}] * 2}}
    for index, message in ((True, "must be an integer"), (2, "there are 2 lights, counted from 0")):
        file.tree["nodes"] = [{"mesh": 0, "extensions": {"KHR_lights_punctual": {"light": index}}}]
        refused(tmp_path, file, rf"nodes\[0\]\.extensions\.KHR_lights_punctual\.light = {index}: {message}")
