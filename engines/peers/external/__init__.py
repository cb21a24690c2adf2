"""A renderer by process: any program that takes a scene file and writes an EXR or PFM, described by a YAML file.

    raybench_renderer: 1
    name: lantern                      # what tables call it; not the name of one of raybench's engines
    lineage: lantern                   # engines that share its code; by default the name
    version: "3.9"                     # part of a cell's identity, as is the content of this file
    command: [lantern, -t, "{threads}", -n, "{spp}", --seed, "{seed}", -o, "{image}", "{scene}"]
    scene_format: raybench             # what {scene} is: the scene's own file; or mitsuba, pbrt: exported for it
    image: exr                         # or pfm: what it writes to {image}; linear radiance
    time: process                      # from its start to its end; or by a pattern, see below
    shaders: [{name: path_tracer}]     # what it can do, under raybench's names
    samplers: [random]                 # the default
    precision: float32                 # the default
    environment: {OMP_NUM_THREADS: "{threads}"}

`command` is a list of words, given to the system as they are: no shell reads them. A program with a slash is looked for
beside the file, one without on PATH. Words and the environment's values may hold `{scene}`, `{image}`, `{folder}` (an
empty one, the working directory), `{spp}`, `{seed}`, `{threads}`, `{width}`, `{height}`, `{precision}`, `{shader}`,
`{sampler}`, and options as `{shader.max_depth}`; `{{` and `}}` are braces. `{scene}`, `{image}`, `{spp}` and `{seed}` must
occur, and `{threads}` unless `threads: n` says how many it always takes. An option of a shader or sampler that is not
passed must be at its default, or be given in the list: `shaders: [{name: path_tracer, max_depth: 8}]`.

An exported scene contains size and depth; a scene exported for Mitsuba also needs `-D spp={spp} -D seed={seed}`, as in
`configs/renderers/mitsuba.yaml`.

The clock. Every call of `render` is a separate process with a different seed. With `time: process` its time is that of the
process: start, reading the scene, building, rendering, writing. With

    time: {pattern: 'took (?P<s>[0-9.]+)s'}

its time is the one that the program prints (the last match; a group's name is its unit, us, ms, s, min or h, and the groups
that are found are added). `warm_up` then measures the start, by a process of one sample.

An image is the mean of `spp` samples, so variance is known only between calls, and is NaN after one call; halves are NaN.
Single rays are not supported. A program that fails, or whose image is missing, unreadable, of another size or not finite,
raises `RendererFailed`.
"""

from engines.peers.external.engine import Engine, Renderer

__all__ = ["Engine", "Renderer"]
