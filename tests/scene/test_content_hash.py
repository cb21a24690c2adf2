"""The content hash changes with what the pixels depend on, and with nothing else."""

from __future__ import annotations

import copy
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import engines
import engines.scene.procedural
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    Diffuse,
    EnvironmentLight,
    ImageTexture,
    Mask,
    Material,
    Mesh,
    NormalMap,
    Null,
    Plastic,
    Principled,
    Sides,
)
from engines.scene.content import content_hash

SCENE = {
    "raybench_scene": 1,
    "name": "one",
    "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0], "resolution": [8, 8]},
    "materials": {"a": {"kd": 0.5}, "b": {"kd": [0.1, 0.2, 0.3]}, "lamp": {"emission": 1}},
    "shapes": [
        {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "a"},
        {"mesh": {"vertices": np.eye(3).tolist(), "faces": [[0, 1, 2]]}, "material": "b"},
        {"procedural": {"name": "sphereflake", "level": 1}, "material": "lamp"},
    ],
    "lights": [{"point": {"position": [0, 3, 0], "intensity": 1}}, {"environment": {"radiance": 1}}],
}
SPOT = {"position": [0, 3, 0], "target": [0, 0, 0], "intensity": 1}


def hash_of(change=None):
    data = copy.deepcopy(SCENE)
    if change:
        change(data)
    return engines.scene_from(data).content_hash


def _rename(data):
    data["materials"] = {"x": data["materials"]["a"], "lamp": data["materials"]["lamp"], "b": data["materials"]["b"]}
    data["shapes"][0]["material"] = "x"


SAME = {
    "name": lambda d: d.update(name="two"),
    "resolution": lambda d: d["camera"].update(resolution=[16, 9]),
    "material renamed and moved": _rename,
    "unused material": lambda d: d["materials"].update(unused={"ks": 1}),
    "default written out": lambda d: (d["materials"]["a"].update(ks=0, ior=1.0), d["camera"].update(up=[0, 1, 0], fov=40)),
    "number as colour": lambda d: d["materials"]["a"].update(kd=[0.5, 0.5, 0.5]),
    "minus zero": lambda d: d["shapes"][0]["sphere"].update(center=[-0.0, 0, 0]),
    "order of keys": lambda d: d.update(camera=d.pop("camera"), materials=dict(reversed(d["materials"].items()))),
    "array instead of list": lambda d: d["shapes"][1]["mesh"].update(vertices=np.eye(3)),
    "same material by another name": lambda d: (
        d["materials"].update(c=d["materials"]["b"]),
        d["shapes"][1].update(material="c"),
    ),
}
OTHER = {
    "disk": lambda d: d["shapes"].append({"disk": {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 1}, "material": "a"}),
    "spot": lambda d: d["lights"].append({"spot": SPOT}),
    "spot cutoff": lambda d: d["lights"].append({"spot": {**SPOT, "cutoff": 30, "beam_width": 15}}),
    "spot beam": lambda d: d["lights"].append({"spot": {**SPOT, "beam_width": 10}}),
    "metal": lambda d: d["materials"].update(a={"conductor": {"metal": "Au"}}),
    "another metal": lambda d: d["materials"].update(a={"conductor": {"metal": "Ag"}}),
    "metal of a mesh": lambda d: d["materials"].update(b={"conductor": {"metal": "Au"}}),
    "rough metal": lambda d: d["materials"].update(a={"conductor": {"metal": "Au", "alpha": 0.1}}),
    "brushed metal": lambda d: d["materials"].update(a={"conductor": {"metal": "Au", "alpha": [0.1, 0.2]}}),
    "dull metal": lambda d: d["materials"].update(a={"conductor": {"metal": "Au", "specular_reflectance": 0.9}}),
    "eye": lambda d: d["camera"].update(eye=[0, 0, 3.0000001]),
    "fov": lambda d: d["camera"].update(fov=41),
    "fov axis": lambda d: d["camera"].update(fov_axis="x"),
    "camera kind": lambda d: d.update(camera={"type": "orthographic", "eye": [0, 0, 3], "target": [0, 0, 0], "height": 2}),
    "kd": lambda d: d["materials"]["a"].update(kd=0.25),
    "two sided": lambda d: d["materials"]["lamp"].update(two_sided=True),
    "material swapped": lambda d: d["shapes"][0].update(material="b"),
    "radius": lambda d: d["shapes"][0]["sphere"].update(radius=2),
    "vertex": lambda d: d["shapes"][1]["mesh"]["vertices"][0].__setitem__(0, 1.5),
    "face order": lambda d: d["shapes"][1]["mesh"].update(faces=[[1, 2, 0]]),
    "smooth": lambda d: d["shapes"][1]["mesh"].update(smooth=True),
    "level": lambda d: d["shapes"][2]["procedural"].update(level=2),
    "order of shapes": lambda d: d["shapes"].reverse(),
    "shape removed": lambda d: d["shapes"].pop(),
    "intensity": lambda d: d["lights"][0]["point"].update(intensity=2),
    "falloff": lambda d: d["lights"][0]["point"].update(falloff="none"),
    "light removed": lambda d: d["lights"].pop(),
}


