"""Materials of a glTF file: metallic-roughness and its extensions as Disney's BSDF, with notes on what that does not show."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from engines.scene.bsdf import Blend, Bsdf, Mask, NormalMap
from engines.scene.context import SceneReader
from engines.scene.frames import LARGEST, nearest_orthogonal
from engines.scene.gltf.document import (
    Document,
    boolean,
    child,
    extension,
    mapping,
    name_of,
    number,
    numbers,
    optional,
    required,
)
from engines.scene.gltf.textures import Change, Pixels, Textures, placing
from engines.scene.materials import Material
from engines.scene.models import IORS, LEAST_CONTRAST, Diffuse, Principled, ThinDielectric
from engines.scene.notes import Notes
from engines.scene.textures import Color, ImageTexture, MeshAttribute, Number, Texture, tinted
from engines.scene.triple import BLACK, WHITE, Triple, product, triple
from engines.schema import fields
from engines.schema.yaml_file import Located

VERTEX_COLOR, VERTEX_ALPHA = "vertex_color", "vertex_alpha"
"""The attributes of meshes that have COLOR_0: its colour times the base colour, and its alpha."""
MODES = ("OPAQUE", "MASK", "BLEND")
SMOOTH = 0.05
"""Roughness up to which a pane is taken as smooth without a note."""
STEEPEST = 100.0
"""Largest scale of a normal map: its normals lie along the surface."""
LUMINANCE = (0.212671, 0.715160, 0.072169)


@dataclass(slots=True)
class Materials:
    """The materials of a file that meshes have."""

    document: Document
    reader: SceneReader
    notes: Notes
    textures: Textures
    looks: dict[tuple[Any, ...], Look] = field(default_factory=dict)

    def look(self, primitive: Located, colored: bool, mirrored: bool) -> Look:
        """The material of a primitive that has vertex colours, or has not, for faces whose texture coordinates are mirrored, or
        are not."""
        named = optional(primitive, "material")
        default = child(self.document.root, {}, "materials", "default")
        node = default if named is None else self.document.item("materials", named)
        key = (node.path, colored, mirrored)
        if key not in self.looks:
            look = Look(node, name_of(node, "material"), self.textures, self.notes, colored, mirrored)
            look.index = self.reader.table.add_named(look.material())
            self.looks[key] = look
        return self.looks[key]


@dataclass(slots=True)
class Look:
    """A material as faces show it. `uv_set` is the set of texture coordinates of its first texture, `tint` the factor of vertex
    colours, `tilted` says whether it has a normal map, and `index` is that of the table."""

    node: Located
    name: str
    textures: Textures
    notes: Notes
    colored: bool
    mirrored: bool
    uv_set: int | None = None
    tint: Triple = WHITE
    tilted: bool = False
    index: int = 0

    def material(self) -> Material:
        """The material. Raises `SceneError`."""
        pbr = self._part(optional(self.node, "pbrMetallicRoughness"))
        base, opacity = self._base(pbr)
        if extension(self.node, "KHR_materials_unlit") is not None:
            self._note("it is unlit: it emits its base colour, and so lights what is around it")
            black = None if opacity == 1.0 else Mask(opacity, Diffuse(BLACK))
            return Material(self.name, emission=self._covered(base, opacity), two_sided=True, bsdf=black)
        emission = self._covered(self._emission(), opacity)
        bsdf = self._bsdf(pbr, base)
        if opacity != 1.0:
            bsdf = Mask(opacity, bsdf)
        two_sided = boolean(self.node, "doubleSided")
        return Material(self.name, emission=emission, two_sided=two_sided and emission != BLACK, bsdf=bsdf)

    # ---- values

    def _note(self, text: str) -> None:
        self.notes.add(text, f"material {self.name!r}")

    def _part(self, node: Located | None) -> Located:
        return child(self.node, {}) if node is None else mapping(node)

    def _held(self, key: str, values: tuple[float, ...], most: float = 1.0, least: float = 0.0) -> tuple[float, ...]:
        """The numbers, held between the least and the most."""
        held = tuple(min(max(each, least), most) for each in values)
        if held != values:
            self._note(f"{key} lies outside of [{least:g}, {most:g}]: it is held there")
        return held

    def _shares(self, node: Located, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Numbers that are held in [0, 1]."""
        return self._held(key, numbers(node, key, default))

    def _share(self, node: Located, key: str, default: float) -> float:
        return self._held(key, (number(node, key, default),))[0]

    def _texture(
        self, node: Located, key: str, channel: str = "", srgb: bool = False, change: Change | None = None
    ) -> ImageTexture | None:
        """The texture at a key; None where there is none, and one texel with the mean, with a note, where it looks at another
        set of coordinates."""
        info = optional(node, key)
        if info is None:
            return None
        own, to_uv = placing(info)
        if self.uv_set is None:
            self.uv_set = own
        if own != self.uv_set:
            self._note(f"{key} has its mean everywhere: it looks at TEXCOORD_{own}, and others at TEXCOORD_{self.uv_set}")
        return self.textures.read(info, to_uv, channel, srgb, change, own != self.uv_set)

    def _number(self, node: Located, key: str, texture: str, channel: str, default: float) -> Number:
        """A share, or one channel of a texture times it."""
        factor = self._share(node, key, default)
        found = self._texture(node, texture, channel, change=_times((factor,))) if factor > 0.0 else None
        return factor if found is None else found

    # ---- parts

    def _base(self, pbr: Located) -> tuple[Color, Number]:
        """The base colour, and how much of the surface is there."""
        red, green, blue, alpha = self._shares(pbr, "baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        color: Color = (red, green, blue)
        image = self._texture(pbr, "baseColorTexture", srgb=True, change=_times(color))
        if self.colored and image is not None:
            self._note("vertex colours are left out, as it has a texture")
        elif self.colored:
            self.tint, color = color, MeshAttribute(VERTEX_COLOR)
        color = color if image is None else image
        mode = optional(self.node, "alphaMode")
        kind = "OPAQUE" if mode is None else fields.one_of(mode, MODES, "alphaMode")
        if kind == "OPAQUE":
            return color, 1.0
        if kind == "BLEND":
            if self.colored and image is None:
                return color, MeshAttribute(VERTEX_ALPHA, alpha)
            return color, self._texture(pbr, "baseColorTexture", "a", change=_times((alpha,))) or alpha
        cutoff = number(self.node, "alphaCutoff", 0.5)
        if self.colored and image is None:
            self._note("the alpha of vertex colours is not cut off: it is left out")
        cut = Change(("cut", alpha, cutoff), lambda pixels: pixels * np.float32(alpha) >= cutoff)
        image = self._texture(pbr, "baseColorTexture", "a", change=cut)
        if image is not None and image.filter == "bilinear":
            self._note("its alpha is cut off at texels, between which it is interpolated")
        return color, image or float(alpha >= cutoff)

    def _emission(self) -> Color:
        factor = numbers(self.node, "emissiveFactor", (0.0, 0.0, 0.0))
        strength = extension(self.node, "KHR_materials_emissive_strength")
        scale = 1.0 if strength is None else number(strength, "emissiveStrength", 1.0)
        emission = product(triple(factor), scale)
        if min(emission) < 0.0 or not max(emission) < LARGEST:
            raise required(self.node, "emissiveFactor").refuse(f"times emissiveStrength must lie in [0, {LARGEST:g}]")
        if max(emission) == 0.0:
            return BLACK
        image = self._texture(self.node, "emissiveTexture", srgb=True, change=_times(emission))
        return emission if image is None else image

    def _covered(self, emission: Color, opacity: Number) -> Color:
        """The emission of what is there of the surface: a mask does not scale it."""
        if opacity == 1.0 or emission == BLACK:
            return emission
        if isinstance(opacity, float):
            if isinstance(emission, ImageTexture):
                return self.textures.times(self.node, emission, opacity)
            return product(emission, opacity) if isinstance(emission, tuple) else tinted(emission, (opacity, opacity, opacity))
        if isinstance(opacity, ImageTexture) and isinstance(emission, tuple):
            return self.textures.times(self.node, opacity, emission)
        if isinstance(opacity, ImageTexture) and isinstance(emission, ImageTexture) and _alike(emission, opacity):
            return self.textures.times(self.node, emission, opacity.pixels)
        self._note("what is cut out of it emits all the same")
        return emission

    def _bsdf(self, pbr: Located, base: Color) -> Bsdf:
        metallic = self._number(pbr, "metallicFactor", "metallicRoughnessTexture", "b", 1.0)
        roughness = self._number(pbr, "roughnessFactor", "metallicRoughnessTexture", "g", 1.0)
        transmission, solid = self._transmission(metallic)
        eta = self._eta(metallic != 0.0, transmission != 0.0)
        coat, gloss = self._clearcoat()
        bsdf: Bsdf = Principled(
            base,
            roughness,
            metallic=metallic,
            eta=eta,
            sheen=self._sheen(),
            clearcoat=coat,
            clearcoat_gloss=gloss,
            spec_trans=transmission if solid else 0.0,
        )
        normals = self._normals()
        if normals is not None:
            bsdf = NormalMap(normals, bsdf)
        if solid or transmission == 0.0:
            return bsdf
        if isinstance(roughness, Texture) or roughness > SMOOTH:
            self._note("its thin pane is smooth where light passes it: neither that nor its reflection is blurred")
        return Blend(transmission, bsdf, ThinDielectric(max(eta, 1.0 + LEAST_CONTRAST), transmittance=base))

    def _eta(self, metallic: bool, transmits: bool) -> float:
        """The index of refraction, with what KHR_materials_specular makes of the reflectance at normal incidence."""
        ior, specular = extension(self.node, "KHR_materials_ior"), extension(self.node, "KHR_materials_specular")
        index = 1.5 if ior is None else number(ior, "ior", 1.5)
        if index != 0.0 and not 1.0 <= index <= IORS[1]:
            raise required(self._part(ior), "ior").refuse(f"must be 0, or lie in [1, {IORS[1]:g}]")
        least = 1.0 + LEAST_CONTRAST if metallic or transmits else 1.0
        if specular is not None and transmits:
            self._note("its reflection is that of its ior alone, as light passes it: KHR_materials_specular is left out")
        if specular is None or transmits:
            return max(index or IORS[1], least)
        color = numbers(specular, "specularColorFactor", (1.0, 1.0, 1.0))
        if len(set(color)) > 1:
            self._note("its reflection is not tinted: specularColorFactor counts by its luminance")
        for key in ("specularTexture", "specularColorTexture"):
            if optional(specular, key) is not None:
                self._note(f"{key} is left out")
        reflected = ((index - 1.0) / (index + 1.0)) ** 2 if index != 0.0 else 1.0
        reflected *= self._share(specular, "specularFactor", 1.0) * _luminance(color)
        root = min(max(reflected, 0.0) ** 0.5, 0.99)
        return min(max((1.0 + root) / (1.0 - root), least), IORS[1])

    def _transmission(self, metallic: Number) -> tuple[Number, bool]:
        """The share of light that may pass, and whether what it enters is a solid."""
        node = extension(self.node, "KHR_materials_transmission")
        if node is None or metallic == 1.0:
            return 0.0, False
        volume = extension(self.node, "KHR_materials_volume")
        solid = volume is not None and number(volume, "thicknessFactor", 0.0) > 0.0
        if solid and volume is not None and {"attenuationDistance", "attenuationColor"} & volume.value.keys():
            self._note("its inside does not absorb light: attenuationColor is left out")
        share = self._number(node, "transmissionFactor", "transmissionTexture", "r", 0.0)
        if not solid and metallic != 0.0 and share != 0.0:
            if isinstance(metallic, Texture) or isinstance(share, Texture):
                self._note("light passes its metallic parts, too")
            else:
                share *= 1.0 - metallic
        return share, solid and share != 0.0

    def _sheen(self) -> Number:
        node = extension(self.node, "KHR_materials_sheen")
        if node is None:
            return 0.0
        factor = triple(self._shares(node, "sheenColorFactor", (0.0, 0.0, 0.0)))
        if max(factor) == 0.0:
            return 0.0
        self._note("its sheen is Disney's, white, by the luminance of sheenColorFactor, whatever its roughness")
        image = self._texture(node, "sheenColorTexture", srgb=True, change=_times(factor))
        return _luminance(factor) if image is None else image

    def _clearcoat(self) -> tuple[Number, Number]:
        """Its strength and its gloss."""
        node = extension(self.node, "KHR_materials_clearcoat")
        coat = 0.0 if node is None else self._number(node, "clearcoatFactor", "clearcoatTexture", "r", 0.0)
        if node is None or coat == 0.0:
            return 0.0, 0.0
        self._note("its clear coat is Disney's: a quarter as strong, wider, no rougher than 0.32, and it does not dim the base")
        if optional(node, "clearcoatNormalTexture") is not None:
            self._note("its clear coat has the normals of the base: clearcoatNormalTexture is left out")
        factor = self._share(node, "clearcoatRoughnessFactor", 0.0)
        glossy = Change(("gloss", factor), lambda pixels: _gloss(pixels * factor))
        image = self._texture(node, "clearcoatRoughnessTexture", "g", change=glossy) if factor > 0.0 else None
        return coat, float(_gloss(np.array(factor))) if image is None else image

    def _normals(self) -> ImageTexture | None:
        info = optional(self.node, "normalTexture")
        if info is None:
            return None
        (scale,) = self._held("scale of normalTexture", (number(mapping(info), "scale", 1.0),), STEEPEST, -STEEPEST)
        to_uv = np.reshape(placing(info)[1], (2, 3))[:, :2]
        up = np.diag([1.0, -1.0])  # y of a texel points up, and v down; where coordinates are mirrored, the second tangent, too
        turn = scale * (np.eye(2) if self.mirrored else up) @ nearest_orthogonal(to_uv).T @ up

        def changed(pixels: Pixels) -> Pixels:
            normals = 2.0 * pixels - 1.0
            if pixels.shape[2] == 3:
                normals[:, :, :2] = normals[:, :, :2] @ turn.T
            return (normals + 1.0) / 2.0

        change = None if np.allclose(turn, np.eye(2)) else Change(("normal", *turn.flat), changed)
        found = self._texture(self.node, "normalTexture", change=change)
        if found is not None and found.pixels.shape[2] != 3:
            self._note("its normalTexture is left out: an image with three channels is expected")
            return None
        self.tilted = found is not None
        return found


def _alike(a: ImageTexture, b: ImageTexture) -> bool:
    """Whether the texels of two images are at the same places."""
    return a.pixels.shape[:2] == b.pixels.shape[:2] and (a.to_uv, a.wrap, a.filter) == (b.to_uv, b.wrap, b.filter)


def _luminance(color: tuple[float, ...]) -> float:
    return sum(a * b for a, b in zip(color, LUMINANCE, strict=True))


def _times(factor: tuple[float, ...]) -> Change | None:
    """Pixels times a number or a colour; None for 1."""
    if set(factor) == {1.0}:
        return None
    numbers = factor[:1] if len(set(factor)) == 1 else factor
    return Change(("times", *numbers), lambda pixels: pixels * np.array(numbers, np.float32))


def _gloss(roughness: Any) -> Any:
    """Disney's gloss of the clear coat whose width is the square of a roughness: from 0.1 down to 0.001."""
    return np.clip((0.1 - roughness**2) / 0.099, 0.0, 1.0)
