"""What pages have from the code is written into them, and is the same on every machine."""

import sys
from importlib.metadata import EntryPoint

import pytest

from docs._ext.reference import MARK, filled
from engines import registry
from tests.docs.pages import TEXT

SAYS = {
    "command_line": ("raybench race SCENE... [OPTIONS]", "--set KEY=VALUE", "Samples per pixel."),
    "experiment": ("budget", "certify", "in [1, 1000]"),
    "scene": ("sphereflake", "tessellated_sphere", "two_sided", "sigma_t", "degrees"),
    "renderer": ("raybench_renderer: 1", "`{scene}`"),
    "names": ("path_tracer", "embreex_batch", "rr_depth", "leaf_size", "aces", "Cycles on the CPU"),
    "columns": ("time_to_quality", "warm_seconds", "relmse_corrected"),
    "api": ("`engines.load_scene`", "`engines.scene.lights.SpotLight`", "(../../engines/scene/lights.py)"),
    "api/conformance": ("stop_from_a_thread_ends_the_render",),
    "api/plugin": ("autofunction:: engines.plugin.select",),
}


def test_what_pages_have_from_the_code_is_up_to_date():
    assert [page for page, text in TEXT.items() if filled(text) != text] == [], "run make reference"


@pytest.mark.parametrize("page", SAYS)
def test_the_reference_is_made_from_the_code(page):
    made = "".join(mark[3] or "" for mark in MARK.finditer(TEXT[f"docs/reference/{page}.md"]))
    assert [word for word in SAYS[page] if word not in made] == []


@pytest.mark.parametrize("page", ["docs/reference/names.md", "docs/reference/experiment.md"])
def test_what_is_installed_or_set_here_changes_nothing(page, monkeypatch):
    other = EntryPoint("foreign", "engines.numpy_reference:Engine", registry.GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [other])
    monkeypatch.setenv("RAYBENCH_MITSUBA_PYTHON", "/nowhere")
    for package in ("mitsuba", "drjit", "pyluxcore", "open3d", "flip_evaluator"):
        monkeypatch.setitem(sys.modules, package, None)
    assert filled(TEXT[page]) == TEXT[page]


def test_an_outdated_text_is_written_anew_and_the_rest_stays():
    page = "a\n<!-- generated: tone mappers -->\nold\n<!-- end -->\nb\n<!-- generated: reports -->\nc\n"
    assert filled(page) == page.replace("old", "\n`linear`, `srgb`, `reinhard`, `aces`.\n")
