"""What the base classes of adapters give: a film, passes, stopping, updates, and what an engine declines."""

import threading
from types import MappingProxyType

import numpy as np
import pytest

import engines
from engines import ConfigError, Settings, UnknownName, Unsupported
from engines.conformance import check_engine
from engines.errors import RendererFailed
from engines.peers.adapters import camera_frame, derive_seed, flat_meshes
from engines.scene import Mesh
from tests.adapters.tiny import ByCalls, Engine

SMALL = Settings(6, 5, sampler="random", seed=3)
CAMERA = {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]}
SQUARE = {"vertices": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "faces": [[0, 1, 2], [0, 2, 3]]}


def scene(shapes=(), lights=(), camera=None, textures=None, **materials):
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "name": "small",
            "camera": {**CAMERA, **(camera or {})},
            "textures": textures,
            "materials": {"grey": {"kd": 0.5}, **materials},
            "shapes": list(shapes),
            "lights": [{"point": {"position": [0, 3, 4], "intensity": 30}}, *lights],
        }
    )


LIT = scene([{"mesh": SQUARE, "material": "grey"}])


def test_an_adapter_that_renders_sample_by_sample_conforms():
    found = check_engine(Engine())
    assert [str(finding) for finding in found if finding.verdict == "broken"] == []
    held = {finding.key for finding in found if finding.ok}
    assert {"a_split_render_is_the_same", "update_of_the_shapes_starts_anew", "stop_from_a_thread_ends_the_render"} <= held


def test_the_variance_of_means_is_that_between_calls():
    renderer = ByCalls().prepare(LIT, SMALL)
    parts = []
    for spp in (2, 3, 4):
        parts.append((spp, renderer.image(spp, renderer.film.spp, renderer.seed)))
        film = renderer.render(spp)
        assert np.isnan(film.variance_of_mean()).all() == (spp == 2)
    weights, images = np.array([spp for spp, _ in parts]), np.array([image for _, image in parts])
    mean = np.average(images, axis=0, weights=weights)
    np.testing.assert_allclose(film.mean(), mean, rtol=1e-12)
    between = np.einsum("i,i...->...", weights, (images - mean) ** 2) / 2
    np.testing.assert_allclose(film.variance_of_mean(), between / 9, rtol=1e-9, atol=1e-15)
    assert np.isnan(film.half(0)).all()
    assert (film.counts == 9).all()


def test_passes_never_repeat_their_samples():
    renderer = ByCalls().prepare(LIT, SMALL)
    assert (renderer.image(1, 0, renderer.seed) != renderer.image(1, 1, renderer.seed)).any()


def test_derived_seeds_depend_on_all_bits_and_stay_within_31():
    seeds = {derive_seed(seed, part) for seed in (0, 1, 2**40, 2**63) for part in (0, 1, 2**40, "warm-up")}
    assert len(seeds) == 16
    assert all(0 < seed < 2**31 for seed in seeds)


def test_a_renderer_without_an_image_fails_unless_it_was_stopped():
    renderer = ByCalls().prepare(LIT, SMALL)
    renderer.image = lambda *_: None
    with pytest.raises(RendererFailed, match="tiny: the renderer gave no image"):
        renderer.render(1)

    renderer.image = lambda *_: renderer.stop()
    assert renderer.render(1).spp == 0


def test_stop_reaches_a_running_image():
    renderer, running, ended = ByCalls().prepare(LIT, SMALL), threading.Event(), threading.Event()

    def image(spp, offset, seed):
        running.set()
        assert ended.wait(20)

    renderer.image, renderer.interrupt = image, ended.set
    thread = threading.Thread(target=renderer.render, args=(5,))
    thread.start()
    assert running.wait(20)
    renderer.stop()
    thread.join(20)
    assert not thread.is_alive()


def test_an_image_may_say_how_many_samples_it_has():
    renderer = ByCalls().prepare(LIT, SMALL)
    renderer.image = lambda spp, *_: (np.ones((5, 6, 3)), spp + 2)
    assert renderer.render(3).spp == 5


def test_an_update_that_is_declined_leaves_the_renderer_as_it_was():
    renderer = Engine().prepare(LIT, SMALL)
    before = renderer.render(2).mean()
    with pytest.raises(Unsupported, match="Sphere"):
        renderer.update(shapes=scene([{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}]).shapes)
    np.testing.assert_array_equal(renderer.film.mean(), before)
    assert renderer.scene is LIT


@pytest.mark.parametrize(
    ("scene_", "settings", "words"),
    [
        (scene([{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}]), {}, "support the shape Sphere"),
        (scene(mirror={"conductor": {"metal": "Au"}}), {}, "'mirror': tiny does not support the BSDF Conductor"),
        (scene(holes={"mask": {"opacity": 0.5, "of": "grey"}}), {}, "'holes': tiny does not support the BSDF Mask"),
        (scene(lamp={"emission": 1, "two_sided": True}), {}, "'lamp'.*both sides"),
        (scene(textures={"t": {"checkerboard": {}}}, lamp={"emission": "t"}), {}, "'lamp'.*Checkerboard"),
        (scene(lights=[{"environment": {"radiance": 1}}]), {}, "support the light EnvironmentLight"),
        (scene(lights=[{"point": {"position": [0, 1, 0], "intensity": 1, "falloff": "none"}}]), {}, "fall off"),
        (scene(camera={"mirror": True}), {}, "camera's mirror"),
        (scene(camera={"type": "orthographic", "height": 2}), {}, "support the camera Orthographic"),
        (scene(textures={"t": {"checkerboard": {}}}, t={"kd": "t"}), {}, "'t'.*Checkerboard"),
        (LIT, {"precision": "float32"}, "float64 only"),
        (LIT, {"sampler": "halton"}, "no sampler halton: known: random, sobol"),
        (LIT, {"shader": {"name": "path_tracer", "direct": "light"}}, "direct mis only"),
        (LIT, {"shader": {"name": "path_tracer", "rr_depth": 2}}, "rr_depth from 4 to 99 only"),
    ],
)
def test_what_is_not_listed_is_declined(scene_, settings, words):
    from dataclasses import replace

    with pytest.raises(Unsupported, match=words):
        ByCalls().prepare(scene_, replace(SMALL, **settings))


