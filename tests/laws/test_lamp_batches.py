"""Many lamps: light adds, so that a picture under batches of them is the one under all of them."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.image import preview
from hagoromo.image.prepared import lamp_batches
from hagoromo.image.prepared.lamp_batches import LAMPS_AT_ONCE, WeightsOfLamps
from hagoromo.transport import lighting
from hagoromo.transport.frames import DEFAULT_TOLERANCE
from hagoromo.transport.lighting import MOST_LAMPS
from hagoromo.transport.palette import palette_of

MATTE = hg.Reflectance(alpha=0.25, beta=0.0, gamma=0.2, n=1.5, body_colour=hg.Spectrum.constant(1.0))
CAMERA = hg.Camera(9, 7, (26, 26), (4.5, 3.5)).look_at(eye=(0, -1, 0), target=(0, 0, 0))
RED, BLUE = (hg.Spectrum([400, 600, 700], values) for values in ([0, 0.2, 1], [1, 0.2, 0]))


def many_far_lamps(count: int) -> list[hg.Lamp]:
    """On the camera's side of the scene, all strengths different, every third one blue."""
    random = np.random.default_rng(7)
    towards = random.normal(size=(count, 3)) * [1, 1, 1] - [0, 1.5, 0]
    return [
        hg.Lamp(to_lamp=place, intensity=1.0 + k / count, spectrum=RED if k % 3 else BLUE)
        for k, place in enumerate(towards)
    ]


def test_six_hundred_lamps_give_the_sum_of_two_halves_of_them():
    """Of a matte ball, exact: the irradiance of each lamp times α; the two spectra apart, in the order of the lamps."""
    lamps, settings = many_far_lamps(600), hg.Settings(shadows="none")
    ball = hg.Surface.sphere(centre=(0, 0, 0), radius=0.1, reflectance=MATTE)
    whole, *halves = (
        hg.render(hg.Scene(CAMERA, tuple(part), surfaces=(ball,)), settings)
        for part in (lamps, lamps[:300], lamps[300:])
    )
    total = sum(half.weights.astype(np.float64) for half in halves)
    assert whole.weights.shape == (7, 9, 4) and len(whole.palette.lamp_groups) == 600 > MOST_LAMPS
    np.testing.assert_allclose(whole.weights, total, rtol=1e-5)  # 20 sums of single precision
    np.testing.assert_array_equal(whole.alpha, halves[0].alpha)
    normal = np.array([0.0, -1.0, 0.0])  # of the ball in the middle of the picture
    for group, spectrum in enumerate((BLUE, RED)):  # in the order in which lamps have them
        own = [lamp for lamp in lamps if lamp.spectrum is spectrum]
        exact = sum(0.25 * np.asarray(lamp.intensity).item() * max(float(lamp.to_lamp @ normal), 0.0) for lamp in own)
        assert whole.weights[3, 4, 2 * group] == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("separate", [False, True])
def test_batches_of_all_kinds_of_lamps_give_the_picture_of_one(monkeypatch, separate):
    """Far lamps, near ones and spots in turn, of two spectra, over a volume box with shadow maps.

    Steps of the march follow the lamps, so that the bound is that of the picture, `Settings.tolerance`.
    """
    record = {"alpha": 0.2, "beta": 0.1, "gamma": 0.2, "n": 1.5, "body_colour": 0.8}
    shape = {"form": "sphere", "radius_mm": 2.0}
    box = hg.build({"kind": "solid", "shape": shape, "voxel_mm": 0.4, "material": record})
    camera = hg.Camera(9, 7, (60, 60), (4.5, 3.5)).look_at(eye=(0, -0.05, 0.002), target=(0, 0, 0.002))
    lamps = []
    for k in range(7):
        place = np.array([np.cos(k), -1.0 - 0.2 * k, np.sin(k)])
        spectrum = RED if k in (1, 2, 5) else BLUE
        lamps += [
            (hg.Lamp(to_lamp=place, spectrum=spectrum), hg.Lamp(position=place, spectrum=spectrum),
             hg.Lamp(position=place, axis=-place, spectrum=spectrum))[k % 3]
        ]  # fmt: skip
    scene, settings = hg.Scene(camera, tuple(lamps), (box,)), hg.Settings(separate_lamps=separate, samples=2)
    one = hg.render(scene, settings)
    monkeypatch.setattr(lamp_batches, "LAMPS_AT_ONCE", 3)
    assert sorted(map(len, lamp_batches.lamp_batches(lamps))) == [1, 3, 3]
    whole = hg.render(scene, settings)
    assert whole.channel_names() == one.channel_names() and whole.lamp_names == one.lamp_names
    assert whole.palette.lamp_groups == one.palette.lamp_groups and whole.metadata == one.metadata
    error = np.sqrt(np.mean((whole.weights - one.weights) ** 2, axis=(0, 1)))
    mean = one.weights.mean(axis=(0, 1))
    assert (mean > 0).all() and (error < DEFAULT_TOLERANCE * mean).all()
    monkeypatch.setattr(preview, "FIRST_RAYS", 4)
    *coarse, last = hg.preview(scene, settings)
    assert [image.metadata["preview"]["stride"] for image in coarse] == [4, 2]
    assert last.weights.tobytes() == whole.weights.tobytes() and last.metadata["preview"]["share"] == 1.0


