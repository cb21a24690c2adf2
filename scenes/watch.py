"""Makes watch.glb: python scenes/watch.py

A wrist watch on a leather strap, with the camera, the lamps and the backdrop of a product photograph. Metres; in the frame of
the dial +z points out of the glass and +y towards 12 o'clock. A part is (vertices, normals, faces).
"""

import io
import json
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

FILE = Path(__file__).with_suffix(".glb")
TILT = np.radians(-24.0)
"""Of the dial's frame about +x: the watch leans back on its strap."""
SIDE = 448
"""Texels along the sides of the dial and of the bezel."""


def grid(points, closed=False):
    """(vertices, normals, faces) of a surface through points (rows, columns, 3), whose normal is d/drow x d/dcolumn.

    `closed` columns: the first repeats the last.
    """
    rows, columns = points.shape[:2]
    down = np.gradient(points, axis=0)
    across = np.gradient(points, axis=1)
    if closed:
        across[:, [0, -1]] = (points[:, [1]] - points[:, [-2]]) / 2
    normals = np.cross(down, across)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    inner = np.where(length[[1, -2]] > 0, normals[[1, -2]], (0, 0, 1))  # at a pole, that of the next row
    normals[[0, -1]] = np.where(length[[0, -1]] > 1e-16, normals[[0, -1]], inner)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-30)
    at = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    kept = [len({tuple(np.round(points.reshape(-1, 3)[i], 9)) for i in face}) == 3 for face in faces]
    return points.reshape(-1, 3), normals.reshape(-1, 3), faces[kept]


def joined(*parts):
    starts = np.cumsum([0, *(len(part[0]) for part in parts)])
    faces = [part[2] + start for part, start in zip(parts, starts, strict=False)]
    return *(np.concatenate([part[i] for part in parts]) for i in (0, 1)), np.concatenate(faces)


