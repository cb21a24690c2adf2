"""The smallest honest engine: brute force in NumPy, for round shapes, planes, triangles and meshes, and for no lobe but kd.

Tests break it in one place at a time to see that the conformance suite notices.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from engines.choices import SAMPLERS, SHADERS, Option, resolve
from engines.concurrency import CallGuard
from engines.errors import Unsupported
from engines.film import Film
from engines.interface import Hits
from engines.scene import Cylinder, EnvironmentLight, Mesh, Perspective, Plane, PointLight, Sphere, Triangle

LIGHTS = (PointLight, EnvironmentLight)
ACCELERATORS = {"none": {"chunk": Option(64, "rays at a time", lambda value: None if value > 0 else "positive")}}


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def dot(a, b):
    return np.einsum("...i,...i->...", a, b)


class Renderer:
    def __init__(self, scene, settings):
        self.scene, self.settings = scene, settings
        self.camera, self.shapes = scene.camera, scene.shapes
        self.shader = resolve("shader", settings.shader, SHADERS)
        self._film = Film(*settings.size(scene))
        self.rays, self.stopped, self.done = 0, False, 0
        self.guard = CallGuard()

    @property
    def film(self):
        return self._film

    def warm_up(self):
        """There is nothing to compile."""
        with self.guard.rendering("warm_up"):
            pass

    def render(self, spp, on_pass=None):
        with self.guard.rendering():
            self.stopped = False
            for _ in range(spp):
                self.film.add(self.samples())
                self.done += 1
                if on_pass:
                    on_pass(self.film)
                if self.stopped:
                    break
            return self.film

    def stop(self):
        self.stopped = True

    def update(self, camera=None, shapes=None):
        with self.guard.updating():
            self.camera, self.shapes = camera or self.camera, self.shapes if shapes is None else shapes
            self._film = Film(*self.settings.size(replace(self.scene, camera=self.camera)))
            self.done = 0

    def counters(self):
        zeros = dict.fromkeys(("build_seconds", "compile_seconds", "accelerator_bytes"), 0.0)
        return {**zeros, "rays": self.rays, "bad_samples": self.film.bad_samples}

    # Rays

    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        o, d = np.asarray(origins, float).reshape(-1, 3), np.asarray(directions, float).reshape(-1, 3)
        length = np.max(np.abs(d), axis=1, initial=0.0)
        valid = np.isfinite(o).all(axis=1) & np.isfinite(length) & (length > 0)
        self.rays += int(valid.sum())
        with np.errstate(invalid="ignore", divide="ignore"):
            limit = np.broadcast_to(np.asarray(t_max, float), len(o)) * length
            o, d = np.where(valid[:, None], o, 0.0), np.where(valid[:, None], d / length[:, None], 1.0)
            t = np.where(valid & (limit > 0), limit, -1.0)
        n = len(t)
        shape, primitive = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
        normal, u, v = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
        with np.errstate(invalid="ignore", divide="ignore"):
            for index, piece, hit in self.intersections(o, d):
                near = (hit[0] > 1e-9) & self.wins(hit[0], t)
                t, u, v = (np.where(near, new, old) for new, old in zip(hit[:3], (t, u, v), strict=True))
                shape[near], primitive[near] = index, piece
                normal[near] = np.broadcast_to(hit[3], (n, 3))[near]
        normal *= -np.sign(dot(normal, d))[:, None]
        with np.errstate(invalid="ignore", divide="ignore"):
            t = np.where(shape >= 0, t / length, np.inf)
        return Hits(t, shape, primitive, normal, u, v)

    def wins(self, t, other):
        return t < other

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf):
        return np.isfinite(self.trace(origins, directions, t_max).t)

    def intersections(self, o, d):
        """(shape, primitive, (t, u, v, normal)) of every primitive with all rays; t is NaN where there is none."""
        for index, shape in enumerate(self.shapes):
            match shape:
                case Sphere(center, radius):
                    yield index, 0, self.sphere(o, d, np.array(center), radius)
                case Cylinder(p0, p1, radius):
                    yield index, 0, self.cylinder(o, d, np.array(p0), np.array(p1), radius)
                case Plane(point, normal):
                    t = dot(np.array(point) - o, normal) / (d @ np.array(normal))
                    yield index, 0, (t, np.zeros_like(t), np.zeros_like(t), np.array(normal))
                case Triangle(a, b, c):
                    yield index, 0, self.triangle(o, d, np.array(a), np.array(b), np.array(c))
                case Mesh(vertices, faces):
                    for piece, face in enumerate(faces):
                        yield index, piece, self.triangle(o, d, *vertices[face])

    def sphere(self, o, d, center, radius):
        f = o - center
        a, b, c = dot(d, d), -dot(f, d), dot(f, f) - radius**2
        root = np.sqrt(b * b - a * c)
        near, far = (b - root) / a, (b + root) / a
        t = np.where(near > 1e-9, near, far)
        return t, np.zeros_like(t), np.zeros_like(t), (f + t[:, None] * d) / radius

    def cylinder(self, o, d, p0, p1, radius):
        span = p1 - p0
        start, slope = dot(o - p0, span) / dot(span, span), dot(d, span) / dot(span, span)
        f, g = o - p0 - start[:, None] * span, d - slope[:, None] * span
        a, b, c = dot(g, g), -dot(f, g), dot(f, f) - radius**2
        root, t = np.sqrt(b * b - a * c), np.full(len(o), np.nan)
        for candidate in ((b + root) / a, (b - root) / a):
            place = start + slope * candidate
            t = np.where((candidate > 1e-9) & self.on_side(place), candidate, t)
        return t, np.zeros_like(t), np.zeros_like(t), (f + t[:, None] * g) / radius

    def on_side(self, place):
        """Whether places along the axis, 0 to 1 from end to end, lie between these."""
        return (place >= 0) & (place <= 1)

    def triangle(self, o, d, a, b, c):
        """Moeller and Trumbore 1997."""
        p = np.cross(d, c - a)
        det = p @ (b - a)
        u = dot(o - a, p) / det
        q = np.cross(o - a, b - a)
        v = dot(d, q) / det
        t = np.where((u >= 0) & (v >= 0) & (u + v <= 1), q @ (c - a) / det, np.nan)
        return t, u, v, unit(np.cross(b - a, c - a))

    # Light

    def random(self):
        return np.random.default_rng([self.settings.seed, self.done])

    def camera_rays(self, random):
        camera, (height, width) = self.camera, self.film.counts.shape
        y, x = np.mgrid[:height, :width].reshape(2, -1) + random.random((2, height * width))
        forward = unit(np.subtract(camera.target, camera.eye))
        right = unit(np.cross(forward, camera.up))
        up = np.cross(right, forward)
        half = np.tan(np.radians(camera.fov) / 2)
        hx, hy = (half * width / height, half) if camera.fov_axis == "y" else (half, half * height / width)
        across, above = hx * (2 * x / width - 1), hy * (1 - 2 * y / height)
        directions = forward + across[:, None] * right + above[:, None] * up
        return np.tile(camera.eye, (len(x), 1)), unit(directions)

    def samples(self):
        """One sample for every pixel, (pixels, 3)."""
        random = self.random()
        o, d = self.camera_rays(random)
        radiance, throughput = np.zeros((len(o), 3)), np.ones((len(o), 3))
        depths = 1 if self.shader.name == "albedo" else self.shader.options["max_depth"]
        for depth in range(1, depths + 1):
            hits = self.trace(o, d)
            hit = np.isfinite(hits.t)
            kd, emission = self.response(hits)
            front = hits.shape >= 0
            if self.shader.name == "albedo":
                return np.where(kd.max(axis=1, keepdims=True) > 0, kd, emission)
            for light in self.scene.lights:
                if isinstance(light, EnvironmentLight):
                    radiance += np.where(hit[:, None], 0.0, throughput * np.array(light.radiance))
            radiance += throughput * emission * front[:, None]
            if depth == depths or not hit.any():
                break
            points = np.where(hit[:, None], o + np.where(hit, hits.t, 0)[:, None] * d, 0.0) + 1e-6 * hits.normal
            for light in self.scene.lights:
                if isinstance(light, PointLight):
                    radiance += throughput * self.point_light(light, points, hits.normal, kd)
            o, d = points, self.scatter(hits.normal, random)
            throughput = throughput * kd * hit[:, None]
        return radiance

    def response(self, hits):
        """kd and the emission that leaves towards the ray, (n, 3) each; black where nothing is hit."""
        kd, emission = np.zeros((2, len(hits.t), 3))
        for index, shape in enumerate(self.shapes):
            here = hits.shape == index
            given = shape.materials[0] if isinstance(shape, Mesh) else shape.material
            material = self.scene.materials[given]
            kd[here], emission[here] = material.kd, material.emission
            if isinstance(shape, Mesh) and not material.two_sided:
                a, b, c = np.moveaxis(shape.vertices[shape.faces], 1, 0)
                fronts = np.cross(b - a, c - a)[np.where(here, hits.primitive, 0)]
                emission[here & (dot(fronts, hits.normal) < 0)] = 0
        return kd, emission

    def point_light(self, light, points, normals, kd):
        to = np.array(light.position) - points
        distance = np.linalg.norm(to, axis=1)
        cosine = np.maximum(dot(to, normals) / distance, 0)
        lit = ~self.occluded(points, to, 1.0) & (cosine > 0)
        return np.where(lit, cosine / distance**2, 0)[:, None] * kd / np.pi * np.array(light.intensity)

    def scatter(self, normals, random):
        """Directions in proportion to the cosine: the normal plus a point on the unit sphere."""
        sphere = unit(random.normal(size=normals.shape))
        return unit(normals + (1 - 1e-9) * sphere)


class Engine:
    name, version = "small", "1"
    renderer: type[Renderer] = Renderer

    def accelerators(self):
        return ACCELERATORS

    def why_not(self, scene, settings):
        shader = resolve("shader", settings.shader, SHADERS)
        sampler = resolve("sampler", settings.sampler, SAMPLERS)
        if settings.accelerator != "auto":
            resolve("accelerator", settings.accelerator, ACCELERATORS)
        lacking = {
            f"small draws at random, not by {sampler.name}": sampler.name != "random",
            "small computes in float64": settings.precision == "float32",
            f"small has no shader {shader.name}": shader.name not in ("path_tracer", "albedo"),
            "small has a pinhole camera": not isinstance(scene.camera, Perspective),
            "small knows diffuse surfaces only": any(max(*given.ks, *given.kt) > 0 for given in scene.materials),
            "small knows point lights and environments": not all(isinstance(light, LIGHTS) for light in scene.lights),
        }
        return next((sentence for sentence, lacks in lacking.items() if lacks), None)

    def prepare(self, scene, settings):
        reason = self.why_not(scene, settings)
        if reason is not None:
            raise Unsupported(reason)
        return self.renderer(scene, settings)
