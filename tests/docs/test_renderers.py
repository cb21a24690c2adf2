"""The figures of pages are those of the committed archives, and so is every number in the prose about them."""

import importlib.util
import re

import pytest

from tests.docs.blocks import FENCE, ROOT
from tests.docs.pages import TEXT

SPEC = importlib.util.spec_from_file_location("page_figures", ROOT / "docs" / "figures.py")
figures = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(figures)

RENDERERS = "docs/renderers.md"
PAGES = [page for page, text in TEXT.items() if figures.MARK.search(text)]
NUMBER = re.compile(r"(?<![\w.-])\d+(?:,\d{3})*(?:\.\d+)?(?!\w)")
VERSIONS = re.compile(r"(?:Mitsuba|Python) [\d.]*\d")
"""Names, no figures."""


@pytest.fixture(scope="module")
def race():
    return figures.Race(ROOT / "results" / "renderers")


@pytest.fixture(scope="module")
def makers(race):
    return {"renderers": lambda words: figures.renderers(race, words)}


@pytest.fixture(scope="module")
def known(race):
    """Every number that the tables of the archive show, or pages have from it."""
    tables = [path.read_text(encoding="utf-8") for path in (ROOT / "results" / "renderers" / "tables").glob("*.md")]
    words = ([f"{target:g}"] for target in race.targets)
    made = [figures.renderers(race, each) for each in (["first"], ["biased"], ["race"], *words)]
    return {number for text in (*tables, *made) for number in NUMBER.findall(text)}


def prose(text):
    """A page without its figures, code, links' addresses and comments."""
    text = VERSIONS.sub("", FENCE.sub("", figures.MARK.sub("", text)))
    return re.sub(r"`[^`\n]*`|\]\([^)]*\)|<!--.*?-->", " ", text)


@pytest.mark.parametrize("page", PAGES)
def test_the_figures_of_a_page_are_those_of_the_archive(page, makers):
    assert figures.filled(TEXT[page], makers) == TEXT[page], "run make figures"


def test_the_archive_bears_out_what_the_page_of_renderers_claims(race):
    figures.claims(race)


@pytest.mark.parametrize("page", PAGES)
def test_every_number_in_the_prose_is_in_the_archive(page, known):
    numbers = NUMBER.findall(prose(TEXT[page]))
    if page != RENDERERS:
        numbers = [number for number in numbers if "." in number]
    assert [number for number in numbers if number not in known] == []


def test_the_page_of_renderers_has_its_figures_from_the_archive():
    assert RENDERERS in PAGES
    assert {"first", "biased", "race"} <= {words.partition(" ")[2] for _, words, *_ in figures.MARK.findall(TEXT[RENDERERS])}


def test_a_figure_stands_in_a_sentence_or_between_lines(makers):
    one = "It takes <!-- figures: renderers study 0.01 numba --><!-- end --> there."
    table = "a\n\n<!-- figures: renderers 0.01 brief -->\n<!-- end -->\n\nb\n"
    for page in (one, table):
        made = figures.filled(page, makers)
        assert made != page and figures.filled(made, makers) == made
    assert re.fullmatch(r"It takes <!--[^>]*-->[\d.]+ s \[[\d.]+, [\d.]+\]<!-- end --> there.", figures.filled(one, makers))
    assert "\n\n| scene |" in figures.filled(table, makers)


def test_an_unknown_figure_is_refused(makers):
    with pytest.raises(ValueError, match="see the top"):
        figures.filled("<!-- figures: renderers no such words here --><!-- end -->", makers)


def test_every_entry_of_the_bibliography_is_cited():
    entries = re.findall(r"^- ([^:\n]*?)(?: \d{4})?:", TEXT["docs/reference/bibliography.md"], re.MULTILINE)
    sources = [path for folder in ("engines", "harness", "tests") for path in (ROOT / folder).rglob("*.py")]
    texts = [text for page, text in TEXT.items() if page != "docs/reference/bibliography.md"]
    everything = "\n".join([*texts, *(path.read_text(encoding="utf-8") for path in sources)])
    assert len(entries) > 50
    assert [name for name in entries if name not in everything] == []


def test_numbers_of_prose_are_found_without_those_of_code_links_and_figures():
    page = "Mitsuba 3 takes 0.1234 s, 1,200 paths ([why](a2.md#b-5)), `7` and <!-- figures: renderers first -->8<!-- end -->."
    assert NUMBER.findall(prose(page)) == ["0.1234", "1,200"]
