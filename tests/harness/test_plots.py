"""Plots: all are drawn, the same at every run, one colour an engine, readable with many curves, never in the way."""

import dataclasses
import json
import math
import shutil
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest

from engines.errors import ConfigError
from harness.analysis import analyse
from harness.report.plots import Palette, write_plots
from harness.report.plots.catalogue import _of_a_panel
from harness.report.plots.curves import band, error_curves, pareto, target_ecdf
from harness.report.plots.figures import STYLE, figure, log_scales, new_figure, save
from harness.report.plots.panels import facets, panels
from harness.report.plots.parallel import Beside, draw
from harness.report.plots.scaling import cost_over_pixels, cost_over_primitives
from harness.report.plots.style import ENGINE_COLOURS, FORMATS, OTHER_COLOURS, file_stem, formats
from harness.store.results import load_results
from tests.harness.synthetic import SMALL, arranged, base_cell, done_cell


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("plots")


@pytest.fixture(scope="module")
def analysis(reported, tmp_path_factory):
    """From manifest, events, images and references alone."""
    derived = shutil.ignore_patterns("plots", "tables", "*.csv", "report.html")
    return analyse(load_results(shutil.copytree(reported, tmp_path_factory.mktemp("bare") / "copy", ignore=derived)))


@pytest.fixture(scope="module")
def plots(analysis, folder):
    (folder / "plots").mkdir()
    (folder / "plots" / "stale.svg").write_text("old")
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("RAYBENCH_PLOTS", "svg")
        return write_plots(analysis, folder)


def test_every_plot_that_the_results_allow_is_drawn(plots, folder):
    names = {plot.name for plot in plots}
    for scene in ("cornell_box", "two_spheres"):
        kinds = ("error-over-time", "error-over-samples", "error-over-rays", "time-to-quality", "pareto", "phases")
        assert {f"{kind}-{scene}" for kind in kinds} <= names
    assert {"targets-over-time", "speed-up-over-threads"} <= names
    for name in names:
        ElementTree.parse(folder / "plots" / f"{name}.svg")


def test_plots_are_the_same_at_every_run_and_older_ones_are_removed(plots, folder, reported):
    ours, theirs = ({path.name: path.read_bytes() for path in (place / "plots").glob("*.svg")} for place in (folder, reported))
    assert ours == theirs


def test_a_plot_comes_as_svg_png_and_pdf_the_same_whoever_draws_it(plots, tmp_path):
    chosen = plots[1::8]
    again, no_folder = tmp_path / "again", tmp_path / "a file"
    again.mkdir()
    no_folder.touch()
    draw(chosen, tmp_path, FORMATS)
    with Beside(chosen, no_folder, FORMATS) as failing:
        failing._share = (chosen, again, FORMATS)
        failing.finish()  # a second process that fails is replaced
    expected = {f"{plot.name}.{suffix}" for plot in chosen for suffix in ("svg", "png", "pdf")}
    assert {path.name for path in again.iterdir()} == expected
    for name in expected:
        content = (again / name).read_bytes()
        assert len(content) > 1000 and content == (tmp_path / name).read_bytes()


@pytest.mark.parametrize(("asked", "written"), [("none", []), ("svg", ["svg"]), ("pdf", ["pdf"]), ("png, svg", ["png", "svg"])])
def test_formats_that_nobody_wants_are_not_written(monkeypatch, tmp_path, asked, written):
    monkeypatch.setenv("RAYBENCH_PLOTS", asked)
    save(new_figure(), tmp_path, "empty", formats())
    assert sorted(path.suffix[1:] for path in tmp_path.iterdir()) == written


def test_a_format_that_is_none_is_named(monkeypatch):
    monkeypatch.setenv("RAYBENCH_PLOTS", "svg,gif")
    with pytest.raises(ConfigError, match=r"RAYBENCH_PLOTS: 'gif' .* expected: none, or any of svg, png, pdf"):
        formats()


