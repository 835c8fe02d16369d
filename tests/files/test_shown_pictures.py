"""Display transforms, colour profiles and layouts of EXR, by readers that are not ours."""

import io
import sys
import warnings

import numpy as np
import pytest
from PIL import Image, ImageCms

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.icc import DISPLAY_P3, SRGB, icc_profile
from hagoromo.files.png import write_png
from hagoromo.image.picture.any_picture import convert_picture, read_any_picture
from hagoromo.image.picture.image import auto_exposure
from hagoromo.image.picture.shown import DisplayTransform, DisplayView
from hagoromo.light.colour import srgb_decode, srgb_encode

LINEAR = np.random.default_rng(11).random((13, 17, 3)) ** 2.0
# half a step of 8 bits at white in linear light, where the curve has the slope 2.27, of one picture, and of another
# through a matrix whose rows sum to 1.45 at most without their signs
ROUNDING = 2.27 * 0.5 / 255 * (1.0 + 1.45)
ACES = "ACES 2.0 - SDR 100 nits (Rec.709)"


def by_littlecms(numbers: np.ndarray, profile: bytes) -> np.ndarray:
    """8-bit values of a profile as those of LittleCMS' own sRGB."""
    transform = ImageCms.buildTransform(
        ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB"), "RGB", "RGB",
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )  # fmt: skip
    shown = ImageCms.applyTransform(Image.fromarray(numbers), transform)
    assert shown is not None
    return np.asarray(shown).astype(int)


@pytest.mark.parametrize("name", [SRGB, DISPLAY_P3])
def test_littlecms_finds_the_same_colours_in_what_is_written(tmp_path, name):
    """Within the rounding of two pictures of 8 bits, in linear light, and with their mean within a tenth of that."""
    way = DisplayTransform(name)
    way.save(tmp_path / "a.tif", way.values(LINEAR))
    way.save(tmp_path / "a.png", way.values(LINEAR))
    for file in ("a.tif", "a.png"):
        with Image.open(tmp_path / file) as picture:
            profile, numbers = picture.info.get("icc_profile"), np.asarray(picture)
        if file == "a.png" and name == SRGB:
            assert profile is None and picture.info["srgb"] == 0
            continue
        assert isinstance(profile, bytes) and profile == icc_profile(name)
        error = srgb_decode(by_littlecms(numbers, profile)) - LINEAR
        assert np.abs(error).max() < ROUNDING and np.abs(error.mean()) < 0.1 * ROUNDING
    with Image.open(tmp_path / "a.tif") as picture:
        described = ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(icc_profile(name))))
    assert described.strip() == name


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_a_picture_with_a_profile_compares_as_it_looks(tmp_path, suffix, capsys):
    """The same colours for two displays: apart where the profile is ignored, alike where it is applied."""
    for name in (SRGB, DISPLAY_P3):
        DisplayTransform(name).save(tmp_path / f"{name}{suffix}", DisplayTransform(name).values(LINEAR))
    a, b = (read_any_picture(tmp_path / f"{name}{suffix}").linear for name in (SRGB, DISPLAY_P3))
    assert np.abs(a - b).max() < ROUNDING
    assert np.abs(DisplayTransform(SRGB).values(LINEAR) - DisplayTransform(DISPLAY_P3).values(LINEAR)).max() > 0.05


def test_a_profile_of_littlecms_is_srgb_and_leaves_all_bits(tmp_path):
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    numbers = srgb_encode(LINEAR)
    write_png(tmp_path / "a.png", numbers, profile=profile)
    assert np.array_equal(read_any_picture(tmp_path / "a.png").values, numbers / 255.0)
    picture = Image.fromarray(numbers)
    picture.save(tmp_path / "a.jpg", icc_profile=icc_profile(DISPLAY_P3), quality=100, subsampling=0)
    with Image.open(tmp_path / "a.jpg") as stored:
        expected = by_littlecms(np.asarray(stored), icc_profile(DISPLAY_P3))
    found = 255.0 * read_any_picture(tmp_path / "a.jpg").values
    assert np.abs(found - expected).max() < 3.0


