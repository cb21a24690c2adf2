"""Media in scene files: their keys, which sides of shapes and cameras have them, and what identifies a scene that has some."""

from dataclasses import replace

import pytest

import engines
from engines import SceneError
from engines.scene import HomogeneousMedium

SHAPES = {
    "sphere": {"center": [0, 0, 0], "radius": 1},
    "spheres": {"centers": [[0, 0, 0]], "radii": [1]},
    "disk": {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 1},
    "cylinder": {"p0": [0, 0, 0], "p1": [0, 0, 1], "radius": 1},
    "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]},
    "triangle": {"a": [0, 0, 0], "b": [1, 0, 0], "c": [0, 1, 0]},
    "mesh": {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]},
    "procedural": {"name": "box", "half_size": [1, 1, 1], "center": [0, 0, 0]},
}
CAMERAS = {
    "perspective": {},
    "thin_lens": {"aperture_radius": 0.1, "focus_distance": 3},
    "perspective_arctan": {},
    "orthographic": {"height": 2},
}
FOG = {"sigma_t": [0.5, 1, 4], "albedo": 0.9, "g": 0.6}


def mapping(media=None, shape=None, camera=None):
    return {
        "raybench_scene": 1,
        "media": {"smoke": {"sigma_t": 2, "albedo": [0.1, 0.2, 0.3]}, "fog": FOG} if media is None else media,
        "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0], **(camera or {})},
        "materials": {"clear": {"null": {}}},
        "shapes": [{"sphere": SHAPES["sphere"], "material": "clear", **(shape or {})}],
        "lights": [{"environment": {"radiance": 1}}],
    }


def read(**parts):
    return engines.scene_from(mapping(**parts))


def test_media_are_read_in_their_order():
    smoke = HomogeneousMedium("smoke", (2.0, 2.0, 2.0), (0.1, 0.2, 0.3))
    assert read().media == (smoke, HomogeneousMedium("fog", (0.5, 1.0, 4.0), (0.9, 0.9, 0.9), 0.6))
    assert read(media={}).media == ()


@pytest.mark.parametrize("kind", SHAPES)
def test_every_shape_has_media_on_its_sides(kind):
    scene = mapping()
    scene["shapes"] = [
        {kind: SHAPES[kind], "material": "clear", **sides} for sides in ({}, {"interior": "fog"}, {"exterior": "smoke"})
    ]
    sides = [(shape.interior, shape.exterior, shape.is_boundary) for shape in engines.scene_from(scene).shapes]
    assert sides == [(None, None, False), (1, None, True), (None, 0, True)]


@pytest.mark.parametrize("kind", CAMERAS)
def test_every_camera_may_be_in_a_medium(kind):
    camera = {"type": kind, **CAMERAS[kind]}
    assert read(camera=camera).camera.medium is None
    assert read(camera={**camera, "medium": "fog"}).camera.medium == 1


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"media": {"fog": {"sigma_t": -1, "albedo": 0}}}, r"media\.fog\.sigma_t = -1: must not be negative"),
        ({"media": {"fog": {"sigma_t": 1, "albedo": 1.5}}}, r"media\.fog\.albedo = 1\.5: must lie in \[0, 1\]"),
        ({"media": {"fog": {"sigma_t": 1, "albedo": 1, "g": 1}}}, r"media\.fog\.g = 1: must lie between -1 and 1"),
        ({"media": {"fog": {"sigma_t": 1}}}, r"media\.fog\.albedo: is missing"),
        ({"media": {"fog": {**FOG, "phase": "hg"}}}, r"media\.fog\.phase: unknown key"),
        ({"media": [FOG]}, r"media: must be a mapping from names to media"),
        ({"shape": {"interior": "fgo"}}, r"shapes\[0\]\.interior = 'fgo': unknown medium: did you mean 'fog'"),
        ({"shape": {"exterior": 1}}, r"shapes\[0\]\.exterior = 1: unknown medium"),
        ({"camera": {"medium": "air"}}, r"camera\.medium = 'air': unknown medium"),
    ],
)
def test_a_wrong_medium_is_refused_with_its_place(parts, said):
    with pytest.raises(SceneError, match=said):
        read(**parts)


def test_the_content_hash_follows_media_by_value():
    plain, inside = read().content_hash, read(shape={"interior": "fog"}).content_hash
    assert plain == read(media={}).content_hash, "media that nothing uses do not count"
    renamed = mapping({"mist": FOG}, {"interior": "mist"})
    assert engines.scene_from(renamed).content_hash == inside
    others = [
        read(shape={"exterior": "fog"}),
        read(shape={"interior": "smoke"}),
        read(shape={"interior": "fog", "exterior": "smoke"}),
        read(camera={"medium": "fog"}),
        *(read(media={"fog": {**FOG, **changed}}, shape={"interior": "fog"}) for changed in ({"g": 0}, {"albedo": 0.8})),
    ]
    assert len({plain, inside, *(scene.content_hash for scene in others)}) == 2 + len(others)


def test_a_saved_scene_has_its_media(tmp_path):
    scene = mapping(camera={"medium": "smoke"})
    sides = {"interior": "fog", "exterior": "smoke"}
    scene["shapes"] = [{kind: SHAPES[kind], "material": "clear", **sides} for kind in SHAPES]
    scene = engines.scene_from(scene)
    again = engines.load_scene(engines.save_scene(scene, tmp_path))
    assert again.media == scene.media
    assert again.content_hash == scene.content_hash
    assert [(shape.interior, shape.exterior) for shape in again.shapes] == [(1, 0)] * len(SHAPES)
    assert again.camera == scene.camera


def test_two_media_of_one_name_are_saved_under_two(tmp_path):
    scene = read(shape={"interior": "fog", "exterior": "smoke"})
    scene = replace(scene, media=tuple(replace(medium, name="fog") for medium in scene.media))
    assert engines.load_scene(engines.save_scene(scene, tmp_path)).content_hash == scene.content_hash
