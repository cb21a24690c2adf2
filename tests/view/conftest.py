"""A folder with a small scene, and a viewer on it for each test file, so that no render continues beside other tests.

The numpy engine renders, so nothing is compiled.
"""

from pathlib import Path

import pytest

from tests.view.viewer_process import SCENE, Viewer


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("viewed")
    (made / "ball.yaml").write_text(SCENE)
    (made / "bad.yaml").write_text(SCENE.replace("kd: 0.7", "kd: 1.7"))
    (made / "deep").mkdir()
    (made / "deep/other.yaml").write_text(SCENE.replace("a ball", "another ball"))
    return made


@pytest.fixture(scope="module")
def viewer(folder):
    with Viewer(folder, "ball.yaml", "--engine", "numpy") as running:
        yield running
