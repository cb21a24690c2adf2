"""Generated furniture: closed where it is a solid, facing outwards, with normals and texture coordinates that fit."""

from __future__ import annotations

import numpy as np
import pytest

import engines
from engines.errors import SceneError
from engines.scene.geometry import face_normals, unit_rows

VASE = [[0, 0], [0.4, 0.1], [0.2, 0.6], [0.2, 0.6], [0, 0.6]]
TEXTURED = {
    "textures": {"squares": {"checkerboard": {"a": 1, "b": 0}}},
    "materials": {"grey": {"diffuse": {"reflectance": "squares"}}},
}
SOLIDS = {
    "lathe": {"profile": VASE, "segments": 32},
    "tube": {"points": [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 1, 1]], "radius": 0.05, "end_radius": 0.02},
    "closed tube": {"points": [[1, 0, 0], [0, 1, 0.3], [-1, 0, 0], [0, -1, -0.3]], "radius": 0.1, "closed": True},
    "rounded_box": {"half_size": [1, 0.5, 0.3], "radius": 0.1},
    "upholstery": {"half_size": [1, 0.5, 0.3], "radius": 0.1, "bulge": 0.05},
    "cushion": {"size": [0.5, 0.4, 0.2]},
    "books": {"count": 5},
}
NAMES = {"closed tube": "tube", "upholstery": "rounded_box"}


def made(name, **options):
    scene = {
        "raybench_scene": 1,
        "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
        **TEXTURED,
        "shapes": [{"procedural": {"name": name, **options}, "material": "grey"}],
    }
    return engines.scene_from(scene).shapes[0]


def welded(mesh):
    """Faces in which vertices at one place are one."""
    _, same = np.unique(np.round(mesh.vertices, 7), axis=0, return_inverse=True)
    return same.ravel()[mesh.faces]


@pytest.mark.parametrize("kind", SOLIDS)
def test_solids_are_closed_and_their_faces_and_normals_point_outwards(kind):
    mesh = made(NAMES.get(kind, kind), **SOLIDS[kind], center=[3, 4, 5], tilt=20, rotate_y=50)
    faces = welded(mesh)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert sorted(map(tuple, edges)) == sorted(map(tuple, edges[:, ::-1])), "every edge has its opposite"
    corners = mesh.vertices[mesh.faces] - [3, 4, 5]
    assert np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() > 0, "its volume"
    if mesh.normals is not None:
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1)
        agreement = np.einsum("ij,ikj->ik", unit_rows(face_normals(mesh.vertices, mesh.faces)), mesh.normals[mesh.faces])
        assert np.median(agreement) > 0.9 and (agreement > 0).mean() > 0.98
    assert np.isfinite(mesh.uvs).all() and len(mesh.uvs) == len(mesh.vertices)


@pytest.mark.parametrize("part", ["leaves", "stems"])
def test_a_plants_normals_are_on_the_fronts_of_its_faces(part):
    mesh = made("plant", part=part, leaves=8)
    assert (np.einsum("ij,ikj->ik", face_normals(mesh.vertices, mesh.faces), mesh.normals[mesh.faces]) > 0).all()


def test_a_lathe_of_a_half_circle_is_a_sphere_with_radial_normals():
    angle = np.linspace(-np.pi / 2, np.pi / 2, 33)
    profile = np.stack([np.maximum(np.cos(angle), 0), np.sin(angle)], axis=1)
    profile[[0, -1], 0] = 0
    mesh = made("lathe", profile=profile.tolist(), segments=64, spans=2)
    assert np.allclose(np.linalg.norm(mesh.vertices, axis=1), 1, atol=1e-4)
    assert np.allclose(mesh.normals, mesh.vertices, atol=0.03)
    east = np.abs(mesh.vertices - [0, 0, -1]).max(axis=1).argmin()
    assert mesh.uvs[east] == pytest.approx([0.25, 0.5], abs=1e-3), "u goes from +x to -z, v from the top"


def test_two_points_of_a_profile_at_one_place_are_an_edge():
    cylinder = made("lathe", profile=[[0, 0], [1, 0], [1, 0], [1, 2], [1, 2], [0, 2]])
    assert len(cylinder.faces) == 48 * 4
    assert set(np.unique(np.abs(np.round(cylinder.normals[:, 1], 9)))) == {0.0, 1.0}


def test_a_tilt_takes_y_towards_z_before_the_turn_about_y():
    mesh = made("rounded_box", half_size=[0.01, 1, 0.01], radius=0.001, tilt=90)
    assert np.allclose(np.abs(mesh.vertices).max(axis=0), [0.01, 0.01, 1])
    rod = made("tube", points=[[0, 0, 0], [0, 1, 0]], radius=0.01, tilt=90, rotate_y=90)
    assert rod.vertices[:, 0].max() == pytest.approx(1) and rod.vertices[:, 0].min() == pytest.approx(0)


def test_a_rounded_box_shows_textures_in_metres_upright_on_its_walls():
    mesh = made("rounded_box", half_size=[1, 0.5, 0.25], radius=0.05)
    front = mesh.normals[:, 2] > 0.999
    assert np.allclose(mesh.uvs[front], mesh.vertices[front][:, :2] * [1, -1])


def test_a_sheet_is_flat_without_folds_and_waves_by_its_depth_with_them():
    path = {"points": [[0, 1, 0], [0, 0, 0]], "across": [2, 0, 0]}
    assert np.abs(made("sheet", **path).vertices[:, 2]).max() == 0
    curtain = made("sheet", **path, folds=5, depth=0.1, columns=200)
    assert np.abs(curtain.vertices[:, 2]).max() == pytest.approx(0.1, rel=1e-2)


def test_leaves_of_a_plant_grow_where_its_stems_end():
    options = {"leaves": 7, "seed": 3, "segments": 8}
    blades, stems = (made("plant", part=part, **options) for part in ("leaves", "stems"))
    ends = stems.vertices.reshape(7, 9, 7, 3)[:, -1, :6].mean(axis=1)
    starts = blades.vertices.reshape(7, 9, 5, 3)[:, 0, 2]
    assert np.allclose(ends, starts, atol=1e-3)
    assert blades.uvs.min() >= 0 and blades.uvs.max() <= 1


def test_books_stand_on_their_feet_and_hold_their_pages():
    covers, pages = (made("books", count=9, part=part, center=[0, 1, 0]) for part in ("covers", "pages"))
    assert covers.vertices[:, 1].min() == 1 < pages.vertices[:, 1].min()
    assert (np.abs(pages.vertices[:, 0]) < np.abs(covers.vertices[:, 0]).max()).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": "lathe", "profile": [[-1, 0], [1, 1]]}, "radii must not be less than 0"),
        ({"name": "lathe", "profile": [[1, 0]]}, "at least 2 are expected"),
        ({"name": "lathe", "profile": [[1, 0], [1, 0]]}, "must have two points in succession that differ"),
        ({"name": "tube", "points": [[0, 0, 0], [0, 0, 0]]}, "two points in succession must differ"),
        ({"name": "cushion", "segments": 16384}, r"would need .* GiB"),
    ],
)
def test_what_makes_no_surface_is_refused(options, message):
    with pytest.raises(SceneError, match=message):
        made(**options)
