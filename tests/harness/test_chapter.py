"""The chapter says what the numbers say: its tables are theirs, and claims that they do not bear out fail."""

import importlib.util
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from engines.errors import ConfigError
from harness.analysis import analyse
from harness.cli import results
from harness.report.chapter import Facts, figures, filled, write_chapter
from harness.report.chapter.document import Chapter, Listing, Paragraph, Section, html, latex, markdown
from harness.statistics import Estimate
from harness.store.results import load_results
from tests.harness.synthetic import Size, base_cell, manifest, metrics

SIZE = Size(20, 10)
SPP = (1, 4, 16)
COMMITTED = Path(__file__).resolve().parents[2] / "results" / "dissertation"


def cell(
    accelerator, seconds, *, block, scene="hall", threads=2, shader="path_tracer", sampler="sobol", error=0.01, label=None
):
    """A measured cell: `seconds` a sample, `error` at the last checkpoint."""
    made = base_cell((scene, "numba", accelerator, sampler, threads, label), block, SIZE) | {"shader": {"name": shader}}
    made["cell_id"] = "-".join(map(str, (scene, accelerator, sampler, threads, shader, block, bool(label))))
    made["primitives"], made["phases"] = 1234, {"build_seconds": 0.002}
    made["points"] = [
        {
            "spp": spp,
            "seconds": spp * seconds,
            "rays": spp * (2000 if shader == "whitted" else 9000),
            "metrics": metrics(error * SPP[-1] / spp),
            "image": None,
        }
        for spp in SPP
    ]
    return made


@pytest.fixture
def undrawn(monkeypatch):
    """Spares the drawing, which takes most of the time, where only words are looked at."""
    monkeypatch.setattr(figures, "save", lambda figure, plots, name, formats: "<svg></svg>")


