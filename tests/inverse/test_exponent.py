"""Whether values are linear in light, by the shading of the object, with both errors of transfer."""

import re
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.camera.camera import unplaced_camera
from hagoromo.files.png import read_png
from hagoromo.measurement.linearity import linearity_of, why_not_tested
from hagoromo.photograph.exponent import Exponent, exponent_of
from tests.data import DATA, real_data
from tests.inverse.simulated_relief import SimulatedRelief, dome, relief_camera, relief_capture

SIDE, TO_EYE = 61, np.array([0.0, 0.0, 1.0])


def lamps(count: int, low: float, high: float) -> np.ndarray:
    around, up = 2.4 * np.arange(count), np.radians(np.linspace(low, high, count))
    return np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=1)


def sphere(to_lamp: np.ndarray, body: str, seed: int = 0) -> np.ndarray:
    """(K, P) light of a sphere of uneven albedo, 0 … 1, as 8 bits hold it; NaN where it is clipped."""
    random = np.random.default_rng(seed)
    y, x = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE * 2.1 - 1.05
    on = x**2 + y**2 < 0.97
    normal = np.stack([x, -y, np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))], axis=-1)[on]
    cosine = np.maximum(normal @ to_lamp.T, 0.0)
    if body == "rough":  # Minnaert's law
        cosine = cosine**1.15 * normal[:, 2:] ** 0.15
    if body == "glossy":
        half = np.add(to_lamp, (0.0, 0.0, 1.0))
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        cosine = cosine + np.exp(-((np.arccos(np.clip(normal @ half.T, -1.0, 1.0)) / 0.15) ** 2)) * (cosine > 0.0)
    light = cosine.T * random.uniform(0.4, 0.85, len(normal))
    noisy = light + random.normal(0.0, 0.003, light.shape)
    return np.where(light < 1.0, np.rint(255.0 * np.clip(noisy, 0.0, 1.0)) / 255.0, np.nan)


@pytest.mark.by_night("rough")
@pytest.mark.parametrize("body", ["matte", "rough", "glossy"])
def test_linear_values_are_not_called_bent_and_both_errors_of_transfer_are(body):
    to_lamp = lamps(8, 30.0, 75.0)
    light = sphere(to_lamp, body)
    right = exponent_of(light, to_lamp, TO_EYE)
    decoded = exponent_of(hg.srgb_decode(255.0 * light), to_lamp, TO_EYE)
    encoded = exponent_of(hg.srgb_encode(light) / 255.0, to_lamp, TO_EYE)
    assert right and decoded and encoded
    assert not right.bent and 0.8 < right.value < 1.2
    assert decoded.bent and "decoded" in decoded.sentence and encoded.bent and "display-encoded" in encoded.sentence


def test_what_cannot_tell_says_nothing():
    to_lamp = lamps(8, 30.0, 75.0)
    light = sphere(to_lamp, "matte")
    assert exponent_of(light[:5], to_lamp[:5], TO_EYE) is None and exponent_of(light[:, :40], to_lamp, TO_EYE) is None
    assert not Exponent(1.7, 0.4).bent and "too uncertain" in Exponent(1.7, 0.4).sentence
    near = hg.Lamp(position=(0.0, 0.0, 2.0))
    grey = np.full((3, 5, 3), 0.2, np.float32)
    camera = hg.Camera(5, 3, (10, 10), (2.5, 1.5))
    shot = hg.Photograph(grey, np.float32(0.01) * grey, np.ones((3, 5), bool), camera, (near,))
    for capture, said in [
        (hg.Capture((shot,) * 8), "near lamps, and neither points of the surface nor its distance"),
        (hg.Capture((shot,) * 5), "5 photographs, and the shading shows it from 6 on"),
        (hg.Capture((shot,) * 8, points=np.ones((3, 5, 3))), "too few pixels"),
        (hg.Capture((replace(shot, lamps=(near, near)),) * 8), "photographs under several lamps"),
    ]:
        assert linearity_of(capture) is None and why_not_tested(capture).startswith("not tested: " + said)


@pytest.mark.parametrize(
    ("value", "error", "finding", "said"),
    [
        (1.01, 0.01, "linear", "linear in light"),
        (1.7, 0.4, "uncertain", "too uncertain"),
        (1.32, 0.0435, "doubtful", "1.21 to 1.44 .* linear values have 1: "),
        (0.88, 0.02, "doubtful", "perhaps the matter is rough and darkens late"),
        (0.82, 0.02, "doubtful", "perhaps the photographs were linear"),
        (2.2, 0.05, "bent", "display-encoded"),
        (1.8, 1e6, "uncertain", "too uncertain"),
    ],
)
def test_whatever_leaves_one_out_is_said_with_what_to_do(value, error, finding, said):
    found = Exponent(value, error)
    assert found.finding == finding and re.search(said, found.sentence)
    assert found.contradicted == (finding in ("doubtful", "bent")) == ("--transfer" in found.advice)
    assert found.record()["interval_95"] == list(found.interval) and found.record()["finding"] == finding