def lathe(*runs, segments=96, teeth=0, depth=0.0):
    """Profiles (radius, z) turned about +z, each smooth; the outside is the front where z grows. `teeth` are cut into them."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    cut = depth * (0.5 + 0.5 * np.tanh(3 * np.cos(teeth * angle))) if teeth else 0 * angle
    parts = []
    for run in np.asarray(runs, dtype=object):
        r, z = np.array(run, float).T
        radius = r[:, None] - np.where(r[:, None] > 0, cut, 0)
        flat = [radius * np.cos(angle), radius * np.sin(angle), z[:, None] + 0 * angle]
        parts.append(grid(np.stack(flat, axis=-1)[:, ::-1], closed=True))
    return joined(*parts)


def prism(outline, low, high, bevel=0.0):
    """A flat body over a convex outline (n, 2), counter-clockwise, from z = low to high, its upper edge cut by `bevel`."""
    base = np.array(outline, float)
    inner = base - bevel * base / np.linalg.norm(base, axis=1, keepdims=True) if bevel else base
    layers = [(base, low), (base, high - bevel), (inner, high)]
    rings = [np.column_stack([flat, np.full(len(flat), z)]) for flat, z in layers]
    quads = [(a, b) for a, b in pairwise(rings) if np.abs(a - b).max() > 0]
    parts = []
    for a, b in quads:
        for i in range(len(base)):
            j = (i + 1) % len(base)
            corners = np.array([a[i], a[j], b[j], b[i]])
            parts.append(flat_face(corners))
    return joined(*parts, flat_face(rings[-1]))


def flat_face(corners):
    """A convex polygon (n, 3)."""
    corners = np.array(corners, float)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    fan = [[0, i, i + 1] for i in range(1, len(corners) - 1)]
    return corners, np.tile(normal / np.linalg.norm(normal), (len(corners), 1)), np.array(fan)


def moved(part, matrix, offset=(0, 0, 0)):
    return part[0] @ matrix.T + offset, part[1] @ matrix.T, part[2]


def turn(axis, angle):
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i], matrix[i, j] = np.sin(angle), -np.sin(angle)
    return matrix


def planar(part, radius):
    """Texture coordinates of an image that fills the square around a disk."""
    return np.column_stack([0.5 + part[0][:, 0] / (2 * radius), 0.5 - part[0][:, 1] / (2 * radius)])


def rounded(x):
    """Sine and cosine so that the circle becomes a box with round edges."""
    return np.sign(x) * np.abs(x) ** 0.3


def strap(steps=60, side=5):
    """Leather that goes around from the upper to the lower lugs; u goes across its outside, v along it."""
    angle = np.linspace(0.5, 2 * np.pi - 0.5, steps)  # 0 is +z, at the dial
    stretch = 1 + 0.1 * np.sin(angle / 2) ** 2
    centre = np.stack([0 * angle, 0.0335 * np.sin(angle) * stretch, 0.031 * np.cos(angle) - 0.0255], axis=-1)
    along = np.gradient(centre, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    out = np.cross(along, (1, 0, 0))
    out *= np.sign((out * (centre - centre.mean(0))).sum(1, keepdims=True))
    share = np.abs(np.linspace(-1, 1, steps))
    width = 0.0083 + 0.0014 * share**2
    thick = 0.0009 + 0.0009 * share**4
    turned = np.linspace(-0.5 * np.pi, 1.5 * np.pi, 4 * side + 1)
    across, height = -rounded(np.sin(turned)), rounded(np.cos(turned))
    points = centre[:, None] + np.array([1, 0, 0]) * (width[:, None] * across)[..., None]
    points = points + out[:, None] * (thick[:, None] * height)[..., None]
    part = grid(points, closed=True)
    middle = np.repeat(centre, len(turned), axis=0)
    if ((part[0] - middle) * part[1]).sum() < 0:
        part = part[0], -part[1], part[2][:, ::-1]
    u = np.broadcast_to(0.5 + 0.5 * across, points.shape[:2])
    v = np.broadcast_to(np.linspace(0, 1, steps)[:, None], points.shape[:2])
    return part, np.stack([u, v], axis=-1).reshape(-1, 2)


# ---- textures, sRGB


def dial():
    """A blue sunburst with a track of minutes."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] / (SIDE - 1) * 2 - 1
    r, angle = np.hypot(x, y), np.arctan2(x, -y)
    shine = 0.5 + 0.3 * np.cos(2 * (angle - 0.7)) + 0.05 * np.cos(41 * angle) * np.cos(17 * angle)
    shade = (1.15 - 0.75 * r**1.5)[..., None] * (0.55 + 0.8 * shine)[..., None]
    image = Image.fromarray(np.uint8(np.clip(shade * (24, 62, 118), 0, 255)))
    draw, c = ImageDraw.Draw(image), SIDE / 2
    for minute in range(60):
        s, t = np.sin(minute * np.pi / 30), -np.cos(minute * np.pi / 30)
        inner = 0.9 if minute % 5 else 0.88
        ends = [c + c * inner * s, c + c * inner * t, c + c * 0.95 * s, c + c * 0.95 * t]
        draw.line(ends, (225, 228, 230), 2 if minute % 5 else 4)
    draw.text((c, 0.66 * c), "raybench", (232, 234, 236), ImageFont.load_default(31), "mm")
    draw.text((c, 1.44 * c), "200 m", (200, 205, 210), ImageFont.load_default(19), "mm")
    return image


def bezel():
    """A ring of black ceramics with marks of minutes, of radius .92 outside."""
    image = Image.new("RGB", (SIDE, SIDE), (9, 10, 13))
    draw, c, white = ImageDraw.Draw(image), SIDE / 2, (214, 216, 212)
    for minute in range(60):
        s, t = np.sin(minute * np.pi / 30), -np.cos(minute * np.pi / 30)
        if minute == 0:
            tip, left, right = [
                (c + c * r * np.sin(a), c - c * r * np.cos(a)) for r, a in ((0.85, 0), (0.955, -0.075), (0.955, 0.075))
            ]
            draw.polygon([tip, left, right], white)
        elif minute % 10 == 0:
            text = Image.new("L", (40, 30))
            ImageDraw.Draw(text).text((20, 15), str(minute), 255, ImageFont.load_default(24), "mm")
            text = text.rotate(-6 * minute, expand=True, resample=Image.Resampling.BICUBIC)
            place = (round(c + c * 0.9 * s - text.width / 2), round(c + c * 0.9 * t - text.height / 2))
            image.paste(Image.new("RGB", text.size, white), place, text)
        elif minute % 5 == 0 or minute < 15:
            inner = 0.86 if minute % 5 == 0 else 0.9
            draw.line(
                [c + c * inner * s, c + c * inner * t, c + c * 0.945 * s, c + c * 0.945 * t], white, 5 if minute % 5 == 0 else 3
            )
    return image


