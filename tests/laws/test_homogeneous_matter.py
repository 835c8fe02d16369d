"""A homogeneous block with a flat face has a closed form at every density: the promise of the tolerance, held to it.

From half a mean free path a voxel to matter that nothing passes, lamps from straight above the face down to 5°, a hard
face, one that falls off over a voxel, and two boxes in one place.
"""

import dataclasses

import numpy as np
import pytest

import hagoromo as hg
from tests.oracle.blocks import DEPTHS, FACES, HEIGHTS, LAMPS, error_and_ratio_by_lamp, light_over_closed_form, rays
from tests.oracle.scenes import BLUE, MATTE, RED, block, camera


@pytest.mark.parametrize("shadows", ["march", "map"])
@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize(
    ("depth", "tolerance"),
    [
        (DEPTHS[0], 0.01),
        *((depth, 0.04) for depth in DEPTHS[::2]),
        *(pytest.param(depth, 0.04, marks=pytest.mark.nightly) for depth in DEPTHS[1::2]),
        *(pytest.param(depth, 0.01, marks=pytest.mark.nightly) for depth in DEPTHS[1:3]),
    ],
)
def test_a_block_is_its_closed_form(depth, face, shadows, tolerance):
    """Root mean square over the mean, lamp by lamp, within the tolerance."""
    ratio = light_over_closed_form(depth, face, hg.Settings(shadows=shadows, tolerance=tolerance))
    error, mean = error_and_ratio_by_lamp(ratio)
    assert (error < tolerance).all(), dict(zip(HEIGHTS, mean.round(4).tolist(), strict=True))


@pytest.mark.parametrize("shadows", ["march", "map"])
@pytest.mark.parametrize("depth", [0.1, 0.4, 1.2])
def test_two_equal_boxes_in_one_place_share_the_light(depth, shadows):
    """They differ in colour only: each sends half, to 1 %, whichever is named first. depth: mean free paths a voxel."""
    origin, direction = rays()
    voxels = [block(depth, shape=(7, 23, 23), matter=dataclasses.replace(MATTE, body_colour=c)) for c in (RED, BLUE)]
    scene = hg.Scene(camera(), LAMPS[1:2], tuple(v.box() for v in voxels))
    light = hg.RayMarch(scene, hg.Settings(shadows=shadows))(origin, direction).weights[:, :2]
    assert light.min() > 0.0
    assert np.abs(light[:, 0] / light[:, 1] - 1.0).max() < 0.01
