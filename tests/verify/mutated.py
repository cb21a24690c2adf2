"""Copies of the reference engine, or of the jitted one, with one planted fault each, as packages of their own."""

import importlib
import re
import shutil
import sys
from pathlib import Path
from typing import NamedTuple

SOURCES = Path(__file__).resolve().parents[2] / "engines"
HOUSES = {"numpy_reference": ("numpy_reference",), "numba_cpu": ("numba_cpu", "kernels")}
"""The package of an engine's class, and the folders that make the engine."""


class Fault(NamedTuple):
    """`before` becomes `after` in `file`; `case` (with `accelerator`) must see it.

    Files of the reference are named from its folder, those of the jitted engine from `engines`.
    """

    name: str
    file: str
    before: str
    after: str
    case: str
    accelerator: str = "auto"
    also: tuple[str, str] = ("", "")

    @property
    def jitted(self) -> bool:
        return self.file.startswith(("kernels/", "numba_cpu/"))


FAULTS = [
    Fault("phase function: backwards", "media.py", "at.wo + np.where(", "at.wo - np.where(", "med.once"),
    Fault(
        "media: interior and exterior exchanged", "media.py", "cosine, -cosine) > 0.0", "cosine, -cosine) < 0.0", "med.absorb"
    ),
    Fault(
        "media: a channel of its own for each path",
        "media.py",
        "(share * density).sum(axis=0)",
        "np.take_along_axis(density, channel[None], 0)",
        "med.white",
    ),
    Fault(
        "sphere by b*b - 4ac",
        "shapes/sphere.py",
        "discriminant = radius * radius - dot(to_axis, to_axis)",
        "discriminant = (b * b - a * (dot(f, f) - radius * radius)) / a",
        "S1",
        "none",
    ),
    Fault(
        "sphere: roots by plus and minus",
        "shapes/sphere.py",
        "t0, t1 = gap * (away + radius) / q, q / a",
        "t0, t1 = (b - np.sqrt(a * discriminant)) / a, (b + np.sqrt(a * discriminant)) / a",
        "S11",
        "none",
    ),
    Fault(
        "sphere: surface without its rounding band",
        "shapes/sphere.py",
        "np.where(np.abs(gap) <= 4.0 * EPSILON * radius, 0.0, gap)",
        "1.0 * gap",
        "S5",
        "none",
    ),
    Fault("direction taken for unit", "renderer.py", "scaled / long, length", "scaled, length", "S7", "none"),
    Fault("field of view taken for half of it", "camera.py", "np.radians(camera.fov) / 2.0", "np.radians(camera.fov)", "cam"),
    Fault("field of view along the other axis", "camera.py", 'camera.fov_axis == "x"', 'camera.fov_axis == "y"', "cam"),
    Fault(
        "sphere: nearer root only", "shapes/sphere.py", "np.where(near > 0.0, near, np.maximum(t0, t1))", "near", "S4", "none"
    ),
    Fault("triangle: hits behind the eye", "shapes/watertight.py", "inside & certain & (t > 0.0)", "inside", "B2", "none"),
    Fault(
        "triangle: strict edges",
        "shapes/watertight.py",
        "inside = np.minimum(np.minimum(u, v), w) >= 0.0",
        "inside = np.minimum(np.minimum(u, v), w) > 0.0",
        "T4",
        "none",
    ),
    Fault(
        "triangle: constant epsilon",
        "shapes/watertight.py",
        "inside & certain & (t > 0.0)",
        "inside & (t > 1e-4)",
        "T15",
        "none",
    ),
    Fault(
        "triangle: u and v swapped",
        "shapes/watertight.py",
        "return v / total, w / total",
        "return w / total, v / total",
        "T1",
        "none",
    ),
    Fault(
        "slab by min and max alone",
        "accelerators/bvh.py",
        "np.abs(direction) < 1e-300, 1e-300, direction",
        "False, 0.0, direction",
        "B1",
        "bvh",
        ("+ extent) + 1e-300", "+ extent) * 0.0"),
    ),
    Fault("slab widened by nothing", "accelerators/bvh.py", "pad = 32.0 * slack", "pad = -32.0 * slack", "B1", "bvh"),
    Fault("constant offset of spawned rays", "interaction.py", "offset * scale", "np.full(scale.size, 1e-4)", "L1"),
    Fault("no offset of spawned rays", "interaction.py", "offset * scale", "0.0 * scale", "L2"),
    Fault(
        "offset to the wrong side",
        "interaction.py",
        "np.where(dot(self.geometric, wi) < 0.0, -self.offset, self.offset)",
        "np.where(dot(self.geometric, wi) < 0.0, self.offset, -self.offset)",
        "L2",
    ),
    Fault(
        "normal never turned to the ray",
        "interaction.py",
        "geometric = np.where(front, outward, -outward)",
        "geometric = outward",
        "d",
    ),
    Fault("point light without 1/d^2", "lights/point.py", "dot(to_light, to_light), 1.0)", "1.0, 1.0)", "i"),
    Fault("directional light backwards", "lights/directional.py", "= -columns", "= columns", "i"),
    Fault("triangle light without its cosine", "shapes/interface.py", "(np.abs(cosine) * area)", "area", "e"),
    Fault("triangle light: uniform weights wrong", "shapes/triangle.py", "su = np.sqrt(u0)", "su = u0", "e"),
    Fault(
        "sphere light: cone pdf without 2", "shapes/sphere.py", "1.0 / (2.0 * np.pi * spread)", "1.0 / (np.pi * spread)", "f"
    ),
    Fault("albedo not divided by pi", "bsdf/mixture.py", "at) / np.pi, 0.0)", "at), 0.0)", "i"),
    Fault("bounce multiplied by pi", "bsdf/mixture.py", "(q[lanes] / d[lanes])", "(np.pi * q[lanes] / d[lanes])", "a"),
    Fault(
        "light choice without its probability",
        "path_tracer.py",
        "(at.cosine(light.wi) * scale * weight)",
        "(at.cosine(light.wi) * weight)",
        "sum",
    ),
    Fault(
        "light chosen by power, divided by the even probability",
        "light_samplers/plain.py",
        "light, u), self._inverse_pmf[light])",
        "light, u), np.full(u.size, float(self._inverse_pmf.size)))",
        "pick",
    ),
    Fault(
        "light found by scattering, weighted by the even probability",
        "light_samplers/plain.py",
        "geometric: Array) -> Array:\n        return self._inverse_pmf[light]",
        "geometric: Array) -> Array:\n        return np.full(light.size, float(self._inverse_pmf.size))",
        "pick",
    ),
    Fault(
        "lights of a hierarchy chosen by another share than is said",
        "light_samplers/hierarchy.py",
        "(sums <= uc[inside] * sums[-1])",
        "(sums <= uc[inside] ** 2 * sums[-1])",
        "pick",
    ),
    Fault(
        "hierarchy of lights: one above the horizon is left out",
        "light_samplers/hierarchy.py",
        "(incident < np.pi / 2)",
        "(incident < 0.3)",
        "pick",
    ),
    Fault(
        "lights of a cell: the other light of a bin with the probability of its own",
        "light_samplers/cells.py",
        "STEPS / np.where(own, of_own, of_other)",
        "STEPS / of_own",
        "pick",
    ),
    Fault(
        "resampled light without the mean of the targets",
        "direct_light.py",
        "(total[mine] / count / targets[k, mine])",
        "(1.0 + 0.0 * targets[k, mine])",
        "resample",
    ),
    Fault(
        "resampled light with the sum of the targets for their mean",
        "direct_light.py",
        "total[mine] / count",
        "total[mine]",
        "resample",
    ),
    Fault("candidates in too few strata", "direct_light.py", "(k + u) / count", "(k + u) / (count + 1)", "resample"),
    Fault("emission counted twice", "path_tracer.py", "return np.where(only_way, 1.0, 0.0)", "return np.ones(pdf.size)", "e"),
    Fault(
        "mis weights that do not add up",
        "path_tracer.py",
        "weight = 1.0 / (1.0 + ratio * ratio)",
        "weight = 1.0 / (1.0 + ratio)",
        "e",
    ),
    Fault(
        "roulette divides by too much",
        "path_tracer.py",
        "np.where(played, survival, 1.0)[kept]",
        "np.where(played, survival, 1.0)[kept] ** 2",
        "rr",
    ),
    Fault(
        "roulette with another survival",
        "path_tracer.py",
        "paths.throughput.max(axis=0, initial=0.0) * (paths.eta**2 * paths.odds), 0.95",
        "paths.throughput.max(axis=0, initial=0.0) * (paths.eta**2 * paths.odds), 0.6",
        "rr2",
    ),
    Fault("refraction without 1/eta^2", "bsdf/mixture.py", "1.0 / (eta * eta)), total", "1.0 + 0.0 * eta), total", "D3"),
    Fault(
        "Fresnel for one polarisation",
        "bsdf/fresnel.py",
        "mean = 0.5 * perpendicular * perpendicular + 0.5 * parallel * parallel",
        "mean = perpendicular * perpendicular",
        "D0",
    ),
    Fault("index not inverted inside", "bsdf/interface.py", "np.where(at.front, ior, 1.0 / ior)", "ior", "D9"),
    Fault("mirror with the wrong sign", "bsdf/interface.py", "at.normal - at.wo", "at.normal + at.wo", "k"),
    Fault("refracted to the wrong side", "bsdf/mixture.py", "(c1 / eta - c2)", "(c1 / eta + c2)", "l"),
    Fault("refraction without 1 - F", "bsdf/mixture.py", "kt * (1.0 - reflectance), kt", "kt, kt", "energy"),
    Fault(
        "total reflection dims", "bsdf/mixture.py", "np.where(total, 1.0, 1.0 / (eta * eta))", "1.0 / (eta * eta)", "wf.glass"
    ),
    Fault(
        "a diffuse lobe that depends on the viewer",
        "bsdf/mixture.py",
        "at) / np.pi, 0.0)",
        "at) * np.abs(dot(at.normal, at.wo)) / np.pi, 0.0)",
        "recip",
    ),
    Fault(
        "sky density without its sine", "lights/image_environment.py", "(2.0 * np.pi**2 * sine)", "(2.0 * np.pi**2)", "c.sky"
    ),
    Fault(
        "half the area of a sphere light",
        "shapes/sphere.py",
        "* 4.0 * np.pi * radius * radius",
        "* 2.0 * np.pi * radius * radius",
        "a.mis",
    ),
    Fault("Halton of one base", "sampler.py", "PRIMES[dimension]", "PRIMES[0]", "q.edge"),
    Fault("Sobol of one dimension", "sampler.py", "DIRECTIONS[dimension, bits]", "DIRECTIONS[0, bits]", "q.slope"),
    Fault("strata on a diagonal", "sampler.py", "place >> m if dimension % 2 else", "", "q.slope"),
    Fault(
        "spot light without its fall-off",
        "lights/spot.py",
        "(cutoff - angle) / (cutoff - beam_width), 1.0)",
        "1.0 + 0.0 * angle, 1.0)",
        "spot",
    ),
    Fault(
        "disk light crowded at its centre", "shapes/disk.py", "np.sqrt(u0), 2.0 * np.pi * u1", "u0, 2.0 * np.pi * u1", "disk"
    ),
    Fault(
        "metal of one polarisation",
        "bsdf/fresnel.py",
        "0.5 * np.abs(parallel) ** 2",
        "0.5 * np.abs(perpendicular) ** 2",
        "metal",
    ),
    Fault(
        "microfacets that hide no light",
        "bsdf/facets.py",
        "self.masking(self.wo) * self.masking(wi)",
        "self.masking(self.wo)",
        "metal",
    ),
    Fault(
        "cylinder: one crossing alone",
        "shapes/cylinder.py",
        "roots = gap * (away + radius) / q, q / speed2",
        "roots = (gap * (away + radius) / q,)",
        "Y1",
    ),
    Fault("half the area of a cylinder light", "shapes/cylinder.py", "self.area = 2.0 * np.pi", "self.area = np.pi", "Y2"),
    Fault(
        "principal point shifts upwards",
        "camera.py",
        "y - camera.principal_point[1]",
        "y + camera.principal_point[1]",
        "cam.shift",
    ),
    Fault("mirror forgotten", "camera.py", "right = -right if camera.mirror else right", "right = 1.0 * right", "cam.shift"),
    Fault(
        "clipped along rays",
        "camera.py",
        "slope = dot(direction, _axes(camera)[0])",
        "slope = np.ones(direction.shape[1])",
        "cam.clip",
    ),
    Fault("lens crowded at its centre", "camera.py", "np.sqrt(lens[0])", "lens[0]", "lens"),
    Fault(
        "focal sphere for a plane",
        "camera.py",
        "camera.focus_distance / dot(direction, forward)",
        "camera.focus_distance",
        "lens",
    ),
    Fault(
        "Jacobian of refraction without its index", "bsdf/facets.py", "/ (out + eta * into) ** 2", "/ (out + into) ** 2", "mod"
    ),
    Fault(
        "clearcoat four times as bright",
        "bsdf/principled.py",
        "return 0.25 * self.clearcoat * self._schlick",
        "return self.clearcoat * self._schlick",
        "mod",
    ),
    Fault("flat base without its factor", "bsdf/principled.py", "1.25 * (beneath", "(beneath", "mod"),
    Fault(
        "Beckmann facets hidden as those of GGX",
        "bsdf/facets.py",
        "lambda: beckmann.masking(v, self.alpha))",
        "lambda: ggx.masking(v, self.alpha))",
        "mod",
    ),
    Fault(
        "a matt model that depends on the viewer",
        "bsdf/diffuse.py",
        "self._reflectance(member, at) / np.pi, 0.0)",
        "self._reflectance(member, at) * np.abs(dot(at.normal, at.wo)) / np.pi, 0.0)",
        "mod.recip",
    ),
    Fault("visible normals to one side", "bsdf/ggx.py", "2.0 * np.pi * u1  # drop", "np.pi * u1  # drop", "mod.sky"),
    Fault(
        "coat without its probability",
        "bsdf/plastic.py",
        "dot(at.wo, at.normal))) / specular",
        "dot(at.wo, at.normal)))",
        "mod.sky",
    ),
    Fault(
        "blend the other way round",
        "wrappers.py",
        "at.take(lanes))), second, first)",
        "at.take(lanes))), first, second)",
        "mod.white",
    ),
    Fault(
        "mask the other way round",
        "wrappers.py",
        "self._passing[lanes] = ~self.chosen",
        "self._passing[lanes] = self.chosen",
        "mod.mask",
    ),
    Fault("a number used twice", "wrappers.py", "np.where(found, u / share, (u - share) / (1.0 - share))", "u", "mod.mask"),
    Fault(
        "shadowing of tilted normals twice as strong",
        "tilts.py",
        "_tangent2(n, at.normal) / 8.0",
        "_tangent2(n, at.normal) / 4.0",
        "mod.tilt",
    ),
    Fault(
        "normal map upside down from behind",
        "tilts.py",
        "np.stack([along, side * along, ",
        "np.stack([along, along, ",
        "mod.tilt",
    ),
    Fault("bump without its scale", "tilts.py", "along * bump.scale * slope", "along * slope", "mod.tilt"),
    Fault(
        "front and back exchanged",
        "wrappers.py",
        "np.where(at.front[lanes], first, second)",
        "np.where(at.front[lanes], second, first)",
        "mod.sides",
    ),
    Fault("mirrored textures shifted", "textures.py", "2.0 * size - 1.0 - around", "2.0 * size - 2.0 - around", "tex"),
    Fault(
        "texels at whole numbers", "textures.py", "_scaled(place, width, height, 0.5)", "_scaled(place, width, height)", "tex"
    ),
    Fault(
        "checkerboard of other squares", "textures.py", "place - np.floor(place) > 0.5", "place - np.floor(place) > 0.25", "tex"
    ),
    Fault("sphere: v from below", "shapes/sphere.py", "theta / np.pi])", "1.0 - theta / np.pi])", "uv"),
    Fault("cylinder: v in metres", "shapes/cylinder.py", "axis) / self._length[index]", "axis)", "uv"),
    Fault(
        "sky turned backwards",
        "lights/image_environment.py",
        "self._rotated(direction, self._to_world.T)",
        "self._rotated(direction, self._to_world)",
        "sky",
    ),
    Fault(
        "rows on the poles taken for cells",
        "lights/image_environment.py",
        "v * (height - 1.0) if self._poles",
        "v * height - 0.5 if self._poles",
        "sky",
    ),
    Fault(
        "density of a turned sky as it is",
        "lights/image_environment.py",
        "u, v = self._place(direction)\n        height",
        "u, v = _place(direction)\n        height",
        "sky.floor",
    ),
    Fault(
        "kernels: sphere by b*b - 4ac",
        "kernels/lane/shapes/sphere.py",
        "discriminant = radius * radius - dot(l, l)",
        "discriminant = (b * b - a * (dot(f, f) - radius * radius)) / a",
        "S1",
        "none",
    ),
    Fault(
        "kernels: watertight edges made strict",
        "kernels/lane/shapes/triangle.py",
        "(low >= 0.0) | (high <= 0.0)",
        "(low > 0.0) | (high < 0.0)",
        "T4",
        "none",
    ),
    Fault(
        "kernels: hits before a constant epsilon are dropped",
        "numba_cpu/accel/grid.py",
        "valid = distance > real(0) and this",
        "valid = distance > real(1e-4) and this",
        "T15",
        "grid",
    ),
    Fault(
        "kernels: slab by min and max alone",
        "numba_cpu/accel/bvh_walk.py",
        "inverse = finite_inverse(d, tiny)",
        "inverse = np.float32(1) / d",
        "B1",
        "bvh",
    ),
    Fault(
        "kernels: a hit beyond the cell is taken",
        "numba_cpu/accel/grid.py",
        "if t * widen + ray.error_bound + grid.box[6] < exit_:",
        "if primitive >= 0:",
        "A3",
        "grid",
    ),
    Fault(
        "kernels: point light without 1/d^2",
        "kernels/lane/lights.py",
        "scale = 1.0 / select(falloff",
        "scale = 1.0 + 0.0 * select(falloff",
        "d",
    ),
    Fault(
        "kernels: normal never turned to the viewer",
        "kernels/stages/surface.py",
        "geometric = select(front, found.normal, -found.normal)",
        "geometric = found.normal",
        "d",
    ),
]


