"""Scenes: what they hold, read from YAML files (`load_scene`) or Python mappings (`scene_from`).

What a module of this folder has in its `__all__` is public here.
"""

from engines.scene import bsdf, cameras, lights, materials, media, mesh, models, scene, shapes, textures, triple
from engines.scene.bsdf import *
from engines.scene.cameras import *
from engines.scene.files import names_a_file
from engines.scene.flattening import flattened
from engines.scene.lights import *
from engines.scene.load import load_scene, scene_from
from engines.scene.materials import *
from engines.scene.media import *
from engines.scene.mesh import *
from engines.scene.models import *
from engines.scene.scene import *
from engines.scene.shapes import *
from engines.scene.textures import *
from engines.scene.triple import *
from engines.scene.write import save_scene

__all__ = ["flattened", "load_scene", "names_a_file", "save_scene", "scene_from"]
__all__ += bsdf.__all__
__all__ += cameras.__all__
__all__ += lights.__all__
__all__ += materials.__all__
__all__ += media.__all__
__all__ += mesh.__all__
__all__ += models.__all__
__all__ += scene.__all__
__all__ += shapes.__all__
__all__ += textures.__all__
__all__ += triple.__all__
