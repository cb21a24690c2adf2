"""Materials and textures of glTF files as BSDFs, with notes on what is approximated."""

import io

import numpy as np
import pytest
from PIL import Image

import engines
from engines.scene import Blend, Diffuse, Mask, MeshAttribute, NormalMap, Principled, ThinDielectric
from tests.fuzz.gltf import WHOLE
from tests.gltf_file import UVS, GltfFile

PIXEL = [[[255, 128, 0, 64], [0, 255, 255, 255]]]
"""1 x 2 texels."""
LINEAR = ((128 / 255 + 0.055) / 1.055) ** 2.4


def loaded(folder, file):
    return engines.load_scene(file.write(folder))


def painted(folder, extensions=None, **keys):
    """The only material of a square that has these keys, and the notes."""
    file = keys.pop("file", None) or GltfFile()
    file.material(extensions, **keys)
    scene = loaded(folder, file)
    (material,) = scene.materials
    return material, scene.warnings


def test_metallic_roughness_is_the_principled_bsdf(tmp_path):
    pbr = {"baseColorFactor": [0.1, 0.2, 0.3, 1], "metallicFactor": 0.25, "roughnessFactor": 0.75}
    material, notes = painted(tmp_path, pbrMetallicRoughness=pbr)
    assert material.bsdf == Principled((0.1, 0.2, 0.3), 0.75, metallic=0.25) and notes == ()


def test_a_primitive_without_material_is_the_white_metal_of_the_specification(tmp_path):
    (material,) = loaded(tmp_path, GltfFile()).materials
    assert material.bsdf == Principled((1, 1, 1), 1.0, metallic=1.0)


def test_textures_are_decoded_by_what_they_mean_and_times_their_factors(tmp_path):
    file = GltfFile()
    image = file.image(PIXEL)
    pbr = {"baseColorFactor": [1, 0.5, 1, 1], "baseColorTexture": image, "metallicRoughnessTexture": image}
    pbr |= {"metallicFactor": 0.5, "roughnessFactor": 1}
    material, _ = painted(tmp_path, file=file, pbrMetallicRoughness=pbr)
    bsdf = material.bsdf
    np.testing.assert_allclose(bsdf.base_color.pixels, [[[1, 0.5 * LINEAR, 0], [0, 0.5, 1]]], rtol=1e-6)
    np.testing.assert_allclose(bsdf.roughness.pixels[0, :, 0], [128 / 255, 1], rtol=1e-6)
    np.testing.assert_allclose(bsdf.metallic.pixels[0, :, 0], [0, 0.5])
    assert engines.load_scene(tmp_path / "m.glb").shapes[0].uvs.tolist() == UVS


def test_samplers_and_texture_transforms_place_images(tmp_path):
    file = GltfFile()
    image = file.image(PIXEL)
    file.tree["textures"][0]["sampler"] = file.add("samplers", wrapS=33071, wrapT=33071, magFilter=9728)
    placing = {"offset": [0.5, 0.25], "rotation": np.pi / 2, "scale": [2, 3]}
    pbr = {"baseColorTexture": image | {"extensions": {"KHR_texture_transform": placing}}}
    material, _ = painted(tmp_path, file=file, pbrMetallicRoughness=pbr)
    found = material.bsdf.base_color
    assert (found.wrap, found.filter) == ("clamp", "nearest")
    # +u comes to lie along -v, which is upwards in the image: counter-clockwise
    np.testing.assert_allclose(found.to_uv, [0, 3, 0.5, -2, 0, 0.25], atol=1e-12)


def test_a_normal_map_is_scaled_and_turned_where_its_coordinates_are_mirrored(tmp_path):
    file = GltfFile()
    mirrored = file.accessor([[1 - u, v] for u, v in UVS])
    other = {**file.primitive["attributes"], "TEXCOORD_0": mirrored}
    image = file.image([[[255, 191, 255]]])
    file.material(normalTexture=image | {"scale": 0.5})
    file.tree["meshes"][0]["primitives"].append({**file.primitive, "attributes": other})
    scene = loaded(tmp_path, file)
    plain, turned = (scene.materials[shape.materials[0]].bsdf.map.pixels[0, 0] for shape in scene.shapes)
    tilt = 0.5 * (2 * 191 / 255 - 1)
    np.testing.assert_allclose(plain, [0.75, 0.5 + tilt / 2, 1], rtol=1e-6)
    np.testing.assert_allclose(turned, [0.75, 0.5 - tilt / 2, 1], rtol=1e-6)