def source_of(fault):
    """The file, below `SOURCES`, that a fault changes."""
    return SOURCES / fault.file if fault.jitted else SOURCES / "numpy_reference" / fault.file


def mutated(fault, folder):
    """The engine with the fault, imported from a copy under `folder`."""
    package = "planted_" + re.sub(r"\W+", "_", fault.name)
    house, copy = "numba_cpu" if fault.jitted else "numpy_reference", folder / package
    for part in HOUSES[house]:
        shutil.copytree(SOURCES / part, copy / part, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "__init__.py").touch()
    file = copy / fault.file if fault.jitted else copy / house / fault.file
    source = file.read_text()
    assert source.count(fault.before) >= 1, f"{fault.file} no longer holds {fault.before!r}"
    assert fault.also[0] in source
    file.write_text(
        source.replace(fault.before, fault.after).replace(*fault.also)
        if fault.also[0]
        else source.replace(fault.before, fault.after)
    )
    for path in copy.rglob("*.py"):
        text = path.read_text()
        for part in HOUSES[house]:
            text = text.replace(f"engines.{part}", f"{package}.{part}")
        path.write_text(text)
    sys.path.insert(0, str(folder))
    try:
        return importlib.import_module(f"{package}.{house}").Engine()
    finally:
        sys.path.remove(str(folder))
