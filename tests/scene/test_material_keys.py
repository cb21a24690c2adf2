"""Materials of a scene file: models, wrappers, names of materials and of textures."""

from __future__ import annotations

import math

import numpy as np
import pytest

import engines
from engines.errors import SceneError
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Dielectric,
    Diffuse,
    Mask,
    Mixture,
    NormalMap,
    Null,
    Plastic,
    Principled,
    Sheen,
    Sides,
    ThinDielectric,
)

SCENE = {
    "raybench_scene": 1,
    "camera": {"type": "perspective", "eye": [0, 0, 3], "target": [0, 0, 0]},
    "textures": {
        "tiles": {"checkerboard": {"a": 0.8, "b": [0.1, 0.2, 0.3]}, "scale": [2, 3], "offset": [0.5, 0.25]},
        "map": {"image": np.full((1, 1, 3), 0.5)},
        "photo": {"image": np.full((1, 1, 3), 128, np.uint8)},
    },
}
TILES = Checkerboard((0.8,) * 3, (0.1, 0.2, 0.3), (2, 0, 0.5, 0, 3, 0.25))


def loaded(**materials):
    return engines.scene_from({**SCENE, "materials": materials})


def bsdf(**keys):
    return loaded(m=keys).materials[0].bsdf


def refusal(**materials):
    with pytest.raises(SceneError) as refused:
        loaded(**materials)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_every_model_has_its_keys():
    half, white = (0.5,) * 3, (1.0,) * 3
    assert bsdf(diffuse={"reflectance": "tiles"}) == Diffuse(TILES)
    assert bsdf(dielectric={}) == Dielectric(1.5, (0.0, 0.0), white, white, "ggx")
    assert bsdf(dielectric={"alpha": [0.1, 0.2], "distribution": "beckmann", "specular_transmittance": 0.5}) == Dielectric(
        1.5, (0.1, 0.2), white, half, "beckmann"
    )
    assert bsdf(dielectric={"alpha": "tiles"}).alpha == (TILES, TILES)
    assert bsdf(thin_dielectric={"ior": 1.3, "specular_reflectance": 0.5}) == ThinDielectric(1.3, half, white)
    assert bsdf(plastic={"diffuse": "tiles", "alpha": 0.1, "nonlinear": True}) == Plastic(TILES, 1.49, 0.1, True, white, "ggx")
    assert bsdf(principled={"roughness": "tiles", "specular": 0.5}) == Principled(roughness=TILES, eta=1.5)
    assert math.isclose(bsdf(principled={"specular": 1}).eta, 2 / (1 - math.sqrt(0.08)) - 1)
    assert bsdf(principled={"specular": 0}).eta == 1.0
    assert bsdf(principled={"specular": 0, "spec_trans": 0.5}).eta > 1.0
    assert [bsdf(principled={"eta": 1, "spec_trans": share}).eta for share in (0, 0.5)] == [1.0, 1.001]
    assert bsdf(sheen={"color": 0.5}) == Sheen((0.5, 0.5, 0.5)) and bsdf(sheen={}) == Sheen()
    assert bsdf(null={}) == Null()
    assert bsdf(conductor={"reflectance": "tiles"}).reflectance == TILES


def test_wrappers_hold_materials_by_name_or_by_their_keys():
    found = loaded(
        leaf={"mask": {"opacity": 0.3, "of": "later"}, "emission": 2},
        worn={"blend": {"weight": "tiles", "a": "leafy", "b": {"kd": 0.5, "ks": 0.2}}},
        relief={"bump": {"height": "map", "scale": 0.1, "of": {"normal_map": {"map": "map", "of": "later"}}}},
        sided={"by_side": {"front": "later"}},
        leafy={"mask": {"opacity": 1, "of": {}}},
        later={"kd": "tiles", "sides": "front"},
    ).materials
    leaf, worn, relief, sided, leafy, later = (material.bsdf for material in found)
    assert later == Sides(Mixture(TILES), None) and found[5].kd == (0, 0, 0)
    assert leaf == Mask(0.3, later) and found[0].emission == (2, 2, 2)
    assert leafy == Mask(1.0, Mixture())
    assert worn == Blend(TILES, leafy, Mixture((0.5,) * 3, (0.2,) * 3))
    assert isinstance(relief, Bump) and isinstance(relief.of, NormalMap) and relief.of.of == later
    assert sided == Sides(later, None)
    assert [material.name for material in found] == ["leaf", "worn", "relief", "sided", "leafy", "later"]


def test_lobes_without_textures_stay_lobes_and_sides_wraps_what_is_opaque():
    plain, front, lamp = loaded(
        a={"kd": 0.5, "sides": "both"}, b={"kd": 0.5, "sides": "front"}, c={"emission": 1, "sides": "front"}
    ).materials
    assert plain.bsdf is None and plain.kd == (0.5,) * 3
    assert front.bsdf == Sides(Mixture((0.5,) * 3), None) and lamp.bsdf is None


@pytest.mark.parametrize(
    "keys",
    [
        {"dielectric": {}},
        {"thin_dielectric": {}},
        {"null": {}},
        {"kt": 0.5},
        {"kt": "tiles"},
        {"principled": {"spec_trans": 0.1}},
        {"mask": {"opacity": 1, "of": {}}},
        {"blend": {"weight": 0.5, "a": {}, "b": {"dielectric": {}}}},
    ],
)
def test_sides_is_refused_where_light_passes(keys):
    assert "m.sides = 'front': light passes this material" in refusal(m={**keys, "sides": "front"})


