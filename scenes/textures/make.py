"""Draws the textures of the shipped scenes: python scenes/textures/make.py [NAME ...]

Each function returns sRGB values (h, w), (h, w, 3) or (h, w, 4) in [0, 1], or linear ones in `LINEAR`; all of them repeat at
their edges, but for book spines, leaves and paintings. Seeds are fixed.
"""

import sys
from pathlib import Path

import numpy as np

from engines.image import write_image

HERE = Path(__file__).resolve().parent


def noise(h, w, rows, columns, seed, octaves=4, fade=0.5):
    """(h, w) smooth noise in about [-1, 1] that repeats: `rows` x `columns` bumps, each octave twice as fine."""
    random, total = np.random.default_rng(seed), np.zeros((h, w))
    for octave in range(octaves):
        r, c = rows << octave, columns << octave
        grid = random.uniform(-1, 1, (r, c))
        y, x = (np.arange(h) + 0.5) * r / h, (np.arange(w) + 0.5) * c / w
        y0, x0 = y.astype(int), x.astype(int)
        t, s = (smooth(y - y0)[:, None], smooth(x - x0)[None])
        corner = [[grid[np.ix_((y0 + i) % r, (x0 + j) % c)] for j in (0, 1)] for i in (0, 1)]
        total += fade**octave * (
            (corner[0][0] * (1 - s) + corner[0][1] * s) * (1 - t) + (corner[1][0] * (1 - s) + corner[1][1] * s) * t
        )
    return total


def smooth(t):
    return t * t * (3 - 2 * t)


def mixed(a, b, share):
    """Colours from a to b, (h, w, 3)."""
    share = np.clip(share, 0, 1)[..., None]
    return np.array(a) * (1 - share) + np.array(b) * share


def places(h, w):
    """v and u of the texels."""
    return np.meshgrid((np.arange(h) + 0.5) / h, (np.arange(w) + 0.5) / w, indexing="ij")


def grain(h, w, seed):
    """(h, w) rings of wood in [0, 1], along u."""
    v, _ = places(h, w)
    bend = noise(h, w, 2, 1, seed, 3)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (9 * v + 1.1 * bend))
    fibres = noise(h, w, 64, 4, seed + 1, 2)
    return np.clip(0.62 * rings**1.6 + 0.18 + 0.22 * fibres, 0, 1)


def wood():
    return mixed((0.72, 0.52, 0.33), (0.43, 0.27, 0.15), grain(512, 512, 1))


def walnut():
    return mixed((0.42, 0.27, 0.18), (0.2, 0.12, 0.08), grain(512, 512, 7))


def planks():
    """Eight rows of boards, two to a row."""
    h = w = 512
    rows = 8
    v, u = places(h, w)
    row = (v * rows).astype(int)
    random = np.random.default_rng(3)
    shift = random.uniform(0, 1, rows)[row]
    board = ((u + shift) * 2).astype(int) % 2
    tone = random.uniform(0, 1, (rows, 2))[row, board]
    lines = noise(h, w, 48, 3, 5, 3)
    rings = 0.5 + 0.5 * np.sin(2 * np.pi * (v * rows * 2.3 + 3 * tone + 0.9 * noise(h, w, 8, 2, 6, 2)))
    color = mixed((0.74, 0.56, 0.37), (0.5, 0.33, 0.19), 0.3 * rings + 0.55 * tone + 0.16 * lines + 0.06)
    return color * np.where(_joints(u, v, row, shift), 0.45, 1)[..., None]


def _joints(u, v, row, shift):
    return (np.abs(v * 8 - np.rint(v * 8)) < 0.018) | (np.abs((u + shift) * 2 - np.rint((u + shift) * 2)) < 0.004)


def weave():
    """Linen: 32 x 32 threads over and under each other."""
    v, u = places(256, 256)
    x, y = u * 32, v * 32
    over = (x.astype(int) + y.astype(int)) % 2
    thread = np.where(over, np.sin(np.pi * (y % 1)) * (0.7 + 0.3 * np.sin(np.pi * (x % 1))),
                      np.sin(np.pi * (x % 1)) * (0.7 + 0.3 * np.sin(np.pi * (y % 1))))  # fmt: skip
    return np.clip(0.42 + 0.42 * thread + 0.07 * noise(256, 256, 32, 32, 11, 2), 0, 1)