@pytest.mark.parametrize("change", SAME.values(), ids=SAME.keys())
def test_the_hash_stays(change):
    assert hash_of(change) == hash_of()


def test_every_other_change_gives_a_hash_of_its_own():
    hashes = [hash_of(), *(hash_of(change) for change in OTHER.values())]
    assert len(set(hashes)) == len(hashes)


def test_the_hash_is_pinned():
    """References on disk are filed under it: change `content.VERSION` with the canonical form, on purpose only."""
    assert hash_of() == "3c7cc150cc004d8230ec1f5f3afa8731f525163e37646372a67ae8ff80ce45ee"


SHIPPED = {  # by commit 6d31046, before there were textures
    "cornell_box": "d13163987ab95b9a96d716d491dfd4ee7018aa6300a38db4e3ed4a59b343a3af",
    "dahlquist": "4b843861db9daf44ee05147e63714e1897ecb769bdc501857f85d8b2f3852320",
    "glassware": "2490e6217884f8c365d55721aa6964f878d32bf8e03312ad42387f83b8438ede",  # with powers as products
    "metals": "53db4c51181c1123db4eaee0459a95a8282a55be2b5c5f6acff37541f9311d3a",
    "mobilert_spheres": "f00f852c47618a6c0176dc00a12e6bf49b969f9498fb6524a71ce0c1b99cd985",
}


def test_generators_use_no_functions_of_numpy_whose_last_bits_depend_on_the_processor():
    """Those that NumPy takes from Intel's vector library where it finds AVX-512; rods.py sorts by an angle, and no more."""
    names = r"np\.(tan|a(rc)?(sin|cos|tan)h?|exp|expm1|log\w*|power|pow|cbrt|sinh|cosh|tanh)\("
    differing = re.compile(names + r"|\*\*\s?([3-9](?!\d)|0\.(?!5\b))")
    folder = Path(engines.scene.procedural.__file__).parent
    lines = [line for file in sorted(folder.glob("*.py")) for line in file.read_text().splitlines()]
    assert [line for line in lines if differing.search(line) and "lambda" not in line] == []


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_keep_their_hashes(name):
    assert engines.load_scene(name).content_hash == SHIPPED[name]


PLUGIN = """
class Own:
    options = {"x": 1, "place": (0, 0, 0)}
    jitted = numpy = len

    def __init__(self, name):
        self.name = name

one, other = Own("one"), Own("other")
"""
PLACES = {
    "camera": lambda plugin, **options: {"camera": {"type": plugin, **options}},
    "light": lambda plugin, **options: {"lights": [{"plugin": {"type": plugin, **options}}]},
    "BSDF": lambda plugin, **options: {"materials": {**SCENE["materials"], "a": {"plugin": {"type": plugin, **options}}}},
}


