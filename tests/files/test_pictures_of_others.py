"""Pictures of other programs, in and out: against bytes by their definition, and against other readers."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.hdr import read_hdr, write_hdr
from hagoromo.files.png import png_bytes, read_png, write_png
from hagoromo.files.tiff import write_tiff
from hagoromo.image.picture.any_picture import convert_picture, read_any_picture
from hagoromo.image.picture.spectral_exr import CHANNEL, SpectralPicture, read_spectral_exr, write_spectral_exr

RGBE = np.random.default_rng(2).integers(128, 255, (4, 5, 4)).astype(np.uint8)
RGBE[..., 3] = np.random.default_rng(3).integers(120, 140, (4, 5))
COLOURS = RGBE[..., :3] * 2.0 ** (RGBE[..., 3:].astype(float) - 136.0)  # Ward's shared exponent


def hdr() -> bytes:
    """Lines of fewer than 8 pixels are not packed."""
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 5\n" + RGBE.tobytes()


def test_hdr_is_read_by_its_definition(tmp_path):
    (tmp_path / "a.hdr").write_bytes(hdr())
    assert read_hdr(tmp_path / "a.hdr") == pytest.approx(COLOURS)


def test_hdr_that_is_written_keeps_eight_bits(tmp_path):
    """A channel is off by at most a 256th of the brightest, rounding down as some do."""
    image = np.random.default_rng(4).random((33, 40, 3)) * 10.0 ** np.linspace(-3, 3, 40)[:, None]
    write_hdr(tmp_path / "a.hdr", image)
    assert (np.abs(read_hdr(tmp_path / "a.hdr") - image) <= image.max(axis=2, keepdims=True) / 127).all()
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    other = np.array(mi.Bitmap(str(tmp_path / "a.hdr")).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))
    assert (np.abs(other - image) <= image.max(axis=2, keepdims=True) / 127).all()


def test_sixteen_bits_that_are_written_are_what_openimageio_reads(tmp_path):
    oiio = pytest.importorskip("OpenImageIO")
    numbers = np.random.default_rng(6).integers(0, 65536, (7, 11, 3)).astype(np.uint16)
    write_tiff(tmp_path / "a.tif", numbers)
    write_png(tmp_path / "a.png", numbers)
    for name in ("a.tif", "a.png"):
        file = oiio.ImageInput.open(str(tmp_path / name))
        assert file.spec().format == "uint16"
        assert np.array_equal(np.asarray(file.read_image("uint16")), numbers)


def test_hdr_that_is_damaged_is_refused(tmp_path):
    bad = {
        "cut": hdr()[:-5], "turned": hdr().replace(b"-Y 4 +X", b"+Y 4 +X"), "none": b"#?RADIANCE\nabc",
        "huge": hdr().replace(b"-Y 4 +X 5", b"-Y 900000 +X 900000"),
    }  # fmt: skip
    for name, data in bad.items():
        (tmp_path / f"{name}.hdr").write_bytes(data)
        with pytest.raises(InputError, match=f"{name}.hdr"):
            read_hdr(tmp_path / f"{name}.hdr")


def chunks(data: bytes) -> dict[bytes, bytes]:
    found, at = {}, 8
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        content = data[at + 8 : at + 8 + length]
        assert struct.unpack_from(">I", data, at + 8 + length)[0] == zlib.crc32(kind + content)
        found[kind] = content
        at += 12 + length
    return found


def test_a_png_for_people_says_that_it_is_srgb(tmp_path):
    from PIL import Image

    image = np.random.default_rng(5).integers(0, 256, (7, 9, 3), dtype=np.uint8)
    (tmp_path / "a.png").write_bytes(png_bytes(image, srgb=True))
    found = chunks((tmp_path / "a.png").read_bytes())
    order = list(found)
    assert found[b"sRGB"] == b"\0" and order.index(b"IHDR") == 0 < order.index(b"sRGB") < order.index(b"IDAT")
    with Image.open(tmp_path / "a.png") as other:
        assert other.info["srgb"] == 0 and other.info["gamma"] == 0.45455
        assert np.array_equal(np.asarray(other), image)
    assert np.array_equal(read_png(tmp_path / "a.png"), image)
    assert b"sRGB" not in chunks(png_bytes(image))


def rendered(tmp_path):
    """An image of two colours under two lamps of other spectra."""
    red = hg.Spectrum([400, 560, 600, 700], [0.1, 0.1, 0.8, 0.8])
    palette = hg.Palette((red,), (hg.Spectrum.constant(1.0),), (hg.Spectrum.named("D65"), hg.Spectrum.named("A")))
    weights = np.random.default_rng(6).uniform(0.0, 0.3, (6, 8, 4)).astype(np.float32)
    image = hg.Image(weights, np.ones((6, 8), np.float32), palette)
    image.save(tmp_path / "image.exr")
    return image


def test_a_spectral_exr_holds_the_radiance_of_the_image(tmp_path):
    """By OpenEXR's own reader, by the names of the layout; its colours by colour-science are the image's own to 0.5 %,
    which is the step of 10 nm and the light beyond 400 and 700 nm.
    """
    import colour
    import OpenEXR

    image = rendered(tmp_path)
    assert main(["convert", str(tmp_path / "image.exr"), "--to", "spectral", "--out", str(tmp_path / "s.exr")]) == 0
    with OpenEXR.File(str(tmp_path / "s.exr"), separate_channels=True) as file:
        header, channels = dict(file.header()), {name: np.array(each.pixels) for name, each in file.channels().items()}
    assert header["spectralLayoutVersion"] == "1.0" and header["emissiveUnits"] == "W.m^-2.sr^-1.nm^-1"
    names = [f"S0.{wave},000000nm" for wave in range(400, 701, 10)]
    assert set(names) == {name for name in channels if CHANNEL.fullmatch(name)}
    red, lamps = image.palette.bodies[0], image.palette.lamps
    expected = sum(
        lamp.at(550.0) * (red.at(550.0) * image.weights[..., 2 * k] + image.weights[..., 2 * k + 1])
        for k, lamp in enumerate(lamps)
    )
    assert channels["S0.550,000000nm"] == pytest.approx(expected, rel=1e-5)
    spectrum = np.array([channels[name][2, 3] for name in names])
    shape = colour.SpectralShape(400, 700, 10)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    light = colour.SpectralDistribution(spectrum, shape.wavelengths)
    xyz = colour.sd_to_XYZ(light, observer, colour.sd_ones(shape), method="Integration")
    assert xyz / xyz[1] == pytest.approx(image.xyz()[2, 3] / image.xyz()[2, 3, 1], rel=5e-3)


def test_a_spectral_exr_is_read_as_it_was_written(tmp_path):
    waves = np.array([380.0, 500.25, 640.0, 780.0])
    for is_light in (True, False):
        picture = SpectralPicture(np.random.default_rng(7).random((3, 4, 4)).astype(np.float32), waves, is_light)
        write_spectral_exr(tmp_path / "a.exr", picture)
        again = read_spectral_exr(tmp_path / "a.exr")
        assert np.array_equal(again.values, picture.values) and again.is_light == is_light
        assert again.wavelengths == pytest.approx(waves)


def test_colour_science_reads_and_writes_the_same_layout(tmp_path):
    """Its own reader of Fichet et al. (2021) of what we write, and its own sample, D65, read by us."""
    import colour
    from colour.io import fichet2021

    pytest.importorskip("OpenImageIO")  # by which it reads

    waves = np.array([450.0, 500.0, 550.0, 650.0])
    picture = SpectralPicture(np.random.default_rng(7).random((3, 4, 4)).astype(np.float32), waves, True)
    write_spectral_exr(tmp_path / "a.exr", picture)
    found: Any = colour.read_spectral_image_Fichet2021(str(tmp_path / "a.exr"))
    assert list(found) == ["S0"] and found["S0"][0] == pytest.approx(waves * 1e-9 if found["S0"][0][0] < 1 else waves)
    assert np.asarray(found["S0"][1]) == pytest.approx(picture.values)
    sample = Path(fichet2021.__file__).parent / "tests" / "resources" / "D65.exr"
    theirs: Any = colour.read_spectral_image_Fichet2021(str(sample))
    ours = read_spectral_exr(sample)
    assert ours.is_light and ours.values == pytest.approx(np.asarray(theirs["S0"][1]))
    rgb = ours.linear_srgb()[0, 0]
    assert rgb / rgb[1] == pytest.approx([1.0, 1.0, 1.0], abs=0.02)  # the display's white


def test_white_is_white(tmp_path):
    """A reflectance of 1 under D65, and light of equal energy: Y = 1 but for what lies beyond the wavelengths."""
    waves = np.arange(360.0, 831.0, 5.0)
    white = SpectralPicture(np.ones((1, 1, len(waves)), np.float32), waves, False)
    assert white.linear_srgb()[0, 0] == pytest.approx([1.0, 1.0, 1.0], abs=2e-3)


@pytest.mark.parametrize(
    ("name", "said"),
    [("S0.5nm", "no wavelength"), ("S0.550,0pHz", "no wavelength"), ("Y", "no spectral channels")],
)
def test_channels_that_are_no_light_are_refused(tmp_path, name, said):
    hg.write_exr(tmp_path / "a.exr", {name: np.ones((2, 2), np.float32)})
    with pytest.raises(InputError, match=said):
        read_spectral_exr(tmp_path / "a.exr")


def test_frequencies_are_read_as_wavelengths(tmp_path):
    """545.07 THz is 550 nm."""
    ones = np.ones((2, 2), np.float32)
    hg.write_exr(tmp_path / "a.exr", {"T.545,07713THz": ones, "T.600,nm": ones, "T.6,5e2nm": ones})
    assert read_spectral_exr(tmp_path / "a.exr").wavelengths == pytest.approx([550.0, 600.0, 650.0], abs=1e-3)


@pytest.mark.parametrize("suffix", [".exr", ".hdr", ".tif", ".png"])
def test_a_picture_that_is_written_as_another_is_the_same(tmp_path, suffix):
    """To the bits of the format: 8 of the brightest channel (HDR), 16 or 8 of the display's values."""
    linear = np.random.default_rng(8).uniform(0.02, 1.0, (9, 12, 3)).astype(np.float32)
    hg.write_exr(tmp_path / "a.exr", {name: linear[..., k] for k, name in enumerate("RGB")})
    convert_picture(tmp_path / "a.exr", tmp_path / f"b{suffix}")
    step = {".exr": 1e-7, ".hdr": 1 / 127, ".tif": 3 / 65535, ".png": 3 / 255}[suffix]
    assert np.abs(read_any_picture(tmp_path / f"b{suffix}").linear - linear).max() < step
    if suffix == ".tif":
        import tifffile

        assert tifffile.imread(tmp_path / "b.tif").dtype == np.uint16