def lit_from_above(folder, texel, uvs=UVS, node=(1, 1, 1), **transform):
    """The mean of a square with one texel of a normal map, in light that travels down and away."""
    file = GltfFile()
    file.primitive["attributes"]["TEXCOORD_0"] = file.accessor(uvs)
    image = file.image([[texel]]) | ({"extensions": {"KHR_texture_transform": transform}} if transform else {})
    file.material(pbrMetallicRoughness={"metallicFactor": 0}, normalTexture=image)
    light = {"rotation": [-0.5, 0, 0, 0.866], "extensions": {"KHR_lights_punctual": {"light": 0}}}
    file.tree["nodes"] = [{"mesh": 0, "scale": node}, light]
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "directional"}]}}
    return engines.engine("numpy").prepare(loaded(folder, file), engines.Settings(8, 6)).render(4).mean().mean()


LEFT, DOWN, UP = (40, 128, 218), (128, 40, 218), (128, 215, 218)
"""Which way a texel leans in its image."""


@pytest.mark.parametrize(
    ("texel", "keys"),
    [
        (UP, {"uvs": [[1 - u, v] for u, v in UVS]}),
        (UP, {"node": (-1, 1, 1)}),
        (UP, {"node": (-1, 1, 1), "uvs": [[1 - u, v] for u, v in UVS]}),
        (UP, {"uvs": [[u, 1 - v] for u, v in UVS], "offset": [0, 1], "scale": [1, -1]}),
        (LEFT, {"rotation": np.pi / 2}),
        (DOWN, {"rotation": np.pi}),
    ],
    ids=["mirrored-uvs", "mirrored-node", "both", "flipped-uvs", "turned-by-90", "turned-by-180"],
)
def test_a_texel_of_a_normal_map_leans_in_the_scene_as_its_image_lies_there(tmp_path, texel, keys):
    """Up, in all of these."""
    mean = lit_from_above(tmp_path, texel, **keys)
    up, down = lit_from_above(tmp_path, UP), lit_from_above(tmp_path, DOWN)
    assert up > 1.5 * down and mean == pytest.approx(up, rel=0.02)


@pytest.mark.parametrize(("side", "two"), [(False, False), (True, True)])
def test_emission_is_factor_times_strength_times_texture(tmp_path, side, two):
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}}
    material, _ = painted(tmp_path, strength, emissiveFactor=[1, 0.5, 0], doubleSided=side)
    assert material.emission == (4.0, 2.0, 0.0) and material.two_sided is two
    file = GltfFile()
    image = file.image(PIXEL)
    material, _ = painted(tmp_path, strength, file=file, emissiveFactor=[1, 1, 1], emissiveTexture=image)
    np.testing.assert_allclose(material.emission.pixels, [[[4, 4 * LINEAR, 0], [0, 4, 4]]], rtol=1e-6)


def test_alpha_is_a_mask(tmp_path):
    def opacity(mode, alpha, textured, **keys):
        file = GltfFile()
        pbr = {"baseColorFactor": [1, 1, 1, alpha]} | ({"baseColorTexture": file.image(PIXEL)} if textured else {})
        bsdf = painted(tmp_path, file=file, pbrMetallicRoughness=pbr, alphaMode=mode, **keys)[0].bsdf
        found = bsdf.opacity if isinstance(bsdf, Mask) else 1.0
        return found.pixels[0, :, 0].tolist() if textured and found != 1.0 else found

    assert opacity("OPAQUE", 0.5, False) == 1.0 and opacity("OPAQUE", 0.5, True) == 1.0
    assert opacity("BLEND", 0.5, False) == 0.5
    assert opacity("BLEND", 0.5, True) == pytest.approx([0.5 * 64 / 255, 0.5])
    assert opacity("MASK", 0.5, False) == 1.0 and opacity("MASK", 0.4, False) == 0.0
    assert opacity("MASK", 1.0, True) == [0.0, 1.0] and opacity("MASK", 1.0, True, alphaCutoff=0.2) == [1.0, 1.0]


