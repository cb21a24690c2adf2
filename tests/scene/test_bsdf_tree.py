"""BSDFs as trees: what they are made of, what passes them, and what light depends on."""

import numpy as np
import pytest

from engines.scene import (
    BLACK,
    WHITE,
    Blend,
    Bump,
    Checkerboard,
    Conductor,
    CustomBSDF,
    Dielectric,
    Diffuse,
    ImageTexture,
    Mask,
    Material,
    Mixture,
    NormalMap,
    Null,
    Plastic,
    Principled,
    Sheen,
    Sides,
    ThinDielectric,
)
from engines.scene.bsdf_tree import (
    anisotropic,
    has_null_lobes,
    is_opaque,
    is_textured,
    leaves,
    members,
    textures,
    tilts_null_lobes,
    transmits,
    uses_uvs,
)

BOARD = Checkerboard()
IMAGE = ImageTexture(np.full((2, 2, 3), 0.5, np.float32))
DARK = ImageTexture(np.zeros((2, 2, 3), np.float32))
METAL, GLASS = Conductor(BLACK, WHITE, (0.1, 0.2)), Dielectric()
TREE = Blend(BOARD, Bump(IMAGE, 1.0, METAL), Sides(None, Mask(0.5, METAL)))


class Plugin:
    options: dict = {}  # noqa: RUF012
    transmission = True


def test_members_stand_from_the_outside_in_and_leaves_once():
    assert [type(part) for part in members(TREE)] == [Blend, Bump, Conductor, Sides, Mask, Conductor]
    assert leaves(TREE) == [METAL, None]
    assert leaves(None) == [None] and list(members(None)) == []
    assert leaves(METAL) == [METAL]


@pytest.mark.parametrize(
    ("bsdf", "opaque", "through"),
    [
        (Diffuse(), True, False),
        (Sheen(), True, False),
        (Plastic(), True, False),
        (Mixture(kd=WHITE), True, False),
        (Mixture(kt=(0.0, 0.1, 0.0)), False, True),
        (Mixture(kt=DARK), True, True),
        (Principled(spec_trans=0.5), False, True),
        (Principled(spec_trans=DARK), True, True),
        (GLASS, False, True),
        (Null(), False, True),
        (Mask(0.5, Diffuse()), False, False),
        (Sides(None, Diffuse()), True, False),
        (Blend(0.5, Diffuse(), ThinDielectric()), False, True),
        (CustomBSDF(Plugin()), False, True),
    ],
)
def test_what_passes_a_bsdf(bsdf, opaque, through):
    assert (is_opaque(bsdf), transmits(bsdf)) == (opaque, through)
    assert (is_opaque(NormalMap(IMAGE, bsdf)), transmits(NormalMap(IMAGE, bsdf))) == (opaque, through)


def test_null_lobes_are_found_in_wrappers_and_below_tilts():
    assert has_null_lobes(TREE) and not has_null_lobes(GLASS)
    assert not tilts_null_lobes(TREE) and tilts_null_lobes(Sides(None, Bump(IMAGE, 1.0, Null())))


def test_textures_stand_in_the_order_of_the_tree():
    assert list(textures(TREE)) == [BOARD, IMAGE]
    assert list(textures(Conductor(BLACK, WHITE, (BOARD, 0.1), IMAGE))) == [BOARD, IMAGE]
    assert is_textured(TREE) and not is_textured(METAL) and not is_textured(None)


def test_texture_coordinates_matter_where_tangents_do():
    assert anisotropic(METAL) and not anisotropic(GLASS) and not anisotropic(None)
    assert anisotropic(Principled(anisotropic=BOARD)) and not anisotropic(Principled())
    assert uses_uvs(Mask(0.5, METAL)) and uses_uvs(Diffuse(BOARD)) and not uses_uvs(Mask(0.5, GLASS))


def test_a_material_is_one_bsdf():
    assert Material("m", kd=WHITE, ior=1.5).as_bsdf == Mixture(WHITE, ior=1.5)
    assert Material("m", bsdf=GLASS).as_bsdf is GLASS