def test_aces_shows_what_its_reference_says():
    """ACES 2.0, SDR: 18 % grey at 10 of 100 nits; far above white nothing is cut."""
    pytest.importorskip("PyOpenColorIO", reason="views of ACES need opencolorio")
    ramp = np.array([0.18, 1.0, 4.0, 16.0])[:, None, None] * np.ones((1, 1, 3))
    shown = DisplayTransform(ACES).values(ramp)[:, 0]
    assert ((shown[0] + 0.055) / 1.055) ** 2.4 == pytest.approx(0.1, abs=2e-3)
    assert (np.diff(shown, axis=0) > 0.01).all() and shown.max() < 1.0
    assert DisplayTransform("ACES 2.0 - SDR 100 nits (P3 D65)").profile == DISPLAY_P3
    with pytest.raises(InputError, match=r"there is no display 'Filmic': give one of sRGB, Display P3, ACES 2\.0"):
        DisplayTransform("Filmic")


def an_image() -> hg.Image:
    matte = hg.Reflectance(alpha=0.2, beta=0.5, gamma=0.2, n=1.5, body_colour=hg.Spectrum.constant(1.0))
    camera = hg.Camera(17, 13, (20, 20), (8.5, 6.5)).look_at(eye=(0, -1, 0), target=(0, 0, 0))
    ball = hg.Surface.sphere(centre=(0, 0, 0), radius=0.1, reflectance=matte)
    return hg.render(hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0)),), surfaces=(ball,)))


def test_expose_and_convert_take_a_display(tmp_path):
    pytest.importorskip("PyOpenColorIO", reason="views of ACES need opencolorio")
    an_image().save(tmp_path / "a.exr")
    for name in (ACES, DISPLAY_P3):
        out = tmp_path / f"{name}.exr"
        assert main(["expose", str(tmp_path / "a.exr"), "--display", name, "--out", str(out)]) == 0
        with Image.open(out.with_suffix(".png")) as picture:
            assert ("icc_profile" in picture.info) == (name == DISPLAY_P3)
    assert (tmp_path / f"{ACES}.png").read_bytes() != (tmp_path / "a.png").read_bytes()
    convert_picture(tmp_path / "a.exr", tmp_path / "b.png", display=ACES)
    shown = np.asarray(Image.open(tmp_path / "b.png"))
    linear = read_any_picture(tmp_path / "a.exr").linear
    assert np.array_equal(shown, np.round(255 * DisplayTransform(ACES).values(linear)))
    with pytest.raises(InputError, match="leave it out"):
        convert_picture(tmp_path / "a.exr", tmp_path / "b.hdr", display=ACES)


OWN = """
ocio_profile_version: 2
roles: {{default: {linear}, scene_linear: {linear}, aces_interchange: ACES2065-1}}
displays:
  Mine:
    - !<View> {{name: Root, colorspace: root}}
    - !<View> {{name: Cube, colorspace: cube}}
active_displays: [Mine]
active_views: [Root, Cube]
colorspaces:
  - !<ColorSpace> {{name: ACES2065-1}}
  - !<ColorSpace> {{name: lin{alias}}}
  - !<ColorSpace> {{name: root, from_scene_reference: !<ExponentTransform> {{value: [0.5, 0.5, 0.5, 1]}}}}
  - !<ColorSpace> {{name: cube, from_scene_reference: !<ExponentTransform> {{value: [0.3333, 0.3333, 0.3333, 1]}}}}
"""


LINEAR_SRGB = ', aliases: ["Linear Rec.709 (sRGB)"]'


def own_configuration(folder, linear="lin", alias=LINEAR_SRGB):
    (folder / "own.ocio").write_text(OWN.format(linear=linear, alias=alias).lstrip())
    return str(folder / "own.ocio")


def test_a_configuration_of_ones_own_shows_what_its_views_say(tmp_path):
    """The root of linear values in closed form, by the default view and by name; the display has no known profile."""
    pytest.importorskip("PyOpenColorIO", reason="views need opencolorio")
    place, linear = own_configuration(tmp_path), np.clip(LINEAR, 0.0, 1.0)
    for look in (DisplayView(ocio=place), DisplayView("Mine", "Root", place)):
        assert np.abs(DisplayTransform(look).values(linear) - np.sqrt(linear)).max() < 1e-5
    assert DisplayTransform(DisplayView(ocio=place)).profile == ""
    assert DisplayTransform(DisplayView(ocio=place, view="Cube")).name == "Mine: Cube"
    an_image().save(tmp_path / "a.exr", display=DisplayView(ocio=place))
    with Image.open(tmp_path / "a.png") as picture:
        assert not {"srgb", "icc_profile", "gamma"} & set(picture.info)