def test_none_removes_older_files_and_writes_none_but_the_report_has_every_plot(analysis, plots, tmp_path):
    (tmp_path / "plots").mkdir()
    (tmp_path / "plots" / "old.svg").touch()
    assert [plot.name for plot in write_plots(analysis, tmp_path)] == [plot.name for plot in plots]
    assert list((tmp_path / "plots").iterdir()) == []


def test_every_plot_says_what_it_shows(plots):
    assert all(len(plot.description) > 40 and plot.title for plot in plots)


def test_an_engine_has_one_colour_and_others_move_none(tmp_path):
    def palette(*engines):
        cells = [base_cell(("s", engine, "bvh", "random", 1, None), 0, SMALL) for engine in engines]
        return Palette(arranged(tmp_path, cells))

    few, more = palette("zeta", "numba"), palette("zeta", "numba", "alpha", "mitsuba")
    assert few.colour("zeta") == more.colour("zeta") == OTHER_COLOURS[0] and more.colour("alpha") == OTHER_COLOURS[1]
    assert {engine: more.colour(engine) for engine in ("numba", "mitsuba")}.items() <= ENGINE_COLOURS.items()


def test_looks_differ_by_more_than_colour(analysis):
    palette = Palette(analysis.results)
    same_engine = {
        c.settings: palette.look(c)
        for c in analysis.results.of_scene("cornell_box")
        if c.settings.engine == "numba" and not c.settings.label
    }
    assert len({(str(look.line), look.marker, look.width) for look in same_engine.values()}) == len(same_engine)


def of_one_engine(folder, *changes):
    """The palette and the contestants of cells that differ in what is changed; a cell of another engine has failed."""
    rng, case = np.random.default_rng(1), ("cornell_box", "numba", "bvh", "random", 1, None)
    cells = [{**done_cell(folder, case, 0, 1.0, SMALL, rng, False), **change} for change in changes]
    cells.append({**base_cell(("cornell_box", "embree", "embree", "random", 1, None), 0, SMALL), "state": "failed"})
    results = arranged(folder, [{**cell, "cell_id": f"cell{index}"} for index, cell in enumerate(cells)])
    return Palette(results), [contestant for contestant in results.contestants if contestant.done]


def test_contestants_of_one_engine_differ_by_colour_and_marker_where_their_shaders_do(tmp_path):
    shaders = [{"name": "path_tracer", "max_depth": 6, "direct": direct} for direct in ("mis", "bsdf", "light")]
    palette, contestants = of_one_engine(tmp_path, *({"shader": shader, "raced": shaders[0]} for shader in shaders))
    looks = [palette.look(contestant) for contestant in contestants]
    assert len({look.colour for look in looks}) == len({look.marker for look in looks}) == 3
    names = [f"path_tracer(direct={direct})" for direct in ("bsdf", "light", "mis")]
    assert [entry.label for entry in palette.key(contestants)] == [name for name, _ in palette.colours(contestants)] == names


def test_contestants_of_one_engine_differ_by_colour_and_line_where_their_samplers_do(tmp_path):
    palette, contestants = of_one_engine(tmp_path, {"sampler": {"name": "random"}}, {"sampler": {"name": "sobol"}})
    looks = [palette.look(contestant) for contestant in contestants]
    assert len({look.colour for look in looks}) == len({look.line for look in looks}) == 2
    assert [entry.label for entry in palette.key(contestants)] == ["random", "sobol"]


def test_an_engine_keeps_its_colour_where_shaders_are_not_in_one_race(tmp_path):
    """Each has a reference of its own."""
    palette, contestants = of_one_engine(tmp_path, {}, {"shader": {"name": "albedo"}, "reference_id": "another"})
    assert {palette.look(contestant).colour for contestant in contestants} == {ENGINE_COLOURS["numba"]}