def test_what_is_cut_out_does_not_emit(tmp_path):
    pbr = {"baseColorFactor": [1, 1, 1, 0.5]}
    assert painted(tmp_path, pbrMetallicRoughness=pbr, alphaMode="BLEND", emissiveFactor=[1, 1, 0])[0].emission == (0.5, 0.5, 0)
    file = GltfFile()
    pbr = {"baseColorTexture": file.image(PIXEL)}
    keys = {"alphaMode": "BLEND", "emissiveFactor": [1, 0, 1], "emissiveTexture": pbr["baseColorTexture"]}
    emission = painted(tmp_path, file=file, pbrMetallicRoughness=pbr, **keys)[0].emission
    np.testing.assert_allclose(emission.pixels, [[[64 / 255, 0, 0], [0, 0, 1]]], rtol=1e-6)


def test_unlit_emits_its_base_colour_with_a_note(tmp_path):
    pbr = {"baseColorFactor": [0.5, 0.25, 1, 0.5]}
    material, notes = painted(tmp_path, {"KHR_materials_unlit": {}}, pbrMetallicRoughness=pbr, alphaMode="BLEND")
    assert material.emission == (0.25, 0.125, 0.5) and material.bsdf == Mask(0.5, Diffuse((0, 0, 0)))
    assert notes == ("material 'paint': it is unlit: it emits its base colour, and so lights what is around it",)


def rendered(folder, file, samples=256):
    """The mean of the red channel, of a camera that sees the square alone, and its standard error."""
    file.add("cameras", type="orthographic", orthographic={"xmag": 0.4, "ymag": 0.4, "znear": 0, "zfar": 9})
    file.tree["nodes"].append({"camera": 0, "translation": [0.5, 0.5, 1]})
    file.tree["scenes"] = [{"nodes": [0, 1]}]
    settings = engines.Settings(4, 4, sampler="random")
    film = engines.engine("numpy").prepare(loaded(folder, file), settings).render(samples)
    return film.mean()[:, :, 0].mean(), np.sqrt(film.variance_of_mean()[:, :, 0].mean() / 16)


def test_an_unlit_surface_is_blended_with_what_lies_behind(tmp_path):
    file = GltfFile()
    pbr = {"baseColorFactor": [0.1, 1, 1, 0.25]}
    file.material({"KHR_materials_unlit": {}}, pbrMetallicRoughness=pbr, alphaMode="BLEND")
    mean, error = rendered(tmp_path, file)
    assert 0 < error < 0.01 and mean == pytest.approx(0.25 * 0.1 + 0.75 * 0.6, abs=4 * error)


def test_a_thin_pane_before_an_even_sky_cannot_be_seen(tmp_path):
    file = GltfFile()
    file.material({"KHR_materials_transmission": {"transmissionFactor": 1}}, pbrMetallicRoughness=DIELECTRIC)
    mean, _ = rendered(tmp_path, file)
    assert mean == pytest.approx(0.6, rel=1e-5)


DIELECTRIC = {"metallicFactor": 0, "roughnessFactor": 0}


def test_ior_and_specular_give_the_reflectance_at_normal_incidence(tmp_path):
    def eta(**extensions):
        named = {f"KHR_materials_{key}": value for key, value in extensions.items()}
        return painted(tmp_path, named, pbrMetallicRoughness=DIELECTRIC)[0].bsdf.eta

    assert eta(ior={"ior": 1.25}) == 1.25 and eta(specular={"specularFactor": 0}) == 1.0
    half = eta(specular={"specularFactor": 0.5})
    assert ((half - 1) / (half + 1)) ** 2 == pytest.approx(0.02)
    tinted = eta(ior={"ior": 2.0}, specular={"specularColorFactor": [1, 0, 0]})
    assert ((tinted - 1) / (tinted + 1)) ** 2 == pytest.approx(0.212671 / 9)


