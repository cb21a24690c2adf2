"""python -m tests.benchmarks.lanes: what the habits of a shader cost, as ratios of one run (docs/extend/shader.md)."""

import math
import time

import numpy as np

import engines
from engines.plugin import Shader, Vec3, const, finish, inline, select


@inline
def straight(si, light, bsdf, draws, path, options):
    zero, half = const(0.0, si.t), const(0.5, si.t)
    p, value, weight = si.point.x + si.point.y + si.point.z, zero, half
    for _ in range(16):
        p = p * 1.9 + 0.5
        wave = abs(p - np.floor(p) - 0.5)
        value += weight * select(wave > 0.25, wave, 0.5 - wave)
        weight *= 0.5
    black = Vec3(zero, zero, zero)
    return finish(si.t, select(si.miss, black, Vec3(value, value, value)), black)


@inline
def branching(si, light, bsdf, draws, path, options):
    zero, half = const(0.0, si.t), const(0.5, si.t)
    black = Vec3(zero, zero, zero)
    if si.miss:
        return finish(si.t, black, black)
    p, value, weight = si.point.x + si.point.y + si.point.z, zero, half
    for _ in range(16):
        p = p * 1.9 + 0.5
        wave = abs(p - np.floor(p) - 0.5)
        if wave > 0.25:
            value += weight * wave
        else:
            value += weight * (0.5 - wave)
        weight *= 0.5
    return finish(si.t, Vec3(value, value, value), black)


@inline
def widening(si, light, bsdf, draws, path, options):
    zero = const(0.0, si.t)
    p, value, weight = np.float64(si.point.x + si.point.y + si.point.z), np.float64(0.0), np.float64(0.5)
    for _ in range(16):
        p = p * 1.9 + 0.5
        wave = abs(p - np.floor(p) - 0.5)
        value += weight * select(wave > 0.25, wave, 0.5 - wave)
        weight *= 0.5
    grey, black = const(value, si.t), Vec3(zero, zero, zero)
    return finish(si.t, select(si.miss, black, Vec3(grey, grey, grey)), black)


@inline
def calling(si, light, bsdf, draws, path, options):
    zero, half = const(0.0, si.t), const(0.5, si.t)
    p, value, weight = si.point.x + si.point.y + si.point.z, zero, half
    for _ in range(16):
        p = p * 1.9 + 0.5
        value += weight * abs(math.sin(p))
        weight *= 0.5
    black = Vec3(zero, zero, zero)
    return finish(si.t, select(si.miss, black, Vec3(value, value, value)), black)


def main():
    scene, renderers = engines.load_scene("cornell_box"), {}
    for function in (straight, branching, widening, calling):
        shader = Shader(function.__name__, jitted=function)
        settings = engines.Settings(128, 128, shader=shader, sampler="random", precision="float32", threads=1)
        renderers[function.__name__] = engines.engine("numba").prepare(scene, settings)
    albedo = engines.Settings(128, 128, shader="albedo", sampler="random", precision="float32", threads=1)
    renderers["albedo"] = engines.engine("numba").prepare(scene, albedo)
    times = {name: [] for name in renderers}
    for renderer in renderers.values():
        renderer.warm_up()
    for _ in range(7):  # interleaved, so that other load slows all alike
        for name, renderer in renderers.items():
            start = time.process_time()
            renderer.render(64)
            times[name].append(time.process_time() - start)
    base = np.median(times.pop("albedo"))  # the same rays with a shader that costs next to nothing
    unit = np.median(times["straight"]) - base
    for name, seconds in times.items():
        own, whole = (np.median(seconds) - base) / unit, np.median(seconds) / (base + unit)
        print(f"{name:9} shader {own:4.1f}   whole image {whole:4.1f}")


if __name__ == "__main__":
    main()