def folder_of(path, cells):
    path.mkdir()
    events = [{"event": "targets", "metric": "relmse_e0.01", "targets": [0.1, 0.05]}, *cells]
    (path / "manifest.json").write_text(json.dumps(manifest()))
    (path / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    return path


def wobble(block):
    """What a block does to all its cells, and a little of its own."""
    return 1.0 + 0.05 * block


def chapter(tmp_path, cells, name="results"):
    folder = folder_of(tmp_path / name, with_twins(cells))
    written = write_chapter([folder], tmp_path / f"{name}-chapter")
    assert [path.name for path in written] == ["chapter.md", "chapter.tex", "chapter.html"]
    return written[0].read_text().replace("\\", "")


def with_twins(cells):
    """With an A/A twin of the scene that is as good as equal."""
    first = [made for made in cells if made["cell_id"].rsplit("-", 2)[0] == cells[0]["cell_id"].rsplit("-", 2)[0]]
    return cells + [made | {"label": "A/A", "cell_id": made["cell_id"] + "-twin"} for made in first]


def accelerators(bvh, grid, noise=0.002):
    return [
        made
        for block in range(4)
        for made in (
            cell("bvh", bvh * wobble(block), block=block),
            cell("grid", grid * wobble(block) * (1 + noise * (-1) ** block), block=block),
        )
    ]


@pytest.mark.usefixtures("undrawn")
def test_turned_numbers_turn_the_tables(tmp_path):
    one = chapter(tmp_path, accelerators(0.01, 0.02), "one")
    other = chapter(tmp_path, accelerators(0.02, 0.01), "other")
    tie = chapter(tmp_path, accelerators(0.01, 0.01, noise=0.1), "tie")
    assert re.search(r"\| hall \|.*\| numba bvh \|\n", one) and re.search(r"\| hall \|.*\| numba grid \|\n", other)
    assert re.search(r"\| numba (bvh and numba grid|grid and numba bvh) \|\n", tie), "both may be the fastest"


@pytest.mark.usefixtures("undrawn")
def test_threads_are_credited_with_what_they_gave(tmp_path):
    text = chapter(tmp_path, threads())
    assert re.search(r"\| hall \| 1\.60 \[1\.\d+, 1\.\d+\] \| 0\.800 \|", text)
    assert "Accelerators" not in text and "Samplers" not in text, "what was not varied is left out"


def threads():
    return [
        cell("bvh", 0.02 * wobble(b) / share * (1 + 0.001 * b), block=b, threads=n)
        for b in range(4)
        for n, share in ((1, 1.0), (2, 1.6))
    ]


@pytest.mark.usefixtures("undrawn")
def test_builds_are_those_of_a_warm_process(tmp_path):
    made = accelerators(0.01, 0.02)
    assert "Milliseconds of a build" not in chapter(tmp_path, made, "without"), "the first build is none"
    for each in made:
        seconds = {"bvh": 0.004, "grid": 0.003}[each["accelerator"]["name"]]
        each["phases"] = {"build_seconds": 0.05, "warm_build_seconds": seconds}
    assert re.search(r"\| hall \| 1234 \| 4\b[^|]* \| 3\b[^|]* \|", chapter(tmp_path, made, "with"))


@pytest.mark.usefixtures("undrawn")
def test_the_worst_pixels_share_of_the_error_is_told(tmp_path):
    made: list[dict[str, Any]] = accelerators(0.01, 0.02)
    for each in made:
        each["points"] = [point | {"metrics": {"relmse_e0.01": 2.0, "relmse_e0.01_trimmed": 0.5}} for point in each["points"]]
    # One of 200 pixels is what 0.1 % rounds up to: the others hold 0.5 * 199 of 2 * 200.
    assert re.search(r"\| hall \| path_tracer \| 16 \| 2 \| 0\.500 \| 75\.1 % \|", chapter(tmp_path, made))


@pytest.mark.usefixtures("undrawn")
def test_what_did_not_run_is_said(tmp_path):
    broken = base_cell(("hall", "numba", "none", "sobol", 2, None), 0, SIZE) | {
        "state": "failed",
        "message": "out of rods",
        "shader": {"name": "path_tracer"},
    }
    text = chapter(tmp_path, [*accelerators(0.01, 0.02), broken])
    assert "numba brute force on hall: failed, out of rods." in text and "Of 13 cells, 12 done and 1 failed." in text


# ---- a text of one's own ---------------------------------------------------------------------------------------------


def composed(tmp_path, cells, text, usual=(), **values):
    """The Markdown of a chapter of the template `text`, about `cells`."""
    folder = tmp_path / "results"
    if not folder.exists():
        folder_of(folder, with_twins(cells))
    (tmp_path / "text.md").write_text(text)

    def compose(analyses, sections):
        facts = Facts(analyses, usual)
        functions = {name: getattr(facts, name) for name in dir(facts) if not name.startswith("_")}
        return filled(tmp_path / "text.md", functions | values, sections)

    return write_chapter([folder], tmp_path / "chapter", compose)[0].read_text().replace("\\", "")


def facts_of(tmp_path, cells, usual=()):
    return Facts([analyse(load_results(folder_of(tmp_path / "results", with_twins(cells))))], usual)


TEXT = """{# not shown #}
# A chapter

## Speed

[table accelerators]

On hall the tree is faster than the grid, by {{ speedup("hall",
"numba bvh", "numba grid") }}. That is all.

- It takes {{ 2 * 3 }} words.
- It has {{ primitives("hall, numba bvh") }} primitives
  and {{ half }}.
"""


@pytest.mark.usefixtures("undrawn")
def test_a_text_holds_the_numbers_of_the_results(tmp_path):
    text = composed(tmp_path, accelerators(0.01, 0.02), TEXT, ("sobol",), half=0.5)
    assert text.startswith("# A chapter\n\n## Speed\n\n### Samples per second") and "not shown" not in text
    assert "On hall the tree is faster than the grid, by 2.00 (1.97 to 2.03). That is all." in text
    assert "- It takes 6 words.\n- It has 1,234 primitives and 0.500.\n" in text and "{{" not in text


def test_claims_hold_only_where_the_results_bear_them_out(tmp_path):
    facts = facts_of(tmp_path, accelerators(0.02, 0.01))
    grid, bvh = (facts.speedup("hall", *pair) for pair in (("numba grid", "numba bvh"), ("numba bvh", "numba grid")))
    assert grid.better and not bvh.better and bvh.greatest < 1 < grid.least
    assert bvh.verdicts == "worse on hall, 0.500 (0.492 to 0.508)" and grid.verdicts.startswith("better on hall, 2.00 (")
    assert facts.fastest("hall", "numba grid") and not facts.fastest(["hall"], "numba bvh")


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("code", "problem"),
    [
        ("speed(", "text.md:5: unexpected"),
        ("quicker('hall')", "text.md:5: 'quicker' is undefined"),
        ("speed('attic')", "text.md:5: 'attic' names no configurations: one is expected"),
        ("speed('hall')", "'hall' names 2 configurations (numba bvh; numba grid): one is expected"),
        ("speedup('hall', 'numba bvh', 'embree')", "'hall' with numba bvh and embree names no comparisons"),
        ("speed()", "missing 1 required positional argument"),
        ("1 / 0", "division by zero"),
        ("build('hall, numba bvh')", "text.md:5: the results have no number for it"),
    ],
)
def test_what_a_text_cannot_ask_is_a_message(tmp_path, code, problem):
    with pytest.raises(ConfigError, match=re.escape(problem)):
        composed(tmp_path, accelerators(0.01, 0.02), f"# A\n\n## B\n\nIt is {{{{ {code} }}}}.\n")


