"""Every BSDF in one exported file, with textures, a lens and a cylinder: Mitsuba renders it as it renders the description."""

import subprocess
import sys

import numpy as np

from engines import Settings
from engines.peers.export import export
from engines.peers.mitsuba import ScalarEngine, engine
from engines.scene import Cylinder, EnvironmentLight, Material, Mesh, Scene, Sphere, ThinLens
from tests.mitsuba.test_description import MODELS
from tests.needs import needs

pytestmark = needs("mitsuba-scalar")

SIDE, SPP, SECONDS = 16, 16, 60
RENDER = """
import mitsuba, numpy, sys
mitsuba.set_variant("scalar_rgb")
image = mitsuba.render(mitsuba.load_file(sys.argv[1]), spp=int(sys.argv[2]))
numpy.save(sys.argv[3], numpy.array(image)[..., :3])
"""


def test_mitsuba_renders_every_model_of_an_exported_file_in_bounded_time(tmp_path, monkeypatch):
    corners = np.array([[-9, -2, -9], [9, -2, -9], [9, -2, 9], [-9, -2, 9]], float)
    faces, uvs = np.array([[0, 2, 1], [0, 3, 2]], np.int32), np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    floor = Mesh(corners, faces, np.full(2, 2, np.int32), uvs=uvs)
    spheres = [Sphere((2.2 * (i % 5) - 4.4, 2.2 * (i // 5) - 3.0, 0.0), 1.0, i) for i in range(len(MODELS))]
    sky = EnvironmentLight((1.0, 1.0, 1.0), np.random.default_rng(1).random((4, 8, 3)), rows="poles")
    lens = ThinLens((0.0, 2.0, 14.0), (0.0, 0.5, 0.0), (0.0, 1.0, 0.0), 50.0, "y", (SIDE, SIDE), 0.05, 14.0)
    shapes = (*spheres, floor, Cylinder((-6.0, -2.0, 1.0), (-6.0, 2.0, 1.0), 0.5, 6))
    scene = Scene("all", lens, tuple(Material(f"m{i}", bsdf=m) for i, m in enumerate(MODELS)), shapes, (sky,), "")
    file = export(scene, "mitsuba", tmp_path / "all.xml", max_depth=5)
    assert len(list(tmp_path.glob("all_files/texture_*.exr"))) >= 3
    image = tmp_path / "image.npy"
    subprocess.run([sys.executable, "-c", RENDER, file, str(SPP), image], check=True, timeout=SECONDS)
    monkeypatch.setattr(engine, "_blends_lack", lambda scene: None)  # the file has Mitsuba's own blends, so this must, too
    settings = Settings(shader={"name": "path_tracer", "max_depth": 5, "rr_depth": 1000}, sampler="random", seed=3)
    ours = ScalarEngine().prepare(scene, settings).render(SPP).mean()
    assert np.allclose(np.load(image).mean(axis=(0, 1)), ours.mean(axis=(0, 1)), rtol=0.04)
