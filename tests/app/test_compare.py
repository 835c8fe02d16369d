"""The measures of compare, each against its definition."""

import numpy as np
import OpenEXR
import pytest

from hagoromo.errors import InputError
from hagoromo.files.png import write_png
from hagoromo.image.picture.compare import compare


@pytest.fixture
def reference(tmp_path):
    image = np.random.default_rng(3).uniform(0.1, 0.8, (31, 43, 3)).astype(np.float32)
    return image, write(tmp_path / "b.exr", image)


def write(path, image):
    """By OpenEXR itself, as other programs do: this package writes no NaN."""
    channels = {name: np.ascontiguousarray(image[..., k], np.float32) for k, name in enumerate("RGB")}
    with OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(path))
    return path


def test_a_scaled_image_is_off_by_its_scale(reference, tmp_path):
    """A factor 1.1 is a relative error of 0.1 at every pixel; float32 keeps 6 digits."""
    image, b = reference
    found = compare(write(tmp_path / "a.exr", 1.1 * image), b)
    rmse = 0.1 * np.sqrt(np.mean(image.astype(float) ** 2))
    assert found.relative_rmse == pytest.approx(0.1, rel=1e-5)
    assert found.peak == pytest.approx(float(image.max()))
    assert found.psnr == pytest.approx(20 * np.log10(image.max() / rmse), rel=1e-5)
    assert 0.9 < found.ssim < 1.0 and 0.5 < found.delta_e_2000 < 5.0


def test_an_image_equals_itself(reference):
    found = compare(reference[1], reference[1])
    assert (found.psnr, found.ssim, found.delta_e_2000, found.relative_rmse) == (None, 1.0, 0.0, 0.0)


def test_outside_the_mask_nothing_counts(reference, tmp_path):
    image, b = reference
    other, mask = image.copy(), np.full((31, 43), 255, np.uint8)
    other[5:9, 7:18], mask[5:9, 7:18] = np.nan, 0
    write_png(tmp_path / "mask.png", mask)
    found = compare(write(tmp_path / "a.exr", other), b, tmp_path / "mask.png")
    assert found.relative_rmse == 0.0 and found.pixels == 31 * 43 - 44
    with pytest.raises(InputError, match="not finite"):
        compare(tmp_path / "a.exr", b)


def test_one_step_of_a_png_is_one_step_of_255(tmp_path):
    image = np.full((29, 23, 3), 100, np.uint8)
    write_png(tmp_path / "b.png", image)
    write_png(tmp_path / "a.png", image + np.uint8(1))
    found = compare(tmp_path / "a.png", tmp_path / "b.png")
    assert found.psnr == pytest.approx(20 * np.log10(255)) and found.peak == 1.0
    assert found.relative_rmse == pytest.approx(0.01)
    # one step of grey is 0.4 units of L*, of which ΔE00 counts a little more in the dark
    assert 0.3 < found.delta_e_2000 < 0.5


def test_what_cannot_be_compared_is_refused(reference, tmp_path):
    image, b = reference
    write_png(tmp_path / "a.png", np.zeros((31, 43, 3), np.uint8))
    for other, said in [
        (write(tmp_path / "small.exr", image[:-2]), r"43 × 29 × 3.*43 × 31 × 3.*equal sizes"),
        (tmp_path / "a.png", "two PNG or two EXR"),
        (tmp_path / "absent.exr", "does not exist"),
    ]:
        with pytest.raises(InputError, match=said):
            compare(other, b)
    write_png(tmp_path / "mask.png", np.zeros((31, 43), np.uint8))
    with pytest.raises(InputError, match="0 pixels"):
        compare(b, b, tmp_path / "mask.png")


def test_arrays_and_files_compare_alike(reference, tmp_path):
    image, b = reference
    other = np.clip(image + np.random.default_rng(5).normal(0.0, 0.02, image.shape), 0.0, 1.0).astype(np.float32)
    assert compare(other, image) == compare(write(tmp_path / "a.exr", other), b)
    numbers = [np.rint(255.0 * picture).astype(np.uint8) for picture in (other, image)]
    for name, picture in zip(("a.png", "b.png"), numbers, strict=True):
        write_png(tmp_path / name, picture)
    assert compare(*numbers) == compare(tmp_path / "a.png", tmp_path / "b.png")
    with pytest.raises(InputError, match="cannot be compared"):
        compare(numbers[0], image)