def test_any_two_pictures_are_compared(tmp_path, capsys):
    """A linear picture and the same for the display: the rounding to 8 bits alone is the difference."""
    linear = np.random.default_rng(9).uniform(0.05, 2.0, (16, 18, 3)).astype(np.float32)
    hg.write_exr(tmp_path / "a.exr", {name: linear[..., k] for k, name in enumerate("RGB")})
    convert_picture(tmp_path / "a.exr", tmp_path / "b.png", peak=2.0)
    convert_picture(tmp_path / "a.exr", tmp_path / "c.tif", peak=2.0)
    with pytest.raises(InputError, match="--peak"):
        hg.compare(tmp_path / "a.exr", tmp_path / "b.png")
    assert hg.compare(tmp_path / "a.exr", tmp_path / "b.png", peak=2.0).delta_e_2000 < 0.3
    assert hg.compare(tmp_path / "c.tif", tmp_path / "b.png").delta_e_2000 < 0.3
    words = ["compare", str(tmp_path / "a.exr"), str(tmp_path / "b.png"), "--peak", "2"]
    assert main([*words, "--map", str(tmp_path / "map.png")]) == 0
    assert read_png(tmp_path / "map.png").shape == (16, 18, 3)
    assert main([*words, "--map", str(tmp_path / "map.png")]) == 2  # it is there
    assert "exists" in capsys.readouterr().err


def test_the_map_has_the_mean_that_compare_says(tmp_path):
    a, b = (np.random.default_rng(k).uniform(0.1, 1.0, (14, 15, 3)) for k in (1, 2))
    mask = np.zeros((14, 15), bool)
    mask[2:13, 1:14] = True
    made = hg.delta_e_map(a, b, mask=mask)
    assert made[mask].mean() == pytest.approx(hg.compare(a, b, mask=mask).delta_e_2000)
    assert (made[~mask] == 0).all()
