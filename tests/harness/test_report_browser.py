"""The report in a headless Chromium with the network off: no error, and the viewer and tables do what they say."""

import re

import pytest

READY = "document.getElementById('viewer-canvas').dataset.ready"
LABEL = "document.getElementById('viewer-canvas').getAttribute('aria-label')"
PIXELS = """(() => { const c = document.getElementById('viewer-canvas');
  const d = c.getContext('2d').getImageData(0, 30, c.width, c.height - 30).data;
  let sum = 0; for (let i = 0; i < d.length; i += 97) sum = (sum * 31 + d[i]) % 1000003; return sum; })()"""


@pytest.fixture
def report(reported):
    return reported / "report.html"


@pytest.fixture
def page(browser, report):
    browser.open(report)
    browser.wait_for(READY)
    browser.evaluate("document.getElementById('viewer-canvas').focus()")
    return browser


def test_it_opens_offline_without_errors_and_asks_for_nothing(page, report):
    assert page.problems == []
    assert {url for url in page.requests if not url.startswith("data:")} == {report.as_uri()}


@pytest.mark.parametrize("width", [1280, 420])
@pytest.mark.parametrize("dark", [False, True])
def test_nothing_sticks_out_sideways(page, report, width, dark):
    page.open(report, width=width, dark=dark)
    page.wait_for(READY)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    colour = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (colour == "rgb(255, 255, 255)") != dark


@pytest.mark.parametrize("section", ["verdicts", "equivalence"])
def test_tables_that_matter_fit_a_1280_pixel_window(page, report, section):
    page.open(report, width=1280, dark=False)
    page.wait_for(READY)
    page.evaluate("document.querySelectorAll('details').forEach(e => { e.open = true; })")
    room, needed = (
        page.evaluate(f"document.querySelector('#{section} .scroller').{name}") for name in ("clientWidth", "scrollWidth")
    )
    assert needed <= room


def test_engines_are_compared_once_in_numbers(page):
    lines = page.evaluate("Array.from(document.querySelectorAll('#table-equivalence tbody tr'), line => line.textContent)")
    assert len(lines) == 12 and all("images at" in line and "%" in line for line in lines)
    assert len(page.evaluate("document.body.textContent").split(lines[0].split("%")[0].strip())) == 2


def test_of_each_scene_one_plot_is_seen_and_every_other_can_be_chosen(page):
    heights = "Array.from(document.querySelectorAll('.chart[data-plot]'), s => s.getBoundingClientRect().height)"
    sets = page.evaluate("document.querySelectorAll('.tabs').length")
    assert sum(height > 100 for height in page.evaluate(heights)) == sets == 3
    labels = page.evaluate("Array.from(document.querySelectorAll('.tabs > label'), l => l.htmlFor)")
    seen = set()
    for label in labels:
        page.evaluate(f"document.querySelector('label[for=\"{label}\"]').click()")
        found = [place for place, height in enumerate(page.evaluate(heights)) if height > 100]
        assert len(found) == sets
        seen |= set(found)
    assert len(seen) == len(labels) >= 12


def test_number_keys_flip_and_zero_is_the_reference(page):
    seen = {}
    for key in ("1", "2", "0"):
        page.press(key)
        seen[key] = page.evaluate(LABEL), page.evaluate(PIXELS)
    assert "reference" in seen["0"][0] and len(set(seen.values())) == 3
    assert page.evaluate("document.getElementById('viewer-a').selectedOptions[0].textContent").startswith("0")


def test_the_address_keeps_what_is_seen(page, report):
    page.press("2", "Shift+3", "w", "]")
    page.set("#viewer-rule", "samples")
    chosen = "['a', 'b', 'rule'].map(name => document.getElementById('viewer-' + name).selectedOptions[0].textContent)"
    before = page.evaluate(chosen), page.evaluate(PIXELS)
    page.wait_for("location.hash.includes('rule=samples')")
    address = page.evaluate("location.href")
    page.open(report)
    page.page.goto("about:blank")
    page.page.goto(address)
    page.wait_for(READY)
    assert (page.evaluate(chosen), page.evaluate(PIXELS)) == before


def test_a_and_b_are_chosen_freely_swapped_and_subtracted(page):
    a, b = "document.getElementById('viewer-a').value", "document.getElementById('viewer-b').value"
    page.press("1", "Shift+2")
    chosen = page.evaluate(a), page.evaluate(b)
    plain = page.evaluate(PIXELS)
    page.press(" ")
    assert (page.evaluate(b), page.evaluate(a)) == chosen and page.evaluate(PIXELS) != plain
    page.press("d")
    difference = page.evaluate(PIXELS)
    page.press("Shift+1", "1")
    assert page.evaluate(a) == page.evaluate(b) and page.evaluate(PIXELS) != difference
    assert "A−B" in page.evaluate("document.getElementById('viewer-scale').textContent")


def test_zoom_pan_and_exposure_change_the_picture_and_fit_restores_it(page):
    pictures = [page.evaluate(PIXELS)]
    for key in ("+", "ArrowLeft", "]"):
        page.press(key)
        pictures.append(page.evaluate(PIXELS))
    assert len(set(pictures)) == 4
    page.press("[")
    page.press("f")
    assert page.evaluate(PIXELS) == pictures[0]


def test_zoom_is_shared_between_pictures(page):
    page.press("+")
    zoomed = page.evaluate("document.getElementById('viewer-status').textContent.match(/Zoom [0-9]+/)[0]")
    page.press("2")
    assert page.evaluate("document.getElementById('viewer-status').textContent.match(/Zoom [0-9]+/)[0]") == zoomed