def marble():
    h = w = 512
    v, u = places(h, w)
    bent = noise(h, w, 3, 3, 21, 5)
    veins = np.abs(np.sin(np.pi * (2 * u + 2 * v + 1.1 * bent)))
    fine = np.abs(np.sin(np.pi * (3 * v - 4 * u + 1.7 * noise(h, w, 4, 4, 22, 5))))
    dark = np.exp(-veins * 16) * 0.75 + np.exp(-fine * 24) * 0.3 + 0.12 * np.abs(bent)
    return mixed((0.93, 0.92, 0.9), (0.36, 0.36, 0.4), dark)


def rug():
    """A carpet of diamonds in a border."""
    h, w = 512, 512
    v, u = places(h, w)
    x, y = np.abs(2 * u - 1), np.abs(2 * v - 1)
    edge = np.maximum(x, y)
    cells = (np.abs((8 * u) % 2 - 1) + np.abs((8 * v) % 2 - 1)) * 3
    inside = mixed((0.55, 0.12, 0.1), (0.86, 0.77, 0.6), smooth(np.clip(8 * (np.abs(cells % 2 - 1) - 0.5) + 0.5, 0, 1)))
    heart = (np.abs((8 * u) % 2 - 1) + np.abs((8 * v) % 2 - 1)) < 0.45
    inside[heart] = (0.12, 0.2, 0.32)
    frame = mixed((0.12, 0.17, 0.28), (0.8, 0.66, 0.42), ((24 * (u + v)) % 1 < 0.45) & (edge < 0.92))
    color = np.where((edge > 0.8)[..., None], frame, inside)
    color[np.abs(edge - 0.8) < 0.012] = color[np.abs(edge - 0.965) < 0.01] = (0.87, 0.79, 0.62)
    pile = 1 + 0.09 * noise(h, w, 64, 64, 31, 2)
    return np.clip(color * pile[..., None], 0, 1)


def stripes():
    """Cushion cloth."""
    v, u = places(256, 256)
    bands = [((0.0, 0.12), (0.16, 0.28, 0.36)), ((0.2, 0.23), (0.77, 0.52, 0.2)), ((0.3, 0.33), (0.16, 0.28, 0.36)),
             ((0.45, 0.55), (0.77, 0.52, 0.2)), ((0.67, 0.7), (0.16, 0.28, 0.36)), ((0.77, 0.8), (0.77, 0.52, 0.2)),
             ((0.88, 1.0), (0.16, 0.28, 0.36))]  # fmt: skip
    color = np.full((256, 256, 3), (0.9, 0.86, 0.78))
    for (low, high), band in bands:
        color[(u >= low) & (u < high)] = band
    return color * (1 - 0.1 * (((u * 64) % 1 < 0.3) | ((v * 64) % 1 < 0.3)))[..., None]


def spines():
    """Sixteen spines of books side by side; the top of each is plain."""
    h, w, count = 256, 512, 16
    random = np.random.default_rng(41)
    color = np.zeros((h, w, 3))
    cloth = [(0.5, 0.13, 0.1), (0.12, 0.24, 0.33), (0.83, 0.76, 0.6), (0.18, 0.3, 0.2), (0.73, 0.47, 0.16),
             (0.16, 0.15, 0.17), (0.62, 0.6, 0.56), (0.36, 0.17, 0.27), (0.22, 0.4, 0.46), (0.9, 0.87, 0.8)]  # fmt: skip
    wide = w // count
    for k in range(count):
        base, part = np.array(cloth[k % len(cloth)]), np.zeros((h, wide, 3))
        part[:] = base
        ink = np.array((0.86, 0.72, 0.36)) if base.mean() < 0.45 else np.array((0.2, 0.16, 0.14))
        for at in random.uniform(0.08, 0.2, 2):
            part[int(at * h) : int(at * h) + 3] = part[int((1 - at) * h) : int((1 - at) * h) + 3] = ink
        if k % 3 == 1:
            part[int(0.3 * h) : int(0.62 * h), 4:-4] = 0.75 * ink + 0.25 * base
            ink = base
        for row in range(int(0.34 * h), int(0.58 * h), 2):  # letters that run down the spine
            for left, right in ((9, 15), (18, 23)):
                if random.random() < 0.62:
                    part[row : row + 1, left : right - random.integers(0, 3)] = ink
        color[:, k * wide : (k + 1) * wide] = part
    return color


