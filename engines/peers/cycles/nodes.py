"""Materials, environments and spot lights as Blender's shader nodes. bpy is imported by the caller's process alone."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np

from engines.scene import (
    BLACK,
    WHITE,
    Blend,
    Bsdf,
    Checkerboard,
    Color,
    Conductor,
    Dielectric,
    Diffuse,
    EnvironmentLight,
    ImageTexture,
    Mask,
    Material,
    Mixture,
    Null,
    Number,
    Sides,
    SpotLight,
    Texture,
    ThinDielectric,
)
from engines.scene.bsdf_tree import textures

EXTENSIONS = {"repeat": "REPEAT", "mirror": "MIRROR", "clamp": "EXTEND"}
LEAST_ROWS = 256
"""Of the image of an environment, about."""
TO_BLENDER = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Takes directions of raybench's latitude-longitude images to those of Blender's."""


class Nodes:
    """Writes the node tree of a material, world or light. `placed` are its textures: attributes uv0, uv1, ..."""

    def __init__(self, tree: Any, placed: tuple[Texture, ...] = ()) -> None:
        self.tree, self.placed = tree, placed
        tree.nodes.clear()

    def node(self, kind: str, inputs: Any = (), **properties: Any) -> Any:
        """A node with values or links for its inputs, by name or place: None leaves an input alone."""
        made = self.tree.nodes.new(f"ShaderNode{kind}")
        for key, value in properties.items():
            setattr(made, key, value)
        for key, value in inputs.items() if isinstance(inputs, dict) else enumerate(inputs):
            if hasattr(value, "is_output"):
                self.tree.links.new(value, made.inputs[key])
            elif value is not None:
                made.inputs[key].default_value = value
        return made

    def out(self, kind: str, inputs: Any = (), output: Any = 0, **properties: Any) -> Any:
        """An output of a new node."""
        return self.node(kind, inputs, **properties).outputs[output]

    def mixed(self, share: Any, a: Any, b: Any) -> Any:
        """A `share` of the BSDF b and the rest of a, of which None is black."""
        return self.out("MixShader", [share, a, b])

    def added(self, *parts: Any) -> Any:
        """The sum of BSDFs, of which None is black."""
        there = [part for part in parts if part is not None]
        return self.out("AddShader", [there[0], self.added(*there[1:])]) if len(there) > 1 else there[0] if there else None

    def value(self, given: Color | Number) -> Any:
        """A colour, a number, or the output of a texture."""
        if isinstance(given, ImageTexture | Checkerboard):
            where = next(index for index, each in enumerate(self.placed) if each is given)
            smooth = isinstance(given, ImageTexture) and given.filter == "bilinear"
            uv = self.out("Attribute", output="Vector", attribute_name=f"uv{where}")
            return self.out(
                "TexImage",
                {"Vector": uv},
                image=image_of(texels(given)),
                interpolation="Linear" if smooth else "Closest",
                extension=EXTENSIONS[given.wrap] if isinstance(given, ImageTexture) else "REPEAT",
            )
        return (*given, 1.0) if isinstance(given, tuple) else given

    def bsdf(self, given: Bsdf | None) -> Any:
        """The output of a BSDF's nodes; None for black."""
        match given:
            case Diffuse(reflectance):
                return self.out("BsdfDiffuse", {"Color": self.value(reflectance), "Roughness": 0.0})
            case Mixture():
                return self._mixture(given)
            case Conductor():
                return self._conductor(given)
            case Dielectric(ior, alpha, reflectance, transmittance, distribution):
                return self._glass(ior, alpha[0], reflectance, transmittance, distribution)
            case ThinDielectric(ior, reflectance, transmittance):
                return self._pane(ior, reflectance, transmittance)
            case Null():
                return self.out("BsdfTransparent")
            case _:
                return self._wrapped(given)

    def _wrapped(self, given: Bsdf | None) -> Any:
        match given:
            case Mask(opacity, of):
                return self.mixed(self.value(opacity), self.out("BsdfTransparent"), self.bsdf(of))
            case Blend(weight, a, b):
                return self.mixed(self.value(weight), self.bsdf(a), self.bsdf(b))
            case Sides(front, back):
                return self.mixed(self._backfacing(), self.bsdf(front), self.bsdf(back))
            case None:
                return None
        raise AssertionError(f"{type(given).__name__} has no nodes: the engine declines it")

    def _mixture(self, given: Mixture) -> Any:
        diffuse = None if given.kd == BLACK else self.bsdf(Diffuse(given.kd))
        mirror = None if given.ks == BLACK else self._glossy(given.ks)
        if given.kt != BLACK:
            return self.added(diffuse, self._glass(given.ior, 0.0, given.ks, given.kt))
        if given.fresnel and mirror is not None:
            mirror = self.mixed(self._fresnel(given.ior), None, mirror)
        return self.added(diffuse, mirror)

    def _conductor(self, given: Conductor) -> Any:
        if (given.eta, given.k) == (BLACK, WHITE):  # Fresnel's equations give 1
            return self._glossy(given.reflectance, given.alpha[0], given.distribution)
        return self.out(
            "BsdfMetallic",
            {"IOR": given.eta, "Extinction": given.k, "Roughness": _roughness(given.alpha[0])},
            distribution=given.distribution.upper(),
            fresnel_type="PHYSICAL_CONDUCTOR",
        )

    def _glossy(self, color: Color, alpha: Number = 0.0, distribution: str = "ggx") -> Any:
        inputs = {"Color": self.value(color), "Roughness": _roughness(alpha)}
        return self.out("BsdfAnisotropic", inputs, distribution=distribution.upper())

    def _glass(self, ior: float, alpha: Number, reflectance: Color, transmittance: Color, distribution: str = "ggx") -> Any:
        """One node where both tints are alike; else, of a smooth interface alone, a mixture by Fresnel's equations."""
        kind = {"distribution": distribution.upper()}
        if reflectance == transmittance:
            inputs = {"Color": self.value(reflectance), "Roughness": _roughness(alpha), "IOR": ior}
            return self.out("BsdfGlass", inputs, **kind)
        refraction = self.out("BsdfRefraction", {"Color": self.value(transmittance), "Roughness": 0.0, "IOR": ior}, **kind)
        return self.mixed(self._fresnel(ior), refraction, None if reflectance == BLACK else self._glossy(reflectance))

    def _pane(self, ior: float, reflectance: Color, transmittance: Color) -> Any:
        """2 F/(1 + F) is reflected, F as from outside on both sides."""
        outside = self.out("MapRange", [self._backfacing(), 0.0, 1.0, ior, 1.0 / ior])
        fresnel = self._fresnel(outside)
        above = self.out("Math", [fresnel, 2.0], operation="MULTIPLY")
        share = self.out("Math", [above, self.out("Math", [fresnel, 1.0], operation="ADD")], operation="DIVIDE")
        return self.mixed(share, self.out("BsdfTransparent", [self.value(transmittance)]), self._glossy(reflectance))

    def _fresnel(self, ior: Any) -> Any:
        return self.out("Fresnel", {"IOR": ior})

    def _backfacing(self) -> Any:
        return self.out("NewGeometry", output="Backfacing")

    def surface(self, material: Material, scatters: bool) -> None:
        """The whole material. Without `scatters`, what it emits."""
        light = None
        if material.emits:
            front = 1.0 if material.two_sided else self.out("Math", [1.0, self._backfacing()], operation="SUBTRACT")
            light = self.out("Emission", [(*material.mean_emission, 1.0), front])
        self.node("OutputMaterial", [self.added(self.bsdf(material.as_bsdf) if scatters else None, light)])

    def world(self, light: EnvironmentLight) -> None:
        """The environment as the background of a world."""
        if light.image is None:  # varies by less than rounding, or Cycles does not sample it as a light
            along = [self.out("NewGeometry", output="Incoming"), tuple(1e-9 * x for x in light.radiance), light.radiance]
            color = self.out("VectorMath", along, operation="MULTIPLY_ADD")
        else:
            matrix, flipped = looked_up(light)
            image = _tall(light.image * np.array(light.radiance))
            where = self.out("NewGeometry", output="Incoming")
            rows = [self.out("VectorMath", [where, tuple(-row)], "Value", operation="DOT_PRODUCT") for row in matrix]
            local = self.out("CombineXYZ", rows)
            color = self.out("TexEnvironment", [local], image=image_of(image[:, ::-1] if flipped else image, upright=True))
        self.node("OutputWorld", [self.out("Background", [color, 1.0])])

    def spot(self, light: SpotLight) -> None:
        """Of a point light, as much as shines into the cone; Blender's own spot lights fade otherwise."""
        towards = self.out(
            "VectorMath", [self.out("NewGeometry", output="Incoming"), light.direction], "Value", operation="DOT_PRODUCT"
        )
        angle = self.out("Math", [towards], operation="ARCCOSINE")
        cutoff, beam = math.radians(light.cutoff), math.radians(light.beam_width)
        if light.cutoff == light.beam_width:
            share = self.out("Math", [angle, cutoff], operation="LESS_THAN")
        else:
            share = self.out("MapRange", [angle, beam, cutoff, 1.0, 0.0])
        self.node("OutputLight", [self.out("Emission", [None, share])])