@pytest.mark.usefixtures("undrawn")
def test_an_unknown_table_and_an_unreadable_file_are_messages(tmp_path):
    with pytest.raises(ConfigError, match=r"text.md: .*no figure 'speed'"):
        composed(tmp_path, accelerators(0.01, 0.02), "# A\n\n## B\n\n[figure speed]\n")
    with pytest.raises(ConfigError, match=r"none.md: "):
        filled(tmp_path / "none.md", {}, [])


def test_samplers_are_compared_by_error_and_by_time(tmp_path):
    made = [
        cell("bvh", 0.01 * wobble(b), block=b, sampler=s, error=e * (1 + 0.01 * (-1) ** (b + i)))
        for b in range(4)
        for i, (s, e) in enumerate((("random", 0.03), ("sobol", 0.01)))
    ]
    facts = facts_of(tmp_path, made)
    errors = facts.error_ratio("hall", "sobol", "random")
    assert errors.better and not facts.error_ratio("hall", "random", "sobol").better
    assert re.fullmatch(r"3\.00 \(2\.\d+ to 3\.\d+\)", str(errors))
    assert facts.time_ratio("hall", "sobol", "random").better
    assert next(iter(facts.speedup("hall", "sobol", "random").ratios.values())).verdict == "same"


ODD = Chapter("50 % & <more>", [Section("A_b", [Paragraph(["x < y & z_1 is 5 %."]), Listing(["# *one*"])])])


def test_every_language_escapes_what_it_must():
    assert "x < y & z\\_1" in markdown(ODD).replace("\\<", "<") and "\\*one\\*" in markdown(ODD)
    text = latex(ODD)
    assert r"\chapter{50 \% \& \textless{}more\textgreater{}}" in text and r"\# *one*" in text and r"z\_1 is 5 \%" in text
    page = html(ODD)
    assert "<title>50 % &amp; &lt;more&gt;</title>" in page and "x &lt; y &amp; z_1" in page