def leaf():
    """RGBA: a leaf with veins, its tip at the top; alpha cuts its edge and some slits."""
    h, w = 512, 256
    v, u = places(h, w)
    x, t = np.abs(2 * u - 1), 1 - v
    half = np.sin(np.pi * t**0.75) ** 0.8 * 0.93
    slant = 9 * (t - 0.42 * x)
    vein = np.minimum(np.abs(slant - np.rint(slant)) * 9, x * 22)
    color = mixed((0.42, 0.6, 0.26), (0.11, 0.33, 0.1), smooth(np.clip(vein, 0, 1)) * (0.85 + 0.15 * noise(h, w, 6, 3, 51)))
    slit = (np.abs(slant - np.rint(slant) - 0.5 * np.sign(slant - np.rint(slant))) < 0.12) & (x > 0.3 * half + 0.2) & (t > 0.12)
    alpha = (x < half + 0.012 * np.sin(60 * t)) & ~(slit & (t < 0.8))
    return np.concatenate([color, alpha[..., None].astype(float)], axis=2)


def tiles():
    """Height of 4 x 4 tiles with rounded edges and grout between them."""
    v, u = places(256, 256)
    x, y = np.abs((4 * u) % 1 - 0.5), np.abs((4 * v) % 1 - 0.5)
    edge = 0.47 - np.maximum(x, y)
    return np.clip(edge / 0.05, 0, 1) ** 0.5 * 0.9 + 0.05


def tile_color():
    """Colours of the same tiles."""
    v, u = places(256, 256)
    x, y = np.abs((4 * u) % 1 - 0.5), np.abs((4 * v) % 1 - 0.5)
    tone = np.random.default_rng(61).uniform(0, 1, (4, 4))[(4 * v).astype(int), (4 * u).astype(int)]
    color = mixed((0.28, 0.56, 0.58), (0.16, 0.42, 0.48), tone)
    color[np.maximum(x, y) > 0.475] = (0.82, 0.8, 0.76)
    return color


def holes():
    """Opacity of a sheet with 8 x 8 round holes in staggered rows."""
    v, u = places(256, 256)
    row = (8 * v).astype(int)
    away = np.hypot((8 * u + 0.5 * (row % 2)) % 1 - 0.5, (8 * v) % 1 - 0.5)
    return np.clip((away - 0.25) * 16 + 0.5, 0, 1)


def page():
    """Lines of print on paper, two columns of an open book."""
    h, w = 256, 384
    color = np.full((h, w), 0.93)
    random = np.random.default_rng(111)
    for row in range(22, 236, 7):
        for left in (22, 214):
            x, end = left, left + (148 if random.random() < 0.85 else 70)
            while x < end - 6:
                word = min(int(random.integers(4, 20)), end - x)
                color[row : row + 3, x : x + word] = 0.35 + 0.1 * random.random((3, word))
                x += word + 4
    _, u = places(h, w)
    return color * (1 - 0.3 * np.exp(-((u - 0.5) ** 2) * 2500))


def dents():
    """Normals of hammered metal or thick glass: 2 c - 1, z up."""
    height = noise(256, 256, 12, 12, 71, 1)
    slopes = [0.5 * (np.roll(height, -1, axis) - np.roll(height, 1, axis)) * 256 / 12 * 0.35 for axis in (1, 0)]
    normal = np.stack([-slopes[0], -slopes[1], np.ones_like(height)], axis=2)
    return 0.5 + 0.5 * normal / np.linalg.norm(normal, axis=2, keepdims=True)


def peel():
    """Height of small pores: the skin of an orange, leather, plaster."""
    return np.clip(0.5 + 0.35 * noise(256, 256, 28, 28, 81, 2), 0, 1)


def painting():
    """Hills under a low sun."""
    h, w = 384, 512
    v, u = places(h, w)
    color = mixed((0.96, 0.73, 0.42), (0.3, 0.45, 0.62), 1.25 * (0.7 - v) + 0.1 * noise(h, w, 6, 4, 91))
    sun = np.hypot((u - 0.66) * w / h, v - 0.4)
    color = color + (np.array((1.0, 0.93, 0.7)) - color) * np.clip((0.075 - sun) * 40, 0, 1)[..., None]
    hills = [((0.5, 0.5, 0.58), 0.55, 4, 0.09), ((0.4, 0.42, 0.36), 0.66, 3, 0.11), ((0.2, 0.3, 0.24), 0.8, 2, 0.12)]
    for place, (hue, level, bumps, size) in enumerate(hills):
        line = level + size * noise(1, w, 1, bumps, 95 + place, 4)[0]
        color[v > line[None]] = hue
    return np.clip(color * (1 + 0.09 * noise(h, w, 48, 24, 92, 2))[..., None], 0, 1)


