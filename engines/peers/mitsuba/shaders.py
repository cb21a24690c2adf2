"""The radiance along a ray in Mitsuba's wavefront: its own path integrator, and the transport rules that it lacks.

Each maker gives a function (sampler, ray, active) -> colour; what it does is recorded once and compiled. Whitted's tree of
rays is walked along one branch a sample, chosen as the dielectric samples it, which has the tree's expected value.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from engines.peers.mitsuba import plugins
from engines.peers.mitsuba.stage import Stage, far_corner, listed_emitters

Radiance = Callable[[Any, Any, Any], Any]


def path_node(options: Any) -> dict[str, Any]:
    """Mitsuba's integrator for our `path_tracer`: its depth counts alike, and its roulette begins and decides alike. That of
    `volpath` begins a vertex after its `rr_depth`, which is at least 1, and is repeated at null lobes."""
    kind, rr_depth = "path", options["rr_depth"]
    if options["transparent_shadows"]:
        kind, rr_depth = "volpath", max(rr_depth - 1, 1)
    return {"type": kind, "max_depth": options["max_depth"], "rr_depth": rr_depth, "hide_emitters": options["hide_emitters"]}


def volumetric_node(options: Any) -> dict[str, Any]:
    """Mitsuba's integrator for our `volumetric_path_tracer`, whose roulette begins where its own does."""
    return {"type": "volpath", **{key: options[key] for key in ("max_depth", "rr_depth", "hide_emitters")}}


def path_tracer(stage: Stage) -> Radiance:
    return _integrated(stage, path_node(stage.settings.shader.options))


def volumetric_path_tracer(stage: Stage) -> Radiance:
    return _integrated(stage, volumetric_node(stage.settings.shader.options))


def mitsuba(stage: Stage) -> Radiance:
    """An integrator of Mitsuba's, by the name of its plugin."""
    return _integrated(stage, plugins.node(stage.settings.shader.options))


def _integrated(stage: Stage, node: Any) -> Radiance:
    mi, dr, integrator, medium = stage.mi, stage.dr, stage.mi.load_dict(node), stage.camera.get_medium()

    def radiance(sampler: Any, ray: Any, active: Any) -> Any:
        return integrator.sample(stage.loaded, sampler, ray, medium, active)[0]

    def primal(sampler: Any, ray: Any, active: Any) -> Any:
        with dr.suspend_grad():
            return integrator.sample(
                mode=dr.ADMode.Primal,
                scene=stage.loaded,
                sampler=sampler,
                ray=ray,
                depth=mi.UInt32(0),
                δL=None,
                δaovs=None,
                state_in=None,
                active=active,
            )[0]

    return primal if isinstance(integrator, mi.CppADIntegrator) else radiance


def whitted(stage: Stage) -> Radiance:
    """Direct light of every light at every vertex, with shadows; mirrors and glass are followed."""
    return _direct(stage, stage.settings.shader.options["max_depth"])


def no_shadows(stage: Stage) -> Radiance:
    """Direct light of every light at the first hit, whatever stands between."""
    return _direct(stage, 0)


def _direct(stage: Stage, max_depth: int) -> Radiance:
    """`max_depth` 0: the first hit alone, without shadows."""
    mi, dr, scene = stage.mi, stage.dr, stage.loaded
    lights, ambient = listed_emitters(stage), stage.settings.shader.options["ambient"]
    context = mi.BSDFContext()

    def lit(sampler: Any, si: Any, bsdf: Any, active: Any) -> Any:
        smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        diffuse = smooth & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)  # of rough metals it gives pi f(n, n)
        total = dr.select(diffuse, ambient * bsdf.eval_diffuse_reflectance(si, diffuse), 0.0)
        for light in lights:
            ds, weight = light.sample_direction(si, sampler.next_2d(smooth), smooth)
            seen = smooth & (ds.pdf != 0.0)
            if max_depth:
                seen &= ~scene.ray_test(si.spawn_ray_to(ds.p), seen)
            value = bsdf.eval(context, si, si.to_local(ds.d), seen)
            total += dr.select(seen, value * weight, 0.0)
        return dr.select(smooth, total, 0.0)

    def radiance(sampler: Any, ray: Any, active: Any) -> Any:
        def go_on(sampler: Any, ray: Any, light: Any, weight: Any, depth: Any, active: Any) -> Any:
            return active

        def step(sampler: Any, ray: Any, light: Any, weight: Any, depth: Any, active: Any) -> Any:
            si = scene.ray_intersect(ray, active)
            light = light + weight * si.emitter(scene, active).eval(si, active)
            active = active & si.is_valid()
            bsdf = si.bsdf()
            light = light + dr.select(active, weight * lit(sampler, si, bsdf, active), 0.0)
            active &= mi.has_flag(bsdf.flags(), mi.BSDFFlags.Delta) & (depth + 1 < max_depth)
            specular = mi.BSDFContext()
            specular.type_mask = mi.BSDFFlags.Delta
            sample, value = bsdf.sample(specular, si, sampler.next_1d(active), sampler.next_2d(active), active)
            active &= (sample.pdf > 0.0) & (dr.max(value) > 0.0)
            weight = dr.select(active, weight * value, weight)
            ray = dr.select(active, si.spawn_ray(si.to_world(sample.wo)), ray)
            return sampler, ray, light, weight, depth + 1, active

        state = (sampler, mi.Ray3f(ray), mi.Color3f(0.0), mi.Color3f(1.0), mi.UInt32(0), mi.Bool(active))
        return dr.while_loop(state, go_on, step, labels=("sampler", "ray", "light", "weight", "depth", "active"))[2]

    return radiance


def depth_map(stage: Stage) -> Radiance:
    mi, dr, corner = stage.mi, stage.dr, far_corner(stage)

    def radiance(sampler: Any, ray: Any, active: Any) -> Any:
        if corner is None:
            return mi.Color3f(0.0)
        si = stage.loaded.ray_intersect(ray, active)
        reach = 1.1 * dr.norm(mi.Point3f(*map(float, corner)) - ray.o)
        grey = dr.select(si.is_valid() & (reach > 0.0), dr.maximum(0.0, (reach - si.t) / reach), 0.0)
        return mi.Color3f(grey)

    return radiance


def albedo(stage: Stage) -> Radiance:
    def radiance(sampler: Any, ray: Any, active: Any) -> Any:
        si = stage.loaded.ray_intersect(ray, active)
        return stage.scale * si.bsdf().eval_diffuse_reflectance(si, si.is_valid())

    return radiance


SHADERS: dict[str, Callable[[Stage], Radiance]] = {
    "path_tracer": path_tracer,
    "volumetric_path_tracer": volumetric_path_tracer,
    "mitsuba": mitsuba,
    "whitted": whitted,
    "no_shadows": no_shadows,
    "depth_map": depth_map,
    "albedo": albedo,
}
