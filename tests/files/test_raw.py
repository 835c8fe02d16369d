"""Photographs as cameras leave them: RAW through LibRaw, TIFF, EXIF, 8 bits with a curve; damaged ones are refused."""

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.exif import Exif, read_exif
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.png import write_png
from hagoromo.files.raw import read_raw
from hagoromo.files.table import write_table
from hagoromo.files.tiff import read_tiff
from hagoromo.photograph.capture import load_capture
from hagoromo.photograph.development.exposure import StatedExposure, read_exposure
from hagoromo.photograph.development.transfer import Transfer, estimate_transfer
from tests.inverse.simulated_bracket import FULL, SENSOR, numbers, scene, write_dng

RANDOM = np.random.default_rng(3)
COLOUR16 = RANDOM.integers(0, 65536, (13, 17, 3)).astype(np.uint16)


def test_libraw_gives_the_numbers_that_a_dng_holds(tmp_path):
    """A DNG written by hand: every number, the mosaic, black and white level, and its EXIF."""
    raw = RANDOM.integers(500, 14_000, (62, 94)).astype(np.uint16)
    write_dng(tmp_path / "a.dng", raw, seconds=1 / 60)
    found = read_raw(tmp_path / "a.dng")
    np.testing.assert_array_equal(found.numbers, raw)
    assert found.mosaic == "RGGB" and (found.black == 512.0).all() and found.white == int(FULL)
    exif = found.exif
    assert exif.exposure_s == pytest.approx(1 / 60, rel=1e-4) and exif.iso == 100.0 and exif.f_number == 5.6
    assert exif.focal_mm == 55.0 and exif.sensor_mm == pytest.approx(22.7, rel=1e-4) and exif.camera == "Maker One"
    assert exif.focal_px(94) == pytest.approx(55.0 / 22.7 * 94, rel=1e-4)
    exposure = read_exposure(tmp_path / "a.dng")
    np.testing.assert_array_equal(exposure.signal, raw - 512.0)
    np.testing.assert_array_equal(exposure.full, raw >= int(FULL))


def test_a_bracket_of_dngs_is_developed_and_loads_as_a_capture(tmp_path, capsys):
    """The command line: three RAW files → an EXR whose values, variance and mask a capture reads back."""
    light, files = scene(2), []
    for k, seconds in enumerate((0.05, 0.2, 0.8)):
        files.append(tmp_path / f"{k}.dng")
        write_dng(files[-1], numbers(light, seconds, 20 + k), seconds)
    assert main(["develop", *map(str, files), "--out", str(tmp_path / "a.exr")]) == 0
    said = capsys.readouterr().out
    assert "from pairs of frames" in said and "linearity tested" in said and "wrote" in said
    metadata = read_exr(tmp_path / "a.exr")[1]
    assert abs(json.loads(metadata["gain"]) - SENSOR.gain) < 4 * json.loads(metadata["gain_standard_error"])
    assert float(metadata["focal_px"]) == pytest.approx(55.0 / 22.7 * light.shape[1], rel=1e-4)
    frame = {"file_path": "a.exr", "transform_matrix": np.eye(4).tolist(), "fl_x": float(metadata["focal_px"])}
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": [frame]}))
    shot = load_capture(tmp_path).photographs[0]
    assert shot.native is not None
    measured = shot.native & shot.mask[..., None]
    z = (shot.values - light / SENSOR.gain / (int(FULL) - 512.0))[measured] / np.sqrt(shot.variance[measured])
    assert abs(z.mean()) < 0.05 and 0.9 < z.var() < 1.1  # gain and read noise are estimates: 5 % and more of variance
    assert main(["info", str(files[0]), "--decode"]) == 0
    assert "RGGB" in capsys.readouterr().out