def sky():
    """An afternoon: linear radiance of 64 x 128 cells, +y up, with a bright haze around the sun, but not the sun."""
    v, _ = places(64, 128)
    up = np.cos(np.pi * v)
    blue = mixed((1.35, 1.3, 1.2), (0.32, 0.55, 1.05), np.clip(up, 0, 1) ** 0.55)
    clouds = np.clip(1.6 * noise(64, 128, 6, 6, 101, 4) + 0.1, 0, 1) * np.clip(3 * up, 0, 1)
    color = blue + (np.array((1.5, 1.5, 1.5)) - blue) * (0.75 * clouds)[..., None]
    ground = mixed((0.3, 0.32, 0.24), (0.22, 0.24, 0.18), -up)
    return np.where((up > 0)[..., None], color, ground)


def sky_large():
    """A day with a sun: linear radiance of 1024 x 2048 cells as half floats, +y up. Clouds lie in a flat layer and fade into
    the haze of the horizon. The sun, 35 degrees high at u = 0.3, gives level ground about as much light as the sky does.
    """
    h, w = 1024, 2048
    v, u = places(h, w)
    up, level = np.cos(np.pi * v), np.sin(np.pi * v)
    along, across = level * np.cos(2 * np.pi * u), level * np.sin(2 * np.pi * u)
    high, turn = np.radians(35), 2 * np.pi * 0.3
    towards = np.sin(high) * up + np.cos(high) * (np.cos(turn) * along + np.sin(turn) * across)
    layer = np.maximum(up, 0) + 0.12
    clouds = taken(noise(1024, 1024, 6, 6, 126, 6, 0.55), 0.2 * across / layer, 0.15 * along / layer)
    share = smooth(np.clip(1.5 * clouds - 0.05, 0, 1)) * smooth(np.clip(5 * up, 0, 1))
    blue = mixed((1.15, 1.2, 1.25), (0.16, 0.34, 0.85), np.clip(up, 0, 1) ** 0.5)
    glow = np.exp(-(1 - towards) * 40)
    color = blue + (np.array((1.75, 1.7, 1.62)) - 0.35 * share[..., None] - blue) * (0.9 * share)[..., None]
    color = color + glow[..., None] * np.array((1.3, 1.1, 0.8))
    angle = np.degrees(np.arccos(np.clip(towards, -1, 1)))
    color = color + np.clip((0.85 - angle) / 0.2 + 0.5, 0, 1)[..., None] * np.array((5400.0, 4700.0, 3700.0))
    ground = mixed((0.62, 0.62, 0.56), (0.2, 0.22, 0.14), np.clip(-up, 0, 1) ** 0.4)
    return rounded(np.where((up > 0)[..., None], color, ground), 7)


def taken(image, v, u):
    """Values of an image (h, w) that repeats, at v and u, interpolated."""
    h, w = image.shape
    y, x = v * h - 0.5, u * w - 0.5
    y0, x0 = np.floor(y).astype(int), np.floor(x).astype(int)
    corner = [[image[(y0 + i) % h, (x0 + j) % w] for j in (0, 1)] for i in (0, 1)]
    t, s = y - y0, x - x0
    return (corner[0][0] * (1 - s) + corner[0][1] * s) * (1 - t) + (corner[1][0] * (1 - s) + corner[1][1] * s) * t


def rounded(values, bits):
    """Half floats of so many significant bits, which a file compresses well."""
    share, power = np.frexp(values)
    return np.ldexp(np.rint(share * 2**bits), power - bits).astype(np.float16)


TEXTURES = {
    make.__name__: make
    for make in (
        wood,
        walnut,
        planks,
        weave,
        marble,
        rug,
        stripes,
        spines,
        leaf,
        tiles,
        tile_color,
        holes,
        page,
        dents,
        peel,
        painting,
        sky,
        sky_large,
    )
}
LINEAR = {"sky", "sky_large"}


def main(names):
    for name in names or TEXTURES:
        values = TEXTURES[name]()
        if name in LINEAR:
            write_image(HERE / f"{name}.exr", values if values.dtype == np.float16 else values.astype(np.float32))
        else:
            from PIL import Image

            Image.fromarray(np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)).save(HERE / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
