"""Writes scenes/meadow.yaml, which shows a few groups of grass, flowers and trees again and again: python scenes/meadow.py

Places are random, with fixed seeds: denser near the camera, and larger patches far from it.
"""

from pathlib import Path

import numpy as np

from engines.scene.procedural.rods import tree
from engines.scene.procedural.surfaces import terrain

TURN = [[-0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, -0.8]]
"""Of the sky, whose sun comes to lie behind the camera."""
FILE = Path(__file__).with_name("meadow.yaml")
GROUND = {"cells": 96, "size": 150.0, "height": 4.5, "roughness": 0.35, "seed": 5, "center": (0.0, -3.0, -55.0)}
HEAD = """\
# A meadow and trees under the sun and the sky of an image: 3,800,000 triangles of grass, flowers and leaves, instances
# of ten groups of 19,000 triangles in all. Written by scenes/meadow.py. Made for raybench.
raybench_scene: 1
name: meadow
camera: {{type: perspective, eye: {eye}, target: {target}, up: [0, 1, 0], fov: 36, resolution: [1280, 720]}}
materials:
  soil:      {{diffuse: {{reflectance: [0.1, 0.115, 0.035]}}}}
  grass:     {{diffuse: {{reflectance: [0.22, 0.38, 0.06]}}}}
  fresh:     {{diffuse: {{reflectance: [0.34, 0.5, 0.09]}}}}
  dry:       {{diffuse: {{reflectance: [0.46, 0.4, 0.17]}}}}
  stalk:     {{diffuse: {{reflectance: [0.2, 0.32, 0.09]}}}}
  poppy:     {{diffuse: {{reflectance: [0.72, 0.045, 0.02]}}}}
  dark:      {{diffuse: {{reflectance: [0.03, 0.025, 0.03]}}}}
  white:     {{diffuse: {{reflectance: [0.86, 0.86, 0.82]}}}}
  yellow:    {{diffuse: {{reflectance: [0.85, 0.56, 0.03]}}}}
  blue:      {{diffuse: {{reflectance: [0.12, 0.18, 0.72]}}}}
  bark:      {{diffuse: {{reflectance: [0.22, 0.16, 0.11]}}}}
  leaf:      {{diffuse: {{reflectance: [0.18, 0.34, 0.05]}}}}
  bright:    {{diffuse: {{reflectance: [0.3, 0.45, 0.07]}}}}
"""


def listed(values):
    """Numbers as YAML, to a tenth of a millimetre."""
    return "[" + ", ".join(f"{round(float(value), 4):g}" for value in np.ravel(values)) + "]"


def procedural(name, material, **options):
    options = ", ".join(f"{key}: {listed(value) if np.ndim(value) == 1 else value}" for key, value in options.items())
    return f"{{procedural: {{name: {name}, {options}}}, material: {material}}}"


def tube(material, points, radius, end_radius):
    points = "[" + ", ".join(map(listed, points)) + "]"
    options = f"points: {points}, radius: {radius}, end_radius: {end_radius}, spans: 3, sides: 5"
    return f"{{procedural: {{name: tube, {options}}}, material: {material}}}"


def petals(material, count, center, tilt, inner, outer, width, rise):
    """A ring of petals of two triangles each around `center`, which leans by `tilt` radians."""
    turns = 2 * np.pi * np.arange(count) / count
    out, side = np.stack([np.cos(turns), 0 * turns, np.sin(turns)], 1), np.stack([-np.sin(turns), 0 * turns, np.cos(turns)], 1)
    up, middle = np.array([0.0, 1.0, 0.0]), inner + 0.6 * (outer - inner)
    broad = middle * out + rise * up
    corners = [inner * out, broad + 0.5 * width * side, outer * out, broad - 0.5 * width * side]
    points = np.stack(corners, axis=1).reshape(-1, 3)
    cos, sin = np.cos(tilt), np.sin(tilt)
    points = points @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).T + center
    faces = (4 * np.arange(count)[:, None, None] + np.array([[0, 2, 1], [0, 3, 2]])).reshape(-1, 3)
    rows = (", ".join(map(listed, points)), ", ".join(str(face.tolist()) for face in faces))
    return f"{{mesh: {{vertices: [{rows[0]}], faces: [{rows[1]}]}}, material: {material}}}"


def grass(random, tufts, size, length, dry):
    """A patch of tufts, `size` metres across."""
    shapes = []
    for tuft in range(tufts):
        x, z = random.uniform(-0.5, 0.5, 2) * size
        material = random.choice(["grass", "fresh", "dry"], p=[0.6 - dry, 0.4, dry])
        shapes.append(
            procedural(
                "plant", material, leaves=26, stem=0.02, length=round(length * random.uniform(0.75, 1.25), 3), width=0.0085,
                spread=62, droop=round(random.uniform(35, 85)), crease=0.5, segments=3, seed=tuft, center=[x, -0.01, z],
                rotate_y=round(random.uniform(0, 360)),
            )
        )  # fmt: skip
    return shapes


