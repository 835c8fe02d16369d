"""A thin lens draws what is out of focus as the disc of confusion in closed form, and what is in focus sharply."""

import math
from functools import cache

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.image.scene.scene_file import load_scene
from tests.ball_scene import KEY, ball_scene

SIZE, FOCAL, DISTANCE, APERTURE = 28, 60.0, 1.0, 0.12  # px, px, m, m
SPECK = 0.05  # radius of a flat disc [m]: 6 px across


@cache
def picture(focus, mode, aperture=APERTURE, distortion=()):
    """A bright speck on the axis at DISTANCE."""
    view = hg.Camera(SIZE, SIZE, (FOCAL, FOCAL), (SIZE / 2, SIZE / 2), (*distortion, 0.0, 0.0, 0.0, 0.0)[:4],
                     aperture=aperture, focus=focus)  # fmt: skip
    matte = hg.Reflectance(0.25, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0))
    pose = np.diag([SPECK, SPECK, 1.0, 1.0])
    pose[2, 3] = DISTANCE
    disc = hg.Surface(matte, "disk", pose=pose)
    scene = hg.Scene(view, (hg.Lamp(to_lamp=(0.0, 0.0, -1.0)),), surfaces=(disc,))
    settings = hg.Settings(samples=1600, orders=1) if mode == "path" else hg.Settings(samples=256)
    image = hg.render(scene, settings, mode=mode)
    return image.weights.sum(axis=2).astype(float)


def spread(light):
    """Mean and variance [px²] of the light along each axis."""
    at = np.arange(SIZE) + 0.5
    sums = [light.sum(axis=axis) / light.sum() for axis in (0, 1)]
    means = [float(share @ at) for share in sums]
    return means, [float(share @ (at - mean) ** 2) for share, mean in zip(sums, means, strict=True)]


@pytest.mark.parametrize("mode", ["march", "path"])
@pytest.mark.parametrize("focus", [0.5, math.inf])
def test_a_point_spreads_over_the_circle_of_confusion(focus, mode):
    """A disc of diameter C has the variance C²/16 along each axis, which adds to that of the sharp speck: to 3 % of
    both, three standard deviations of their estimates by some 10⁴ rays.
    """
    views = (1.0, 0.0), (DISTANCE, APERTURE), (focus, APERTURE)
    pinhole, sharp, blurred = (picture(at, mode, aperture) for at, aperture in views)
    confusion = FOCAL * APERTURE * abs(1.0 / focus - 1.0 / DISTANCE)
    (means, wide), (_, narrow), (_, least) = map(spread, (blurred, sharp, pinhole))
    np.testing.assert_allclose(wide, np.array(narrow) + confusion**2 / 16.0, rtol=0.03)
    np.testing.assert_allclose(narrow, least, rtol=0.03)  # the speck itself is seen from all of the lens
    np.testing.assert_allclose(means, SIZE / 2, atol=0.1)
    np.testing.assert_allclose(blurred.sum(), pinhole.sum(), rtol=0.03)
    edge = SIZE // 2 + round(0.5 * confusion + FOCAL * SPECK + 1.0)
    assert blurred[:, edge:].sum() < 1e-3 * blurred.sum() < blurred[:, edge - 4 :].sum()


def test_a_pinhole_keeps_its_bits():
    np.testing.assert_array_equal(picture(0.3, "march", 0.0), picture(math.inf, "march", 0.0))


def test_a_scene_file_states_aperture_and_focus(tmp_path):
    def camera_of(text, preset=False):
        scene = ball_scene((53, 37), 90.0, (KEY,), "cie1931")
        if preset:
            preset_of = 'preset = "canon_eos_kiss_digital"\nbinning = 64'
            scene = scene.replace("size = [53, 37]\nfocal = [90.0, 90.0]", preset_of)
        (tmp_path / "scene.toml").write_text(scene.replace("eye =", f"{text}\neye ="))
        return load_scene(tmp_path / "scene.toml")[0]

    scene = camera_of("aperture_mm = 20.0\nfocus_mm = 900.0")
    assert (scene.camera.aperture, scene.camera.focus) == (0.02, 0.9)
    assert scene.record()["camera"]["aperture"] == 0.02
    assert camera_of("f_number = 2.75\nfocus_mm = 900.0", preset=True).camera.aperture == pytest.approx(0.02)
    for text, said in (
        ("aperture_mm = 20.0", "give one of them, and focus_mm"),
        ("focus_mm = 20.0", "without an aperture"),
        ("aperture_mm = 2.0\nf_number = 2.0\nfocus_mm = 9.0", "give one of them"),
        ("f_number = 2.0\nfocus_mm = 9.0", "needs a preset"),
        ("aperture_mm = -1.0\nfocus_mm = 9.0", "aperture_mm"),
    ):
        with pytest.raises(InputError, match=said) as refused:
            camera_of(text)
        assert "\n" not in str(refused.value)
    for aperture, focus in ((math.nan, 1.0), (-1.0, 1.0), (0.1, 0.0)):
        with pytest.raises(InputError, match=r"aperture|focus"):
            hg.Camera(8, 8, (9.0, 9.0), (4.0, 4.0), aperture=aperture, focus=focus)


def test_a_camera_is_a_pinhole_unless_it_is_told():
    view = hg.Camera(SIZE, SIZE, (FOCAL, FOCAL), (SIZE / 2, SIZE / 2))
    assert view.aperture == 0.0 and view.focus == math.inf and not view.orthographic
