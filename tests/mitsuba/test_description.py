"""What Mitsuba gets of each part of a scene, asked of Mitsuba: BSDFs, textures, cameras, cylinders and environments."""

from dataclasses import replace

import numpy as np
import pytest

from engines.peers.adapters.colors import LUMINANCE
from engines.peers.mitsuba.bsdfs import bsdf_node, material_lacks
from engines.peers.mitsuba.cameras import sensor
from engines.peers.mitsuba.description import scene_lacks
from engines.peers.mitsuba.lights import light_node
from engines.peers.mitsuba.nodes import Placing
from engines.peers.mitsuba.shapes import parts
from engines.peers.mitsuba.stage import _with_transforms
from engines.peers.mitsuba.textures import Textures
from engines.scene import (
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    Cylinder,
    Dielectric,
    Diffuse,
    EnvironmentLight,
    ImageTexture,
    Mask,
    Material,
    Mixture,
    NormalMap,
    Null,
    Orthographic,
    Perspective,
    Plane,
    Plastic,
    Principled,
    Scene,
    Sheen,
    Sides,
    ThinDielectric,
    ThinLens,
)
from tests.mitsuba.peer import mi
from tests.needs import needs

pytestmark = needs("mitsuba-scalar")

RNG = np.random.default_rng(3)
IMAGE = ImageTexture(RNG.uniform(0.1, 0.4, (4, 5, 3)).astype(np.float32), to_uv=(2.0, 0.0, 0.25, 0.0, -1.5, 0.5))
GREY = ImageTexture(RNG.uniform(0.1, 0.9, (3, 1, 1)).astype(np.float32), wrap="clamp")
CHECKS = Checkerboard((0.1, 0.2, 0.3), (0.6, 0.5, 0.4))
METAL = Conductor((0.2, 0.4, 1.4), (3.9, 2.4, 1.6), (0.3, GREY), distribution="beckmann")
MODELS = [
    Mixture(kd=IMAGE, ks=(0.3, 0.2, 0.1)),
    Mixture(ks=IMAGE, kt=CHECKS, ior=1.5, fresnel=True),
    Diffuse(CHECKS),
    METAL,
    replace(METAL, alpha=(0.0, 0.0), reflectance=IMAGE),
    Dielectric(1.3, (0.2, 0.2), CHECKS, IMAGE, "beckmann"),
    Dielectric(0.7),
    ThinDielectric(1.5, IMAGE),
    Plastic(IMAGE, nonlinear=True),
    Plastic(CHECKS, 1.9, 0.2, reflectance=IMAGE),
    Principled(IMAGE, GREY, 0.5, metallic=GREY, clearcoat=0.5),
    Principled(spec_trans=0.5),
    Null(),
    Sheen((0.6, 0.6, 0.6)),
    Mask(GREY, METAL),
    Blend(IMAGE, METAL, Mask(0.5, Diffuse())),
    Bump(IMAGE, 0.1, Mask(0.5, Blend(0.2, METAL, Diffuse()))),
    NormalMap(GREY, METAL),
    Bump(IMAGE, 0.1, Blend(0.3, METAL, Principled(spec_trans=0.5))),
    Sides(METAL, None),
    Sides(None, Diffuse()),
    Bump(IMAGE, 0.1, Sides(METAL, Diffuse())),
    Mask(0.3, Sides(Diffuse(), None)),
    Blend(0.5, Dielectric(1.5), Diffuse()),
]


@pytest.fixture(autouse=True)
def _scalar():
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)


def placing():
    def mesh(*given):
        raise AssertionError("no mesh is described here")

    return Placing(mesh, lambda name, image: {"bitmap": mi.Bitmap(np.ascontiguousarray(image, np.float32))})


def loaded(model):
    textures = Textures(placing())
    node = bsdf_node(model, textures)
    found = mi.load_dict(_with_transforms(mi, {"type": "scene", **textures.nodes, "it": {"type": "sphere", "bsdf": node}}))
    return found.shapes()[0].bsdf()