def stalk(random, height):
    """A bent stalk, and where it ends."""
    lean = random.uniform(-0.12, 0.12, 2) * height
    points = np.array([[0, 0, 0], [0.2 * lean[0], 0.5 * height, 0.2 * lean[1]], [lean[0], height, lean[1]]])
    return tube("stalk", points, 0.0022, 0.0014), points[-1]


def poppies(random):
    shapes = []
    for flower in range(3):
        foot = np.append(random.uniform(-0.16, 0.16, 2), 0)[[0, 2, 1]]
        bent, tip = stalk(random, random.uniform(0.42, 0.58))
        bent = bent.replace("spans:", f"center: {listed(foot)}, spans:")
        lean = random.uniform(-25, 25)
        cup = {"leaves": 5, "stem": 0.002, "length": 0.05, "width": 0.062, "spread": 75, "droop": 12, "crease": 0.15}
        shapes += [
            bent,
            procedural("plant", "poppy", **cup, segments=5, seed=flower, center=foot + tip, tilt=round(lean)),
            procedural("tessellated_sphere", "dark", subdivisions=1, center=foot + tip + [0, 0.008, 0], radius=0.008),
        ]
    return shapes


def daisies(random):
    shapes = []
    for _ in range(5):
        foot = np.append(random.uniform(-0.2, 0.2, 2), 0)[[0, 2, 1]]
        bent, tip = stalk(random, random.uniform(0.28, 0.42))
        shapes += [
            bent.replace("spans:", f"center: {listed(foot)}, spans:"),
            petals("white", 17, foot + tip, random.uniform(-0.5, 0.5), 0.006, 0.027, 0.0085, 0.003),
            procedural("tessellated_sphere", "yellow", subdivisions=1, center=foot + tip, radius=0.008),
        ]
    return shapes


def cornflowers(random):
    shapes = []
    for _ in range(4):
        foot = np.append(random.uniform(-0.15, 0.15, 2), 0)[[0, 2, 1]]
        bent, tip = stalk(random, random.uniform(0.35, 0.5))
        lean = random.uniform(-0.4, 0.4)
        shapes += [
            bent.replace("spans:", f"center: {listed(foot)}, spans:"),
            petals("blue", 11, foot + tip, lean, 0.003, 0.026, 0.013, 0.011),
            petals("blue", 7, foot + tip, lean, 0.001, 0.014, 0.008, 0.012),
        ]
    return shapes


def seeds(random):
    """Tall grass with ears."""
    shapes = []
    for _ in range(6):
        foot = np.append(random.uniform(-0.25, 0.25, 2), 0)[[0, 2, 1]]
        bent, tip = stalk(random, random.uniform(0.5, 0.75))
        shapes.append(bent.replace("stalk", "dry").replace("spans:", f"center: {listed(foot)}, spans:"))
        ear = [[0, 0, 0], [0.004, 0.05, 0.002], [0.014, 0.11, 0.005]]
        shapes.append(tube("dry", ear, 0.006, 0.0015).replace("spans:", f"center: {listed(foot + tip)}, spans:"))
    return shapes


def twig(material, seed):
    """A bunch of leaves."""
    options = {"leaves": 26, "stem": 0.34, "length": 0.22, "width": 0.13, "spread": 90, "droop": 75, "segments": 2}
    return [procedural("plant", material, **options, seed=seed)]


class Ground:
    """Its height, by interpolation in the cells of its mesh."""

    def __init__(self):
        side = GROUND["cells"] + 1
        self.heights = terrain(**GROUND).vertices[:, 1].reshape(side, side)

    def __call__(self, x, z):
        place = (np.array([x - GROUND["center"][0], z - GROUND["center"][2]]) / GROUND["size"] + 0.5) * GROUND["cells"]
        column, row = place.astype(int)
        s, t = place - [column, row]
        near, far = (h[column] * (1 - s) + h[column + 1] * s for h in (self.heights[row], self.heights[row + 1]))
        return near * (1 - t) + far * t


def instance(group, linear, place):
    rows = np.column_stack([linear, place])
    matrix = ", ".join("[" + ", ".join(f"{round(float(value), 3):g}" for value in row) + "]" for row in rows)
    return f"{{instance: {{group: {group}, matrix: [{matrix}]}}}}"


def about_y(turn):
    return np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])


def about_x(turn):
    return np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])