def test_the_band_holds_the_median_of_the_seeds(analysis):
    verdict = analysis.verdicts[0]
    data = band(analysis.results, verdict, "seconds")
    assert (data.low <= data.error).all() and (data.error <= data.high).all() and (np.diff(data.x) > 0).all()


def test_medians_over_seeds_never_go_back_in_time_where_the_faster_ones_go_further(analysis):
    """Of three seeds the slowest ends two checkpoints before the others, at the second with one more of its own."""

    def ending(cell, slowness, points):
        points = [point.replaced(seconds=slowness * point.seconds) for point in points]
        return cell.replaced(points=tuple(points))

    verdict = analysis.verdicts[0]
    first, second, third = verdict.contestant.done
    *points, before, last = first.points
    least = points[-1].seconds
    points += [before.replaced(seconds=1.1 * least), last.replaced(seconds=1.2 * least)]
    own = points[-2].replaced(spp=points[-2].spp - 1)
    cells = ending(first, 9.0, [*points[:-2], own]), ending(second, 1.0, points), ending(third, 3.0, points)
    verdict = dataclasses.replace(verdict, contestant=dataclasses.replace(verdict.contestant, cells=cells))
    for x in ("seconds", "cold", "rays"):
        data = band(analysis.results, verdict, x)
        assert data.spp.tolist() == [point.spp for point in points]
        assert (np.diff(data.x) > 0).all() and (np.diff(data.seconds) > 0).all()
    assert data.seconds[-1] == pytest.approx(3.0 * points[-1].seconds)
    cells = ending(first, 9.0, points[:-2]), ending(second, 1.0, points[:-1]), ending(third, 3.0, points)
    verdict = dataclasses.replace(verdict, contestant=dataclasses.replace(verdict.contestant, cells=cells))
    assert band(analysis.results, verdict, "seconds").spp.tolist() == [point.spp for point in points[:-1]]
    points[-2] = points[-2].replaced(seconds=1.3 * least)
    verdict = dataclasses.replace(
        verdict, contestant=dataclasses.replace(verdict.contestant, cells=(ending(second, 1, points),))
    )
    assert band(analysis.results, verdict, "seconds").spp.tolist() == [*(point.spp for point in points[:-2]), points[-1].spp]


def test_many_curves_are_split_into_facets_that_hold_each_once(analysis):
    verdicts = analysis.verdicts * 4
    parts = facets(verdicts)
    assert len(parts) == 3 and sum(len(part.verdicts) for part in parts) == len(verdicts)
    assert len(facets(verdicts[:10])) == 1


@pytest.mark.parametrize("draws", [pareto, lambda *those: error_curves(*those, "spp")], ids=["pareto", "curves"])
def test_a_legend_of_looks_fits_its_figure(analysis, draws):
    panel = panels(analysis)[0]
    with matplotlib.rc_context(STYLE):
        drawn = figure(draws(analysis, dataclasses.replace(panel, verdicts=panel.verdicts * 2), Palette(analysis.results)))
        drawn.draw_without_rendering()
        (legend,) = drawn.legends
        box = legend.get_window_extent()
    assert box.x0 >= 0 and box.x1 <= drawn.bbox.width


def test_a_caption_speaks_of_slopes_only_where_the_legend_has_them(analysis):
    panel, palette = panels(analysis)[0], Palette(analysis.results)
    none = [dataclasses.replace(v, slope=v.slope._replace(value=math.nan)) for v in panel.verdicts]
    for verdicts, expected in ((panel.verdicts[:5], True), (panel.verdicts * 2, False), (none[:5], False)):
        shown = dataclasses.replace(panel, verdicts=verdicts)
        captions = {name: description for name, _, description, _ in _of_a_panel(analysis, shown, palette)}
        said = ["slopes" in captions[f"error-over-{x}-{panel.stem}"] for x in ("samples", "time", "rays")]
        legends = figure(error_curves(analysis, shown, palette, "spp")).legends
        numbers = [text.get_text() for legend in legends for text in legend.get_texts() if "(-0." in text.get_text()]
        assert said == [expected, False, False] and bool(numbers) == expected


