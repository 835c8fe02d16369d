"""Learnt: what photographs teach of shadows and scattered light beyond their fit predicts one that was held out."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.image.relight.learnt import Learnt, learn
from hagoromo.measurement.normals.normals import NormalMap, least_squares_fit, robust_lambert
from hagoromo.measurement.normals.photometric_model import predicted
from hagoromo.measurement.surface.horizon import height_over_horizon

SIZE, PITCH = 47, 5e-4  # px, m
LAMPS, TILT = 11, 48.0  # lamps, the largest tilt from the line of sight [°]
NOISE = 1e-3  # of white


def directions() -> np.ndarray:
    k = np.arange(LAMPS) + 0.5
    cosine = 1.0 - (1.0 - np.cos(np.radians(TILT))) * k / LAMPS
    turn, sine = np.pi * (1.0 + np.sqrt(5.0)) * k, np.sqrt(1.0 - cosine**2)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)


def taken(depth_px: float, ambient: float) -> hg.Capture:
    """Photographs of a Lambertian dome with a hollow of this depth; what is lit gets `ambient` times its body more."""
    camera = hg.Camera(SIZE, SIZE, (1e5, 1e5), (SIZE / 2, SIZE / 2))
    camera = camera.look_at((0.0, 0.0, 1e5 * PITCH), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2
    radius2 = x * x + y * y
    height = 0.6 * np.sqrt(np.maximum(24.0**2 - radius2, 60.0)) - depth_px * np.exp(-0.5 * radius2 / 5.0**2)
    down, across = np.gradient(height)
    normals = np.stack([-across, down, np.ones_like(height)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    points = PITCH * np.stack([x, -y, height], axis=2)
    mask = radius2 < 22.0**2
    body, noise = np.array([0.7, 0.6, 0.5]) / np.pi, np.random.default_rng(4)
    rows, columns = np.nonzero(mask)
    photographs = []
    for number, to_lamp in enumerate(directions()):
        lit = np.zeros(mask.shape)
        over = height_over_horizon(points, camera, (rows, columns), np.broadcast_to(to_lamp, (mask.sum(), 3)))
        lit[rows, columns] = over > 0.0
        shade = np.maximum(normals @ to_lamp, 0.0) * lit + ambient
        values = np.pi * body * shade[..., None] + NOISE * noise.normal(size=(*mask.shape, 3))
        lamp = hg.Lamp(to_lamp=tuple(to_lamp), intensity=np.pi)
        photographs.append(
            hg.Photograph(values, np.full_like(values, NOISE**2), mask, camera, (lamp,), f"lamp {number}")
        )
    return hg.Capture(tuple(photographs), "dome", points=np.where(mask[..., None], points, 0.0))


def errors(capture: hg.Capture, held: int, boxes: bool = False) -> tuple[float, float, Learnt]:
    """Relative errors of the fit and of what was learnt, of the photograph `held`; and what was learnt.

    boxes: the fit has the hard cast shadows of the true shape, as volume boxes have.
    """
    rest = replace(capture, photographs=tuple(p for k, p in enumerate(capture.photographs) if k != held))
    views = hg.views_from_capture(rest)
    normals, body = robust_lambert(views)
    fit = replace(least_squares_fit(views), normals=normals, body=body)
    solved = NormalMap(
        views.image(normals),
        views.image(np.zeros(len(normals))),
        views.image(body.T),
        views.image(fit.labels),
        fit,
        views,
    )
    assert capture.points is not None
    camera, pixels = capture.photographs[0].camera, (views.rows, views.columns)
    over = [
        height_over_horizon(capture.points, camera, pixels, np.tile(one, (len(normals), 1))) for one in directions()
    ]
    passed = (np.stack(over) > 0.0).astype(np.float64) if boxes else np.ones((LAMPS, len(normals)))
    learnt = learn(rest, solved, passed=np.delete(passed, held, axis=0) if boxes else None)
    assert learnt is not None
    to_lamp = np.broadcast_to(directions()[held], (len(normals), 3))
    own = passed[held] * predicted(fit, to_lamp[None], views.to_eye)[0]
    true = (capture.photographs[held].values[views.rows, views.columns] / np.pi).T
    scale = np.sqrt(np.mean(true**2))
    fitted, found = (
        float(np.sqrt(np.mean((one - true) ** 2)) / scale) for one in (own, learnt.added(own, to_lamp, passed[held]))
    )
    return fitted, found, learnt


def test_shadows_and_scattered_light_are_learnt():
    """A hollow whose shadows the fit does not have: the error falls to less than 0.4 of it, interpolated and
    extrapolated; the horizon is known to less than 2°, as the shape is exact.
    """
    capture = taken(16.0, 0.04)
    for held in (LAMPS - 3, LAMPS - 1):
        fitted, found, learnt = errors(capture, held)
        assert fitted > 0.03 and found < 0.4 * fitted
        assert learnt.shadows is not None and learnt.shadows.spread < np.radians(2.0) and learnt.shadows.ambient > 0.0


def test_where_the_fit_is_right_nothing_is_learnt():
    """A dome without shadows: the prediction stays that of the fit, to a twentieth of its error."""
    capture = taken(0.0, 0.0)
    fitted, found, learnt = errors(capture, 4)
    assert learnt.neighbours is None
    assert found == pytest.approx(fitted, rel=0.05)


@pytest.mark.nightly
def test_what_boxes_show_learns_scattered_light():
    """Hard shadows are right, and scattered light is 0.04 of the body's: found in the shadows to 15 % (bodies have a
    part of it), as light that the fit has for the lamp's elsewhere; the error falls by a third or more.
    """
    fitted, found, learnt = errors(taken(16.0, 0.04), LAMPS - 1, boxes=True)
    assert fitted > 0.01 and found < fitted / 1.5
    assert learnt.shadows is not None and learnt.shadows.fitted == 1.0
    assert learnt.shadows.ambient == pytest.approx(0.04, rel=0.15)


def test_where_boxes_are_right_they_stay():
    """The same hollow without scattered light: no part predicts the photographs left out better, none is used."""
    fitted, found, learnt = errors(taken(16.0, 0.0), LAMPS - 1, boxes=True)
    assert learnt.shadows is None and learnt.neighbours is None
    assert found == fitted and fitted < 0.01


@pytest.mark.slow  # 20 s
def test_relit_boxes_have_the_light_from_all_around():
    """The whole way from photographs without a shape: with scattered light of 0.06 of the body's the boxes'
    error under lamps kept aside falls by a quarter or more (a third); without such light they stay as rendered.
    """
    held = [f"lamp {LAMPS - 3}", f"lamp {LAMPS - 1}"]
    error = {}
    for ambient in (0.06, 0.0):
        found = hg.relight(replace(taken(6.0, ambient), points=None), hold=held).predictions
        for key in ("boxes", "boxes_learnt"):
            error[key, ambient] = np.mean([one.compared[key].relative_rmse for one in found])
    assert error["boxes_learnt", 0.06] < 0.75 * error["boxes", 0.06]
    assert error["boxes_learnt", 0.0] == pytest.approx(error["boxes", 0.0], rel=1e-6)


def test_few_photographs_teach_nothing():
    capture = taken(0.0, 0.0)
    few = replace(capture, photographs=capture.photographs[:5])
    views = hg.views_from_capture(few)
    fit = least_squares_fit(views)
    empty = np.zeros((SIZE, SIZE), np.float32)
    solved = NormalMap(views.image(fit.normals), empty, empty, views.image(fit.labels), fit, views)
    assert learn(few, solved) is None
