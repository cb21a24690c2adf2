"""The report: one file that needs nothing else, complete, safe against odd input, rebuildable from little."""

import base64
import html
import html.parser
import json
import re
import shutil
import zlib

import numpy as np
import pytest

from engines.errors import ConfigError
from harness.analysis import analyse
from harness.report import write_derived
from harness.report.html import assembly
from harness.report.html.assembly import MOST_WINNERS, report_html
from harness.report.html.noise import noise_panels
from harness.report.html.pictures import busiest, packed, shrunk
from harness.report.plots.panels import panels
from harness.report.sentences import MOST_LINES, sentences
from harness.report.tables import all_tables
from harness.report.tables.model import estimate_text
from harness.report.winners import standing, tally, winners
from harness.store.results import load_results

DERIVED = ("points.csv", "ttq.csv", "phases.csv", "report.html", "tables/time_to_quality.md", "tables/columns.md")


@pytest.fixture(scope="module")
def folder(reported):
    return reported


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


class Outline(html.parser.HTMLParser):
    """Tags, ids and addresses of a document; `open` tracks nesting."""

    VOID = frozenset(("meta", "input", "img", "br", "link", "hr", "path", "use", "wbr"))

    def __init__(self, text):
        super().__init__()
        self.ids, self.addresses, self.images, self.svgs, self.plots, self.stack, self.tags = [], [], [], [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append(tag)
        self.ids += [attributes["id"]] if "id" in attributes else []
        self.addresses += [attributes[key] for key in ("src", "href", "xlink:href") if key in attributes]
        if tag == "img":
            self.images.append(attributes)
        if "data-plot" in attributes:
            self.plots.append(attributes)
        if tag == "svg":
            self.svgs.append(attributes)
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.stack.pop()

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag


def payload_of(page):
    return json.loads(re.search(r'<script type="application/json" id="pictures">(.*?)</script>', page, re.S).group(1))


def test_noise_is_told_from_bias_for_contestants_with_images_of_three_seeds(page, folder):
    section = page.partition('<section id="noise">')[2].partition("</section>")[0]
    analysis = analyse(load_results(folder))
    said = {
        (panel.title, one.name): one
        for panel in noise_panels(analysis)
        for one in panel.contestants
        if one.name in section and one.deviation in section
    }
    assert {title for title, _ in said} == {"cornell_box", "two_spheres"}
    biased, sound = (
        next(one for (title, name), one in said.items() if (title, name.split()[:2]) == ("two_spheres", [engine, "random"]))
        for engine in ("embree", "numpy")
    )
    assert biased.biased and "The tests of pixels, tiles and image mean find bias, too." in biased.reading
    assert sound.reading.startswith("Consistent with no bias") and not sound.biased
    assert section.count("<figure>") == 4 * len(said)


def test_everything_derived_is_written(page, folder):
    assert all((folder / name).exists() for name in DERIVED)
    assert len(page) < 10_000_000


def test_the_document_is_well_formed_with_unique_ids_and_nothing_outside(page):
    outline = Outline(page)
    assert outline.stack == [] and len(outline.ids) == len(set(outline.ids))
    assert all(address.startswith(("#", "data:")) for address in outline.addresses)
    assert not re.search(r"""(src|href)=["']https?:|@import|url\(["']?http""", page)
    targets = {address[1:] for address in outline.addresses if address.startswith("#")}
    assert targets <= set(outline.ids)


def test_pictures_and_plots_have_words_for_those_who_cannot_see_them(page, folder):
    outline = Outline(page)
    assert outline.images and all(len(image["alt"]) > 10 for image in outline.images)
    assert len(outline.plots) == 16 and len(outline.svgs) == 2 + 2 * page.count('<div class="noise">') > 2
    assert all(each["role"] == "img" and len(each["aria-label"]) > 40 for each in (*outline.plots, *outline.svgs))
    files = re.findall(r"<noscript><p>The plot needs JavaScript. <code>(.*?)</code>", page)
    assert len(files) == 16 and all((folder / file).exists() for file in files)


def test_verdicts_come_first_and_every_part_is_there(page):
    places = [
        page.index(f'<section id="{name}"')
        for name in ("verdicts", "quality", "plots", "images", "equivalence", "tables", "provenance", "glossary")
    ]
    assert places == sorted(places)
    assert "biased by" in page and "raybench render" in page and "0123abc" in page


def test_input_is_escaped(page):
    assert "<small> cannot" not in page and "&lt;small&gt; cannot hold" in page


def test_every_cell_has_a_row_with_its_command(page, folder):
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    cells = {event["cell_id"] for event in events if event["event"] == "cell"}
    table = page[page.index('<table id="table-cells"') :]
    assert table[: table.index("</table>")].count('class="copy"') == len(cells)


def test_pictures_decode_to_the_images(page, folder):
    payload = payload_of(page)
    assert [group["title"] for group in payload["groups"]] == ["cornell_box", "two_spheres"]
    group = payload["groups"][0]
    assert group["has_reference"] and (group["width"], group["height"], group["factor"]) == (64, 48, 1)
    results = load_results(folder)
    reference = results.reference(results.contestants[0].cells[0].reference_id)
    assert unpacked(group["pictures"][0]["data"], (48, 64, 3)) == pytest.approx(reference.mean, rel=5e-3)
    for rule in group["rules"].values():
        names = [group["pictures"][place]["name"] for place in rule["pictures"]]
        assert names[0] == "reference" and {name.split()[0] for name in names[1:4]} == {"numpy", "numba", "embree"}
        assert len(names) == len(set(names)) <= 10


def test_a_contestant_has_a_picture_by_each_rule_or_a_reason_for_none(page, folder):
    everyone = {c.name for c in load_results(folder).contestants if c.settings.scene == "cornell_box" and not c.settings.label}
    group = payload_of(page)["groups"][0]
    for rule in group["rules"].values():
        shown = [group["pictures"][place] for place in rule["pictures"][1:]]
        missing = dict(map(tuple, rule["missing"]))
        assert {picture["name"] for picture in shown} | missing.keys() == everyone and all(missing.values())
    spp, seconds = (re.search(r"([\d.]+) s?p?p?", group["rules"][rule]["words"])[1] for rule in ("samples", "time"))
    places = [group["rules"][rule]["pictures"][1:] for rule in ("samples", "time")]
    taken = [[group["pictures"][place]["caption"] for place in each] for each in places]
    assert {caption.split(" spp")[0] for caption in taken[0]} == {spp}
    assert all(float(caption.split(", ")[1].split(" s")[0]) <= 1.01 * float(seconds) for caption in taken[1])


def test_a_ratio_is_that_to_the_baseline_or_the_inverse_of_one_to_it(folder):
    kinds, analysis = set(), analyse(load_results(folder))
    for panel in panels(analysis):
        found = standing(analysis, panel, analysis.results.targets[0])
        for row in found.rows:
            text, other = found.ratio_of(row)
            own = row.no_ratio == ""
            theirs = {each.contestant: each for each in found.rows if each.baseline == row.contestant}
            kinds.add("own" if own else "inverse" if other else "none")
            if own:
                assert row.baseline and other == row.baseline
                assert text == estimate_text((row.ratio, row.ratio_low, row.ratio_high))
            elif other:
                numbers = [float(number) for number in re.findall(r"[\d.]+", text)]
                ratio = theirs[other]
                assert numbers == pytest.approx([1 / ratio.ratio, 1 / ratio.ratio_high, 1 / ratio.ratio_low], rel=0.01)
    assert kinds >= {"own", "inverse"}


def test_a_cell_of_the_matrix_says_what_the_winners_say(page, folder):
    """The same names and times as winners.txt, from the same decision."""
    lines = [line.strip() for line in (folder / "winners.txt").read_text().splitlines()[1:]]
    matrix = page[page.index('<table class="matrix">') :]
    cells = re.findall(r"<td data-target=.*?</td>", matrix[: matrix.index("</table>")], re.S)
    assert len(cells) == len(lines) > 4
    for cell, line in zip(cells, lines, strict=True):
        text = " ".join(html.unescape(re.sub(r"<[^>]*>", "", cell)).split())
        said = line.split(": ", 1)[1].split("; ")[0]
        if first := re.fullmatch(
            r"(.*?)(?: is first, after| is the only one ranked and took| ran alone and took) (.*) s(.*)", said
        ):
            assert text.startswith(first[1]) and f"{first[2]}{first[3]} s" in text
        elif said.startswith("not separated"):
            several, names = said.split(": ", 1)
            assert several in text and names.split(" (")[0] in text
        else:
            assert said in text
        assert 'href="#quality-' in cell


def test_the_page_begins_with_the_sentences_of_the_command_line(page, folder):
    """Those on winners, then ratios of settings; what has no ratio is folded."""
    analysis = analyse(load_results(folder))
    shown, hidden = beginning(page)
    first, settings = winners(analysis), sentences(analysis)
    assert len(first) == MOST_WINNERS and all(f"</b> to relMSE {each.target:g}: {each.text}." in shown for each in first)
    assert all(each.text in shown for each in [each for each in settings if each.known][:MOST_LINES])
    assert all(each.text in hidden for each in settings if not each.known)


def beginning(page):
    """What stands before the table of winners: (shown, folded)."""
    shown, _, folded = page[page.index('<h2 class="question">') : page.index('<table class="matrix">')].partition("<details")
    return html.unescape(shown), html.unescape(folded)


def test_of_many_scenes_and_targets_the_page_first_counts_who_is_first(folder, monkeypatch):
    monkeypatch.setattr(assembly, "MOST_WINNERS", 5)
    first = winners(analyse(load_results(folder)))
    shown, folded = beginning(page_of(folder))
    assert tally(first) in shown and all(each.text in folded for each in first)


def unpacked(data, shape):
    """What the viewer's JavaScript does: high bytes, then low bytes, of half floats."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(data)), np.uint8).astype(np.uint16)
    half = planes.size // 2
    return ((planes[:half] << 8) | planes[half:]).view(np.float16).astype(np.float64).reshape(shape)


def test_packing_keeps_extremes():
    image = np.array([[[0.0, 1e6, -3.0], [np.nan, np.inf, 1.0]]])
    found = unpacked(packed(image), image.shape)
    assert found[0, 0].tolist() == [0, 65024, -3] and np.isnan(found[0, 1, 0]) and np.isposinf(found[0, 1, 1])
    values = np.geomspace(1e-3, 6e4, 3000).reshape(10, 100, 3)
    assert unpacked(packed(values), values.shape) == pytest.approx(values, rel=5e-3)


def test_shrinking_averages_whole_blocks():
    image = np.arange(5 * 7 * 3, dtype=float).reshape(5, 7, 3)
    assert shrunk(image, 2).shape == (2, 3, 3)
    assert shrunk(image, 2)[0, 0] == pytest.approx(image[:2, :2].mean(axis=(0, 1)))
    assert shrunk(image, 9).shape == (1, 1, 3)


def test_the_crop_shows_the_busiest_part():
    image = np.zeros((200, 200, 3))
    image[130:150, 120:160:2] = 1.0
    y, x = busiest(image)
    assert y <= 130 < y + 48 and x <= 121 < x + 48 and busiest(image[:20, :20]) == (0, 0)


# What may be missing


def rewritten(folder, target, change):
    """A copy of the results whose events went through `change`."""
    shutil.copytree(folder, target, ignore=shutil.ignore_patterns("plots", "tables", "*.csv", "report.html"))
    events = [json.loads(line) for line in (target / "events.jsonl").read_text().splitlines()]
    (target / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in change(events)))
    return target


def page_of(folder):
    """The report without its plots, which take long to draw."""
    analysis = analyse(load_results(folder))
    return report_html(analysis, all_tables(analysis), [])


def test_the_report_is_rebuilt_from_manifest_events_and_images_alone(folder, tmp_path):
    """Its plots are, too: tests/harness/test_plots.py."""
    copy = rewritten(folder, tmp_path / "copy", lambda events: events)
    assert page_of(copy) == page_of(folder)


def test_no_cell_done(folder, tmp_path, with_plots):
    copy = rewritten(folder, tmp_path / "copy", lambda events: [e for e in events if e.get("state") != "done"])
    text = write_derived(copy).read_text(encoding="utf-8")
    assert "nothing to compare yet" in text and "mitsuba" in text


def test_no_events_but_the_run(folder, tmp_path):
    copy = rewritten(folder, tmp_path / "copy", lambda events: events[:1])
    (copy / "manifest.json").unlink()
    assert "none yet" in write_derived(copy).read_text(encoding="utf-8")


def test_images_and_references_gone(folder, tmp_path):
    copy = rewritten(folder, tmp_path / "copy", few_cells)
    shutil.rmtree(copy / "images")
    shutil.rmtree(copy / "references")
    text = write_derived(copy).read_text(encoding="utf-8")
    assert 'id="images"' not in text and "unknown" in (copy / "tables" / "time_to_quality.md").read_text()


def test_a_damaged_image_and_no_reference(folder, tmp_path):
    copy = rewritten(folder, tmp_path / "copy", few_cells)
    shutil.rmtree(copy / "references")
    for image in sorted(copy.glob("images/*numba*-0/*.exr")):
        image.write_bytes(b"no image")
    payload = payload_of(page_of(copy))
    assert payload["groups"] and not payload["groups"][0]["has_reference"]


def few_cells(events):
    """One scene and two engines: enough to draw, quick to do."""

    def wanted(event):
        return event["scene"] == "cornell_box" and event["engine"] in ("numba", "numpy") and event["threads"] == 1

    return [event for event in events if event["event"] != "cell" or wanted(event)]


def test_nonfinite_metrics_and_points_do_not_break_it(folder, tmp_path, with_plots):
    bad = {"relmse_e0.01_corrected": float("inf"), "relmse_e0.01_se": float("nan"), "nonfinite": 3.0}

    def spoil(events):
        for event in few_cells(events):
            for point in event.get("points", [])[-1:]:
                point["metrics"] |= bad
            yield event

    copy = rewritten(folder, tmp_path / "copy", spoil)
    assert "non-finite pixels" in write_derived(copy).read_text(encoding="utf-8")


def test_results_of_two_machines_carry_a_banner(folder, tmp_path):
    def move(events):
        for event in few_cells(events):
            yield event | {"env_id": "other"} if event.get("block") == 1 and event["event"] == "cell" else event

    assert "must not be compared" in page_of(rewritten(folder, tmp_path / "copy", move))


def test_a_folder_without_events_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"events\.jsonl"):
        write_derived(tmp_path)
