"""The pages hang together, and the site builds without a warning, opens from disk and fits every width."""

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.docs.blocks import FENCE, ROOT
from tests.docs.pages import FRONT, PAGES, TEXT

DOCS = ROOT / "docs"
LINK = re.compile(r"!?\[[^\]]*\]\(<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\)")
WIDE = ("index", "how/verdicts", "reference/names", "reference/experiment", "reference/api", "reference/api/interface")
"""Pages with pictures, formulas, wide tables and long signatures."""
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```", re.MULTILINE | re.DOTALL)


def links(page: str) -> list[str]:
    """What a page links to or shows, outside of its blocks and code."""
    return LINK.findall(re.sub(r"`[^`\n]*`", "", FENCE.sub("", TEXT[page])))


@pytest.mark.parametrize("page", TEXT)
def test_what_a_page_links_to_and_shows_is_there(page):
    lost = []
    for link in links(page):
        parts = urlsplit(link)
        if parts.scheme:
            good = parts.scheme == "https" and "." in parts.netloc
        else:
            good = not parts.path or (ROOT / page).parent.joinpath(parts.path).exists()
        lost += [] if good else [link]
    assert lost == []


def test_every_page_is_in_one_table_of_contents():
    listed, pages = [], PAGES[len(FRONT) :]
    for page in pages:
        for tree in TOCTREE.findall(page.read_text()):
            names = [line for line in tree.splitlines() if line and not line.startswith(":")]
            listed += [(page.parent / f"{name}.md").resolve() for name in names]
    assert sorted(listed) == sorted({*pages} - {DOCS / "index.md"})


def test_every_picture_is_shown():
    shown = {(ROOT / page).parent.joinpath(link).resolve() for page in TEXT for link in links(page)}
    pictures = {path for path in DOCS.glob("pictures/**/*") if path.suffix in (".png", ".svg")}
    assert pictures - shown == set()


@pytest.mark.parametrize("page", TEXT)
def test_no_line_is_hidden_as_a_comment(page):
    lines = FENCE.sub("", TEXT[page]).splitlines()
    assert [line for line in lines if line.lstrip().startswith("%")] == [], "MyST leaves out lines that begin with %"


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site, built as `make docs` builds it."""
    folder = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", str(folder / "trees"), str(DOCS)]
    done = subprocess.run([*build, str(folder / "html")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "html"


def test_the_site_needs_no_network(site):
    fetched = re.compile(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=\"(?:https?:)?//[^\"]*\"|@import|url\(['\"]?https?:")
    files = [path for path in site.rglob("*") if path.suffix in (".html", ".css")]
    assert [f"{path.name}: {each}" for path in files for each in fetched.findall(path.read_text())] == []


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("reference/names", ("path_tracer", "embreex_batch", "rr_depth", "leaf_size", "aces", "Cycles on the CPU")),
        ("reference/api/interface", ("occluded(", "NDArray[float64]")),
        ("reference/api/plugin", ("engines.plugin.select", "engines.plugin.cosine_direction")),
    ],
)
def test_the_site_has_the_reference(site, page, words):
    text = re.sub(r"<[^>]*>", "", (site / f"{page}.html").read_text()).replace("\N{NO-BREAK SPACE}", " ")
    assert [word for word in words if word not in text] == []


def test_reports_of_committed_results_are_pages_that_one_page_lists(site):
    assert 'href="reports/baseline.html"' in (site / "reports.html").read_text()
    assert '<table class="matrix">' in (site / "reports" / "baseline.html").read_text()


@pytest.mark.parametrize("page", ["reports", "dissertation"])
def test_the_chapter_is_a_page_that_others_link_to(site, page):
    assert 'href="reports/chapter.html"' in (site / f"{page}.html").read_text()
    assert "Threats to validity" in (site / "reports" / "chapter.html").read_text()


@pytest.mark.parametrize("page", WIDE)
def test_nothing_sticks_out_sideways(site, browser, page):
    for width in (390, 1400):
        browser.open(site / f"{page}.html", width=width, dark=width == 390)
        assert browser.evaluate("document.documentElement.scrollWidth") <= width


def test_pages_from_disk_ask_for_nothing_else_and_search_finds(site, browser):
    browser.open(site / "search.html")
    browser.page.fill(".sidebar-search", "stratified")
    browser.press("Enter")
    # Sphinx appends the pages found one by one.
    browser.wait_for("document.querySelector('#search-results').innerText.includes('Engines, shaders, samplers')")
    assert browser.problems == []
    assert {url for url in browser.requests if not url.startswith(("data:", "file:"))} == set()
