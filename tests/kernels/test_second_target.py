"""Lane functions and integrators do not depend on the machine that runs them: they compile for a GPU as they are."""

import json
import subprocess
import sys

from engines.kernels.flatten import lights, materials
from engines.kernels.flatten.shapes import ANALYTIC
from tests.needs import needs


@needs("nvvm")
def test_lane_functions_and_integrators_compile_for_a_gpu_and_have_no_float64_of_their_own():
    done = subprocess.run([sys.executable, "-m", "tests.kernels.second_target"], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    assert {name.split(".")[0] for name in found} >= {
        "path_tracer",
        "media",
        "whitted",
        "camera",
        *(shape.__name__.lower() for shape in ANALYTIC),
        "sphere",
        "plane",
        "triangle",
        *(f"bsdf {kind}" for kind in range(materials.NULL + 1)),
        *(f"light {kind}" for kind in range(lights.CYLINDER + 1) if kind != lights.IMAGE_ENVIRONMENT),
    }
    wide = {name for name, code in found.items() if code["float64"]}
    assert wide == {name for name in found if name.endswith("(float64)")}
    assert all(code["instructions"] > 2 and code["calls"] == 0 for code in found.values()), found
