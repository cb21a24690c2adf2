"""A scene of raybench as a scene of Blender's, rendered by Cycles. bpy is imported when the first one is made."""

from __future__ import annotations

import contextlib
import importlib
import math
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.interface import Settings
from engines.peers.adapters import CameraFrame, FlatMesh, camera_frame, tangents
from engines.peers.adapters.geometry import placed_uvs
from engines.peers.cycles.geometry import SphereGroup, meshes_of, points_of
from engines.peers.cycles.nodes import Nodes, placed
from engines.scene import (
    DirectionalLight,
    EnvironmentLight,
    Light,
    Orthographic,
    Perspective,
    Plane,
    PointLight,
    Scene,
    SpotLight,
    ThinLens,
)

SENSOR = 36.0
"""Width of the sensor in millimetres: Blender has focal lengths and sensors in place of angles."""
MOST_SAMPLES = 1 << 24
"""Of a pixel's sequence, which `sample_offset` and `sample_subset_length` cut into calls."""
MOST_BOUNCES = 1024
EVEN_SKY = 16
"""Columns of the map by which Cycles samples a constant environment."""

_captured: dict[str, Any] = {}


class BlenderScene:
    """Blender's data of one scene, until `free`. Several can live beside each other in a process."""

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self.bpy = _blender()
        self.data = self.bpy.data
        self.size = settings.size(scene)
        self.seconds = 0.0  # that Cycles itself took to render
        self.made: list[Any] = []
        self.scene = self.data.scenes.new("raybench")
        self.scene.render.engine = "CYCLES"
        materials = [self._material(scene, index, settings) for index in range(len(scene.materials))]
        for mesh in meshes_of(scene):
            self._mesh(mesh, materials, placed(scene.materials[mesh.material]))
        for group in points_of(scene):
            self._points(group, materials)
        for light in scene.lights:
            self._light(light)
        self._camera(scene, camera_frame(scene, settings))
        self._settings(settings)

    def render(self, spp: int, offset: int, seed: int) -> NDArray[np.float32]:
        """(h, w, 3) the mean of samples `offset` to `offset` + `spp` of every pixel's sequence."""
        cycles = self.scene.cycles
        cycles.seed, cycles.sample_offset, cycles.sample_subset_length = seed, offset, spp
        self.scene.update_tag()  # or the session that is kept takes the numbers of its first render
        self.bpy.ops.render.render(scene=self.scene.name)
        self.seconds += _captured["seconds"]
        width, height = self.size
        return _captured.pop("pixels").reshape(height, width, 4)[::-1, :, :3]

    def free(self) -> None:
        """Removes from Blender what was made for the scene."""
        self.data.batch_remove([*self.made, self.scene])

    # ---- what is in it -----------------------------------------------------------------------------------------------

    def _material(self, scene: Scene, index: int, settings: Settings) -> Any:
        given = scene.materials[index]
        made = self._kept(self.data.materials.new(given.name))
        with _nodes(made) as tree:
            Nodes(tree, placed(given)).surface(given, scatters=settings.shader.options["max_depth"] > 1)
        sampled = given.emits and not any(isinstance(shape, Plane) and shape.material == index for shape in scene.shapes)
        sides = "FRONT_BACK" if given.two_sided else "FRONT"
        made.cycles.emission_sampling = sides if sampled else "NONE"
        return made

    def _object(self, name: str, data: Any) -> Any:
        made = self._kept(self.data.objects.new(name, self._kept(data)))
        self.scene.collection.objects.link(made)
        made.shadow_terminator_geometry_offset = made.shadow_terminator_shading_offset = 0.0
        return made

    def _mesh(self, given: FlatMesh, materials: list[Any], textures: tuple[Any, ...]) -> None:
        mesh, count = self.data.meshes.new(given.name), len(given.faces)
        mesh.vertices.add(len(given.vertices))
        mesh.vertices.foreach_set("co", given.vertices.astype(np.float32).ravel())
        mesh.loops.add(3 * count)
        mesh.loops.foreach_set("vertex_index", given.faces.ravel())
        mesh.polygons.add(count)
        mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
        mesh.polygons.foreach_set("use_smooth", np.full(count, given.normals is not None))
        mesh.update()
        if given.normals is not None:
            _attribute(mesh, "custom_normal", "FLOAT_VECTOR", "vector", given.normals)
        for index, texture in enumerate(textures):
            assert given.uvs is not None
            uv = placed_uvs(given.uvs, texture)
            _attribute(mesh, f"uv{index}", "FLOAT_VECTOR", "vector", np.column_stack([uv, np.zeros(len(uv))]))
        mesh.materials.append(materials[given.material])
        self._object(given.name, mesh)

    def _points(self, group: SphereGroup, materials: list[Any]) -> None:
        """Python cannot make points but from the vertices of a mesh, by nodes."""
        mesh = self.data.meshes.new("spheres")
        mesh.vertices.add(len(group.radii))
        mesh.vertices.foreach_set("co", group.centers.astype(np.float32).ravel())
        _attribute(mesh, "radius", "FLOAT", "value", group.radii)
        tree = self._kept(self.data.node_groups.new("points", "GeometryNodeTree"))
        for direction in ("INPUT", "OUTPUT"):
            tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
        begin, radius, points, painted, end = (
            tree.nodes.new(kind)
            for kind in (
                "NodeGroupInput",
                "GeometryNodeInputNamedAttribute",
                "GeometryNodeMeshToPoints",
                "GeometryNodeSetMaterial",
                "NodeGroupOutput",
            )
        )
        radius.inputs["Name"].default_value = "radius"
        painted.inputs["Material"].default_value = materials[group.material]
        for output, node, input in (
            (begin.outputs[0], points, "Mesh"),
            (radius.outputs["Attribute"], points, "Radius"),
            (points.outputs[0], painted, "Geometry"),
            (painted.outputs[0], end, 0),
        ):
            tree.links.new(output, node.inputs[input])
        self._object("spheres", mesh).modifiers.new("points", "NODES").node_group = tree

    def _light(self, light: Light) -> None:
        if isinstance(light, EnvironmentLight):
            self.scene.world = self._kept(self.data.worlds.new("environment"))
            with _nodes(self.scene.world) as tree:
                Nodes(tree).world(light)
            if light.image is None:
                sampling = self.scene.world.cycles
                sampling.sampling_method, sampling.sample_map_resolution = "MANUAL", EVEN_SKY
            return
        assert isinstance(light, PointLight | SpotLight | DirectionalLight)
        sun = isinstance(light, DirectionalLight)
        color = light.irradiance if sun else light.intensity
        made = self.data.lights.new("light", "SUN" if sun else "POINT")
        largest = max(*color, 1e-30)
        made.color = np.divide(color, largest)
        made.energy = largest if sun else 4.0 * math.pi * largest
        if sun:
            made.angle = 0.0
        else:
            made.shadow_soft_size = 0.0
        if isinstance(light, SpotLight):
            with _nodes(made) as tree:
                Nodes(tree).spot(light)
        placing = np.eye(4)
        if sun:
            back = -np.array(light.direction)
            placing[:3, :3] = np.stack([*tangents(back), back], axis=1)
        else:
            placing[:3, 3] = light.position
        self._object("light", made).matrix_world = placing.T

    def _camera(self, scene: Scene, frame: CameraFrame) -> None:
        camera, given = self.data.cameras.new("camera"), scene.camera
        left, right, bottom, top = frame.window
        width = right - left
        camera.sensor_fit, camera.sensor_width = "HORIZONTAL", SENSOR
        camera.shift_x, camera.shift_y = (left + right) / (2.0 * width), (bottom + top) / (2.0 * width)
        assert isinstance(given, Perspective | ThinLens | Orthographic)
        camera.clip_start, camera.clip_end = given.clip
        if isinstance(given, Orthographic):
            camera.type, camera.ortho_scale = "ORTHO", width
        else:
            camera.lens = SENSOR / width
        if isinstance(given, ThinLens) and given.aperture_radius > 0.0:
            camera.dof.use_dof, camera.dof.focus_distance = True, given.focus_distance
            camera.dof.aperture_fstop = 1e-3 * camera.lens / (2.0 * given.aperture_radius)
        placing = np.eye(4)
        placing[:3] = np.stack([frame.right, frame.up, -frame.forward, frame.origin], axis=1)
        self.scene.camera = self._object("camera", camera)
        self.scene.camera.matrix_world = placing.T

    def _settings(self, settings: Settings) -> None:
        render, cycles, path = self.scene.render, self.scene.cycles, settings.shader.options
        render.resolution_x, render.resolution_y = self.size
        render.resolution_percentage = 100
        render.threads_mode, render.threads = "FIXED", settings.threads
        render.use_persistent_data = True  # or every render builds anew
        render.use_compositing = render.use_sequencer = False
        cycles.device = "CPU"
        cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
        cycles.samples, cycles.use_sample_subset = MOST_SAMPLES, True
        cycles.sampling_pattern = "TABULATED_SOBOL"
        cycles.use_light_tree = path["light_sampler"] == "bvh"
        for key in ("use_adaptive_sampling", "use_denoising", "use_guiding", "use_auto_tile"):
            setattr(cycles, key, False)
        for key in ("light_sampling_threshold", "blur_glossy", "sample_clamp_direct", "sample_clamp_indirect", "time_limit"):
            setattr(cycles, key, 0.0)
        cycles.caustics_reflective = cycles.caustics_refractive = True
        bounces = max(0, path["max_depth"] - 2)
        for kind in ("max", "diffuse", "glossy", "transmission"):
            setattr(cycles, f"{kind}_bounces", bounces)
        cycles.transparent_max_bounces = MOST_BOUNCES
        cycles.min_light_bounces = cycles.min_transparent_bounces = min(max(0, path["rr_depth"] - 2), MOST_BOUNCES)
        cycles.film_exposure = 1.0

    def _kept(self, made: Any) -> Any:
        self.made.append(made)
        return made


def _attribute(mesh: Any, name: str, kind: str, field: str, values: NDArray[np.float64]) -> None:
    mesh.attributes.new(name, kind, "POINT").data.foreach_set(field, values.astype(np.float32).ravel())


@contextlib.contextmanager
def _nodes(owner: Any) -> Any:
    if owner.node_tree is None:
        owner.use_nodes = True
    yield owner.node_tree


def _blender() -> Any:
    """bpy with nothing in it, and with the pixels of every render of Cycles captured."""
    bpy: Any = importlib.import_module("bpy")
    if not _captured:
        _captured["installed"] = True
        bpy.ops.wm.read_factory_settings(use_empty=True)
        addon: Any = importlib.import_module("cycles.engine")
        native = addon.render

        def render(engine: Any, depsgraph: Any) -> None:
            begin = perf_counter()
            native(engine, depsgraph)
            _captured["seconds"] = perf_counter() - begin
            combined = engine.get_result().layers[0].passes["Combined"]
            pixels = np.empty(engine.resolution_x * engine.resolution_y * 4, np.float32)
            combined.rect.foreach_get(pixels)
            _captured["pixels"] = pixels

        addon.render = render
    return bpy