def hit(u=0.3, v=0.6, wi=(0.3, 0.2, 0.9)):
    si = mi.SurfaceInteraction3f()
    si.uv, si.wi, si.p, si.n = [u, v], np.array(wi) / np.linalg.norm(wi), [0, 0, 0], [0, 0, 1]
    si.sh_frame = mi.Frame3f([0, 0, 1])
    si.dp_du, si.dp_dv = [1, 0, 0], [0, 1, 0]
    return si


def value(bsdf, wo, **where):
    wo = np.array(wo) / np.linalg.norm(wo)
    return np.ravel(bsdf.eval(mi.BSDFContext(), hit(**where), wo)) / abs(wo[2])


def test_every_model_and_wrapper_is_one_of_mitsubas():
    for model in MODELS:
        assert material_lacks(Material("it", bsdf=model)) is None, model
        bsdf = loaded(model)
        seen = [value(bsdf, (0.1, -0.3, 0.9)), value(bsdf, (0.1, -0.3, -0.9), wi=(0.3, 0.2, -0.9))]
        assert np.isfinite(seen).all() and np.min(seen) >= 0.0, model


def bilinear(texture, u, v):
    """As docs/transport.md has it, for `repeat`."""
    u, v = np.reshape(texture.to_uv, (2, 3)) @ (u, v, 1.0)
    h, w = texture.pixels.shape[:2]
    x, y = u * w - 0.5, v * h - 0.5
    i, j, fx, fy = int(np.floor(x)), int(np.floor(y)), x - np.floor(x), y - np.floor(y)
    rows = [(1 - fx) * texture.pixels[k % h, i % w] + fx * texture.pixels[k % h, (i + 1) % w] for k in (j, j + 1)]
    return (1 - fy) * rows[0] + fy * rows[1]


def test_textures_are_looked_up_as_transport_md_says():
    diffuse, checks = loaded(Diffuse(IMAGE)), loaded(Diffuse(CHECKS))
    for u, v in RNG.uniform(-2.0, 2.0, (20, 2)):
        assert np.allclose(value(diffuse, (0, 0, 1), u=u, v=v), bilinear(IMAGE, u, v) / np.pi, rtol=1e-4)
        same = (u - np.floor(u) > 0.5) == (v - np.floor(v) > 0.5)
        assert np.allclose(value(checks, (0, 0, 1), u=u, v=v), np.array(CHECKS.a if same else CHECKS.b) / np.pi, rtol=1e-5)


def test_numbers_of_a_texture_are_luminances_and_a_row_of_texels_is_an_image():
    share = LUMINANCE @ bilinear(IMAGE, 0.3, 0.6)
    assert np.allclose(value(loaded(Mask(IMAGE, Diffuse((1.0,) * 3))), (0, 0, 1)), share / np.pi, rtol=1e-4)
    one, other = (float(LUMINANCE @ colour) for colour in (CHECKS.a, CHECKS.b))
    blend = loaded(Blend(CHECKS, Diffuse((0.0,) * 3), Diffuse((1.0,) * 3)))
    assert np.allclose([value(blend, (0, 0, 1), v=v)[0] * np.pi for v in (0.3, 0.7)], (one, other), rtol=1e-5)
    rows = loaded(Mask(GREY, Diffuse((1.0,) * 3)))  # one column: u does not matter
    assert np.allclose([value(rows, (0, 0, 1), u=u, v=0.5)[0] * np.pi for u in (0.1, 0.9)], GREY.pixels[1, 0, 0], rtol=1e-5)


def test_opaque_models_are_alike_on_both_sides_and_sides_are_not():
    front, back = {"wi": (0.3, 0.2, 0.9)}, {"wi": (0.3, 0.2, -0.9)}
    for model in (METAL, Principled(IMAGE), Bump(IMAGE, 0.3, METAL), Blend(0.4, METAL, Diffuse())):
        one, other = value(loaded(model), (0.2, 0.1, 0.9), **front), value(loaded(model), (0.2, 0.1, -0.9), **back)
        assert np.allclose(one, other, rtol=1e-5) and one.min() > 0.0
    sides = loaded(Sides(Diffuse((0.5,) * 3), Bump(IMAGE, 0.2, Diffuse((0.25,) * 3))))
    assert value(sides, (0, 0, 1), **front)[0] == pytest.approx(0.5 / np.pi)
    assert 0.0 < value(sides, (0, 0, -1), **back)[0] < 0.26 / np.pi
    dark = loaded(Sides(Diffuse(), None))
    assert value(dark, (0, 0, 1), **front)[0] > 0.0 and value(dark, (0, 0, -1), **back)[0] == 0.0