def test_a_point_below_three_standard_errors_is_no_part_of_the_line(analysis):
    def unsure(cell):
        end = cell.end.replaced(metrics={**cell.end.metrics, "relmse_e0.01_se": 1.0})
        return cell.replaced(points=(*cell.points[:-1], end))

    panel = panels(analysis)[0]
    verdict, *others = panel.verdicts
    contestant = dataclasses.replace(verdict.contestant, cells=tuple(map(unsure, verdict.contestant.done)))
    verdict = dataclasses.replace(verdict, contestant=contestant)
    assert band(analysis.results, verdict, "spp").noisy[-1]
    panel = dataclasses.replace(panel, verdicts=[verdict, *others])
    assert error_curves(analysis, panel, Palette(analysis.results), "spp") is not None


def test_results_without_targets_or_threads_draw_what_is_left(tmp_path, with_plots):
    rng = np.random.default_rng(1)
    case = ("cornell_box", "numba", "bvh", "random", 1, None)
    cells = [done_cell(tmp_path, case, block, 1.0, SMALL, rng, False) for block in range(2)]
    (tmp_path / "events.jsonl").write_text("".join(json.dumps(cell) + "\n" for cell in cells))
    names = {plot.name for plot in write_plots(analyse(load_results(tmp_path)), tmp_path)}
    assert "error-over-time-cornell_box" in names and "phases-cornell_box" in names
    assert not {"speed-up-over-threads", "targets-over-time"} & names


def test_a_scene_on_which_a_contestant_was_not_measured_counts_as_not_reached(tmp_path):
    rng = np.random.default_rng(1)
    cells = [
        done_cell(tmp_path, (scene, engine, "bvh", "random", 1, None), block, 1.0, SMALL, rng, False)
        for scene, engine in (("cornell_box", "numba"), ("cornell_box", "embree"), ("two_spheres", "numba"))
        for block in range(3)
    ]
    found = analyse(dataclasses.replace(arranged(tmp_path, cells), targets=[1e9]))
    chart = target_ecdf(found, Palette(found.results))
    assert chart is not None
    assert {curve.name: curve.y[-1] for curve in chart.subplots[0].content} == {"numba": 1.0, "embree": 0.5}


def test_growth_is_drawn_over_three_sizes_with_its_exponent(tmp_path):
    rng = np.random.default_rng(1)
    case = ("cornell_box", "numba", "bvh", "random", 1, None)
    cells = []
    for count in (100, 1000, 10_000):
        for block in range(3):
            cell = done_cell(tmp_path, case, block, 1.0, SMALL, rng, False)
            for point in cell["points"]:
                point["seconds"] = 1e-6 * point["spp"] * count**0.5
            more = {"scene": f"ball{count}", "primitives": count, "cell_id": f"{count}-{block}"}
            cells.append(cell | more)
    analysis = analyse(arranged(tmp_path, cells))
    chart = cost_over_primitives(analysis, Palette(analysis.results))
    assert chart is not None and cost_over_pixels(analysis, Palette(analysis.results)) is None
    assert [text.get_text() for text in figure(chart).legends[0].get_texts()] == ["numba (0.50)"]
    assert cost_over_primitives(analyse(arranged(tmp_path, cells[:6])), Palette(analysis.results)) is None


def test_short_log_axes_have_numbers_of_their_own():
    def labels(low, high):
        axis = new_figure().subplots()
        axis.plot([low, high], [1, 1])
        log_scales(axis)
        axis.figure.draw_without_rendering()
        return [text.get_text() for text in axis.get_xticklabels(minor=True) if text.get_text()]

    assert {"0.02", "0.05"} <= set(labels(0.015, 0.08)) and labels(1e-3, 1e2) == []


def test_file_names_are_safe():
    assert file_stem("pareto", "a b/c: d(e=1)") == "pareto-a_b_c__d_e_1_"