@pytest.mark.parametrize("place", PLACES)
def test_a_plugin_counts_by_its_name_its_options_and_its_source(place, tmp_path, monkeypatch):
    file = tmp_path / "own_plugin.py"
    file.write_text(PLUGIN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own_plugin", raising=False)

    def hashed(plugin, **options):
        return engines.scene_from({**SCENE, **PLACES[place](plugin, **options)}, allow_imports=True).content_hash

    found = [hashed("own_plugin:one"), hashed("own_plugin:other"), hashed("own_plugin:one", x=2)]
    assert found[0] == hashed("own_plugin:one")
    if place != "camera":  # whose plugins need not list their options
        assert found[0] == hashed("own_plugin:one", place=[0, 0, 0], x=1.0)
    file.write_text(PLUGIN + "# edited")
    assert len({*found, hashed("own_plugin:one"), engines.scene_from(SCENE).content_hash}) == 5


def test_a_plugin_counts_with_the_modules_beside_it_that_it_imports(tmp_path, monkeypatch):
    files = {
        "with_helper.py": "import its_helper\n" + PLUGIN,
        "its_helper.py": "from its_table import TABLE\n",
        "its_table.py": "TABLE = 1\n",
        "stranger.py": "",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    for name in files:
        monkeypatch.delitem(sys.modules, name.removesuffix(".py"), raising=False)

    def hashed():
        light = [{"plugin": {"type": "with_helper:one"}}]
        return engines.scene_from({**SCENE, "lights": light}, allow_imports=True).content_hash

    found = [hashed()]
    (tmp_path / "stranger.py").write_text("# edited")
    assert hashed() == found[0]
    for name in ("its_helper.py", "its_table.py"):
        (tmp_path / name).write_text(files[name] + "# edited")
        found.append(hashed())
    assert len(set(found)) == 3


def _hash(*materials, uvs=None):
    """Of one triangle that has these materials, the first of them on its face."""
    scene = engines.scene_from(SCENE)
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32), uvs=uvs)
    return content_hash(scene.camera, [Material("a", bsdf=bsdf) for bsdf in materials], [mesh], [])


def test_textures_count_by_value_wherever_they_stand():
    pixels = np.linspace(0, 1, 12, dtype=np.float32).reshape(2, 2, 3)
    image = ImageTexture(pixels)
    others = [
        ImageTexture(pixels[:1]),
        ImageTexture(pixels * 2),
        ImageTexture(pixels, filter="nearest"),
        ImageTexture(pixels, wrap="clamp"),
        ImageTexture(pixels, to_uv=(2, 0, 0, 0, 1, 0)),
        Checkerboard(),
        Checkerboard(a=(0.1, 0.1, 0.1)),
    ]

    def everywhere(texture):
        inner = Diffuse(texture)
        return [
            inner,
            Mask(0.5, inner),
            Mask(0.4, inner),
            Blend(0.5, inner, Null()),
            Blend(0.5, Null(), inner),
            Bump(texture, 1.0, Diffuse()),
            NormalMap(texture, Diffuse()),
            Sides(inner, None),
            Sides(None, inner),
            Conductor((1.0,) * 3, (2.0,) * 3, (texture, 0.1)),
            Plastic(texture),
            Principled(roughness=texture),
        ]

    hashes = {_hash(bsdf) for texture in (image, *others) for bsdf in everywhere(texture)}
    assert len(hashes) == 12 * 8
    assert {_hash(bsdf) for bsdf in everywhere(ImageTexture(pixels.copy(), name="another"))} < hashes


def test_texture_coordinates_count_where_a_material_looks_at_them():
    uvs = np.arange(6.0).reshape(3, 2)
    brushed = Conductor((1.0,) * 3, (1.0,) * 3, (0.1, 0.2))
    for bsdf in (Diffuse(Checkerboard()), Principled(anisotropic=0.5), Mask(1.0, brushed)):
        assert len({_hash(bsdf), _hash(bsdf, uvs=uvs), _hash(bsdf, uvs=uvs + 1)}) == 3
    for bsdf in (None, Diffuse(), Conductor((1.0,) * 3, (1.0,) * 3, (0.1, 0.1))):
        assert _hash(bsdf) == _hash(bsdf, uvs=uvs)
    assert _hash(Diffuse(), Diffuse(Checkerboard()), uvs=uvs) == _hash(Diffuse())


def test_newer_fields_count_where_they_differ_from_their_defaults():
    camera = engines.scene_from(SCENE).camera
    cameras = [{}, {"mirror": True}, {"principal_point": (0.1, 0.0)}, {"clip": (0.1, 9.0)}]
    lights = [{}, {"rows": "poles"}, {"rotation": ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))}]
    found = {content_hash(replace(camera, **each), [], [], []) for each in cameras}
    found |= {content_hash(camera, [], [], [EnvironmentLight((1.0,) * 3, **each)]) for each in lights}
    assert len(found) == len(cameras) + len(lights)
    assert _hash(Conductor((1.0,) * 3, (1.0,) * 3, distribution="beckmann")) != _hash(Conductor((1.0,) * 3, (1.0,) * 3))
