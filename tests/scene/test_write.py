"""A scene that is written loads as the same scene."""

from __future__ import annotations

import numpy as np
import pytest

import engines
from engines.errors import ConfigError, SceneError
from engines.scene.content import content_hash
from engines.scene.geometry import unit_rows
from engines.scene.mesh import Mesh

RANDOM = np.random.default_rng(5)
TILTED = [0.123, 0.456, -0.789]
SCENE = {
    "raybench_scene": 1,
    "name": "all there is: ünïcode",
    "camera": {
        "type": "thin_lens",
        "eye": [0.1, 1, 4],
        "target": [0, 1 / 3, 0],
        "fov": 41.7,
        "aperture_radius": 0.02,
        "focus_distance": 3,
        "mirror": True,
        "principal_point": [0.1, -0.2],
        "clip": [0.1, float("inf")],
        "resolution": [8, 6],
    },
    "textures": {
        "wood": {"image": RANDOM.integers(0, 256, (3, 4, 3), np.uint8), "scale": [4, 2], "offset": [0.5, 0], "wrap": "mirror"},
        "grey": {"image": RANDOM.random((2, 3)), "filter": "nearest", "to_uv": [[0, 1, 0.25], [1, 0, 0]]},
        "tiles": {"checkerboard": {"a": [0.1, 0.2, 0.3]}, "scale": 8},
    },
    "materials": {
        "plain": {"kd": [0.1, 0.2, 0.3], "ks": 0.4},
        "glass": {"ks": 1, "kt": 1, "ior": 1.5, "fresnel": True},
        "null": {"null": {}},
        "lamp": {"kd": "wood", "ks": 1e-5, "emission": [1, 2, 3], "two_sided": True},
        "table": {"diffuse": {"reflectance": "wood"}, "sides": "front"},
        "gold": {"conductor": {"metal": "Au", "alpha": ["grey", 0.2], "distribution": "beckmann"}},
        "frosted": {"dielectric": {"ior": 1.4, "alpha": 0.05, "specular_transmittance": "tiles"}},
        "pane": {"thin_dielectric": {"specular_reflectance": 0.5}},
        "varnish": {"plastic": {"diffuse": "wood", "alpha": 0.1, "nonlinear": True}},
        "paint": {"principled": {"base_color": [0.8, 0.1, 0.1], "roughness": "grey", "specular": 0.7}},
        "leaf": {"mask": {"opacity": "grey", "of": "table"}},
        "worn": {"blend": {"weight": 0.3, "a": "gold", "b": {"kd": "tiles", "sides": "front"}}},
        "relief": {"bump": {"height": "wood", "scale": 0.01, "of": "plain"}, "emission": 1},
        "mapped": {"normal_map": {"map": "grey", "of": "relieved"}},
        "relieved": {"by_side": {"back": "varnish"}},
    },
    "shapes": [
        {"sphere": {"center": [0, 0.1, 0], "radius": 1 / 3}, "material": "lamp"},
        {"disk": {"center": [0, 0, 0], "normal": TILTED, "radius": 1}, "material": "gold"},
        {"plane": {"point": [0, -1, 0], "normal": [0.1, 0.9, 0.2]}, "material": "null"},
        {"cylinder": {"p0": [0, 0, 0], "p1": [0, 1, 0.1], "radius": 0.1}, "material": "frosted"},
        {"triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]}, "material": "pane"},
        {
            "mesh": {
                "vertices": RANDOM.random((4, 3)),
                "faces": [[0, 1, 2], [0, 2, 3]],
                "uvs": RANDOM.random((4, 2)),
                "smooth": True,
            },
            "material": "mapped",
        },
        *(
            {"mesh": {"vertices": np.eye(3), "faces": [[0, 1, 2]]}, "material": name}
            for name in ("plain", "glass", "table", "varnish", "paint", "leaf", "worn", "relief")
        ),
    ],
    "lights": [
        {"point": {"position": [0, 3, 0], "intensity": 7, "falloff": "none"}},
        {"spot": {"position": [0, 3, 0], "direction": TILTED, "intensity": 7, "cutoff": 33, "beam_width": 11}},
        {"spot": {"position": [0, 3, 0], "direction": TILTED, "intensity": 7, "texture": "wood", "up": [1, 2, 0]}},
        {
            "projector": {
                "position": [0, 3, 0],
                "direction": TILTED,
                "texture": "tiles",
                "up": [1, 2, 0],
                "irradiance": [1, 2, 3],
            }
        },
        {"projector": {"position": [0, 3, 0], "direction": TILTED, "texture": "grey", "fov": 33, "irradiance": [1, 2, 3]}},
        {"directional": {"direction": TILTED, "irradiance": [1, 2, 3]}},
        {
            "environment": {
                "image": RANDOM.random((3, 4, 3)),
                "scale": 3,
                "rows": "poles",
                "rotation": [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
            }
        },
    ],
}


def test_everything_that_can_be_written_comes_back(tmp_path):
    scene = engines.scene_from(SCENE)
    written = engines.save_scene(scene, tmp_path / "new" / "folder")
    again = engines.load_scene(written)
    assert again.content_hash == scene.content_hash
    assert (again.name, again.camera) == (scene.name, scene.camera)
    assert sum(1 for _ in written.parent.glob("textures/*")) == 3, "each texture is written once, beside the environment"
    assert engines.load_scene(engines.save_scene(again, tmp_path / "twice")).content_hash == scene.content_hash


@pytest.mark.parametrize("name", ["cornell_box", "metals", "mobilert_spheres", "mobilert_cornell", "glassware", "dahlquist"])
def test_shipped_scenes_come_back(tmp_path, name):
    scene = engines.load_scene(name)
    assert engines.load_scene(engines.save_scene(scene, tmp_path)).content_hash == scene.content_hash


def test_a_mesh_of_several_materials_keeps_them_and_its_normals_to_the_last_bit(tmp_path):
    scene = engines.scene_from(SCENE)
    normals = unit_rows(RANDOM.normal(size=(50, 3)))
    mesh = Mesh(
        RANDOM.random((50, 3)),
        RANDOM.integers(0, 50, (30, 3)).astype(np.int32),
        np.arange(30, dtype=np.int32) % 3 + 2,
        normals,
        "a/../mesh.obj",
        RANDOM.random((50, 2)),
    )
    held = engines.Scene(
        "one", scene.camera, scene.materials, (mesh,), (), content_hash(scene.camera, scene.materials, [mesh], [])
    )
    again = engines.load_scene(engines.save_scene(held, tmp_path))
    assert np.array_equal(again.shapes[0].normals, normals) and np.array_equal(again.shapes[0].uvs, mesh.uvs)
    assert again.content_hash == held.content_hash


def test_a_sky_of_eight_bits_comes_back_exactly(tmp_path):
    from PIL import Image

    Image.fromarray(RANDOM.integers(0, 256, (4, 8, 3), np.uint8)).save(tmp_path / "sky.png")
    scene = engines.scene_from({**SCENE, "lights": [{"environment": {"image": "sky.png"}}]}, folder=tmp_path)
    assert engines.load_scene(engines.save_scene(scene, tmp_path / "out")).content_hash == scene.content_hash


def test_what_cannot_be_written_is_refused_in_one_line(tmp_path):
    flake = {"procedural": {"name": "sphereflake", "level": 5}, "material": "plain"}
    with pytest.raises(ConfigError, match="a set of 66430 spheres: at most 50000 can be written"):
        engines.save_scene(engines.scene_from({**SCENE, "shapes": [flake]}), tmp_path / "a")
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="file: cannot be written: "):
        engines.save_scene(engines.scene_from(SCENE), tmp_path / "file")


def test_a_list_of_materials_wants_a_ply_with_numbers_of_them(tmp_path):
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]] * 2, np.int32), np.array([0, 1], np.int32), name="m")
    scene = engines.scene_from(SCENE)
    held = engines.Scene("one", scene.camera, scene.materials, (mesh,), (), "")
    file = engines.save_scene(held, tmp_path)
    text = file.read_text()
    assert "material: [plain, glass]" in text
    for new, message in (("[plain]", r"has a face with a material outside \[0, 0\]$"), ("[plain, gone]", "unknown material")):
        file.write_text(text.replace("[plain, glass]", new))
        with pytest.raises(SceneError, match=message):
            engines.load_scene(file)
    ply = file.parent / "meshes" / "m.ply"
    ply.write_bytes(ply.read_bytes().replace(b"int material", b"int somethin"))
    file.write_text(text)
    with pytest.raises(SceneError, match="has no column 'material'"):
        engines.load_scene(file)