def _roughness(alpha: Number) -> float:
    """Blender's, of which alpha is the square."""
    assert isinstance(alpha, int | float)
    return math.sqrt(alpha)


def looked_up(light: EnvironmentLight) -> tuple[Any, bool]:
    """(3, 3) from the scene's directions to those of Blender's image, and whether the image's columns are turned round."""
    matrix = TO_BLENDER @ np.transpose(light.rotation)
    flipped = np.linalg.det(matrix) < 0.0
    return (matrix * [[1.0], [-1.0], [1.0]] if flipped else matrix), bool(flipped)


def _tall(image: Any) -> Any:
    """The same image for whoever interpolates between rows, with rows so many that what Blender does wrong hardly counts: it
    interpolates across each pole with the row of the other one."""
    height = len(image)
    times = 1 + 2 * (LEAST_ROWS // (2 * height))  # odd: then rows that are given stay rows
    places = ((np.arange(times * height) + 0.5) / times - 0.5).clip(0, height - 1)
    below = places.astype(int)
    share = (places - below)[:, None, None]
    return (1.0 - share) * image[below] + share * image[np.minimum(below + 1, height - 1)]


def texels(texture: ImageTexture | Checkerboard) -> Any:
    """(h, w, 1 or 3): an image's, or the two colours of a checkerboard, two of each."""
    if isinstance(texture, ImageTexture):
        return texture.pixels
    return np.array([[texture.a, texture.b], [texture.b, texture.a]])


def placed(material: Material) -> tuple[Texture, ...]:
    """The textures of a material, which have attributes of their own."""
    return tuple(textures(material.as_bsdf))


def image_of(pixels: Any, upright: bool = False) -> Any:
    """Linear floats as they are. Blender's v = 0 is the last row of an `upright` image, else the first."""
    height, width = pixels.shape[:2]
    bpy: Any = importlib.import_module("bpy")
    rgba = np.ones((height, width, 4), np.float32)
    rgba[:, :, :3] = pixels[::-1] if upright else pixels
    image = bpy.data.images.new("image", width, height, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    image.use_half_precision = False
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    image.pack()
    return image
