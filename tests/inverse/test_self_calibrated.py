"""Lamps refined together with surface, albedos and gloss: what Lambert's law alone cannot tell of glossy bodies."""

import numpy as np
import pytest

from hagoromo.calibration.lamps.uncalibrated import self_calibrate
from hagoromo.calibration.lamps.uncalibrated.bas_relief import entropy
from hagoromo.calibration.lamps.uncalibrated.calibrate_from_object import refined_lamps
from hagoromo.calibration.lamps.uncalibrated.joint_surface import height_field
from tests.inverse.simulated_mirror import degrees_between, unit
from tests.inverse.test_self_calibration import LAMPS, STRENGTH, shaped


def rough_and_glossy(mask, normal, albedo, width):
    """Name → light: Oren and Nayar's body in Fujii's form, Beckmann's highlights, 3 % of light from below, 8 bits."""
    shown, eye = {}, np.array([0.0, 0.0, 1.0])
    for k, lamp in enumerate(LAMPS):
        incidence, view = np.maximum(normal @ lamp, 0.0), normal[..., 2]
        s = lamp[2] - incidence * view
        body = incidence * (0.94 + 0.2 * s / np.where(s > 0.0, np.maximum(np.maximum(incidence, view), 0.05), 1.0))
        half = np.clip(normal @ unit(lamp + eye), 1e-3, 1.0)
        shine = 0.15 * np.exp(-np.log(2) * (1.0 / half**2 - 1.0) / np.tan(width) ** 2) * (incidence > 0.0)
        body = body + 0.03 * (1.0 - normal[..., 1]) / 2.0
        light = STRENGTH[k] * (albedo * body[..., None] + (shine / np.maximum(view, 0.2))[..., None])
        light = np.round(np.clip(0.9 * light, 0.0, 1.0) * 255.0) / 255.0
        shown[str(k)] = np.where(mask[..., None], np.where(light < 0.98, light, np.nan), 0.0)
    return shown


@pytest.mark.nightly
def test_gloss_and_roughness_tell_what_shading_alone_does_not():
    """1.5° in the mean and 3 % of strength with a gloss 17° wide, on a body, under light that the model does not know.

    1.5° is what light from below costs; shading alone is off by more than twice as much, and stated errors cover both.
    """
    mask, normal, albedo = shaped("bumpy")
    shown = rough_and_glossy(mask, normal, albedo, 0.3)
    start = self_calibrate(shown, mask)
    found = refined_lamps(shown, mask, None, start)
    before, after = degrees_between(start.to_lamp, LAMPS), degrees_between(found.to_lamp, LAMPS)
    assert after.mean() < 1.5 and after.mean() < 0.5 * before.mean()
    assert (after < 2 * found.standard_error_deg).all() and found.standard_error_deg.max() < 6.0
    ratio = np.log(found.strength / STRENGTH)
    off = np.abs(ratio - np.median(ratio, axis=0))
    assert off.max() < 0.03 and (off.T < 3 * found.strength_error).all()
    assert found.convex == start.convex and found.names == start.names


@pytest.mark.parametrize("spread", [0.0, 0.6])
def test_a_height_field_goes_through_the_normals_of_a_surface(spread):
    """0.5°, from afar and in perspective: slopes are differences over a pixel, of a dome 60 pixels wide."""
    row, column = np.mgrid[:61, :67] + 0.5
    x, y = (column - 33.5) / 61.0, -(row - 30.5) / 61.0
    tangent = spread * np.stack([x, y], axis=2)
    mask = x**2 + y**2 < 0.2
    field = height_field(mask, tangent)
    # corners in the order of the field's unknowns
    down, right = np.mgrid[:62, :68]
    near = np.zeros(down.shape, bool)
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        near[i : i + 61, j : j + 67] |= mask
    distance = (right[near] - 33.5) ** 2 + (down[near] - 30.5) ** 2
    depth = (0.3 if spread else 61.0) * distance / 61.0**2
    normals = field.normals(depth)[0]
    again = field.normals(field.through(3.0 * normals))[0]
    assert degrees_between(again, normals).max() < 0.5


def test_the_slope_of_the_entropy_is_its_difference():
    """1 %: the two values about the median move a little, and the histogram with them."""
    random = np.random.default_rng(5)
    values = np.concatenate([random.normal(0.0, 0.05, 307), random.normal(0.9, 0.08, 211)])
    way = np.sin(3.0 * (values - np.median(values)))
    step = 1e-6
    change = (entropy(values + step * way)[0] - entropy(values - step * way)[0]) / (2.0 * step)
    assert np.isclose(entropy(values)[1] @ way, change, rtol=0.01)
