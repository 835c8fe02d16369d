"""Many lamps: what is computed at once for all of them is what each of them gives, and the same fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import hagoromo as hg
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.lamp_shift import _one, shifted
from hagoromo.measurement.normals.lobe_samples import RELATIVE_ERROR, samples_of, trust_of
from hagoromo.measurement.normals.normals import START_GLOSS, least_squares_fit
from hagoromo.measurement.normals.photometric_model import Prior
from hagoromo.measurement.normals.photometric_step import PixelProblem, PixelStep
from hagoromo.measurement.normals.shading import Gloss
from hagoromo.measurement.normals.views import views_from_capture
from studies.glossy_objects import glossy_object


def test_far_lamps_together_are_far_lamps_one_by_one():
    """Slopes in closed form are those of finite differences, whose steps of 1e-5 rad leave an error of that size."""
    views = views_from_capture(glossy_object("glaze", size=24)[0])
    shift = 0.02 * np.random.default_rng(3).normal(size=(len(views.lamps), 3))
    places = views.points, views.farther(1.0), views.farther(1.0 + 1e-5)
    each = [_one(lamp, by, places) for lamp, by in zip(views.lamps, shift, strict=True)]
    together = shifted(views, shift, 0.0)
    for one, name in enumerate(together._fields):
        np.testing.assert_allclose(getattr(together, name), np.stack([part[one] for part in each]), atol=3e-5)


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:exponent")  # the body under a coat darkens late
def test_a_measurement_has_one_thread_of_blas_and_leaves_the_setting_as_it_was():
    """So its bits are the same however many cores there are; with more, threads mostly wait for each other."""
    during: list[int] = []

    def threads() -> dict[str, int]:
        return {pool["filepath"]: pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        hg.measure(glossy_object("glaze", size=24)[0], progress=lambda *_: during.extend(threads().values()))
        after = threads()
    assert set(before.values()) == {2} and set(during) == {1}
    assert {path: after[path] for path in before} == before


def test_bodies_beside_a_highlight_are_those_of_least_squares():
    """The device, in single precision, against the weights written out in double precision: to 1e-4 of a body."""
    capture, _ = glossy_object("glaze", size=24)
    views = views_from_capture(capture)
    fit = replace(least_squares_fit(views), gloss=Gloss.alike((0.0, np.log(0.2), 0.0, 0.0), 1, 3))
    trust = trust_of(capture, views)
    samples = samples_of(views, fit, views.place, trust)
    interface = samples.column(0.2)
    found = samples.numbers(samples.bodies(interface))
    lit, lobes = (samples.numbers(one).astype(np.float64)[:, None] for one in (samples.body, interface))
    values, known = views.values, trust.trusted[:, None] | trust.lower
    noise = np.where(trust.lower, np.median(views.variance[np.isfinite(views.variance)]), views.variance)
    stated = known / (noise + (RELATIVE_ERROR * np.maximum(values, values.mean(axis=0))) ** 2)
    weight = stated
    for _ in range(2):
        body = np.sum(weight * lit * (values - lobes), axis=0) / np.sum(weight * lit**2, axis=0)
        body = np.maximum(body, 1e-4 * body.mean())
        missing = np.maximum(body * lit + lobes - values, 0.0)
        weight = stated / (1.0 + missing**2 * stated / CAUCHY_SCALE**2) * ~(trust.lower & (missing > 0.0))
    np.testing.assert_allclose(found, body, rtol=1e-4)


def test_eliminated_pixels_follow_as_in_one_system():
    """The step of what pixels share, and theirs by elimination, is that of the least squares of all of them at once."""
    views = views_from_capture(glossy_object("glaze", size=12)[0])
    start = replace(least_squares_fit(views), gloss=Gloss.alike(START_GLOSS, 1, 3))
    problem = PixelProblem(views, views.place, 0.1, Prior(), np.ones(start.gloss.rows.shape, bool))
    step = PixelStep(problem, start)
    outer, rhs, local = step._reduced(0.0)
    change = np.asarray(np.linalg.solve(outer, rhs), np.float64)
    own, gloss, lamps, depth = step._slopes
    weight, left = step.weight_of_rows[..., None], step._slopes[0].swapaxes(1, 2)
    count = len(views.values)
    by_lamp = np.zeros((*own.shape[:2], count, lamps.shape[2]))
    for row in range(own.shape[1]):
        by_lamp[:, row, row // 3] = lamps[:, row]
    shared = np.concatenate([gloss, by_lamp.reshape(*own.shape[:2], -1), depth], axis=2)
    deviation = np.moveaxis(step.deviation, 2, 0).reshape(len(own), -1) - shared @ change
    of_pixel = np.linalg.solve(left @ (own * weight) + 1e-9 * np.eye(5), left @ (weight * deviation[..., None]))
    np.testing.assert_allclose(local.after(change), of_pixel[..., 0], atol=1e-6 * np.abs(of_pixel).max())