class Balance(HTMLParser):
    """Fails where an end tag closes something else than the last open one."""

    VOID = frozenset(("meta", "path", "use", "br", "img"))

    def __init__(self, text):
        super().__init__()
        self.open, self.ids = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.ids += [value for key, value in attrs if key == "id"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.ids += [value for key, value in attrs if key == "id"]

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


def test_the_page_is_whole_and_the_figures_are_files(tmp_path):
    chapter(tmp_path, accelerators(0.01, 0.02))
    target = tmp_path / "results-chapter"
    page = (target / "chapter.html").read_text()
    balance = Balance(page)
    assert balance.open == [] and len(balance.ids) == len(set(balance.ids)) and "data:image/svg+xml;" in page
    assert not re.search(r"""(src|href)=["']https?:""", page)
    text = (target / "chapter.tex").read_text()
    figures = re.findall(r"\\includegraphics\[[^]]*\]\{([^}]*)\}", text)
    assert figures and all((target / "plots" / name).stat().st_size > 1000 for name in figures)
    assert text.count("\\begin{") == text.count("\\end{") and "\\begin{tabular}" in text
    linked = re.findall(r"\]\((plots/[^)]*)\)", (target / "chapter.md").read_text())
    assert linked and all((target / name).exists() for name in linked)


def test_two_folders_make_two_sections_with_figures_of_their_own(tmp_path):
    first, second = (folder_of(tmp_path / name, accelerators(0.01, 0.02)) for name in "ab")
    text = write_chapter([first, second], tmp_path / "both")[0].read_text()
    assert text.count("\n## ") == 2
    linked = re.findall(r"\]\((plots/[^)]*)\)", text)
    assert len(set(linked)) == len(linked) and all((tmp_path / "both" / name).exists() for name in linked)


def test_a_chapter_needs_results(tmp_path):
    with pytest.raises(ConfigError, match="nowhere: no such folder"):
        write_chapter([tmp_path / "nowhere"], tmp_path / "none")
    with pytest.raises(ConfigError, match="a results folder is missing"):
        results.chapter([], tmp_path / "out")
    with pytest.raises(ConfigError, match="a results folder is missing"):
        results.report([])
    folder = folder_of(tmp_path / "results", accelerators(0.01, 0.02))
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="is a file"):
        results.chapter([folder], tmp_path / "file")


def test_samplers_whose_curves_are_read_differently_are_not_separated_by_the_reading(tmp_path):
    same = [
        cell("bvh", 0.01 * wobble(b) * (1 + 0.001 * (-1) ** b), block=b, sampler=sampler)
        for b in range(4)
        for sampler in ("sobol", "random")
    ]
    times = facts_of(tmp_path, same).time_ratio("hall", "random", "sobol")
    assert not times.better and 1.2 < times.least < 1.3, "random is read between checkpoints, sobol at the next one"


@pytest.fixture(scope="module")
def script():
    """results/dissertation/chapter.py."""
    spec = importlib.util.spec_from_file_location("dissertation_chapter", COMMITTED / "chapter.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.usefixtures("undrawn")
def test_the_committed_chapter_is_what_its_script_and_archives_say(tmp_path, script):
    folders = [COMMITTED, COMMITTED.parent / "dahlquist"]
    made = write_chapter(folders, tmp_path / "chapter", script.compose)[0]
    assert made.read_text() == (COMMITTED / "chapter" / "chapter.md").read_text(), "make chapter-text writes it again"


class Turned(Facts):
    """Facts in which every comparison has ended the other way round, and every number is another."""

    def _ratios(self, where, one, other, measuring):
        return super()._ratios(where, other, one, measuring)

    def fastest(self, where, one):
        return not super().fastest(where, one)


def test_each_group_of_claims_of_the_committed_chapter_can_fail(script):
    analyses = [analyse(load_results(folder)) for folder in (COMMITTED, COMMITTED.parent / "dahlquist")]
    facts = Turned(analyses, script.USUAL)
    for check in script.CHECKS:
        if check not in (script.check_fireflies, script.check_discussion):
            with pytest.raises(AssertionError):
                check(facts)
    facts.error = lambda phrase, spp: Estimate(1.0, 0.9, 1.1, 4)
    facts.build = lambda phrase: Estimate(1.0, 0.1 if phrase == "gears" else 0.9, 0.2 if phrase == "gears" else 1.1, 4)
    for check in (script.check_fireflies, script.check_discussion):
        with pytest.raises(AssertionError, match=r"1\.0"):
            check(facts)