def test_a_package_that_is_missing_is_named_last():
    class Without(Engine):
        module, install = "no_such_module", "pip install it"

    assert Without().why_not(LIT, SMALL) == "no_such_module is not installed: pip install it"
    assert "Sphere" in Without().why_not(scene([{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}]), SMALL)


def test_unknown_names_are_refused_and_own_ones_known():
    class Own(Engine):
        own_samplers = takes_samplers = MappingProxyType({"blue": {}})

    assert Own().why_not(LIT, Settings(sampler="blue")) is None
    with pytest.raises(UnknownName, match="blue"):
        Own().prepare(LIT, Settings(sampler="blu"))
    with pytest.raises(ConfigError, match="max_depth"):
        Own().prepare(LIT, Settings(sampler="blue", shader={"name": "path_tracer", "max_depth": 0}))


def test_flat_meshes_hold_every_triangle_by_material():
    flat_triangle = {"triangle": {"a": [0, 0, 0], "b": [0, 0, 0], "c": [1, 0, 0]}, "material": "grey"}
    triangle = {"triangle": {"a": [0, 0, 1], "b": [1, 0, 1], "c": [0, 1, 1]}, "material": "red"}
    found = flat_meshes(
        scene(
            [
                {"mesh": SQUARE, "material": "grey"},
                triangle,
                {"mesh": SQUARE, "material": "red"},
                flat_triangle,
                {"mesh": {**SQUARE, "smooth": True}, "material": "red"},
            ],
            red={"kd": [0.5, 0, 0]},
        )
    )
    assert [(mesh.material, len(mesh.faces), mesh.normals is not None) for mesh in found] == [
        (0, 2, False),
        (1, 3, False),
        (1, 2, True),
    ]
    assert len({mesh.name for mesh in found}) == 3
    corners = found[1].vertices[found[1].faces]
    np.testing.assert_array_equal(corners[0], [[0, 0, 1], [1, 0, 1], [0, 1, 1]])
    np.testing.assert_array_equal(corners[1:], np.array(SQUARE["vertices"])[SQUARE["faces"]])
    assert all(mesh.uvs is None for mesh in found)


def test_faces_without_texture_coordinates_get_their_own_where_a_texture_is():
    (found,) = flat_meshes(scene([{"mesh": SQUARE, "material": "t"}], textures={"s": {"checkerboard": {}}}, t={"kd": "s"}))
    np.testing.assert_array_equal(found.uvs[found.faces], [[[0, 0], [1, 0], [0, 1]]] * 2)


@pytest.mark.parametrize(
    "camera",
    [
        {"fov": 30, "principal_point": [0.1, -0.2]},
        {"fov": 50, "fov_axis": "x", "mirror": True, "up": [0.1, 1, 0.3]},
        {"type": "orthographic", "height": 3, "principal_point": [-0.3, 0.2]},
        {"type": "thin_lens", "aperture_radius": 1e-9, "focus_distance": 4},
    ],
)
def test_a_camera_frame_gives_the_rays_of_the_engines(camera):
    """A point through the frame's window is seen in the pixel that the frame says."""
    settings, rng = Settings(12, 7, shader="albedo", sampler="random"), np.random.default_rng(1)
    empty = scene(camera=camera)
    frame = camera_frame(empty, settings)
    left, right, bottom, top = frame.window
    for x, y in ((0, 0), (11, 0), (3, 5), (6, 6)):
        inside = (np.array([x, y]) + 0.5) / (12, 7)
        place = (left + inside[0] * (right - left)) * frame.right + (top + inside[1] * (bottom - top)) * frame.up
        distance = rng.uniform(2, 4)
        scale = 1.0 if frame.fov_x == 0.0 else distance
        center = frame.origin + distance * frame.forward + scale * place
        dot = {"sphere": {"center": center.tolist(), "radius": 0.2 * scale * (top - bottom) / 7}, "material": "grey"}
        seen = engines.engine("numpy").prepare(scene([dot], camera=camera), settings).render(64).mean()[..., 0]
        assert seen[y, x] > 0
        assert (seen > 0).sum() == 1


def test_a_camera_frame_has_the_angles_of_view():
    frame = camera_frame(scene(camera={"fov": 90}), Settings(20, 10))
    assert frame.fov_y == pytest.approx(90)
    assert frame.fov_x == pytest.approx(2 * np.degrees(np.arctan(2)))
    assert frame.window == pytest.approx((-2, 2, -1, 1))


def test_the_mesh_of_a_scene_is_not_changed():
    (mesh,) = LIT.shapes
    assert isinstance(mesh, Mesh)
    assert flat_meshes(LIT)[0].vertices is not mesh.vertices