def test_transmission_is_a_thin_pane_and_with_a_thickness_a_solid(tmp_path):
    passing = {"KHR_materials_transmission": {"transmissionFactor": 0.5}, "KHR_materials_ior": {"ior": 1.25}}
    pbr = {**DIELECTRIC, "baseColorFactor": [1, 0.5, 0.5, 1]}
    material, notes = painted(tmp_path, passing, pbrMetallicRoughness=pbr)
    plain = Principled((1, 0.5, 0.5), 0.0, eta=1.25)
    assert material.bsdf == Blend(0.5, plain, ThinDielectric(1.25, transmittance=(1, 0.5, 0.5))) and notes == ()
    _, notes = painted(tmp_path, passing, pbrMetallicRoughness={"metallicFactor": 0})
    assert "neither that nor its reflection is blurred" in notes[0]
    solid = passing | {"KHR_materials_volume": {"thicknessFactor": 1.0, "attenuationColor": [1, 0, 0]}}
    material, notes = painted(tmp_path, solid, pbrMetallicRoughness=pbr)
    assert material.bsdf == Principled((1, 0.5, 0.5), 0.0, eta=1.25, spec_trans=0.5)
    assert "its inside does not absorb light" in notes[0]


def test_clear_coat_and_sheen_are_those_of_the_principled_bsdf_with_notes(tmp_path):
    coat = {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.1**0.5}}
    material, notes = painted(tmp_path, coat)
    assert (material.bsdf.clearcoat, material.bsdf.clearcoat_gloss) == (0.5, pytest.approx(0.0, abs=1e-12))
    assert "its clear coat is Disney's" in notes[0]
    material, _ = painted(tmp_path, {"KHR_materials_clearcoat": {"clearcoatFactor": 1}})
    assert (material.bsdf.clearcoat, material.bsdf.clearcoat_gloss) == (1.0, 1.0)
    material, notes = painted(tmp_path, {"KHR_materials_sheen": {"sheenColorFactor": [0, 1, 0]}})
    assert material.bsdf.sheen == pytest.approx(0.715160) and "its sheen is Disney's" in notes[0]


def test_a_scene_with_all_of_it_is_taken_by_our_engines_and_written_as_yaml(tmp_path):
    scene = loaded(tmp_path, WHOLE)
    assert isinstance(scene.materials[0].bsdf, Mask) and isinstance(scene.materials[0].bsdf.of, NormalMap)
    for name in ("numpy", "numba", "embree"):
        assert engines.engine(name).why_not(scene, engines.Settings(8, 6)) is None
    written = engines.save_scene(scene, tmp_path / "folder")
    assert engines.load_scene(written).content_hash == scene.content_hash


def test_vertex_colours_times_the_base_colour_are_an_attribute(tmp_path):
    file = GltfFile()
    colors = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 51]]
    file.primitive["attributes"]["COLOR_0"] = file.accessor(colors, "u1", normalized=True)
    pbr = {"baseColorFactor": [0.5, 1, 0.25, 0.5], "metallicFactor": 0}
    material, _ = painted(tmp_path, file=file, pbrMetallicRoughness=pbr, alphaMode="BLEND")
    assert material.bsdf.of.base_color == MeshAttribute("vertex_color")
    assert material.bsdf.opacity == MeshAttribute("vertex_alpha", 0.5)
    found = engines.load_scene(tmp_path / "m.glb").shapes[0].attributes
    np.testing.assert_allclose(found["vertex_color"], [[0.5, 0, 0], [0, 1, 0], [0, 0, 0.25], [0.5, 1, 0.25]])
    np.testing.assert_allclose(found["vertex_alpha"][:, 0], [1, 1, 1, 0.2])


def test_textures_look_at_the_set_of_coordinates_that_they_name(tmp_path):
    file = GltfFile()
    file.primitive["attributes"]["TEXCOORD_1"] = file.accessor(np.array(UVS) * 65535, "u2", normalized=True)
    file.tree["accessors"][1]["count"] = 3  # the other set cannot be used
    image = file.image(PIXEL)
    pbr = {"baseColorTexture": image | {"texCoord": 1}}
    _, notes = painted(tmp_path, file=file, pbrMetallicRoughness=pbr, emissiveFactor=[1, 1, 1], emissiveTexture=image)
    np.testing.assert_array_equal(engines.load_scene(tmp_path / "m.glb").shapes[0].uvs, np.array(UVS))
    assert "emissiveTexture has its mean everywhere: it looks at TEXCOORD_0, and others at TEXCOORD_1" in notes[0]