@pytest.mark.by_night("matte-20")
@pytest.mark.parametrize("count", [6, 20])
@pytest.mark.parametrize("body", ["matte", "glossy"])
def test_linear_values_under_exact_lamps_are_not_doubted(body, count):
    """Before, 1.015 ± 0.003: the interval knew noise alone, not what 8 bits and dark pixels do to the estimate."""
    to_lamp = lamps(count, 20.0, 75.0)
    found = [exponent_of(sphere(to_lamp, body, seed), to_lamp, TO_EYE) for seed in range(3)]
    assert [one.finding for one in found if one] == ["linear"] * 3


@pytest.mark.parametrize("gloss", [True, False])
def test_a_flat_object_is_not_called_bent_for_its_highlights(gloss):
    """All of it brightens where lamps stand high; linear values of a glossy relief came out as contradicted."""
    found = linearity_of(relief_capture(SimulatedRelief(), relief_camera(48), dome(), 0, gloss))
    assert found is not None and found.finding == "linear"


def test_near_lamps_are_tested_at_the_points_of_the_surface():
    """Lamps at 3 radii of a ball, whose light falls off 4-fold over it: taken for far they give 0.75 to 1.5."""
    y, x = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE * 2.1 - 1.05
    on = x**2 + y**2 < 0.97
    points = np.stack([x, -y, np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))], axis=2)
    random, camera = np.random.default_rng(3), unplaced_camera(SIDE, SIDE, None)
    albedo = random.uniform(0.4, 0.85, on.shape)
    light, near = [], [hg.Lamp(position=3.0 * place, intensity=20.0) for place in lamps(8, 30.0, 75.0)]
    for lamp in near:
        towards, irradiance = lamp.direction_and_irradiance(points)
        cosine = np.maximum(np.sum(points * towards, axis=2), 0.0)
        light.append(albedo * cosine * np.asarray(irradiance) / np.pi + random.normal(0.0, 0.003, on.shape))
    white = max(one[on].max() for one in light)
    found = {}
    for name in ("right", "encoded"):
        shots = []
        for one, lamp in zip(light, near, strict=True):
            share = np.clip(one / white, 0.0, 1.0)
            shown = share if name == "right" else hg.srgb_encode(share) / 255.0
            values = np.repeat(shown[..., None], 3, axis=2).astype(np.float32)
            shots.append(hg.Photograph(values, np.full_like(values, 1e-5), on, camera, (lamp,)))
        found[name] = linearity_of(hg.Capture(tuple(shots), points=np.where(on[..., None], points, np.nan)))
    right, encoded = found["right"], found["encoded"]
    assert right is not None and 0.9 < right.value < 1.1 and not right.bent
    assert encoded is not None and encoded.bent


@real_data("uw_psm")
@pytest.mark.parametrize("name", ["gray", "owl"])
def test_real_photographs_are_linear_and_both_errors_show(name):
    """Twelve lamps, 8 bits, linear; the other four objects leave the wrong curves 1.4 to 3 standard errors off."""
    folder = DATA / "uw_psm"
    mask = read_png(folder / name / f"{name}.mask.png")
    on = mask.reshape(*mask.shape[:2], -1).max(axis=2) > 0
    rows = [line.split() for line in (folder / "lights_by_repo_author.txt").read_text().splitlines()[1:]]
    to_lamp = np.array([[float(x) for x in row[:3]] for row in rows if len(row) >= 3])
    numbers = np.stack(
        [read_png(folder / name / f"{name}.{k}.png")[on].reshape(on.sum(), -1).mean(1) for k in range(12)]
    )
    light = np.where(numbers < 254, numbers / 255.0, np.nan)
    right, decoded = exponent_of(light, to_lamp, TO_EYE), exponent_of(hg.srgb_decode(255.0 * light), to_lamp, TO_EYE)
    encoded = exponent_of(hg.srgb_encode(light) / 255.0, to_lamp, TO_EYE)
    assert right and decoded and encoded
    assert not right.bent and 0.85 < right.value < 1.2 and decoded.value < 0.65 and encoded.bent
