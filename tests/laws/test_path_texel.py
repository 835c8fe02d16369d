"""Mode path through a texel, at its finest level, sees the light of all orders of the same matter in a plain box."""

import numpy as np
import pytest

import hagoromo as hg
from tests.laws.test_texel import plain, quick_sheet

EYE = np.array([0.3, -1.0, 0.4]) / np.linalg.norm([0.3, -1.0, 0.4])
WALKS = 96


def light(box):
    """Means of the first order and of higher ones over a picture of 6 mm of the middle, and their standard errors."""
    focal = 32 * 0.08 / 6e-3
    camera = hg.Camera(32, 32, (focal, focal), (16.0, 16.0)).look_at(0.08 * EYE, (0.0, 0.0, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.6, -0.7, 0.5)), hg.Lamp(position=(-0.2, -0.3, 0.25))), (box,))
    pictures = [hg.render(scene, hg.Settings(samples=WALKS // 4, seed=seed), mode="path") for seed in range(4)]
    each = np.array([picture.weights for picture in pictures], float)
    first, higher = each[..., :2].sum(axis=-1), each[..., 2:].mean(axis=-1)  # all bands are alike: white
    means = np.array([part.mean(axis=(1, 2)) for part in (first, higher)])
    return means.mean(axis=1), means.std(axis=1, ddof=1) / 2.0, np.mean([picture.alpha for picture in pictures])


def test_matter_of_a_texel_is_that_of_a_plain_box_in_all_orders(few_match_points):
    """2 % is granted to the lattices, which interpolate the same bars in other places, as for the march."""
    white = hg.Reflectance(0.3, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element="cylinder")
    textured, error, opacity = light(quick_sheet(extinction="projected").with_materials([white, white]))
    voxels, other_error, other_opacity = light(plain(extinction="projected").with_materials([white]))
    assert opacity == pytest.approx(other_opacity, rel=0.02)
    noise = np.hypot(error, other_error)
    assert voxels[1] > 0.1 * voxels[0] and (noise < 0.03 * voxels).all()
    assert (np.abs(textured - voxels) < 0.02 * voxels + 4.0 * noise).all()