def standing(random, ground, groups, x, z, size, lean):
    """An instance on the ground, turned at random, a little higher or lower than others and askew."""
    skew = np.eye(3) * [1, random.uniform(0.85, 1.2), 1]
    skew[[0, 2], 1] = random.uniform(-lean, lean, 2)
    linear = size * random.uniform(0.8, 1.2) * skew @ about_y(random.uniform(0, 2 * np.pi))
    return instance(random.choice(groups), linear, [x, ground(x, z), z])


def broadleaf(random, ground, name, level, height, x, z):
    """A tree: its wood, and a bunch of leaves at the ends of its last two generations of branches."""
    linear, foot = random.uniform(0.85, 1.2) * about_y(random.uniform(0, 2 * np.pi)), np.array([x, ground(x, z) - 0.1, z])
    shapes = [instance(name, linear, foot)]
    for end in tree(level, "joints", 6, height, (0.0, 0.0, 0.0)).centers[-(2**level + 2 ** (level - 1)) :]:
        turned = about_y(random.uniform(0, 2 * np.pi)) @ about_x(random.uniform(-1.2, 1.2)) @ about_y(random.uniform(0, 6))
        bunch = random.choice(["twig", "light_twig"], p=[0.7, 0.3])
        shapes.append(instance(bunch, random.uniform(1.1, 1.8) * turned, linear @ end + foot))
    return shapes


def scattered(random, ground, groups, count, near, far, size=1.0, angle=24.0, lean=0.12, clusters=None):
    """`count` instances between two distances in front of the camera, evenly over the ground, or about `clusters`."""
    shapes = []
    while len(shapes) < count:
        distance, direction = np.sqrt(random.uniform(near**2, far**2)), np.radians(random.uniform(-angle, angle))
        x, z = distance * np.sin(direction), -distance * np.cos(direction)
        if clusters is not None:
            x, z = clusters[random.integers(len(clusters))] + random.normal(0, 0.5, 2)
        if near < np.hypot(x, z) < far:
            shapes.append(standing(random, ground, groups, x, z, size, lean))
    return shapes


def main():
    random, ground = np.random.default_rng(8), Ground()
    groups = {
        "grass_a": grass(random, 8, 0.7, 0.3, 0.08),
        "grass_b": grass(random, 8, 0.7, 0.36, 0.18),
        "poppies": poppies(random),
        "daisies": daisies(random),
        "cornflowers": cornflowers(random),
        "ears": seeds(random),
        "oak": [procedural("tree", "bark", level=7, part="rods", sides=7, height=1.9)],
        "birch": [procedural("tree", "bark", level=6, part="rods", sides=7, height=2.3)],
        "twig": twig("leaf", 1),
        "light_twig": twig("bright", 2),
    }
    eye = np.array([0.0, ground(0.0, 0.0) + 1.05, 0.0])
    target = np.array([0.0, ground(0.0, 0.0) + 0.75, -5.0])
    lines = [HEAD.format(eye=listed(eye), target=listed(target)), "groups:\n"]
    for name, shapes in groups.items():
        lines += [f"  {name}:\n", *(f"    - {shape}\n" for shape in shapes)]
    turf = ["grass_a", "grass_b"]
    clusters = np.stack([random.uniform(-3.2, 3.2, 14), random.uniform(-9, -2.2, 14)], axis=1)
    woods = [("oak", 7, 1.9, x, z) for x, z in ((-7, -24), (9.5, -31), (-19, -38), (22, -44), (1, -58), (-12, -60))]
    woods += [("birch", 6, 2.3, x, z) for x, z in ((5.5, -27), (14, -36), (-11.5, -31), (-27, -52), (9, -55), (31, -60))]
    shapes = [
        procedural("terrain", "soil", **GROUND),
        *scattered(random, ground, turf, 230, 1.0, 8.0, angle=36),
        *scattered(random, ground, turf, 210, 7.0, 22.0, 1.8, angle=34),
        *scattered(random, ground, turf, 110, 20.0, 60.0, 3.6, angle=32),
        *scattered(random, ground, ["ears"], 60, 2.0, 14.0, angle=32),
        *scattered(random, ground, ["poppies"], 110, 1.6, 14.0, clusters=clusters[:5]),
        *scattered(random, ground, ["daisies"], 150, 1.4, 14.0, clusters=clusters[4:10]),
        *scattered(random, ground, ["cornflowers"], 80, 1.6, 14.0, clusters=clusters[9:]),
        *(shape for wood in woods for shape in broadleaf(random, ground, *wood)),
    ]
    lines += ["shapes:\n", *(f"  - {shape}\n" for shape in shapes)]
    lines += ["lights:\n", f"  - {{environment: {{image: textures/sky_large.exr, scale: 1.15, rotation: {TURN}}}}}\n"]
    FILE.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