CASES = [
    ({"kd": "tile"}, "materials.m.kd = 'tile': unknown texture: did you mean 'tiles'?"),
    ({"kd": 0.6, "ks": 0.6}, "kd + ks + kt = 1.2 in red: must not exceed 1"),
    ({"diffuse": {}, "kd": 0.5}, "m.kd: either diffuse, or kd, ks"),
    ({"diffuse": {}, "null": {}}, "m.null: either diffuse, or"),
    ({"mask": {"opacity": 0.5}}, "m.mask.of: is missing"),
    ({"mask": {"opacity": 2, "of": {}}}, "m.mask.opacity = 2: must lie in [0, 1]"),
    ({"mask": {"opacity": 0.5, "of": 3}}, "m.mask.of = 3: must be the name of a material, or a mapping"),
    ({"mask": {"opacity": 0.5, "of": "gone"}}, "m.mask.of = 'gone': unknown material"),
    ({"mask": {"opacity": 0.5, "of": {"emission": 1}}}, "m.mask.of: emits: emission stands beside the outermost"),
    ({"mask": {"opacity": 0.5, "of": "m"}}, "m.mask.of = 'm': a material that is inside itself: m -> m"),
    ({"bump": {"height": "tiles", "of": {}}}, "m.bump.height = 'tiles': must be an image: a checkerboard has no slope"),
    ({"bump": {"height": 1, "of": {}}}, "m.bump.height = 1: must be the name of a texture"),
    ({"normal_map": {"map": "photo", "of": {}}}, "m.normal_map.map = 'photo': its texels are sRGB-encoded"),
    ({"plastic": {"ior": 4}}, "m.plastic.ior = 4: must lie in [1, 3]"),
    ({"plastic": {"alpha": 1e-9}}, "m.plastic.alpha = 1e-09: must lie in [0.0001, 1]"),
    ({"dielectric": {"ior": 1.0, "alpha": 0.1}}, "m.dielectric.ior = 1.0: a rough interface needs an index at least 0.001"),
    ({"dielectric": {"alpha": [0, 0.1]}}, "m.dielectric.alpha[0] = 0: must lie in [0.0001, 1]"),
    ({"dielectric": {"alpha": ["tiles", 0]}}, "m.dielectric.alpha[1] = 0: must lie in [0.0001, 1]"),
    ({"principled": {"eta": 1.5, "specular": 0.5}}, "m.principled.specular: either specular or eta"),
    ({"sides": "back"}, "m.sides = 'back': unknown sides"),
]


@pytest.mark.parametrize(("keys", "message"), CASES)
def test_what_is_wrong_is_refused_where_it_stands(keys, message):
    assert message in refusal(m=keys)


def test_cycles_depth_and_size_are_limited():
    def mask(of):
        return {"mask": {"opacity": 0.5, "of": of}}

    assert "inside itself: b -> c -> b" in refusal(a=mask("b"), b=mask("c"), c=mask("b"))
    backwards = {f"m{i}": mask(f"m{i + 1}") for i in range(5000)} | {"m5000": {"kd": 0.5}}
    assert "stands inside 32 others" in refusal(**backwards)
    assert "around each other: at most 256, and 32" in refusal(**dict(reversed(backwards.items())))
    doubled = {f"m{i}": {"blend": {"weight": 0.5, "a": f"m{i - 1}", "b": f"m{i - 1}"}} for i in range(1, 20)}
    assert "holds 511 wrappers and models, 8 around" in refusal(m0={"kd": 0.5}, **doubled)
    deepest = {f"m{i}": mask(f"m{i - 1}") for i in range(1, 33)}
    assert len(loaded(m0={"kd": 0.5}, **deepest).materials) == 33


def test_null_is_a_key_of_a_file(tmp_path):
    (tmp_path / "s.yaml").write_text(
        "raybench_scene: 1\ncamera: {type: perspective, eye: [0, 0, 3], target: [0, 0, 0]}\nmaterials: {air: {null: {}}}\n"
    )
    assert engines.load_scene(tmp_path / "s.yaml").materials[0].bsdf == Null()


def test_textures_whose_sum_passes_one_are_warned_about():
    assert any(
        "'m': where the textures of kd, ks and kt are brightest" in text
        for text in loaded(m={"kd": "tiles", "ks": 0.3}).warnings
    )
    assert not any("brightest" in text for text in loaded(m={"kd": "tiles", "ks": 0.2}).warnings)


TEXTURES = [
    ({"image": "gone.png"}, "t.image = 'gone.png': no such file"),
    ({"image": "../a.png"}, "t.image = '../a.png': lies outside the scene's folder"),
    ({"checkerboard": {}, "image": "a.png"}, "textures.t: must have either image, or checkerboard"),
    ({"chequers": {}}, "textures.t.chequers: unknown key"),
    ({"checkerboard": {}, "filter": "nearest"}, "textures.t.filter: unknown key"),
    ({"checkerboard": {}, "scale": [1, 2, 3]}, "textures.t.scale: must be a number, or two"),
    ({"checkerboard": {}, "scale": 2, "to_uv": [[1, 0, 0], [0, 1, 0]]}, "t.scale: either to_uv, or scale and offset"),
    ({"checkerboard": {}, "to_uv": [[1, 0], [0, 1]]}, "textures.t.to_uv[0]: must be three numbers"),
    (3, "textures.t = 3: must be a mapping with image, or checkerboard"),
]


@pytest.mark.parametrize(("texture", "message"), TEXTURES)
def test_what_is_wrong_with_a_texture_is_refused(texture, message, tmp_path):
    with pytest.raises(SceneError) as refused:
        engines.scene_from({**SCENE, "textures": {"t": texture}}, folder=tmp_path)
    assert message in str(refused.value) and "\n" not in str(refused.value)
