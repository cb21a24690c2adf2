"""The chapter says what the numbers say: turned numbers turn the sentences, equal ones are a tie, nothing is made up."""

import json
import re
from html.parser import HTMLParser

import pytest

from engines.errors import ConfigError
from harness.cli import results
from harness.report.chapter import figures, write_chapter
from harness.report.chapter.document import Chapter, Listing, Paragraph, Section, html, latex, markdown
from harness.report.chapter.families import Family, Found, Pair
from harness.report.chapter.sentences import ERROR, finding, listed, tally
from harness.statistics import Ratio
from tests.harness.synthetic import Size, base_cell, manifest, metrics

SIZE = Size(20, 10)
SPP = (1, 4, 16)


def cell(
    accelerator,
    seconds,
    *,
    block,
    scene="hall",
    threads=2,
    shader="path_tracer",
    sampler="sobol",
    error=0.01,
    label=None,
):
    """A measured cell: `seconds` a sample, `error` at the last checkpoint."""
    made = base_cell((scene, "numba", accelerator, sampler, threads, label), block, SIZE) | {"shader": {"name": shader}}
    made["cell_id"] = "-".join(map(str, (scene, accelerator, sampler, threads, shader, block, bool(label))))
    made["primitives"], made["phases"] = 1234, {"build_seconds": 0.002}
    made["points"] = [
        {"spp": spp, "seconds": spp * seconds, "rays": spp * (2000 if shader == "whitted" else 9000),
         "metrics": metrics(error * SPP[-1] / spp), "image": None} for spp in SPP
    ]  # fmt: skip
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
        made for block in range(4) for made in (
            cell("bvh", bvh * wobble(block), block=block),
            cell("grid", grid * wobble(block) * (1 + noise * (-1) ** block), block=block),
        )
    ]  # fmt: skip


@pytest.mark.usefixtures("undrawn")
def test_turned_numbers_turn_the_sentences(tmp_path):
    one = chapter(tmp_path, accelerators(0.01, 0.02), "one")
    other = chapter(tmp_path, accelerators(0.02, 0.01), "other")
    assert "numba bvh is faster than numba grid by a factor of 2.00." in one
    assert (
        "hall (1234 primitives), path_tracer: numba bvh is faster than numba grid by a factor of 2.00 (1.97 to 2.03)."
        in one
    )
    assert "numba grid is faster than numba bvh by a factor of 2.00." in other
    assert "numba bvh is faster" not in other and "numba grid is faster" not in one
    assert re.search(r"\| hall \|.*\| numba bvh \|\n", one) and re.search(r"\| hall \|.*\| numba grid \|\n", other)


@pytest.mark.usefixtures("undrawn")
def test_what_cannot_be_separated_is_said(tmp_path):
    text = chapter(tmp_path, accelerators(0.01, 0.01, noise=0.1))
    assert "numba bvh and numba grid are not separated." in text
    assert "are not separated: the ratio of their speeds is " in text and "is faster than numba" not in text
    assert re.search(r"\| numba (bvh and numba grid|grid and numba bvh) \|\n", text), "both are the fastest"


@pytest.mark.usefixtures("undrawn")
def test_threads_are_credited_with_what_they_gave(tmp_path):
    made = [cell("bvh", 0.02 * wobble(b) / share * (1 + 0.001 * b), block=b, threads=n)
            for b in range(4) for n, share in ((1, 1.0), (2, 1.6))]  # fmt: skip
    text = chapter(tmp_path, made)
    assert "With 2 threads rendering is faster than with 1 thread in 1 of 1 configuration; the median speed-up is 1.60" in text
    assert "Accelerators" not in text and "Samplers" not in text, "what was not varied is left out"


@pytest.mark.usefixtures("undrawn")
def test_samplers_are_judged_by_error_and_time(tmp_path):
    made = [cell("bvh", 0.01 * wobble(b), block=b, sampler=s, error=e * (1 + 0.01 * (-1) ** (b + i)))
            for b in range(4) for i, (s, e) in enumerate((("random", 0.03), ("sobol", 0.01)))]  # fmt: skip
    text = chapter(tmp_path, made)
    assert "sobol has a smaller error than random by a factor of 3.00." in text
    assert "sobol reaches it before random by a factor of" in text
    assert "random and sobol are the same within the margin." in text, "their samples cost the same"
    turned = [event | {"sampler": {"name": {"random": "sobol", "sobol": "random"}[event["sampler"]["name"]]},
                       "cell_id": event["cell_id"] + "t"} for event in made]  # fmt: skip
    assert "random has a smaller error than sobol by a factor of 3.00." in chapter(
        tmp_path, turned, "turned"
    )


@pytest.mark.usefixtures("undrawn")
def test_shaders_are_compared_by_cost_and_not_by_merit(tmp_path):
    made = [
        cell("bvh", s * wobble(b), block=b, shader=n)
        for b in range(3)
        for n, s in (("whitted", 0.01), ("path_tracer", 0.04))
    ]
    text = chapter(tmp_path, made)
    assert "whitted is faster than path_tracer by a factor of 4" in text
    assert "this is what a sample costs, not which is better" in text