def test_a_configuration_without_linear_srgb_is_entered_by_its_role_of_aces(tmp_path):
    """AP0 of linear sRGB by the matrix of both primaries (Bradford), then the root."""
    pytest.importorskip("PyOpenColorIO", reason="views need opencolorio")
    import colour

    place = own_configuration(tmp_path, "ACES2065-1", "")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matrix = colour.matrix_RGB_to_RGB("sRGB", "ACES2065-1", "Bradford")
    linear = np.clip(LINEAR, 0.0, 1.0)
    shown = DisplayTransform(DisplayView(ocio=place)).values(linear)
    assert np.abs(shown - np.sqrt(np.clip(linear @ matrix.T, 0.0, 1.0))).max() < 2e-3  # of D65 and D60 in four digits


def test_an_exposure_is_of_the_png_alone(tmp_path):
    """A stop doubles linear values before they are encoded; the EXR has the same bytes."""
    image = an_image()
    for name, look in (
        ("a", None),
        ("b", DisplayView(exposure=1.0)),
        ("c", DisplayView(exposure=-1.5, display=DISPLAY_P3)),
    ):
        image.save(tmp_path / f"{name}.exr", display=look)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes() == (tmp_path / "c.exr").read_bytes()
    linear = image.linear_srgb() * auto_exposure(image.linear_srgb(), image.alpha)
    assert np.array_equal(hg.read_png(tmp_path / "b.png"), srgb_encode(2.0 * linear))
    assert np.array_equal(hg.read_png(tmp_path / "c.png"), DisplayTransform(DISPLAY_P3).numbers(linear * 2.0**-1.5))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--view", "Filmic"],
            "has no view 'Filmic' of sRGB - Display: give one of ACES 2.0 - SDR 100 nits (Rec.709), ",
        ),
        (["--ocio", "ocio://none"], "is no configuration of OpenColorIO"),
        (["--ocio", "none.ocio"], "none.ocio does not exist"),
        (
            ["--ocio", "ocio://cg-config-latest", "--display", "Mine"],
            "has no display 'Mine': give one of sRGB - Display",
        ),
        (["--exposure", "40"], "exposure is 40 stops"),
    ],
)
def test_wrong_looks_are_one_line(tmp_path, capsys, words, said):
    pytest.importorskip("PyOpenColorIO", reason="views need opencolorio")
    an_image().save(tmp_path / "a.exr")
    assert main(["expose", str(tmp_path / "a.exr"), *words, "--out", str(tmp_path / "b.exr")]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not (tmp_path / "b.exr").exists()


def test_without_opencolorio_a_line_says_what_to_install(tmp_path, monkeypatch, capsys):
    an_image().save(tmp_path / "a.exr")
    monkeypatch.setitem(sys.modules, "PyOpenColorIO", None)
    words = ["expose", str(tmp_path / "a.exr"), "--out", str(tmp_path / "b.exr")]
    assert main([*words, "--view", "Un-tone-mapped"]) == 2
    assert "pip install 'hagoromo[display]'" in capsys.readouterr().err
    assert main([*words, "--exposure", "0.5"]) == 0  # needs nothing


@pytest.mark.parametrize("words", [("half",), ("tiles",), ("parts",), ("half", "tiles", "parts")])
def test_an_exr_in_another_layout_has_the_same_numbers(tmp_path, words):
    """By OpenImageIO; 65 × 130 px: the last tiles are not full."""
    oiio = pytest.importorskip("OpenImageIO")
    random = np.random.default_rng(5)
    channels = {name: random.random((65, 130)).astype(np.float16) for name in ("R", "G", "B", "depth.Z", "first.R")}
    write_exr(tmp_path / "a.exr", channels, {"colour_space": "linear sRGB"})
    assert main(["convert", str(tmp_path / "a.exr"), "--exr", *words, "--out", str(tmp_path / "b.exr")]) == 0
    file, found, part = oiio.ImageInput.open(str(tmp_path / "b.exr")), {}, 0
    while file.seek_subimage(part, 0):
        spec = file.spec()
        assert (spec.tile_width, spec.format) == (64 if "tiles" in words else 0, "half" if "half" in words else "float")
        values = np.asarray(file.read_image(part, 0, 0, spec.nchannels, "float")).reshape(65, 130, -1)
        prefix = f"{spec.getattribute('name')}." if "parts" in words and part else ""
        for k, name in enumerate(spec.channelnames):
            found[name if name.startswith(prefix) else prefix + name] = values[..., k]
        part += 1
    assert part == (3 if "parts" in words else 1) and set(found) == set(channels)
    for name, values in channels.items():
        assert np.array_equal(found[name], values.astype(np.float32))
    ours, texts = read_exr(tmp_path / "b.exr")
    assert np.array_equal(ours["R"], channels["R"]) and texts["colour_space"] == "linear sRGB"
