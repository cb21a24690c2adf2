"""glTF files, damaged: their JSON, words of it, bytes of the whole file, and the buffer beside it."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import engines
from engines.scene import Mesh
from tests.fuzz.mutate import mutated_bytes, mutated_text, mutated_tree
from tests.gltf_file import GltfFile


def _whole() -> GltfFile:
    """A file that has most of what is read."""
    file = GltfFile()
    given = file.primitive["attributes"]
    given["NORMAL"] = file.accessor([[0, 0, 127]] * 4, "i1", normalized=True)
    given["COLOR_0"] = file.accessor([[255, 0, 128, 255]] * 4, "u1", normalized=True)
    given["JOINTS_0"] = file.accessor([[0, 1, 0, 0]] * 4, "u1")
    given["WEIGHTS_0"] = file.accessor([[0.5, 0.5, 0, 0]] * 4)
    texels = np.arange(48, dtype=np.uint8).reshape(3, 4, 4) * 5
    image = file.image(texels) | {"extensions": {"KHR_texture_transform": {"offset": [0.5, 0.0], "rotation": 0.25}}}
    file.tree["textures"][0]["sampler"] = file.add("samplers", wrapS=33648, wrapT=33648, magFilter=9728)
    pbr = {"baseColorFactor": [0.5, 0.5, 1.0, 0.75], "baseColorTexture": image, "metallicRoughnessTexture": image}
    extensions = {
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatRoughnessTexture": image},
        "KHR_materials_sheen": {"sheenColorFactor": [0.5, 0.25, 0.0]},
        "KHR_materials_transmission": {"transmissionFactor": 0.5, "transmissionTexture": image},
        "KHR_materials_ior": {"ior": 1.25},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1.0, 0.5, 0.5]},
        "KHR_materials_emissive_strength": {"emissiveStrength": 2.0},
        "KHR_materials_volume": {"thicknessFactor": 0.5, "attenuationDistance": 1.0},
    }
    more = {"emissiveFactor": [0.0, 0.5, 0.0], "emissiveTexture": image, "normalTexture": image | {"scale": 0.5}}
    file.material(extensions, pbrMetallicRoughness=pbr, alphaMode="MASK", alphaCutoff=0.25, doubleSided=True, **more)
    sparse = {
        "count": 1,
        "indices": {"bufferView": file.view(b"\2"), "componentType": 5121},
        "values": {"bufferView": file.view(np.ones(3, "<f4").tobytes())},
    }
    moved = {**file.tree["accessors"][0], "sparse": sparse}
    strip = {"attributes": {"POSITION": file.add("accessors", **moved)}, "mode": 5}
    file.add("meshes", primitives=[strip, {**strip, "mode": 6}], name="strips")
    turned = {"translation": [0.0, 1.0, 0.0], "rotation": [0.0, 0.5, 0.0, 0.5], "scale": [1.0, -1.0, 2.0]}
    instances = {"TRANSLATION": file.accessor([[0, 0, 1], [0, 0, 2]]), "SCALE": file.accessor([[1, 1, 1], [2, 2, 2]])}
    lens = {"perspective": {"yfov": 0.5, "aspectRatio": 1.5, "znear": 0.1}, "type": "perspective"}
    spot = {"type": "spot", "intensity": 5.0, "color": [1.0, 0.5, 0.25], "spot": {"outerConeAngle": 0.5}}
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [spot, {"type": "point", "range": 10.0}]}}
    file.tree["extensionsUsed"] = ["KHR_lights_punctual", "KHR_materials_iridescence"]
    file.tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    bound = np.tile(np.eye(4).reshape(1, 16), (2, 1)).tolist()
    file.tree["skins"] = [{"joints": [2, 4], "inverseBindMatrices": file.accessor(bound)}]
    file.tree["nodes"] = [
        {"mesh": 0, "skin": 0, "children": [1, 2, 3]},
        {"mesh": 1, **turned, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": instances}}},
        {"matrix": np.eye(4).reshape(-1).tolist(), "camera": file.add("cameras", **lens)},
        {"children": [4], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"extensions": {"KHR_lights_punctual": {"light": 1}}},
    ]
    return file


WHOLE = _whole()


def write(random: Random, folder: Path) -> None:
    """A folder with `m.gltf` and its buffer `m.bin`, or with `m.glb`. Most of the damage leaves the file JSON."""
    way = random.randrange(10)
    if way == 0:
        (folder / "m.glb").write_bytes(mutated_bytes(random, WHOLE.glb()))
        return
    data = mutated_bytes(random, WHOLE.data) if way in (1, 2, 3) else WHOLE.data
    tree: dict[str, Any] = json.loads(WHOLE.gltf("m.bin" if data is not WHOLE.data or random.random() < 0.5 else ""))
    text = json.dumps(mutated_tree(random, tree) if way > 4 else tree, indent=1)
    content = mutated_text(random, text) if way == 4 else text
    (folder / "m.gltf").write_bytes(content.encode("utf-8", "surrogatepass"))
    (folder / "m.bin").write_bytes(data)


def read(folder: Path) -> None:
    """Loads; every number must be finite, and the picture too."""
    (file,) = folder.glob("m.gl*")
    scene = engines.load_scene(file)
    for shape in scene.shapes:
        assert isinstance(shape, Mesh) and np.isfinite(shape.vertices).all()
        assert shape.faces.min() >= 0 and shape.faces.max() < len(shape.vertices)
        assert shape.normals is None or np.isfinite(shape.normals).all()
        assert shape.uvs is None or np.isfinite(shape.uvs).all()
        assert shape.materials.max() < len(scene.materials)
    engine, settings = engines.engine("numpy"), engines.Settings(width=4, height=4)
    if engine.why_not(scene, settings) is None:
        assert np.isfinite(engine.prepare(scene, settings).render(1).mean()).all()
