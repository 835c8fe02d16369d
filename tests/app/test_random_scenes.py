"""The study of random scenes: a number draws one scene, and what blocks are off has no part of the truth's noise."""

import numpy as np
import pytest

import hagoromo as hg
from studies.drawn_scenes import MATTER, drawn_scene
from studies.random_scenes import holds, off


@pytest.mark.nightly
def test_a_number_draws_one_scene_and_many_draw_all_kinds_of_matter():
    drawn = [drawn_scene(number, 16) for number in range(60)]
    again = drawn_scene(7, 16)
    assert again.words == drawn[7].words and again.scene.record() == drawn[7].scene.record()
    words = " ".join(each.words for each in drawn)
    assert all(make.__name__.replace("_", " ") in words for make in MATTER)
    assert {len(each.scene.boxes) for each in drawn} == {1, 2} and any(each.scene.surfaces for each in drawn)
    for each in drawn:  # lamps without a size stand beside the boxes: march refuses those within
        for lamp in each.scene.lamps:
            assert not any(box.contains(place) for place in lamp.stands_at for box in each.scene.boxes)


def test_what_blocks_are_off_has_no_part_of_the_noise_of_the_truth():
    """Blocks that are 2 % off by chance, truths with 6 % of noise in a block: the mean of 40 is 2 %, ± 0.6 %."""
    random = np.random.default_rng(3)
    shape = (8, 8)
    squares, errors = [], []
    for _ in range(40):
        own = 0.02 * random.standard_normal(shape)
        truths = 1.0 + 0.06 * random.standard_normal((2, *shape))
        picture, truths = (np.kron(values, np.ones((8, 8))).astype(np.float64) for values in (1.0 + own, truths))
        found = off(picture, truths, np.ones(shape, bool), 1.0)
        squares.append(np.copysign(found["blocks"] ** 2, found["blocks"]))
        errors.append(found["square_noise"])
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.02, abs=0.006)
    assert np.std(squares) == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.3)


def test_stated_intervals_are_widened_by_the_noise_of_the_truth_alone():
    stated = {"mean": 0.01, "mean_interval": (0.0, 0.02), "blocks_interval": (0.01, 0.03)}
    found = {"mean": 0.015, "mean_noise": 0.0, "blocks": 0.02, "square_noise": 0.0}
    assert holds(found, stated) == {"mean": True, "blocks": True}
    assert holds(found | {"mean": 0.025, "blocks": 0.04}, stated) == {"mean": False, "blocks": False}
    assert holds(found | {"mean": 0.025, "blocks": 0.04, "mean_noise": 0.01, "square_noise": 0.001}, stated) == {
        "mean": True,
        "blocks": True,
    }


def test_a_drawn_scene_is_rendered():
    image = hg.render(drawn_scene(102, 8).scene)
    assert np.isfinite(image.weights).all() and image.weights.max() > 0.0
