"""cutout: the colours of triangles seen through a pinhole, for raybench, of which it knows the public names alone."""

from dataclasses import replace

import numpy as np

from engines import Film, Hits, Unsupported
from engines.choices import SAMPLERS, SHADERS, resolve
from engines.concurrency import CallGuard
from engines.scene import Mesh, Perspective, Triangle

COUNTERS = dict.fromkeys(("build_seconds", "compile_seconds", "accelerator_bytes", "bad_samples"), 0.0)


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


class Renderer:
    def __init__(self, scene, settings):
        self.scene, self.settings, self.stopped, self.guard = scene, settings, False, CallGuard()
        self.update(scene.camera, scene.shapes)

    def update(self, camera=None, shapes=None):
        with self.guard.updating():
            self.change(replace(self.scene, camera=camera or self.scene.camera), shapes)

    def change(self, scene, shapes):
        self.scene, self.film = scene, Film(*self.settings.size(scene))
        if shapes is not None:
            flat = [
                (s.vertices[s.faces], s.materials) if isinstance(s, Mesh) else ([(s.a, s.b, s.c)], [s.material]) for s in shapes
            ]
            self.faces = np.concatenate([np.zeros((0, 3, 3)), *(corners for corners, _ in flat)])
            self.ids = np.array([(i, k) for i, (f, _) in enumerate(flat) for k in range(len(f))], int).reshape(-1, 2)
            shown = [scene.materials[index] for _, given in flat for index in given]
            self.colours = np.array([m.kd if max(m.kd) > 0 else m.emission for m in shown] + [(0, 0, 0)])

    def trace(self, origins, directions, t_max=np.inf):
        """Moeller and Trumbore 1997, face by face."""
        o, d = (np.asarray(a, float).reshape(-1, 3) for a in (origins, directions))
        n = len(o)
        with np.errstate(all="ignore"):
            length = np.abs(d).max(axis=1, initial=0.0)
            d, t = d / length[:, None], np.broadcast_to(np.asarray(t_max, float), n) * length
            t = np.where((t > 0) & np.isfinite(length) & np.isfinite(o).all(axis=1), t, -1.0)
            face, u, v, normal = np.full(n, -1), np.zeros(n), np.zeros(n), np.zeros((n, 3))
            for index, (a, b, c) in enumerate(self.faces):
                p, q = np.cross(d, c - a), np.cross(o - a, b - a)
                det = p @ (b - a)
                ut, vt, tt = (p * (o - a)).sum(1) / det, (q * d).sum(1) / det, q @ (c - a) / det
                near = (ut >= 0) & (vt >= 0) & (ut + vt <= 1) & (tt > 1e-12) & (tt < t)
                t[near], face[near], u[near], v[near] = tt[near], index, ut[near], vt[near]
                normal[near] = unit(np.cross(b - a, c - a)) * np.sign(det[near, None])
            shape, primitive = np.vstack([self.ids, (-1, -1)])[face].T
            return Hits(np.where(face < 0, np.inf, t / length), shape, primitive, normal, u, v)

    def occluded(self, origins, directions, t_max=np.inf):
        return self.trace(origins, directions, t_max).shape >= 0

    def warm_up(self):
        self.render(0)

    def render(self, spp, on_pass=None):
        with self.guard.rendering():
            return self.passes(spp, on_pass)

    def passes(self, spp, on_pass):
        self.stopped, camera, (height, width) = False, self.scene.camera, self.film.counts.shape
        forward = unit(np.subtract(camera.target, camera.eye))
        right = unit(np.cross(forward, camera.up))
        half = np.tan(np.radians(camera.fov) / 2) / (height if camera.fov_axis == "y" else width)
        first = np.searchsorted(self.ids[:, 0], np.arange(len(self.ids) + 1))
        for _ in range(spp):
            inside = np.random.default_rng([self.settings.seed, self.film.spp]).random((2, height * width))
            y, x = np.mgrid[:height, :width].reshape(2, -1) + inside
            d = forward + half * ((2 * x - width)[:, None] * right + (height - 2 * y)[:, None] * np.cross(right, forward))
            seen = self.trace(np.tile(camera.eye, (len(d), 1)), d)
            self.film.add(self.colours[np.where(seen.shape < 0, -1, first[seen.shape] + seen.primitive)])
            if on_pass:
                on_pass(self.film)
            if self.stopped:
                break
        return self.film

    def stop(self):
        self.stopped = True

    def counters(self):
        return {**COUNTERS, "bad_samples": float(self.film.bad_samples)}


class Engine:
    name, version = "cutout", "0.3"

    def accelerators(self):
        return {"auto": {}}

    def why_not(self, scene, settings):
        shader, sampler = resolve("shader", settings.shader, SHADERS), resolve("sampler", settings.sampler, SAMPLERS)
        resolve("accelerator", settings.accelerator, self.accelerators())
        able = shader.name == "albedo" and sampler.name == "random" and settings.precision != "float32"
        able = able and isinstance(scene.camera, Perspective) and all(isinstance(s, Triangle | Mesh) for s in scene.shapes)
        able = able and all(max(*m.ks, *m.kt) == 0 for m in scene.materials)
        return None if able else "cutout shows matte triangles' albedo through a pinhole, drawn at random, in float64"

    def prepare(self, scene, settings):
        reason = self.why_not(scene, settings)
        if reason:
            raise Unsupported(reason)
        return Renderer(scene, settings)