def test_masks_come_out_of_bumps_and_let_through_from_both_sides():
    inner = Mask(0.5, Blend(0.2, METAL, Diffuse()))
    for model in (inner, Bump(IMAGE, 0.1, inner), NormalMap(GREY, inner)):
        bsdf = loaded(model)
        for side in (1.0, -1.0):
            si = hit(wi=(0.3, 0.2, 0.9 * side))
            for u, passes in ((0.01, False), (0.499, False), (0.501, True), (0.999, True)):
                wo = np.ravel(bsdf.sample(mi.BSDFContext(), si, u, [0.4, 0.7])[0].wo)
                assert np.allclose(wo, -np.ravel(si.wi)) is passes, model


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (Dielectric(1.0, (0.1, 0.1)), "index 1"),
        (Sides(Dielectric(), None), "sides that transmit"),
        (Bump(IMAGE, 1.0, Blend(0.5, Mask(0.5, Diffuse()), Dielectric())), "masks beside"),
        (Bump(IMAGE, 1.0, NormalMap(IMAGE, Diffuse())), "inside of another"),
        (NormalMap(CHECKS, Diffuse()), "checkerboard"),
        (Blend(0.5, Diffuse(), Sheen((0.5, 0.5, 0.6))), "a sheen with a colour"),
        (Diffuse(ImageTexture(np.full((2, 2, 3), 1.5, np.float32))), "leave the range"),
        (Bump(replace(IMAGE, to_uv=(0.0, 1.0, 0.0, -1.0, 0.0, 0.0)), 1.0, Diffuse()), "turned"),
    ],
)
def test_what_has_no_counterpart_is_declined_by_name(model, words):
    assert words in str(material_lacks(Material("it", bsdf=Mask(0.5, model) if "sides" not in words else model)))


EYE, TARGET, UP = (1.0, 2.0, 3.0), (0.5, 0.0, -1.0), (0.1, 1.0, 0.0)
CAMERAS = [
    Perspective(EYE, TARGET, UP, 50.0, "y", (9, 6), (0.1, -0.2), True),
    Perspective(EYE, TARGET, UP, 50.0, "x", (6, 9), (0.3, 0.0), clip=(0.5, 20.0)),
    Orthographic(EYE, TARGET, UP, 2.0, (9, 6), (0.1, -0.2), True),
    ThinLens(EYE, TARGET, UP, 50.0, "y", (9, 6), 0.3, 2.5),
]


def test_cameras_send_the_rays_of_transport_md():
    forward = np.subtract(TARGET, EYE) / np.linalg.norm(np.subtract(TARGET, EYE))
    right = np.cross(forward, UP) / np.linalg.norm(np.cross(forward, UP))
    up = np.cross(right, forward)
    for camera in CAMERAS:
        width, height = camera.resolution
        lens = mi.load_dict(_with_transforms(mi, sensor(camera, width, height, {"type": "independent"}, 1e-3)))
        for place in RNG.random((6, 2)):
            x, y = (2.0 * (place[0] - camera.principal_point[0]) - 1.0, 1.0 - 2.0 * (place[1] - camera.principal_point[1]))
            half = camera.height / 2.0 if isinstance(camera, Orthographic) else np.tan(np.radians(camera.fov / 2.0))
            hx, hy = (half, half * height / width) if getattr(camera, "fov_axis", "y") == "x" else (half * width / height, half)
            across = x * hx * (-right if camera.mirror else right) + y * hy * up
            ray = lens.sample_ray(0.0, 0.5, place, [0.3, 0.8])[0]
            origin, direction = np.ravel(ray.o), np.ravel(ray.d)
            if isinstance(camera, ThinLens):
                sharp = np.add(EYE, camera.focus_distance * (forward + across))
                away = np.cross(sharp - origin, direction)
                on_lens = origin - np.multiply(direction, (origin - EYE) @ forward / (direction @ forward)) - EYE
                assert np.linalg.norm(away) < 1e-5 and 0.01 < np.linalg.norm(on_lens) < 0.3
                continue
            begin, towards = (EYE, forward + across) if isinstance(camera, Perspective) else (EYE + across, forward)
            towards = towards / np.linalg.norm(towards)
            near = max(camera.clip[0], 1e-7)
            assert np.allclose(direction, towards, atol=1e-6)
            assert np.allclose(origin, np.add(begin, towards * near / (towards @ forward)), atol=1e-5)
            if np.isfinite(camera.clip[1]):
                assert ray.maxt * (towards @ forward) == pytest.approx(camera.clip[1] - camera.clip[0], rel=1e-5)