def six_lamps_over_a_floor(near):
    """A dense ball over a floor, under six near or far lamps."""
    record = {"alpha": 0.2, "beta": 0.1, "gamma": 0.2, "n": 1.5, "body_colour": 0.8}
    box = hg.build(
        {"kind": "solid", "shape": {"form": "sphere", "radius_mm": 2.0}, "voxel_mm": 0.4, "material": record}
    )
    camera = hg.Camera(9, 7, (60, 60), (4.5, 3.5)).look_at(eye=(0, -0.05, 0.012), target=(0, 0, 0.002))
    places = [np.array([np.cos(k), -1.0 - 0.2 * k, 0.3 + np.sin(k) ** 2]) for k in range(6)]
    lamps = tuple(hg.Lamp(position=place) if k in near else hg.Lamp(to_lamp=place) for k, place in enumerate(places))
    return hg.Scene(camera, lamps, (box,), surfaces=(hg.Surface.floor(-0.001, 0.02, MATTE),))


@pytest.mark.by_night("map-near", "map-far", "march-near", "march-one near")
@pytest.mark.parametrize("near", [range(6), (), (0, 2, 3), (4,)], ids=["near", "far", "mixed", "one near"])
@pytest.mark.parametrize("shadows", ["map", "march"])
def test_a_loop_through_lamps_gives_the_bits_of_one_after_the_other(monkeypatch, near, shadows):
    scene, settings = six_lamps_over_a_floor(near), hg.Settings(shadows=shadows)
    looped = hg.render(scene, settings)
    monkeypatch.setattr(lighting, "MOST_UNROLLED", 6)
    assert hg.render(scene, settings).weights.tobytes() == looped.weights.tobytes() and looped.weights.max() > 0.0


def test_lamps_in_parts_give_the_picture_of_all_in_one_kernel(monkeypatch):
    """Steps of the march follow the lamps of a part, so that the bound is that of the picture; coverage is the same."""
    scene = six_lamps_over_a_floor(range(6))
    whole = hg.render(scene)
    monkeypatch.setattr(lighting, "LAMPS_OF_A_PART", 2)
    parts = hg.render(scene)
    error = np.sqrt(np.mean((parts.weights - whole.weights) ** 2, axis=(0, 1)))
    assert (error < DEFAULT_TOLERANCE * whole.weights.mean(axis=(0, 1))).all()
    assert parts.alpha.tobytes() == whole.alpha.tobytes()


def test_weights_of_very_many_lamps_are_refused_before_they_take_memory():
    lamps = [hg.Lamp(to_lamp=(0, -1, 0)) for _ in range(10_000)]
    palette = palette_of([MATTE], [], []).with_lamps(lamps, separate=True)
    with pytest.raises(hg.InputError, match="1000000 × 100000 pixels with 20000 weights each needs"):
        WeightsOfLamps(palette, (100_000, 1_000_000))


def test_batches_hold_every_lamp_once_and_no_more_than_a_kernel_takes():
    for count in (1, LAMPS_AT_ONCE, LAMPS_AT_ONCE + 1, 600, 601, 10_000):
        batches = lamp_batches.lamp_batches(many_far_lamps(count))
        assert sorted(number for batch in batches for number in batch) == list(range(count))
        assert max(map(len, batches)) <= LAMPS_AT_ONCE and len({len(batch) for batch in batches[:-1]}) <= 1