def leather():
    """Brown grain with a seam at both sides."""
    h, w, random = 768, 96, np.random.default_rng(4)
    spots = random.uniform(-1, 1, (h // 3, w // 3))
    grain = np.asarray(Image.fromarray(np.float32(spots)).resize((w, h), Image.Resampling.BICUBIC))
    u = np.arange(w)[None] / (w - 1)
    edge = np.clip(12 * np.minimum(u, 1 - u), 0.45, 1)
    color = (1 + 0.16 * grain)[..., None] * edge[..., None] * (112, 62, 30)
    image = Image.fromarray(np.uint8(np.clip(color, 0, 255)))
    draw = ImageDraw.Draw(image)
    for y in range(0, h, 12):
        for x in (12, w - 13):
            draw.line([x, y, x, y + 7], (226, 206, 170), 3)
    return image


# ---- the file


class Glb:
    """JSON and the bytes of its buffer."""

    def __init__(self):
        self.data, self.tree = b"", {"asset": {"version": "2.0", "generator": "raybench scenes/watch.py"}, "scene": 0}
        self.tree["extensionsUsed"] = []

    def add(self, kind, **item):
        self.tree.setdefault(kind, []).append(item)
        return len(self.tree[kind]) - 1

    def view(self, data):
        self.data += b"\0" * (-len(self.data) % 4)
        at = self.add("bufferViews", buffer=0, byteOffset=len(self.data), byteLength=len(data))
        self.data += data
        return at

    def accessor(self, rows, dtype="f4", bounds=False):
        rows = np.array(rows, f"<{dtype}")
        keys = {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()} if bounds else {}
        kind = "SCALAR" if rows.ndim == 1 else f"VEC{rows.shape[1]}"
        code = {"f4": 5126, "u2": 5123}[dtype]
        return self.add(
            "accessors", bufferView=self.view(rows.tobytes()), componentType=code, count=len(rows), type=kind, **keys
        )

    def texture(self, image):
        buffer = io.BytesIO()
        image.save(buffer, "JPEG", quality=88, subsampling=0, optimize=True)
        source = self.add("images", bufferView=self.view(buffer.getvalue()), mimeType="image/jpeg")
        return {"index": self.add("textures", source=source)}

    def material(self, name, color, metallic=0.0, roughness=0.5, texture=None, emission=None, **extensions):
        pbr = {"baseColorFactor": [*color, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
        keys = {"extensions": {f"KHR_materials_{key}": value for key, value in extensions.items()}} if extensions else {}
        if texture:
            pbr["baseColorTexture"] = texture
        if emission:
            keys["emissiveFactor"] = emission
        self.tree["extensionsUsed"] = sorted({*self.tree["extensionsUsed"], *keys.get("extensions", ())})
        return self.add("materials", name=name, pbrMetallicRoughness=pbr, **keys)

    def mesh(self, *primitives):
        """The index of a mesh of (part, material) or (part, material, uvs)."""
        made = []
        for (vertices, normals, faces), material, *uvs in primitives:
            attributes = {"POSITION": self.accessor(vertices, bounds=True), "NORMAL": self.accessor(normals)}
            if uvs:
                attributes["TEXCOORD_0"] = self.accessor(uvs[0])
            made.append({"attributes": attributes, "indices": self.accessor(faces.ravel(), "u2"), "material": material})
        return self.add("meshes", primitives=made)

    def bytes(self):
        text = json.dumps({**self.tree, "buffers": [{"byteLength": len(self.data)}]}, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        binary = self.data + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def quaternion(matrix):
    """x, y, z, w of a rotation (3, 3)."""
    m = matrix
    squares = np.array([m[0, 0], m[1, 1], m[2, 2]]) * 2 - np.trace(m)
    sizes = np.sqrt(np.maximum(1 + np.append(squares, np.trace(m)), 0)) / 2
    signs = np.sign([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    return [*(sizes[:3] * np.where(signs == 0, 1, signs)).tolist(), float(sizes[3])]


def looking(eye, target):
    """A node's rotation that looks along -z from eye to target."""
    z = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    x = np.cross((0, 1, 0), z) / np.linalg.norm(np.cross((0, 1, 0), z))
    return quaternion(np.column_stack([x, np.cross(z, x), z]))


def softbox(center, target, width, height):
    """A square that faces the target."""
    z = np.subtract(target, center) / np.linalg.norm(np.subtract(target, center))
    x = np.cross((0, 1, 0), z) / np.linalg.norm(np.cross((0, 1, 0), z))
    y = np.cross(z, x)
    return flat_face([np.add(center, i * width / 2 * x + j * height / 2 * y) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def materials(file):
    """Indices of the materials by name."""
    coat = {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.05}
    made = {
        "steel": file.material("steel", (0.72, 0.71, 0.69), 1.0, 0.24),
        "brushed": file.material("brushed steel", (0.66, 0.65, 0.63), 1.0, 0.34),
        "ceramic": file.material("ceramic", (1, 1, 1), 0.0, 0.4, file.texture(bezel()), clearcoat=coat),
        "dial": file.material("dial", (1, 1, 1), 0.35, 0.35, file.texture(dial())),
        "lume": file.material("lume", (0.85, 0.87, 0.78), 0.0, 0.6),
        "hands": file.material("hands", (0.9, 0.89, 0.87), 1.0, 0.2),
        "red": file.material("seconds", (0.85, 0.16, 0.03), 0.0, 0.35, clearcoat=coat),
        "crystal": file.material("crystal", (1, 1, 1), 0.0, 0.0, transmission={"transmissionFactor": 1.0}, ior={"ior": 1.3}),
        "leather": file.material("leather", (1, 1, 1), 0.0, 0.55, file.texture(leather())),
        "backdrop": file.material("backdrop", (0.2, 0.215, 0.235), 0.0, 0.5),
    }
    for name, color, strength in (("key", [1, 0.97, 0.92], 8.5), ("rim", [0.82, 0.91, 1], 9.0), ("top", [1, 1, 1], 3.0)):
        made[name] = file.material(f"{name} light", (0, 0, 0), emission=color, emissive_strength={"emissiveStrength": strength})
    return made


def case():
    """Parts of polished steel, and those of brushed steel."""
    back = lathe(
        [(0, -0.0048), (0.0165, -0.0048)],
        [(0.0165, -0.0048), (0.018, -0.0046), (0.0188, -0.0038), (0.0192, -0.0026), (0.0194, -0.001), (0.0194, 0.0012)],
    )
    rehaut = lathe([(0.01655, 0.0042), (0.0164, 0.0041), (0.0158, 0.0019)], segments=72)
    rim = [(0.0194, 0.0012), (0.0204, 0.0013), (0.0207, 0.0017), (0.0207, 0.0027), (0.0202, 0.0034), (0.0197, 0.0036)]
    grip = lathe(rim, segments=180, teeth=60, depth=0.0004)
    crown = lathe(
        [(0.0008, 0), (0.0015, 0.0001)],
        [(0.0015, 0.0001), (0.0015, 0.0012)],
        [(0.0028, 0.0012), (0.003, 0.0015), (0.003, 0.0036), (0.0027, 0.004)],
        [(0.0027, 0.004), (0.0014, 0.0043), (0, 0.0044)],
        teeth=24,
        depth=0.0002,
    )
    crown = moved(crown, turn(1, np.pi / 2), (0.0188, 0, -0.0008))
    lug = prism(kite(0.0016, -0.005, 0.0013, 0.0052), -0.0018, 0.002, 0.0006)
    turns = {s: turn(0, s * -0.55) @ turn(2, (s < 0) * np.pi) for s in (1, -1)}
    lugs = [moved(lug, turns[s], (x, s * 0.0195, -0.0017)) for s in (1, -1) for x in (-0.0115, 0.0115)]
    return joined(back, rehaut, grip, crown), joined(*lugs)


def kite(low, bottom, high, top, tip=None):
    """A trapezium of half widths `low` and `high`, with a tip or without."""
    return [(-low, bottom), (low, bottom), (high, top), *([] if tip is None else [(0, tip)]), (-high, top)]


def marks(file, made):
    """Nodes of the twelve indices of the dial."""
    mark = (prism(kite(0.0007, -0.0017, 0.0007, 0.0017), 0, 0.0004, 0.0001), made["hands"])
    glow = (prism(kite(0.00045, -0.0014, 0.00045, 0.0014), 0.0004, 0.00045), made["lume"])
    twelve = (prism([(0, -0.002), (0.0017, 0.0015), (-0.0017, 0.0015)], 0, 0.0004, 0.0001), made["hands"])
    glow12 = (prism([(0, -0.0015), (0.0012, 0.0012), (-0.0012, 0.0012)], 0.0004, 0.00045), made["lume"])
    shapes = [file.mesh(twelve, glow12)] + [file.mesh(mark, glow)] * 11
    for each, shape in enumerate(shapes):
        matrix = turn(2, -each * np.pi / 6)
        place = (matrix @ (0, 0.0118, 0.0019)).tolist()
        yield file.add("nodes", mesh=shape, rotation=quaternion(matrix), translation=place)


def hands(file, made):
    """Nodes of the hands, which show 10:09:34."""
    hour = prism(kite(0.0006, -0.0022, 0.0011, 0.0064, 0.0088), 0, 0.00025)
    hour_glow = prism(kite(0.00035, 0.0015, 0.0007, 0.0062), 0.00025, 0.0003)
    minute = prism(kite(0.0005, -0.0025, 0.0009, 0.011, 0.0135), 0.0004, 0.00065)
    minute_glow = prism(kite(0.0003, 0.0015, 0.00055, 0.0108), 0.00065, 0.0007)
    second = prism(kite(0.00013, -0.0045, 0.00008, 0.0142), 0.0009, 0.00105)
    cap = lathe([(0.0009, 0.0009), (0.0009, 0.0012)], [(0.0009, 0.0012), (0, 0.0012)], segments=32)
    parts = [
        ((10 + 9.6 / 60) / 12, [(hour, made["hands"]), (hour_glow, made["lume"])]),
        (9.6 / 60, [(minute, made["hands"]), (minute_glow, made["lume"])]),
        (34 / 60, [(joined(second, cap), made["red"])]),
    ]
    for share, shapes in parts:
        rotation = quaternion(turn(2, -2 * np.pi * share))
        yield file.add("nodes", mesh=file.mesh(*shapes), rotation=rotation, translation=[0, 0, 0.0022])


def watch(file, made):
    """The node of the watch, which stands on y = 0."""
    polished, lugs = case()
    ring = lathe([(0.0197, 0.0036), (0.0191, 0.0039), (0.0172, 0.0043), (0.01655, 0.0043), (0.01655, 0.0042)])
    plate = lathe([(0.0161, 0.0019), (0, 0.0019)], segments=72)
    glass = lathe([(0.01655, 0.0041), (0, 0.0041)], segments=72)
    band, band_uvs = strap()
    body = {
        "case": [(polished, made["steel"]), (lugs, made["brushed"])],
        "bezel": [(ring, made["ceramic"], planar(ring, 0.0207))],
        "dial": [(plate, made["dial"], planar(plate, 0.0164))],
        "crystal": [(glass, made["crystal"])],
        "strap": [(band, made["leather"], band_uvs)],
    }
    nodes = [file.add("nodes", name=name, mesh=file.mesh(*parts)) for name, parts in body.items()]
    pose = turn(1, np.radians(-14)) @ turn(0, TILT)
    lowest = min(float((pose @ part[0].T)[1].min()) for part in (band, polished, lugs))
    nodes += [*marks(file, made), *hands(file, made)]
    return file.add("nodes", name="watch", children=nodes, rotation=quaternion(pose), translation=[0, -lowest, 0])


def make():
    file = Glb()
    made = materials(file)
    bend = np.linspace(0, np.pi / 2, 13)
    curve = [(0.5, 0.0), *((-0.16 - 0.12 * np.sin(a), 0.12 - 0.12 * np.cos(a)) for a in bend), (-0.28, 0.6)]
    sweep = np.array([[(x, y, z) for x in (-0.7, 0.7)] for z, y in curve])
    studio = {
        "backdrop": (grid(sweep[::-1]), made["backdrop"]),
        "key light": (softbox((-0.27, 0.17, 0.0), (0, 0.03, 0), 0.26, 0.24), made["key"]),
        "rim light": (softbox((0.24, 0.1, -0.03), (0, 0.03, 0), 0.05, 0.24), made["rim"]),
        "top light": (softbox((0, 0.3, -0.06), (0.001, 0.03, 0), 0.3, 0.16), made["top"]),
    }
    scene = [watch(file, made), *(file.add("nodes", name=name, mesh=file.mesh(part)) for name, part in studio.items())]
    cone = {"innerConeAngle": 0.1, "outerConeAngle": 0.3}
    lamp = {"name": "spot", "type": "spot", "intensity": 0.02, "color": [1, 0.9, 0.75], "spot": cone}
    file.tree["extensions"] = {"KHR_lights_punctual": {"lights": [lamp]}}
    file.tree["extensionsUsed"].append("KHR_lights_punctual")
    spot, eye, target = (-0.1, 0.3, -0.1), (0.02, 0.075, 0.205), (0.007, 0.0325, -0.004)
    shown = {"KHR_lights_punctual": {"light": 0}}
    scene.append(file.add("nodes", name="spot", rotation=looking(spot, (0, 0.03, 0)), translation=spot, extensions=shown))
    lens = file.add("cameras", type="perspective", perspective={"yfov": 0.385, "aspectRatio": 16 / 9, "znear": 0.01})
    scene.append(file.add("nodes", name="camera", camera=lens, rotation=looking(eye, target), translation=eye))
    file.add("scenes", nodes=scene)
    FILE.write_bytes(file.bytes())


if __name__ == "__main__":
    make()