def test_a_texture_of_another_set_of_coordinates_has_its_mean(tmp_path):
    file = GltfFile()
    image = file.image(PIXEL)
    pbr = {"baseColorTexture": image, "metallicRoughnessTexture": image | {"texCoord": 1}}
    material, notes = painted(tmp_path, file=file, pbrMetallicRoughness=pbr | {"metallicFactor": 0.5})
    np.testing.assert_allclose(material.bsdf.metallic.pixels, [[[0.25]]])
    np.testing.assert_allclose(material.bsdf.roughness.pixels, [[[(128 + 255) / 510]]], rtol=1e-6)
    assert "metallicRoughnessTexture has its mean everywhere" in notes[0]


def test_light_that_no_ray_meets_passes_masks_and_panes(tmp_path):
    """A card that a mask takes away casts no shadow on the floor behind it."""
    means = []
    for roots in ([0, 1, 2], [1, 2]):
        file = GltfFile()
        file.material(pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 0]}, alphaMode="MASK")
        floor = file.add("meshes", primitives=[{**file.primitive, "material": file.add("materials")}])
        file.tree["nodes"] = [{"mesh": 0, "translation": [0, 0, 0.5]}, {"mesh": floor}]
        file.tree["nodes"].append({"extensions": {"KHR_lights_punctual": {"light": 0}}})
        file.tree["scenes"] = [{"nodes": roots}]
        file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "directional"}]}}
        file.add("cameras", type="orthographic", orthographic={"xmag": 0.4, "ymag": 0.4, "znear": 0, "zfar": 9})
        file.tree["nodes"][1]["children"] = [3]
        file.tree["nodes"].append({"camera": 0, "translation": [0.5, 0.5, 1]})
        scene = loaded(tmp_path, file)
        settings = engines.Settings(2, 2, shader=scene.shader or {"name": "path_tracer"})
        means.append(engines.engine("numpy").prepare(scene, settings).render(4).mean().mean())
    assert means[0] == pytest.approx(means[1], rel=1e-6) and means[1] > 0.05


def test_alpha_of_vertex_colours_that_is_not_cut_off_is_noted(tmp_path):
    file = GltfFile()
    file.primitive["attributes"]["COLOR_0"] = file.accessor([[255, 0, 0, 0]] * 4, "u1", normalized=True)
    _, notes = painted(tmp_path, file=file, alphaMode="MASK")
    assert notes == ("material 'paint': the alpha of vertex colours is not cut off: it is left out",)


def test_specular_does_not_bend_what_passes(tmp_path):
    extensions = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.25}}
    extensions |= {"KHR_materials_specular": {"specularFactor": 0.5}, "KHR_materials_volume": {"thicknessFactor": 1}}
    material, notes = painted(tmp_path, extensions, pbrMetallicRoughness=DIELECTRIC)
    assert material.bsdf.eta == 1.25 and "its reflection is that of its ior alone" in notes[0]


def test_an_ior_of_0_and_a_boundless_scale_stay_within_what_engines_take(tmp_path):
    for extensions in ({}, {"KHR_materials_specular": {"specularColorFactor": [1e30, 1e30, 1e30]}}):
        material, _ = painted(tmp_path, extensions | {"KHR_materials_ior": {"ior": 0}}, pbrMetallicRoughness=DIELECTRIC)
        assert material.bsdf.eta == 100.0
    file = GltfFile()
    material, notes = painted(tmp_path, file=file, normalTexture=file.image([[[255, 128, 255]]]) | {"scale": 1e39})
    assert np.isfinite(material.bsdf.map.pixels).all()
    assert notes == ("material 'paint': scale of normalTexture lies outside of [-100, 100]: it is held there",)


def test_the_transparent_colour_of_a_png_is_alpha(tmp_path):
    for mode, clear in (("RGB", (255, 128, 0)), ("L", 128)):
        buffer = io.BytesIO()
        image = Image.new(mode, (2, 1), clear)
        image.putpixel((1, 0), (0, 0, 0) if mode == "RGB" else 0)
        image.save(buffer, "PNG", transparency=clear)
        file = GltfFile()
        source = file.add("images", bufferView=file.view(buffer.getvalue()))
        pbr = {"baseColorTexture": {"index": file.add("textures", source=source)}}
        material, _ = painted(tmp_path, file=file, pbrMetallicRoughness=pbr, alphaMode="BLEND")
        assert material.bsdf.opacity.pixels[0, :, 0].tolist() == [0.0, 1.0]