def test_wipe_grid_and_error_map_are_drawn_and_named(page):
    plain = page.evaluate(PIXELS)
    for key, control in (("w", "[data-mode=wipe]"), ("g", "[data-mode=grid]")):
        page.press(key)
        assert page.evaluate(f"document.querySelector('{control}').getAttribute('aria-pressed')") == "true"
        assert page.evaluate(PIXELS) != plain
    page.press("g")
    page.press("e")
    assert "R² + ε" in page.evaluate("document.getElementById('viewer-scale').textContent")
    assert page.evaluate(PIXELS) != plain


def test_the_pixel_under_the_pointer_is_told(page):
    plain = page.evaluate(PIXELS)
    page.point(*page.spot(0.5, 0.5, "#viewer-canvas"))
    assert page.evaluate(PIXELS) != plain
    text = page.evaluate("document.getElementById('viewer-status').textContent")
    assert text.startswith("(32, 24)") and "reference: " in text and "relative squared error" in text


def test_another_scene_can_be_opened(page):
    page.evaluate(
        "(() => { const s = document.getElementById('viewer-group'); s.value = '1';s.dispatchEvent(new Event('change')); })()"
    )
    page.wait_for(f"{READY} === document.getElementById('viewer-group').selectedOptions[0].textContent")
    assert page.evaluate(LABEL).startswith(page.evaluate(READY))


def test_tables_sort_by_number_both_ways(page):
    column = "Array.from(document.querySelectorAll('#table-cells tbody tr'), r => parseFloat(r.cells[6].dataset.sort))"
    for direction in ("ascending", "descending"):
        page.evaluate("document.querySelectorAll('#table-cells th button')[6].click()")
        values = [v for v in page.evaluate(column) if v is not None]  # unknown ones come as null
        assert len(values) > 20 and values == sorted(values, reverse=direction == "descending")
        assert page.evaluate("document.querySelectorAll('#table-cells th')[6].getAttribute('aria-sort')") == direction


def test_search_shows_the_rows_that_hold_all_words(page):
    page.evaluate(
        "(() => { const i = document.querySelector('[data-filter=table-cells]'); i.value = 'numpy SOBOL';"
        "i.dispatchEvent(new Event('input')); })()"
    )
    shown = page.evaluate(
        "Array.from(document.querySelectorAll('#table-cells tbody tr')).filter(r => !r.hidden).map(r => r.cells[2].textContent)"
    )
    assert len(shown) == 6 and all("numpy" in name and "sobol" in name for name in shown)
    assert page.evaluate("document.querySelector('[data-count=table-cells]').textContent").startswith("6 of")


def test_the_theme_button_turns_light_to_dark(page):
    before = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.evaluate("document.getElementById('theme').click()")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != before


def test_controls_have_names(page):
    unnamed = page.evaluate("""Array.from(document.querySelectorAll('button, input, select, canvas'))
        .filter(e => !(e.textContent.trim() || e.getAttribute('aria-label') || e.labels?.length))
        .map(e => e.outerHTML)""")
    assert unnamed == []


PLOT = "document.querySelector('[data-plot=\"error-over-time-cornell_box\"]')"


@pytest.fixture
def plot(page):
    page.evaluate(f"{PLOT}.scrollIntoView({{block: 'center'}})")
    page.wait_for(f"{PLOT}.dataset.drawn")
    return page


def test_a_mark_tells_contestant_samples_error_and_seconds(plot):
    point = plot.page.locator("[data-plot='error-over-time-cornell_box'] .scatterlayer .point").nth(2)
    box = point.bounding_box()
    plot.point(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    told = "document.querySelector('[data-plot=\"error-over-time-cornell_box\"] .hoverlayer').textContent"
    plot.wait_for(f"{told}.length > 0")
    found = re.fullmatch(r"(\w+) .*?samples: (\d+)error: (\S+) \(\S+ to \S+\)seconds: (\S+)", plot.evaluate(told))
    assert found, plot.evaluate(told)
    engine, samples, error, seconds = found.groups()
    assert engine in ("numpy", "numba", "embree") and int(samples) > 1 and float(error) > 0 and float(seconds) > 0


def test_a_plot_is_zoomed_by_dragging_and_by_keys_and_shown_whole_again(plot):
    ends = f"{PLOT}.layout.xaxis.range.join()"
    whole = plot.evaluate(ends)
    area = "[data-plot='error-over-time-cornell_box'] .nsewdrag"
    plot.drag(plot.spot(0.3, 0.3, area), plot.spot(0.6, 0.7, area))
    plot.wait_for(f"{ends} !== '{whole}'")
    x, y = plot.spot(0.5, 0.5, area)
    plot.page.mouse.dblclick(x, y)
    plot.wait_for(f"{ends} === '{whole}'")
    plot.evaluate(f"{PLOT}.focus()")
    for key in ("+", "ArrowLeft"):
        before = plot.evaluate(ends)
        plot.press(key)
        plot.wait_for(f"{ends} !== '{before}'")
    plot.press("0")
    plot.wait_for(f"{ends} === '{whole}'")


def test_every_plot_is_drawn_without_a_complaint(page):
    page.problems.clear()
    for label in page.evaluate("Array.from(document.querySelectorAll('.tabs > label'), l => l.htmlFor)"):
        page.evaluate(f"document.querySelector('label[for=\"{label}\"]').click()")
        page.wait_for(f"document.querySelector('[data-plot=\"{label.removeprefix('choose-')}\"]').dataset.drawn")
    assert page.problems == []


def test_texts_of_plots_have_the_colour_of_the_theme(plot, report):
    colour = f"getComputedStyle({PLOT}.querySelector('.xtick text')).fill"
    light = plot.evaluate(colour)
    plot.evaluate("document.getElementById('theme').click()")
    assert plot.evaluate(colour) == plot.evaluate("getComputedStyle(document.body).color") != light