@pytest.mark.usefixtures("undrawn")
def test_what_was_not_measured_or_not_tested_is_said(tmp_path):
    broken = base_cell(("hall", "numba", "none", "sobol", 2, None), 0, SIZE) | {
        "state": "failed",
        "message": "out of rods",
        "shader": {"name": "path_tracer"},
    }
    text = chapter(tmp_path, [*accelerators(0.01, 0.02), broken])
    assert "numba brute force on hall: failed, out of rods." in text and "Of 13 cells, 12 done and 1 failed." in text
    assert "was not tested: it takes images of several seeds" in text


FAMILY = Family({"scene": "hall"}, {})


def made_of(*verdicts):
    ratios = {"faster": 2.0, "slower": 0.5, "same": 1.0, "unresolved": 1.1, "few": 1.1}
    return Pair("a", "b", [
        Found(FAMILY, Ratio(ratios[v], 0.9 * ratios[v], 1.1 * ratios[v], 2 if v == "few" else 5, v)) for v in verdicts
    ])  # fmt: skip


@pytest.mark.parametrize(
    ("verdicts", "sentence"),
    [
        (["faster"] * 3, "a is faster than b in all 3 cases, by a factor of 2."),
        (["faster", "faster", "slower"], "a is faster than b in 2 of 3 cases, by a factor of 2; "
                                         "the other way round in 1 (by a factor of 2)."),
        (["faster", "slower"], "Of 2 cases, a is faster than b in 1 (by a factor of 2), "
                               "and the other way round in 1 (by a factor of 2)."),
        (["unresolved", "unresolved"], "a and b are not separated in any of 2 cases."),
        (["same", "same"], "a and b are the same within the margin in all 2 cases."),
        (["same", "unresolved"], "a and b are not separated in any of 2 cases; in 1 they are the same; 1 is unresolved."),
        (["faster", "unresolved", "few"], "a is faster than b in 1 of 2 cases, by a factor of 2; 1 is unresolved; "
                                          "1 more were not measured often enough to say."),
        (["few"], "a and b were not measured often enough to be compared."),
    ],
)  # fmt: skip
def test_a_tally_counts_every_finding(verdicts, sentence):
    assert tally(made_of(*verdicts)) == sentence


def test_a_finding_has_the_better_one_as_its_subject():
    assert (
        finding("a", "b", Ratio(0.5, 0.4, 0.6, 5, "slower")) == "b is faster than a by a factor of 2 (1.67 to 2.50)"
    )
    assert (
        finding("a", "b", Ratio(3, 2, 4, 5, "faster"), ERROR)
        == "a has a smaller error than b by a factor of 3 (2 to 4)"
    )
    assert finding("a", "b", Ratio(1.1, 0.9, 1.3, 5, "unresolved")).startswith("a and b are not separated: the ratio")
    assert finding("a", "b", Ratio(1.01, 0.99, 1.02, 5, "same")).startswith("a and b are the same within the margin: the ratio")
    assert finding("a", "b", Ratio(1.1, 0.9, 1.3, 2, "unresolved")).endswith("not measured often enough to be compared")
    assert listed(["a", "b", "c"]) == "a, b and c"


ODD = Chapter("50 % & <more>", [Section("A_b", [Paragraph(["x < y & z_1 is 5 %."]), Listing(["# *one*"])])])


def test_every_language_escapes_what_it_must():
    assert "x < y & z\\_1" in markdown(ODD).replace("\\<", "<") and "\\*one\\*" in markdown(ODD)
    text = latex(ODD)
    assert (
        r"\chapter{50 \% \& \textless{}more\textgreater{}}" in text and r"\# *one*" in text and r"z\_1 is 5 \%" in text
    )
    page = html(ODD)
    assert "<title>50 % &amp; &lt;more&gt;</title>" in page and "x &lt; y &amp; z_1" in page


class Balance(HTMLParser):
    """Fails where an end tag closes something else than the last open one."""

    VOID = frozenset(("meta", "path", "use", "br"))

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
    assert balance.open == [] and len(balance.ids) == len(set(balance.ids)) and "<svg" in page
    assert not re.search(r"""(src|href)=["']https?:""", page)
    text = (target / "chapter.tex").read_text()
    figures = re.findall(r"\\includegraphics\[[^]]*\]\{([^}]*)\}", text)
    assert figures and all((target / "plots" / name).stat().st_size > 1000 for name in figures)
    assert text.count("\\begin{") == text.count("\\end{") and "\\begin{tabular}" in text
    linked = re.findall(r"\]\((plots/[^)]*)\)", (target / "chapter.md").read_text())
    assert linked and all((target / name).exists() for name in linked)


@pytest.mark.usefixtures("undrawn")
def test_two_folders_make_two_sections_and_no_results_none(tmp_path):
    first, second = (folder_of(tmp_path / name, accelerators(0.01, 0.02)) for name in "ab")
    text = write_chapter([first, second], tmp_path / "both")[0].read_text()
    assert text.count("\n## ") == 2
    with pytest.raises(ConfigError, match="nowhere: no such folder"):
        write_chapter([tmp_path / "nowhere"], tmp_path / "none")


@pytest.mark.usefixtures("undrawn")
def test_a_chapter_needs_results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="name results folders, or run their configs"):
        results.chapter([], tmp_path / "out")
    with pytest.raises(ConfigError, match="a results folder is missing"):
        results.report([])
    (tmp_path / "results").mkdir()
    folder_of(tmp_path / "results" / "dissertation", accelerators(0.01, 0.02))
    results.chapter([], tmp_path / "out")
    assert (tmp_path / "out" / "chapter.html").exists()
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="is a file"):
        results.chapter([], tmp_path / "file")
