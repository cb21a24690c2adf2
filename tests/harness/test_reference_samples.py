"""How many samples a reference needs: the estimate brings errors to ten standard errors; plan and run say it."""

import math

import numpy as np
import pytest

from engines.film import Film
from harness.config import Quality
from harness.config.settings import SceneFile
from harness.metrics import Reference, measure
from harness.plan.references import PlannedReference
from harness.run import reference_samples, references
from harness.statistics.reference_noise import samples_needed

SHAPE = (32, 32, 3)
SPEC = {
    "replicates": 8,
    "replicate_spp": 32,
    "width": 32,
    "height": 32,
    "shader": {"name": "path_tracer"},
    "sampler": {"name": "random"},
    "seed": 9000,
    "engine": "embree",
}


@pytest.fixture
def picture():
    """A truth, and a function that makes images of n samples with skewed noise about it."""
    rng = np.random.default_rng(1)
    truth = rng.lognormal(-1, 0.7, (32, 32, 1)) * rng.uniform(0.3, 1, SHAPE)
    truth[3:6, 4:8] = 8.0
    sigma = 0.6 * (0.05 + truth) * rng.lognormal(0, 0.5, (32, 32, 1))

    def image(n):
        return truth + sigma * (rng.gamma(0.3 * n, 1.0, (32, 32, 1)) - 0.3 * n) / math.sqrt(0.3) / n

    return image, float((sigma**2 / (truth**2 + 0.01)).mean()), float((np.ones(SHAPE) * sigma**2).mean())


def reference_of(images, spp):
    film = Film(32, 32)
    for image in images:
        film.add(image)
    return Reference(film.mean(), film.half(0), film.half(1), film.variance_of_mean(), spp)


@pytest.mark.parametrize("target", [0.1, 0.01, 0.001])
@pytest.mark.parametrize("epsilon", [0.01, None])
def test_with_the_samples_that_are_needed_errors_stand_ten_standard_errors_above_zero(picture, target, epsilon):
    """Over eight pilots of 256 samples: the middle ratio is 8 to 20, single ones differ by a factor of two and more."""
    draw, relative, absolute = picture
    name = "relmse_e0.01" if epsilon else "mse"
    spp = max(1, round((relative if epsilon else absolute) / target))
    ratios = []
    for _ in range(8):
        needed = samples_needed(reference_of([draw(32) for _ in range(8)], 256), target, epsilon)
        for _ in range(5):
            scores = measure(draw(spp), reference_of([draw(needed / 2) for _ in range(2)], needed), 0.01)
            ratios.append(scores[f"{name}_corrected"] / scores[f"{name}_se"])
    assert 8 < np.median(ratios) < 20


def test_a_larger_pilot_gives_the_same_answer(picture):
    """To a factor of two: of few samples neither the largest variances nor the radiance beside them are known well."""

    def needed(each):
        pilots = [reference_of([picture[0](each) for _ in range(16)], 16 * each) for _ in range(9)]
        return np.median([samples_needed(pilot, 0.01, 0.01) for pilot in pilots])

    few, many = needed(16), needed(256)
    assert 0.5 < few / many < 2
    exact = np.ones(SHAPE)
    assert samples_needed(Reference(exact, exact, exact, np.zeros(SHAPE), 4), 0.01, 0.01) == 1


def said(wanted, root, **quality):
    given = {"metric": "relmse", "epsilon": 0.01, "targets": (0.1, 0.01), **quality}
    return reference_samples.sufficiency(wanted, root, Quality(**given))


def made(root, draw, done, **changes):
    """A reference with `done` of its replicates on disk."""
    wanted = PlannedReference(SceneFile("box", "box"), "abc", {**SPEC, **changes}, {})
    film = Film(32, 32)
    for _ in range(done):
        film.add(draw(wanted.spec["replicate_spp"]))
    if done:
        references._save(wanted.folder(root), wanted, film, 1.0)
    return wanted


def test_before_the_first_replicates_nothing_is_known(tmp_path, picture):
    found = said(made(tmp_path, picture[0], 0), tmp_path)
    assert found.enough is None and "not known before its first replicates" in found.message and "0.01" in found.message


def test_a_reference_says_whether_its_own_samples_are_enough(tmp_path, picture):
    wanted = made(tmp_path, picture[0], 8, replicate_spp=128)
    assert said(wanted, tmp_path, targets=(0.1,)).enough is True
    short = said(wanted, tmp_path, targets=(0.1, 1e-5))
    assert short.enough is False and "the target 1e-05 in" in short.message and "flagged" in short.message
    assert said(wanted, tmp_path, metric="mse").enough is False


def test_a_part_of_a_reference_or_another_one_of_the_image_is_a_pilot(tmp_path, picture):
    made(tmp_path, picture[0], 4, engine="numba", seed=1)
    assert said(made(tmp_path, picture[0], 0, replicates=256), tmp_path).enough is True
    assert said(made(tmp_path, picture[0], 0, sampler={"name": "sobol"}), tmp_path).enough is None
    assert said(made(tmp_path, picture[0], 0, width=64), tmp_path).enough is None
    alone = made(tmp_path / "other", picture[0], 1)
    assert said(alone, tmp_path / "other").enough is None, "one replicate has no variance"


def test_without_a_formula_the_message_says_how_it_is_checked(tmp_path, picture):
    wanted = made(tmp_path, picture[0], 8)
    assert "checked against its halves" in said(wanted, tmp_path, metric="ssim", targets=(0.9,)).message
    assert "chosen from the first results" in said(wanted, tmp_path, targets=None).message