def scene(*shapes, camera=CAMERAS[0], **material):
    return Scene("it", camera, (Material("it", **material),), shapes, (), "")


def test_a_cylinder_has_the_texture_coordinates_of_transport_md():
    shape = Cylinder((1.0, 0.0, 0.5), (0.2, 1.5, -0.4), 0.4, 0)
    (part,) = parts(scene(shape, kd=(0.5,) * 3), placing(), Textures(placing()))
    node = {key: inner for key, inner in part.node.items() if key != "bsdf"}
    found = mi.load_dict(_with_transforms(mi, {"type": "scene", "it": node}))
    axis = np.subtract(shape.p1, shape.p0)
    length = np.linalg.norm(axis)
    x, y, z = axis / length
    assert z > -0.7  # the chart of the frame below
    first, second = (
        np.array([1 - x * x / (1 + z), -x * y / (1 + z), -x]),
        np.array([-x * y / (1 + z), 1 - y * y / (1 + z), -y]),
    )
    for u, v in RNG.uniform(0.05, 0.95, (8, 2)):
        out = np.cos(2 * np.pi * u) * first + np.sin(2 * np.pi * u) * second
        point = shape.p0 + v * axis + 0.4 * out
        si = found.ray_intersect(mi.Ray3f(point + out, -out))
        assert np.allclose(np.ravel(si.p), point, atol=1e-5) and np.allclose(np.ravel(si.n), out, atol=1e-5)
        assert np.allclose(np.ravel(si.uv), (u, v), atol=1e-5) and np.allclose(np.ravel(si.dp_dv), axis, atol=1e-5)


def test_textures_on_a_plane_are_declined():
    plane = Plane((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0)
    assert "textures on a plane" in str(scene_lacks(scene(plane, bsdf=Diffuse(CHECKS))))
    assert scene_lacks(scene(plane, bsdf=Diffuse())) is None


@pytest.mark.parametrize("rows", ["cells", "poles"])
def test_an_environment_is_looked_up_with_its_rotation_and_rows(rows):
    turn = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    image = RNG.random((5, 8, 3))
    light = EnvironmentLight((2.0, 1.0, 0.5), image, tuple(map(tuple, turn)), rows)
    found = mi.load_dict(_with_transforms(mi, light_node(light, placing(), Textures(placing()))))
    directions = RNG.normal(size=(20, 3))
    for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        x, y, z = turn.T @ direction
        u, v = (np.arctan2(x, -z) / (2 * np.pi)) % 1.0, np.arccos(y) / np.pi
        across, down = u * 8 - 0.5, v * 5 - 0.5 if rows == "cells" else v * 4
        i, j, fx, fy = int(np.floor(across)), int(np.floor(down)), across - np.floor(across), down - np.floor(down)
        row = [(1 - fx) * image[min(max(k, 0), 4), i % 8] + fx * image[min(max(k, 0), 4), (i + 1) % 8] for k in (j, j + 1)]
        si = mi.SurfaceInteraction3f()
        si.wi = -direction
        assert np.allclose(np.ravel(found.eval(si)), light.radiance * ((1 - fy) * row[0] + fy * row[1]), rtol=2e-3, atol=1e-3)
