"""A folder with a small scene, a viewer on it, and pages in a browser, which end with their file: what they render would go
on beside other tests. Nothing here compiles: the numpy engine renders."""

from pathlib import Path

import pytest

from tests.harness.chromium import PROGRAM
from tests.view.driving import SCENE, Page, Viewer


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


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if PROGRAM is None:
        pytest.skip("Chromium is not installed")
    with Page(tmp_path_factory.mktemp("profile")) as browser:
        yield browser
