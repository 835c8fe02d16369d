"""Cast shadows on a known shape take no part in its materials, and no lobe is brighter than what was seen allows."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.measurement.material.cast_shadow import without_cast_shadows
from hagoromo.measurement.observations import Pixels
from hagoromo.measurement.photometric.gloss_posterior import BRIGHTEST_UNSEEN, GlossLaw, least_log_gamma
from hagoromo.measurement.sight import sight_of
from hagoromo.reflectance.facets import LN2
from tests.inverse.simulated_ball import BallMaterial, simulate

SIZE = 61
ANGLES = ((35, 20), (80, -15), (-40, 30), (-75, -10), (10, -60))
ROWS, COLUMNS = np.mgrid[:SIZE, :SIZE] / (SIZE - 1) * 2 - 1
GLOSSY = BallMaterial((0.20, 0.12, 0.08), 0.4, 0.25, 1.5)
SPOTS: Any = np.where((np.sin(18 * ROWS) * np.sin(18 * COLUMNS) > 0.3)[..., None], 0.1, 1.0) * (0.2, 0.12, 0.08)


def shadowed(capture, seed=5):
    """A post's shadow, soft over a pixel, in each photograph at another place; the capture, and where it is darker."""
    rng, photographs, where = np.random.default_rng(seed), [], []
    for photograph in capture.photographs:
        x, y = rng.uniform(-0.5, 0.5, 2)
        let_through = np.clip(SIZE / 2 * (np.hypot(COLUMNS - x, 0.5 * (ROWS - y)) - 0.2), 0.0, 1.0)
        values = photograph.values * let_through[..., None].astype(np.float32)
        photographs.append(replace(photograph, values=values))
        where.append((let_through < 1.0) & (photograph.values.sum(axis=2) > 0.0))
    return replace(capture, photographs=tuple(photographs)), np.stack(where)


def on_the_ball(capture):
    """Labels (h, w) of one material."""
    assert capture.normals is not None
    return np.where(np.linalg.norm(capture.normals, axis=2) > 0.5, 0, -1)


def test_shadows_are_found_with_their_soft_edges():
    """Of values that a fit would take, where over a quarter of the light, and ten standard deviations, are missing.

    Three photographs must show the pixel.
    """
    plain = simulate([GLOSSY], 3, SIZE, angles=ANGLES)
    capture, dark = shadowed(plain)
    cut, shadows = without_cast_shadows(capture, on_the_ball(capture))
    pairs = zip(plain.photographs, capture.photographs, strict=True)
    missing = np.stack([(a.values - b.values).sum(axis=2) for a, b in pairs])
    light = np.stack([one.values.sum(axis=2) for one in plain.photographs])
    noise = np.stack([np.sqrt(one.variance.sum(axis=2)) for one in plain.photographs])
    pixels = Pixels.where(plain, on_the_ball(plain) == 0)
    fitted = np.zeros(dark.shape, bool)
    for taken, one in zip(fitted, plain.photographs, strict=True):
        taken[pixels.rows, pixels.columns] = sight_of(one, pixels.points, pixels.normals).fit_to_use
    clear = dark & fitted & (fitted.sum(axis=0) >= 3) & (missing > np.maximum(0.25 * light, 10.0 * noise))
    assert clear.sum() > 500 and np.mean(shadows[clear]) > 0.98
    assert np.mean(shadows[~dark & (light > 0.0)]) < 0.05  # what lies beside a shadow
    for before, after, shadow in zip(capture.photographs, cut.photographs, shadows, strict=True):
        assert (after.mask == before.mask & ~shadow).all()


def test_the_material_is_as_without_shadows():
    """Its own colour and gloss, one for all pixels; the remark says how many values were left out."""
    plain = simulate([GLOSSY], 3, SIZE, angles=ANGLES)
    capture, dark = shadowed(plain)
    (material,) = measure_known_shape(capture).materials
    (without,) = measure_known_shape(plain).materials
    for key, truth in (("alpha", GLOSSY.alpha), ("gamma", 0.25)):
        low, high = material.interval_95[key]
        assert low <= truth <= high
        assert high - low < 2.0 * np.subtract(*without.interval_95[key][::-1])
    assert material.texture is not None and not material.texture["per_pixel"]
    assert material.gloss is None and without.gloss is None
    (said,) = [one for one in material.remarks if "cast shadow" in one]
    assert float(said.split()[0]) == pytest.approx(100.0 * dark.sum() / (material.pixels * len(ANGLES)), rel=0.35)
    assert not any("cast shadow" in one for one in without.remarks)


@pytest.mark.parametrize(
    "material",
    [
        BallMaterial((0.20, 0.12, 0.08), 0.0, 0.2, 1.5),
        BallMaterial((5e-4, 5e-4, 5e-4), 8.0, 0.15, 2.5),
        BallMaterial((2e-3, 2e-3, 2e-3), 1.0, 0.3, 1.5),
        BallMaterial(SPOTS, 0.4, 0.2, 1.5),
    ],
    ids=["matte", "metal", "dark", "spots"],
)  # fmt: skip
def test_what_is_dark_by_itself_is_no_shadow(material):
    capture = simulate([material], 1, SIZE, angles=ANGLES)
    assert not without_cast_shadows(capture, on_the_ball(capture))[1].any()


@pytest.mark.parametrize("tail", [0.0, 0.2])
def test_a_lobe_is_no_brighter_than_what_was_seen_lets_guess(tail):
    law = GlossLaw(np.array([0.0, np.log(0.3)]), np.diag([0.1, 0.04]))
    angles = np.array([0.1, 0.5, 1.2])
    gamma = np.exp(least_log_gamma(angles, tail, law))
    usual = 0.3 * np.exp(-2.0 * 0.2)
    seen = (
        np.exp(-LN2 * (angles / gamma) ** 2)
        if not tail
        else (1.0 + (2.0**tail - 1.0) * (angles / gamma) ** 2) ** (-1.0 / tail)
    )
    held = gamma < usual * (1.0 - 1e-9)
    assert seen[held] == pytest.approx(1.0 / BRIGHTEST_UNSEEN) and held[0]
    assert gamma[~held] == pytest.approx(usual) and (seen[~held] < 1.0 / BRIGHTEST_UNSEEN).all()