def test_a_capture_of_raw_files_knows_their_levels_mosaic_and_exposure(tmp_path):
    """Values are the light per second over white; the variance is the stated sensor's: covers to 5 %."""
    light = scene(3)
    write_dng(tmp_path / "a.dng", numbers(light, 0.2, 5), 0.2)
    frame = {"file_path": "a.dng", "transform_matrix": np.eye(4).tolist(), "fl_x": 300.0}
    sensor = {"gain": SENSOR.gain, "read_noise": SENSOR.read_noise}
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": [frame], "sensor": sensor}))
    shot = load_capture(tmp_path).photographs[0]
    assert shot.native is not None and shot.camera.sensor is not None
    measured = shot.native & shot.mask[..., None]
    z = (shot.values - light / SENSOR.gain / (int(FULL) - 512.0))[measured] / np.sqrt(shot.variance[measured])
    assert 0.95 < z.var() < 1.05 and measured.sum() > 0.8 * light[..., 0].size


def test_raw_that_is_damaged_is_refused_in_one_line(tmp_path, capfd):
    write_dng(tmp_path / "a.dng", RANDOM.integers(500, 14_000, (62, 94)).astype(np.uint16))
    whole = (tmp_path / "a.dng").read_bytes()
    for data in (b"", b"no photograph at all", whole[: len(whole) // 2]):
        (tmp_path / "b.dng").write_bytes(data)
        with pytest.raises(InputError, match=r"b\.dng cannot be read as camera RAW") as refused:
            read_raw(tmp_path / "b.dng")
        assert "\n" not in str(refused.value)
    assert capfd.readouterr().err == ""
    with pytest.raises(InputError, match="does not exist"):
        read_raw(tmp_path / "c.dng")


@pytest.mark.parametrize("compression", [1, 5, 8, 32773])  # none, LZW, deflate, PackBits
def test_tiff_gives_its_numbers_back(tmp_path, compression):
    path = tmp_path / "a.tif"
    assert cv2.imwrite(str(path), COLOUR16[..., ::-1], [cv2.IMWRITE_TIFF_COMPRESSION, compression])
    np.testing.assert_array_equal(read_tiff(path), COLOUR16)


def test_tiff_of_other_kinds_and_damaged_ones_are_refused(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, RANDOM.normal(size=(5, 7)).astype(np.float32))
    assert read_tiff(path).dtype == np.float32
    tifffile.imwrite(path, np.zeros((5, 7), np.complex64))
    with pytest.raises(InputError, match="complex64"):
        read_tiff(path)
    assert cv2.imwrite(str(path), COLOUR16)
    whole = path.read_bytes()
    for data in (b"", b"II*\0junkjunk", whole[: len(whole) // 2]):
        path.write_bytes(data)
        with pytest.raises(InputError, match=r"a\.tif") as refused:
            read_tiff(path)
        assert "\n" not in str(refused.value)


def exif_block(order: str) -> bytes:
    """EXIF as a camera writes it: maker and model, and in an IFD of its own exposure 1/60 s, ISO 400, 8.6 mm, no f."""
    begin = b"II*\0" if order == "<" else b"MM\0*"
    camera = b"Maker\0Maker Two\0"
    strings, inner = 8 + 2 + 3 * 12 + 4, 8 + 2 + 3 * 12 + 4 + len(camera)
    fractions = inner + 2 + 4 * 12 + 4

    def row(tag: int, kind: int, count: int, value: int) -> bytes:
        short = kind == 3
        return struct.pack(order + ("HHIHxx" if short else "HHII"), tag, kind, count, value)

    outer = row(0x010F, 2, 6, strings) + row(0x0110, 2, 10, strings + 6) + row(0x8769, 4, 1, inner)
    rows = row(0x829A, 5, 1, fractions) + row(0x829D, 5, 1, fractions + 8)
    rows += row(0x8827, 3, 1, 400) + row(0x920A, 5, 1, fractions + 16)
    values = struct.pack(order + "6I", 1, 60, 0, 0, 86, 10)
    first = begin + struct.pack(order + "I", 8) + struct.pack(order + "H", 3) + outer + bytes(4) + camera
    return first + struct.pack(order + "H", 4) + rows + bytes(4) + values


@pytest.mark.parametrize("order", ["<", ">"])
def test_exif_is_read_from_jpeg_and_png_and_damage_tells_nothing(tmp_path, order):
    blob = b"Exif\0\0" + exif_block(order)
    assert cv2.imwrite(str(tmp_path / "a.jpg"), COLOUR16.astype(np.uint8))
    plain = (tmp_path / "a.jpg").read_bytes()
    assert read_exif(tmp_path / "a.jpg") == Exif()
    segment = b"\xff\xe1" + (len(blob) + 2).to_bytes(2, "big") + blob
    (tmp_path / "a.jpg").write_bytes(plain[:2] + segment + plain[2:])
    assert read_exif(tmp_path / "a.jpg") == Exif(exposure_s=1 / 60, iso=400.0, focal_mm=8.6, camera="Maker Two")
    for end in range(20, len(segment), 11):
        (tmp_path / "a.jpg").write_bytes(plain[:2] + segment[:end])
        read_exif(tmp_path / "a.jpg")
    write_png(tmp_path / "a.png", COLOUR16)
    chunks = (tmp_path / "a.png").read_bytes()
    chunk = len(blob[6:]).to_bytes(4, "big") + b"eXIf" + blob[6:] + b"\0\0\0\0"
    (tmp_path / "a.png").write_bytes(chunks[:33] + chunk + chunks[33:])
    assert read_exif(tmp_path / "a.png").iso == 400.0


def srgb_photograph(light: np.ndarray, seconds: float) -> np.ndarray:
    u = np.clip(light * seconds, 0.0, 1.0)
    return np.rint(255.0 * np.where(u <= 0.0031308, 12.92 * u, 1.055 * u ** (1 / 2.4) - 0.055)).astype(np.uint8)


def test_eight_bits_need_a_curve_and_come_back_linear_through_it(tmp_path):
    """Stated (srgb, or a CSV of it): the rounding variance covers; within three of its standard deviations."""
    light = RANDOM.uniform(0.01, 0.9, (31, 47, 3))
    write_png(tmp_path / "a.png", srgb_photograph(light, 1.0))
    with pytest.raises(InputError, match="8 bits, which are rarely linear: state transfer"):
        read_exposure(tmp_path / "a.png")
    level = np.arange(256.0)
    write_table(tmp_path / "curve.csv", {"number": level, "light": Transfer.load("srgb", 255).table[:, 0]})
    for transfer in ("srgb", tmp_path / "curve.csv"):
        shot = read_exposure(tmp_path / "a.png", StatedExposure(transfer=transfer))
        z = (shot.signal / 255.0 - light) / (np.sqrt(shot.rounding) / 255.0)
        assert np.abs(z).max() < 3.0 and 0.8 < z.var() < 1.2  # of a uniform law ±√3
    for bad, said in [("log", "no transfer curve"), (tmp_path / "none.csv", "does not exist")]:
        with pytest.raises(InputError, match=said):
            read_exposure(tmp_path / "a.png", StatedExposure(transfer=bad))
    write_table(tmp_path / "curve.csv", {"number": level, "light": level[::-1]})
    with pytest.raises(InputError, match="must"):
        read_exposure(tmp_path / "a.png", StatedExposure(transfer=tmp_path / "curve.csv"))


def test_the_curve_is_estimated_from_a_bracket(tmp_path):
    """Five exposures through sRGB's curve, unknown to the estimate: within 3 % of white, Debevec's smoothness; and the
    command line uses it.
    """
    light = np.exp(RANDOM.uniform(np.log(0.002), np.log(2.0), (64, 64, 3)))
    times = (0.25, 0.5, 1.0, 2.0, 4.0)
    shots = [srgb_photograph(light, t) for t in times]
    curve = estimate_transfer(shots, times)
    true = Transfer.load("srgb", 255).table
    assert np.abs(curve.table - true)[20:250].max() < 0.03 * 255.0
    with pytest.raises(InputError, match="3 exposures or more"):
        estimate_transfer(shots[:2], times[:2])
    paths = []
    for k, picture in enumerate(shots):
        paths.append(str(tmp_path / f"{k}.png"))
        write_png(paths[-1], picture)
    command = ["develop", *paths, "--exposures", *map(str, times), "--out", str(tmp_path / "a.exr")]
    noise = ["--gain", "78", "--read-noise", "10"]
    assert main([*command, "--transfer", "estimate", *noise]) == 0
    layers = read_exr(tmp_path / "a.exr")[0]
    valid = layers["A"] == 1.0
    values, true = np.stack([layers[c] for c in "RGB"], axis=2)[valid], light[valid]
    assert np.abs(values / values.mean() - true / true.mean()).max() < 0.03 * true.max() / true.mean()
    variance = np.stack([layers[f"variance.{c}"] for c in "RGB"], axis=2)[valid]
    scale = (values * true).sum() / (true**2).sum()  # the estimate's last number is its unit
    assert np.mean(np.abs(values - scale * true) < 1.96 * np.sqrt(variance)) > 0.9
    assert main([*command, "--transfer", "linear", "--force", *noise]) == 2


@pytest.mark.parametrize(("power", "full_well"), [(1.0, 20_000), (2.2, 2_000)])
def test_the_error_of_an_estimated_curve_holds_the_truth(power, full_well):
    """Five noisy exposures through a power law: at least 90 % of the numbers' light within 1.96 standard errors, which
    are not idle: below 3 % of white. The variance of the light has it, beside that of the rounding.
    """
    random = np.random.default_rng(3)
    light, times = np.exp(random.uniform(np.log(0.002), np.log(2.0), (80, 100, 3))), (0.25, 0.5, 1.0, 2.0, 4.0)
    caught = [np.clip(random.poisson(light * t * full_well) / full_well, 0.0, 1.0) for t in times]
    curve = estimate_transfer([np.rint(255.0 * one ** (1.0 / power)).astype(np.uint8) for one in caught], times)
    assert curve.error is not None
    true, told = 255.0 * (np.arange(256) / 255.0)[:, None] ** power, np.s_[3:252]
    assert np.mean(np.abs(curve.table - true)[told] < 1.96 * curve.error[told]) > 0.9
    assert curve.error.max() < 0.03 * 255.0
    variance = np.asarray(curve.light(np.full((1, 1, 3), 128, np.uint8))[2])
    np.testing.assert_allclose(variance[0, 0], curve.error[128] ** 2, rtol=1e-6)


def test_sixteen_bits_and_float_are_linear_as_they_are(tmp_path):
    write_png(tmp_path / "a.png", COLOUR16)
    shot = read_exposure(tmp_path / "a.png", StatedExposure(black=100.0, white=60_000.0, exposure_s=0.5))
    np.testing.assert_allclose(shot.signal, COLOUR16 - 100.0, atol=0.01)  # float32
    np.testing.assert_array_equal(shot.full, COLOUR16 >= 60_000)
    assert shot.seconds == 0.5 and shot.white == 59_900.0
    values = RANDOM.uniform(0.0, 3.0, (5, 7, 3)).astype(np.float32)
    write_exr(tmp_path / "a.exr", dict(zip("RGB", np.moveaxis(values, 2, 0), strict=True)))
    np.testing.assert_array_equal(read_exposure(tmp_path / "a.exr").signal, values)
    write_png(tmp_path / "m.png", COLOUR16[..., 0])
    assert read_exposure(tmp_path / "m.png", StatedExposure(mosaic="GBRG")).signal.shape == (13, 17)
    for path, given, said in [
        ("m.png", StatedExposure(mosaic="XTRANS"), "mosaic 'XTRANS' is unknown"),
        ("m.png", StatedExposure(black=7.0, white=3.0), "below white"),
        ("a.toml", StatedExposure(), "does not exist|not a photograph"),
    ]:
        with pytest.raises(InputError, match=said):
            read_exposure(Path(tmp_path / path), given)
