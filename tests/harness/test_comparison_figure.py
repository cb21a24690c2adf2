"""`raybench figure`: its errors are those of the pixels that it shows, and what it cannot show is said in a line."""

from dataclasses import replace

import numpy as np
import pytest

from engines.errors import ConfigError
from engines.image import read_image
from harness.metrics import Reference, measure
from harness.report import comparison_figure as made
from harness.report.moments import Moment, moment_of
from harness.report.plots.figures import style
from harness.report.tables.model import number_text
from harness.store.results import load_results
from tests.harness import sweeping
from tests.harness.synthetic import write_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("figure") / "results", seeds=3, threads=(1,))


@pytest.fixture(scope="module")
def results(folder):
    return load_results(folder)


def drawn(results, taken, crops, **options):
    reference = made.reference_of(results, taken)
    with style():
        return made.comparison_figure(results, taken, reference, crops, **options), reference


def test_each_crop_has_the_error_of_its_pixels(results):
    taken = made.taken_images(results, "cornell_box", Moment())
    crop = made.Crop(8, 4, 16, 12)
    figure, reference = drawn(results, taken, [crop], with_plot=False)
    shown = {text.get_text() for axis in figure.axes for text in axis.texts}
    part = (slice(4, 16), slice(8, 24))
    for one in taken:
        cut = Reference(*(getattr(reference, n)[part] for n in ("mean", "half_1", "half_2", "variance")), spp=reference.spp)
        scores = measure(one.image[part], cut, 0.01)
        assert number_text(scores["relmse_e0.01_corrected"]) in shown
        assert f"{one.point.spp} spp, {number_text(one.point.seconds)} s" in shown
    images = [axis.images[0].get_array() for axis in figure.axes if axis.images]
    assert len(images) == len(taken) + 2 and {image.shape for image in images[1:]} == {(12, 16, 3)}


def test_images_are_those_of_the_moment(results):
    at_spp = made.taken_images(results, "cornell_box", moment_of("64spp"))
    assert at_spp and {taken.point.spp for taken in at_spp} == {64}
    last = made.taken_images(results, "cornell_box", moment_of("last"))
    seconds = sorted(taken.point.seconds for taken in last)[1]
    for taken in made.taken_images(results, "cornell_box", moment_of(f"{seconds}s")):
        later = [p for p in taken.contestant.done[0].points if p.image and p.spp > taken.point.spp]
        assert taken.point.seconds <= seconds and all(p.seconds > seconds for p in later)


def test_contestants_come_in_the_order_of_their_names_or_of_falling_error(results):
    taken = made.taken_images(results, "cornell_box", Moment())
    errors = [taken.point.metrics["relmse_e0.01_corrected"] for taken in taken]
    assert errors == sorted(errors, reverse=True) and len(taken) > 2
    names = [one.contestant.name for one in taken][:2]
    assert [t.contestant.name for t in made.taken_images(results, "cornell_box", Moment(), names)] == names


def test_crops_of_choice_do_not_overlap_and_lie_inside():
    image = np.random.default_rng(1).random((60, 90, 3))
    one, other = made.chosen_crops(image)
    assert abs(one.x - other.x) >= one.width or abs(one.y - other.y) >= one.height
    assert all(c.x + c.width <= 90 and c.y + c.height <= 60 for c in (one, other))


@pytest.mark.parametrize("text", ["1,2,3", "1,2,3,x", "1,2,0,4", "-1,2,3,4"])
def test_what_is_no_crop_is_refused(text):
    with pytest.raises(ConfigError, match="expected x,y,width,height"):
        made.crop_of(text)


@pytest.mark.parametrize("text", ["soon", "0s", "2.5spp", "infs"])
def test_what_is_no_moment_is_refused(text):
    with pytest.raises(ConfigError, match="expected a time"):
        moment_of(text)


def test_what_cannot_be_shown_is_named(results):
    for arguments, words in (
        (("nowhere", Moment()), "scene 'nowhere' is not among"),
        (("cornell_box", Moment(seconds=1e-9)), "has no image within"),
        (("cornell_box", Moment(), ["nobody"]), "--contestant 'nobody'"),
    ):
        with pytest.raises(ConfigError, match=words):
            made.taken_images(results, *arguments)
    taken = made.taken_images(results, "cornell_box", Moment())
    with pytest.raises(ConfigError, match="the image has 48 x 36 pixels"):
        drawn(results, taken, [made.Crop(40, 0, 16, 8)])
    with pytest.raises(ConfigError, match="do not fit"):
        drawn(results, taken, [made.Crop(0, 0, 16, 8)], width=3)


def test_the_command_writes_figure_and_crops(folder, tmp_path):
    figure, crops = tmp_path / "figure.pdf", tmp_path / "crops"
    arguments = ["--scene", "cornell_box", "--crops", "8,4,16,12", "2,2,6,6", "-o", figure, "--exr", crops]
    done = sweeping.raybench("figure", folder, *arguments)
    assert done.returncode == 0, done.stderr
    assert figure.read_bytes().startswith(b"%PDF")
    results = load_results(folder)
    taken = made.taken_images(results, "cornell_box", Moment())
    assert len(list(crops.iterdir())) == 2 * (len(taken) + 1)
    expected = made.reference_of(results, taken).mean[4:16, 8:24]
    np.testing.assert_allclose(read_image(crops / "crop1-reference.exr"), expected, rtol=1e-3)
    again = sweeping.raybench("figure", folder, "--scene", "nowhere", "-o", figure)
    assert again.returncode == 2 and "Traceback" not in again.stderr


def test_no_two_curves_of_a_figure_look_alike(results):
    one = made.taken_images(results, "cornell_box", Moment())[0]
    settings = replace(one.contestant.settings, precision="float16")
    other = one._replace(contestant=replace(one.contestant, settings=settings))
    figure, _ = drawn(results, [one, other], [made.Crop(8, 4, 16, 12)])
    curves = [line for line in figure.axes[-1].lines if line.get_marker() != "o"]
    assert len({(line.get_color(), line.get_linestyle()) for line in curves}) == len(curves) == 2
