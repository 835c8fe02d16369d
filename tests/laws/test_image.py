"""Laws of the exposure (MODEL §5): weights are the spectral render, for any camera and lamp spectrum."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.png import read_png
from hagoromo.image.expose import expose
from hagoromo.image.picture.image import read_image
from hagoromo.image.render import render
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox

RED = Spectrum([380, 480, 580, 640, 730], [0.05, 0.08, 0.3, 0.9, 0.95])
BLUE = Spectrum([380, 440, 520, 730], [0.6, 0.9, 0.3, 0.1])
GOLD = Spectrum([380, 500, 600, 730], [0.4, 0.7, 1.0, 1.0])
DAY, WARM = Spectrum([380, 450, 560, 730], [0.8, 1.1, 1.0, 0.9]), Spectrum([380, 560, 730], [0.2, 1.0, 1.9])


def a_scene(bodies=(RED, BLUE, GOLD), lamps=(DAY, WARM, DAY), interfaces=None) -> Scene:
    """Two overlapping boxes (one with two materials, one with per-voxel colour) over a floor, three lamps."""
    rng = np.random.default_rng(1)
    one = interfaces or (Spectrum.constant(1.0), Spectrum([380, 730], [0.4, 1.0]))
    skin = Reflectance(0.2, 0.2, 0.3, 1.4, bodies[0], one[0], element="sphere")
    gold = Reflectance(0.1, 0.6, 0.2, 1.5, bodies[1], one[1], element="cylinder")
    plain = Reflectance(0.2, 0.3, 0.2, 1.5, bodies[2], one[0])
    shape = (11, 13, 17)
    axis = rng.normal(size=(*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    pose = np.eye(4)
    pose[:3, 3] = (0.05, 0.02, 0.0)
    first = VolumeBox.from_arrays(
        rng.random(shape), axis, 0.01, 60.0, [skin, gold], material=(rng.random(shape) > 0.5).astype(np.uint8)
    )
    second = VolumeBox.from_arrays(
        rng.random(shape), axis, 0.01, 60.0, [plain], body_colour=rng.random((*shape, 2)), basis=bodies[:2], pose=pose
    )
    places = ((0.5, -0.5, 0.6), (-0.4, -0.3, 0.5), (0.2, 0.6, 0.5))
    camera = Camera(31, 23, (40.0, 40.0), (15.5, 11.5)).look_at((0.1, -0.4, 0.3), (0.1, 0.06, 0.04))
    return Scene(
        camera,
        tuple(Lamp(position=p, spectrum=s) for p, s in zip(places, lamps, strict=True)),
        (first, second),
        (Surface.floor(-0.01, 0.5, plain),),
    )


def test_weights_are_the_spectral_render():
    """Exposing the weights agrees to 1e-4 with rendering wavelengths in 1 nm steps and summing with the trapezium."""
    response = Response.load("canon_eos_300d")
    exposed = render(a_scene()).expose(response)
    wavelengths = np.arange(400, 701, 1.0)
    curves = np.stack([response.curve(c).at(wavelengths) for c in range(3)], -1)
    weight = np.full(301, 1.0)
    weight[[0, -1]] = 0.5
    total = np.zeros_like(exposed, dtype=np.float64)
    # all wavelengths share geometry: a grey render per wavelength only changes numbers, so 13 are rendered and checked
    # exactly, and all 301 are formed from the one grey render per (lamp, colour) pair that those 13 confirm
    image = render(a_scene())
    for wavelength in wavelengths[::25]:
        grey = [Spectrum.constant(float(s.at(wavelength))) for s in (RED, BLUE, GOLD)]
        lamps = [Spectrum.constant(float(s.at(wavelength))) for s in (DAY, WARM, DAY)]
        sheen = (Spectrum.constant(1.0), Spectrum.constant(float(Spectrum([380, 730], [0.4, 1.0]).at(wavelength))))
        single = render(a_scene(grey, lamps, sheen))
        radiance = _radiance_at(single, wavelength)
        assert np.allclose(radiance, _radiance_at(image, wavelength), rtol=1e-4, atol=1e-4 * radiance.max())
    for wavelength, share, curve in zip(wavelengths, weight, curves, strict=True):
        total += share * _radiance_at(image, wavelength)[..., None] * curve
    assert np.abs(exposed - total).max() < 1e-4 * total.max()


def _radiance_at(image, wavelength):
    """Spectral radiance of an image at one wavelength: Σ_kj W_kj E_k(λ) B_j(λ)."""
    palette = image.palette
    values = [float(lamp.at(wavelength)) * float(c.at(wavelength)) for lamp in palette.lamps for c in palette.colours]
    return image.weights.astype(np.float64) @ np.array(values)


def test_another_lamp_spectrum_needs_no_new_rendering():
    """Weights exposed under other lamps equal a render of the scene under those lamps."""
    response = Response.load("canon_eos_300d")
    kept = render(a_scene())
    assert len(kept.palette.lamps) == 2  # two of the three lamps share a spectrum
    again = render(a_scene(lamps=(WARM, BLUE, WARM))).expose(response)
    assert np.allclose(kept.expose(response, (WARM, BLUE)), again, rtol=1e-5, atol=1e-7 * again.max())
    with pytest.raises(InputError, match="lamp groups"):
        kept.expose(response, (WARM,))


def test_an_image_written_and_read_is_the_same_image(tmp_path):
    image = render(a_scene(), Settings(samples=2, seed=5))
    paths = image.save(tmp_path / "scene.exr", Response.load("canon_eos_300d"))
    read = read_image(tmp_path / "scene.exr")
    assert np.array_equal(read.weights, image.weights) and np.array_equal(read.alpha, image.alpha)
    assert read.metadata["settings"]["seed"] == 5 and read.metadata["scene"] == image.metadata["scene"]
    response = Response.load("cie1931")
    assert np.array_equal(read.expose(response), image.expose(response))
    assert read_png(paths[1]).shape == (23, 31, 3)
    with pytest.raises(InputError, match="exists"):
        image.save(tmp_path / "scene.exr")


def test_the_same_seed_gives_the_same_bits():
    first, second, other = (render(a_scene(), Settings(samples=3, seed=s)).weights for s in (1, 1, 2))
    assert np.array_equal(first, second) and not np.array_equal(first, other)


SLIDERS = {"key": 0.3, "fill": 2.5, "rim": 0.0}
OTHERS = {"key": WARM, "rim": Spectrum([380, 500, 730], [1.4, 0.9, 0.3])}


def a_named_scene(strength=None, spectrum=None) -> Scene:
    """`a_scene` with lamps called key, fill and rim, of which key and rim have one spectrum."""
    scene = a_scene()
    lamps = [
        replace(lamp, name=name, intensity=(strength or {}).get(name, 1.0),
                spectrum=(spectrum or {}).get(name, lamp.spectrum))
        for name, lamp in zip(SLIDERS, scene.lamps, strict=True)
    ]  # fmt: skip
    return scene.with_lamps(*lamps)


def test_separate_lamps_add_up_to_the_joint_picture():
    """Weights of the lamps of one spectrum, added: the joint weights to 1e-6 of the largest, single precision.

    Each lamp's weights are those of a scene with this lamp alone, within a quarter of the tolerance: the steps of the
    march follow the light of all lamps.
    """
    joint, apart = (render(a_named_scene(), Settings(separate_lamps=way)) for way in (False, True))
    colours = len(joint.palette.colours)
    assert len(joint.palette.lamps) == 2 and len(apart.palette.lamps) == 3
    assert joint.palette.lamp_groups == (0, 1, 0) and apart.palette.lamp_groups == (0, 1, 2)
    key, fill, rim = (apart.weights[..., k * colours : (k + 1) * colours] for k in range(3))
    for ours, theirs in ((joint.weights[..., :colours], key + rim), (joint.weights[..., colours:], fill)):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6 * ours.max())
    alone = render(a_named_scene().with_lamps(a_named_scene().lamps[2]))
    assert np.sqrt(np.mean((rim - alone.weights) ** 2)) < 0.25 * Settings().tolerance * rim.mean()
    response = Response.load("canon_eos_300d")
    exposed = joint.expose(response)
    np.testing.assert_allclose(apart.expose(response), exposed, rtol=0, atol=2e-6 * exposed.max())


def test_changed_strengths_and_spectra_of_lamps_equal_a_new_rendering(tmp_path):
    """Exposed through a camera and as XYZ, to 2e-6 of the largest value; also from the file, and by its numbers."""
    image = render(a_named_scene(), Settings(separate_lamps=True))
    image.save(tmp_path / "apart.exr")
    again = render(a_named_scene(SLIDERS, OTHERS), Settings(separate_lamps=True))
    by_number = {0: 0.3, 1: 2.5, 2: 0.0}, {0: OTHERS["key"], 2: OTHERS["rim"]}
    for changed in (
        image.with_lamps(SLIDERS, OTHERS),
        expose(tmp_path / "apart.exr", SLIDERS, OTHERS),
        image.with_lamps(*by_number),
    ):
        assert changed.lamp_names == ("key", "fill", "rim")
        response = Response.load("canon_eos_300d")
        for ours, theirs in ((changed.expose(response), again.expose(response)), (changed.xyz(), again.xyz())):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-6 * theirs.max())
        assert changed.metadata["scene"]["lamps"] == again.metadata["scene"]["lamps"]
    assert not np.allclose(image.expose(response), again.expose(response), rtol=0.1)  # the sliders change much


@pytest.mark.parametrize(
    ("strength", "spectrum", "said"),
    [
        ({"sun": 2.0}, {}, "0 lamps are called 'sun': the image has key, fill, rim"),
        ({7: 2.0}, {}, "0 lamps are called 7"),
        ({"key": 2.0}, {}, "key, rim share weights: render with separate_lamps"),
        ({}, {"rim": WARM}, "key, rim share weights"),
        ({"fill": -1.0}, {}, "factor of 0 or more"),
        ({"fill": np.nan}, {}, "factor of 0 or more"),
    ],
)
def test_lamps_that_cannot_be_changed_are_refused(joint_image, strength, spectrum, said):
    with pytest.raises(InputError, match=said):
        joint_image.with_lamps(strength, spectrum)
    dimmed = joint_image.with_lamps({"key": 0.5, "rim": 0.5})  # those that share weights, alike
    np.testing.assert_array_equal(dimmed.weights[..., :5], 0.5 * joint_image.weights[..., :5])


def test_an_image_of_version_0_2_is_changed_by_its_groups(tmp_path, joint_image):
    """Its file does not name the lamps."""
    joint_image.save(tmp_path / "new.exr")
    channels, header = read_exr(tmp_path / "new.exr")
    record = json.loads(header["palette"])
    header["palette"] = json.dumps({key: record[key] for key in ("bodies", "interfaces", "lamps")})
    write_exr(tmp_path / "old.exr", channels, {key: header[key] for key in ("palette", "hagoromo")})
    old = read_image(tmp_path / "old.exr")
    assert old.lamp_names == ("lamp group 1", "lamp group 2")
    np.testing.assert_array_equal(old.with_lamps({1: 0.0}).weights[..., 5:], 0.0)
    header["palette"] = json.dumps(record | {"lamp_groups": [0, 7, 0]})
    write_exr(tmp_path / "odd.exr", channels, {key: header[key] for key in ("palette", "hagoromo")})
    with pytest.raises(InputError, match="lamp_groups"):
        read_image(tmp_path / "odd.exr")


@pytest.fixture(scope="module")
def joint_image():
    return render(a_named_scene())
